//! What nobody reads, and parts of the daemon that die.

use std::fs::File;
use std::io::Write as _;
use std::net::TcpListener;
use std::os::fd::OwnedFd;
use std::process::{Command, Stdio};
use std::time::Instant;

use nix::fcntl::{FcntlArg, OFlag, fcntl};
use nix::sys::signal::{Signal, kill};
use nix::unistd::{Pid, pipe};
use outrigger::mock::rig::{MockConfig, MockRig};

use super::program::{Bench, PATIENCE, Running, exchange, has_problem};
use super::sensor::Sending;

/// A pipe that is full already: its reader, who reads nothing, and its writer.
fn full_pipe() -> (OwnedFd, OwnedFd) {
    let (reader, writer) = pipe().unwrap();
    fcntl(&writer, FcntlArg::F_SETFL(OFlag::O_NONBLOCK)).unwrap();
    let mut file = File::from(writer);
    while file.write(&[b'.'; 4096]).is_ok() {}
    let writer = OwnedFd::from(file);
    fcntl(&writer, FcntlArg::F_SETFL(OFlag::empty())).unwrap();
    (reader, writer)
}

pub fn a_log_without_a_reader_holds_up_nothing() {
    let bench = Bench::new(&["left"], "");
    let (reader, stuck) = full_pipe();
    let (gone, broken) = pipe().unwrap();
    drop(gone);
    let full = File::create("/dev/full").unwrap();
    let logs: [(Stdio, Option<&str>); 3] = [
        (stuck.into(), Some("log_stuck")),
        (broken.into(), Some("log_lost")),
        (full.into(), Some("log_lost")),
    ];
    for (number, (log, problem)) in logs.into_iter().enumerate() {
        let daemon = Running::start_with(bench.command(&["--record"]), log);
        let sensor = Sending::ouster(daemon.sensor(0));
        daemon.wait("packets come", |status| status["sensors"][0]["packets"].as_u64() > Some(0));
        let sent = sensor.unplug();
        // a line of the log, which nobody takes
        daemon.wait("the sensor is silent", |status| has_problem(status, "silent"));
        if let Some(problem) = problem {
            let words = daemon.wait_for_problem(problem);
            assert!(words.contains("lines are lost"), "{words}");
        }
        let metrics = daemon.get("/metrics").1;
        assert!(metrics.contains("outrigger_sensor_up{sensor=\"left\"} 0"), "{metrics}");
        let last = daemon.order("/api/v1/recording/stop", "");
        assert_eq!((&last["packets"], &last["complete"]), (&sent.into(), &true.into()));
        daemon.order("/api/v1/recording/start", "");
        assert_eq!(daemon.end().0, Some(0));
        let sessions = bench.sessions();
        assert!(
            sessions.len() == 2 * (number + 1) && sessions.iter().all(|session| session.manifest().complete)
        );
    }
    drop(reader);
    // closed from the start
    let mut command = Command::new("sh");
    command.args(["-c", "exec \"$0\" \"$@\" 2>&-", env!("CARGO_BIN_EXE_outrigger")]);
    command.args(bench.arguments(&bench.path("sessions"), &["--record"]));
    let daemon = Running::start(command);
    assert_eq!(daemon.status()["recorder"]["recording"], true);
    assert_eq!(daemon.end().0, Some(0));
}

pub fn a_stdout_without_a_reader_holds_up_nothing() {
    let bench = Bench::new(&["left"], "");
    let (_reader, stuck) = full_pipe();
    let (gone, broken) = pipe().unwrap();
    drop(gone);
    let full = File::create("/dev/full").unwrap();
    for stdout in [Stdio::from(stuck), broken.into(), full.into()] {
        let free = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
        let mut command = bench.command(&["--record", "--listen", &free.to_string()]);
        let mut child = command.stdout(stdout).stderr(Stdio::null()).spawn().unwrap();
        let begun = Instant::now();
        while std::net::TcpStream::connect(free).is_err() {
            assert!(begun.elapsed() < PATIENCE && child.try_wait().unwrap().is_none());
            std::thread::sleep(std::time::Duration::from_millis(50));
        }
        let request = format!("GET /healthz HTTP/1.1\r\nHost: {free}\r\nConnection: close\r\n\r\n");
        assert_eq!(exchange(free, &request).0, 200);
        kill(Pid::from_raw(child.id() as i32), Signal::SIGTERM).unwrap();
        assert_eq!(child.wait().unwrap().code(), Some(0));
    }
    assert!(bench.sessions().iter().all(|session| session.manifest().complete));
}

pub fn a_part_that_is_needed_ends_the_daemon_in_order() {
    for component in ["recorder", "receive left", "state"] {
        let bench = Bench::new(&["left"], "");
        let daemon = bench.start(&["--record", "--break-component", component]);
        let sensor = Sending::ouster(daemon.sensor(0));
        let (code, log) = daemon.ended();
        let sent = sensor.unplug();
        assert_eq!(code, Some(101), "{component}: {log}");
        assert!(log.contains(&format!("{component}: it panicked: ordered, as a test")), "{log}");
        let session = &bench.sessions()[0];
        let manifest = session.manifest();
        assert!(manifest.complete && session.problems().is_empty(), "{component}: {:?}", session.problems());
        let counted = manifest.sensors[0].packets + manifest.losses.total();
        assert!(manifest.sensors[0].packets > 0 && counted <= sent, "{component}: {counted} of {sent}");
    }
}

pub fn a_part_that_is_not_needed_is_reported_dead() {
    let bench = Bench::new(&["left"], "");
    let daemon = bench.start(&["--record", "--break-component", "live left"]);
    let sensor = Sending::ouster(daemon.sensor(0));
    let words = daemon.wait_for_problem("component_dead");
    assert!(words.contains("live left: it panicked"), "{words}");
    let before = daemon.status();
    let packets = |status: &serde_json::Value| status["recorder"]["packets"].as_u64().unwrap();
    let later = daemon.wait("it records on", |status| packets(status) > packets(&before) + 10);
    let age_ms = |status: &serde_json::Value| status["sensors"][0]["decoded_age_ms"].as_f64();
    assert!(age_ms(&later) > age_ms(&before), "what is decoded grows old");
    assert!(daemon.get("/metrics").1.contains("outrigger_components_dead 1"));
    let sent = sensor.unplug();
    let (code, log) = daemon.end();
    assert_eq!(code, Some(101), "{log}");
    assert!(log.contains("component_dead") && log.contains("after a part of it died"), "{log}");
    assert_eq!(bench.sessions()[0].manifest().sensors[0].packets, sent);

    let rig = MockRig::start(MockConfig::default(), 3).unwrap();
    let bench = Bench::new(&["left"], &format!("[rig]\nport = \"{}\"\n", rig.path().display()));
    let daemon = bench.start(&["--break-component", "rig-watch"]);
    daemon.wait("the rig is there", |status| status["rig"]["connected"] == true);
    daemon.wait_for_problem("component_dead");
    let status = daemon.wait("the rig is let go of", |status| status["rig"]["connected"] == false);
    assert_eq!(status["rig"]["status"]["axes"][0]["source"], "stale");
    assert_eq!(daemon.end().0, Some(101));
}
