use std::sync::Arc;

use super::*;
use crate::base::rng::Rng;
use crate::rig::Mount;
use crate::world::scene::Scene;
use crate::world::scene::{BoxScene, Mesh};
use crate::world::trajectory::Trajectory;

fn boxes(boxes_m: &[[[f64; 3]; 2]]) -> Scene {
    let boxes_m: Vec<[DVec3; 2]> = boxes_m.iter().map(|corners_m| corners_m.map(DVec3::from)).collect();
    Scene::Mesh(Arc::new(Mesh::of_boxes(&boxes_m).unwrap()))
}

/// A bow through a room, 12 s at 1.4 m height.
fn bow(middle: [f64; 2], radius_m: f64) -> Trajectory {
    let pose = |n: u64| {
        let angle = 0.4 + 3.0 * n as f64 / 120.0;
        let at = DVec3::new(middle[0] + radius_m * angle.cos(), middle[1] + radius_m * angle.sin(), 1.4);
        (1_000_000_000 + n * 100_000_000, Pose::new(DQuat::from_rotation_z(angle + 1.6), at))
    };
    Trajectory::new((0..=120).map(pose).collect()).unwrap()
}

/// What two tilted VLP-16 saw on a walk, in a frame that begins anywhere; scene from that frame.
fn walked(scene: &Scene, truth: &Trajectory, seed: u64) -> (Vec<WalkReturn>, Pose, Pose) {
    let model = sensors::catalogue::nominal("vlp-16").unwrap();
    let mut rng = Rng::new(seed, 0);
    let mut any = |half: f64| rng.between(-half, half);
    let tilt = DQuat::from_scaled_axis(DVec3::new(any(0.06), any(0.06), 0.0));
    let scene_from_walk = Pose::new(
        DQuat::from_rotation_z(any(std::f64::consts::PI)) * tilt,
        DVec3::new(any(50.0), any(50.0), any(50.0)),
    );
    let walk_from_scene = scene_from_walk.inverse();
    let [start_ns, end_ns] = truth.time_span_ns();
    let mut returns = Vec::new();
    for time_ns in (start_ns..end_ns).step_by(300_000) {
        let side = if rng.below(2) == 0 { 1.0 } else { -1.0 };
        let mount = Mount { pitch_rad: 0.66 * side, z_m: 0.1, ..Mount::default() };
        let ray = model.ray(rng.below(16) as usize, rng.between(0.0, std::f64::consts::TAU));
        let scene_from_sensor = truth.at(time_ns).unwrap() * mount.body_from_sensor();
        let origin_m = scene_from_sensor.transform_point(ray.origin_m);
        let direction = scene_from_sensor.rotate(ray.direction);
        let Some(hit) = scene.cast(origin_m, direction) else { continue };
        let point_m = origin_m + (hit.distance_m + 0.02 * rng.normal()) * direction;
        let [origin_m, point_m] = [origin_m, point_m].map(|at_m| walk_from_scene.transform_point(at_m));
        returns.push(WalkReturn { origin_m, point_m, time_ns });
    }
    (returns, walk_from_scene * truth.at(start_ns).unwrap(), scene_from_walk)
}

/// Distance at the begin of the walk, m, and angle, degrees.
fn off(found: &Pose, truth: &Pose, start: &Pose) -> [f64; 2] {
    let [found, truth] = [found, truth].map(|pose| *pose * *start);
    [
        found.translation_m.distance(truth.translation_m),
        found.rotation.angle_between(truth.rotation).to_degrees(),
    ]
}

fn is_right(alignment: &Alignment, truth: &Pose, start: &Pose) {
    assert_eq!(alignment.answer, Answer::Placed, "{alignment:?}");
    let [shift_m, turn_deg] = off(&alignment.placed().unwrap(), truth, start);
    assert!(shift_m < 0.005 && turn_deg < 0.05, "{shift_m} m {turn_deg} deg, {alignment:?}");
}

const ROOM: [[f64; 3]; 2] = [[-4.0, -2.5, 0.0], [4.0, 2.5, 2.8]];
const SQUARE: [[f64; 3]; 2] = [[-3.0, -3.0, 0.0], [3.0, 3.0, 2.8]];
const CUPBOARD: [[f64; 3]; 2] = [[3.2, 1.0, 0.0], [3.9, 2.2, 2.0]];

#[test]
fn empty_rooms_are_ambiguous_and_a_hint_or_a_cupboard_decides() {
    for (room, count) in [(ROOM, 2), (SQUARE, 4)] {
        let scene = boxes(&[room]);
        let (returns, start, truth) = walked(&scene, &bow([0.3, -0.2], 1.2), count as u64);
        let found = place(&returns, &start, &Target::of(&scene), None).unwrap();
        assert_eq!((found.answer, found.placements.len()), (Answer::Ambiguous, count), "{found:?}");
        assert!(found.words().contains("--align-near"), "{}", found.words());
        let begin = truth * start;
        let (yaw, ..) = begin.rotation.to_euler(glam::EulerRot::ZYX);
        let hint = Hint { at_m: begin.translation_m.truncate() + 0.4, yaw_rad: Some(yaw + 0.3) };
        is_right(&place(&returns, &start, &Target::of(&scene), Some(hint)).unwrap(), &truth, &start);
    }
    let scene = boxes(&[ROOM, CUPBOARD]);
    let (returns, start, truth) = walked(&scene, &bow([0.3, -0.2], 1.2), 9);
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| place(&returns, &start, &Target::of(&scene), None).unwrap())
    };
    let found = on(1);
    is_right(&found, &truth, &start);
    assert_eq!(found.best, on(3).best, "the same on any number of threads");
    let sd = found.sd.unwrap();
    assert!(sd.yaw_deg < 0.05 && sd.roll_deg < 0.05 && sd.pitch_deg < 0.05, "{sd:?}");
}

#[test]
fn a_box_scene_is_as_good_as_a_mesh() {
    let scene = Scene::Box(BoxScene::closed(ROOM[0].into(), ROOM[1].into()));
    let (returns, start, _) = walked(&scene, &bow([0.3, -0.2], 1.2), 4);
    let found = place(&returns, &start, &Target::of(&scene), None).unwrap();
    assert_eq!((found.answer, found.placements.len()), (Answer::Ambiguous, 2), "{found:?}");
}

#[test]
fn along_a_corridor_without_ends_a_walk_slides() {
    let mut corridor = BoxScene::closed(DVec3::new(-40.0, -1.2, 0.0), DVec3::new(40.0, 1.2, 2.8));
    corridor.faces[0] = [false; 2];
    let scene = Scene::Box(corridor);
    let walk = Trajectory::straight(DVec3::new(-4.0, 0.2, 1.4), DVec3::new(4.0, 0.1, 1.4), 0.8, 0);
    let (returns, start, _) = walked(&scene, &walk, 5);
    let found = place(&returns, &start, &Target::of(&scene), None).unwrap();
    assert_eq!(found.answer, Answer::Slides, "{found:?}");
    assert!(found.slides_along.unwrap()[0].abs() > 0.99, "{found:?}");
}

#[test]
fn another_building_is_refused() {
    let walked_in = boxes(&[ROOM, CUPBOARD]);
    let (returns, start, _) = walked(&walked_in, &bow([0.3, -0.2], 1.2), 6);
    let other = boxes(&[[[0.0, 0.0, 0.0], [11.0, 6.5, 3.2]], [[4.0, 0.0, 0.0], [4.2, 4.5, 3.2]]]);
    let found = place(&returns, &start, &Target::of(&other), None).unwrap();
    assert_eq!(found.answer, Answer::NotFound, "{found:?}");
    assert!(found.words().contains("fits nowhere"), "{}", found.words());
}

/// A walk by odometry that is off by so much after a share of its time.
fn bent(
    (truth, scene_from_walk): (&Trajectory, &Pose),
    returns: &[WalkReturn],
    by: &dyn Fn(f64) -> Pose,
) -> (Vec<WalkReturn>, Trajectory) {
    let bent = |(time_ns, pose)| (time_ns, by(share_of(truth, time_ns)) * (scene_from_walk.inverse() * pose));
    let own = Trajectory::new(truth.stamped().map(bent).collect()).unwrap();
    // a sensor measures from where the body is
    let seen = |of: &WalkReturn| {
        let body_from_walk = truth.at(of.time_ns).unwrap().inverse() * *scene_from_walk;
        of.moved(&(own.at(of.time_ns).unwrap() * body_from_walk))
    };
    let moved = returns.iter().map(seen).collect();
    (moved, own)
}

fn share_of(walk: &Trajectory, time_ns: u64) -> f64 {
    let [start_ns, end_ns] = walk.time_span_ns();
    (time_ns - start_ns) as f64 / (end_ns - start_ns) as f64
}

#[test]
fn a_jump_of_the_trajectory_is_noticed_and_drift_is_removed() {
    let scene = boxes(&[ROOM, CUPBOARD]);
    let truth = bow([0.3, -0.2], 1.2);
    let (returns, start, scene_from_walk) = walked(&scene, &truth, 7);
    let bent = |by: &dyn Fn(f64) -> Pose| bent((&truth, &scene_from_walk), &returns, by);
    let about = Pose::from_translation(start.translation_m);
    let drift = |share: f64| {
        about * Pose::new(DQuat::from_rotation_z(0.02 * share), 0.15 * share * DVec3::X) * about.inverse()
    };
    let (drifted, own) = bent(&drift);
    let placed = place(&drifted, &start, &Target::of(&scene), None).unwrap().placed().unwrap();
    let followed = follow(&drifted, &own, &Target::of(&scene), &placed).unwrap();
    let inside = |time_ns: u64| (0.05..0.95).contains(&share_of(&truth, time_ns));
    for (time_ns, pose) in followed.trajectory.stamped().filter(|(at, _)| inside(*at)) {
        let [shift_m, turn_deg] = off(&pose, &truth.at(time_ns).unwrap(), &Pose::IDENTITY);
        assert!(shift_m < 0.015 && turn_deg < 0.3, "{shift_m} m {turn_deg} deg at {time_ns}");
    }
    assert!(followed.unsure == 0 && followed.drift_m > 0.05, "{followed:?}");
    let jump = |share: f64| match share > 0.75 {
        true => about * Pose::new(DQuat::from_rotation_z(0.5), DVec3::new(0.9, 0.3, 0.0)) * about.inverse(),
        false => Pose::IDENTITY,
    };
    let jumped = place(&bent(&jump).0, &start, &Target::of(&scene), None).unwrap();
    let misfit = jumped.misfit.unwrap();
    assert!((8.3..9.6).contains(&misfit.from_s) && misfit.to_s > 11.0, "{misfit:?}");
}

#[test]
fn a_walk_by_odometry_that_jumps_is_tracked_through_its_scene_and_through_no_other() {
    let scene = boxes(&[ROOM, CUPBOARD]);
    let truth = bow([0.3, -0.2], 1.2);
    let (returns, start, scene_from_walk) = walked(&scene, &truth, 8);
    let about = Pose::from_translation(start.translation_m);
    let turned = |yaw_rad: f64, shift_m: DVec3| {
        about * Pose::new(DQuat::from_rotation_z(yaw_rad), shift_m) * about.inverse()
    };
    let lost = |share: f64| match share {
        ..0.35 => Pose::IDENTITY,
        ..0.7 => turned(0.5, DVec3::new(0.9, 0.3, 0.0)),
        _ => turned(-0.4, DVec3::new(0.1, -0.6, 0.0)),
    };
    let (returns, own) = bent((&truth, &scene_from_walk), &returns, &lost);
    assert_eq!(place(&returns, &start, &Target::of(&scene), None).unwrap().answer, Answer::NotFound);
    let tracked = track(&returns, &own, &Target::of(&scene), None).unwrap();
    assert!(tracked.inlier_share > 0.95, "{}", tracked.inlier_share);
    assert_eq!(tracked.trajectory.time_span_ns(), truth.time_span_ns());
    for (time_ns, pose) in tracked.trajectory.stamped() {
        let [shift_m, turn_deg] = off(&pose, &truth.at(time_ns).unwrap(), &Pose::IDENTITY);
        assert!(shift_m < 0.03 && turn_deg < 1.0, "{shift_m} m {turn_deg} deg at {time_ns}");
    }
    let other = boxes(&[[[0.0, 0.0, 0.0], [11.0, 6.5, 3.2]], [[4.0, 0.0, 0.0], [4.2, 4.5, 3.2]]]);
    assert!(track(&returns, &own, &Target::of(&other), None).is_none());
}
