//! What is given for several sensors of a recording finds the one that it is meant for, or none.

use std::net::{IpAddr, SocketAddr};
use std::path::PathBuf;

use outrigger::recording::{SensorInfo, SessionWriter};
use serde_json::Value;

use crate::decode::{decode, outrigger, path};
use crate::support::datagram::{Datagram, datagrams, write_capture};
use crate::support::{Case, shared, with_shared};

pub const CASES: &[Case] = &[
    with_shared("units_without_serial_numbers_are_tied", units_without_serial_numbers_are_tied),
    with_shared("of_two_units_that_look_the_same_none_is_picked", of_two_units_none_is_picked),
    with_shared("a_sessions_own_metadata_stay", a_sessions_own_metadata_stay),
    with_shared("one_damaged_metadata_file_costs_one_sensor", one_damaged_metadata_file_costs_one_sensor),
    with_shared("velodynes_of_a_session_are_told_by_name", velodynes_of_a_session_are_told_by_name),
];

/// Two units of one model with LEGACY packets, left.json and right.json, in both.pcapng.
struct Two {
    folder: tempfile::TempDir,
    all: Vec<Datagram>,
    /// Where the lidar packets of the left one go; those of the right one go to the second port after it.
    port: u16,
}

impl Two {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let one = datagrams(&shared("captures/ouster/ouster_example.pcap"));
        let both = one.iter().flat_map(|datagram| {
            [(200, 0), (201, 2)].map(|(host, ports)| {
                let mut sent = datagram.clone();
                sent.source.set_ip([192, 168, 0, host].into());
                sent.destination.set_port(datagram.destination.port() + ports);
                sent
            })
        });
        let all: Vec<Datagram> = both.collect();
        write_capture(&folder.path().join("both.pcapng"), &all);
        for file in ["left.json", "right.json"] {
            std::fs::copy(shared("captures/ouster/ouster_example.json"), folder.path().join(file)).unwrap();
        }
        let port = one.iter().find(|datagram| datagram.payload.len() > 1000).unwrap().destination.port();
        Self { folder, all, port }
    }

    fn name(&self, name: &str) -> String {
        self.folder.path().join(name).display().to_string()
    }

    /// The same as a session of left and right.
    fn session(&self) -> PathBuf {
        let dir = self.folder.path().join("walk");
        let metadata = std::fs::read_to_string(self.name("left.json")).unwrap();
        let sensors = [("left", self.port), ("right", self.port + 2)];
        record(
            &dir,
            &sensors,
            &metadata,
            self.all.iter().map(|sent| (usize::from(sent.source.ip() == IpAddr::from(RIGHT)), sent)),
        );
        dir
    }
}

const RIGHT: [u8; 4] = [192, 168, 0, 201];

/// A session of sensors that are received on these ports; without metadata where the text is empty.
fn record<'a>(
    dir: &std::path::Path,
    sensors: &[(&str, u16)],
    metadata: &str,
    packets: impl Iterator<Item = (usize, &'a Datagram)>,
) {
    let info = |(name, port): &(&str, u16)| SensorInfo {
        name: (*name).into(),
        address: Some(SocketAddr::from(([0; 4], *port))),
        source: None,
        metadata: Some(metadata.to_owned()).filter(|metadata| !metadata.is_empty()),
    };
    let writer = SessionWriter::create(dir, &sensors.iter().map(info).collect::<Vec<_>>()).unwrap();
    for (sensor, datagram) in packets {
        writer.write_packet(sensor, &datagram.packet()).unwrap();
    }
    writer.close(None).unwrap();
}

fn inspect(arguments: &[&str]) -> (i32, Value, String) {
    let output = outrigger(&[&["--json", "inspect"], arguments].concat());
    let document = crate::support::document(&output.stdout).unwrap_or(Value::Null);
    (output.status.code().unwrap(), document, String::from_utf8(output.stderr).unwrap())
}

/// Number of frames of every sensor, by id.
fn frames(document: &Value) -> Vec<(String, usize)> {
    let count = |sensor: &Value| match &sensor["frames"] {
        Value::Array(frames) => frames.len(),
        count => count.as_u64().unwrap() as usize,
    };
    let sensors = document["sensors"].as_array().unwrap();
    sensors.iter().map(|sensor| (sensor["id"].as_str().unwrap().to_owned(), count(sensor))).collect()
}

/// Two units of one model with LEGACY packets: who sends tells them apart, or where to.
fn units_without_serial_numbers_are_tied() {
    let two = Two::new();
    let name = |name: &str| two.name(name);
    let capture = &name("both.pcapng");
    let (_, alone, _) = decode(
        &path("captures/ouster/ouster_example.pcap"),
        &[&path("captures/ouster/ouster_example.json")],
        &[],
    );
    let port = two.port;
    let ports = [format!(":{port}="), format!(":{}=", port + 2)];
    let both = [format!("192.168.0.201:{}=", port + 2), format!("192.168.0.200:{port}=")];
    for ties in [["192.168.0.201=", "192.168.0.200="].map(str::to_owned), ports, both] {
        let metas =
            [format!("{}{}", ties[0], name("left.json")), format!("{}{}", ties[1], name("right.json"))];
        let (code, document, said) = decode(capture, &[&metas[0], &metas[1]], &[]);
        assert_eq!((code, said.as_str()), (0, ""), "{metas:?}");
        for (at, tie) in ties.iter().enumerate() {
            let sensor = &document["sensors"][at];
            assert_eq!(sensor["frames"].as_array().unwrap().len(), 3, "{document:#}");
            assert_eq!(sensor["totals"], alone["sensors"][0]["totals"]);
            assert_eq!(sensor["imu_samples"], alone["sensors"][0]["imu_samples"]);
            let said = format!("{}={}=", sensor["source"].as_str().unwrap(), sensor["port"]);
            let parts = tie.split([':', '=']);
            assert!(parts.clone().all(|part| said.contains(part)), "{said} {tie}");
        }
    }
    let output = outrigger(&["decode", capture, "--meta", &format!(":0={}", name("left.json"))]);
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.code() == Some(2) && said.contains("there is no port 0, expected 1 to"), "{said}");
    let wrong = [format!("192.168.0.209={}", name("left.json"))];
    let (code, _, said) = decode(capture, &[&wrong[0]], &[]);
    assert!(code == 1 && said.contains("comes from 192.168.0.209"), "{said}");
    let meta = format!("192.168.0.201={}", name("left.json"));
    let (code, document, said) = decode(capture, &[&meta], &[]);
    assert!(code == 0 && said.contains("which is configured for 192.168.0.201"), "{said}");
    assert_eq!(document["sensors"][0]["totals"], alone["sensors"][0]["totals"]);
}

/// Metadata of one of them fit both.
fn of_two_units_none_is_picked() {
    let two = Two::new();
    let (capture, left) = (two.name("both.pcapng"), two.name("left.json"));
    let words = ["fits the packets of several sensors", "192.168.0.200 to port", "192.168.0.201 to port"];
    let (code, _, said) = decode(&capture, &[&left], &[]);
    assert!(code == 1 && words.iter().all(|words| said.contains(words)), "{said}");
    let (code, document, _) = inspect(&[&capture, "--meta", &left]);
    let advice = document["advice"].to_string();
    assert!(code == 0 && words.iter().all(|words| advice.contains(words)), "{advice}");
    assert_eq!(document["sensors"][0]["counters"]["packets"], 0);
}

fn a_sessions_own_metadata_stay() {
    let two = Two::new();
    let session = two.session().display().to_string();
    let other = path("captures/ouster/OS-1-128_v2.3.0_1024x10.json");
    let rig =
        format!("format = \"outrigger-rig/1\"\n[decode]\nmeta = {other:?}\n[inspect]\nmeta = {other:?}\n");
    std::fs::write(two.name("rig.toml"), rig).unwrap();
    let config = two.name("rig.toml");
    let own = [("left".to_owned(), 3), ("right".to_owned(), 3)];
    let (code, document, said) = decode(&session, &[], &["--config", &config]);
    assert_eq!((code, frames(&document)), (0, own.to_vec()), "{said}");
    let (code, document, said) = inspect(&[&session, "--config", &config]);
    assert_eq!((code, frames(&document)), (0, own.to_vec()), "{said}");
    // what is typed counts
    let (code, document, said) = decode(&session, &[&other], &["--config", &config]);
    assert_eq!((code, document), (1, Value::Null), "{said}");
}

fn one_damaged_metadata_file_costs_one_sensor() {
    let two = Two::new();
    let dir = two.session();
    let (session, file) = (dir.display().to_string(), dir.join("metadata/left.json"));
    let named = file.display().to_string();
    for (damage, words) in [(true, "line 2, column 0: not JSON"), (false, "cannot be read")] {
        match damage {
            true => std::fs::write(&file, "{\n").unwrap(),
            false => std::fs::remove_file(&file).unwrap(),
        }
        let words = format!("{named}: {words}");
        let (code, document, said) = decode(&session, &[], &[]);
        assert!(code == 3 && said.contains(&words), "{said}");
        assert_eq!(frames(&document), [("right".to_owned(), 3)]);
        let (code, document, _) = inspect(&[&session]);
        assert!(code == 3 && document["losses"].to_string().contains(&words), "{document:#}");
        assert_eq!(frames(&document), [("right".to_owned(), 3)]);
    }
}

/// Behind one address: position packets go by their port, calibrations by the name.
fn velodynes_of_a_session_are_told_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path().join("walk");
    let one = datagrams(&shared("captures/velodyne/mrpt_vlp16_gps.pcap"));
    let to = |sent: &Datagram, port: u16| {
        let mut sent = sent.clone();
        sent.destination.set_port(port);
        sent
    };
    let mut all = Vec::new();
    for sent in &one {
        match sent.payload.len() {
            1206 => all.extend([(0, to(sent, 2368)), (1, to(sent, 2369))]),
            _ => all.push((2, to(sent, 8310))),
        }
    }
    let packets = all.iter().map(|(sensor, sent)| (*sensor, sent));
    record(&dir, &[("left", 2368), ("right", 2369), ("right-aside", 8310)], "", packets);
    let session = dir.display().to_string();
    let lines: String =
        (0..16).map(|id| format!("- {{laser_id: {id}, vert_correction: 0.0{id}}}\n")).collect();
    let file = folder.path().join("unit.yaml").display().to_string();
    std::fs::write(&file, format!("lasers:\n{lines}")).unwrap();
    let (code, document, said) = inspect(&[&session, "--calibration", &format!("right={file}")]);
    assert_eq!(code, 0, "{said}");
    let told: Vec<[&Value; 3]> = document["sensors"]
        .as_array()
        .unwrap()
        .iter()
        .map(|sensor| ["id", "position_packets", "beams"].map(|field| &sensor[field]))
        .collect();
    let as_said = format!("as {file} says").into();
    let expected = [[&"left".into(), &0.into(), &"nominal".into()], [&"right".into(), &57.into(), &as_said]];
    assert_eq!(told, expected);
    let (code, _, said) = decode(&session, &[], &["--calibration", &format!("front={file}")]);
    assert!(code == 1 && said.contains("is called front; there are left, right\n"), "{said}");
    let (code, document, said) = decode(&session, &[], &["--calibration", &format!(":2368={file}")]);
    assert_eq!((code, &document["sensors"][0]["beams"]), (0, &as_said), "{said}");
    // a capture does not know whose the position packets are
    let capture = dir.join("packets.pcapng").display().to_string();
    let (_, document, said) = decode(&capture, &[], &[]);
    assert!(said.contains("nothing says of which"), "{said}");
    assert!(document["sensors"].as_array().unwrap().iter().all(|sensor| sensor["position_packets"] == 0));
}
