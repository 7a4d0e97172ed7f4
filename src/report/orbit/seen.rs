//! Who sees what of a scene, in 3-D.

use glam::DVec3;

use super::Orbit;
use crate::report::{BlindSpot, figures};
use crate::rig::Rig;
use crate::simulate::occluder::Occluder;
use crate::world::local_origin::LocalOrigin;
use crate::world::scene::Scene;
use crate::world::trajectory::Trajectory;

/// What is observable by who saw it (a class of [`figures::who_classes`] for each place), with trajectory and rig. `others`:
/// solids of the body other than housings.
pub(crate) fn seen(
    scene: &Scene,
    trajectory: &Trajectory,
    (rig, others): (&Rig, &[Occluder]),
    size_m: f64,
    points: impl Iterator<Item = (DVec3, usize)>,
    spots: &[BlindSpot],
    origin: LocalOrigin,
) -> Orbit {
    let names: Vec<&str> = rig.sensors.iter().map(|sensor| sensor.name.as_str()).collect();
    let classes = figures::who_classes(&names, "observable, but unseen");
    let mut orbit = Orbit::new("Who sees what, and where the rig goes", scene, origin);
    orbit.classes(&classes, size_m, points);
    orbit.trajectory(trajectory);
    orbit.rig(rig, &trajectory.at_offset_ns(0.0), others);
    orbit.spots(spots);
    orbit
}
