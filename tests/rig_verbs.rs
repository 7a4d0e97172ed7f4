//! The verbs `rig` and `mock rig` as a user meets them.

use std::io::{BufRead, BufReader, Read};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use outrigger::mock::rig::{MockConfig, MockRig};
use outrigger::rig::{MountFile, SensorEntry};
use serde_json::Value;

use crate::support::{Case, case};

pub const CASES: &[Case] = &[
    case("a_mount_file_is_applied_and_read_back", a_mount_file_is_applied_and_read_back),
    case("nothing_moves_without_being_armed", nothing_moves_without_being_armed),
    case(
        "ctrl_c_holds_and_ctrl_c_again_is_an_emergency_stop",
        ctrl_c_holds_and_ctrl_c_again_is_an_emergency_stop,
    ),
    case(
        "watching_goes_on_when_the_rig_comes_back_elsewhere",
        watching_goes_on_when_the_rig_comes_back_elsewhere,
    ),
    case("a_rig_with_switches_is_homed_by_the_verb", a_rig_with_switches_is_homed_by_the_verb),
    case("what_nothing_measures_has_no_uncertainty", what_nothing_measures_has_no_uncertainty),
    case("the_mock_runs_until_it_is_interrupted", the_mock_runs_until_it_is_interrupted),
];

fn outrigger(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_outrigger"))
        .args(arguments)
        .env_remove("OUTRIGGER_RIG_PORT")
        .env_remove("OUTRIGGER_JSON")
        .output()
        .unwrap()
}

fn document(output: &Output) -> Value {
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{said}");
    crate::support::document(&output.stdout).unwrap()
}

fn refusal(output: &Output) -> String {
    ended_with(1, output)
}

/// What is wrong with the command line itself.
fn misuse(output: &Output) -> String {
    ended_with(2, output)
}

fn ended_with(code: i32, output: &Output) -> String {
    assert_eq!(output.status.code(), Some(code), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(output.stdout.is_empty(), "{}", String::from_utf8_lossy(&output.stdout));
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn mock(seed: u64) -> (MockRig, String) {
    let mock = MockRig::start(MockConfig::default(), seed).unwrap();
    let port = mock.path().display().to_string();
    (mock, port)
}

fn sensor(name: &str, pitch_deg: f64) -> SensorEntry {
    SensorEntry {
        name: name.into(),
        model: "os1-64".into(),
        x_m: 0.1,
        y_m: 0.0,
        z_m: 0.0,
        pitch_deg,
        ..SensorEntry::default()
    }
}

fn a_mount_file_is_applied_and_read_back() {
    let (_mock, port) = mock(21);
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("mount.json");
    let rolled = SensorEntry { roll_deg: -4.5, ..sensor("left", -11.0) };
    MountFile::new(vec![rolled, sensor("right", 12.0)]).write(&file).unwrap();
    let file = file.to_str().unwrap();
    // not homed: the message says what to do
    let said = refusal(&outrigger(&["rig", "apply", file, "--port", &port, "--arm"]));
    assert!(said.contains("rig home --arm"), "{said}");
    document(&outrigger(&["rig", "home", "--port", &port, "--arm", "--json"]));
    let command = ["rig", "apply", file, "--sensors", "right,left", "--port", &port, "--arm", "--json"];
    let ended = outrigger(&command);
    let said = String::from_utf8_lossy(&ended.stderr);
    assert!(
        said.contains("left: the rig sets its pitch alone; no servo sets roll -4.50 degrees, x +0.100 m"),
        "{said}"
    );
    assert!(said.contains("no servo sets x +0.100 m: see that it is screwed on so"), "{said}");
    let applied = document(&ended);
    for (axis, pitch_deg) in [12.0, -11.0].into_iter().enumerate() {
        let axis = &applied["axes"][axis];
        assert!((axis["position_deg"].as_f64().unwrap() - pitch_deg).abs() < 0.3, "{applied:#}");
        assert_eq!((&axis["state"], &axis["source"]), (&"holding".into(), &"measured".into()), "{applied:#}");
        assert!(
            axis["age_ms"].as_f64().unwrap() < 1000.0 && axis["faults"] == Value::Array(vec![]),
            "{applied:#}"
        );
    }
    assert!((applied["applied"][0]["target_deg"].as_f64().unwrap() - 12.0).abs() < 1e-3, "{applied:#}");
    let said =
        refusal(&outrigger(&["rig", "apply", file, "--sensors", "right,up", "--port", &port, "--arm"]));
    assert!(said.contains("no sensor `up`; there are left, right"), "{said}");
    let said =
        refusal(&outrigger(&["rig", "apply", file, "--sensors", "left,left", "--port", &port, "--arm"]));
    assert!(said.contains("left is given twice"), "{said}");
    let three = folder.path().join("three.json");
    let sensors = ["left", "right", "level"].map(|name| sensor(name, 0.0));
    MountFile::new(sensors.to_vec()).write(&three).unwrap();
    let three = three.to_str().unwrap();
    let said = refusal(&outrigger(&["rig", "apply", three, "--port", &port, "--dry-run"]));
    assert!(said.contains("three.json has 3 sensors, the rig 2 axes: --sensors"), "{said}");
    // the program that moved it is gone, and it still holds
    let status = document(&outrigger(&["rig", "status", "--port", &port, "--json"]));
    assert!((status["axes"][0]["position_deg"].as_f64().unwrap() - 12.0).abs() < 0.3, "{status:#}");
    assert_eq!(
        (&status["armed"], &status["axes"][0]["state"]),
        (&false.into(), &"idle".into()),
        "{status:#}"
    );
}

fn nothing_moves_without_being_armed() {
    let (_mock, port) = mock(22);
    let before = document(&outrigger(&["rig", "status", "--port", &port, "--json"]));
    let said = misuse(&outrigger(&["rig", "set", "10", "-10", "--port", &port]));
    assert!(said.contains("--arm") && said.contains("nothing was moved"), "{said}");
    let dry = document(&outrigger(&["rig", "set", "10", "-10", "--port", &port, "--dry-run", "--json"]));
    assert_eq!(dry["moves"][1]["to_deg"], -10.0, "{dry:#}");
    let said = refusal(&outrigger(&["rig", "set", "10", "-80", "--port", &port, "--dry-run"]));
    assert!(said.contains("axis 1") && said.contains("the firmware's limits"), "{said}");
    let limited = ["rig", "set", "10", "-10", "--port", &port, "--dry-run", "--limits-deg", "-5,5"];
    let said = refusal(&outrigger(&limited));
    assert!(said.contains("axis 0") && said.contains("the configured limits"), "{said}");
    let said = refusal(&outrigger(&["rig", "set", "10", "--port", &port, "--dry-run"]));
    assert!(said.contains("1 pitch for a rig with 2 axes"), "{said}");
    for (flag, value, expected) in [
        ("--approach-deg", "100", "below 90"),
        ("--approach-deg", "-3", "below 90"),
        ("--timeout-s", "1e30", "up to 3600 s"),
        ("--tolerance-deg", "nan", "below 90"),
    ] {
        let set = outrigger(&["rig", "set", "0", "0", "--port", &port, "--dry-run", flag, value]);
        let said = String::from_utf8_lossy(&set.stderr);
        assert!(set.status.code() == Some(2) && said.contains(flag) && said.contains(expected), "{said}");
    }
    for (verb, flag) in [
        ("status", "--arm"),
        ("clear", "--dry-run"),
        ("watch", "--limits-deg=-5,5"),
        ("home", "--approach-deg=2"),
    ] {
        let said = outrigger(&["rig", verb, "--port", &port, flag]);
        let words = String::from_utf8_lossy(&said.stderr);
        let flag = flag.split('=').next().unwrap();
        assert!(said.status.code() == Some(2) && words.contains(flag), "{verb} {flag}: {words}");
        assert!(words.contains(&format!("`rig {verb}` has no use for it")), "{words}");
        assert!(words.contains(&format!("Usage: outrigger rig {verb}")), "{words}");
        let help = outrigger(&["rig", verb, "--help"]).stdout;
        let help = String::from_utf8_lossy(&help);
        assert!(help.contains("--port") && !help.contains(flag), "{help}");
    }
    for time in ["nan", "-1", "inf", "1e19"] {
        let watched = outrigger(&["rig", "watch", "--port", &port, "--for", time]);
        let said = String::from_utf8_lossy(&watched.stderr);
        assert!(watched.status.code() == Some(2) && said.contains("expected seconds"), "{time}: {said}");
    }
    // a file that says to try only does not win over who types --arm
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("rig.toml");
    std::fs::write(
        &config,
        format!("format = \"outrigger-rig/1\"\n[rig]\nport = {port:?}\ndry_run = true\n"),
    )
    .unwrap();
    let tried = document(&outrigger(&["rig", "home", "--config", config.to_str().unwrap(), "--json"]));
    assert_eq!(tried["dry_run"], true, "{tried:#}");
    let homed =
        document(&outrigger(&["rig", "home", "--arm", "--config", config.to_str().unwrap(), "--json"]));
    assert_eq!(homed["axes"][0]["homed"], true, "{homed:#}");
    let said = refusal(&outrigger(&["rig", "status", "--port", "/dev/null"]));
    assert!(said.contains("cannot open /dev/null: it is no serial device"), "{said}");
    let said = refusal(&outrigger(&["rig", "status", "--port", &port, "--node", "5"]));
    assert!(said.contains("node 1 sends") && said.contains("--node 1"), "{said}");
    for port in ["dynamixel:/dev/null@57600:1,1", "cia402:none7@1,200"] {
        let said = refusal(&outrigger(&["rig", "status", "--port", port]));
        assert!(said.contains("two different"), "{said}");
    }
    let after = document(&outrigger(&["rig", "status", "--port", &port, "--json"]));
    for axis in 0..2 {
        let at = |status: &Value| status["axes"][axis]["position_deg"].as_f64().unwrap();
        assert!((at(&before) - at(&after)).abs() < 0.1, "{before:#} {after:#}");
    }
    let said = refusal(&outrigger(&["rig", "status", "--port", "/dev/no-such-rig"]));
    assert!(said.contains("rig cable: cannot open /dev/no-such-rig"), "{said}");
    let said = misuse(&outrigger(&["rig", "status"]));
    assert!(said.contains("--port"), "{said}");
}

fn ctrl_c_holds_and_ctrl_c_again_is_an_emergency_stop() {
    let (mock, port) = mock(23);
    document(&outrigger(&["rig", "home", "--port", &port, "--arm", "--json"]));
    let mut mover = Command::new(env!("CARGO_BIN_EXE_outrigger"));
    mover.args(["rig", "set", "58", "-58", "--port", &port, "--arm"]).stderr(Stdio::piped());
    let mut mover = Running(mover.spawn().unwrap());
    let started = Instant::now();
    while mock.true_positions_rad().unwrap()[0] < 0.4 {
        assert!(started.elapsed() < Duration::from_secs(20), "it never moved");
        std::thread::sleep(Duration::from_millis(5));
    }
    let pid = Pid::from_raw(mover.0.id() as i32);
    kill(pid, Signal::SIGINT).unwrap();
    kill(pid, Signal::SIGINT).ok(); // two of the same may be delivered as one
    std::thread::sleep(Duration::from_millis(300)); // what comes sooner is the same wish
    let _ = kill(pid, Signal::SIGINT); // it may have ended by the first
    assert_eq!(mover.0.wait().unwrap().code(), Some(1));
    let mut said = String::new();
    mover.0.stderr.take().unwrap().read_to_string(&mut said).unwrap();
    assert!(said.contains("holding; Ctrl-C again for e-stop") && said.contains("rig: interrupted"), "{said}");
    let at = mock.true_positions_rad().unwrap();
    std::thread::sleep(Duration::from_millis(300));
    let later = mock.true_positions_rad().unwrap();
    assert!(at[0] < 0.95 && (later[0] - at[0]).abs() < 0.15, "{at:?} {later:?}");
    // by the second the e-stop is latched, and status says that by its exit code
    let status = outrigger(&["rig", "status", "--port", &port, "--json"]);
    let status: Value = crate::support::document(&status.stdout).unwrap();
    assert_eq!(status["armed"], false, "{status:#}");
}

/// The line breaks and the rig comes back under another name, as a USB adapter does; the address is a link that follows.
fn watching_goes_on_when_the_rig_comes_back_elsewhere() {
    let (first, port) = mock(24);
    let folder = tempfile::tempdir().unwrap();
    let link = folder.path().join("rig");
    std::os::unix::fs::symlink(&port, &link).unwrap();
    let mut watcher = Command::new(env!("CARGO_BIN_EXE_outrigger"));
    watcher.args(["rig", "watch", "--reconnect", "--json", "--for", "60", "--port"]).arg(&link);
    let mut watcher = Running(watcher.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap());
    let mut lines = BufReader::new(watcher.0.stdout.take().unwrap()).lines();
    lines.next().unwrap().unwrap();
    first.close();
    std::fs::remove_file(&link).unwrap();
    let (second, port) = mock(25);
    let at = second.true_positions_rad().unwrap()[0];
    std::os::unix::fs::symlink(&port, &link).unwrap();
    let back = lines.any(|line| {
        let report: outrigger::drive::WatchedAxis = serde_json::from_str(&line.unwrap()).unwrap();
        report.axis == 0 && (report.position_deg.to_radians() - at).abs() < 2e-3
    });
    assert!(back, "nothing came from the rig's new name");
    kill(Pid::from_raw(watcher.0.id() as i32), Signal::SIGINT).unwrap();
    assert_eq!(watcher.0.wait().unwrap().code(), Some(0));
    let mut said = String::new();
    watcher.0.stderr.take().unwrap().read_to_string(&mut said).unwrap();
    assert!(said.contains("hung up") && said.contains("the rig is back; home it before it moves"), "{said}");
}

/// Ends a program that a failed case would leave behind.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn a_rig_with_switches_is_homed_by_the_verb() {
    let said = outrigger(&["mock", "rig", "--home-switch", "up"]);
    assert_eq!(said.status.code(), Some(2));
    let mut program = Command::new(env!("CARGO_BIN_EXE_outrigger"));
    program
        .args(["mock", "rig", "--seed", "3", "--home-switch", "-5", "--encoder-on-motor"])
        .stdout(Stdio::piped());
    let mut running = Running(program.spawn().unwrap());
    let mut port = String::new();
    BufReader::new(running.0.stdout.take().unwrap()).read_line(&mut port).unwrap();
    let port = port.trim();
    let dry = document(&outrigger(&["rig", "home", "--port", port, "--dry-run", "--json"]));
    assert_eq!(dry["homing_moves"], true, "{dry:#}");
    let homed = document(&outrigger(&["rig", "home", "--port", port, "--arm", "--json"]));
    for axis in 0..2 {
        assert!((homed["axes"][axis]["position_deg"].as_f64().unwrap() + 5.0).abs() < 0.5, "{homed:#}");
    }
    let set = document(&outrigger(&["rig", "set", "3", "2", "--port", port, "--arm", "--json"]));
    let applied = &set["applied"][0];
    assert_eq!(applied["approach"], "from_below", "{set:#}");
    assert!(applied["readings"].as_u64().unwrap() > 1, "{set:#}");
    assert!((0.01..0.1).contains(&applied["uncertainty_deg"].as_f64().unwrap()), "{set:#}");
}

fn what_nothing_measures_has_no_uncertainty() {
    let mut program = Command::new(env!("CARGO_BIN_EXE_outrigger"));
    program.args(["mock", "rig", "--seed", "3", "--pulse"]).stdout(Stdio::piped());
    let mut running = Running(program.spawn().unwrap());
    let mut port = String::new();
    BufReader::new(running.0.stdout.take().unwrap()).read_line(&mut port).unwrap();
    let set = ["rig", "set", "5", "-5", "--home", "--arm", "--port", port.trim(), "--json"];
    let moved = document(&outrigger(&set));
    for axis in [&moved["axes"][0], &moved["applied"][0]] {
        assert_eq!(axis["source"], "commanded", "{moved:#}");
        assert_eq!(axis.get("uncertainty_deg"), Some(&Value::Null), "{moved:#}");
    }
}

fn the_mock_runs_until_it_is_interrupted() {
    let said = outrigger(&["mock", "rig", "--fault", "melt@1"]);
    assert_eq!(said.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&said.stderr).contains("known are stuck"));
    let mut program = Command::new(env!("CARGO_BIN_EXE_outrigger"));
    program.args(["mock", "rig", "--seed", "3", "--fault", "stuck:1@0"]).stdout(Stdio::piped());
    let mut running = Running(program.spawn().unwrap());
    let mut port = String::new();
    BufReader::new(running.0.stdout.take().unwrap()).read_line(&mut port).unwrap();
    let port = port.trim();
    document(&outrigger(&["rig", "home", "--port", port, "--arm", "--json"]));
    let said = refusal(&outrigger(&["rig", "set", "30", "-30", "--port", port, "--arm"]));
    assert!(said.contains("fault stall (axis 1)") && said.contains("outrigger rig clear"), "{said}");
    let watched = outrigger(&["rig", "watch", "--for", "0.5", "--port", port, "--json"]);
    let lines = String::from_utf8(watched.stdout).unwrap();
    let reports: Vec<Value> = lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let stalled = |report: &&Value| report["axis"] == 1 && report["faults"] == serde_json::json!(["stall"]);
    let watched = reports.iter().find(stalled).unwrap();
    // a script that reads the state reads that of a fault, too
    let failed = outrigger(&["rig", "status", "--port", port, "--json"]);
    let status: Value = crate::support::document(&failed.stdout).unwrap();
    let axis = status["axes"][1].as_object().unwrap();
    assert_eq!(axis["faults"], watched["faults"], "{status:#}");
    assert!(
        watched.as_object().unwrap().keys().all(|key| key == "time_ns" || axis.contains_key(key)),
        "{lines}"
    );
    let said = String::from_utf8_lossy(&failed.stderr);
    assert!(failed.status.code() == Some(1) && said.contains("stall (axis 1)"), "{said}");
    assert!(said.contains("outrigger rig clear"), "{said}");
    let cleared = document(&outrigger(&["rig", "clear", "--port", port, "--json"]));
    for axis in 0..2 {
        assert_eq!(cleared["axes"][axis]["state"], "idle", "{cleared:#}");
    }
    kill(Pid::from_raw(running.0.id() as i32), Signal::SIGINT).unwrap();
    assert_eq!(running.0.wait().unwrap().code(), Some(0));
}
