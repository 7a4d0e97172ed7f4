use std::sync::Arc;

use glam::{DQuat, DVec3};

use super::*;
use crate::recording::export::{Point, Source};

const START_NS: u64 = 1_700_000_000_000_000_000;

fn point(time_ns: u64, position_m: DVec3) -> Point {
    Point {
        position_m,
        range_mm: (position_m.length() * 1e3) as u32,
        time_ns,
        ring: 0,
        column: 0,
        return_number: 1,
        intensity: 0.0,
        reflectivity: 0,
        near_ir: None,
    }
}

fn cloud(points: Vec<Point>, host_ns: u64) -> Cloud {
    let source = Source {
        id: "a".into(),
        number: 0,
        vendor: "Ouster".into(),
        model: "os1-64".into(),
        serial: String::new(),
        timestamp_mode: None,
    };
    Cloud::of_points(Arc::new(source), 0, [points[0].time_ns, host_ns], points)
}

/// Ten seconds along x at 1 m/s, turning at a tenth of a radian per second.
fn walk(start_ns: u64) -> Trajectory {
    let pose = |s: u64| Pose::new(DQuat::from_rotation_z(0.1 * s as f64), DVec3::X * s as f64);
    Trajectory::new((0..=10).map(|s| (start_ns + s * 1_000_000_000, pose(s))).collect()).unwrap()
}

fn world(trajectory: Trajectory) -> Target {
    Target::World { trajectory, offset: TimeOffset::Fixed(0) }
}

#[test]
fn every_point_is_placed_at_its_own_time() {
    let mut registration = Registration::new(world(walk(START_NS)), PointFilter::default());
    let wall_m = DVec3::new(20.0, 3.0, 1.0);
    let body_from_sensor = Pose::new(DQuat::from_rotation_x(0.3), DVec3::new(0.1, 0.2, 0.3));
    let times_ns: Vec<u64> = (0..20).map(|at| START_NS + at * 500_000_000 + 3).collect();
    let seen = |time_ns: &u64| {
        let world_from_sensor = walk(START_NS).at(*time_ns).unwrap() * body_from_sensor;
        point(*time_ns, world_from_sensor.inverse().transform_point(wall_m))
    };
    let mut cloud = cloud(times_ns.iter().map(seen).collect(), START_NS);
    registration.apply(0, &mut cloud, &|_| body_from_sensor);
    assert_eq!((cloud.points.len(), registration.losses()), (20, None));
    assert!(cloud.points.iter().all(|point| point.position_m.abs_diff_eq(wall_m, 1e-9)));
    assert_eq!(cloud.frame_name(), "world");
}

#[test]
fn points_outside_of_the_trajectory_are_counted() {
    let mut registration = Registration::new(world(walk(START_NS)), PointFilter::default());
    let times_ns = [START_NS - 1, START_NS, START_NS + 10_000_000_000, START_NS + 10_000_000_001];
    let mut cloud = cloud(times_ns.map(|time_ns| point(time_ns, DVec3::X)).to_vec(), START_NS);
    registration.apply(0, &mut cloud, &|_| Pose::IDENTITY);
    assert_eq!(cloud.points.len(), 2);
    let loss = registration.losses().unwrap();
    assert!(loss.starts_with("2 points lie outside of the trajectory's time, 1700000000.000 to"), "{loss}");
}

/// A sensor that counts from power-on, 12 s ago, and whose quartz is fast by 50 ppm.
#[test]
fn a_clock_without_a_date_is_placed_by_the_hosts() {
    let mut registration = Registration::new(world(walk(START_NS)), PointFilter::default());
    for at in 0..100_u64 {
        let true_ns = at * 100_000_000;
        let device_ns = 12_000_000_000 + true_ns + true_ns / 20_000;
        let late_ns = if at % 10 == 7 { 80_000_000 } else { 0 }; // a packet that waited
        let mut cloud = cloud(vec![point(device_ns, DVec3::ZERO)], START_NS + true_ns + late_ns);
        registration.apply(0, &mut cloud, &|_| Pose::IDENTITY);
        let off_m = cloud.points[0].position_m.x - true_ns as f64 * 1e-9;
        assert!(off_m.abs() < 1e-3, "{at}: {off_m}");
    }
    let notices = registration.notices(&|_| "left".into());
    assert!(notices[0].starts_with("left: its clock (12.000 s at the start) is not that of"), "{notices:?}");
}

#[test]
fn both_may_begin_together() {
    let target = Target::World { trajectory: walk(0), offset: TimeOffset::Start };
    let mut registration = Registration::new(target, PointFilter::default());
    let mut cloud =
        cloud(vec![point(START_NS, DVec3::ZERO), point(START_NS + 2_000_000_000, DVec3::ZERO)], 0);
    registration.apply(0, &mut cloud, &|_| Pose::IDENTITY);
    assert!(cloud.points[1].position_m.abs_diff_eq(2.0 * DVec3::X, 1e-12));
    assert_eq!("start".parse(), Ok(TimeOffset::Start));
    assert_eq!("-37".parse(), Ok(TimeOffset::Fixed(-37_000_000_000)));
    assert!("soon".parse::<TimeOffset>().is_err());
}

#[test]
fn what_is_not_wanted_is_left_out() {
    let filter = PointFilter {
        range: Some("0.5..9.5".parse().unwrap()),
        mask: Some("operator".parse().unwrap()),
        clip: Some("-100,-100,-3,100,100,3".parse().unwrap()),
        ..PointFilter::default()
    };
    let mut registration = Registration::new(Target::Rig, filter);
    let positions_m = [
        DVec3::new(0.3, 0.0, 0.0),  // too near
        DVec3::new(0.0, 0.3, -1.0), // the operator
        DVec3::new(0.0, 0.6, -1.0),
        DVec3::new(9.6, 0.0, 0.0), // too far
        DVec3::new(0.0, 5.0, 3.5), // above the box
        DVec3::new(-5.0, 5.0, 2.5),
    ];
    let mut cloud = cloud(positions_m.map(|position_m| point(START_NS, position_m)).to_vec(), START_NS);
    registration.apply(0, &mut cloud, &|_| Pose::IDENTITY);
    let left: Vec<DVec3> = cloud.points.iter().map(|point| point.position_m).collect();
    assert_eq!(left, [positions_m[2], positions_m[5]]);
    for wrong in ["", "me", "1,2,3", "0,0,0,0,0,1,0", "0,0,0,0,0,1,-1"] {
        assert!(wrong.parse::<Mask>().is_err(), "{wrong}");
    }
    for wrong in ["", "5", "5..5", "9..2", "-1..2", "a..b"] {
        assert!(wrong.parse::<RangeLimits>().is_err(), "{wrong}");
    }
}

#[test]
fn times_are_those_of_the_host() {
    let window = TimeWindow::new(Some("1".parse().unwrap()), Some("2".parse().unwrap()));
    let mut registration =
        Registration::new(Target::Sensor, PointFilter { window, ..PointFilter::default() });
    registration.begin(START_NS);
    assert!(registration.is_wanted([START_NS + 900_000_000, START_NS + 1_000_000_000]));
    assert!(!registration.is_wanted([START_NS + 2_000_000_000, START_NS + 2_100_000_000]));
    // the sensor's clock is 37 s ahead
    let device_ns = |ms: u64| START_NS + 37_000_000_000 + ms * 1_000_000;
    let mut cloud = cloud(
        [950, 1000, 1999, 2000].map(|ms| point(device_ns(ms), DVec3::X)).to_vec(),
        START_NS + 950_000_000,
    );
    registration.apply(0, &mut cloud, &|_| Pose::IDENTITY);
    let left: Vec<u64> = cloud.points.iter().map(|point| point.time_ns).collect();
    assert_eq!(left, [device_ns(1000), device_ns(1999)]);
}
