//! Who sees what of a scene, in 3-D.

use super::Orbit;
use crate::report::{BlindSpot, figures};
use crate::rig::Rig;
use crate::simulate::occluder::Occluder;
use crate::world::coverage::Coverage;
use crate::world::local_origin::LocalOrigin;
use crate::world::scene::Scene;
use crate::world::trajectory::Trajectory;

/// The observable voxels by who saw them, with trajectory and rig. `others`: solids of the body other than housings.
pub(crate) fn seen(
    scene: &Scene,
    trajectory: &Trajectory,
    (rig, others): (&Rig, &[Occluder]),
    coverage: &Coverage,
    observable: &[usize],
    spots: &[BlindSpot],
    origin: LocalOrigin,
) -> Orbit {
    let names: Vec<&str> = rig.sensors.iter().map(|sensor| sensor.name.as_str()).collect();
    let classes = figures::who_classes(&names, "observable, but unseen");
    let mut orbit = Orbit::new("Who sees what, and where the rig goes", scene, origin);
    let grid = coverage.grid();
    let points = observable.iter().map(|cell| (grid.centre_m(*cell), figures::who_covers(coverage, *cell)));
    orbit.classes(&classes, grid.voxel_m, points);
    orbit.trajectory(trajectory);
    orbit.rig(rig, &trajectory.at_offset_ns(0.0), others);
    orbit.spots(spots);
    orbit
}
