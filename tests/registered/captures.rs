//! Other people's recordings in the world's frame.

use std::collections::HashMap;

use glam::DVec3;
use nalgebra::{Matrix3, SymmetricEigen, Vector3};
use outrigger::base::geometry::Pose;
use outrigger::world::trajectory::Trajectory;
use serde_json::Value;

use super::{ran, rows, run, stderr};
use crate::support::shared;

const OS1: &str = "captures/ouster/OS-1-128_v2.3.0_1024x10_lb_n3";
const OS1_META: &str = "captures/ouster/OS-1-128_v2.3.0_1024x10.json";

/// Median distance of points from the planes fitted to them, in cells of a metre; mm.
fn thickness_mm(points_m: impl Iterator<Item = DVec3>) -> (f64, usize) {
    let mut cells: HashMap<[i32; 3], Vec<DVec3>> = HashMap::new();
    for at_m in points_m {
        cells.entry(at_m.floor().to_array().map(|value| value as i32)).or_default().push(at_m);
    }
    let mut thick_mm = Vec::new();
    for points_m in cells.values().filter(|points_m| points_m.len() >= 60) {
        let mean_m = points_m.iter().sum::<DVec3>() / points_m.len() as f64;
        let mut spread = Matrix3::zeros();
        for at_m in points_m {
            let off = Vector3::from((*at_m - mean_m).to_array());
            spread += off * off.transpose() / points_m.len() as f64;
        }
        let mut values: Vec<f64> = SymmetricEigen::new(spread).eigenvalues.iter().copied().collect();
        values.sort_by(f64::total_cmp);
        if values[0] < 0.04 * values[1] {
            thick_mm.push(values[0].max(0.0).sqrt() * 1e3);
        }
    }
    thick_mm.sort_by(f64::total_cmp);
    (thick_mm[thick_mm.len() / 2], thick_mm.len())
}

/// A vehicle at 2.5 m/s with the poses that came with its recording.
pub fn planes_are_thinner() {
    let folder = tempfile::tempdir().unwrap();
    let capture = shared(&format!("{OS1}.pcap"));
    let metadata = shared(OS1_META);
    let kitti = shared(&format!("{OS1}_poses_kitti.txt"));
    let [capture, metadata, poses] = [&capture, &metadata, &kitti].map(|path| path.to_str().unwrap());
    let out = folder.path().join("cloud.npy");
    let decode = |more: &[&str]| {
        let base = [
            "decode",
            capture,
            "--meta",
            metadata,
            "--force",
            "--range",
            "1..30",
            "-o",
            out.to_str().unwrap(),
        ];
        let (_, words) = ran(0, &[&base[..], more].concat());
        (rows(&out), words)
    };
    let (plain, _) = decode(&[]);
    let (world, words) = decode(&["--frame", "world", "--trajectory", poses]);
    assert!(words.contains("used for the middle of its revolution, 3 of 3"), "{words}");
    assert_eq!(world.len(), plain.len());
    // one pose for each revolution
    let begun: Vec<u64> = {
        let (document, _) = ran(0, &["decode", capture, "--meta", metadata]);
        let frames = document["sensors"][0]["frames"].as_array().unwrap();
        frames.iter().map(|frame| frame["first_time_ns"].as_u64().unwrap()).collect()
    };
    let given = Trajectory::read(&std::fs::read(&kitti).unwrap(), Some(10.0)).unwrap().trajectory;
    let given: Vec<Pose> = given.stamped().map(|(_, pose)| pose).collect();
    let frozen = plain.iter().map(|row| {
        let number = begun.partition_point(|at| *at <= row.time_ns) - 1;
        given[number].transform_point(row.at_m)
    });
    let (frozen_mm, _) = thickness_mm(frozen);
    let (world_mm, planes) = thickness_mm(world.iter().map(|row| row.at_m));
    let (found, _) = decode(&["--frame", "world", "--trajectory", "odometry"]);
    let (found_mm, _) = thickness_mm(found.iter().map(|row| row.at_m));
    println!(
        "median thickness of {planes} planes: {world_mm:.2} mm (by odometry {found_mm:.2} mm), with one pose per revolution \
         {frozen_mm:.2} mm"
    );
    assert!(
        planes > 100 && world_mm < frozen_mm && found_mm < 0.9 * frozen_mm,
        "{world_mm} {found_mm} {frozen_mm}"
    );
}

pub fn revolutions_are_cut_whole() {
    let folder = tempfile::tempdir().unwrap();
    let part = folder.path().join("part.pcap");
    let part = part.to_str().unwrap();
    let metadata = shared(OS1_META);
    let cases = [
        (format!("{OS1}.pcap"), Some(metadata.to_str().unwrap())),
        ("captures/velodyne/nebula_vlp16.pcap".into(), None),
    ];
    for (capture, metadata) in cases {
        let capture = shared(&capture);
        let meta: Vec<&str> = metadata.iter().flat_map(|meta| ["--meta", *meta]).collect();
        let frames = |path: &str| {
            let (document, _) = ran(0, &[&["decode", path][..], &meta].concat());
            document["sensors"][0]["frames"].as_array().unwrap().clone()
        };
        let all = frames(capture.to_str().unwrap());
        let cut = ["cut", capture.to_str().unwrap(), "--from", "1f", "--to", "2f", "--force", "-o", part];
        ran(0, &[&cut[..], &meta].concat());
        let found = frames(part);
        // the last firings of a Velodyne's revolution lie by those that follow, of which a part is gone
        let same = |frame: &&Value| {
            ["points", "range_sum_mm", "first_time_ns", "last_time_ns"]
                .iter()
                .all(|field| frame[*field] == all[1][*field])
        };
        assert!(found.iter().any(|frame| same(&frame)), "{found:#?} {:#}", all[1]);
    }
    let output = run(&[
        "cut",
        shared(&format!("{OS1}.pcap")).to_str().unwrap(),
        "--meta",
        metadata.to_str().unwrap(),
        "--from",
        "9f",
        "--force",
        "-o",
        part,
    ]);
    assert!(stderr(&output).contains("has fewer revolutions, counted from 0: 3"), "{}", stderr(&output));
}

pub fn topics_of_poses_are_trajectories() {
    let folder = tempfile::tempdir().unwrap();
    let name = |name: &str| shared(&format!("captures/bags/{name}")).to_str().unwrap().to_owned();
    let [out, again] = ["a.npy", "b.npy"].map(|name| folder.path().join(name));
    let room = name("backpack_room.mcap");
    ran(0, &["decode", &room, "--frame", "world", "-o", out.to_str().unwrap()]);
    let topic = format!("{room}:/odom");
    let (_, words) =
        ran(0, &["decode", &room, "--frame", "world", "--trajectory", &topic, "-o", again.to_str().unwrap()]);
    assert!(words.contains("trajectory of /odom (base_link in odom)"), "{words}");
    assert!(std::fs::read(&out).unwrap() == std::fs::read(&again).unwrap());
    // a prediction along a robot's recorded odometry
    let turtlebot = format!("{}:/odom", name("real/evo_nav2_turtlebot.mcap"));
    let arguments = [
        "predict",
        "--room=-20,-20,-1,20,20,4",
        "--mounts",
        "0,0,0.5,0,0",
        "--sensors",
        "vlp-16",
        "--trajectory",
        &turtlebot,
    ];
    let output = run(&[&arguments[..], &["--json"]].concat());
    assert!(stderr(&output).contains("trajectory of /odom (base_link in odom)"), "{}", stderr(&output));
    let output = run(&["decode", &room, "--frame", "world", "--trajectory", &format!("{room}:/none")]);
    assert!(
        stderr(&output).contains("no trajectory on /none; expected nav_msgs/Odometry"),
        "{}",
        stderr(&output)
    );
}
