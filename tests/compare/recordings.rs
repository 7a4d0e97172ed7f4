//! Real recordings against maps of themselves. Nothing here is tuned to them: the thresholds are below what was measured
//! once by as much as another compiler may change it.

use std::process::Command;

use outrigger::rig::{MountFile, SensorEntry};
use outrigger::world::trajectory::Trajectory;
use serde_json::Value;

use crate::support::shared;

fn compare(capture: &str, model: &str, more: &[&str]) -> Value {
    let folder = tempfile::tempdir().unwrap();
    let mount = folder.path().join("mount.json");
    let entry = SensorEntry {
        name: "only".into(),
        model: model.into(),
        x_m: 0.0,
        y_m: 0.0,
        z_m: 0.0,
        pitch_deg: 0.0,
        ..SensorEntry::default()
    };
    MountFile::new(vec![entry]).write(&mount).unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_outrigger"))
        .arg("compare")
        .arg(shared(capture))
        .args(["--json", "--nulls", "0", "--mount"])
        .arg(&mount)
        .args(more)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    crate::support::document(&output.stdout).unwrap_or_else(|_| panic!("{said}"))
}

/// Shares of the rays that were recorded.
fn shares(document: &Value) -> [f64; 4] {
    let rays = &document["rays"]["only"];
    let count = |name: &str| rays[name].as_f64().unwrap();
    let recorded = count("agree") + count("short") + count("long") + count("extra");
    ["agree", "short", "long", "extra"].map(|name| count(name) / recorded)
}

pub fn two_frames_predict_the_third() {
    let folder = "captures/ouster";
    let metadata = shared(&format!("{folder}/OS-1-128_v2.3.0_1024x10.json"));
    let poses = shared(&format!("{folder}/OS-1-128_v2.3.0_1024x10_lb_n3_poses_kitti.txt"));
    let document = compare(
        &format!("{folder}/OS-1-128_v2.3.0_1024x10_lb_n3.pcap"),
        "os1-128",
        &[
            "--map-frames",
            "0..2",
            "--rate",
            "10",
            "--meta",
            metadata.to_str().unwrap(),
            "--trajectory",
            poses.to_str().unwrap(),
        ],
    );
    let [agree, short, long, extra] = shares(&document);
    // measured: 0.868 agree, 0.015 short, 0.067 long, 0.051 extra
    assert!(agree > 0.84, "agree {agree:.3} short {short:.3} long {long:.3} extra {extra:.3}");
    assert!(document["mount"][0]["tilt_error_deg"].is_null());
}

/// The way that the recording itself tells against the poses that came with it, and used instead of them.
pub fn odometry_agrees_with_the_poses() {
    let folder = "captures/ouster";
    let capture = format!("{folder}/OS-1-128_v2.3.0_1024x10_lb_n3");
    let metadata = shared(&format!("{folder}/OS-1-128_v2.3.0_1024x10.json"));
    let metadata = metadata.to_str().unwrap();
    let scratch = tempfile::tempdir().unwrap();
    let kitti = scratch.path().join("found.txt");
    let output = Command::new(env!("CARGO_BIN_EXE_outrigger"))
        .arg("odometry")
        .arg(shared(&format!("{capture}.pcap")))
        .args(["--meta", metadata, "--kitti", kitti.to_str().unwrap()])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let read = |path: &std::path::Path| {
        Trajectory::read(&std::fs::read(path).unwrap(), Some(10.0)).unwrap().trajectory
    };
    let [found, given] = [read(&kitti), read(&shared(&format!("{capture}_poses_kitti.txt")))];
    // theirs count from the middle of the first revolution
    let start = found.stamped().next().unwrap().1.inverse();
    for ((_, found), (_, given)) in found.stamped().map(|(at, pose)| (at, start * pose)).zip(given.stamped())
    {
        let off_m = found.translation_m.distance(given.translation_m);
        let off_deg = found.rotation.angle_between(given.rotation).to_degrees();
        // measured: 0.025 m after the first revolution and 0.024 m after the second, of 0.498 m
        assert!(off_m < 0.035 && off_deg < 0.25, "{off_m:.4} m {off_deg:.3} deg");
    }
    let own = ["--map-frames", "0..2", "--meta", metadata, "--trajectory", "odometry"];
    let document = compare(&format!("{capture}.pcap"), "os1-128", &own);
    let [agree, short, long, extra] = shares(&document);
    // measured: 0.870 agree, 0.017 short, 0.054 long, 0.059 extra
    assert!(agree > 0.84, "agree {agree:.3} short {short:.3} long {long:.3} extra {extra:.3}");
}

pub fn a_still_velodyne_agrees_with_its_own_map() {
    for capture in ["mrpt_vlp16_gps", "nebula_vlp16"] {
        let document = compare(
            &format!("captures/velodyne/{capture}.pcap"),
            "vlp-16",
            &["--map-frames", "0..2", "--trajectory", "still"],
        );
        let [agree, short, long, extra] = shares(&document);
        // the lowest beam never returns and the next one hardly: what it looks at is dark, it is no dead channel
        // half of the beams return, and of those that the map promises many pass the edge of a cell: the map cannot tell
        assert_eq!(document["verdict"], "cannot_tell", "{}", document["reason"]);
        assert_eq!(document["reason"]["code"], "map_too_coarse", "{}", document["reason"]);
        // measured: 0.9998 and 0.9997 agree
        assert!(
            agree > 0.995 && short < 0.001,
            "{capture}: agree {agree:.3} short {short:.3} long {long:.3} extra {extra:.3}"
        );
    }
}

/// Metadata of 2019 state no product: by its beams it is the mount file's OS1-64.
pub fn an_ouster_without_a_product_is_known_by_its_beams() {
    let metadata = shared("captures/ouster/ouster_example.json");
    let more = ["--map-frames", "0..2", "--trajectory", "still", "--meta", metadata.to_str().unwrap()];
    let document = compare("captures/ouster/ouster_example.pcap", "os1-64", &more);
    assert_ne!(document["reason"]["code"], "wrong_model", "{}", document["reason"]);
}
