//! How far a pair goes on that loses the program which moves it, or is told to stop by a signal.

use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use outrigger::mock::rig::{MockConfig, MockRig};

use crate::support::{Case, case};

pub const CASES: &[Case] = &[
    case(
        "a_pair_stops_within_ten_degrees_when_its_host_is_killed",
        a_pair_stops_within_ten_degrees_when_its_host_is_killed,
    ),
    case("every_signal_to_stop_brakes_within_four_degrees", every_signal_to_stop_brakes_within_four_degrees),
    case("a_program_that_nohup_starts_ignores_a_hang_up", a_program_that_nohup_starts_ignores_a_hang_up),
    case("a_hang_up_stops_every_long_verb", a_hang_up_stops_every_long_verb),
    case("a_busy_host_keeps_a_pair_moving", a_busy_host_keeps_a_pair_moving),
];

/// Set to repeat the killings more often than a test has time for.
const REPETITIONS: &str = "OUTRIGGER_KILLS";

/// A program that ends with the test.
struct Running(Child);

impl Running {
    fn start(arguments: &[&str]) -> Self {
        // tests that nohup started hand on that hang-ups are ignored
        let mut command = Command::new("env");
        command.args(["--default-signal=HUP", env!("CARGO_BIN_EXE_outrigger")]).args(arguments);
        Self(command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap())
    }

    fn signal(&self, signal: Signal) {
        kill(Pid::from_raw(self.0.id() as i32), signal).unwrap();
    }

    fn ends_within(&mut self, time: Duration) -> bool {
        let started = Instant::now();
        while started.elapsed() < time {
            if self.0.try_wait().unwrap().is_some() {
                return true;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        false
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn homed(seed: u64) -> MockRig {
    let start_urad = Some([-900_000, -900_000]);
    let mock = MockRig::start(MockConfig { start_urad, ..MockConfig::default() }, seed).unwrap();
    let port = mock.path().display().to_string();
    let home = ["rig", "home", "--port", &port, "--arm"];
    assert!(Running::start(&home).0.wait().unwrap().success());
    mock
}

fn at_deg(mock: &MockRig) -> f64 {
    mock.true_positions_rad().unwrap()[0].to_degrees()
}

/// A move through 100 degrees at 30 degrees a second that has full speed.
fn on_the_way(mock: &MockRig) -> Running {
    let port = mock.path().display().to_string();
    let mover = Running::start(&["rig", "set", "58", "58", "--port", &port, "--arm"]);
    let started = Instant::now();
    while at_deg(mock) < -20.0 {
        assert!(started.elapsed() < Duration::from_secs(60), "it never moved");
        std::thread::sleep(Duration::from_millis(2));
    }
    mover
}

/// Where it stands at last.
fn stands_deg(mock: &MockRig) -> f64 {
    let mut before = at_deg(mock);
    loop {
        std::thread::sleep(Duration::from_millis(400));
        let now = at_deg(mock);
        if (now - before).abs() < 0.05 {
            return now;
        }
        before = now;
    }
}

/// How far a pair at full speed goes on after something was done to the program that moves it, degrees.
fn goes_on_deg(seed: u64, what: impl FnOnce(&Running)) -> (f64, MockRig, Running) {
    let mock = homed(seed);
    let mover = on_the_way(&mock);
    let before_deg = at_deg(&mock);
    what(&mover);
    let way_deg = stands_deg(&mock) - before_deg;
    (way_deg, mock, mover)
}

/// The plan, at 30 degrees a second: 4.5 until the silence is noticed, 2 until it stands.
fn a_pair_stops_within_ten_degrees_when_its_host_is_killed() {
    let repetitions = std::env::var(REPETITIONS).ok().and_then(|count| count.parse().ok()).unwrap_or(2);
    let kill = |seed| goes_on_deg(seed, |mover| mover.signal(Signal::SIGKILL)).0;
    let mut ways_deg: Vec<f64> = (0..repetitions).map(|seed| kill(100 + seed)).collect();
    ways_deg.sort_by(f64::total_cmp);
    println!(
        "killed: {repetitions} times, median {:.2}, max {:.2} degrees",
        ways_deg[ways_deg.len() / 2],
        ways_deg[ways_deg.len() - 1]
    );
    assert!(ways_deg.iter().all(|way_deg| (1.0..10.0).contains(way_deg)), "{ways_deg:?}");
}

fn every_signal_to_stop_brakes_within_four_degrees() {
    for (seed, signal) in [Signal::SIGINT, Signal::SIGTERM, Signal::SIGHUP].into_iter().enumerate() {
        let (way_deg, mock, mut mover) = goes_on_deg(120 + seed as u64, |mover| mover.signal(signal));
        println!("{signal}: {way_deg:.2} degrees");
        assert!((0.2..4.0).contains(&way_deg), "{signal}: {way_deg}");
        assert!(mover.ends_within(Duration::from_secs(20)), "{signal}: it goes on");
        assert_eq!(mover.0.wait().unwrap().code(), Some(1), "{signal}: the move was broken off");
        let status = outrigger::drive::Rig::connect(mock.path()).unwrap().status().unwrap();
        assert!(status.axes.iter().all(|axis| axis.faults.is_empty()), "{signal}: {status:?}");
    }
}

fn a_program_that_nohup_starts_ignores_a_hang_up() {
    let mock = homed(130);
    let mut command = Command::new("nohup");
    command.args([env!("CARGO_BIN_EXE_outrigger"), "rig", "watch", "--for", "60", "--port"]).arg(mock.path());
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    let mut watch = Running(command.spawn().unwrap());
    wait_until_caught(&watch, Signal::SIGTERM);
    watch.signal(Signal::SIGHUP);
    assert!(!watch.ends_within(Duration::from_millis(700)), "it ended");
    watch.signal(Signal::SIGTERM);
    assert!(watch.ends_within(Duration::from_secs(20)));
}

/// Until a program does not end by a signal any more.
fn wait_until_caught(running: &Running, signal: Signal) {
    let path = format!("/proc/{}/status", running.0.id());
    let is_caught = || {
        let status = std::fs::read_to_string(Path::new(&path)).unwrap_or_default();
        let mask =
            status.lines().find_map(|line| line.strip_prefix("SigCgt:")).unwrap_or("0").trim().to_owned();
        u64::from_str_radix(&mask, 16).unwrap() & 1 << (signal as u64 - 1) != 0
    };
    let started = Instant::now();
    while !is_caught() {
        assert!(started.elapsed() < Duration::from_secs(60), "{signal} is never caught");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Of which none leaves anything half written: each ends by its own code, not by the signal.
fn a_hang_up_stops_every_long_verb() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let config = path("rig.toml");
    let port = std::net::UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let text = format!(
        "format = \"outrigger-rig/1\"\nsensor = [{{ name = \"a\", model = \"vlp-16\", listen = \"127.0.0.1:{port}\" }}]\n"
    );
    std::fs::write(&config, text).unwrap();
    let (sessions, session) = (path("sessions"), path("session"));
    let verbs: [&[&str]; 3] = [
        &["record", "--config", &config, "--out", &session],
        &["daemon", "--config", &config, "--listen", "127.0.0.1:0", "--out", &sessions, "--record"],
        &["mock", "rig"],
    ];
    for verb in verbs {
        let mut running = Running::start(verb);
        wait_until_caught(&running, Signal::SIGHUP);
        std::thread::sleep(Duration::from_millis(500)); // a session is open
        running.signal(Signal::SIGHUP);
        assert!(running.ends_within(Duration::from_secs(20)), "{verb:?}: it goes on");
        assert!(running.0.wait().unwrap().code().is_some(), "{verb:?} ended by the signal");
    }
    let daemons = std::fs::read_dir(&sessions).unwrap().map(|entry| entry.unwrap().path());
    for session in daemons.chain([session.into()]) {
        let manifest = outrigger::recording::Manifest::read(&session).unwrap();
        assert!(manifest.complete, "{} is not closed", session.display());
    }
}

/// Programs that take every core, twice: the move takes a little longer at most, and nothing is latched.
fn a_busy_host_keeps_a_pair_moving() {
    let cores = std::thread::available_parallelism().map_or(2, usize::from);
    let _busy: Vec<Running> = (0..2 * cores)
        .map(|_| Running(Command::new("sh").args(["-c", "while :; do :; done"]).spawn().unwrap()))
        .collect();
    let mock = homed(140);
    let mut mover = on_the_way(&mock);
    assert!(mover.ends_within(Duration::from_secs(60)), "it never arrives");
    assert!(mover.0.wait().unwrap().success());
    assert!((at_deg(&mock) - 58.0).abs() < 0.5, "{}", at_deg(&mock));
}
