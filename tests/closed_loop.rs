//! Scene to packets to decoder to coverage equals the prediction.
//!
//! The mock sensor measures a hall and encodes real packets; the decoder knows only those. The prediction is cast here
//! from the sensor's true firings: what packets round (ranges to millimetres, azimuths to 0.01 degrees, times to
//! microseconds) is in the comparison.

use std::net::SocketAddr;

use glam::DVec3;
use outrigger::compare::{Agreement, Replay};
use outrigger::coverage::{Coverage, VoxelGrid};
use outrigger::mock::sensor::{MockSensor, Scan};
use outrigger::rig::{Mount, MountedSensor};
use outrigger::scene::{BoxScene, Scene};
use outrigger::trajectory::Trajectory;
use sensors::velodyne::{Options, Product, ReturnMode, VelodyneDecoder};
use sensors::{Decoded, Decoder, Packet};

use crate::support::{Case, case};

pub const CASES: &[Case] =
    &[case("every_velodyne_sees_what_was_predicted", every_velodyne_sees_what_was_predicted)];

/// UTC, because a Velodyne sends only its place in the hour: the host's clock says which.
const START_NS: u64 = 1_763_722_223_000_000_000;

fn hall() -> Scene {
    Scene::Box(BoxScene::closed(DVec3::new(-6.0, -4.0, -1.2), DVec3::new(6.0, 4.0, 1.8)))
}

fn walk() -> Trajectory {
    Trajectory::straight(DVec3::new(-1.0, 0.1, 0.0), DVec3::new(-0.6, 0.2, 0.05), 1.0, START_NS)
}

fn mounted(sensor: &MockSensor) -> MountedSensor {
    let mount = Mount { x_m: 0.06, y_m: 0.02, z_m: 0.1, pitch_rad: 0.4, roll_rad: 0.05 };
    MountedSensor { name: "right".into(), model: sensor.model().clone(), mount }
}

/// Where every beam of every firing must have ended, without any packet in between.
fn predicted(sensor: &MockSensor, scene: &Scene, walk: &Trajectory, grid: &VoxelGrid) -> Coverage {
    let body_from_sensor = mounted(sensor).mount.body_from_sensor();
    let (model, spin) = (sensor.model(), sensor.spin());
    let mut coverage = Coverage::new(grid.clone(), 1);
    let [start_ns, end_ns] = walk.time_span_ns();
    let revolutions = ((end_ns - start_ns) as f64 * 1e-9 * spin.rate_hz()).ceil() as u32;
    for column in (0..revolutions).flat_map(|revolution| spin.columns(start_ns, revolution)) {
        for (channel, beam) in model.beams().iter().enumerate() {
            let Some(world_from_body) = walk.at(column.time_ns + beam.fire_offset_ns.round() as u64) else {
                continue;
            };
            let world_from_sensor = world_from_body * body_from_sensor;
            let azimuth_rad = column.azimuth_rad + spin.azimuth_rate_rad_per_ns() * beam.fire_offset_ns;
            let ray = model.ray(channel, azimuth_rad);
            let origin_m = world_from_sensor.transform_point(ray.origin_m);
            let direction = world_from_sensor.rotate(ray.direction);
            let Some(hit) = scene.cast(origin_m, direction) else { continue };
            if (model.min_range_m..=model.max_range_m).contains(&(hit.distance_m + ray.range_offset_m)) {
                coverage.add(0, origin_m + hit.distance_m * direction);
            }
        }
    }
    coverage
}

/// Measures, encodes, decodes and lays against the scene; then compares with the prediction.
fn closes(mut sensor: MockSensor, decoder: &mut dyn Decoder) -> Agreement {
    let (scene, walk) = (hall(), walk());
    let grid = VoxelGrid::centred_on(scene.bounds_m(), 0.1);
    let prediction = predicted(&sensor, &scene, &walk, &grid);
    let mounted = mounted(&sensor);
    let body_from_sensor = mounted.mount.body_from_sensor();
    let model = sensor.model().clone();
    let scan = Scan {
        scene: &scene,
        trajectory: &walk,
        model: &model,
        body_from_sensor: &|_| body_from_sensor,
        noise_m: 0.0,
        seed: 1,
    };
    let name = model.name.clone();
    let mut replay = Replay::new(&scene, &walk, vec![mounted], &grid);
    let [source, destination]: [SocketAddr; 2] =
        ["127.0.0.1:50000", "127.0.0.1:7502"].map(|text| text.parse().unwrap());
    let mut take = |decoded: Decoded<'_>| {
        if let Decoded::Frame(frame) = decoded {
            replay.add_frame(0, frame);
        }
    };
    sensor
        .run(&scan, |time_ns, payload| {
            let packet = Packet { host_time_ns: time_ns + 1_000_000, source, destination, payload };
            decoder.push(&packet, &mut take)
        })
        .unwrap();
    decoder.finish(&mut take);
    let stats = decoder.stats();
    assert_eq!((stats.malformed, stats.lost_packets, stats.late), (0, 0, 0), "{name}: {stats:?}");
    let agreement = Agreement::between(&prediction.union(), &replay.recorded.union(), None);
    println!("{name}: {agreement:?} {:?}", replay.rays[0]);
    agreement
}

fn every_velodyne_sees_what_was_predicted() {
    for product in Product::ALL {
        let Ok(sensor) = MockSensor::velodyne(product, ReturnMode::Strongest, 10.0) else { continue };
        let mut decoder = VelodyneDecoder::new(Options { product: Some(product), ..Options::default() });
        let agreement = closes(sensor, &mut decoder);
        println!("{} {agreement:?}", product.name());
    }
}
