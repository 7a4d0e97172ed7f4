//! The main job end to end, as a process: the demo agrees with itself, and says so plainly when something breaks.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use outrigger::recording::Session;
use serde_json::Value;

use crate::support::{Case, case};

pub const CASES: &[Case] = &[
    case("a_velodyne_rig_too", a_velodyne_rig_too),
    case(
        "a_cut_cable_keeps_the_session_and_the_next_demo_agrees",
        a_cut_cable_keeps_the_session_and_the_next_demo_agrees,
    ),
    case("a_dead_sensor_is_named_and_exit_code_is_3", a_dead_sensor_is_named_and_exit_code_is_3),
    case("files_of_others_are_left_alone", files_of_others_are_left_alone),
];

/// Fast enough for every part of the loop to take little time; too fast for dense coverage.
const HURRIED: &str = "8";
/// As the demo walks by default: a hundredth of a degree between encoder and shaft no longer shows in the cells.
const WALKING: &str = "2";

/// A short search and a walk at this speed, several times faster than life.
fn demo(out: &Path, speed: &str, more: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_outrigger"))
        .args(["demo", "--json", "--evals", "40", "--rate", "8", "--speed", speed, "--out"])
        .arg(out)
        .args(more)
        .output()
        .unwrap()
}

fn folder() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("demo");
    (folder, out)
}

fn agrees(output: &Output, out: &Path) {
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    let document: Value = crate::support::document(&output.stdout).unwrap();
    assert!(document["compare"]["agreement"]["iou"].as_f64().unwrap() >= 0.999, "{document:#}");
    assert_eq!(document["compare"]["verdict"], "matches");
    let coverage = &document["compare"]["coverage"];
    assert!(["planned", "as_driven", "recorded"].iter().all(|name| coverage[name].as_u64().unwrap() > 1000));
    for sensor in document["recording"].as_array().unwrap() {
        assert_eq!(
            (&sensor["packets_sent"], &sensor["lost"]),
            (&sensor["packets_recorded"], &Value::from(0))
        );
    }
    for axis in document["rig"].as_array().unwrap() {
        let [asked, measured] =
            ["target_pitch_deg", "measured_pitch_deg"].map(|name| axis[name].as_f64().unwrap());
        assert!(
            (asked - measured).abs() < 0.5 && asked != measured,
            "read back, not copied: {asked} {measured}"
        );
    }
    let written: Value = serde_json::from_slice(&std::fs::read(out.join("report.json")).unwrap()).unwrap();
    assert_eq!(written, document);
    let page = std::fs::read_to_string(out.join("report.html")).unwrap();
    for outside in ["http://", "https://", "src=", "<link", "@import"] {
        assert!(!page.contains(outside), "the page asks for something outside: {outside}");
    }
    assert!(Session::open(&out.join("session")).unwrap().problems().is_empty());
}

fn a_velodyne_rig_too() {
    let (_keep, out) = folder();
    agrees(&demo(&out, WALKING, &["--preset", "paper-vlp-16"]), &out);
}

fn a_cut_cable_keeps_the_session_and_the_next_demo_agrees() {
    let (_keep, out) = folder();
    let output = demo(&out, HURRIED, &["--fault", "cut-cable"]);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("rig cable") && said.contains("session"), "{said}");
    let session = Session::open(&out.join("session")).unwrap();
    let mut packets = session.packets().unwrap();
    let mut count = 0;
    while packets.next().unwrap().is_some() {
        count += 1;
    }
    assert!(count > 100, "{count} packets before the cut");
    assert!(!session.events::<Value>().unwrap().is_empty(), "the session says why it ended");
    // the next demo clears what this one left
    agrees(&demo(&out, WALKING, &[]), &out);
}

fn a_dead_sensor_is_named_and_exit_code_is_3() {
    let (_keep, out) = folder();
    let output = demo(&out, HURRIED, &["--fault", "kill-sensor"]);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(3), "{said}");
    assert!(said.contains("left sent no data"), "{said}");
    assert!(Session::open(&out.join("session")).is_ok());
}

fn files_of_others_are_left_alone() {
    let (_keep, out) = folder();
    std::fs::create_dir(&out).unwrap();
    std::fs::write(out.join("thesis.tex"), "years of work").unwrap();
    let output = demo(&out, HURRIED, &[]);
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stderr).contains("--out"));
    assert_eq!(std::fs::read_dir(&out).unwrap().count(), 1);
}
