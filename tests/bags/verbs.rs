//! Verbs on bags: what cannot be decoded is named, pipes and parts are read, and packets go from bag to capture and back.

use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use glam::DVec3;
use outrigger::recording::bags::{BagClouds, BagPackets, Surroundings};
use sensors::capture::CaptureReader;
use serde_json::Value;

use super::{bag, decode, points_of};
use crate::support::{Case, shared, with_shared};

pub const CASES: &[Case] = &[
    with_shared("packets_of_another_maker_are_named_and_not_decoded", other_makers),
    with_shared("a_bag_without_lidar_lists_its_topics", no_lidar),
    with_shared("inspect_lists_topics_and_decodes_by_them", inspected),
    with_shared("a_bag_comes_through_a_pipe", piped),
    with_shared("parts_of_a_split_bag_are_read_in_order", split),
    with_shared("packed_captures_decode_as_plain_ones", packed_captures),
    with_shared("an_osf_file_is_named_with_what_to_do", osf),
    with_shared("clouds_of_a_bag_become_point_files", cloud_files),
    with_shared("packets_go_from_capture_to_bags_and_back_bit_for_bit", round_trips),
    with_shared("a_bag_is_cut_by_time_and_sensor", cut_by_time),
    with_shared("points_that_are_not_there_are_not_written", nothing_to_write),
    with_shared("an_mcap_file_states_where_sensor_and_rig_were", stated_transforms),
    with_shared("a_bag_that_ends_early_gives_what_is_before_and_says_so", ended_early),
];

/// A VLP-16 with its position packets.
const VLP16: &str = "captures/velodyne/rustlidar_vlp16.pcap";

fn outrigger(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_outrigger")).args(arguments).output().unwrap()
}

fn text_of(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn other_makers() {
    let path = bag("real/nebula_hesai_qt64");
    let output = outrigger(&["decode", text_of(&path)]);
    let messages = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{messages}");
    for expected in ["/pandar_packets", "pandar_msgs/PandarScan", "4 messages of Hesai packets"] {
        assert!(messages.contains(expected), "{expected}: {messages}");
    }
    let output = outrigger(&["inspect", "--json", text_of(&path)]);
    let document: Value = crate::support::document(&output.stdout).unwrap();
    assert_eq!((document["sensors"].as_array().unwrap().len(), output.status.code()), (0, Some(0)));
    assert_eq!(document["topics"][0]["messages"], 4);
}

fn no_lidar() {
    for (name, topic) in [
        ("real/evo_nav2_turtlebot.mcap", "/odom (nav_msgs/Odometry): 2639 messages"),
        ("real/evo_tf_example.bag", "/tf "),
    ] {
        let output = outrigger(&["decode", text_of(&bag(name))]);
        assert_eq!(output.status.code(), Some(1), "{output:?}");
        assert!(stderr(&output).contains(topic), "{name}: {}", stderr(&output));
    }
}

fn inspected() {
    let output = outrigger(&["inspect", "--json", text_of(&bag("os0_crc_zstd.mcap"))]);
    let document: Value = crate::support::document(&output.stdout).unwrap();
    assert_eq!(output.status.code(), Some(0), "{document}");
    assert_eq!(document["sensors"][0]["source"], "/ouster/lidar_packets");
    let topics = document["topics"].as_array().unwrap();
    let lidar = topics.iter().find(|topic| topic["topic"] == "/ouster/lidar_packets").unwrap();
    assert_eq!((&lidar["packets"], &lidar["type"]), (&34.into(), &"ouster_sensor_msgs/PacketMsg".into()));
    assert!(
        document["flows"]
            .as_array()
            .unwrap()
            .iter()
            .all(|flow| !flow["source"].as_str().unwrap().contains("192.0"))
    );
    let killed = outrigger(&["inspect", text_of(&bag("vlp16_scans_bz2_killed.bag.active"))]);
    assert_eq!(killed.status.code(), Some(3));
    assert!(
        String::from_utf8_lossy(&killed.stdout).contains("the file ends inside the record at byte"),
        "{killed:?}"
    );
}

fn piped() {
    for name in ["vlp16_scans_cut_lz4.bag", "os0_crc_zstd.mcap"] {
        for verb in [&["decode", "--json", "-"][..], &["inspect", "--json", "-"]] {
            let mut child = Command::new(env!("CARGO_BIN_EXE_outrigger"))
                .args(verb)
                .stdin(Stdio::piped())
                .stdout(Stdio::piped())
                .spawn()
                .unwrap();
            child.stdin.take().unwrap().write_all(&std::fs::read(bag(name)).unwrap()).unwrap();
            let output = child.wait_with_output().unwrap();
            let document: Value = crate::support::document(&output.stdout).unwrap();
            assert_eq!(output.status.code(), Some(0), "{name}: {document}");
            assert_eq!(document["sensors"].as_array().unwrap().len(), 1, "{name}");
        }
    }
}

fn split() {
    let folder = tempfile::tempdir().unwrap();
    let whole = bag("vlp16_scans_db3/vlp16_scans_db3.db3");
    // more than nine parts sort otherwise by name
    let names = ["walk_10.db3", "walk_2.db3"];
    for (name, condition) in names
        .iter()
        .zip(["id <= (SELECT MIN(id) + 1 FROM messages)", "id > (SELECT MIN(id) FROM messages) + 1"])
    {
        let path = folder.path().join(name);
        std::fs::copy(&whole, &path).unwrap();
        let connection = rusqlite::Connection::open(&path).unwrap();
        connection.execute(&format!("DELETE FROM messages WHERE NOT ({condition})"), []).unwrap();
    }
    let list = |names: &[&str]| {
        let list: String = names.iter().map(|name| format!("    - {name}\n")).collect();
        let text = format!(
            "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: sqlite3\n  relative_file_paths:\n{list}"
        );
        std::fs::write(folder.path().join("metadata.yaml"), text).unwrap();
    };
    list(&names);
    let path = text_of(folder.path()).to_owned();
    let (document, code) = decode(&path, &[]);
    assert_eq!((points_of(&document).iter().sum::<u64>(), code), (73_486, 0), "{document}");
    list(&[names[0], "walk_11.db3", names[1]]);
    let (document, code) = decode(&path, &[]);
    assert_eq!((points_of(&document).iter().sum::<u64>(), code), (73_486, 3));
    assert!(document["losses"].to_string().contains("walk_11.db3"), "{document}");
    // without a list, by their numbers
    std::fs::remove_file(folder.path().join("metadata.yaml")).unwrap();
    std::fs::rename(folder.path().join(names[0]), folder.path().join("walk_1.db3")).unwrap();
    let (document, code) = decode(&path, &[]);
    assert_eq!((points_of(&document).iter().sum::<u64>(), code), (73_486, 0));
}

fn packed_captures() {
    let plain = shared(VLP16);
    let bytes = std::fs::read(&plain).unwrap();
    let expected: Value =
        serde_json::from_slice(&outrigger(&["decode", "--json", text_of(&plain)]).stdout).unwrap();
    let folder = tempfile::tempdir().unwrap();
    // in blocks, as recorders pack them
    let mut zstd = zstd::Encoder::new(Vec::new(), 3).unwrap();
    let mut lz4 = lz4::EncoderBuilder::new().build(Vec::new()).unwrap();
    for block in bytes.chunks(10_000) {
        zstd.write_all(block).unwrap();
        zstd.flush().unwrap();
        lz4.write_all(block).unwrap();
        lz4.flush().unwrap();
    }
    let zstd = zstd.finish().unwrap();
    let (lz4, outcome) = lz4.finish();
    outcome.unwrap();
    for (name, content) in [("a.pcap.zst", &zstd), ("a.pcap.lz4", &lz4)] {
        let path = folder.path().join(name);
        std::fs::write(&path, content).unwrap();
        let output = outrigger(&["decode", "--json", text_of(&path)]);
        let document: Value = crate::support::document(&output.stdout).unwrap();
        assert_eq!(document["sensors"][0]["totals"], expected["sensors"][0]["totals"], "{name}");
        assert_eq!(output.status.code(), Some(0));
        // cut off: said, and what was whole is decoded
        std::fs::write(&path, &content[..content.len() / 2]).unwrap();
        let output = outrigger(&["decode", "--json", text_of(&path)]);
        assert_eq!(output.status.code(), Some(3), "{name}: {}", stderr(&output));
    }
}

fn osf() {
    let output = outrigger(&["decode", text_of(&shared("field/captures/empty_osf.osf"))]);
    assert_eq!(output.status.code(), Some(1));
    assert!(
        stderr(&output)
            .contains("an Ouster OSF recording (convert it: ouster-cli source FILE save out.pcap)"),
        "{output:?}"
    );
}

fn cloud_files() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("points.csv");
    let (document, code) = decode("vlp16_points_lz4.mcap", &["--out", text_of(&out)]);
    assert_eq!((points_of(&document), code), (vec![18_790, 18_701, 18_678, 17_317], 0), "{document}");
    assert_eq!(std::fs::read_to_string(&out).unwrap().lines().count(), 73_486 + 1);
    let (document, code) = decode("backpack_room.mcap", &[]);
    let points: u64 = document["sensors"]
        .as_array()
        .unwrap()
        .iter()
        .map(|sensor| sensor["totals"]["points"].as_u64().unwrap())
        .sum();
    assert_eq!((points, code), (32_688, 0));
    assert_eq!(document["sensors"].as_array().unwrap().len(), 2);
    // clouds that stay in their sensors' frames take the transforms and the poses of their bag with them
    let again = folder.path().join("again.mcap");
    let (_, code) = decode("backpack_room.mcap", &["--out", text_of(&again)]);
    assert_eq!(code, 0);
    // every point at its own time lies on a wall of the room
    for (name, count) in
        [("backpack_room.mcap", 32_688), ("backpack_room_lz4.bag", 41_984), (text_of(&again), 32_688)]
    {
        let out = folder.path().join("world.csv");
        let (_, code) = decode(name, &["--frame", "world", "--force", "--out", text_of(&out)]);
        assert_eq!(code, 0, "{name}");
        let text = std::fs::read_to_string(&out).unwrap();
        let header: Vec<&str> = text.lines().next().unwrap().split(',').collect();
        let axes =
            ["x_m", "y_m", "z_m"].map(|axis| header.iter().position(|column| *column == axis).unwrap());
        let walls_m = [[-6.0, 6.0], [-4.0, 4.0], [-1.5, 2.5]];
        for line in text.lines().skip(1) {
            let values: Vec<&str> = line.split(',').collect();
            let off_m = |axis: usize| {
                let value: f64 = values[axes[axis]].parse().unwrap();
                walls_m[axis]
                    .map(|wall_m: f64| (value - wall_m).abs())
                    .into_iter()
                    .fold(f64::INFINITY, f64::min)
            };
            let nearest_m = (0..3).map(off_m).fold(f64::INFINITY, f64::min);
            assert!(nearest_m <= 1.1e-5, "{name}: {line}");
        }
        assert_eq!(text.lines().count(), count + 1);
    }
    let output = outrigger(&["decode", text_of(&bag("vlp16_points_lz4.mcap")), "--frame", "world"]);
    assert!(stderr(&output).contains("it holds no trajectory"), "{output:?}");
}

type Stamped = (u64, Vec<u8>);

fn captured(path: &Path) -> Vec<Stamped> {
    let mut reader = CaptureReader::open(path).unwrap();
    let mut packets = Vec::new();
    while let Some(packet) = reader.next().unwrap() {
        packets.push((packet.host_time_ns, packet.payload.to_vec()));
    }
    packets.sort();
    packets
}

fn bagged(path: &Path) -> Vec<Stamped> {
    let mut reader = BagPackets::open(path, "bag").unwrap();
    let mut packets = Vec::new();
    while let Some(found) = reader.next().unwrap() {
        packets.push((found.packet.host_time_ns, found.packet.payload.to_vec()));
    }
    assert!(reader.losses().is_empty());
    packets.sort();
    packets
}

fn round_trips() {
    let folder = tempfile::tempdir().unwrap();
    let vlp16 = shared(VLP16);
    let crc = [shared("captures/ouster/crc_test.pcap"), shared("captures/ouster/crc_test.json")];
    for (capture, metadata) in [(vlp16.as_path(), None), (crc[0].as_path(), Some(text_of(&crc[1])))] {
        let expected = captured(capture);
        for name in ["a.mcap", "a.bag"] {
            let path = folder.path().join(name);
            let mut arguments = vec!["cut", text_of(capture), "--force", "-o", text_of(&path)];
            arguments.extend(metadata.iter().flat_map(|path| ["--meta", path]));
            let output = outrigger(&arguments);
            assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
            assert!(bagged(&path) == expected, "{name} of {}", capture.display());
            // it decodes without any metadata beside it
            let plain = outrigger(&["decode", "--json", text_of(&path)]);
            assert_eq!(plain.status.code(), Some(0), "{}", stderr(&plain));
            let back = folder.path().join("back.pcap");
            let output = outrigger(&["cut", text_of(&path), "--force", "-o", text_of(&back)]);
            assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
            assert!(captured(&back) == expected, "{name} of {}, back", capture.display());
        }
    }
}

fn cut_by_time() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("part.pcap");
    let whole = bag("os0_crc_zstd.mcap");
    let all = bagged(&whole);
    let arguments = ["cut", text_of(&whole), "--from", "0.05", "--to", "0.08", "-o", text_of(&path)];
    let output = outrigger(&arguments);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let start_ns = all.iter().map(|(time_ns, _)| *time_ns).min().unwrap();
    let is_within = |(time_ns, _): &&Stamped| (50_000_000..80_000_000).contains(&(time_ns - start_ns));
    let expected: Vec<Stamped> = all.iter().filter(is_within).cloned().collect();
    assert!(!expected.is_empty() && captured(&path) == expected);
    // a second time it is there already; nothing of another sensor is in it
    assert_eq!(outrigger(&arguments).status.code(), Some(1));
    // nothing is left: no empty file
    let clouds = bag("backpack_room.mcap");
    let none = folder.path().join("none.mcap");
    for (recording, more, message) in [
        (&whole, &["--from", "100", "--to", "200"][..], "packets lies in the part that was asked for"),
        (&clouds, &[], "the recording holds no packet"),
    ] {
        let arguments = [&["cut", text_of(recording), "-o", text_of(&none)], more].concat();
        let output = outrigger(&arguments);
        assert_eq!(output.status.code(), Some(1));
        assert!(stderr(&output).contains(message), "{}", stderr(&output));
        assert!(!none.exists());
    }
    let output = outrigger(&["cut", text_of(&whole), "--sensor", "nobody", "--force", "-o", text_of(&path)]);
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("no packet of sensor nobody; there are ouster"), "{}", stderr(&output));
    assert!(captured(&path) == expected, "the file of before is still there");
}

/// No file, no folder, and no success either; inertial samples alone are something.
fn nothing_to_write() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let (whole, rest) = (bag("os0_windowed_none.bag"), at("rest.mcap"));
    let output = outrigger(&["cut", text_of(&whole), "--from", "0.06", "-o", text_of(&rest)]);
    assert!(output.status.success(), "{}", stderr(&output));
    let decoded = |recording: &Path, name: &str, more: &[&str]| {
        outrigger(&[&["decode", text_of(recording), "-o", text_of(&at(name))], more].concat())
    };
    let clouds = bag("backpack_room.mcap");
    let far = ["--clip", "900,900,900,901,901,901"];
    for (recording, name, format, is_far) in [
        (&rest, "none.laz", "laz", false),
        (&rest, "none/", "ply", false),
        (&clouds, "none.laz", "laz", true),
        (&clouds, "none", "mcap", true),
        (&whole, "none", "ply", true),
    ] {
        let more = [&["--format", format][..], if is_far { &far } else { &[] }].concat();
        let message = if is_far { "no point is left" } else { "no point in 0 frames" };
        let output = decoded(recording, name, &more);
        assert_eq!(output.status.code(), Some(1), "{name} {more:?}");
        assert!(stderr(&output).contains(message), "{name} {more:?}: {}", stderr(&output));
        assert!(!at(name).exists(), "{name} {more:?}");
    }
    let output = decoded(&rest, "inertial.mcap", &[]);
    assert!(output.status.success() && at("inertial.mcap").exists(), "{}", stderr(&output));
    assert!(outrigger(&["decode", text_of(&rest)]).status.success(), "nothing is to be written");
}

/// A trajectory of some seconds around this time (s), which walks and turns.
fn walk(start_s: u64) -> String {
    let pose = |at: u64| {
        let time_s = 0.05 * at as f64;
        let (sin, cos) = (0.2 * time_s).sin_cos();
        format!(
            "{:.3} {:.4} {:.4} 1.5 0 0 {sin:.9} {cos:.9}\n",
            (start_s - 2) as f64 + time_s,
            0.5 * time_s,
            -time_s
        )
    };
    (0..200).map(pose).collect()
}

/// How many points the clouds of a bag hold and the sum of their places in the world, by the transforms in it where they are in
/// their sensor's frame, m.
fn in_world(path: &Path) -> (usize, DVec3) {
    let surroundings = Surroundings::read(path, "bag").unwrap();
    let mut clouds = BagClouds::open(path, "bag").unwrap();
    let (mut count, mut sum_m) = (0, DVec3::ZERO);
    while let Some(cloud) = clouds.next().unwrap() {
        for point in &cloud.points {
            let world_from_cloud = (cloud.frame_id != "world").then(|| {
                let (of, child_from_cloud) = surroundings.trajectory_of(&cloud.frame_id).unwrap();
                assert_eq!(
                    (of.parent.as_str(), of.child.as_str(), of.topic.as_str()),
                    ("world", "base_link", "/tf")
                );
                of.trajectory.at(point.time_ns).unwrap() * child_from_cloud
            });
            let place_m = point.position_m;
            sum_m += world_from_cloud.map_or(place_m, |pose| pose.transform_point(place_m));
            count += 1;
        }
    }
    (count, sum_m)
}

fn stated_transforms() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let capture = shared("captures/velodyne/nebula_vlp16.pcap");
    let start_s = captured(&capture)[0].0 / 1_000_000_000;
    std::fs::write(at("walk.tum"), walk(start_s)).unwrap();
    let mount = r#"{"format": "outrigger-mount/1", "frame": "mount: x right, y forward, z up", "sensors": [{"name": "top",
        "model": "vlp-16", "x_m": 0.3, "y_m": 0.1, "z_m": 0.2, "pitch_deg": 20, "roll_deg": 5}]}"#;
    std::fs::write(at("mount.json"), mount).unwrap();
    let stated = [
        "--mount",
        &at("mount.json").display().to_string(),
        "--trajectory",
        &at("walk.tum").display().to_string(),
    ]
    .map(str::to_owned);
    let run = |verb: &str, out: &str, more: &[&str]| {
        let out = at(out);
        let mut arguments = vec![verb, text_of(&capture), "--out", text_of(&out)];
        arguments.extend(stated.iter().map(String::as_str).chain(more.iter().copied()));
        let output = outrigger(&arguments);
        assert!(output.status.success(), "{}", stderr(&output));
        out
    };
    let (count, sum_m) = in_world(&run("decode", "world.mcap", &["--frame", "world"]));
    let (stated_count, stated_sum_m) = in_world(&run("decode", "sensor.mcap", &[]));
    assert!(count > 10_000 && count == stated_count, "{count} {stated_count}");
    assert!((sum_m - stated_sum_m).length() < 1e-4 * count as f64, "{sum_m} {stated_sum_m}");
    let id = decode(text_of(&capture), &[]).0["sensors"][0]["id"].as_str().unwrap().to_owned();
    let sensor = format!("{}_velodyne", id.replace(|c: char| !c.is_ascii_alphanumeric(), "_"));
    let bytes = std::fs::read(at("sensor.mcap")).unwrap();
    let times = mcap::MessageStream::new(&bytes).unwrap().map(|message| message.unwrap().log_time);
    let (least_ns, most_ns) =
        times.fold((u64::MAX, 0), |(least, most), time| (least.min(time), most.max(time)));
    assert!(most_ns - least_ns < 1_000_000_000, "recorded together, whatever the sensor's clock shows");
    // packets, in both kinds of bag: the poses of the file around the packets, and the sensor where the mount file has it
    for name in ["packets.mcap", "packets.bag"] {
        let packets = Surroundings::read(&run("cut", name, &[]), name).unwrap();
        let [of] = &packets.trajectories[..] else { panic!("{}", packets.trajectories.len()) };
        let given = std::fs::read_to_string(at("walk.tum")).unwrap();
        let times = captured(&capture).iter().map(|stamped| stamped.0).collect::<Vec<_>>();
        let [first_ns, last_ns] = of.trajectory.time_span_ns();
        assert!(first_ns <= times[0] && last_ns >= *times.last().unwrap(), "{first_ns} {last_ns}");
        assert!(last_ns - first_ns < times.last().unwrap() - times[0] + 200_000_000, "no more than these");
        for (time_ns, pose) in of.trajectory.stamped() {
            let stamp = format!("{:.3} ", time_ns as f64 * 1e-9);
            let line = given.lines().find(|line| line.starts_with(&stamp)).unwrap();
            let numbers: Vec<f64> = line.split(' ').map(|word| word.parse().unwrap()).collect();
            assert!(
                pose.translation_m.abs_diff_eq(DVec3::new(numbers[1], numbers[2], numbers[3]), 1e-9),
                "{line}"
            );
        }
        let body_from_sensor = packets.frames.a_from_b("base_link", &sensor).unwrap();
        assert!(
            body_from_sensor.translation_m.abs_diff_eq(DVec3::new(0.1, -0.3, 0.2), 1e-9),
            "{body_from_sensor:?}"
        );
    }
    // a trajectory of another day is named
    std::fs::write(at("walk.tum"), walk(start_s + 86_400)).unwrap();
    let output =
        outrigger(&["cut", text_of(&capture), "--out", text_of(&at("other.mcap")), &stated[2], &stated[3]]);
    assert_eq!(output.status.code(), Some(3));
    assert!(stderr(&output).contains("no packet came in the time of the trajectory"), "{}", stderr(&output));
}

fn ended_early() {
    let folder = tempfile::tempdir().unwrap();
    let db3 = "os1_fusa_db3_message_zstd/os1_fusa_db3_message_zstd.db3";
    for name in
        ["os0_windowed_none.bag", "vlp16_scans_cut_lz4.bag", "vlp16_scans_bz2.bag", "os0_crc_zstd.mcap", db3]
    {
        let bytes = std::fs::read(bag(name)).unwrap();
        let read = |count: usize| {
            let path = folder.path().join("cut");
            std::fs::write(&path, &bytes[..count]).unwrap();
            let mut reader = BagPackets::open(&path, "cut").ok()?;
            let mut packets = Vec::new();
            while let Some(found) = reader.next().unwrap() {
                packets.push((found.packet.host_time_ns, found.packet.payload.to_vec()));
            }
            Some((packets, reader.losses()))
        };
        let (whole, losses) = read(bytes.len()).unwrap();
        assert!(losses.is_empty(), "{name}: {losses:?}");
        for percent in [20, 50, 80, 95] {
            let Some((packets, losses)) = read(bytes.len() * percent / 100) else { continue };
            assert!(whole.starts_with(&packets), "{name} at {percent} %");
            // behind the packets lies but an index
            assert!(packets.len() == whole.len() || !losses.is_empty(), "{name} at {percent} %: {losses:?}");
        }
        let (packets, _) = read(bytes.len() * 95 / 100).unwrap_or_default();
        let is_packed_as_one = name.ends_with(".mcap") || name.ends_with(".db3");
        assert!(is_packed_as_one || packets.len() * 2 > whole.len(), "{name}: {}", packets.len());
    }
}
