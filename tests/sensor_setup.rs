//! Live sensors over their web interfaces: mock servers on loopback, whole and broken.

use std::io::{BufRead, BufReader, Read};
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use outrigger::live::setup::discover::{ousters, velodynes};
use outrigger::live::setup::{Http, Sensor, SensorState, SetupError, Wanted, warnings};
use outrigger::mock::web::{Announced, Announcer, Behind, MockWeb, OusterWeb, VelodyneWeb, WebFault};
use sensors::ouster::{Metadata, Profile, Synthetic, TimestampMode};
use serde_json::{Value, json};

use crate::support::{Case, case};

pub const CASES: &[Case] = &[
    case("an_ouster_is_read_set_and_saved", an_ouster_is_read_set_and_saved),
    case("a_velodyne_is_read_set_and_saved", a_velodyne_is_read_set_and_saved),
    case("faults_of_a_sensor_are_reported", faults_of_a_sensor_are_reported),
    case("broken_servers_are_distinguished_and_bounded", broken_servers_are_distinguished_and_bounded),
    case("refused_settings_are_named", refused_settings_are_named),
    case("metadata_of_another_sensor_are_noticed", metadata_of_another_sensor_are_noticed),
    case("sensors_are_discovered", sensors_are_discovered),
    case("the_verb_sets_a_mock_up_and_its_packets_follow", the_verb_sets_a_mock_up_and_its_packets_follow),
    case("recording_asks_the_sensor_for_its_metadata", recording_asks_the_sensor_for_its_metadata),
];

fn metadata(serial: u64, mode: TimestampMode) -> String {
    let mut wanted = Synthetic::new("os1-64", serial, Profile::from_name("RNG19_RFL8_SIG16_NIR16").unwrap());
    wanted.timestamp_mode = mode;
    Metadata::synthetic(&wanted).unwrap().to_json()
}

fn ouster() -> OusterWeb {
    OusterWeb::new(&metadata(992_200_000_777, TimestampMode::Ptp1588), false).unwrap()
}

fn serve(behind: Behind, fault: Option<WebFault>) -> MockWeb {
    MockWeb::start((Ipv4Addr::LOCALHOST, 0).into(), behind, fault).unwrap()
}

fn serve_ouster(web: OusterWeb) -> MockWeb {
    serve(Behind::Ouster(Box::new(web)), None)
}

fn sensor(web: &MockWeb) -> Sensor {
    Sensor::at(&web.address().to_string()).unwrap()
}

fn kinds(state: &SensorState) -> Vec<&'static str> {
    state.warnings.iter().map(|warning| warning.kind).collect()
}

fn within(wanted: Wanted) -> Wanted {
    Wanted { within: Duration::from_secs(20), ..wanted }
}

fn an_ouster_is_read_set_and_saved() {
    for old in [false, true] {
        let web = if old { ouster().with_old_firmware() } else { ouster() };
        let web = serve_ouster(web);
        let found = sensor(&web);
        let before = found.read().unwrap();
        assert_eq!(
            (before.model.as_str(), before.serial.as_str()),
            ("OS-1-64", "992200000777"),
            "{before:?}"
        );
        assert!(before.firmware.contains(if old { "v2.4.0" } else { "v3.2.0" }), "{before:?}");
        assert_eq!((before.status.as_str(), before.clock.locked), ("RUNNING", Some(true)), "{before:?}");
        assert_eq!(kinds(&before), ["destination"], "nothing else ails it: {before:?}");
        Metadata::parse(before.metadata.as_deref().unwrap(), "mock").unwrap();
        let wanted = within(Wanted {
            host: Some("auto".into()),
            port: Some(17502),
            auxiliary_port: Some(17503),
            settings: vec![
                ("lidar_mode".into(), json!("512x20")),
                ("azimuth_window".into(), json!([90_000, 270_000])),
            ],
            save: true,
            ..Wanted::default()
        });
        let configured = found.configure(&wanted).unwrap();
        assert_eq!((configured.refused().count(), configured.saved), (0, true), "{configured:#?}");
        let after = &configured.state;
        assert_eq!(
            (after.destination.host.as_str(), after.destination.port),
            ("127.0.0.1", Some(17502)),
            "{after:?}"
        );
        assert_eq!((after.status.as_str(), kinds(after)), ("RUNNING", vec![]), "{after:?}");
        assert_eq!(after.settings["azimuth_window"], json!([90_000, 270_000]));
        let Behind::Ouster(kept) = &*web.behind() else { panic!() };
        assert_eq!(
            (&kept.saved()["udp_port_imu"], &kept.saved()["lidar_mode"]),
            (&json!(17503), &json!("512x20"))
        );
    }
    // without --save nothing is kept
    let web = serve_ouster(ouster());
    let wanted = within(Wanted { port: Some(9000), ..Wanted::default() });
    assert!(!sensor(&web).configure(&wanted).unwrap().saved);
    let Behind::Ouster(kept) = &*web.behind() else { panic!() };
    assert_ne!(kept.saved()["udp_port_lidar"], json!(9000));
}

fn a_velodyne_is_read_set_and_saved() {
    let web = serve(Behind::Velodyne(VelodyneWeb::new("VLP-16", "AG12345678")), None);
    let found = sensor(&web);
    let before = found.read().unwrap();
    assert_eq!((before.model.as_str(), before.serial.as_str()), ("VLP-16", "AG12345678"));
    assert_eq!((before.destination.port, before.clock.locked), (Some(2368), Some(true)));
    assert_eq!(kinds(&before), ["destination"], "{before:?}");
    assert!((30.0..60.0).contains(&before.temperature_c.unwrap()), "{before:?}");
    let wanted = within(Wanted {
        host: Some("192.168.1.7".into()),
        port: Some(2370),
        settings: vec![("rpm".into(), json!(1200)), ("returns".into(), json!("Dual"))],
        save: true,
        ..Wanted::default()
    });
    let configured = found.configure(&wanted).unwrap();
    assert_eq!((configured.refused().count(), configured.saved), (0, true), "{configured:#?}");
    assert_eq!(kinds(&configured.state), Vec::<&str>::new(), "{:?}", configured.state);
    let Behind::Velodyne(kept) = &*web.behind() else { panic!() };
    let kept = kept.saved();
    assert_eq!(
        kept["host"],
        json!({ "addr": "192.168.1.7", "dport": 2370, "tport": 8308 }),
        "the rest as it was"
    );
    assert_eq!((&kept["rpm"], &kept["returns"]), (&json!(1200), &json!("Dual")));
}

fn faults_of_a_sensor_are_reported() {
    let mut ill = ouster().sending_to("10.0.0.2:7502".parse().unwrap(), None);
    ill.alert("OVERTEMP", "Unit internal temperature too high");
    ill.alert("SHOT_LIMITING", "Shot limiting mode is active");
    ill.alert("ETHERNET_LINK_BAD", "Link not gigabit");
    ill.set_clock_locked(false);
    ill.set_temperature_c(83.0);
    let state = sensor(&serve_ouster(ill)).read().unwrap();
    assert_eq!(
        kinds(&state),
        ["clock_not_locked", "thermal", "shot_limiting", "alert", "thermal"],
        "{state:#?}"
    );
    assert!(state.clock.detail.contains("LISTENING"), "{state:?}");
    let mut ill = VelodyneWeb::new("VLP-16", "1").sending_to("10.0.0.2:2368".parse().unwrap(), None);
    ill.disable_laser();
    ill.set_pulse("Absent");
    ill.cut_power_of_head();
    let state = sensor(&serve(Behind::Velodyne(ill), None)).read().unwrap();
    assert_eq!(kinds(&state), ["laser_disabled", "clock_not_locked", "thermal"], "{state:#?}");
    // a pulse for the other kind of Ouster clock
    let mut pulse = OusterWeb::new(&metadata(5, TimestampMode::SyncPulseIn), false).unwrap();
    pulse.set_clock_locked(false);
    let state = sensor(&serve_ouster(pulse)).read().unwrap();
    assert!(
        state.clock.detail.contains("NMEA not locked") && kinds(&state).contains(&"clock_not_locked"),
        "{state:?}"
    );
}

fn broken_servers_are_distinguished_and_bounded() {
    let said = |fault: WebFault| {
        let web = serve(Behind::Ouster(Box::new(ouster())), Some(fault));
        let address = web.address().to_string();
        let http =
            Http::with_patience(&address, Duration::from_millis(500), Duration::from_millis(1500)).unwrap();
        let begun = Instant::now();
        let error = Sensor::behind(&http).and_then(|sensor| sensor.read()).unwrap_err();
        assert!(begun.elapsed() < Duration::from_secs(20), "{fault:?} took {:?}", begun.elapsed());
        assert!(error.to_string().contains(&address), "{error}");
        error
    };
    let is_broken = |fault| matches!(said(fault), SetupError::Broken { .. } | SetupError::Unreachable { .. });
    assert!(is_broken(WebFault::Refuses) && is_broken(WebFault::Half) && is_broken(WebFault::Slow));
    assert!(is_broken(WebFault::Endless), "4 MiB are enough");
    for (fault, words) in
        [(WebFault::WrongJson, "It works!"), (WebFault::OtherJson, "[1,2]"), (WebFault::Elsewhere, "302")]
    {
        let error = said(fault);
        assert!(matches!(error, SetupError::Unknown { .. }), "{fault:?}: {error}");
        assert!(error.to_string().contains(words), "{fault:?}: {error}");
    }
    let starting = said(WebFault::ServerError);
    assert!(
        matches!(starting, SetupError::Status { status: 503, .. })
            && starting.to_string().contains("ask again"),
        "no stranger: {starting}"
    );
    assert!(said(WebFault::Endless).to_string().contains("longer than 4 MiB"));
    // nobody there
    let free = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let nobody = Sensor::at(&format!("127.0.0.1:{free}")).unwrap_err();
    assert!(
        matches!(nobody, SetupError::Unreachable { .. }) && nobody.to_string().contains("powered"),
        "{nobody}"
    );
    for address in ["", "a b", "http://x/y", "user@host", "host/path"] {
        assert!(matches!(Http::new(address), Err(SetupError::Address { .. })), "{address}");
    }
    // breaks after it was recognised
    let web = serve_ouster(ouster());
    let found = sensor(&web);
    web.set_fault(Some(WebFault::OtherJson));
    assert!(matches!(found.config(), Err(SetupError::Unexpected { .. })));
}

fn refused_settings_are_named() {
    let wanted = within(Wanted { port: Some(9000), save: true, ..Wanted::default() });
    let web = serve(Behind::Ouster(Box::new(ouster())), Some(WebFault::Reverts));
    let configured = sensor(&web).configure(&wanted).unwrap();
    let refused: Vec<_> = configured.refused().collect();
    assert_eq!(
        (refused.len(), refused[0].key.as_str(), configured.saved),
        (1, "udp_port_lidar", false),
        "{configured:?}"
    );
    let web = serve(Behind::Velodyne(VelodyneWeb::new("VLP-16", "1")), Some(WebFault::Reverts));
    let configured = sensor(&web).configure(&wanted).unwrap();
    assert_eq!((configured.refused().count(), configured.saved), (1, false), "{configured:?}");
    let unknown = Wanted { settings: vec![("spin".into(), json!(1))], ..wanted.clone() };
    for web in [serve_ouster(ouster()), serve(Behind::Velodyne(VelodyneWeb::new("VLP-16", "1")), None)] {
        let error = sensor(&web).configure(&unknown).unwrap_err();
        assert!(matches!(error, SetupError::Setting { .. }) && error.to_string().contains("spin"), "{error}");
    }
    // bound to its packets: the sensor says why
    let web = serve_ouster(OusterWeb::new(&metadata(6, TimestampMode::Ptp1588), true).unwrap());
    let mode = within(Wanted { settings: vec![("lidar_mode".into(), json!("512x10"))], ..Wanted::default() });
    let error = sensor(&web).configure(&mode).unwrap_err();
    assert!(
        matches!(error, SetupError::Status { status: 400, .. }) && error.to_string().contains("lidar_mode"),
        "{error}"
    );
    let web = serve(Behind::Ouster(Box::new(ouster())), Some(WebFault::NeverReady));
    let hasty = Wanted { within: Duration::from_millis(900), ..wanted };
    let error = sensor(&web).configure(&hasty).unwrap_err();
    assert!(
        matches!(error, SetupError::NotReady { .. }) && error.to_string().contains("INITIALIZING"),
        "{error}"
    );
}

fn metadata_of_another_sensor_are_noticed() {
    let ours = metadata(992_200_000_777, TimestampMode::Ptp1588);
    let live = sensor(&serve_ouster(ouster())).read().unwrap().metadata.unwrap();
    assert_eq!(warnings::of_metadata(&live, &ours).unwrap(), []);
    let theirs = metadata(5, TimestampMode::SyncPulseIn);
    let found = warnings::of_metadata(&live, &theirs).unwrap();
    let named = |word: &str| {
        found.iter().any(|warning| warning.kind == "metadata_mismatch" && warning.text.contains(word))
    };
    assert!(found.len() == 2 && named("prod_sn") && named("timestamp_mode"), "{found:?}");
    assert!(warnings::of_metadata(&live, "{").is_err());
    // the flat shape of older files
    let flat = json!({ "prod_sn": "5", "lidar_mode": "1024x10" }).to_string();
    assert_eq!(warnings::of_metadata(&live, &flat).unwrap().len(), 1);
}

/// The responder writes its answer byte by byte and knows nothing of the library that reads it.
fn sensors_are_discovered() {
    let announced = Announced {
        serial: "992200000777".into(),
        part: "840-103575-06".into(),
        firmware: "v3.1.0".into(),
        address: Ipv4Addr::LOCALHOST,
        port: 18080,
    };
    let loopback = Some(Ipv4Addr::LOCALHOST.into());
    assert_eq!(ousters(Duration::from_millis(300), loopback).unwrap(), []);
    let responder = Announcer::start(announced, Ipv4Addr::LOCALHOST).unwrap();
    let end = Instant::now() + Duration::from_secs(20);
    let found = loop {
        let found = ousters(Duration::from_millis(1500), loopback).unwrap();
        if !found.is_empty() || Instant::now() > end {
            break found;
        }
    };
    drop(responder);
    assert_eq!(found.len(), 1, "{found:?}");
    let sensor = &found[0];
    assert_eq!(
        (sensor.serial.as_str(), sensor.part.as_str(), sensor.firmware.as_str()),
        ("992200000777", "840-103575-06", "v3.1.0")
    );
    assert_eq!((sensor.name.as_str(), sensor.port), ("os-992200000777.local.", 18080));
    assert_eq!(sensor.addresses, [std::net::IpAddr::from(Ipv4Addr::LOCALHOST)]);
    // a Velodyne shows itself by what it sends
    let port = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let sender = std::thread::spawn(move || {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        for _ in 0..40 {
            for length in [1206, 100] {
                let _ = socket.send_to(&vec![0; length], ("127.0.0.1", port));
            }
            std::thread::sleep(Duration::from_millis(10));
        }
    });
    let found = velodynes(Duration::from_millis(500), Ipv4Addr::LOCALHOST.into(), port).unwrap();
    sender.join().unwrap();
    assert_eq!(found.len(), 1, "{found:?}");
    assert!(
        velodynes(Duration::from_millis(10), "192.0.2.77".parse().unwrap(), port).is_err(),
        "no such address here"
    );
}

/// Ends a program that a failed case would leave behind.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn outrigger(arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_outrigger"));
    command.args(arguments).env_remove("OUTRIGGER_JSON").env_remove("OUTRIGGER_CONFIG").output().unwrap()
}

fn document(output: &Output, code: i32) -> Value {
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{said}{}", String::from_utf8_lossy(&output.stdout));
    crate::support::document(&output.stdout).unwrap()
}

/// A mock sensor with a web interface, sending to a port; its web address.
fn mock(to: SocketAddr, more: &[&str]) -> (Running, String) {
    let mut program = Command::new(env!("CARGO_BIN_EXE_outrigger"));
    let to = to.to_string();
    program.args([
        "mock",
        "sensor",
        "--json",
        "--model",
        "os1-16",
        "--columns",
        "512",
        "--http",
        "0",
        "--to",
        &to,
    ]);
    let mut running =
        Running(program.args(more).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap());
    let mut line = String::new();
    BufReader::new(running.0.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let ready: Value = serde_json::from_str(&line).unwrap();
    (running, ready["http"].as_str().unwrap().to_owned())
}

fn receiver() -> UdpSocket {
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    socket
}

fn the_verb_sets_a_mock_up_and_its_packets_follow() {
    let (first, second) = (receiver(), receiver());
    let (_mock, host) = mock(first.local_addr().unwrap(), &[]);
    let mut bytes = [0; 65_536];
    assert!(first.recv(&mut bytes).unwrap() > 1000);
    let info = document(&outrigger(&["sensor", "info", &host, "--json"]), 0);
    assert_eq!(info["sensors"][0]["destination"]["port"], first.local_addr().unwrap().port(), "{info:#}");
    let port = second.local_addr().unwrap().port().to_string();
    let set = document(
        &outrigger(&[
            "sensor",
            "configure",
            &host,
            "--dest",
            "auto",
            "--lidar-port",
            &port,
            "--save",
            "--json",
        ]),
        0,
    );
    assert_eq!((&set["saved"], &set["changes"][1]["taken"]), (&true.into(), &true.into()), "{set:#}");
    assert!(second.recv(&mut bytes).unwrap() > 1000, "packets come to the new port");
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("left.json");
    let file = file.to_str().unwrap();
    document(&outrigger(&["sensor", "info", &host, "--save-metadata", file, "--json"]), 0);
    let compared = document(&outrigger(&["sensor", "info", &host, "--meta", file, "--json"]), 0);
    assert_eq!((&compared["sensors"][0]["warnings"], &compared["agrees"]), (&json!([]), &json!(true)));
    let said = outrigger(&["sensor", "info", &host, "--meta", file]);
    assert!(String::from_utf8_lossy(&said.stdout).contains("agrees with"), "{said:?}");
    let narrower = "azimuth_window=[90000,270000]";
    document(&outrigger(&["sensor", "configure", &host, "--set", narrower, "--json"]), 0);
    let compared = document(&outrigger(&["sensor", "info", &host, "--meta", file, "--json"]), 3);
    let warnings = compared["sensors"][0]["warnings"].to_string();
    assert!(warnings.contains("azimuth_window") && compared["agrees"] == false, "{compared:#}");
    let other = folder.path().join("empty.json");
    std::fs::write(&other, "{}").unwrap();
    let refused = outrigger(&["sensor", "info", &host, "--meta", other.to_str().unwrap()]);
    assert!(
        refused.status.code() == Some(1) && String::from_utf8_lossy(&refused.stderr).contains("empty.json"),
        "no metadata: {refused:?}"
    );
    // where nothing gets through to: the sensor goes on, and can be told otherwise
    document(&outrigger(&["sensor", "configure", &host, "--dest", "203.0.113.7", "--json"]), 0);
    std::thread::sleep(Duration::from_millis(300));
    document(&outrigger(&["sensor", "configure", &host, "--dest", "auto", "--json"]), 0);
    for wrong in [["--dest", "300.1.1.1"], ["--set", "azimuth_window=[90000,"]] {
        assert_eq!(outrigger(&["sensor", "configure", &host, wrong[0], wrong[1]]).status.code(), Some(2));
    }
    let twice = outrigger(&["sensor", "configure", &host, "--dest", "auto", "--set", "udp_dest=1.2.3.4"]);
    let said = String::from_utf8_lossy(&twice.stderr);
    assert!(twice.status.code() == Some(2) && said.contains("--set udp_dest"), "{said}");
    // a mode that this mock's packets do not have
    let refused = outrigger(&["sensor", "configure", &host, "--set", "lidar_mode=2048x10"]);
    let said = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert_eq!(refused.status.code(), Some(1), "{said}");
    assert!(said.contains("status 400: lidar_mode: this mock's packets stay"), "{said}");
    let nothing = outrigger(&["sensor", "configure", &host]);
    assert_eq!(nothing.status.code(), Some(2));
    let (_mock, host) = mock(first.local_addr().unwrap(), &["--http-fault", "reverts"]);
    let kept = document(&outrigger(&["sensor", "configure", &host, "--lidar-port", &port, "--json"]), 3);
    assert_eq!(kept["changes"][0]["taken"], false, "{kept:#}");
}

fn recording_asks_the_sensor_for_its_metadata() {
    let folder = tempfile::tempdir().unwrap();
    let port = receiver().local_addr().unwrap().port(); // free again at once
    let (_mock, host) = mock(SocketAddr::from((Ipv4Addr::LOCALHOST, port)), &[]);
    let config = folder.path().join("rig.toml");
    let text = format!(
        "format = \"outrigger-rig/1\"\n[[sensor]]\nname = \"left\"\nmodel = \"os1-16\"\nlisten = \"127.0.0.1:{port}\"\nhost = \"{host}\"\n"
    );
    std::fs::write(&config, text).unwrap();
    let session = folder.path().join("walk");
    let (config, session) = (config.to_str().unwrap(), session.to_str().unwrap());
    let recorded = outrigger(&["record", "--config", config, "--out", session, "--duration", "2", "--json"]);
    let document = document(&recorded, 0);
    assert!(document["sensors"][0]["packets"].as_u64().unwrap() > 10, "{document:#}");
    let inspected = outrigger(&["inspect", session, "--json"]);
    let inspected: Value = crate::support::document(&inspected.stdout).unwrap();
    assert!(
        inspected["sensors"][0]["frames"].as_u64().unwrap() > 2,
        "decoded with what the sensor said: {inspected:#}"
    );
    // by flag, and a sensor that does not answer
    let listen = format!("left=127.0.0.1:{port}:http://{host}");
    let again = folder.path().join("again");
    let again = again.to_str().unwrap();
    let flags = ["record", "--listen", &listen, "--out", again, "--duration", "0.5", "--json"];
    assert_eq!(outrigger(&flags).status.code(), Some(0));
    let listen = format!("left=127.0.0.1:{port}:http://127.0.0.1:9");
    let absent = outrigger(&["record", "--listen", &listen, "--out", "never", "--duration", "1"]);
    let mut said = String::new();
    absent.stderr.as_slice().read_to_string(&mut said).unwrap();
    assert_eq!(absent.status.code(), Some(1));
    assert!(said.contains("left: metadata") && said.contains("powered"), "{said}");
}
