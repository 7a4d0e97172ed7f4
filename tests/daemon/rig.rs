//! The rig behind the daemon: armed, moved, stopped, unplugged.

use std::os::unix::fs::symlink;

use outrigger::mock::rig::{MockConfig, MockRig};
use outrigger::recording::ServoReport;
use outrigger::rig::MountFile;
use serde_json::Value;

use super::faults::events_of;
use super::program::{Bench, Running};
use super::sensor::entry;

/// A bench whose mount has these pitches, and whose rig is found under `rig` in its folder.
fn bench(pitches_deg: [f64; 2]) -> Bench {
    let bench = Bench::new(
        &["left", "right"],
        "[rig]\nport = \"rig\"\nlimits_deg = [[-45, 45]]\ntimeout_s = 60\n[predict]\nmount = \"mount.json\"\n",
    );
    let sensors = vec![
        entry("left", "os1-16", [-0.1, 0.0], pitches_deg[0]),
        entry("right", "vlp-16", [0.1, 0.0], pitches_deg[1]),
    ];
    MountFile::new(sensors).write(&bench.path("mount.json")).unwrap();
    bench
}

fn plug(bench: &Bench, rig: &MockRig) {
    let name = bench.path("rig");
    let _ = std::fs::remove_file(&name); // the first time there is none
    symlink(rig.path(), name).unwrap();
}

fn axes(status: &Value) -> Vec<(f64, f64)> {
    let axes = status["rig"]["status"]["axes"].as_array().unwrap();
    axes.iter()
        .map(|axis| (axis["position_deg"].as_f64().unwrap(), axis["target_deg"].as_f64().unwrap()))
        .collect()
}

fn refused(daemon: &Running, path: &str, body: &str, words: &str) {
    let (code, answer) = daemon.post(path, body);
    assert_eq!(code, 409, "{path}: {answer}");
    assert!(answer["error"].as_str().unwrap().contains(words), "{answer}");
}

pub fn the_rig_moves_when_armed_and_stops_on_command() {
    let rig = MockRig::start(MockConfig::default(), 3).unwrap();
    let bench = bench([-20.0, 20.0]);
    plug(&bench, &rig);
    let daemon = bench.start(&["--record"]);
    daemon.wait("the rig is there", |status| status["rig"]["connected"] == true);
    assert!(daemon.wait_for_problem("not_homed").contains("not homed"));
    refused(&daemon, "/api/v1/rig/home", "", "arm it first");
    refused(&daemon, "/api/v1/rig/apply", "", "arm it first");
    daemon.order("/api/v1/rig/arm", "");
    refused(&daemon, "/api/v1/rig/apply", "", "not homed");
    daemon.order("/api/v1/rig/home", "");
    refused(&daemon, "/api/v1/rig/apply", "{\"pitches_deg\": [80, 0]}", "limits");
    let (code, answer) = daemon.post("/api/v1/rig/apply", "{\"pitches_deg\": [1]}");
    assert!(code == 400 && answer.to_string().contains("1 pitch for a rig with 2 axes"), "{code}: {answer}");
    daemon.order("/api/v1/rig/apply", "");
    daemon.wait("the mount's pitches", |status| {
        axes(status).iter().zip([-20.0, 20.0]).all(|((at, _), to)| (at - to).abs() < 0.5)
    });

    // a move is stopped on its way
    std::thread::scope(|scope| {
        let moving = scope.spawn(|| daemon.post("/api/v1/rig/apply", "{\"pitches_deg\": [30, -30]}"));
        daemon.wait("it moves", |status| status["rig"]["busy"] == "apply" && axes(status)[0].0 > -19.0);
        refused(&daemon, "/api/v1/rig/apply", "", "busy with `apply`");
        daemon.order("/api/v1/rig/e-stop", "");
        let (code, answer) = moving.join().unwrap();
        assert_eq!(code, 409, "{answer}");
    });
    assert!(daemon.wait_for_problem("e_stop").contains("latched"));
    assert!(
        axes(&daemon.status())[0].0 < 29.0,
        "it did not arrive: the stop did not wait for the end of the move"
    );
    let (code, answer) = daemon.post("/api/v1/rig/arm", "");
    assert_eq!(code, 409, "a latched stop keeps it from being armed");
    assert!(answer["error"].as_str().unwrap().contains("e_stop: take its cause away, clear the faults"));
    let told = |event: &'static str, words: &'static str| {
        daemon.wait(event, |status| {
            let mut events = status["events"].as_array().unwrap().iter();
            events.any(|told| told["event"] == event && told["words"].as_str().unwrap().contains(words))
        })
    };
    told("rig_fault", "fault e_stop is latched");
    told("rig_command_failed", "apply: rig: interrupted, emergency stop; axis 0 stands at ");
    daemon.order("/api/v1/rig/clear", "");
    daemon.order("/api/v1/rig/arm", "");
    daemon.order("/api/v1/rig/hold", "");
    assert!(daemon.wait_for_problem("off_mount").contains("the mount that is recorded says"));
    let metrics = daemon.get("/metrics").1;
    assert!(metrics.contains("outrigger_problem{about=\"rig\",kind=\"off_mount\"} "), "{metrics}");
    daemon.order("/api/v1/rig/disarm", "");
    daemon.wait("it is disarmed", |status| status["rig"]["status"]["armed"] == false);
    let (_, log) = daemon.end();
    let servo: Vec<Value> = bench.sessions()[0].servo().unwrap();
    assert!(
        servo.len() > 20 && servo.iter().any(|report| report["state"] == "moving"),
        "{}: {log}",
        servo.len()
    );
}

pub fn axes_turn_the_sensors_that_are_named_for_them() {
    let rig = MockRig::start(MockConfig::default(), 3).unwrap();
    let bench = bench([-20.0, 10.0]);
    let mut text = std::fs::read_to_string(bench.path("rig.toml")).unwrap();
    text += "[rig.apply]\nsensors = [\"right\", \"left\"]\n";
    std::fs::write(bench.path("rig.toml"), text).unwrap();
    plug(&bench, &rig);
    let daemon = bench.start(&["--record"]);
    daemon.wait("the rig is there", |status| status["rig"]["connected"] == true);
    ["arm", "home", "apply"].iter().for_each(|order| drop(daemon.order(&format!("/api/v1/rig/{order}"), "")));
    let status = daemon.status();
    assert!(
        axes(&status).iter().zip([10.0, -20.0]).all(|((at_deg, _), to_deg)| (at_deg - to_deg).abs() < 0.5),
        "{status}"
    );
    assert_eq!(daemon.end().0, Some(0));
    let mount = bench.sessions()[0].mount().unwrap().unwrap();
    assert_eq!(mount.sensors[0].name, "right", "a session's mounts are in the order of the axes");
}

pub fn a_sensor_without_a_slot_is_reported() {
    let bench = Bench::new(&["left", "right"], "[predict]\nmount = \"mount.json\"\n");
    let sensors =
        vec![entry("left", "os1-16", [-0.1, 0.0], -20.0), entry("mirrored", "vlp-16", [0.1, 0.0], 20.0)];
    MountFile::new(sensors).write(&bench.path("mount.json")).unwrap();
    let daemon = bench.start(&[]);
    assert!(daemon.wait_for_problem("unseated").contains("where \"right\" sits; it names left, mirrored"));
    let status = daemon.status();
    let unseated = |event: &&Value| event["event"] == "unseated";
    let told: Vec<&Value> = status["events"].as_array().unwrap().iter().filter(unseated).collect();
    assert!(told.len() == 1 && told[0]["sensor"] == "right", "{told:?}");
    assert_eq!(daemon.end().0, Some(0));
}

/// Encoders that count from where they were switched on: homed while it records.
pub fn a_rig_that_is_not_homed_is_recorded_as_such() {
    let rig = MockRig::start(MockConfig::default().with_home_switches(-300_000), 6).unwrap();
    let bench = bench([-20.0, 20.0]);
    plug(&bench, &rig);
    let daemon = bench.start(&["--record"]);
    let are = |source: &str, status: &Value| {
        let axes = status["rig"]["status"]["axes"].as_array();
        axes.is_some_and(|axes| axes.len() == 2 && axes.iter().all(|axis| axis["source"] == source))
    };
    let status = daemon.wait("no axis has a zero", |status| are("not_homed", status));
    let axis = &status["rig"]["status"]["axes"][0];
    assert!(axis["uncertainty_deg"].is_null() && axis["homed"] == false, "{axis:#}");
    assert!(daemon.wait_for_problem("not_homed").contains("no zero"));
    daemon.order("/api/v1/rig/arm", "");
    daemon.order("/api/v1/rig/home", "");
    daemon.wait("both axes are homed", |status| are("measured", status));
    std::thread::sleep(std::time::Duration::from_millis(300));
    let (code, said) = daemon.end();
    assert_eq!(code, Some(0), "{said}");
    let session = &bench.sessions()[0];
    let reports: Vec<ServoReport> = session.servo().unwrap();
    for axis in 0..2 {
        let own: Vec<&ServoReport> = reports.iter().filter(|report| report.axis == axis).collect();
        let homed = own.iter().position(|report| report.source == "measured").unwrap();
        let (before, after) = own.split_at(homed);
        assert!(
            !before.is_empty() && before.iter().all(|report| report.source == "not_homed"),
            "axis {axis}"
        );
        assert!(before.iter().all(|report| report.uncertainty_urad.is_none()), "axis {axis}");
        assert!(
            after.iter().all(|report| report.source == "measured" && report.homed == Some(true)),
            "axis {axis}"
        );
    }
    let events = events_of(&bench);
    for event in ["axis_not_homed", "axis_homed"] {
        assert_eq!(events.iter().filter(|line| line.as_str() == event).count(), 2, "{event}: {events:?}");
    }
}

pub fn the_rig_is_unplugged_and_comes_back() {
    let first = MockRig::start(MockConfig::default(), 3).unwrap();
    let bench = bench([-20.0, 20.0]);
    let mut mount = MountFile::read(&bench.path("mount.json")).unwrap();
    mount.sensors.push(entry("behind", "vlp-16", [0.0, -0.2], 0.0));
    mount.write(&bench.path("mount.json")).unwrap();
    let daemon = bench.start(&[]);
    assert!(daemon.wait_for_problem("rig_lost").contains("cannot open"));
    plug(&bench, &first);
    let status = daemon.wait("the rig is there", |status| status["rig"]["connected"] == true);
    let named = |event: &&Value| event["event"] == "rig_lost";
    let lost: Vec<&Value> = status["events"].as_array().unwrap().iter().filter(named).collect();
    assert_eq!(lost.len(), 1, "however often it was tried: {lost:?}");
    daemon.order("/api/v1/rig/arm", "");
    first.close();
    assert!(daemon.wait_for_problem("rig_lost").contains("hung up"));
    let (code, answer) = daemon.post("/api/v1/rig/e-stop", "");
    assert_eq!(code, 503, "{answer}");
    let ages_ms = |status: &Value| {
        let rig = &status["rig"];
        let axes = rig["status"]["axes"].as_array().unwrap().iter();
        axes.map(|axis| &axis["age_ms"]).chain([&rig["age_ms"]]).map(|age| age.as_f64().unwrap()).collect()
    };
    let before_ms: Vec<f64> = ages_ms(&daemon.status());
    daemon.wait("what the rig said last grows old", |status| {
        let now_ms: Vec<f64> = ages_ms(status);
        now_ms.iter().zip(&before_ms).all(|(now_ms, before_ms)| *now_ms > before_ms + 1000.0)
    });
    assert!(daemon.get("/metrics").1.contains("outrigger_rig_age_seconds{axis=\"1\"} "));
    assert_eq!(daemon.status()["rig"]["status"]["armed"], false);
    let second = MockRig::start(MockConfig::default(), 3).unwrap();
    plug(&bench, &second);
    let status = daemon.wait("it is back", |status| status["rig"]["connected"] == true);
    assert_eq!(status["rig"]["status"]["armed"], false, "it comes back disarmed");
    let events = status["events"].as_array().unwrap();
    let place = |name: &str| events.iter().position(|event| event["event"] == name).unwrap();
    assert!(place("rig_lost") < place("rig_back"));
    let told: Vec<&Value> = events.iter().filter(|event| event["event"] == "mount_of_others").collect();
    assert!(
        told.len() == 1 && told[0].to_string().contains("names 3 sensors, the rig has 2 axes"),
        "{told:?}"
    );
    assert_eq!(daemon.end().0, Some(0));
}
