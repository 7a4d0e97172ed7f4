//! Bags of ROS 1 and ROS 2 against their right answers: counts, times and checksums of the packets in them, read back with
//! other programs, and the points that they decode to.

mod verbs;

use std::fmt::Write as _;
use std::path::PathBuf;
use std::process::Command;

use glam::DVec3;
use outrigger::recording::bags::{BagClouds, BagPackets, Surroundings, TopicCount};
use serde_json::Value;
use sha2::{Digest as _, Sha256};

use crate::support::{Case, shared, with_shared};

pub const CASES: &[Case] = &[
    with_shared("packets_times_and_checksums_are_those_of_other_readers", every_row_of_packets),
    with_shared("velodyne_bags_decode_to_the_points_of_the_capture", velodyne_points),
    with_shared("ouster_bags_decode_to_the_points_of_the_captures", ouster_points),
    with_shared("clouds_of_a_velodyne_driver_have_their_points_and_times", velodyne_clouds),
    with_shared("points_of_a_walking_backpack_lie_on_the_walls_of_the_room", backpack_rooms),
    with_shared("bags_without_lidar_hold_their_poses", poses_of_other_bags),
];

pub const VERBS: &[Case] = verbs::CASES;

/// A topic with packets: its name, messages, packets, first and last time of record, checksum of the stored packets.
type Row = (&'static str, u64, u64, Option<[u64; 2]>, &'static str);

const VLP16: &str = "0455595af291b092";
const VLP16_ENDS_NS: u64 = 1_453_364_283_096_219_000;
const OS0_NS: Option<[u64; 2]> = Some([1_726_766_428_522_046_000, 1_726_766_428_571_680_000]);
const CRC_NS: Option<[u64; 2]> = Some([1_725_914_836_380_241_000, 1_725_914_836_483_319_000]);

const ROWS: &[(&str, &[Row])] = &[
    (
        "vlp16_scans_none.bag",
        &[("/velodyne_packets", 4, 293, Some([1_453_364_282_808_252_000, VLP16_ENDS_NS]), VLP16)],
    ),
    (
        "vlp16_scans_cut_lz4.bag",
        &[("/front/velodyne_packets", 5, 293, Some([1_453_364_282_725_951_000, VLP16_ENDS_NS]), VLP16)],
    ),
    (
        "vlp16_scans_bz2.bag",
        &[("/velodyne_packets", 30, 293, Some([1_453_364_282_720_631_000, VLP16_ENDS_NS]), VLP16)],
    ),
    ("vlp16_scans_bz2_killed.bag.active", &[("/velodyne_packets", 20, 200, None, "18c41f1fa6d57ecb")]),
    (
        "vlp16_scans_db3",
        &[("/velodyne_packets", 4, 293, Some([1_453_364_282_808_252_000, VLP16_ENDS_NS]), VLP16)],
    ),
    (
        "os0_windowed_none.bag",
        &[
            ("/ouster/lidar_packets", 17, 17, OS0_NS, "03388b14822e994e"),
            ("/ouster/imu_packets", 10, 10, None, "d13544de62c4d60f"),
        ],
    ),
    (
        "os1_2019_nometa_lz4.bag",
        &[(
            "/os1_node/lidar_packets",
            100,
            100,
            Some([1_561_675_844_795_833_000, 1_561_675_844_950_641_000]),
            "4a9cb46a4ca45102",
        )],
    ),
    (
        "os0_crc_zstd.mcap",
        &[
            ("/ouster/lidar_packets", 34, 34, CRC_NS, "f33041e2984837b9"),
            ("/ouster/imu_packets", 10, 10, None, "4912cae437fa34ea"),
        ],
    ),
    (
        "os1_fusa_db3_message_zstd",
        &[
            (
                "/ouster/lidar_packets",
                8,
                8,
                Some([1_689_188_450_035_785_000, 1_689_188_450_046_644_000]),
                "84a961c04b09bb2f",
            ),
            ("/ouster/imu_packets", 2, 2, None, "9769b81dce84cf23"),
        ],
    ),
    (
        "os0_windowed_db3_file_zstd",
        &[
            ("/sensor_left/lidar_packets", 17, 17, OS0_NS, "03388b14822e994e"),
            ("/sensor_left/imu_packets", 10, 10, None, "d13544de62c4d60f"),
        ],
    ),
    (
        "os0_windowed_mcap_message_zstd",
        &[
            ("/ouster/lidar_packets", 17, 17, OS0_NS, "03388b14822e994e"),
            ("/ouster/imu_packets", 10, 10, None, "d13544de62c4d60f"),
        ],
    ),
    ("real/nebula_vlp32", &[("/sensing/lidar/front/velodyne_packets", 5, 379, None, "743019972b7771e2")]),
];

fn bag(name: &str) -> PathBuf {
    shared("captures/bags").join(name)
}

fn every_row_of_packets() {
    for (name, rows) in ROWS {
        let path = bag(name);
        let mut packets = BagPackets::open(&path, name).unwrap();
        let mut hashes = vec![Sha256::new(); 64];
        while let Some(found) = packets.next().unwrap() {
            hashes[found.topic].update(found.stored);
        }
        assert_eq!(packets.losses().is_empty(), !name.ends_with(".active"), "{name}: {:?}", packets.losses());
        for (topic, messages, count, span_ns, checksum) in *rows {
            let at = packets.topics().iter().position(|known| known.name == *topic).unwrap();
            let TopicCount { messages: found_messages, packets: found, span_ns: found_ns, malformed, .. } =
                &packets.counts()[at];
            assert_eq!((found_messages, found, *malformed), (messages, count, 0), "{name} {topic}");
            assert!(span_ns.is_none() || found_ns == span_ns, "{name} {topic}: {found_ns:?}");
            let mut hash = String::new();
            hashes[at].clone().finalize()[..8].iter().for_each(|byte| write!(hash, "{byte:02x}").unwrap());
            assert_eq!(hash, *checksum, "{name} {topic}");
        }
        let with_packets = packets.counts().iter().filter(|count| count.packets > 0).count();
        assert_eq!(with_packets, rows.len(), "{name}: {:?}", packets.counts());
    }
}

/// What `decode --json` says of a bag, and its exit code.
fn decode(name: &str, arguments: &[&str]) -> (Value, i32) {
    let output = Command::new(env!("CARGO_BIN_EXE_outrigger"))
        .args(["decode", "--json"])
        .arg(bag(name))
        .args(arguments)
        .output()
        .unwrap();
    let document = crate::support::document(&output.stdout).unwrap_or_else(|_| panic!("{name}: {output:?}"));
    (document, output.status.code().unwrap())
}

fn points_of(document: &Value) -> Vec<u64> {
    let frames = document["sensors"][0]["frames"].as_array().unwrap();
    frames.iter().map(|frame| frame["points"].as_u64().unwrap()).collect()
}

fn velodyne_points() {
    for name in ["vlp16_scans_none.bag", "vlp16_scans_cut_lz4.bag", "vlp16_scans_bz2.bag", "vlp16_scans_db3"]
    {
        let (document, code) = decode(name, &[]);
        assert_eq!(code, 0, "{name}: {document}");
        assert_eq!(points_of(&document).iter().sum::<u64>(), 73_486, "{name}");
        assert_eq!(document["sensors"][0]["counters"]["packets"], 293, "{name}");
    }
    let (document, code) = decode("vlp16_scans_bz2_killed.bag.active", &[]);
    assert_eq!(code, 3, "{document}");
    assert_eq!(document["sensors"][0]["counters"]["packets"], 200);
    let (document, code) = decode("real/nebula_vlp32", &[]);
    assert_eq!((points_of(&document).iter().sum::<u64>(), code), (131_305, 0));
    assert_eq!(document["sensors"][0]["id"], "sensing-lidar-front");
}

fn ouster_points() {
    for name in ["os0_windowed_none.bag", "os0_windowed_db3_file_zstd", "os0_windowed_mcap_message_zstd"] {
        let (document, code) = decode(name, &[]);
        assert_eq!((points_of(&document), code), (vec![9246], 0), "{name}: {document}");
    }
    let (document, code) = decode("os0_crc_zstd.mcap", &[]);
    assert_eq!((points_of(&document), code), (vec![28_055, 1637], 0), "{document}");
    let (document, _) = decode("os1_fusa_db3_message_zstd", &[]);
    assert_eq!(points_of(&document), [16_373], "{document}");
    let metadata = shared("captures/ouster/ouster_example.json");
    let (document, _) = decode("os1_2019_nometa_lz4.bag", &["--meta", metadata.to_str().unwrap()]);
    assert_eq!(points_of(&document), [12_783, 58_797, 20_690], "{document}");
    assert_eq!(document["sensors"][0]["id"], "os1_node");
}

fn velodyne_clouds() {
    let path = bag("vlp16_points_lz4.mcap");
    let mut clouds = BagClouds::open(&path, "bag").unwrap();
    let mut found = Vec::new();
    while let Some(cloud) = clouds.next().unwrap() {
        let since_stamp_s =
            |time_ns: u64| time_ns.cast_signed().wrapping_sub(cloud.stamp_ns.cast_signed()) as f64 * 1e-9;
        for point in &cloud.points {
            assert!(
                (-0.1009..=0.0014).contains(&since_stamp_s(point.time_ns)),
                "{}",
                since_stamp_s(point.time_ns)
            );
            assert!(point.ring < 16);
        }
        found.push((cloud.points.len(), cloud.stamp_ns));
    }
    let expected = [
        (18_790, 1_453_364_282_809_579_000),
        (18_701, 1_453_364_282_910_440_000),
        (18_678, 1_453_364_283_011_284_000),
        (17_317, 1_453_364_283_096_219_000),
    ];
    assert_eq!(found, expected);
    assert!(clouds.losses().is_empty());
}

fn backpack_rooms() {
    let rooms = [
        ("backpack_room.mcap", 32_688, DVec3::new(-1.19481, -0.34898, 0.39430)),
        ("backpack_room_lz4.bag", 41_984, DVec3::new(-1.14956, -0.37852, 0.39018)),
    ];
    let (low_m, high_m) = (DVec3::new(-6.0, -4.0, -1.5), DVec3::new(6.0, 4.0, 2.5));
    for (name, count, mean_m) in rooms {
        let path = bag(name);
        let surroundings = Surroundings::read(&path, name).unwrap();
        assert!(surroundings.notices.is_empty(), "{:?}", surroundings.notices);
        let mut clouds = BagClouds::open(&path, name).unwrap();
        let (mut points, mut sum_m, mut worst_m, mut number) = (0, DVec3::ZERO, 0.0_f64, 0);
        while let Some(mut cloud) = clouds.next().unwrap() {
            let (of, child_from_cloud) = surroundings.trajectory_of(&cloud.frame_id).unwrap();
            for point in &mut cloud.points {
                let world_from_cloud = of.trajectory.at(point.time_ns).unwrap() * child_from_cloud;
                point.position_m = world_from_cloud.transform_point(point.position_m);
            }
            number += 1;
            for point in &cloud.points {
                let at_m = point.position_m;
                let to_walls_m = (at_m - low_m).abs().min((at_m - high_m).abs());
                worst_m = worst_m.max(to_walls_m.min_element());
                assert!((at_m.cmpge(low_m - 1e-5) & at_m.cmple(high_m + 1e-5)).all(), "{at_m}");
                (points, sum_m) = (points + 1, sum_m + at_m);
            }
        }
        assert_eq!((number, points), (8, count), "{name}");
        assert!(worst_m <= 1e-5, "{name}: {worst_m}");
        assert!(
            (sum_m / f64::from(points)).abs_diff_eq(mean_m, 1e-4),
            "{name}: {}",
            sum_m / f64::from(points)
        );
    }
}

fn poses_of_other_bags() {
    let turtlebot = Surroundings::read(&bag("real/evo_nav2_turtlebot.mcap"), "bag").unwrap();
    let odometry = turtlebot.trajectories.iter().find(|of| of.topic == "/odom").unwrap();
    assert_eq!((odometry.parent.as_str(), odometry.trajectory.stamped().count()), ("odom", 2639));
    let old = Surroundings::read(&bag("real/evo_tf_example.bag"), "bag").unwrap();
    let [of] = &old.trajectories[..] else { panic!("{}", old.trajectories.len()) };
    assert_eq!((of.parent.as_str(), of.child.as_str()), ("odom", "base_footprint"));
    assert_eq!(of.trajectory.stamped().count(), 517);
    assert!(old.frames.a_from_b("base_footprint", "base_link").is_some());
}
