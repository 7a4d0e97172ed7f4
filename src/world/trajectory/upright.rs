//! Doubts about the frame of poses by the direction of up: a platform that walks or rolls stays upright, and its path climbs
//! little. Poses with the quaternion's w first and poses of a camera do not, and are recognized by what makes them upright.

use glam::{DMat3, DQuat, DVec3};

use crate::base::geometry::Pose;

/// Cosine of the tilt up to which a platform is upright (60 degrees), and within which another reading is believed (25).
const UPRIGHT: f64 = 0.5;
const SURELY_UPRIGHT: f64 = 0.9;
/// A path shorter than this says nothing of where up is, m.
const LONG_PATH_M: f64 = 5.0;
/// Share of the path that climbs or falls steeper than 45 degrees, from which on z is not up.
const STEEP_SHARE: f64 = 0.8;

/// Turns poses if another reading explains their frame, and says so; reports what nothing explains.
pub(super) fn settle(stamped: &mut [(u64, Pose)], is_order_stated: bool) -> Vec<String> {
    let mut notes = Vec::new();
    let as_read = median_up(stamped, |rotation| rotation * DVec3::Z);
    let tilt_deg = as_read.clamp(-1.0, 1.0).acos().to_degrees();
    let w_first = |rotation: DQuat| DQuat::from_xyzw(rotation.y, rotation.z, rotation.w, rotation.x);
    if as_read >= UPRIGHT {
        // as expected
    } else if !is_order_stated
        && median_up(stamped, |rotation| w_first(rotation) * DVec3::Z) >= SURELY_UPRIGHT
    {
        stamped.iter_mut().for_each(|(_, pose)| pose.rotation = w_first(pose.rotation));
        notes.push(format!(
            "quaternions read as qw qx qy qz: as qx qy qz qw the body would be {tilt_deg:.0}° from upright"
        ));
    } else if median_up(stamped, |rotation| rotation * DVec3::NEG_Y) >= SURELY_UPRIGHT {
        // body x is the camera's z, body y its -x, body z its -y (REP-103, suffix frames)
        let camera_from_body = DMat3::from_cols(DVec3::Z, DVec3::NEG_X, DVec3::NEG_Y);
        let turn = DQuat::from_mat3(&camera_from_body);
        stamped.iter_mut().for_each(|(_, pose)| pose.rotation *= turn);
        notes.push(format!(
            "poses of a camera (z forward, y down) turned to x forward, z up: as they are, the body would be {tilt_deg:.0}° \
             from upright"
        ));
    } else {
        notes.push(format!(
            "the body is {tilt_deg:.0}° from upright at half of the poses: expected x forward, y left, z up, and quaternions \
             as qx qy qz qw; are these poses of a camera, or of a sensor on its side?"
        ));
    }
    notes.extend(climbs(stamped));
    notes
}

/// Median of how far an axis of the body points up.
fn median_up(stamped: &[(u64, Pose)], axis: impl Fn(DQuat) -> DVec3) -> f64 {
    let mut up: Vec<f64> = stamped.iter().map(|(_, pose)| axis(pose.rotation).z).collect();
    let middle = up.len() / 2;
    *up.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Says so where most of the path goes up or down.
fn climbs(stamped: &[(u64, Pose)]) -> Option<String> {
    let steps = stamped.windows(2).map(|pair| pair[1].1.translation_m - pair[0].1.translation_m);
    let (mut length_m, mut steep_m) = (0.0, 0.0);
    for step in steps {
        length_m += step.length();
        if step.z.abs() > step.truncate().length() {
            steep_m += step.length();
        }
    }
    (length_m >= LONG_PATH_M && steep_m >= STEEP_SHARE * length_m).then(|| {
        format!(
            "{steep_m:.1} of {length_m:.1} m of the path climb or fall steeper than 45°: expected z up; poses of a camera have z \
             forward and y down, and (z, -x, -y) of their world is (x, y, z)"
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn walk(turn: impl Fn(DQuat) -> DQuat) -> Vec<(u64, Pose)> {
        let pose = |n: u64| {
            let yaw = DQuat::from_rotation_z(0.3 * n as f64) * DQuat::from_rotation_y(0.08);
            (n, Pose::new(turn(yaw), DVec3::new(n as f64, 0.0, 1.0)))
        };
        (0..40).map(pose).collect()
    }

    #[test]
    fn an_upright_walk_is_left_as_it_is() {
        let mut stamped = walk(|rotation| rotation);
        assert_eq!(settle(&mut stamped, false), Vec::<String>::new());
        assert_eq!(stamped, walk(|rotation| rotation));
    }

    #[test]
    fn w_first_and_cameras_are_turned_and_named() {
        let right = walk(|rotation| rotation);
        let mut stamped = walk(|q| DQuat::from_xyzw(q.w, q.x, q.y, q.z));
        let notes = settle(&mut stamped, false);
        assert!(notes.len() == 1 && notes[0].contains("qw qx qy qz"), "{notes:?}");
        assert_eq!(stamped, right);
        let camera = DQuat::from_mat3(&DMat3::from_cols(DVec3::NEG_Y, DVec3::NEG_Z, DVec3::X));
        let mut stamped = walk(|rotation| rotation * camera);
        let notes = settle(&mut stamped, false);
        assert!(notes.len() == 1 && notes[0].contains("camera"), "{notes:?}");
        for ((_, found), (_, expected)) in stamped.iter().zip(&right) {
            assert!(found.rotation.angle_between(expected.rotation) < 1e-7);
        }
        let mut lying = walk(|rotation| rotation * DQuat::from_rotation_y(1.5));
        let notes = settle(&mut lying, true);
        assert!(
            notes[0].contains("86° from upright") || notes[0].contains("from upright at half"),
            "{notes:?}"
        );
    }

    #[test]
    fn a_path_that_only_climbs_is_doubted() {
        let climbing = |n: u64| (n, Pose::new(DQuat::IDENTITY, DVec3::new(0.1, 0.0, 1.0) * n as f64));
        let mut stamped: Vec<_> = (0..20).map(climbing).collect();
        let notes = settle(&mut stamped, false);
        assert!(notes.len() == 1 && notes[0].contains("steeper than 45°"), "{notes:?}");
    }
}
