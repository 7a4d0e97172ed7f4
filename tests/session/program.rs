//! The verbs: record, replay, mock sensor.

use std::collections::BTreeSet;
use std::net::UdpSocket;
use std::process::{Command, Stdio};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use outrigger::live::receive::{Listen, Options, Receiver};
use outrigger::recording::Session;
use outrigger::rig::{MountFile, SensorEntry};
use sensors::Decoder;
use sensors::made_up::velodyne_columns;
use sensors::ouster::{Metadata, OusterDecoder};
use sensors::velodyne::{Product, VelodyneDecoder};

use super::crash::Recorder;
use super::round_trip::{packets_of, record_two};
use super::{any_port, payloads, sender, wait_until};
use crate::support::datagram::{Datagram, write_capture};

fn outrigger() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_outrigger"));
    command.stderr(Stdio::piped()).stdout(Stdio::piped());
    command
}

pub fn ctrl_c_completes_the_session_and_replay_repeats_it() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path().join("walk");
    let recorder = Recorder::of(&dir);
    let (from, sent) = (sender(), payloads(300, 5));
    for payload in &sent {
        from.send_to(payload, &recorder.address).unwrap();
        std::thread::sleep(std::time::Duration::from_micros(100));
    }
    kill(Pid::from_raw(recorder.child.id() as i32), Signal::SIGINT).unwrap();
    let (code, stdout, stderr) = recorder.end();
    assert_eq!((code, stdout.trim()), (Some(0), dir.to_str().unwrap()), "{stderr}");
    let session = Session::open(&dir).unwrap();
    assert!(session.problems().is_empty() && session.manifest().complete);
    assert_eq!(packets_of(&session)[&0], sent);

    let listen = Listen { name: "again".into(), address: any_port(), source: None };
    let mut receiver = Receiver::start(&[listen], Options::default()).unwrap();
    let recorded = session.manifest().sensors[0].address.unwrap().port();
    let map = format!("{recorded}={}", receiver.address(0).port());
    let replay = outrigger()
        .args([
            "--json",
            "replay",
            dir.to_str().unwrap(),
            "--to",
            "127.0.0.1",
            "--rate",
            "max",
            "--map",
            &map,
        ])
        .output()
        .unwrap();
    assert!(replay.status.success(), "{}", String::from_utf8_lossy(&replay.stderr));
    let document: serde_json::Value = crate::support::document(&replay.stdout).unwrap();
    assert_eq!((document["packets"].as_u64(), document["not_mapped"].as_u64()), (Some(300), Some(0)));
    receiver.stop_handle().stop();
    let mut again = Vec::new();
    while let Some(datagram) = receiver.recv_blocking() {
        again.push(datagram.packet().payload.to_vec());
    }
    assert!(again == sent, "{} of {} came again", again.len(), sent.len());
}

/// 200 packets of two senders to one port.
fn of_two_senders() -> Vec<Datagram> {
    let destination = "192.168.1.2:2368".parse().unwrap();
    let payloads = payloads(200, 7).into_iter().enumerate();
    let datagram = |(at, payload): (usize, Vec<u8>)| Datagram {
        host_time_ns: 1_700_000_000_000_000_000 + 1_000_000 * at as u64,
        source: ([192, 168, 1, 201 + (at % 2) as u8], 2368).into(),
        destination,
        payload,
    };
    payloads.map(datagram).collect()
}

/// Exit code, document and what was said on stderr.
fn replay(capture: &std::path::Path, more: &[&str]) -> (i32, serde_json::Value, String) {
    let mut command = outrigger();
    command.args(["--json", "replay", "--to", "127.0.0.1", "--rate", "100"]).args(more).arg(capture);
    let output = command.output().unwrap();
    let document = crate::support::document(&output.stdout).unwrap_or_default();
    (output.status.code().unwrap(), document, String::from_utf8(output.stderr).unwrap())
}

pub fn replay_says_what_it_does_not_send() {
    let folder = tempfile::tempdir().unwrap();
    let whole = write_capture(&folder.path().join("whole.pcapng"), &of_two_senders());
    let (code, document, said) = replay(&whole, &[]);
    assert_eq!((code, &document["packets"]), (0, &200.into()), "{said}");
    let senders = serde_json::json!({"192.168.1.201": "127.0.0.1", "192.168.1.202": "127.0.0.2"});
    assert!(document["senders"] == senders && !said.contains("one address"), "{document} {said}");
    let damaged = folder.path().join("damaged.pcapng");
    let mut bytes = std::fs::read(&whole).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle..middle + 10_000].fill(0xFF);
    std::fs::write(&damaged, bytes).unwrap();
    let (code, document, said) = replay(&damaged, &[]);
    assert_eq!(code, 3, "{said}");
    assert!((50..150).contains(&document["packets"].as_u64().unwrap()), "{document}");
    assert!(said.contains("damaged at byte") && document["losses"][0].is_string(), "{said}");
    for (more, failed_with, words) in [
        (&["--map", "1=2"][..], 1, "no UDP packet to send; none goes to a mapped port"),
        (&["--map", "1=2", "--loop"], 1, "no UDP packet to send; none goes to a mapped port"),
        (&["--map", "2368=1", "--map", "2368=2"], 2, "--map 2368=1 and --map 2368=2"),
    ] {
        let (code, _, said) = replay(&whole, more);
        assert!(code == failed_with && said.contains(words), "{said}");
    }
    for more in [&["--rate", "max"][..], &["--rate", "max", "--map", "2368=9"]] {
        let mut command = outrigger();
        command.args(["--json", "replay", "-", "--to", "127.0.0.1"]).args(more);
        let output = command.stdin(std::fs::File::open(&whole).unwrap()).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        let document: serde_json::Value = crate::support::document(&output.stdout).expect(&said);
        assert_eq!(document["packets"], 200);
    }
}

pub fn a_looped_replay_ends_with_its_count() {
    let folder = tempfile::tempdir().unwrap();
    let capture = write_capture(&folder.path().join("whole.pcapng"), &of_two_senders());
    let listener = UdpSocket::bind("127.0.0.1:0").unwrap();
    let map = format!("2368={}", listener.local_addr().unwrap().port());
    let mut command = outrigger();
    command.args(["--json", "replay", "--to", "127.0.0.1", "--loop", "--map", &map]).arg(&capture);
    let running = command.spawn().unwrap();
    let mut buffer = [0; 2000];
    let senders: BTreeSet<_> = (0..500).map(|_| listener.recv_from(&mut buffer).unwrap().1).collect();
    assert_eq!(senders.len(), 2, "the same two in every round");
    kill(Pid::from_raw(running.id() as i32), Signal::SIGINT).unwrap();
    let output = running.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let document: serde_json::Value = crate::support::document(&output.stdout).unwrap();
    assert!(
        document["rounds"].as_u64() >= Some(2) && document["packets"].as_u64() >= Some(500),
        "{document}"
    );
}

/// Two sensors on ports of their own; the session has begun.
fn record_left_and_right(dir: &std::path::Path) -> Recorder {
    let mut command = outrigger();
    command
        .args(["record", "--listen", "left=127.0.0.1:0", "--listen", "right=127.0.0.1:0", "--out"])
        .arg(dir);
    let recorder = Recorder::start(command);
    wait_until("the session has its manifest", || Session::is_session(dir));
    recorder
}

/// Two Velodynes of one host: only the session says which is which.
pub fn sensors_are_called_as_they_were_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path().join("walk");
    let recorder = record_left_and_right(&dir);
    let entries = Session::open(&dir).unwrap().manifest().sensors.clone();
    let from = sender();
    for payload in velodyne_columns(Product::Vlp16, 2400) {
        // the right one is heard first
        for entry in entries.iter().rev() {
            from.send_to(&payload, entry.address.unwrap()).unwrap();
        }
        std::thread::sleep(std::time::Duration::from_micros(100));
    }
    kill(Pid::from_raw(recorder.child.id() as i32), Signal::SIGINT).unwrap();
    assert_eq!(recorder.end().0, Some(0));
    let document = |arguments: &[&std::ffi::OsStr]| -> serde_json::Value {
        let output = outrigger().arg("--json").args(arguments).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        crate::support::document(&output.stdout).expect(&said)
    };
    let inspected = document(&["inspect".as_ref(), dir.as_os_str()]);
    for flow in inspected["flows"].as_array().unwrap() {
        let port = flow["destination"].as_str().unwrap().rsplit_once(':').unwrap().1.to_owned();
        let of_port =
            |entry: &&outrigger::recording::SensorEntry| entry.address.unwrap().port().to_string() == port;
        let entry = entries.iter().find(of_port).unwrap();
        assert_eq!(flow["sensors"], serde_json::json!([entry.name]), "{inspected:#}");
    }
    let out = folder.path().join("points");
    let decoded = document(&[
        "decode".as_ref(),
        dir.as_os_str(),
        "--format".as_ref(),
        "csv".as_ref(),
        "--out".as_ref(),
        out.as_os_str(),
    ]);
    assert_eq!(
        (&decoded["sensors"][0]["id"], &decoded["sensors"][1]["id"]),
        (&"right".into(), &"left".into())
    );
    for name in ["left_000000.csv", "right_000000.csv"] {
        assert!(out.join(name).is_file(), "{decoded:#}");
    }
}

pub fn a_silent_sensor_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path().join("walk");
    let output = outrigger()
        .args(["record", "--listen", "front=127.0.0.1:0", "--duration", "2.3", "--out"])
        .arg(&dir)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{said}");
    let session = Session::open(&dir).unwrap();
    let port = session.manifest().sensors[0].address.unwrap().port();
    assert!(said.contains(&format!(
        "front: no packets on port {port}: is it powered, is udp_dest set to this host?"
    )));
    let events: Vec<serde_json::Value> = session.events().unwrap();
    assert_eq!((&events[0]["event"], &events[0]["sensor"]), (&"sensor_silent".into(), &"front".into()));
}

pub fn two_mock_sensors_are_recorded_and_decoded() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path().join("walk");
    let recorder = record_left_and_right(&dir);
    let addresses: Vec<_> = Session::open(&dir)
        .unwrap()
        .manifest()
        .sensors
        .iter()
        .map(|sensor| sensor.address.unwrap().to_string())
        .collect();
    let metadata = folder.path().join("left.json");
    let mock = |model: &str, to: &str| {
        let mut command = outrigger();
        command.args([
            "--json",
            "mock",
            "sensor",
            "--model",
            model,
            "--to",
            to,
            "--duration",
            "0.45",
            "--rate",
            "max",
        ]);
        command.args(["--mount", "0.06,0,0.1,25,0", "--noise-m", "0.02", "--seed", "7"]);
        command
    };
    let left = mock("os1-64", &addresses[0]).arg("--metadata").arg(&metadata).spawn().unwrap();
    let right = mock("vlp-16", &addresses[1]).args(["--drop", "0.05", "--index", "1"]).spawn().unwrap();
    let mut sent = Vec::new();
    for child in [left, right] {
        let output = child.wait_with_output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let lines = String::from_utf8(output.stdout).unwrap();
        let documents: Vec<serde_json::Value> =
            lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        assert_eq!(documents[0]["ready"], true);
        sent.push(documents[1].clone());
    }
    kill(Pid::from_raw(recorder.child.id() as i32), Signal::SIGINT).unwrap();
    let (code, _, stderr) = recorder.end();
    assert_eq!(code, Some(0), "{stderr}");
    let session = Session::open(&dir).unwrap();
    let known = Metadata::parse(&std::fs::read_to_string(&metadata).unwrap(), "left.json").unwrap();
    let mut decoders: [Box<dyn Decoder>; 2] =
        [Box::new(OusterDecoder::new(known)), Box::new(VelodyneDecoder::new(Default::default()))];
    let mut packets = session.packets().unwrap();
    while let Some((sensor, packet)) = packets.next().unwrap() {
        decoders[sensor].push(&packet, &mut |_| {}).unwrap();
    }
    for (sensor, decoder) in decoders.iter_mut().enumerate() {
        decoder.finish(&mut |_| {});
        let stats = decoder.stats();
        assert_eq!(session.manifest().sensors[sensor].packets, sent[sensor]["sent_packets"], "{stats:?}");
        assert_eq!(stats.packets, sent[sensor]["sent_packets"], "{stats:?}");
        assert!(stats.frames >= 4, "{stats:?}");
        assert_eq!(stats.lost_packets, sent[sensor]["faults"]["dropped"], "{stats:?}");
    }
    assert!(sent[1]["faults"]["dropped"].as_u64() > Some(0));
}

/// Ports for what comes beside lidar packets, as `init` writes them, and the mount that the prediction names.
pub fn what_record_keeps_is_enough_to_compare() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let entry = |name: &str, x_m: f64, pitch_deg: f64| SensorEntry {
        name: name.into(),
        model: "vlp-16".into(),
        x_m,
        y_m: 0.0,
        z_m: 0.1,
        pitch_deg,
        ..SensorEntry::default()
    };
    MountFile::new(vec![entry("left", -0.1, -20.0), entry("right", 0.1, 20.0)])
        .write(&path("mount.json"))
        .unwrap();
    let sensor = |name: &str| {
        let any = "\"127.0.0.1:0\"";
        format!("[[sensor]]\nname = \"{name}\"\nmodel = \"vlp-16\"\nlisten = {any}\nlisten_aside = {any}\n")
    };
    let rest = "[predict]\nmount = \"mount.json\"\n";
    let config = ["format = \"outrigger-rig/1\"\n", &sensor("left"), &sensor("right"), rest].concat();
    std::fs::write(path("rig.toml"), config).unwrap();
    let dir = path("walk");
    let mut command = outrigger();
    command.arg("record").arg("--config").arg(path("rig.toml")).arg("--out").arg(&dir);
    let recorder = Recorder::start(command);
    wait_until("the session has its manifest", || Session::is_session(&dir));
    let manifest = Session::open(&dir).unwrap().manifest().clone();
    let address = |name: &str| {
        let entry = manifest.sensors.iter().find(|sensor| sensor.name == name).unwrap();
        entry.address.unwrap().to_string()
    };
    let room = "-6,-4,-1.5,6,4,2.5";
    let mock = |name: &str| {
        let (to, aside) = (address(name), address(&format!("{name}-aside")));
        let mut command = outrigger();
        command.args([
            "mock",
            "sensor",
            "--model",
            "vlp-16",
            "--name",
            name,
            "--to",
            &to,
            "--aside-to",
            &aside,
        ]);
        command.arg("--mounts").arg(path("mount.json")).arg(format!("--box={room}"));
        command.args(["--duration", "0.6", "--rate", "max"]).spawn().unwrap()
    };
    for child in [mock("left"), mock("right")] {
        let output = child.wait_with_output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    }
    kill(Pid::from_raw(recorder.child.id() as i32), Signal::SIGINT).unwrap();
    let (code, _, said) = recorder.end();
    assert!(code == Some(0) && !said.contains("warning"), "{code:?} {said}");
    let asides = manifest.sensors.iter().filter(|entry| manifest.is_auxiliary(entry)).count();
    assert_eq!((manifest.sensors.len(), asides), (4, 2));
    let compared = outrigger()
        .args(["compare", "--json", "--trajectory", "still", &format!("--room={room}")])
        .arg(&dir)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&compared.stderr);
    let document: serde_json::Value = crate::support::document(&compared.stdout).expect(&said);
    let coverage = &document["coverage"];
    assert!(coverage["recorded"].as_u64() > Some(10_000), "{document:#}");
    assert_eq!(
        (&coverage["recorded"], &document["faults"]),
        (&coverage["as_driven"], &serde_json::json!([]))
    );
    // inspect holds every file against the manifest
    let inspected = || outrigger().arg("inspect").arg(&dir).output().unwrap();
    assert_eq!(inspected().status.code(), Some(0));
    let mount = std::fs::read_to_string(dir.join("mount.json")).unwrap();
    std::fs::write(dir.join("mount.json"), mount.replacen("20", "21", 1)).unwrap();
    let output = inspected();
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.code() == Some(3) && text.contains("mount.json"), "{text}");
    std::fs::remove_file(dir.join("mount.json")).unwrap();
    assert!(String::from_utf8_lossy(&inspected().stdout).contains("mount.json"));
    std::fs::write(dir.join("manifest.json"), "garbage").unwrap();
    let output = inspected();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(1) && said.contains("manifest.json"), "{said}");
}

pub fn has_tshark() -> bool {
    Command::new("tshark").arg("--version").output().is_ok_and(|output| output.status.success())
}

pub fn tshark_reads_a_session() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path().join("walk");
    let streams = [payloads(40, 6), payloads(50, 7)];
    let manifest = record_two(&dir, [&streams[0], &streams[1]]);
    let output = Command::new("tshark")
        .args([
            "-o",
            "udp.check_checksum:TRUE",
            "-T",
            "fields",
            "-e",
            "frame.interface_name",
            "-e",
            "udp.dstport",
        ])
        .args(["-e", "udp.length", "-e", "frame.time_epoch", "-e", "_ws.malformed", "-r"])
        .arg(dir.join("packets.pcapng"))
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    let mut seen = [0; 2];
    let sensors = &manifest.sensors;
    for line in text.lines() {
        let fields: Vec<&str> = line.split('\t').collect();
        let sensor = sensors.iter().position(|sensor| sensor.name == fields[0]).unwrap();
        assert_eq!(fields[1], sensors[sensor].address.unwrap().port().to_string(), "{line}");
        assert_eq!(fields[2].parse::<usize>().unwrap(), streams[sensor][seen[sensor]].len() + 8, "{line}");
        assert_eq!((fields[3].rsplit_once('.').unwrap().1.len(), fields[4]), (9, ""), "{line}");
        seen[sensor] += 1;
    }
    assert_eq!(seen, [40, 50]);
}

pub fn a_mock_sensor_ends_in_order_when_interrupted() {
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    let to = socket.local_addr().unwrap().to_string();
    let arguments = ["--json", "mock", "sensor", "--model", "vlp-16", "--to", &to, "--duration", "600"];
    let child = outrigger().args(arguments).stdout(Stdio::piped()).spawn().unwrap();
    socket.recv(&mut [0; 2048]).unwrap();
    kill(Pid::from_raw(child.id() as i32), Signal::SIGINT).unwrap();
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0));
    let documents = serde_json::Deserializer::from_slice(&output.stdout).into_iter::<serde_json::Value>();
    let last = documents.last().unwrap().unwrap();
    assert!(last["sent_packets"].as_u64().unwrap() > 0, "what it sent is said: {last}");
}
