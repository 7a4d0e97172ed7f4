//! What mounts of an ideal sensor see of a mesh, as the studies of scenes ask it.

use std::path::Path;
use std::sync::Arc;

use super::StudyError;
use crate::rig::{Mount, Rig, Unit};
use crate::simulate::view::{CastView, Precision, Sampling, Shades, ViewError, ViewSite};
use crate::world::coverage::VoxelGrid;
use crate::world::scene::{Scene, load_mesh};
use crate::world::trajectory::Trajectory;

pub(super) const VOXEL_M: f64 = 0.2;

/// A mesh, its grid and the sensor that looks at it.
pub(super) struct MeshSite {
    pub scene: Scene,
    grid: VoxelGrid,
    unit: Unit,
}

impl MeshSite {
    pub(super) fn new(path: &Path, sensor: &str) -> Result<Self, StudyError> {
        let scene = Scene::Mesh(Arc::new(load_mesh(path, None, None).map_err(StudyError::of)?.mesh));
        let unit = Unit::nominal(sensor).map_err(StudyError::of)?;
        Ok(Self { grid: VoxelGrid::centred_on(scene.bounds_m(), VOXEL_M), scene, unit })
    }

    /// The view along a walk, with so many columns per revolution.
    ///
    /// # Errors
    /// A walk shorter than a revolution.
    pub(super) fn view(&self, walk: Trajectory, columns: u32, rate_hz: f64) -> Result<CastView, ViewError> {
        let sampling = Sampling {
            is_ideal: true,
            columns: Some(columns),
            rate_hz: Some(rate_hz),
            ..Sampling::default()
        };
        let site = ViewSite {
            scene: self.scene.clone(),
            trajectory: walk,
            grid: self.grid.clone(),
            shades: Shades::default(),
        };
        CastView::new(site, std::slice::from_ref(&self.unit), &sampling, Precision::Single)
    }

    /// A sensor on each of these mounts.
    pub(super) fn rig(&self, mounts: &[Mount]) -> Rig {
        Rig::of_model(&self.unit.model, mounts)
    }
}
