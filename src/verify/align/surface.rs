//! Surfaces of a walk and of a scene as points with the direction that they face.

use std::collections::HashMap;

use glam::{DQuat, DVec3};
use rayon::prelude::*;

use crate::base::geometry::Pose;
use crate::verify::compare::box_points;
use crate::verify::odometry::{Cells, Moments, PointMap};
use crate::world::scene::Scene;

/// Edge of the cells in which points, with those around them, make a plane, m.
const CELL_M: f64 = 0.2;
/// Samples of a scene per square metre, and their bounds.
const SAMPLES_PER_M2: f64 = 80.0;
const SAMPLES: [f64; 2] = [60_000.0, 500_000.0];
/// Of the samples.
const SEED: u64 = 1;
/// Up to this lean of its normal from the vertical a surface is a floor or a ceiling; from there on it is a wall.
const LEVEL: f64 = 0.94;
const STEEP: f64 = 0.7;

/// A piece of surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Patch {
    pub at_m: DVec3,
    /// Unit, of either sign; none where the surface is not flat.
    pub normal: Option<DVec3>,
}

impl Patch {
    pub(crate) fn is_level(&self) -> bool {
        self.normal.is_some_and(|normal| normal.z.abs() > LEVEL)
    }

    /// A wall, or something that is not flat.
    pub(crate) fn is_upright(&self) -> bool {
        self.normal.is_none_or(|normal| normal.z.abs() < STEEP)
    }

    /// Turned about a point that becomes the origin.
    pub(crate) fn turned(&self, rotation: DQuat, about_m: DVec3) -> Self {
        Self { at_m: rotation * (self.at_m - about_m), normal: self.normal.map(|normal| rotation * normal) }
    }
}

/// One patch for each cell that holds points.
pub(super) fn patches_of(points_m: &[DVec3]) -> Vec<Patch> {
    let mut cells: Cells<Moments> = Cells::new(CELL_M);
    let mut number: HashMap<[i64; 3], usize> = HashMap::new();
    let mut sums: Vec<(DVec3, f64)> = Vec::new();
    for point_m in points_m {
        cells.at_mut(*point_m).add(*point_m);
        let key = (*point_m / CELL_M).floor().to_array().map(|at| at as i64);
        let at = *number.entry(key).or_insert_with(|| {
            sums.push((DVec3::ZERO, 0.0));
            sums.len() - 1
        });
        sums[at].0 += *point_m;
        sums[at].1 += 1.0;
    }
    let patch = |(sum, count): &(DVec3, f64)| {
        let at_m = *sum / *count;
        let mut all = Moments::default();
        cells.around(at_m, 1, |cell| all.join(cell));
        Patch { at_m, normal: all.plane(CELL_M).map(|plane| plane.normal) }
    };
    sums.par_iter().map(patch).collect()
}

/// A scene, ready to be searched and laid against.
pub struct Target<'a> {
    pub(super) scene: &'a Scene,
    pub(super) patches: Vec<Patch>,
    /// Planes through the same points.
    pub(super) map: PointMap,
}

/// Edge of the map's cells, m.
const MAP_CELL_M: f64 = 0.25;

impl<'a> Target<'a> {
    /// Samples the whole scene.
    pub fn of(scene: &'a Scene) -> Self {
        let sampled = |points: Vec<(DVec3, DVec3)>| -> Vec<Patch> {
            points.into_iter().map(|(at_m, normal)| Patch { at_m, normal: Some(normal) }).collect()
        };
        let count = |area_m2: f64| (area_m2 * SAMPLES_PER_M2).clamp(SAMPLES[0], SAMPLES[1]) as usize;
        let patches = match scene {
            Scene::Mesh(mesh) => sampled(mesh.sample_with_normals(count(mesh.area_m2()), SEED)),
            Scene::Box(walls) => sampled(box_points(walls, SAMPLES[0] as usize, SEED)),
            Scene::Voxels(map) => patches_of(&map.occupied_m().collect::<Vec<_>>()),
        };
        let points_m: Vec<DVec3> = match scene {
            Scene::Voxels(voxels) => voxels.occupied_m().collect(),
            _ => patches.iter().map(|patch| patch.at_m).collect(),
        };
        let mut map = PointMap::new(MAP_CELL_M);
        map.add(&points_m, &Pose::IDENTITY);
        Self { scene, patches, map }
    }
}
