//! What rays hit.

mod box_scene;

pub use box_scene::BoxScene;

use glam::DVec3;

/// A surface point that a ray reached first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance from the ray's origin, m.
    pub distance_m: f64,
    /// Unit normal, turned against the ray.
    pub normal: DVec3,
}

/// A scene in world coordinates.
#[derive(Clone, Debug)]
pub enum Scene {
    /// An axis-aligned box seen from inside.
    Box(BoxScene),
}

impl Scene {
    /// First surface along a ray (unit direction), or none.
    pub fn cast(&self, origin_m: DVec3, direction: DVec3) -> Option<Hit> {
        match self {
            Scene::Box(scene) => scene.cast(origin_m, direction),
        }
    }

    /// Least axis-aligned box around every surface, m.
    pub fn bounds_m(&self) -> [DVec3; 2] {
        match self {
            Scene::Box(scene) => [scene.min_m, scene.max_m],
        }
    }
}
