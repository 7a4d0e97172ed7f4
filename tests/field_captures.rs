//! What people bring, each with its right answer: captures and metadata that contradict each other or themselves.

mod velodyne;

use serde_json::{Value, json};

use crate::decode::{decode, outrigger, path};
use crate::support::datagram::{Datagram, datagrams, write_capture};
use crate::support::{Case, shared, with_shared};

pub const CASES: &[Case] = &[
    with_shared("metadata_of_another_mode_give_way_to_the_packets", metadata_of_another_mode),
    with_shared("metadata_of_another_window_give_way_to_the_packets", metadata_of_another_window),
    with_shared("metadata_are_read_as_people_keep_them", metadata_are_read_as_people_keep_them),
    with_shared("metadata_beside_a_capture_are_used", metadata_beside_a_capture_are_used),
    with_shared("a_mode_that_changes_on_the_way_loses_nothing", a_mode_that_changes_on_the_way),
    with_shared("two_sensors_with_one_address_are_two", velodyne::two_sensors_with_one_address_are_two),
    with_shared(
        "two_sensors_behind_one_address_and_port_are_named",
        velodyne::two_sensors_on_one_way_are_named,
    ),
    with_shared("packets_that_come_by_two_ways_are_one_sensors", velodyne::packets_that_come_by_two_ways),
    with_shared("one_odd_stamp_splits_no_revolution", velodyne::one_odd_stamp_splits_no_revolution),
    with_shared("snapshots_an_hour_apart_are_dated_right", velodyne::snapshots_an_hour_apart_are_dated_right),
    with_shared("a_tail_of_zeros_is_no_record", velodyne::a_tail_of_zeros_is_no_record),
    with_shared("blank_factory_bytes_need_a_model", velodyne::blank_factory_bytes_need_a_model),
    with_shared("position_packets_alone_are_said_to_be_alone", velodyne::position_packets_alone),
    with_shared("a_beam_that_never_returns_is_named", velodyne::a_beam_that_never_returns_is_named),
    with_shared("a_sensor_that_does_not_turn_is_said_to_stand", velodyne::a_sensor_that_does_not_turn),
    with_shared("gps_time_of_a_ptp_clock_is_right", gps_time_of_a_ptp_clock_is_right),
    with_shared("merged_datagrams_are_taken_apart", merged_datagrams_are_taken_apart),
];

const CRC_TEST: &str = "captures/ouster/crc_test.pcap";

fn field(name: &str) -> String {
    path(&format!("field/captures/{name}"))
}

fn inspect(arguments: &[&str]) -> (i32, Value) {
    let output = outrigger(&[&["--json", "inspect"], arguments].concat());
    let document = crate::support::document(&output.stdout).unwrap_or(Value::Null);
    (output.status.code().unwrap(), document)
}

/// One of the numbers of every frame of a sensor.
fn of_frames(sensor: &Value, field: &str) -> Vec<u64> {
    sensor["frames"].as_array().unwrap().iter().map(|frame| frame[field].as_u64().unwrap()).collect()
}

fn ensure_nothing_is_missing(document: &Value) {
    for sensor in document["sensors"].as_array().unwrap() {
        for counter in
            ["lost_packets", "late", "malformed", "crc_errors", "duplicated", "reordered", "foreign"]
        {
            assert_eq!(sensor["counters"][counter], 0, "{counter}: {}", sensor["counters"]);
        }
    }
}

/// The metadata of crc_test.pcap, changed.
fn changed_metadata(folder: &tempfile::TempDir, change: impl Fn(&mut Value)) -> String {
    let mut metadata: Value =
        serde_json::from_slice(&std::fs::read(shared("captures/ouster/crc_test.json")).unwrap()).unwrap();
    change(&mut metadata);
    let file = folder.path().join("changed.json");
    std::fs::write(&file, metadata.to_string()).unwrap();
    file.to_str().unwrap().to_owned()
}

fn set_mode(metadata: &mut Value, columns: usize, rate_hz: usize) {
    metadata["config_params"]["lidar_mode"] = json!(format!("{columns}x{rate_hz}"));
    let format = &mut metadata["lidar_data_format"];
    format["columns_per_frame"] = json!(columns);
    format["fps"] = json!(rate_hz);
    format["column_window"] = json!([0, columns - 1]);
}

fn metadata_of_another_mode() {
    let (_, right, _) = decode(&path(CRC_TEST), &[&path("captures/ouster/crc_test.json")], &[]);
    let folder = tempfile::tempdir().unwrap();
    let mut all = vec![(field("crc_test_said_1024x10.json"), "1024x10".to_owned())];
    for (columns, rate_hz) in [(512, 20), (1024, 10), (1024, 20), (2048, 10)] {
        let changed = changed_metadata(&folder, |metadata| set_mode(metadata, columns, rate_hz));
        let kept = folder.path().join(format!("{columns}x{rate_hz}.json"));
        std::fs::rename(changed, &kept).unwrap();
        all.push((kept.to_str().unwrap().to_owned(), format!("{columns}x{rate_hz}")));
    }
    for (file, mode) in all {
        let (code, document, stderr) = decode(&path(CRC_TEST), &[&file], &[]);
        assert_eq!(code, 0, "{mode}: {stderr}");
        ensure_nothing_is_missing(&document);
        assert_eq!(document["sensors"][0]["frames"], right["sensors"][0]["frames"], "{mode}");
        assert_eq!(of_frames(&document["sensors"][0], "points"), [28_055, 1637]);
        let corrections = json!([{"setting": "lidar_mode", "stated": mode, "found": "512x10"}]);
        assert_eq!(document["sensors"][0]["corrections"], corrections);
        assert!(stderr.contains(&mode) && stderr.contains("512x10"), "{stderr}");
        // a pipe cannot be looked at before
        let packets = std::fs::File::open(shared(CRC_TEST)).unwrap();
        let mut program = std::process::Command::new(env!("CARGO_BIN_EXE_outrigger"));
        let output =
            program.args(["decode", "-", "--json", "--meta", &file]).stdin(packets).output().unwrap();
        let piped: Value = crate::support::document(&output.stdout).unwrap();
        assert_eq!(piped["sensors"][0]["frames"], right["sensors"][0]["frames"], "{mode}, from a pipe");
    }
    let changed = changed_metadata(&folder, |metadata| {
        metadata["lidar_data_format"]["columns_per_packet"] = json!(8);
        metadata["config_params"]["columns_per_packet"] = json!(8);
    });
    let (code, document, stderr) = decode(&path(CRC_TEST), &[&changed], &[]);
    assert!(code == 0 && stderr.contains("columns_per_packet 8, its packets have 16"), "{stderr}");
    assert_eq!(document["sensors"][0]["frames"], right["sensors"][0]["frames"]);
    // another unit's packets are not decoded, and both serial numbers named
    let changed =
        changed_metadata(&folder, |metadata| metadata["sensor_info"]["prod_sn"] = json!("122247000999"));
    let (code, _, stderr) = decode(&path(CRC_TEST), &[&changed], &[]);
    assert!(code == 1 && stderr.contains("122247000999") && stderr.contains("122247000785"), "{stderr}");
    let changed =
        changed_metadata(&folder, |metadata| metadata["sensor_info"]["initialization_id"] = json!(77));
    let (code, _, stderr) = decode(&path(CRC_TEST), &[&changed], &[]);
    assert!(code == 0 && stderr.contains("initialization 77, the packets of 11394290"), "{stderr}");
}

fn metadata_of_another_window() {
    let (_, right, _) = decode(&path(CRC_TEST), &[&path("captures/ouster/crc_test.json")], &[]);
    let file = field("crc_test_said_window_128_383.json");
    let (code, document, stderr) = decode(&path(CRC_TEST), &[&file], &[]);
    assert_eq!(code, 0, "{stderr}");
    ensure_nothing_is_missing(&document);
    assert_eq!(document["sensors"][0]["frames"], right["sensors"][0]["frames"]);
    assert!(stderr.contains("[128, 383]") && stderr.contains("[0, 511]"), "{stderr}");

    // the packets of a window, and metadata of the whole turn: three revolutions and what lies around them
    let folder = tempfile::tempdir().unwrap();
    let metadata = shared("captures/ouster/windowed_frame1_0.json");
    let mut full: Value = serde_json::from_slice(&std::fs::read(metadata).unwrap()).unwrap();
    full["lidar_data_format"]["column_window"] = json!([0, 511]);
    let full_file = folder.path().join("full.json");
    std::fs::write(&full_file, full.to_string()).unwrap();
    let one: Vec<Datagram> = datagrams(&shared("captures/ouster/windowed_frame1.pcap"));
    let one: Vec<Datagram> = one.into_iter().filter(|datagram| datagram.payload.len() == 8448).collect();
    let turns = (0..6_u64).flat_map(|turn| one.iter().map(move |datagram| later(datagram, turn)));
    let capture = write_capture(&folder.path().join("turns.pcap"), &turns.collect::<Vec<_>>());
    let (capture, full_file) = (capture.to_str().unwrap(), full_file.to_str().unwrap());
    let (code, document, stderr) = decode(capture, &[full_file], &[]);
    assert_eq!(code, 0, "{stderr}");
    ensure_nothing_is_missing(&document);
    let sensor = &document["sensors"][0];
    assert_eq!(sensor["corrections"][0]["found"], "[1, 256]", "{stderr}");
    let frames = sensor["frames"].as_array().unwrap();
    assert_eq!(frames.len(), 6);
    assert!(frames.iter().all(|frame| frame["complete"] == true && frame["points"] == 9246), "{frames:?}");
}

/// The same packet so many turns of 100 ms later.
fn later(datagram: &Datagram, turns: u64) -> Datagram {
    let mut later = datagram.clone();
    later.host_time_ns += turns * 100_000_000;
    let frame_id = u16::from_le_bytes(later.payload[2..4].try_into().unwrap()) + turns as u16;
    later.payload[2..4].copy_from_slice(&frame_id.to_le_bytes());
    for column in 0..16 {
        let at = 32 + column * (12 + 128 * 4);
        let time_ns = u64::from_le_bytes(later.payload[at..at + 8].try_into().unwrap());
        later.payload[at..at + 8].copy_from_slice(&(time_ns + turns * 100_000_000).to_le_bytes());
    }
    later
}

/// Byte order marks, comments, line ends, lists: what does not change the metadata does not change the answer.
fn metadata_are_read_as_people_keep_them() {
    let text = std::fs::read_to_string(shared("captures/ouster/crc_test.json")).unwrap();
    let (_, right, _) = decode(&path(CRC_TEST), &[&path("captures/ouster/crc_test.json")], &[]);
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("kept.json");
    let utf_16 = |text: &str| {
        let words = text.encode_utf16().flat_map(u16::to_le_bytes);
        [0xff, 0xfe].into_iter().chain(words).collect::<Vec<u8>>()
    };
    let contents = [
        std::fs::read(field("crc_test_with_bom.json")).unwrap(),
        format!("\u{feff}{text}").into_bytes(),
        format!("// of the left one\n{text}/* http://x */\n").into_bytes(),
        text.replace('\n', "\r\n").into_bytes(),
        utf_16(&text),
        format!("[{text}]").into_bytes(),
    ];
    for content in contents {
        std::fs::write(&file, &content).unwrap();
        let (code, document, stderr) = decode(&path(CRC_TEST), &[file.to_str().unwrap()], &[]);
        assert_eq!((code, stderr.as_str()), (0, ""));
        assert_eq!(document["sensors"][0]["frames"], right["sensors"][0]["frames"]);
    }
    std::fs::write(&file, format!("[{text},{text}]")).unwrap();
    let (code, _, stderr) = decode(&path(CRC_TEST), &[file.to_str().unwrap()], &[]);
    assert!(code == 1 && stderr.contains("a list of 2"), "{stderr}");
}

/// By its name, or by the serial number in it; where several describe one sensor, its name tells, and `--meta` wins.
fn metadata_beside_a_capture_are_used() {
    let (_, right, _) = decode(&path(CRC_TEST), &[&path("captures/ouster/crc_test.json")], &[]);
    let text = std::fs::read_to_string(shared("captures/ouster/crc_test.json")).unwrap();
    let other = std::fs::read_to_string(shared("captures/ouster/windowed_frame1_0.json")).unwrap();
    for (names, used) in [
        (&["walk.json"][..], Some("walk.json")),
        (&["walk_0.json", "other.json"], Some("walk_0.json")),
        (&["front.json"], Some("front.json")),
        (&["other.json"], None),
        (&["front.json", "rear.json"], None),
        (&["front.json", "rear.json", "walk.json"], Some("walk.json")),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let place = |name: &str| folder.path().join(name);
        std::fs::copy(shared(CRC_TEST), place("walk.pcap")).unwrap();
        for (at, name) in names.iter().enumerate() {
            let content = if *name == "other.json" {
                other.clone()
            } else {
                text.replace("7502", &format!("{}", 7502 + at))
            };
            std::fs::write(place(name), content.replace("\"fps\": 10", &format!("\"fps\": 10.{at}")))
                .unwrap();
        }
        let (code, document, stderr) = decode(place("walk.pcap").to_str().unwrap(), &[], &[]);
        match used {
            Some(used) => {
                assert_eq!(code, 0, "{names:?}: {stderr}");
                assert!(
                    stderr.contains(&format!("{used} lies next to the recording and is used")),
                    "{stderr}"
                );
                assert!(document["sensors"][0]["metadata"].as_str().unwrap().ends_with(used), "{names:?}");
                let points = |document: &Value| of_frames(&document["sensors"][0], "points");
                assert_eq!(points(&document), points(&right));
            }
            None => assert!(code == 1 && stderr.contains("--meta"), "{names:?}: {stderr}"),
        }
        let wrong = path("captures/ouster/windowed_frame1_0.json");
        let (code, _, stderr) = decode(place("walk.pcap").to_str().unwrap(), &[&wrong], &[]);
        assert!(code == 1 && !stderr.contains("is used"), "--meta wins: {stderr}");
    }
}

/// Two revolutions of 1024 columns, then, after an initialization, two of 512 by the same sensor.
fn a_mode_that_changes_on_the_way() {
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    for (profile, order) in [
        ("RNG15_RFL8_NIR8", [1024, 512]),
        ("RNG15_RFL8_NIR8", [512, 1024]),
        ("RNG19_RFL8_SIG16_NIR16_DUAL", [2048, 512]),
        ("LEGACY", [512, 2048]),
        ("LEGACY", [1024, 512]),
    ] {
        let what = format!("{profile} {order:?}");
        let (capture, file) = capture_of_two_modes(&folder, profile, order);
        let (code, document, stderr) = decode(&capture, &[&file], &[]);
        assert_eq!(code, 0, "{what}: {stderr}");
        ensure_nothing_is_missing(&document);
        let sensor = &document["sensors"][0];
        let expected: Vec<u64> = order.iter().flat_map(|columns| [*columns as u64; 3]).collect();
        assert_eq!(of_frames(sensor, "valid_columns"), expected, "{what}");
        let frames = sensor["frames"].as_array().unwrap();
        assert!(frames.iter().all(|frame| frame["complete"] == true), "{what}: {frames:#?}");
        let (before, after) = (format!("{}x10", order[0]), format!("{}x10", order[1]));
        let since_ns = 1_700_000_000_000_000_000_u64 + SECOND_PART_NS;
        let change = json!({"setting": "lidar_mode", "stated": before, "found": after, "since_ns": since_ns});
        let changes = sensor["corrections"].as_array().unwrap();
        let modes: Vec<_> = changes.iter().filter(|change| change["setting"] == "lidar_mode").collect();
        assert_eq!(modes, [&change], "{what}");
        let words =
            format!("its lidar_mode changed from {before} to {after} at 2023-11-14T22:13:35.000000000Z");
        assert!(stderr.contains(&words), "{what}: {stderr}");
        let (code, seen) = inspect(&[&capture, "--meta", &file]);
        assert_eq!(code, 0, "{what}: {seen}");
        let points: u64 = of_frames(sensor, "points").iter().sum();
        for name in ["all.las", "all.laz", "all.ply", "all.pcd", "all.csv", "all.npy", "all.e57", "all.mcap"]
        {
            let (code, written, stderr) = decode(&capture, &[&file], &["--out", &place(name)]);
            assert_eq!(code, 0, "{what} {name}: {stderr}");
            assert_eq!(of_frames(&written["sensors"][0], "points").iter().sum::<u64>(), points);
        }
        let csv = std::fs::read_to_string(place("all.csv")).unwrap();
        assert_eq!(csv.lines().filter(|line| !line.starts_with('#')).count() as u64, points + 1, "{what}");
        for name in ["all.las", "all.laz", "all.ply", "all.pcd", "all.csv", "all.npy", "all.e57", "all.mcap"]
        {
            std::fs::remove_file(place(name)).unwrap();
        }
    }
}

/// Start of the second part of the capture below, after the first packet's host time.
const SECOND_PART_NS: u64 = 15_000_000_000;

/// Three revolutions in one mode and, after a pause and a new initialization, three in another; metadata of the first.
fn capture_of_two_modes(folder: &tempfile::TempDir, profile: &str, order: [usize; 2]) -> (String, String) {
    use sensors::made_up::ouster_revolution;
    use sensors::ouster::{Metadata, Profile, Synthetic};
    let profile = Profile::from_name(profile).unwrap();
    let metadata = |columns: usize| {
        Metadata::synthetic(&Synthetic::new("os0-32", 77, profile).columns(columns, 16)).unwrap()
    };
    let mut packets = Vec::new();
    for (part, columns) in (0..).zip(order) {
        for turn in 0..3_u64 {
            let start_ns = 5_000_000_000 + part * 10_000_000_000 + turn * 100_000_000;
            let mut of_part = metadata(columns);
            of_part.init_id = 100 + part as u32;
            let revolution = ouster_revolution(&of_part, 10 + turn as u32, start_ns);
            let count = revolution.len() as u64;
            packets.extend((0..).zip(revolution).map(|(at, payload)| Datagram {
                host_time_ns: 1_700_000_000_000_000_000 + start_ns + at * 100_000_000 / count,
                source: ([10, 0, 0, 7], 7502).into(),
                destination: ([10, 0, 0, 1], 7502).into(),
                payload,
            }));
        }
    }
    let capture = write_capture(&folder.path().join("changed.pcap"), &packets);
    let file = folder.path().join("first.json");
    std::fs::write(&file, metadata(order[0]).to_json()).unwrap();
    (capture.to_str().unwrap().to_owned(), file.to_str().unwrap().to_owned())
}

fn gps_time_of_a_ptp_clock_is_right() {
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (capture, meta) = (field("ouster_ptp.pcap"), field("ouster_ptp.json"));
    for name in ["points.las", "points.laz", "points.e57"] {
        let (code, document, stderr) = decode(&capture, &[&meta], &["--out", &place(name)]);
        assert_eq!(code, 0, "{stderr}");
        assert!(
            document["sensors"][0]["clock"].as_str().unwrap().contains("TAI"),
            "{}",
            document["sensors"][0]
        );
    }
    for name in ["points.las", "points.laz"] {
        let mut reader = las::Reader::from_path(place(name)).unwrap();
        let data = reader.read_points(1).unwrap();
        let first = data.points().next().unwrap().unwrap();
        assert!((first.gps_time.unwrap() - 384_035_217.996_875).abs() < 1e-6, "{name}: {:?}", first.gps_time);
    }
    let reader = e57::E57Reader::from_file(place("points.e57")).unwrap();
    let start = reader.pointclouds()[0].acquisition_start.clone().unwrap();
    assert!((start.gps_time - 1_384_035_217.996_875).abs() < 1e-6, "{}", start.gps_time);
}

/// As generic receive offload puts them together: several datagrams of one length as one.
fn merged_datagrams_are_taken_apart() {
    let folder = tempfile::tempdir().unwrap();
    let merged = |capture: &str, most: usize| {
        let mut all: Vec<Datagram> = Vec::new();
        let mut together = 0;
        for datagram in datagrams(&shared(capture)) {
            match all.last_mut() {
                Some(last)
                    if together < most
                        && last.destination == datagram.destination
                        && last.payload.len() == together * datagram.payload.len() =>
                {
                    last.payload.extend(&datagram.payload);
                    together += 1;
                }
                _ => {
                    together = 1;
                    all.push(datagram);
                }
            }
        }
        write_capture(&folder.path().join("merged.pcap"), &all).to_str().unwrap().to_owned()
    };
    let meta = path("captures/ouster/crc_test.json");
    let vlp_16 = "captures/velodyne/mrpt_vlp16_gps.pcap";
    for (capture, metas, most) in [(CRC_TEST, vec![meta.as_str()], 7), (vlp_16, vec![], 5)] {
        let (_, right, _) = decode(&path(capture), &metas, &[]);
        let (code, document, stderr) = decode(&merged(capture, most), &metas, &[]);
        assert_eq!((code, stderr.as_str()), (0, ""), "{capture}");
        let points = |document: &Value| of_frames(&document["sensors"][0], "points");
        assert_eq!(points(&document), points(&right), "{capture}");
        let counted = |document: &Value| document["sensors"][0]["counters"].clone();
        assert_eq!(counted(&document), counted(&right), "{capture}");
        assert_eq!(document["sensors"][0]["imu_samples"], right["sensors"][0]["imu_samples"]);
    }
}
