//! What goes into a session comes out of it.

use std::collections::BTreeMap;
use std::path::Path;

use glam::DVec3;
use outrigger::live::receive::{Listen, Options, Receiver};
use outrigger::mock::transmit::{Clock, Pace, Transmitter};
use outrigger::recording::{LiveRecording, Manifest, SensorInfo, Session, SessionWriter, file};
use outrigger::rig::{MountFile, SensorEntry};
use outrigger::world::trajectory::Trajectory;

use super::{any_port, payloads};

/// Records what two senders send at the same time, as fast as the recorder takes it.
pub fn record_two(dir: &Path, streams: [&[Vec<u8>]; 2]) -> Manifest {
    let listens =
        ["left", "right"].map(|name| Listen { name: name.into(), address: any_port(), source: None });
    let receiver = Receiver::start(&listens, Options::default()).unwrap();
    let addresses = [0, 1].map(|sensor| receiver.address(sensor));
    let infos = [0, 1].map(|sensor| SensorInfo::of(&listens[sensor], addresses[sensor], None));
    let recording = LiveRecording::start(receiver, SessionWriter::create(dir, &infos).unwrap()).unwrap();
    std::thread::scope(|scope| {
        for (stream, to) in streams.into_iter().zip(addresses) {
            scope.spawn(move || {
                let mut transmitter = Transmitter::new(None, to, Clock::new(Pace::Max, None)).unwrap();
                for payload in stream {
                    transmitter.send(0, payload, to).unwrap();
                }
            });
        }
    });
    recording.stop().unwrap()
}

/// Payloads of each sensor in the order of the session.
pub fn packets_of(session: &Session) -> BTreeMap<usize, Vec<Vec<u8>>> {
    let mut found: BTreeMap<usize, Vec<Vec<u8>>> = BTreeMap::new();
    let mut packets = session.packets().unwrap();
    while let Some((sensor, packet)) = packets.next().unwrap() {
        found.entry(sensor).or_default().push(packet.payload.to_vec());
    }
    found
}

pub fn every_byte_sent_is_in_the_session() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path().join("walk");
    let (left, right) = (payloads(600, 1), payloads(600, 2));
    let manifest = record_two(&dir, [&left, &right]);
    assert!(manifest.complete && manifest.losses.total() == 0, "{manifest:?}");
    assert_eq!(manifest.sensors.iter().map(|sensor| sensor.packets).collect::<Vec<_>>(), [600, 600]);
    let session = Session::open(&dir).unwrap();
    assert_eq!(session.problems(), [""; 0]);
    assert_eq!(session.manifest(), &manifest);
    let found = packets_of(&session);
    assert!(found[&0] == left && found[&1] == right);
    assert!(!dir.join(".reserve").exists());
    let mut packets = session.packets().unwrap();
    let mut last_ns = manifest.created_ns - 1_000_000_000;
    while let Some((sensor, packet)) = packets.next().unwrap() {
        assert_eq!(Some(packet.destination), session.manifest().sensors[sensor].address);
        // two sockets are read in turn: order of arrival holds within a batch of each
        assert!(packet.host_time_ns + 1_000_000_000 > last_ns);
        last_ns = packet.host_time_ns;
    }
}

pub fn servo_reports_and_events_come_back() {
    let folder = tempfile::tempdir().unwrap();
    let info =
        SensorInfo { name: "left".into(), metadata: Some("{\"a\":1}".into()), ..SensorInfo::default() };
    let writer = SessionWriter::create(folder.path(), &[info]).unwrap();
    let path = Trajectory::straight(DVec3::ZERO, DVec3::X, 1.3, 1_763_722_223_000_000_001);
    let mount = MountFile::new(vec![SensorEntry {
        name: "left".into(),
        model: "os1-64".into(),
        x_m: 0.1,
        y_m: 0.0,
        z_m: 0.3,
        pitch_deg: 20.0,
        ..SensorEntry::default()
    }]);
    writer.put_trajectory(&path).unwrap();
    writer.put_mount(&mount, &[]).unwrap();
    for number in 0..3 {
        writer
            .write_servo(&serde_json::json!({"axis": "left", "position_deg": 20.0 + f64::from(number)}))
            .unwrap();
    }
    writer.write_event(&serde_json::json!({"time_ns": 5, "event": "begun"})).unwrap();
    writer.close(None).unwrap();
    assert!(writer.write_event(&1).unwrap_err().to_string().contains("closed"));
    let session = Session::open(folder.path()).unwrap();
    assert_eq!(session.problems(), [""; 0]);
    assert_eq!(session.trajectory().unwrap().unwrap().trajectory, path);
    // one that was put there later is read as any other
    let own = folder.path().join(file::TRAJECTORY);
    std::fs::write(&own, "\u{feff}# SLAM\r\n5,0,0,1,0,0,0,1\r\n5,0,0,1,0,0,0,1\r\n6,1,0,1,0,0,0,1\r\n")
        .unwrap();
    let read = session.trajectory().unwrap().unwrap();
    assert_eq!((read.trajectory.time_span_ns(), read.notes.len()), ([5_000_000_000, 6_000_000_000], 1));
    assert!(
        read.notes[0].starts_with(&format!("{}: 1 pose with the time", own.display())),
        "{:?}",
        read.notes
    );
    assert_eq!(session.mount().unwrap().unwrap(), mount);
    assert_eq!(session.metadata("left").unwrap().as_deref(), Some("{\"a\":1}"));
    assert_eq!(session.metadata("right").unwrap(), None);
    let servo: Vec<serde_json::Value> = session.servo().unwrap();
    assert_eq!(servo.iter().map(|line| line["position_deg"].as_f64().unwrap()).sum::<f64>(), 63.0);
    assert_eq!(session.events::<serde_json::Value>().unwrap()[0]["event"], "begun");
    assert!(packets_of(&session).is_empty());
}

pub fn a_session_needs_a_folder_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("notes.txt"), "mine").unwrap();
    let error = SessionWriter::create(folder.path(), &[]).unwrap_err().to_string();
    assert!(error.contains("not empty") && error.contains(&folder.path().display().to_string()), "{error}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "nothing was touched");
    assert!(Session::open(folder.path()).unwrap_err().to_string().contains("no manifest.json"));
    for name in ["", "a/b", "..", "a b"] {
        let info = SensorInfo { name: name.into(), ..SensorInfo::default() };
        let error = SessionWriter::create(&folder.path().join("new"), &[info]).unwrap_err().to_string();
        assert!(error.contains(&format!("{name:?}")), "{error}");
    }
}

pub fn a_changed_file_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let writer = SessionWriter::create(folder.path(), &[]).unwrap();
    writer.write_servo(&1).unwrap();
    writer.write_event(&"a").unwrap();
    writer.close(None).unwrap();
    std::fs::write(folder.path().join(file::SERVO), "2\n").unwrap();
    std::fs::write(folder.path().join(file::EVENTS), "\"ab\"\n").unwrap();
    let session = Session::open(folder.path()).unwrap();
    let problems = session.problems().join("; ");
    assert!(problems.contains("servo.jsonl: content differs"), "{problems}");
    assert!(problems.contains("events.jsonl: 5 bytes, the manifest says 4"), "{problems}");
}
