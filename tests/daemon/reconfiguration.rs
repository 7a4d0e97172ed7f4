//! Better pitches while recording: proposed, refused, agreed to; and what is said where no pose is known.

use outrigger::mock::rig::{MockConfig, MockRig};
use outrigger::mock::sensor::MockSensor;
use outrigger::rig::{Mount, MountFile};
use sensors::velodyne::{Product, ReturnMode};
use serde_json::Value;

use super::program::{Bench, Running, has_problem};
use super::sensor::{ROOM, SERIAL, Sending, entry, metadata};

/// Both sensors lean to the same side: two that see nearly the same.
const PITCH_DEG: f64 = 25.0;

fn refused(daemon: &Running, path: &str, body: &str, words: &str) {
    let (code, answer) = daemon.post(&format!("/api/v1/reconfiguration/{path}"), body);
    assert_eq!(code, 409, "{path}: {answer}");
    assert!(answer["error"].as_str().unwrap().contains(words), "{answer}");
}

fn numbers(list: &Value) -> Vec<f64> {
    list.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
}

pub fn better_pitches_are_proposed_and_driven_to_when_agreed() {
    let rig = MockRig::start(MockConfig::default(), 3).unwrap();
    let sections = format!(
        "[rig]\nport = \"{}\"\nlimits_deg = [[-45, 45]]\ntimeout_s = 60\n[predict]\nmount = \"mount.json\"\nroom = \"{ROOM}\"\n",
        rig.path().display()
    );
    let bench = Bench::new(&["left", "right"], &sections);
    MountFile::new(vec![
        entry("left", "os1-16", [-0.3, 0.0], PITCH_DEG),
        entry("right", "vlp-16", [0.3, 0.0], PITCH_DEG),
    ])
    .write(&bench.path("mount.json"))
    .unwrap();
    let daemon = bench.start(&[]);
    daemon.wait("the rig is there", |status| status["rig"]["connected"] == true);
    refused(&daemon, "propose", "", "not recording");
    let mount = |x_m: f64| Mount { x_m, pitch_rad: PITCH_DEG.to_radians(), ..Mount::default() };
    let left =
        Sending::start(MockSensor::ouster(metadata(SERIAL, 1)), daemon.sensor(0), mount(-0.3), 0, None);
    let right = MockSensor::velodyne(Product::Vlp16, ReturnMode::Strongest, 10.0).unwrap();
    let right = Sending::start(right, daemon.sensor(1), mount(0.3), 0, None);
    daemon.order("/api/v1/recording/start", "{\"label\": \"a walk\"}");
    refused(&daemon, "propose", "", "home the rig first");
    daemon.order("/api/v1/rig/arm", "");
    daemon.order("/api/v1/rig/home", "");
    daemon.order("/api/v1/rig/apply", "");
    // what was mapped on the way there was placed by the angles on the way; a new recording begins a new map
    daemon.order("/api/v1/recording/stop", "");
    daemon.order("/api/v1/recording/start", "{\"label\": \"a walk\"}");
    let begun = daemon.status()["sensors"][0]["frames"].as_u64().unwrap();
    daemon.wait("both have looked around", |status| {
        status["sensors"]
            .as_array()
            .unwrap()
            .iter()
            .all(|sensor| sensor["frames"].as_u64() > Some(begun + 15))
            && status["memory"]["map"].as_u64() > Some(100_000)
    });
    let proposal = daemon.order("/api/v1/reconfiguration/propose", "");
    assert_eq!((&proposal["is_better"], &proposal["pose"]), (&true.into(), &"standing".into()), "{proposal}");
    let pitches_deg = numbers(&proposal["pitches_deg"]);
    assert!(pitches_deg.iter().all(|pitch_deg| pitch_deg.abs() <= 45.0), "{proposal}");
    let sum = |outlook: &Value| outlook["surface"].as_u64().unwrap() + outlook["frontier"].as_u64().unwrap();
    assert!(sum(&proposal["proposed"]) > sum(&proposal["now"]), "{proposal}");
    let status = daemon
        .wait("the page has it", |status| status["reconfiguration"]["proposal"]["id"] == proposal["id"]);
    assert_eq!(status["rig"]["busy"], Value::Null, "nothing has moved");

    refused(&daemon, "agree", "{\"id\": 77}", "not the newest");
    let agree = format!("{{\"id\": {}}}", proposal["id"]);
    daemon.order("/api/v1/rig/disarm", "");
    daemon.wait("it is disarmed", |status| status["rig"]["status"]["armed"] == false);
    refused(&daemon, "agree", &agree, "arm it first");
    assert_eq!(daemon.status()["recorder"]["part"], 1, "a refusal splits nothing");
    daemon.order("/api/v1/rig/arm", "");
    daemon.order("/api/v1/rig/apply", "{\"pitches_deg\": [20, 25]}");
    refused(&daemon, "agree", &agree, "has moved since");
    daemon.order("/api/v1/rig/apply", "");
    daemon.order("/api/v1/reconfiguration/agree", &agree);
    let status = daemon.wait("a new session", |status| status["recorder"]["part"] == 2);
    for (axis, pitch_deg) in status["rig"]["status"]["axes"].as_array().unwrap().iter().zip(&pitches_deg) {
        assert!((axis["position_deg"].as_f64().unwrap() - pitch_deg).abs() < 0.5, "{axis} for {pitch_deg}");
    }
    assert_eq!(status["recorder"]["last"]["why"], "reconfigured");
    refused(&daemon, "agree", &agree, "not the newest");
    daemon.wait("what the prediction is for is said", |status| {
        status["coverage"]["about"].as_str().unwrap().contains("the rig stands at others")
    });
    drop((left, right));
    let (code, log) = daemon.end();
    assert_eq!(code, Some(0), "{log}");

    let sessions = bench.sessions();
    assert_eq!(sessions.len(), 3);
    let [before, after] = [&sessions[1], &sessions[2]];
    assert!(before.problems().is_empty() && after.problems().is_empty());
    let pitches = |session: &outrigger::recording::Session| -> Vec<f64> {
        session.mount().unwrap().unwrap().sensors.iter().map(|sensor| sensor.pitch_deg).collect()
    };
    assert_eq!((pitches(before), pitches(after)), (vec![PITCH_DEG; 2], pitches_deg));
    let events: Vec<Value> = after.events().unwrap();
    assert_eq!(events[0]["follows"], before.dir().file_name().unwrap().to_str().unwrap());
    assert!(events.iter().any(|event| event["event"] == "reconfigured"), "{events:?}");
}

pub fn points_without_a_pose_are_named() {
    let bench = Bench::new(&["left"], "[predict]\ntrajectory = \"way.tum\"\n");
    // a walk of long ago
    std::fs::write(bench.path("way.tum"), "1000 0 0 0 0 0 0 1\n1100 5 0 0 0 0 0 1\n").unwrap();
    let daemon = bench.start(&["--record"]);
    let sensor = Sending::ouster(daemon.sensor(0));
    let said = daemon.wait_for_problem("no_pose");
    assert!(said.contains("does not say where the platform was"), "{said}");
    let coverage = daemon.status()["coverage"].clone();
    assert_eq!((&coverage["seen"], &coverage["pose"]), (&0.into(), &"trajectory".into()));
    assert!(coverage["about"].as_str().unwrap().contains("does not cover"), "{coverage}");
    drop(sensor);
    assert_eq!(daemon.end().0, Some(0), "all of it is recorded");

    let bench = Bench::new(&["left"], "");
    let daemon = bench.start(&["--record"]);
    let sensor = Sending::ouster(daemon.sensor(0));
    let status = daemon.wait("something is seen", |status| status["coverage"]["seen"].as_u64() > Some(100));
    assert!(status["coverage"]["about"].as_str().unwrap().contains("not known"), "{}", status["coverage"]);
    assert!(!has_problem(&status, "no_pose"), "a platform may well stand");
    drop(sensor);
    assert_eq!(daemon.end().0, Some(0));
}
