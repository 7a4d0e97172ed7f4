//! Point files read back: each holds the points that were given, and appears only when whole.

use std::path::Path;
use std::process::Command;

use clap::ValueEnum as _;
use glam::DVec3;
use outrigger::base::geometry::Pose;
use outrigger::mock::sensor::{MockSensor, Surroundings};
use outrigger::recording::export::{Cloud, Export, ExportError, Format, Source, write_bag_metadata};
use outrigger::world::scene::{BoxScene, Scene};
use outrigger::world::trajectory::Trajectory;
use sensors::capture::PcapWriter;
use sensors::ouster::ImuSample;
use sensors::projection::points_f64;
use sensors::velodyne::{Product, ReturnMode};
use sensors::{Frame, Layer, Packet, SensorModel, catalogue};

use crate::support::{Case, case};

pub const CASES: &[Case] = &[
    case("pcd_and_ply_hold_the_points", pcd_and_ply_hold_the_points),
    case("csv_holds_the_points", csv_holds_the_points),
    case("npy_holds_what_csv_holds", npy_holds_what_csv_holds),
    case("las_and_laz_hold_the_points", las_and_laz_hold_the_points),
    case("e57_holds_a_scan_per_frame", e57_holds_a_scan_per_frame),
    case("mcap_holds_a_message_per_frame", mcap_holds_a_message_per_frame),
    case("foxglove_messages_hold_the_points", foxglove_messages_hold_the_points),
    case("inertial_samples_have_a_topic", inertial_samples_have_a_topic),
    case("a_file_appears_whole_or_not_at_all", a_file_appears_whole_or_not_at_all),
    case("a_full_disk_is_named_and_leaves_nothing", a_full_disk_is_named_and_leaves_nothing),
    case("the_same_points_give_the_same_bytes", the_same_points_give_the_same_bytes),
];

const START_NS: u64 = 1_700_000_000_123_456_789;
/// The same in GPS time, which is 18 s ahead of UTC then.
const START_GPS_S: f64 = 1_384_035_218.123_456_8;

fn model() -> SensorModel {
    catalogue::nominal("vlp-16").unwrap()
}

fn source() -> Source {
    Source {
        id: "left, vlp-16".into(),
        number: 2,
        vendor: "Velodyne".into(),
        model: "vlp-16".into(),
        serial: "AG123".into(),
        timestamp_mode: None,
    }
}

/// Five columns with a hole, and a second return here and there.
fn frame() -> Frame {
    let (columns, channels) = (5, 16);
    let mut first = Layer { range_mm: vec![0; columns * channels], ..Layer::default() };
    first.reflectivity = vec![0; columns * channels];
    let mut second = first.clone();
    for at in 0..columns * channels {
        if at % 7 != 2 {
            first.range_mm[at] = 1000 + 37 * at as u32;
            first.reflectivity[at] = at as u8;
        }
        if at % 16 == 5 {
            second.range_mm[at] = 2000 + at as u32;
            second.reflectivity[at] = 200;
        }
    }
    Frame {
        frame_id: 41,
        channels,
        column_time_ns: (0..columns as u64).map(|column| START_NS + column * 55_296).collect(),
        column_azimuth_rad: (0..columns).map(|column| column as f64 * 0.4).collect(),
        column_valid: vec![true; columns],
        azimuth_rate_rad_per_ns: 6e-8,
        first,
        second: Some(second),
        host_time_ns: [START_NS + 5, START_NS + 9],
        ..Frame::default()
    }
}

fn cloud() -> Cloud {
    let mut cloud = Cloud::new(source().into(), &model());
    cloud.fill(&model(), &frame());
    cloud
}

fn write(format: Format, frames: usize, path: &Path) -> u64 {
    let mut export = Export::create(path, format, false).unwrap();
    for _ in 0..frames {
        export.add(&cloud()).unwrap();
    }
    export.finish().unwrap().points
}

/// Every return once, with its position by the exact projection.
fn expected() -> Vec<DVec3> {
    let (model, frame) = (model(), frame());
    let mut positions = Vec::new();
    for layer in [&frame.first, frame.second.as_ref().unwrap()] {
        let mut of_layer = Vec::new();
        points_f64(&model, &frame, layer, &mut of_layer);
        positions.extend(of_layer.into_iter().filter(|position| *position != DVec3::ZERO));
    }
    positions
}

/// The same points, in whatever order, within a tolerance.
fn assert_same(mut found: Vec<DVec3>, tolerance_m: f64) {
    let mut expected = expected();
    assert_eq!(found.len(), expected.len());
    let order = |a: &DVec3, b: &DVec3| a.length().total_cmp(&b.length());
    found.sort_by(order);
    expected.sort_by(order);
    for (found, expected) in found.iter().zip(&expected) {
        assert!(found.distance(*expected) <= tolerance_m, "{found} {expected}");
    }
}

fn f32_at(bytes: &[u8], at: usize) -> f64 {
    f64::from(f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()))
}

fn pcd_and_ply_hold_the_points() {
    let folder = tempfile::tempdir().unwrap();
    for (name, format, ends_with, count_line) in [
        ("a.pcd", Format::Pcd, "DATA binary\n", "POINTS "),
        ("a.ply", Format::Ply, "end_header\n", "element vertex "),
    ] {
        let path = folder.path().join(name);
        let points = write(format, 1, &path);
        let bytes = std::fs::read(&path).unwrap();
        let end = bytes.windows(ends_with.len()).position(|window| window == ends_with.as_bytes()).unwrap();
        let header = std::str::from_utf8(&bytes[..end]).unwrap();
        let count = header.lines().find_map(|line| line.strip_prefix(count_line)).unwrap();
        assert_eq!(count.parse::<u64>().unwrap(), points);
        let body = &bytes[end + ends_with.len()..];
        assert_eq!(body.len() as u64, 32 * points);
        let records: Vec<&[u8]> = body.chunks(32).collect();
        let positions = records.iter().map(|r| DVec3::new(f32_at(r, 0), f32_at(r, 4), f32_at(r, 8)));
        assert_same(positions.collect(), 1e-6);
        let times: Vec<u32> =
            records.iter().map(|r| u32::from_le_bytes(r[16..20].try_into().unwrap())).collect();
        assert!(times.iter().all(|time_ns| *time_ns < 5 * 55_296) && *times.last().unwrap() > 4 * 55_000);
        let rings = records.iter().map(|r| u16::from_le_bytes(r[30..32].try_into().unwrap()));
        assert_eq!(rings.max(), Some(15));
        assert_eq!(records.iter().filter(|r| r[29] == 2).count(), 5);
    }
}

fn csv_holds_the_points() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.csv");
    write(Format::Csv, 1, &path);
    let text = std::fs::read_to_string(&path).unwrap();
    let mut lines = text.lines();
    assert!(
        lines.next().unwrap().starts_with("sensor,frame_id,column,ring,return_number,time_ns,t,x_m,y_m,z_m")
    );
    let positions = lines.map(|line| {
        let rest = line.strip_prefix("\"left, vlp-16\",41,").unwrap();
        let numbers: Vec<f64> = rest.split(',').take(11).map(|number| number.parse().unwrap()).collect();
        assert!(rest.ends_with(','), "a Velodyne sends no near-infrared: {rest}");
        DVec3::new(numbers[5], numbers[6], numbers[7])
    });
    assert_same(positions.collect(), 2e-6);
}

fn npy_holds_what_csv_holds() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npy");
    let points = write(Format::Npy, 1, &path);
    let bytes = std::fs::read(&path).unwrap();
    let (header, body) = bytes.split_at(512);
    let header = String::from_utf8_lossy(&header[10..]);
    assert!(header.contains(&format!("'shape': ({points},)")) && header.ends_with('\n'), "{header}");
    let records: Vec<&[u8]> = body.chunks(60).collect();
    assert_eq!(body.len() as u64, 60 * points);
    let f64_at = |bytes: &[u8], at: usize| f64::from_le_bytes(bytes[at..at + 8].try_into().unwrap());
    let positions = records.iter().map(|r| DVec3::new(f64_at(r, 25), f64_at(r, 33), f64_at(r, 41)));
    assert_same(positions.collect(), 1e-9);
    assert!(records.iter().all(|record| record[..6] == [2, 0, 41, 0, 0, 0]), "sensor and frame");
    assert_eq!(records.iter().filter(|record| record[12] == 2).count(), 5, "second returns");
}

fn las_and_laz_hold_the_points() {
    let folder = tempfile::tempdir().unwrap();
    for (name, format) in [("a.las", Format::Las), ("a.laz", Format::Laz)] {
        let path = folder.path().join(name);
        write(format, 1, &path);
        let mut reader = las::Reader::from_path(&path).unwrap();
        let data = reader.read_all().unwrap();
        let points: Vec<las::Point> = data.points().map(Result::unwrap).collect();
        assert_same(points.iter().map(|p| DVec3::new(p.x, p.y, p.z)).collect(), 1e-4);
        assert!(points.iter().all(|point| point.point_source_id == 3));
        let header = reader.header();
        assert_eq!(header.gps_time_type(), las::GpsTimeType::Standard);
        assert_eq!(header.date().map(|day| day.to_string()).as_deref(), Some("2023-11-14"));
        let time_s = points[0].gps_time.unwrap();
        assert!((time_s - (START_GPS_S - 1e9)).abs() < 1e-6, "{time_s}");
        let rings: Vec<u16> = points
            .iter()
            .map(|point| u16::from_le_bytes(point.extra_bytes[..2].try_into().unwrap()))
            .collect();
        assert_eq!(rings.iter().max(), Some(&15));
        assert_eq!(points.iter().filter(|point| point.return_number == 2).count(), 4); // where both came back
        assert_eq!(points.iter().filter(|point| point.number_of_returns == 2).count(), 8);
    }
}

fn e57_holds_a_scan_per_frame() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.e57");
    write(Format::E57, 2, &path);
    let mut reader = e57::E57Reader::from_file(&path).unwrap();
    let scans = reader.pointclouds();
    assert_eq!(scans.len(), 2);
    assert_ne!(scans[0].guid, scans[1].guid);
    for scan in scans {
        assert_eq!(scan.sensor_serial.as_deref(), Some("AG123"));
        let begun = scan.acquisition_start.as_ref().unwrap();
        assert!((begun.gps_time - START_GPS_S).abs() < 1e-6 && !begun.atomic_reference, "{begun:?}");
        let points = reader.pointcloud_simple(&scan).unwrap();
        let positions = points.map(|point| match point.unwrap().cartesian {
            e57::CartesianCoordinate::Valid { x, y, z } => DVec3::new(x, y, z),
            other => panic!("{other:?}"),
        });
        assert_same(positions.collect(), 1e-6);
    }
}

fn mcap_holds_a_message_per_frame() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let points = write(Format::Mcap, 2, &path);
    let bytes = std::fs::read(&path).unwrap();
    let messages: Vec<mcap::Message> =
        mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap).collect();
    assert_eq!(messages.len(), 2);
    for message in messages {
        assert_eq!(message.channel.topic, "/left__vlp_16/points");
        assert_eq!(message.channel.schema.as_ref().unwrap().name, "sensor_msgs/msg/PointCloud2");
        assert_eq!(message.log_time, START_NS + 5);
        let data = &message.data;
        let seconds = u32::from_le_bytes(data[4..8].try_into().unwrap());
        assert_eq!(u64::from(seconds), START_NS / 1_000_000_000);
        let count = points as usize / 2;
        let body = &data[data.len() - 1 - 22 * count..data.len() - 1];
        let positions = body.chunks(22).map(|r| DVec3::new(f32_at(r, 0), f32_at(r, 4), f32_at(r, 8)));
        assert_same(positions.collect(), 1e-6);
    }
}

fn foxglove_messages_hold_the_points() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    write(Format::Foxglove, 2, &path);
    let bytes = std::fs::read(&path).unwrap();
    let mut messages = 0;
    for message in mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap) {
        messages += 1;
        assert_eq!(message.channel.schema.as_ref().unwrap().name, "foxglove.PointCloud");
        let cloud = <foxglove::messages::PointCloud as foxglove::Decode>::decode(&message.data[..]).unwrap();
        assert_eq!((cloud.frame_id.as_str(), cloud.point_stride), ("left, vlp-16", 30));
        let positions = cloud.data.chunks(30).map(|r| DVec3::new(f32_at(r, 0), f32_at(r, 4), f32_at(r, 8)));
        assert_same(positions.collect(), 1e-6);
        let last = cloud.fields.last().unwrap();
        assert_eq!((last.name.as_str(), last.offset), ("return_number", 29));
        assert_eq!(cloud.data.chunks(30).filter(|record| record[29] == 2).count(), 5);
    }
    assert_eq!(messages, 2);
}

fn inertial_samples_have_a_topic() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bag_0.mcap");
    let mut export = Export::create(&path, Format::Mcap, false).unwrap();
    for number in 0..3 {
        let sample = ImuSample {
            time_ns: START_NS + number,
            acceleration_m_s2: [0.5, -0.25, 9.75],
            angular_rate_rad_s: [0.125, 0.0, -1.0],
        };
        export.add_imu(&source(), &sample, START_NS + 10 * number).unwrap();
    }
    let written = export.finish().unwrap();
    let bytes = std::fs::read(&path).unwrap();
    for message in mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap) {
        assert_eq!(message.channel.topic, "/left__vlp_16/imu");
        let f64_from_end = |count: usize| {
            let at = message.data.len() - 8 * count;
            f64::from_le_bytes(message.data[at..at + 8].try_into().unwrap())
        };
        // the message ends with acceleration and its nine covariances, before it the same of the angular rate
        assert_eq!([12, 11, 10].map(f64_from_end), [0.5, -0.25, 9.75]);
        assert_eq!([24, 23, 22].map(f64_from_end), [0.125, 0.0, -1.0]);
    }
    write_bag_metadata(folder.path(), "bag_0.mcap", &written).unwrap();
    let metadata = std::fs::read_to_string(folder.path().join("metadata.yaml")).unwrap();
    assert!(metadata.contains("message_count: 3") && metadata.contains("nanoseconds: 20"), "{metadata}");
}

fn a_file_appears_whole_or_not_at_all() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("new/a.ply");
    assert!(
        Export::create(&path, Format::Ply, false).is_err(),
        "a folder that is missing may be a typing error"
    );
    std::fs::create_dir(path.parent().unwrap()).unwrap();
    let mut export = Export::create(&path, Format::Ply, false).unwrap();
    export.add(&cloud()).unwrap();
    assert!(!path.exists());
    drop(export);
    assert_eq!(std::fs::read_dir(path.parent().unwrap()).unwrap().count(), 0, "nothing is left behind");
    write(Format::Ply, 1, &path);
    let before = std::fs::read(&path).unwrap();
    assert!(matches!(Export::create(&path, Format::Ply, false), Err(ExportError::Exists { .. })));
    let mut again = Export::create(&path, Format::Ply, true).unwrap();
    again.add(&cloud()).unwrap();
    again.add(&cloud()).unwrap();
    assert_eq!(std::fs::read(&path).unwrap(), before);
    again.finish().unwrap();
    assert!(std::fs::metadata(&path).unwrap().len() > before.len() as u64);
}

/// A second of a VLP-16 that stands in a room.
fn write_capture(path: &Path) {
    let scene = Scene::Box(BoxScene::closed(DVec3::new(-4.0, -3.0, -1.3), DVec3::new(5.0, 3.5, 1.7)));
    let still =
        Trajectory::new([0, 1_000_000_000].map(|ns| (START_NS + ns, Pose::IDENTITY)).to_vec()).unwrap();
    let around = Surroundings {
        scene: &scene,
        trajectory: &still,
        body_from_sensor: &|_| Pose::IDENTITY,
        noise_m: 0.01,
        seed: 1,
    };
    let [source, destination] = ["10.0.0.7:2368", "10.0.0.100:2368"].map(|address| address.parse().unwrap());
    let mut capture = PcapWriter::new(std::fs::File::create(path).unwrap()).unwrap();
    MockSensor::velodyne(Product::Vlp16, ReturnMode::Strongest, 10.0)
        .unwrap()
        .run(&around, |host_time_ns, payload| {
            capture.write(&Packet { host_time_ns, source, destination, link: Default::default(), payload })
        })
        .unwrap();
    capture.close().unwrap();
}

/// Whatever a file's writer does when it is dropped: what the disk said is said, and no file is left.
fn a_full_disk_is_named_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let capture = folder.path().join("capture.pcap");
    write_capture(&capture);
    for format in Format::value_variants() {
        let name = format!("points.{}", format.extension());
        let (format, out) = (format.to_possible_value().unwrap(), folder.path().join("out"));
        std::fs::create_dir(&out).unwrap();
        // so many blocks of 1024 bytes, and a signal less: the disk's words but for the number
        for blocks in [1, 60] {
            let script = format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$@\"");
            let output = Command::new("bash")
                .args(["-c", &script, "bash", env!("CARGO_BIN_EXE_outrigger"), "decode"])
                .arg(&capture)
                .args(["--format", format.get_name(), "--out"])
                .arg(out.join(&name))
                .output()
                .unwrap();
            let said = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(1), "{name}, {blocks}: {said}");
            assert!(said.contains("File too large") && said.contains(&name), "{name}, {blocks}: {said}");
        }
        assert_eq!(std::fs::read_dir(&out).unwrap().count(), 0, "{name}: something is left");
        std::fs::remove_dir(&out).unwrap();
    }
}

fn the_same_points_give_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    for format in <Format as clap::ValueEnum>::value_variants().iter().copied() {
        let bytes = ["a", "b"].map(|name| {
            let path = folder.path().join(format!("{name}-{format:?}")).with_extension(format.extension());
            write(format, 2, &path);
            std::fs::read(&path).unwrap()
        });
        assert!(bytes[0] == bytes[1], "{format:?}");
    }
}
