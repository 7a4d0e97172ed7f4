//! Trajectories through a scene without a recording: along given corners, or planned through the free floor, at the
//! height of a backpack above it.

mod planned;

pub(crate) use planned::planned;

use glam::{DVec2, DVec3};

use crate::world::local_origin::LocalOrigin;
use crate::world::scene::Scene;
use crate::world::trajectory::{Trajectory, TrajectoryError};

/// Height of the body's origin above the floor, m: that of the published walk.
pub(crate) const BODY_HEIGHT_M: f64 = 1.6;
/// Speed of a planned walk, m/s, and of a turn on the spot, rad/s.
const SPEED_M_S: f64 = 1.2;
const TURN_RAD_S: f64 = 1.0;
/// Time between its poses, ns: readers of its file doubt gaps.
const BETWEEN_POSES_NS: u64 = 100_000_000;
/// Free height that somebody with a rig needs, m.
const HEADROOM_M: f64 = 2.0;
/// Surfaces nearer to each other than this are one, m.
const SURFACE_M: f64 = 0.05;
/// Longest walk along waypoints, m: every revolution of it is cast.
const MOST_M: f64 = 20_000.0;
/// Surfaces above one another that are looked at.
const MOST_SURFACES: usize = 400;

/// A corner of a walk; its height where it was given.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Waypoint {
    pub at_m: DVec2,
    /// Of the body's origin, m.
    pub z_m: Option<f64>,
}

impl Waypoint {
    /// The same in a local frame.
    pub(crate) fn local(&self, origin: LocalOrigin) -> Self {
        let from_m = origin.world_m();
        Self { at_m: self.at_m - from_m.truncate(), z_m: self.z_m.map(|z_m| z_m - from_m.z) }
    }
}

/// Why there is no walk.
#[derive(Debug, thiserror::Error)]
pub(crate) enum WalkError {
    #[error(
        "waypoint {number} ({x_m}, {y_m}): no floor with {HEADROOM_M} m of free height above it; give waypoints over a floor, or \
         x,y,z with the height of the rig"
    )]
    NoFloor { number: usize, x_m: f64, y_m: f64 },
    #[error(
        "no floor to walk on was found: nothing with {HEADROOM_M} m of free height above it that hangs together; give a \
         --trajectory (is the z axis up, and the unit right?)"
    )]
    NoFreeFloor,
    #[error("a walk of {length_m:.0} m, expected {MOST_M:.0} m at most: give nearer waypoints")]
    TooLong { length_m: f64 },
    #[error("waypoints: {0}")]
    Shape(#[from] TrajectoryError),
}

/// A walk that was planned.
#[derive(Debug)]
pub(crate) struct Walk {
    pub trajectory: Trajectory,
    pub corners_m: Vec<DVec3>,
    /// What is odd about it.
    pub doubts: Vec<String>,
}

fn polyline(corners_m: &[DVec3]) -> Result<Trajectory, TrajectoryError> {
    Ok(Trajectory::polyline(corners_m, SPEED_M_S, TURN_RAD_S, 0)?.filled(BETWEEN_POSES_NS))
}

/// A walk along corners.
pub(crate) fn along(scene: &Scene, waypoints: &[Waypoint]) -> Result<Walk, WalkError> {
    let mut corners_m: Vec<DVec3> = Vec::new();
    let mut floor_before_m: Option<f64> = None;
    for (number, waypoint) in waypoints.iter().enumerate() {
        let at_m = waypoint.at_m;
        let z_m = match waypoint.z_m {
            Some(z_m) => z_m,
            None => {
                let floors_m = floors_m(scene, at_m);
                // stairs: the floor nearest to where the walk comes from, at first the lowest
                let near = |floor_m: &f64| floor_before_m.map_or(*floor_m, |before| (floor_m - before).abs());
                let floor_m = floors_m.into_iter().min_by(|a, b| near(a).total_cmp(&near(b)));
                floor_m.ok_or(WalkError::NoFloor { number: number + 1, x_m: at_m.x, y_m: at_m.y })?
                    + BODY_HEIGHT_M
            }
        };
        floor_before_m = Some(z_m - BODY_HEIGHT_M);
        corners_m.push(at_m.extend(z_m));
    }
    let length_m = corners_m.windows(2).map(|pair| pair[0].distance(pair[1])).sum();
    if length_m > MOST_M {
        return Err(WalkError::TooLong { length_m });
    }
    let trajectory = polyline(&corners_m)?;
    let through = |(leg, pair): (usize, &[DVec3])| {
        (pair[0] != pair[1] && !scene.sees(pair[0], pair[1], SURFACE_M)).then(|| {
            format!("the walk from waypoint {} to waypoint {} goes through a surface", leg + 1, leg + 2)
        })
    };
    let doubts = corners_m.windows(2).enumerate().filter_map(through).collect();
    Ok(Walk { trajectory, corners_m, doubts })
}

/// Heights of the floors at a place, ascending: surfaces with room for somebody above them, roofs left out.
fn floors_m(scene: &Scene, at_m: DVec2) -> Vec<f64> {
    let [low_m, high_m] = scene.bounds_m();
    if let Scene::Box(_) = scene {
        let is_inside = at_m.cmpge(low_m.truncate()).all() && at_m.cmple(high_m.truncate()).all();
        let is_high = high_m.z - low_m.z >= HEADROOM_M;
        return (is_inside && is_high).then_some(low_m.z).into_iter().collect();
    }
    let mut surfaces_m: Vec<f64> = Vec::new();
    let mut z_m = low_m.z - 1.0;
    while surfaces_m.len() < MOST_SURFACES {
        let Some(hit) = scene.cast(at_m.extend(z_m), DVec3::Z) else { break };
        let surface_m = z_m + hit.distance_m;
        surfaces_m.push(surface_m);
        z_m = surface_m + SURFACE_M;
    }
    let is_floor =
        |at: &usize| surfaces_m.get(at + 1).is_none_or(|above_m| above_m - surfaces_m[*at] >= HEADROOM_M);
    let mut floors_m: Vec<f64> = (0..surfaces_m.len()).filter(is_floor).map(|at| surfaces_m[at]).collect();
    // what has nothing above it and a floor below it is a roof
    if floors_m.len() > 1 && floors_m.last() == surfaces_m.last() {
        floors_m.pop();
    }
    floors_m
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::scene::BoxScene;

    fn room() -> Scene {
        Scene::Box(BoxScene::closed(DVec3::new(-4.0, -3.0, 0.5), DVec3::new(4.0, 3.0, 3.5)))
    }

    fn waypoint(x: f64, y: f64, z_m: Option<f64>) -> Waypoint {
        Waypoint { at_m: DVec2::new(x, y), z_m }
    }

    #[test]
    fn a_walk_is_carried_above_the_floor() {
        let corners = [waypoint(0.0, 0.0, None), waypoint(3.0, 0.0, None), waypoint(3.0, 2.0, Some(1.0))];
        let Walk { trajectory, doubts, .. } = along(&room(), &corners).unwrap();
        let heights_m: Vec<f64> = trajectory.stamped().map(|(_, pose)| pose.translation_m.z).collect();
        assert!((heights_m[0] - 2.1).abs() < 1e-12 && (heights_m[heights_m.len() - 1] - 1.0).abs() < 1e-12);
        assert!(doubts.is_empty(), "{doubts:?}");
    }

    #[test]
    fn a_waypoint_without_a_floor_is_named() {
        let error = along(&room(), &[waypoint(0.0, 0.0, None), waypoint(9.0, 0.0, None)]).unwrap_err();
        assert!(error.to_string().contains("waypoint 2 (9, 0)"), "{error}");
        let error = along(&room(), &[waypoint(0.0, 0.0, None)]).unwrap_err();
        assert!(error.to_string().contains("two different corners"), "{error}");
    }
}
