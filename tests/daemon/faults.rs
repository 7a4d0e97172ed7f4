//! Sensors, networks and operators that misbehave: what the state says, what the exit code says, what is kept.

use std::net::UdpSocket;
use std::time::{Duration, Instant};

use outrigger::mock::rig::{MockConfig, MockRig};
use outrigger::mock::sensor::MockSensor;
use outrigger::rig::Mount;
use sensors::ouster::{Metadata, Profile, Synthetic};
use serde_json::Value;

use super::program::{Bench, has_problem};
use super::sensor::{SERIAL, Sending, metadata};

fn sends(status: &Value) -> bool {
    status["sensors"][0]["state"] == "ok" && status["sensors"][0]["frames"].as_u64() > Some(2)
}

pub fn events_of(bench: &Bench) -> Vec<String> {
    let sessions = bench.sessions();
    let events: Vec<Value> = sessions.iter().flat_map(|session| session.events::<Value>().unwrap()).collect();
    events.iter().map(|event| event["event"].as_str().unwrap().to_owned()).collect()
}

pub fn a_sensor_is_unplugged_and_comes_back() {
    let bench = Bench::new(&["left"], "");
    let daemon = bench.start(&["--record"]);
    assert!(daemon.wait_for_problem("no_packets").contains("left"));
    let first = Sending::ouster(daemon.sensor(0));
    daemon.wait("the sensor sends", sends);
    let sent = first.unplug();
    assert!(daemon.wait_for_problem("silent").contains("left has sent nothing"));
    let again = Sending::ouster(daemon.sensor(0));
    daemon.wait("it is back", |status| sends(status) && !has_problem(status, "silent"));
    let sent = sent + again.unplug();
    let (code, log) = daemon.end();
    assert_eq!(code, Some(0), "{log}");
    let manifest = bench.sessions()[0].manifest().clone();
    assert!(manifest.complete);
    assert_eq!(manifest.sensors[0].packets, sent);
    let events = events_of(&bench);
    let place = |event: &str| events.iter().position(|other| other == event);
    assert!(place("sensor_silent").unwrap() < place("sensor_heard").unwrap(), "{events:?}");
}

pub fn a_sensor_starts_again() {
    let bench = Bench::new(&["left"], "");
    let daemon = bench.start(&["--record"]);
    let first = Sending::ouster(daemon.sensor(0));
    daemon.wait("the sensor sends", sends);
    first.unplug();
    let sensor = MockSensor::ouster(metadata(SERIAL, 2));
    let second = Sending::start(sensor, daemon.sensor(0), Mount::default(), 0, None);
    assert!(daemon.wait_for_problem("restarted").contains("left started again"));
    let status = daemon.wait("it is read", |status| status["sensors"][0]["restarts"] == 1);
    assert!(!has_problem(&status, "clock_jump"), "one cause, one problem: {status}");
    second.unplug();
    assert_eq!(daemon.end().0, Some(0));
    assert!(events_of(&bench).contains(&"sensor_restarted".to_owned()));
}

pub fn a_sensor_comes_back_in_another_mode() {
    let bench = Bench::new(&["left"], "");
    let daemon = bench.start(&["--record"]);
    // from one address: of two at once the daemon takes the first
    let from = Some(UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap());
    let sensor = MockSensor::ouster(metadata(SERIAL, 1));
    let first = Sending::start(sensor, daemon.sensor(0), Mount::default(), 0, from);
    daemon.wait("the sensor sends", sends);
    std::thread::sleep(Duration::from_millis(500));
    first.unplug();
    let wanted = Synthetic::new("os1-16", SERIAL, Profile::Rng19Rfl8Sig16Nir16).columns(1024, 16);
    let other = Metadata::synthetic(&Synthetic { init_id: 2, ..wanted }).unwrap();
    let second = Sending::start(MockSensor::ouster(other), daemon.sensor(0), Mount::default(), 0, from);
    let named = |status: &Value| {
        let events = status["events"].as_array().unwrap();
        events.iter().any(|event| {
            event["event"] == "sensor_settings"
                && event["words"].as_str().unwrap().contains("lidar_mode changed from 512x10 to 1024x10")
        })
    };
    let status = daemon.wait("the change is named", named);
    assert_eq!(status["sensors"][0]["losses"]["malformed"], 0, "{status}");
    second.unplug();
    assert_eq!(daemon.end().0, Some(0));
    assert!(events_of(&bench).contains(&"sensor_settings".to_owned()));
}

pub fn a_clock_jumps() {
    let bench = Bench::new(&["left"], "");
    let daemon = bench.start(&["--record"]);
    let first = Sending::ouster(daemon.sensor(0));
    daemon.wait("the sensor sends", sends);
    first.unplug();
    let sensor = MockSensor::ouster(metadata(SERIAL, 1));
    let second = Sending::start(sensor, daemon.sensor(0), Mount::default(), 90_000_000_000, None);
    let said = daemon.wait_for_problem("clock_jump");
    assert!(said.contains("left jumped by 90.0") || said.contains("left jumped by 89.9"), "{said}");
    let status = daemon.wait("its clock is judged anew", |status| has_problem(status, "clock_not_locked"));
    assert_eq!(status["sensors"][0]["clock"]["state"], "unsynchronised");
    second.unplug();
    assert_eq!(daemon.end().0, Some(0));
    assert!(events_of(&bench).contains(&"clock_jump".to_owned()));
}

pub fn metadata_of_another_sensor() {
    let bench = Bench::new(&["left"], "");
    let other = metadata(SERIAL + 1, 1);
    std::fs::write(bench.path("left.json"), other.to_json()).unwrap();
    let daemon = bench.start(&["--record"]);
    let sensor = Sending::ouster(daemon.sensor(0));
    let said = daemon.wait_for_problem("wrong_metadata");
    assert!(said.contains(&SERIAL.to_string()) && said.contains("left"), "{said}");
    assert_eq!(daemon.status()["sensors"][0]["state"], "not_decoded");
    let sent = sensor.unplug();
    let (code, log) = daemon.end();
    assert_eq!(code, Some(0), "what cannot be read is recorded all the same: {log}");
    assert_eq!(bench.sessions()[0].manifest().sensors[0].packets, sent);
}

pub fn packets_of_other_sensors_and_a_storm_of_garbage() {
    let bench = Bench::new(&["left"], "");
    let config = std::fs::read_to_string(bench.path("rig.toml")).unwrap();
    let config = config.replace("listen = \"127.0.0.1:0\"", "listen = \"0.0.0.0:0\"\nsource = \"127.0.0.1\"");
    std::fs::write(bench.path("rig.toml"), config).unwrap();
    let daemon = bench.start(&["--record"]);
    let to = (std::net::Ipv4Addr::LOCALHOST, daemon.sensor(0).port()).into();
    let sensor = Sending::ouster(to);
    daemon.wait("the sensor sends", sends);
    let stranger = UdpSocket::bind("127.0.0.2:0").unwrap();
    let insider = UdpSocket::bind("127.0.0.1:0").unwrap();
    let (begun, mut garbage, mut foreign) = (Instant::now(), 0, 0);
    let mut rng = outrigger::base::rng::Rng::new(7, 0);
    while begun.elapsed() < Duration::from_millis(800) {
        // any 48 bytes are an inertial packet of the oldest format
        let length = Some(rng.below(1500)).filter(|length| *length != 48).unwrap_or(49);
        let bytes: Vec<u8> = (0..length).map(|_| rng.bits() as u8).collect();
        garbage += u64::from(insider.send_to(&bytes, to).is_ok());
        foreign += u64::from(stranger.send_to(&bytes, to).is_ok());
    }
    assert!(daemon.wait_for_problem("foreign_source").contains("127.0.0.2"));
    assert!(daemon.wait_for_problem("foreign_packets").contains("left"));
    let status = daemon.wait("all of it was looked at", |status| {
        let losses = &status["sensors"][0]["losses"];
        let of = |name: &str| losses[name].as_u64().unwrap();
        // what the kernel drops it drops before anybody asks where it came from
        of("foreign_source")
            + of("not_its_own")
            + of("kernel_dropped")
            + of("queue_dropped")
            + status["sensors"][0]["picture_dropped"].as_u64().unwrap()
            >= foreign + garbage
    });
    assert!(sends(&status), "the sensor is read all the same: {status}");
    let sent = sensor.unplug();
    let (code, log) = daemon.end();
    let manifest = bench.sessions()[0].manifest().clone();
    let losses = manifest.losses;
    assert_eq!(code, Some(if losses.total() > 0 { 3 } else { 0 }), "{log}");
    let counted = manifest.sensors[0].packets + losses.kernel_dropped + losses.queue_dropped;
    let unseen = foreign - status["sensors"][0]["losses"]["foreign_source"].as_u64().unwrap();
    assert!(
        (sent + garbage..=sent + garbage + unseen).contains(&counted),
        "{counted}: {sent} {garbage} {unseen}"
    );
}

pub fn a_second_daemon_says_why_it_cannot_start() {
    let rig = MockRig::start(MockConfig::default(), 1).unwrap();
    let section = format!("[rig]\nport = \"{}\"\n", rig.path().display());
    let bench = Bench::new(&["left"], &section);
    let daemon = bench.start(&[]);
    let fails = |bench: &Bench, arguments: &[&str]| {
        let output = bench.command(arguments).env_remove("OUTRIGGER_RIG_PORT").output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{said}");
        assert!(output.stdout.is_empty(), "no promise on stdout");
        said
    };
    let said = fails(&bench, &[]);
    assert!(said.contains("is in use by another program") && said.contains("rig"), "{said}");
    let config = std::fs::read_to_string(bench.path("rig.toml")).unwrap();
    let taken = daemon.sensor(0).to_string();
    // of a rig and a port that both are taken, the rig is told of first
    let without_rig = config.replace("127.0.0.1:0", &taken).replace(&section, "");
    std::fs::write(bench.path("rig.toml"), without_rig).unwrap();
    let said = fails(&bench, &[]);
    assert!(said.contains(&taken) && said.contains("another program already listens there"), "{said}");
    let other = Bench::new(&["left"], "");
    let said = fails(&other, &["--listen", &daemon.address.to_string()]);
    assert!(said.contains(&daemon.address.to_string()) && said.contains("another daemon"), "{said}");
    assert!(daemon.status()["rig"]["connected"] == true, "the first one is not disturbed");
    assert_eq!(daemon.end().0, Some(0));
}
