use super::*;
use crate::rig::{Mount, MountedSensor, Rig};
use crate::simulate::scan::{Scanner, SensorErrors, Spin};
use crate::world::scene::{BoxScene, Scene};

/// A rig of sensors at these pitches walks; what its odometry makes of it.
fn walked(model: &str, pitches_deg: &[f64], scene: BoxScene, walk: &Trajectory, noise_m: f64) -> Walked {
    let model = sensors::catalogue::nominal(model).unwrap();
    let mounted = |pitch_deg: &f64| MountedSensor {
        name: pitch_deg.to_string(),
        model: model.clone(),
        mount: Mount { pitch_rad: pitch_deg.to_radians(), ..Mount::default() },
    };
    let rig = Rig { sensors: pitches_deg.iter().map(mounted).collect() };
    let scene = Scene::Box(scene);
    let mut scanner = Scanner::new(&scene, walk, &rig, Spin { columns: 512, ..Spin::default() });
    scanner.occluders.iter_mut().for_each(Vec::clear);
    scanner.sensor_errors = SensorErrors { range_noise_m: noise_m, ..SensorErrors::default() };
    let [start_ns, end_ns] = walk.time_span_ns();
    let turns = (end_ns - start_ns) / 100_000_000;
    let mut sweeps: Vec<Sweep> = (0..turns)
        .map(|turn| Sweep {
            start_ns: start_ns + turn * 100_000_000,
            end_ns: start_ns + (turn + 1) * 100_000_000,
            points: Vec::new(),
        })
        .collect();
    scanner.for_each_column(|_, column| {
        for back in &column.returns {
            let turn = ((back.time_ns - start_ns) / 100_000_000) as usize;
            let Some(body) = walk.at(back.time_ns).filter(|_| turn < sweeps.len()) else { continue };
            let body_m = body.inverse().transform_point(back.point_m);
            sweeps[turn].points.push(SweepPoint { time_ns: back.time_ns, body_m });
        }
    });
    let mut odometry = Odometry::new(Settings::default());
    sweeps.into_iter().for_each(|sweep| odometry.add(sweep));
    odometry.finish_over(None).unwrap()
}

/// Greatest distance and angle from the truth, m and degrees, both laid together at the start.
fn off(walked: &Walked, truth: &Trajectory) -> [f64; 2] {
    let start = truth.at(truth.time_span_ns()[0]).unwrap();
    walked.trajectory.stamped().fold([0.0, 0.0], |[shift_m, turn_deg], (time_ns, pose)| {
        let off = pose.inverse() * (start.inverse() * truth.at(time_ns).unwrap());
        [off.translation_m.length().max(shift_m), angle(&off).to_degrees().max(turn_deg)]
    })
}

fn room() -> BoxScene {
    BoxScene::closed(DVec3::new(-4.0, -3.0, 0.0), DVec3::new(5.0, 3.5, 3.0))
}

/// Two seconds on an arc: forward at 1.2 m/s, turning at 40 degrees/s.
fn arc() -> Trajectory {
    let pose = |n: u64| {
        let yaw = 40f64.to_radians() * n as f64 * 0.01;
        let radius_m = 1.2 / 40f64.to_radians();
        let at = DVec3::new(radius_m * yaw.sin() - 1.0, radius_m * (1.0 - yaw.cos()) - 1.2, 1.4);
        (5_000_000_000 + n * 10_000_000, Pose::new(DQuat::from_rotation_z(yaw), at))
    };
    Trajectory::new((0..=200).map(pose).collect()).unwrap()
}

#[test]
fn a_walk_on_an_arc_is_found() {
    for (model, pitches_deg, most_m, most_deg) in
        [("os1-64", &[25.0][..], 0.02, 0.15), ("vlp-16", &[38.0, -38.0][..], 0.03, 0.4)]
    {
        let truth = arc();
        let found = walked(model, pitches_deg, room(), &truth, 0.01);
        let [shift_m, turn_deg] = off(&found, &truth);
        assert!(shift_m < most_m && turn_deg < most_deg, "{model}: {shift_m:.4} m {turn_deg:.3} deg");
        assert_eq!((found.steps.len(), found.problems.len()), (20, 0));
        let quality = found.quality.unwrap();
        // after one sweep of a sparse sensor few planes are known
        assert!(quality.translation_median > 0.05 && quality.degenerate_share < 0.06, "{quality:?}");
        assert_eq!(found.trajectory.time_span_ns(), truth.time_span_ns());
    }
}

/// Along a hallway, about on the heel within a second, and back: each turn begins and ends between two poses.
#[test]
fn a_turn_on_the_heel_in_a_hallway_is_followed() {
    let hallway = BoxScene::closed(DVec3::new(-2.5, -0.7, 0.0), DVec3::new(3.0, 0.75, 2.6));
    let (mut at_m, mut yaw_deg) = (DVec3::new(-1.2, 0.05, 1.3), 0.0_f64);
    let mut stamped = Vec::new();
    for step in 0..35_u64 {
        let rotation = DQuat::from_rotation_z(yaw_deg.to_radians());
        stamped.push((step * 100_000_000, Pose::new(rotation, at_m)));
        match step {
            10..20 => yaw_deg += 18.0,
            _ => at_m += rotation * (0.12 * DVec3::X),
        }
    }
    let truth = Trajectory::new(stamped).unwrap();
    let [shift_m, turn_deg] = off(&walked("vlp-16", &[38.0, -38.0], hallway, &truth, 0.02), &truth);
    assert!(shift_m < 0.1 && turn_deg < 2.0, "{shift_m:.4} m {turn_deg:.3} deg");
}

#[test]
fn a_rig_that_stands_still_stays() {
    let here = Pose::from_translation(DVec3::new(0.3, 0.2, 1.4));
    let still = Trajectory::new(vec![(0, here), (1_500_000_000, here)]).unwrap();
    let found = walked("vlp-16", &[38.0, -38.0], room(), &still, 0.02);
    let [shift_m, turn_deg] = off(&found, &still);
    assert!(shift_m < 0.02 && turn_deg < 0.15, "{shift_m:.4} m {turn_deg:.3} deg");
}

#[test]
fn in_a_corridor_the_direction_along_it_is_degenerate() {
    let mut corridor = BoxScene::closed(DVec3::new(-500.0, -1.5, 0.0), DVec3::new(500.0, 1.5, 3.0));
    corridor.faces[0] = [false; 2];
    let truth = Trajectory::straight(DVec3::new(0.0, 0.2, 1.4), DVec3::new(1.2, 0.2, 1.4), 1.2, 0);
    let found = walked("os1-64", &[25.0], corridor, &truth, 0.01);
    let degenerate = found.steps[1..].iter().filter(|step| step.is_degenerate()).count();
    assert!(degenerate >= found.steps.len() - 2, "{:?}", found.steps);
    let quality = found.quality.unwrap();
    assert!(
        quality.degenerate_share > 0.8 && quality.weakest_direction.unwrap()[0].abs() > 0.99,
        "{quality:?}"
    );
}

#[test]
fn the_same_trajectory_on_any_number_of_threads() {
    let truth = arc();
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| walked("vlp-16", &[38.0], room(), &truth, 0.01).trajectory)
    };
    assert_eq!(on(1), on(3));
}

#[test]
fn too_little_is_an_error_and_a_gap_is_reported() {
    let sweep = |turn: u64, points: usize| Sweep {
        start_ns: turn * 100_000_000,
        end_ns: (turn + 1) * 100_000_000,
        points: vec![SweepPoint { time_ns: turn * 100_000_000, body_m: DVec3::splat(1.0) }; points],
    };
    let error = Odometry::new(Settings::default()).finish_over(None).unwrap_err().to_string();
    assert!(error.starts_with("0 revolutions"), "{error}");
    let mut one = Odometry::new(Settings::default());
    one.add(sweep(0, 1000));
    assert!(one.finish_over(None).unwrap_err().to_string().starts_with("1 revolution with"));
    let mut empty = Odometry::new(Settings::default());
    empty.add(sweep(0, 1000));
    empty.add(sweep(1, 3));
    let error = empty.finish_over(None).unwrap_err().to_string();
    assert!(error.contains("holds 3 returns"), "{error}");
}
