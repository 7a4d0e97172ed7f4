//! Walks that a person could take through any scene.

use glam::DVec3;

use super::StudyError;
use crate::base::geometry::Pose;
use crate::world::scene::Scene;
use crate::world::trajectory::Trajectory;

/// Height of the rig above the ground, m.
pub(super) const HEIGHT_M: f64 = 1.6;
const SPEED_M_S: f64 = 1.2;
const TURN_RAD_S: f64 = 1.5;
/// A walk keeps this far from walls.
const CLEARANCE_M: f64 = 0.5;
/// And is at most so long.
const LONGEST_M: f64 = 12.0;
/// Shortest walk.
const SHORTEST_M: f64 = 2.0;
/// Places along each side of the scene at which a walk is looked for, besides its middle.
const PLACES: u32 = 9;
const DIRECTIONS: u32 = 24;
/// A pause of a walk that stops, and the distance between two, m.
const PAUSE_NS: u64 = 2_000_000_000;
const PAUSE_EVERY_M: f64 = 2.0;
/// Steps of stairs, m.
const STEP_UP_M: f64 = 0.17;
const STEP_ON_M: f64 = 0.29;
/// Flights are no higher than this.
const FLIGHT_M: f64 = 0.85;

/// A kind of walk.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Walk {
    /// Along a line.
    Straight,
    /// Around a place and back to the beginning.
    Loop,
    /// Along a line with pauses.
    StopAndGo,
    /// Along a line, up a few steps and down again.
    Stairs,
}

impl Walk {
    pub const ALL: [Self; 4] = [Self::Straight, Self::Loop, Self::StopAndGo, Self::Stairs];

    /// The walk through a scene, along the longest free line that is found or around its middle.
    pub(crate) fn through(self, scene: &Scene) -> Result<Trajectory, StudyError> {
        let [from_m, to_m] = longest_line(scene).ok_or_else(|| {
            StudyError(format!("no place to stand with {SHORTEST_M} m of free floor was found in it"))
        })?;
        let line = |corners_m: &[DVec3]| {
            Trajectory::polyline(corners_m, SPEED_M_S, TURN_RAD_S, 0).map_err(StudyError::of)
        };
        match self {
            Self::Straight => line(&[from_m, to_m]),
            Self::Loop => {
                let middle_m = (from_m + to_m) / 2.0;
                let along = (to_m - from_m) / 2.0;
                let across = DVec3::Z.cross(along).normalize();
                let [left_m, right_m] = [across, -across].map(|side| free_m(scene, middle_m, side));
                let corners_m = [from_m, middle_m - right_m * across, to_m, middle_m + left_m * across];
                Trajectory::closed_loop(&corners_m, SPEED_M_S, TURN_RAD_S, 0).map_err(StudyError::of)
            }
            Self::StopAndGo => with_pauses(&line(&[from_m, to_m])?),
            Self::Stairs => line(&steps(from_m, to_m)),
        }
    }
}

/// Ends of the longest free line at body height.
pub(super) fn longest_line(scene: &Scene) -> Option<[DVec3; 2]> {
    let [low_m, high_m] = scene.bounds_m();
    let share = |n: u32| f64::from(n) / f64::from(PLACES + 1);
    let grid = (1..=PLACES).flat_map(|i| (1..=PLACES).map(move |j| [share(i), share(j)]));
    let places = std::iter::once([0.5, 0.5]).chain(grid);
    let stands = places.filter_map(|[u, v]| {
        let at = DVec3::new(low_m.x + u * (high_m.x - low_m.x), low_m.y + v * (high_m.y - low_m.y), 0.0);
        Some(DVec3 { z: ground_m(scene, at)? + HEIGHT_M, ..at })
    });
    let lines = stands.flat_map(|stand_m| {
        (0..DIRECTIONS).map(move |step| {
            let (sin, cos) = (std::f64::consts::PI * f64::from(step) / f64::from(DIRECTIONS)).sin_cos();
            let direction = DVec3::new(cos, sin, 0.0);
            let ahead_m = free_m(scene, stand_m, direction);
            let back_m = free_m(scene, stand_m, -direction);
            [stand_m - back_m * direction, stand_m + ahead_m * direction]
        })
    });
    // the first of equals: the middle before all others
    let longest = lines.fold(None, |best: Option<[DVec3; 2]>, line| match best {
        Some(best) if best[0].distance(best[1]) >= line[0].distance(line[1]) - 1e-6 => Some(best),
        _ => Some(line),
    });
    longest.filter(|[from_m, to_m]| from_m.distance(*to_m) >= SHORTEST_M)
}

/// The lowest surface at a place above which a person can stand.
fn ground_m(scene: &Scene, at: DVec3) -> Option<f64> {
    const HEAD_ROOM_M: f64 = HEIGHT_M + CLEARANCE_M;
    let [low_m, high_m] = scene.bounds_m();
    let mut below_m = low_m.z - 1.0;
    while below_m < high_m.z {
        let floor = scene.cast(DVec3 { z: below_m, ..at }, DVec3::Z)?;
        let floor_m = below_m + floor.distance_m;
        let above = scene.cast(DVec3 { z: floor_m + 1e-3, ..at }, DVec3::Z);
        if above.is_none_or(|hit| hit.distance_m > HEAD_ROOM_M) {
            return Some(floor_m);
        }
        below_m = floor_m + 1e-3;
    }
    None
}

/// How far a person can go, m: what stands at the height of the rig, of the hips or of the knees ends it.
fn free_m(scene: &Scene, from_m: DVec3, direction: DVec3) -> f64 {
    let at = |height_m: f64| {
        let from_m = DVec3 { z: from_m.z - HEIGHT_M + height_m, ..from_m };
        scene.cast(from_m, direction).map_or(LONGEST_M, |hit| hit.distance_m)
    };
    let nearest_m = [HEIGHT_M, 1.0, 0.5].into_iter().map(at).fold(LONGEST_M, f64::min);
    (nearest_m - CLEARANCE_M).clamp(0.0, LONGEST_M / 2.0)
}

/// The same trajectory with a pause every two metres.
fn with_pauses(trajectory: &Trajectory) -> Result<Trajectory, StudyError> {
    let [start_ns, end_ns] = trajectory.time_span_ns();
    let step_ns = (PAUSE_EVERY_M / SPEED_M_S * 1e9) as u64;
    let mut stamped: Vec<(u64, Pose)> = Vec::new();
    let (mut late_ns, mut at_ns) = (0, start_ns);
    while at_ns < end_ns {
        let Some(pose) = trajectory.at(at_ns) else { break };
        stamped.push((at_ns + late_ns, pose));
        late_ns += PAUSE_NS;
        stamped.push((at_ns + late_ns, pose));
        at_ns += step_ns;
    }
    stamped.extend(trajectory.at(end_ns).map(|pose| (end_ns + late_ns, pose)));
    Trajectory::new(stamped).map_err(StudyError::of)
}

/// Corners of a path up a flight of steps at its middle and down again.
fn steps(from_m: DVec3, to_m: DVec3) -> Vec<DVec3> {
    let length_m = from_m.distance(to_m);
    let direction = (to_m - from_m) / length_m;
    let most = ((length_m / 2.0 - 0.5) / STEP_ON_M).floor().max(1.0);
    let count = (FLIGHT_M / STEP_UP_M).floor().min(most) as u32;
    let flight_m = f64::from(count) * STEP_ON_M;
    let middle_m = length_m / 2.0;
    let at = |along_m: f64, up_m: f64| from_m + along_m * direction + up_m * DVec3::Z;
    let mut corners_m = vec![from_m];
    for n in 0..=count {
        corners_m.push(at(middle_m - flight_m + f64::from(n) * STEP_ON_M, f64::from(n) * STEP_UP_M));
    }
    for n in (0..count).rev() {
        corners_m.push(at(middle_m + flight_m - f64::from(n) * STEP_ON_M, f64::from(n) * STEP_UP_M));
    }
    corners_m.push(to_m);
    corners_m
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::scene::Mesh;
    use std::sync::Arc;

    /// Walls, floor and ceiling, seen from both sides.
    fn room_of(half_x_m: f64, half_y_m: f64, height_m: f64) -> Scene {
        let side = |corner: usize, bit: usize, half: f64| if corner >> bit & 1 == 1 { half } else { -half };
        let corner = |n: usize| {
            let up_m = if n >> 2 & 1 == 1 { height_m } else { 0.0 };
            DVec3::new(side(n, 0, half_x_m), side(n, 1, half_y_m), up_m)
        };
        let walls = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
        let faces = walls.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
        Scene::Mesh(Arc::new(Mesh::new((0..8).map(corner).collect(), faces).unwrap()))
    }

    fn room() -> Scene {
        room_of(4.0, 3.0, 2.8)
    }

    #[test]
    fn every_walk_stays_in_the_room_at_the_height_of_its_rig() {
        for walk in Walk::ALL {
            let trajectory = walk.through(&room()).unwrap();
            let stations = trajectory.stations_m(0.25);
            assert!(stations.len() > 10, "{walk:?}");
            for at in &stations {
                // half a metre along the path is less across
                assert!(at.x.abs() < 3.95 && at.y.abs() < 2.95, "{walk:?}: {at}");
                assert!((HEIGHT_M - 1e-6..HEIGHT_M + FLIGHT_M + 1e-6).contains(&at.z), "{walk:?}: {at}");
            }
            let climbs = stations.iter().any(|at| at.z > HEIGHT_M + 0.5);
            assert_eq!(climbs, walk == Walk::Stairs);
        }
        let span_s = |walk: Walk| {
            let [start_ns, end_ns] = walk.through(&room()).unwrap().time_span_ns();
            (end_ns - start_ns) as f64 * 1e-9
        };
        assert!(span_s(Walk::StopAndGo) > span_s(Walk::Straight) + 5.0);
    }

    #[test]
    fn the_ground_is_the_lowest_floor_with_room_for_a_head() {
        assert!((ground_m(&room(), DVec3::new(0.5, 0.5, 0.0)).unwrap()).abs() < 1e-2);
        // a person stands not in a crawl space, but on its roof
        let low = room_of(4.0, 3.0, 1.5);
        assert!((ground_m(&low, DVec3::new(0.5, 0.5, 0.0)).unwrap() - 1.5).abs() < 1e-2);
        let closet = room_of(0.5, 0.5, 2.5);
        assert!(Walk::Straight.through(&closet).unwrap_err().to_string().contains("free floor"));
    }
}
