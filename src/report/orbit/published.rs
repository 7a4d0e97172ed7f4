//! The published experiment in 3-D: who sees what of its box.

use super::Orbit;
use crate::base::geometry::{BODY_FROM_MOUNT_FRAME, Pose};
use crate::design::objective::Objective;
use crate::report::figures;
use crate::rig::{Path, Rig};
use crate::world::coverage::Coverage;
use crate::world::local_origin::LocalOrigin;
use crate::world::scene::{BoxScene, Scene};
use crate::world::trajectory::Trajectory;

/// The walls of the box by who saw them, with path and rig; `coverage` is in the mount frame's axes.
pub(crate) fn published(objective: &Objective, rig: &Rig, coverage: &Coverage) -> Orbit {
    let experiment = objective.simulator().experiment();
    let preset = &experiment.preset;
    let corners_m =
        [preset.box_min_m, preset.box_max_m].map(|corner| BODY_FROM_MOUNT_FRAME * glam::DVec3::from(corner));
    let walls = BoxScene::closed(corners_m[0].min(corners_m[1]), corners_m[0].max(corners_m[1]));
    let mut orbit = Orbit::new("Who sees what of the box", &Scene::Box(walls), LocalOrigin::default());
    let names: Vec<&str> = rig.sensors.iter().map(|sensor| sensor.name.as_str()).collect();
    let grid = coverage.grid();
    let points = grid
        .outer_cells()
        .map(|cell| (BODY_FROM_MOUNT_FRAME * grid.centre_m(cell), figures::who_covers(coverage, cell)));
    orbit.classes(&figures::who_classes(&names, "observable, but unseen"), grid.voxel_m, points);
    let half_m = 0.5 * preset.path_length_m;
    let along = match experiment.path {
        Path::Lateral => BODY_FROM_MOUNT_FRAME * glam::DVec3::X,
        Path::Forward => BODY_FROM_MOUNT_FRAME * glam::DVec3::Y,
    };
    let height_m = preset.platform_height_m * glam::DVec3::Z;
    let pose = |share: f64| Pose::from_translation(height_m + share * half_m * along);
    if let Ok(trajectory) = Trajectory::new(vec![(0, pose(-1.0)), (1_000_000_000, pose(1.0))]) {
        orbit.trajectory(&trajectory);
    }
    orbit.rig(rig, &pose(0.0), &[]);
    orbit
}
