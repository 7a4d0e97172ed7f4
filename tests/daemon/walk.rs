//! Nothing goes wrong: sensors, rig and recorder together, and a program that listens.

use std::net::TcpStream;
use std::os::unix::net::UnixDatagram;

use outrigger::daemon::{COVERAGE_KIND, POINTS_KIND};
use outrigger::mock::rig::{MockConfig, MockRig};
use outrigger::mock::sensor::MockSensor;
use outrigger::rig::{Mount, MountFile};
use serde_json::Value;
use tungstenite::Message;

use super::program::{Bench, PATIENCE, Running};
use super::sensor::{ROOM, SERIAL, Sending, entry, metadata};

/// Reads the stream until a text and both kinds of pictures came: the text, and coordinates of the points.
fn listen(daemon: &Running) -> (Value, Vec<[f64; 3]>, usize) {
    let stream = TcpStream::connect(daemon.address).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    let url = format!("ws://{}/api/v1/stream", daemon.address);
    let (mut socket, _) = tungstenite::client(url, stream).unwrap();
    let (mut state, mut points_m, mut cells) = (None, Vec::new(), 0);
    while state.is_none() || points_m.len() < 500 || cells == 0 {
        match socket.read().unwrap() {
            Message::Text(text) => {
                let message: Value = serde_json::from_str(&text).unwrap();
                assert_eq!(message["type"], "status");
                state = Some(message["status"].clone());
            }
            Message::Binary(bytes) => {
                let count = u32::from_le_bytes(bytes[4..8].try_into().unwrap()) as usize;
                assert_eq!(bytes.len(), 32 + 8 * count);
                let number = |at: usize| f64::from(f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()));
                let axis = |at: usize, item: &[u8]| i16::from_le_bytes([item[2 * at], item[2 * at + 1]]);
                match bytes[0] {
                    POINTS_KIND => points_m.extend(bytes[32..].chunks(8).map(|item| {
                        [0, 1, 2].map(|at| number(16 + 4 * at) + number(28) * f64::from(axis(at, item)))
                    })),
                    COVERAGE_KIND => cells = count,
                    other => panic!("kind {other}"),
                }
            }
            _ => {}
        }
    }
    let _ = socket.close(None); // it may be reading meanwhile
    (state.unwrap(), points_m, cells)
}

pub fn two_sensors_and_a_rig_are_recorded_and_shown() {
    let rig = MockRig::start(MockConfig { start_urad: Some([0, 0]), ..MockConfig::default() }, 1).unwrap();
    let sections = format!(
        "[rig]\nport = \"{}\"\n[predict]\nmount = \"mount.json\"\nroom = \"{ROOM}\"\n",
        rig.path().display()
    );
    let bench = Bench::new(&["left", "right"], &sections);
    MountFile::new(vec![
        entry("left", "os1-16", [-0.2, 0.1], 0.0),
        entry("right", "vlp-16", [0.2, 0.1], 0.0),
    ])
    .write(&bench.path("mount.json"))
    .unwrap();
    let daemon = bench.start(&[]);
    let mount = |x_m: f64| Mount { x_m, z_m: 0.1, ..Mount::default() };
    let left =
        Sending::start(MockSensor::ouster(metadata(SERIAL, 1)), daemon.sensor(0), mount(-0.2), 0, None);
    let right = MockSensor::velodyne(
        sensors::velodyne::Product::Vlp16,
        sensors::velodyne::ReturnMode::Strongest,
        10.0,
    );
    let right = Sending::start(right.unwrap(), daemon.sensor(1), mount(0.2), 0, None);
    daemon.wait("both are read", |status| {
        status["sensors"]
            .as_array()
            .unwrap()
            .iter()
            .all(|sensor| sensor["complete_frames"].as_u64() > Some(2))
    });
    let session = daemon.order("/api/v1/recording/start", "{\"label\": \"first walk\"}");
    let (code, answer) = daemon.post("/api/v1/recording/start", "");
    assert_eq!(
        (code, &answer["error"]),
        (409, &format!("already recording {}", session["session"].as_str().unwrap()).into())
    );
    let status = daemon.wait("most of the promise is kept", |status| {
        let coverage = &status["coverage"];
        if status["recorder"]["recording"] != true {
            return false; // still of before it began
        }
        let (kept, promised) = (coverage["seen_of_predicted"].as_f64(), coverage["predicted"].as_f64());
        kept.zip(promised).is_some_and(|(kept, promised)| promised > 100.0 && kept > 0.8 * promised)
    });
    let coverage = &status["coverage"];
    let unexpected = coverage["seen"].as_f64().unwrap() - coverage["seen_of_predicted"].as_f64().unwrap();
    assert!(unexpected < 0.05 * coverage["predicted"].as_f64().unwrap(), "{coverage}");
    assert_eq!(coverage["pose"], "standing");
    let (state, points_m, cells) = listen(&daemon);
    assert_eq!(state["sensors"].as_array().unwrap().len(), 2);
    assert!(cells > 100);
    let walls: Vec<f64> = ROOM.split(',').map(|part| part.parse().unwrap()).collect();
    for point_m in &points_m {
        let nearest = (0..3)
            .flat_map(|axis| [(point_m[axis] - walls[axis]).abs(), (point_m[axis] - walls[axis + 3]).abs()])
            .fold(f64::INFINITY, f64::min);
        assert!(nearest < 0.03, "{point_m:?} is on no wall");
    }
    for sensor in status["sensors"].as_array().unwrap() {
        assert_eq!(
            (&sensor["state"], sensor["clock"]["state"].as_str()),
            (&"ok".into(), Some("utc")),
            "{sensor}"
        );
        assert!(sensor["points_per_s"].as_f64() > Some(10_000.0), "{sensor}");
        assert_eq!(sensor["losses"]["on_the_way"], 0, "{sensor}");
    }
    let metrics = daemon.get("/metrics").1;
    for line in [
        "outrigger_recording 1",
        "outrigger_sensor_up{sensor=\"left\"} 1",
        "outrigger_sensor_lost_packets_total{sensor=\"right\",at=\"kernel\"} 0",
        "outrigger_rig_connected 1",
        "# TYPE outrigger_recorder_latency_seconds summary",
    ] {
        assert!(metrics.lines().any(|other| other == line), "{line} in\n{metrics}");
    }
    let last = daemon.order("/api/v1/recording/stop", "");
    assert_eq!(
        (&last["complete"], &last["lost"], &last["why"]),
        (&true.into(), &0.into(), &"stopped".into())
    );
    drop((left, right));
    let (code, log) = daemon.end();
    assert_eq!(code, Some(0), "{log}");
    let session = bench.sessions().remove(0);
    assert!(session.problems().is_empty(), "{:?}", session.problems());
    assert_eq!(session.mount().unwrap().unwrap().sensors.len(), 2);
    assert!(session.dir().join("rig.toml").is_file() && session.metadata("left").unwrap().is_some());
    let begin: Vec<Value> = session.events().unwrap();
    assert_eq!((&begin[0]["event"], &begin[0]["label"]), (&"begin".into(), &"first walk".into()));
    let packets: u64 = session.manifest().sensors.iter().map(|sensor| sensor.packets).sum();
    assert_eq!(last["packets"], packets);
}

pub fn a_recording_is_cut_into_sessions_without_a_gap() {
    let bench = Bench::new(&["left"], "");
    let daemon = bench.start(&["--record", "--rotate-mib", "1"]);
    let sensor = Sending::ouster(daemon.sensor(0));
    daemon.wait("the third part", |status| status["recorder"]["part"].as_u64() >= Some(3));
    let sent = sensor.unplug();
    let (code, log) = daemon.end();
    assert_eq!(code, Some(0), "{log}");
    let sessions = bench.sessions();
    assert!(sessions.len() >= 3);
    let mut packets = 0;
    let mut before: Option<(String, u64)> = None;
    for session in &sessions {
        assert!(session.manifest().complete && session.problems().is_empty());
        packets += session.manifest().sensors[0].packets;
        let begin: Vec<Value> = session.events().unwrap();
        let follows = before.as_ref().map(|(name, _)| name.as_str());
        assert_eq!(begin[0]["follows"].as_str(), follows);
        let mut read = session.packets().unwrap();
        let mut last_ns = before.as_ref().map_or(0, |(_, last_ns)| *last_ns);
        while let Some((_, packet)) = read.next().unwrap() {
            assert!(packet.host_time_ns >= last_ns, "in order over all parts");
            last_ns = packet.host_time_ns;
        }
        before = Some((session.dir().file_name().unwrap().to_str().unwrap().to_owned(), last_ns));
    }
    assert_eq!(packets, sent, "each packet once");
}

pub fn the_service_manager_is_notified_of_the_end() {
    let bench = Bench::new(&["left"], "");
    let manager = UnixDatagram::bind(bench.path("notify")).unwrap();
    manager.set_read_timeout(Some(PATIENCE)).unwrap();
    let mut command = bench.command(&["--log-format", "json"]);
    command
        .env("NOTIFY_SOCKET", bench.path("notify"))
        .env("WATCHDOG_USEC", "600000")
        .env_remove("WATCHDOG_PID");
    let daemon = Running::start(command);
    let hear = || {
        let mut bytes = [0; 1024];
        let length = manager.recv(&mut bytes).unwrap();
        String::from_utf8_lossy(&bytes[..length]).into_owned()
    };
    let first = hear();
    assert!(first.contains("READY=1") && first.contains(&daemon.address.to_string()), "{first}");
    assert!((0..3).all(|_| hear().contains("WATCHDOG=1")));
    let (code, log) = daemon.end();
    assert_eq!(code, Some(0));
    assert!((0..10).any(|_| hear().contains("STOPPING=1")));
    let lines: Vec<Value> = log.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert!(lines.iter().any(|line| line["event"] == "stopping"), "{log}");
}
