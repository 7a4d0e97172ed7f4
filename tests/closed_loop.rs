//! Scene to packets to decoder to coverage equals the prediction.
//!
//! The mock sensor measures a hall and encodes real packets; the decoder knows only those. The prediction is cast here
//! from the sensor's true firings, without any packet. Packets round: ranges to the format's step, azimuths of a
//! Velodyne to 0.01 degrees. A point so near to a face of its cell that rounding can move it across says nothing about
//! that cell; every other cell must agree.

use std::net::SocketAddr;

use glam::DVec3;
use outrigger::mock::sensor::{MockSensor, Surroundings};
use outrigger::rig::{Mount, MountedSensor};
use outrigger::simulate::frames::Spin;
use outrigger::verify::compare::{Agreement, Gate, Replay};
use outrigger::world::coverage::{Coverage, VoxelGrid};
use outrigger::world::scene::{BoxScene, Scene};
use outrigger::world::trajectory::Trajectory;
use sensors::ouster::{Metadata, OusterDecoder, Profile, Synthetic};
use sensors::velodyne::{Options, Product, ReturnMode, VelodyneDecoder};
use sensors::{Decoded, Decoder, Packet, catalogue};

use crate::support::{Case, case, shared, with_shared};

pub const CASES: &[Case] = &[
    case("every_ouster_sees_what_was_predicted", every_ouster_sees_what_was_predicted),
    case("every_velodyne_sees_what_was_predicted", every_velodyne_sees_what_was_predicted),
    case("every_model_of_the_catalogue_is_in_the_loop", every_model_of_the_catalogue_is_in_the_loop),
    case("range_noise_shows_as_noise", range_noise_shows_as_noise),
    with_shared("a_furnished_house_closes_the_loop", a_furnished_house_closes_the_loop),
];

/// UTC, because a Velodyne sends only its place in the hour: the host's clock says which.
const START_NS: u64 = 1_763_722_223_000_000_000;

/// From the firing of a packet to its arrival.
const HOST_LATE_NS: u64 = 1_000_000;

const MOUNT: Mount = Mount { x_m: 0.06, y_m: 0.02, z_m: 0.1, pitch_rad: 0.4, roll_rad: 0.05, yaw_rad: 0.0 };

fn hall() -> Scene {
    Scene::Box(BoxScene::closed(DVec3::new(-6.0, -4.0, -1.2), DVec3::new(6.0, 4.0, 1.8)))
}

fn walk() -> Trajectory {
    Trajectory::straight(DVec3::new(-1.0, 0.1, 0.0), DVec3::new(-0.85, 0.12, 0.03), 1.0, START_NS)
}

/// Where the loop is closed.
struct Place {
    scene: Scene,
    walk: Trajectory,
    /// Share of the rays that the rounding of azimuths may lead past an edge.
    past_edges: f64,
    /// Share of the cells that the rounding of ranges may leave open.
    open_cells: f64,
}

impl Place {
    fn hall() -> Self {
        Self { scene: hall(), walk: walk(), past_edges: 0.0, open_cells: 0.12 }
    }
}

/// What the true firings hit: cells that rounding cannot take away, and cells it could add.
struct Prediction {
    certain: Coverage,
    possible: Coverage,
    hits: u64,
}

fn predict(sensor: &MockSensor, scene: &Scene, walk: &Trajectory, grid: &VoxelGrid) -> Prediction {
    let body_from_sensor = MOUNT.body_from_sensor();
    let (model, spin) = (sensor.model(), sensor.spin());
    let mut certain = Coverage::new(grid.clone(), 1);
    let mut possible = Coverage::new(grid.clone(), 1);
    let mut hits = 0;
    let [start_ns, end_ns] = walk.time_span_ns();
    let revolutions = ((end_ns - start_ns) as f64 * 1e-9 * spin.rate_hz()).ceil() as u32;
    let columns = (0..revolutions).flat_map(|revolution| spin.columns(start_ns, revolution));
    for column in columns.filter(|column| column.time_ns <= end_ns) {
        for (channel, beam) in model.beams().iter().enumerate() {
            let time_ns = column.time_ns.saturating_add_signed(beam.fire_offset_ns.round() as i64);
            let Some(world_from_body) = walk.at(time_ns) else { continue };
            let world_from_sensor = world_from_body * body_from_sensor;
            let ray =
                model.ray(channel, column.azimuth_rad + spin.azimuth_rate_rad_per_ns() * beam.fire_offset_ns);
            let origin_m = world_from_sensor.transform_point(ray.origin_m);
            let direction = world_from_sensor.rotate(ray.direction);
            let Some(hit) = scene.cast(origin_m, direction) else { continue };
            if !(model.min_range_m..=model.max_range_m).contains(&(hit.distance_m + ray.range_offset_m)) {
                continue;
            }
            hits += 1;
            let point_m = origin_m + hit.distance_m * direction;
            // the mock measures a column from one place: a ray that 55 us of walking lead past an edge hits either side
            let from_column = walk.at(column.time_ns).unwrap_or(world_from_body) * body_from_sensor;
            let (column_m, along) =
                (from_column.transform_point(ray.origin_m), from_column.rotate(ray.direction));
            let measured = scene.cast(column_m, along).map(|hit| column_m + hit.distance_m * along);
            let past_edge = measured.is_none_or(|measured_m| measured_m.distance(point_m) > 0.01);
            if past_edge {
                measured.into_iter().for_each(|measured_m| possible.add(0, measured_m));
            }
            // half a step of range; half a count of azimuth, and a whole one where a packet's last block goes on at the rate
            // between two rounded azimuths
            let azimuth_rad = if matches!(spin, Spin::Clock { .. }) { 0.015_f64.to_radians() } else { 0.0 };
            // and the walk of 1 m/s while a column fires
            let rounding_m =
                0.51e-3 * f64::from(sensor.range_step_mm()) + azimuth_rad * hit.distance_m + 0.06e-3;
            let inside = (point_m - grid.origin_m) / grid.voxel_m;
            let from_face_m = grid.voxel_m * (inside - inside.round()).abs().min_element();
            possible.add(0, point_m);
            if from_face_m > rounding_m && !past_edge {
                certain.add(0, point_m);
                continue;
            }
            for corner in 0..8 {
                let side = |bit: u32| if corner >> bit & 1 == 1 { rounding_m } else { -rounding_m };
                possible.add(0, point_m + DVec3::new(side(0), side(1), side(2)));
            }
        }
    }
    Prediction { certain, possible, hits }
}

/// Measures, encodes, decodes, lays against the scene and compares with the prediction.
fn close_the_loop(
    what: &str,
    place: &Place,
    mut sensor: MockSensor,
    decoder: &mut dyn Decoder,
    host_late_ns: u64,
) {
    let Place { scene, walk, past_edges, open_cells } = place;
    let grid = VoxelGrid::centred_on(scene.bounds_m(), 0.1);
    let prediction = predict(&sensor, scene, walk, &grid);
    let mut replay = replay(scene, walk, &sensor, &grid);
    run(&mut sensor, 0.0, host_late_ns, scene, walk, decoder, &mut replay);
    let stats = decoder.stats();
    assert_eq!(
        (stats.malformed, stats.crc_errors, stats.lost_packets, stats.late),
        (0, 0, 0, 0),
        "{what}: {stats:?}"
    );
    assert!(stats.frames >= 2, "{what}: {stats:?}");
    let replayed = replay.finish();
    let rays = replayed.rays[0];
    let at_edges = (past_edges * prediction.hits as f64) as u64;
    assert!(rays.short.max(rays.long).max(rays.extra) <= at_edges, "{what}: {rays:?}");
    // the walk may end between the true time of a group of lasers and its time in the packet, rounded to 1 us
    let at_the_end = 8;
    assert!(rays.drop <= at_the_end + at_edges, "{what}: {rays:?}");
    assert!(
        rays.agree.abs_diff(prediction.hits) <= at_the_end + 2 * at_edges,
        "{what}: {} hits predicted, {rays:?}",
        prediction.hits
    );
    let (certain, possible) = (prediction.certain.union(), prediction.possible.union());
    let open: Vec<u64> =
        certain.iter().zip(&possible).map(|(certain, possible)| possible & !certain).collect();
    let recorded: Vec<u64> =
        replayed.placed.union().iter().zip(&open).map(|(seen, open)| seen & !open).collect();
    let agreement = Agreement::between(&certain, &recorded, None);
    assert!(agreement.iou.unwrap() >= 0.9999, "{what}: {agreement:?}");
    let undecided: u32 = open.iter().map(|word| word.count_ones()).sum();
    let share = f64::from(undecided) / prediction.certain.union_count() as f64;
    assert!(
        share < *open_cells,
        "{what}: rounding leaves {undecided} cells open beside {}",
        prediction.certain.union_count()
    );
}

fn replay<'a>(scene: &'a Scene, walk: &'a Trajectory, sensor: &MockSensor, grid: &VoxelGrid) -> Replay<'a> {
    let mounted = MountedSensor { name: "right".into(), model: sensor.model().clone(), mount: MOUNT };
    Replay::new(scene, walk, vec![mounted], grid, Gate::default())
}

fn run(
    sensor: &mut MockSensor,
    noise_m: f64,
    host_late_ns: u64,
    scene: &Scene,
    trajectory: &Trajectory,
    decoder: &mut dyn Decoder,
    replay: &mut Replay<'_>,
) {
    let body_from_sensor = MOUNT.body_from_sensor();
    let surroundings =
        Surroundings { scene, trajectory, body_from_sensor: &|_| body_from_sensor, noise_m, seed: 1 };
    let [source, destination]: [SocketAddr; 2] =
        ["127.0.0.1:50000", "127.0.0.1:7502"].map(|text| text.parse().unwrap());
    let mut take = |decoded: Decoded<'_>| {
        if let Decoded::Frame(frame) = decoded {
            replay.add_frame(0, frame);
        }
    };
    sensor
        .run(&surroundings, |time_ns, payload| {
            let packet = Packet {
                host_time_ns: time_ns + host_late_ns,
                source,
                destination,
                link: Default::default(),
                payload,
            };
            decoder.push(&packet, &mut take)
        })
        .unwrap();
    decoder.finish(&mut take);
}

fn ouster(model_name: &str, profile: Profile) -> Metadata {
    Metadata::synthetic(&Synthetic::new(model_name, 122_212_000_123, profile).columns(512, 16)).unwrap()
}

fn ouster_names() -> impl Iterator<Item = &'static str> {
    catalogue::names().into_iter().filter(|name| name.starts_with("os"))
}

fn every_ouster_sees_what_was_predicted() {
    // every model in the profile of its class, and one model in the profiles of all classes
    let by_model = ouster_names().map(|name| (name, Profile::Rng19Rfl8Sig16Nir16));
    let by_profile = [Profile::Legacy, Profile::Rng15Rfl8Nir8].map(|profile| ("os1-64", profile));
    for (name, profile) in by_model.chain(by_profile) {
        let metadata = ouster(name, profile);
        // the decoder learns about the sensor from the text that a user would have
        let known = Metadata::parse(&metadata.to_json(), "metadata.json").unwrap();
        let mut decoder = OusterDecoder::new(known);
        close_the_loop(
            &format!("{name} {}", profile.name()),
            &Place::hall(),
            MockSensor::ouster(metadata),
            &mut decoder,
            HOST_LATE_NS,
        );
    }
}

fn every_velodyne_sees_what_was_predicted() {
    for product in velodynes() {
        let sensor = MockSensor::velodyne(product, ReturnMode::Strongest, 10.0).unwrap();
        let mut decoder = VelodyneDecoder::new(Options { product: Some(product), ..Options::default() });
        // the packets of an S1 carry no time: the host's stamps date them
        let host_late_ns = if product == Product::Hdl64eS1 { 0 } else { HOST_LATE_NS };
        close_the_loop(product.name(), &Place::hall(), sensor, &mut decoder, host_late_ns);
    }
}

fn velodynes() -> impl Iterator<Item = Product> {
    Product::ALL.into_iter().filter(|product| catalogue::names().contains(&product.name()))
}

fn every_model_of_the_catalogue_is_in_the_loop() {
    let mut looped: Vec<&str> = ouster_names().chain(velodynes().map(Product::name)).collect();
    looped.sort_unstable();
    assert_eq!(looped, catalogue::decoded_names());
}

fn range_noise_shows_as_noise() {
    let (scene, walk) = (hall(), walk());
    let grid = VoxelGrid::centred_on(scene.bounds_m(), 0.1);
    let metadata = ouster("os1-64", Profile::Rng19Rfl8Sig16Nir16);
    let mut sensor = MockSensor::ouster(metadata.clone());
    let mut replay = replay(&scene, &walk, &sensor, &grid);
    run(&mut sensor, 0.1, HOST_LATE_NS, &scene, &walk, &mut OusterDecoder::new(metadata), &mut replay);
    let rays = replay.finish().rays[0];
    // with a standard deviation as wide as the gate of agreement, 31.7 % fall outside it, evenly on both sides
    let share = (rays.short + rays.long) as f64 / rays.informative() as f64;
    assert!((share - 0.317).abs() < 0.01, "{rays:?}");
    assert!((rays.short as f64 / rays.long as f64 - 1.0).abs() < 0.05, "{rays:?}");
}

/// Real walls, furniture and openings: single and dual returns, fine and coarse ranges, both makers.
fn a_furnished_house_closes_the_loop() {
    let mesh = outrigger::world::scene::load_mesh(&shared("scenes/house.ply"), None, None).unwrap().mesh;
    let walk = std::fs::read(shared("reference/validation/house_trajectory.tum")).unwrap();
    let here = Trajectory::read(&walk, None).unwrap().trajectory.at(10_000_000_000).unwrap().translation_m;
    let walk = Trajectory::straight(here, here + DVec3::new(0.12, 0.09, 0.0), 1.0, START_NS);
    let scene = Scene::Mesh(std::sync::Arc::new(mesh));
    let exact = Place { scene: scene.clone(), walk: walk.clone(), past_edges: 0.0, open_cells: 0.3 };
    for (name, profile) in [
        ("os0-128", Profile::Rng19Rfl8Sig16Nir16Dual),
        ("os1-64", Profile::Rng15Rfl8Nir8Dual),
        ("os2-32", Profile::Legacy),
    ] {
        let metadata = ouster(name, profile);
        let mut decoder = OusterDecoder::new(metadata.clone());
        let what = format!("house, {name} {}", profile.name());
        close_the_loop(&what, &exact, MockSensor::ouster(metadata), &mut decoder, HOST_LATE_NS);
    }
    // a Velodyne says its azimuths to 0.01 degrees
    let rounded = Place { scene, walk, past_edges: 5e-4, open_cells: 0.3 };
    for product in [Product::Vlp16, Product::Vlp32c, Product::Hdl64eS3] {
        let sensor = MockSensor::velodyne(product, ReturnMode::Strongest, 10.0).unwrap();
        let mut decoder = VelodyneDecoder::new(Options { product: Some(product), ..Options::default() });
        close_the_loop(&format!("house, {}", product.name()), &rounded, sensor, &mut decoder, HOST_LATE_NS);
    }
}
