//! Whether a path lies in a scene: a frame, a unit or an up axis that differ put it outside, or below the floor.

use glam::DVec3;

use super::local_origin::LocalOrigin;
use super::scene::{MeshUnit, Scene};
use super::trajectory::Trajectory;
use crate::base::statistics::median;

/// Coordinates of a scene and of a path in it differ by rounding up to this, m.
const SLACK_M: f64 = 1e-6;
/// Share of the path that may lie off the floor: doors and gaps of a mesh.
const MOST_MISPLACED: f64 = 0.5;
/// A path this far above everything is of another frame, m.
const FARTHEST_ABOVE_M: f64 = 100.0;
/// Walls that a path goes through from which on another unit is tried; in the right one it goes through none.
const LEAST_WALLS: usize = 2;
/// Share of the mesh's longer side that the path then goes along: a short one misses walls in any unit.
const LEAST_SHARE: f64 = 0.5;
/// How high a rig is carried above the floor, and how high rooms are, m.
const CARRIED_M: std::ops::RangeInclusive<f64> = 1.1..=2.1;
const ROOMS_M: std::ops::RangeInclusive<f64> = 2.1..=4.5;

/// Where a path lies.
#[derive(Clone, Debug)]
pub(crate) struct Placement {
    /// What is odd; empty where nothing is.
    pub doubts: Vec<String>,
    /// Whether most of the path lies outside the scene or below its floor: no figure then says anything.
    pub is_wrong: bool,
}

impl Placement {
    /// Of sensors `height_m` above a path; both lie in the local frame that begins at `origin`.
    pub(crate) fn new(scene: &Scene, trajectory: &Trajectory, height_m: f64, origin: LocalOrigin) -> Self {
        let what = scene.kind();
        let [low_m, high_m] = scene.bounds_m();
        let lifted = |point_m: DVec3| point_m + height_m.max(0.0) * DVec3::Z;
        let [path_low_m, path_high_m] = trajectory.bounds_m().map(lifted);
        let is_apart = path_low_m.truncate().cmpgt(high_m.truncate()).any()
            || path_high_m.truncate().cmplt(low_m.truncate()).any()
            || path_high_m.z < low_m.z
            || path_low_m.z > high_m.z + FARTHEST_ABOVE_M;
        if is_apart {
            let box_words = |[low, high]: [DVec3; 2]| {
                let [low, high] = [origin.world(low), origin.world(high)];
                let side = |axis: usize| format!("{:.1} to {:.1}", low[axis], high[axis]);
                format!("x {}, y {}, z {} m", side(0), side(1), side(2))
            };
            let doubt = format!(
                "the path lies outside the {what}: the path at {}, the {what} at {}. Bring both into one frame (shift, unit \
                 --mesh-unit, up axis --up)",
                box_words([path_low_m, path_high_m]),
                box_words([low_m, high_m])
            );
            return Self { doubts: vec![doubt], is_wrong: true };
        }
        let on_path_m = trajectory.sight_stations_m(0.0);
        let is_outside = |at: &DVec3| at.cmplt(low_m - SLACK_M).any() || at.cmpgt(high_m + SLACK_M).any();
        let is_out_of_plan = |at: &DVec3| {
            let at = lifted(*at);
            at.cmplt(low_m - SLACK_M).any() || at.truncate().cmpgt(high_m.truncate() + SLACK_M).any()
        };
        let is_below = |at: &DVec3| is_below_floor(scene, lifted(*at));
        let count = |is: &dyn Fn(&DVec3) -> bool| on_path_m.iter().filter(|at| is(at)).count();
        let (outside, out_of_plan, below) = (count(&is_outside), count(&is_out_of_plan), count(&is_below));
        let mut doubts = Vec::new();
        let all = on_path_m.len();
        if outside > 0 {
            doubts.push(format!(
                "{outside} of {all} points of the path lie outside the {what}; do both use the same frame, unit and up axis?"
            ));
        }
        if below > 0 {
            doubts.push(format!(
                "{below} of {all} points of the path lie below the floor of the {what}, with the sensors {height_m:.2} m above \
                 them: correct the height of the path, or the up axis (--up)"
            ));
        }
        let on_path_m: Vec<DVec3> = on_path_m.into_iter().map(lifted).collect();
        doubts.extend(through_walls(scene, &on_path_m, origin).or_else(|| too_high(scene, &on_path_m)));
        let is_wrong = out_of_plan.max(below) as f64 > MOST_MISPLACED * all as f64;
        Self { doubts, is_wrong }
    }
}

/// A path in metres goes through walls of a mesh in feet, and past them where that is read as such. `path_m` is where the sensors are.
fn through_walls(scene: &Scene, path_m: &[DVec3], origin: LocalOrigin) -> Option<String> {
    let Scene::Mesh(mesh) = scene else { return None };
    let met = |path_m: &[DVec3]| path_m.windows(2).filter(|pair| !scene.sees(pair[0], pair[1], 0.0)).count();
    let walls = met(path_m);
    if walls < LEAST_WALLS {
        return None;
    }
    let foot = MeshUnit::Foot;
    let in_feet = |at_m: &DVec3| origin.local(origin.world(*at_m) / foot.metres());
    let path_feet: Vec<DVec3> = path_m.iter().map(in_feet).collect();
    let [low, high] = mesh.bounds_m();
    let is_inside = path_feet.iter().all(|at| at.cmpge(low).all() && at.cmple(high).all());
    let longer = if high.x - low.x > high.y - low.y { 0 } else { 1 };
    let along = path_feet.iter().map(|at| at[longer]);
    let went = along.clone().fold(f64::MIN, f64::max) - along.fold(f64::MAX, f64::min);
    let is_long = went >= LEAST_SHARE * (high - low)[longer];
    (is_inside && is_long && met(&path_feet) == 0).then(|| {
        let [read, other] = [high - low, (high - low) * foot.metres()]
            .map(|size| format!("{:.1} x {:.1} x {:.1} m", size.x, size.y, size.z));
        format!(
            "the path goes through surfaces of the mesh of {read} {walls} times; read in feet (--mesh-unit {}), it would be {other}, \
             and the path would go through none",
            foot.name()
        )
    })
}

/// A rig that is carried at 1.6 m in a room of 2.4 m is at 5.2 in one of 8 where mesh and path are in feet.
fn too_high(scene: &Scene, path_m: &[DVec3]) -> Option<String> {
    let (mut heights_m, mut rooms_m): (Vec<f64>, Vec<f64>) = path_m
        .iter()
        .filter_map(|at_m| scene.mesh()?.clear_height_m(*at_m))
        .map(|[down, up]| (down, down + up))
        .unzip();
    if 2 * heights_m.len() <= path_m.len() {
        return None;
    }
    let (height_m, room_m) = (median(&mut heights_m)?, median(&mut rooms_m)?);
    let unit = [MeshUnit::Foot, MeshUnit::Inch].into_iter().find(|unit| {
        CARRIED_M.contains(&(height_m * unit.metres())) && ROOMS_M.contains(&(room_m * unit.metres()))
    })?;
    Some(format!(
        "the sensors are {height_m:.2} m above the floor of rooms of {room_m:.2} m; in {} it would be {:.2} and {:.2} m: if that is \
         right, pass --mesh-unit {} and give the trajectory in metres",
        unit.spoken(),
        height_m * unit.metres(),
        room_m * unit.metres(),
        unit.name()
    ))
}

/// Cosine and sine of 20 degrees below the horizon: the walls of a room without a floor are met there.
const SLANTED: [f64; 2] = [0.94, -0.342];

/// A surface above, none below, and hardly any slanting down: a place under everything.
fn is_below_floor(scene: &Scene, at_m: DVec3) -> bool {
    if !matches!(scene, Scene::Mesh(_)) {
        return false; // a room has its bounds, a map its gaps
    }
    let sees = |direction: DVec3| scene.cast(at_m, direction).is_some();
    let around = || {
        (0..8)
            .map(|n| f64::from(n) * std::f64::consts::FRAC_PI_4)
            .map(|yaw| DVec3::new(SLANTED[0] * yaw.cos(), SLANTED[0] * yaw.sin(), SLANTED[1]).normalize())
    };
    !sees(DVec3::NEG_Z) && sees(DVec3::Z) && around().filter(|direction| sees(*direction)).count() <= 2
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::geometry::Pose;
    use crate::world::scene::Mesh;

    /// A floor of 20 x 20 m at z = 0.
    fn floor() -> Scene {
        let corners = [[-10., -10., 0.], [10., -10., 0.], [10., 10., 0.], [-10., 10., 0.]];
        let mesh = Mesh::new(corners.map(DVec3::from).to_vec(), vec![[0, 1, 2], [0, 2, 3]]).unwrap();
        Scene::Mesh(mesh.into())
    }

    fn placed(from_m: [f64; 3], to_m: [f64; 3]) -> Placement {
        let path = Trajectory::straight(from_m.into(), to_m.into(), 1.0, 0);
        Placement::new(&floor(), &path, 0.1, LocalOrigin::default())
    }

    #[test]
    fn above_ground_is_right_and_below_or_outside_wrong() {
        assert!(!placed([-5., 0., 1.5], [5., 0., 1.5]).is_wrong);
        for (from_m, to_m, words) in [
            ([-5., 0., -1.5], [5., 0., -1.5], "outside the mesh: the path at x -5.0 to 5.0"),
            ([30., 0., 1.5], [35., 0., 1.5], "outside the mesh"),
            ([-5., 0., 500.], [5., 0., 500.], "z 500.1 to 500.1 m"),
        ] {
            let placement = placed(from_m, to_m);
            assert!(placement.is_wrong && placement.doubts[0].contains(words), "{:?}", placement.doubts);
        }
        let partly = placed([0., 0., 1.5], [12., 0., 1.5]);
        assert!(!partly.is_wrong && partly.doubts[0].contains("points of the path lie outside the mesh"));
        assert!(placed([9., 0., 1.5], [19., 0., 1.5]).is_wrong);
    }

    /// Rooms of 4 x 3 x 2.4 m in a row along x with doors of 1 x 2 m at their left, in a unit of so many metres.
    fn rooms(unit_m: f64) -> Scene {
        let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
        let mut quad = |corners: [[f64; 3]; 4]| {
            let first = vertices.len() as u32;
            vertices.extend(corners.map(|corner| DVec3::from(corner) / unit_m));
            triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        };
        for z in [0.0, 2.4] {
            quad([[0., -1.5, z], [20., -1.5, z], [20., 1.5, z], [0., 1.5, z]]);
        }
        for x in [0., 4., 8., 12., 16., 20.] {
            quad([[x, -1.5, 0.], [x, 0.5, 0.], [x, 0.5, 2.4], [x, -1.5, 2.4]]);
            quad([[x, 0.5, 2.0], [x, 1.5, 2.0], [x, 1.5, 2.4], [x, 0.5, 2.4]]);
        }
        Scene::Mesh(Mesh::new(vertices, triangles).unwrap().into())
    }

    #[test]
    fn rooms_in_feet_are_doubted_and_a_hall_is_not() {
        // through all doors and back, twice
        let corners_m = [1.0, 19.0, 1.0, 19.0, 1.0].map(|x| DVec3::new(x, 1.0, 1.5));
        let walk = Trajectory::polyline(&corners_m, 1.0, 1.0, 0).unwrap();
        let doubts = |scene: &Scene, walk: &Trajectory| {
            let placement = Placement::new(scene, walk, 0.0, LocalOrigin::default());
            assert!(!placement.is_wrong);
            placement.doubts
        };
        assert!(doubts(&rooms(1.0), &walk).is_empty());
        let foot_m = MeshUnit::Foot.metres();
        let mixed = doubts(&rooms(foot_m), &walk);
        assert!(
            mixed[0].contains("mesh of 65.6 x 9.8 x 7.9 m")
                && mixed[0].contains(
                    "--mesh-unit ft), it would be 20.0 x 3.0 x 2.4 m, and the path would go through none"
                ),
            "{mixed:?}"
        );
        // everything in feet
        let in_feet = |at_m: DVec3| Pose::from_translation(at_m / foot_m);
        let carried =
            Trajectory::new(walk.stamped().map(|(t, pose)| (t, in_feet(pose.translation_m))).collect())
                .unwrap();
        let both = doubts(&rooms(foot_m), &carried);
        assert!(
            both[0]
                .contains("4.92 m above the floor of rooms of 7.87 m; in feet it would be 1.50 and 2.40 m")
                && both[0].contains("--mesh-unit ft"),
            "{both:?}"
        );
        let inch_m = MeshUnit::Inch.metres();
        let in_inches =
            walk.stamped().map(|(t, pose)| (t, Pose::from_translation(pose.translation_m / inch_m)));
        let inches = doubts(&rooms(inch_m), &Trajectory::new(in_inches.collect()).unwrap());
        assert!(inches[0].contains("in inches it would be 1.50 and 2.40 m"), "{inches:?}");
        // a hall of 10 m, a rig carried through it, and one on a mast
        let hall = rooms(0.24);
        for height_m in [1.5, 3.0, 8.0] {
            let path =
                Trajectory::straight(DVec3::new(1.0, 4.0, height_m), DVec3::new(80.0, 4.0, height_m), 1.0, 0);
            assert!(doubts(&hall, &path).is_empty(), "{height_m}");
        }
    }

    #[test]
    fn under_a_hill_is_below_the_floor() {
        // a roof-shaped ground from z = 0 at the sides up to 5 m
        let corners = [
            [-10., -10., 0.],
            [10., -10., 0.],
            [10., 0., 5.],
            [-10., 0., 5.],
            [10., 10., 0.],
            [-10., 10., 0.],
        ];
        let triangles = vec![[0, 1, 2], [0, 2, 3], [3, 2, 4], [3, 4, 5]];
        let hill = Scene::Mesh(Mesh::new(corners.map(DVec3::from).to_vec(), triangles).unwrap().into());
        let path = Trajectory::straight(DVec3::new(-9., 0., 1.), DVec3::new(9., 0., 1.), 1.0, 0);
        let placement = Placement::new(&hill, &path, 0.1, LocalOrigin::default());
        assert!(
            placement.is_wrong && placement.doubts[0].contains("below the floor"),
            "{:?}",
            placement.doubts
        );
        let above = Trajectory::straight(DVec3::new(-9., 0., 6.), DVec3::new(9., 0., 6.), 1.0, 0);
        assert!(!Placement::new(&hill, &above, 0.1, LocalOrigin::default()).is_wrong);
    }
}
