//! Sessions during which the host's clock is set, and whose rig moves: packets and readings are on one clock.

use std::net::SocketAddr;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use glam::DVec3;
use outrigger::base::geometry::Pose;
use outrigger::live::clocks::host::HostTime;
use outrigger::mock::sensor::{MockSensor, Surroundings};
use outrigger::recording::ServoReport;
use outrigger::recording::{ClockSource, SensorInfo, Session, SessionWriter, file};
use outrigger::rig::{Mount, MountFile, SensorEntry};
use outrigger::world::scene::{BoxScene, Scene};
use outrigger::world::trajectory::Trajectory;
use sensors::Packet;
use sensors::capture::PcapWriter;
use sensors::ouster::{Metadata, Profile, Synthetic};
use serde_json::Value;

const START_NS: u64 = 1_763_722_223_000_000_000;
const BOOT_NS: u64 = 40_000_000_000;
const MS: u64 = 1_000_000;
const DAY_NS: i64 = 86_400_000_000_000;
const END_MS: u64 = 3_000;
/// The clock is set here.
const SET_MS: u64 = 1_250;
const ROOM: &str = "--room=-4,-3,-1.4,5,3.5,1.6";

/// The axis goes from -12 degrees to 8 until half the time, and stands.
fn pitch_deg(time_ns: u64) -> f64 {
    let seconds = (time_ns as f64 - START_NS as f64) * 1e-9;
    (-12.0 + 20.0 * seconds / 1.5).min(8.0)
}

fn metadata() -> Metadata {
    let wanted = Synthetic::new("os1-16", 122_000_000_001, Profile::Rng19Rfl8Sig16Nir16);
    Metadata::synthetic(&wanted.columns(512, 16)).unwrap()
}

/// Hands every packet of a sensor on a moving axis over with its time.
fn measure(start_ns: u64, end_ns: u64, take: &mut dyn FnMut(u64, &[u8])) {
    let scene = Scene::Box(BoxScene::closed(DVec3::new(-4.0, -3.0, -1.4), DVec3::new(5.0, 3.5, 1.6)));
    let stands = Trajectory::new(vec![(start_ns, Pose::IDENTITY), (end_ns, Pose::IDENTITY)]).unwrap();
    let surroundings = Surroundings {
        scene: &scene,
        trajectory: &stands,
        body_from_sensor: &|time_ns| {
            let pitch_rad = pitch_deg(time_ns).to_radians();
            Mount { z_m: 0.1, pitch_rad, ..Mount::default() }.body_from_sensor()
        },
        noise_m: 0.005,
        seed: 3,
    };
    let outcome = MockSensor::ouster(metadata()).run(&surroundings, |time_ns, payload| {
        take(time_ns, payload);
        Ok::<(), ()>(())
    });
    outcome.unwrap();
}

/// A host whose clock is set forward by `step_ns` while it records; `link_ns` is by how much the clock of the rig's line was
/// behind it before.
fn record(path: &Path, step_ns: i64, link_ns: u64, is_old: bool) {
    let unix_ns = move |at_ns: u64| {
        let is_set = at_ns >= START_NS + SET_MS * MS;
        at_ns.saturating_add_signed(if is_set { step_ns } else { 0 })
    };
    let now_ns = Arc::new(AtomicU64::new(START_NS));
    let clock = Arc::clone(&now_ns);
    let read = move || {
        let at_ns = clock.load(Ordering::Relaxed);
        // in a session from before, nobody looked
        let unix_ns = if is_old { at_ns } else { unix_ns(at_ns) };
        HostTime { unix_ns, boot_ns: at_ns - START_NS + BOOT_NS, apart_ns: 200 }
    };
    let rig_ns: fn(&HostTime) -> u64 = match link_ns {
        0 => |at| at.boot_ns - BOOT_NS + START_NS,
        _ => |at| at.boot_ns - BOOT_NS + START_NS - 3_600_000 * MS,
    };
    let info =
        SensorInfo { name: "left".into(), metadata: Some(metadata().to_json()), ..SensorInfo::default() };
    let source = ClockSource { read: Box::new(read), rig_ns };
    let writer = SessionWriter::create_with_clock(path, &[info], source).unwrap();
    // what an axis did before and after is no part of the recording
    for time_ns in (START_NS - 4_000 * MS..START_NS + (END_MS + 4_000) * MS).step_by(20_000_000) {
        let is_inside = (START_NS - 100 * MS..START_NS + (END_MS + 100) * MS).contains(&time_ns);
        let deg = if is_inside { pitch_deg(time_ns) } else { 60.0 };
        let stands = time_ns >= START_NS + 1_500 * MS && is_inside;
        let position_urad = (deg.to_radians() * 1e6).round() as i32;
        let report = ServoReport {
            time_ns: time_ns - link_ns,
            axis: 0,
            position_urad,
            uncertainty_urad: Some(200),
            target_urad: (8_f64.to_radians() * 1e6).round() as i32,
            source: "measured".into(),
            homed: Some(true),
            state: if stands { "holding" } else { "moving" }.into(),
            faults: Vec::new(),
        };
        writer.write_servo(&report).unwrap();
    }
    let ends: [SocketAddr; 2] = ["10.0.0.1:7502".parse().unwrap(), "10.0.0.100:7502".parse().unwrap()];
    measure(START_NS, START_NS + END_MS * MS, &mut |time_ns, payload| {
        now_ns.store(time_ns + 2 * MS, Ordering::Relaxed); // written a little after it came
        let packet = Packet {
            host_time_ns: unix_ns(time_ns),
            source: ends[0],
            destination: ends[1],
            link: Default::default(),
            payload,
        };
        writer.write_packet(0, &packet).unwrap();
    });
    writer
        .write_event(&serde_json::json!({"time_ns": unix_ns(START_NS + 2_900 * MS), "event": "late"}))
        .unwrap();
    let entry = SensorEntry {
        name: "left".into(),
        model: "os1-16".into(),
        x_m: 0.0,
        y_m: 0.0,
        z_m: 0.1,
        pitch_deg: 8.0,
        ..SensorEntry::default()
    };
    writer.put_mount(&MountFile::new(vec![entry]), &[]).unwrap();
    writer.close(None).unwrap();
    if is_old {
        let manifest = path.join(file::MANIFEST);
        let mut value: Value = serde_json::from_slice(&std::fs::read(&manifest).unwrap()).unwrap();
        value.as_object_mut().unwrap().remove("clock").unwrap();
        std::fs::write(manifest, value.to_string()).unwrap();
    }
}

/// Exit code and document of a verb.
fn run(arguments: &[&str]) -> (Option<i32>, Value) {
    let output =
        Command::new(env!("CARGO_BIN_EXE_outrigger")).args(arguments).arg("--json").output().unwrap();
    let message = String::from_utf8_lossy(&output.stderr);
    let document =
        crate::support::document(&output.stdout).unwrap_or_else(|_| panic!("{arguments:?}: {message}"));
    (output.status.code(), document)
}

fn compare(path: &str) -> (Option<i32>, Value) {
    run(&["compare", path, ROOM, "--trajectory", "still", "--nulls", "0"])
}

/// The rays agree, and the axis is message to be what it was while packets came.
fn is_right(document: &Value) {
    let rays = &document["rays"]["left"];
    assert!(rays["agree_share"].as_f64().unwrap() > 0.99, "{rays}");
    let axis = &document["rig"][0];
    // half of the time from -12 to 8 degrees, half of it at 8
    let mean_deg = axis["measured_pitch_deg"].as_f64().unwrap();
    assert!((mean_deg - 3.0).abs() < 0.4, "{axis}");
    assert!((axis["measured_span_deg"].as_f64().unwrap() - 20.0).abs() < 1.5, "{axis}");
    assert!((135..=155).contains(&axis["reports"].as_u64().unwrap()), "{axis}");
}

/// The first half of it the axis moves; readings of before and after say nothing.
pub fn an_axis_counts_as_it_was_at_each_packet() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("moving");
    record(&path, 0, 0, false);
    let (exit, document) = compare(path.to_str().unwrap());
    is_right(&document);
    assert_eq!((exit, &document["verdict"]), (Some(0), &"matches".into()), "{:#}", document["words"]);
    let (_, document) = run(&["inspect", path.to_str().unwrap()]);
    assert_eq!(document["host_clock"], serde_json::json!([]));
}

pub fn a_step_of_the_host_s_clock_is_undone_and_named() {
    let folder = tempfile::tempdir().unwrap();
    for (number, step_ns) in
        [100 * DAY_NS, -100 * DAY_NS, 3_500_000_000, -400_000_000].into_iter().enumerate()
    {
        let path = folder.path().join(number.to_string());
        // the line to the rig was opened before an earlier step
        record(&path, step_ns, if number == 0 { 3_600_000 * MS } else { 0 }, false);
        let session = Session::open(&path).unwrap();
        let mut packets = session.packets().unwrap();
        let mut last_ns = START_NS;
        while let Some((_, packet)) = packets.next().unwrap() {
            assert!((0..5 * MS).contains(&(packet.host_time_ns - last_ns)), "{step_ns}");
            last_ns = packet.host_time_ns;
        }
        let events: Vec<Value> = session.events().unwrap();
        assert_eq!(events[0]["event"], "host_clock_step");
        assert_eq!(
            (&events[0]["step_ns"], &events[1]["time_ns"]),
            (&step_ns.into(), &(START_NS + 2_900 * MS).into())
        );
        let set_ns = START_NS + SET_MS * MS;
        assert!(events[0]["between_ns"][1].as_u64().unwrap().abs_diff(set_ns) < 5 * MS, "{}", events[0]);
        let name = path.to_str().unwrap();
        let side = if step_ns > 0 { "forward" } else { "back" };
        let words = format!(
            "the host's clock was set {side} by {:.3} s at 1.25",
            step_ns.unsigned_abs() as f64 * 1e-9
        );
        let (exit, document) = run(&["inspect", name]);
        let step = &document["host_clock"][0];
        assert!(step["words"].as_str().unwrap().contains(&words) && step["is_undone"] == true, "{step}");
        assert!(
            (document["duration_s"].as_f64().unwrap() - 3.0).abs() < 0.01 && exit == Some(0),
            "{document:#}"
        );
        if number > 0 {
            continue; // the packets are as those of the first
        }
        let (exit, document) = compare(name);
        is_right(&document);
        assert_eq!((exit, &document["verdict"]), (Some(0), &"matches".into()), "{:#}", document["words"]);
        assert!(document["problems"].to_string().contains(&words), "{words}: {}", document["problems"]);
    }
}

/// A session from before steps were undone is doubted by its data.
pub fn a_step_in_an_old_session_is_inferred() {
    let folder = tempfile::tempdir().unwrap();
    for (number, step_ns) in [100 * DAY_NS, -2_000_000_000].into_iter().enumerate() {
        let path = folder.path().join(number.to_string());
        record(&path, step_ns, 0, true);
        let name = path.to_str().unwrap();
        let (_, document) = compare(name);
        is_right(&document);
        let side = if step_ns > 0 { "forward" } else { "back" };
        let words = format!("set {side} by {}", step_ns.unsigned_abs() / 1_000_000_000);
        let problems = document["problems"].to_string();
        assert!(
            problems.contains(&words) && problems.contains("the clock of left ran on"),
            "{words}: {problems}"
        );
        let (_, document) = run(&["inspect", name]);
        let step = &document["host_clock"][0];
        assert!((step["step_s"].as_f64().unwrap() - step_ns as f64 * 1e-9).abs() < 0.02, "{document:#}");
        assert_eq!(step["is_undone"], false);
    }
    // readings of another time altogether are not believed
    let path = folder.path().join("apart");
    record(&path, 0, 3_600_000 * MS, true);
    let mut lines = std::fs::read_to_string(path.join(file::SERVO)).unwrap();
    lines = lines.replace("\"time_ns\":1763", "\"time_ns\":1700");
    std::fs::write(path.join(file::SERVO), lines).unwrap();
    let (exit, document) = compare(path.to_str().unwrap());
    let problems = document["problems"].to_string();
    assert!(problems.contains("left: its axis measured nothing near 30 of 30 revolutions"), "{problems}");
    assert_eq!((exit, &document["rig"]), (Some(3), &serde_json::json!([])));
}

/// What `compare` takes grows with what was recorded, not with the time that a clock says has passed: at 50 ms a pose 100 days
/// were 10 GB.
pub fn months_between_two_packets_take_no_memory() {
    let folder = tempfile::tempdir().unwrap();
    let mut capture = PcapWriter::new(Vec::new()).unwrap();
    let ends: [SocketAddr; 2] = ["10.0.0.1:7502".parse().unwrap(), "10.0.0.100:7502".parse().unwrap()];
    for start_ns in [START_NS, START_NS + 100 * DAY_NS as u64] {
        measure(start_ns, start_ns + 500 * MS, &mut |host_time_ns, payload| {
            let packet = Packet {
                host_time_ns,
                source: ends[0],
                destination: ends[1],
                link: Default::default(),
                payload,
            };
            capture.write(&packet).unwrap();
        });
    }
    let file = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    std::fs::write(file("two.pcap"), capture.close().unwrap()).unwrap();
    std::fs::write(file("meta.json"), metadata().to_json()).unwrap();
    let entry = SensorEntry {
        name: "left".into(),
        model: "os1-16".into(),
        x_m: 0.0,
        y_m: 0.0,
        z_m: 0.1,
        pitch_deg: 8.0,
        ..SensorEntry::default()
    };
    MountFile::new(vec![entry]).write(&folder.path().join("mount.json")).unwrap();
    let program = env!("CARGO_BIN_EXE_outrigger");
    for verb in ["compare", "odometry", "inspect", "decode"] {
        let place =
            if verb == "compare" { format!("{ROOM} --trajectory still --nulls 2") } else { String::new() };
        let mount = if ["compare", "odometry"].contains(&verb) {
            format!("--mount {}", file("mount.json"))
        } else {
            String::new()
        };
        let line = format!(
            "ulimit -v 4000000; exec {program} {verb} {} --meta {} {mount} {place} --json",
            file("two.pcap"),
            file("meta.json")
        );
        let output = Command::new("sh").args(["-c", &line]).output().unwrap();
        let message = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code().is_some_and(|code| [0, 1, 3].contains(&code)), "{verb}: {message}");
        assert!(!message.contains("memory allocation"), "{verb}: {message}");
    }
}
