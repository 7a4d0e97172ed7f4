//! A recording on its scene, in 3-D: where its rays end and what became of them.

use super::Orbit;
use crate::report::chart::CellClass;
use crate::rig::Rig;
use crate::verify::compare::{PlacedRay, RayClass, Replayed};
use crate::world::local_origin::LocalOrigin;
use crate::world::scene::Scene;
use crate::world::trajectory::Trajectory;

/// Rays drawn.
const MAX_RAYS: usize = 120_000;
/// Edge of a drawn point, m.
const POINT_M: f64 = 0.04;

/// Classes of rays, in the colours of the pictures of cells.
fn classes() -> [CellClass; 5] {
    [
        CellClass::new("c-both", "agree: recorded where predicted"),
        CellClass::new("c-right", "short: recorded nearer than predicted"),
        CellClass::new("c-odd", "long: recorded farther than predicted"),
        CellClass::new("c-bad", "missed: predicted, nothing recorded"),
        CellClass::new("c-left", "unexpected: recorded, nothing predicted"),
    ]
}

/// Rays of a replayed recording by class, with trajectory and rig.
pub(crate) fn compared(
    replayed: &Replayed,
    scene: &Scene,
    trajectory: &Trajectory,
    agree_within_m: f64,
    origin: LocalOrigin,
) -> Orbit {
    let mut orbit = Orbit::new("Recorded rays by whether they end as predicted", scene, origin);
    let step = replayed.sampled.len().div_ceil(MAX_RAYS).max(1);
    let points = replayed.sampled.iter().step_by(step).filter_map(|ray| {
        let placed: PlacedRay = ray.place_on(&replayed.sensors, trajectory, ray.time_ns)?;
        let predicted_m = placed.cast(scene, &replayed.sensors[ray.sensor]).map(|(range_m, _)| range_m);
        let end_m = |range_m| Some(placed.at_range(range_m));
        let class = match RayClass::in_scene(scene, predicted_m, ray.range_m, agree_within_m, end_m) {
            RayClass::Agree => 0,
            RayClass::Short => 1,
            RayClass::Long => 2,
            RayClass::Drop => 3,
            RayClass::Extra => 4,
            RayClass::Nothing | RayClass::Unplaced => return None,
        };
        Some((placed.at_range(ray.range_m.or(predicted_m)?), class))
    });
    orbit.classes(&classes(), POINT_M, points);
    orbit.trajectory(trajectory);
    orbit.rig(&Rig { sensors: replayed.sensors.clone() }, &trajectory.at_offset_ns(0.0), &[]);
    orbit
}
