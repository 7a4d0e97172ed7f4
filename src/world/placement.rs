//! Whether a path lies in a scene: a frame, a unit or an up axis that differ put it outside, or below the floor.

use glam::DVec3;

use super::local_origin::LocalOrigin;
use super::scene::Scene;
use super::trajectory::Trajectory;

/// Coordinates of a scene and of a path in it differ by rounding up to this, m.
const SLACK_M: f64 = 1e-6;
/// Share of the path that may lie off the floor: doors and gaps of a mesh.
const MOST_MISPLACED: f64 = 0.5;
/// A path this far above everything is of another frame, m.
const FARTHEST_ABOVE_M: f64 = 100.0;

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
        let is_wrong = out_of_plan.max(below) as f64 > MOST_MISPLACED * all as f64;
        Self { doubts, is_wrong }
    }
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
