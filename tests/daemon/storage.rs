//! Disks that are slow, fill up, or outlive the daemon.

use std::process::{Command, Stdio};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use outrigger::recording::Session;

use super::program::{Bench, PATIENCE, Running, sessions_in};
use super::sensor::Sending;
use crate::support::delete_under;

pub fn a_killed_daemon_leaves_a_session_that_opens() {
    let bench = Bench::new(&["left"], "");
    let mut daemon = bench.start(&["--record"]);
    let sensor = Sending::ouster(daemon.sensor(0));
    daemon
        .wait("a hundred packets were recorded", |status| status["recorder"]["packets"].as_u64() > Some(100));
    // what was taken comes to the file by itself, while it is being written
    let begun = std::time::Instant::now();
    while packets_in(&bench) <= 100 {
        assert!(begun.elapsed() < PATIENCE, "the session is flushed");
        std::thread::sleep(std::time::Duration::from_millis(100));
    }
    daemon.signal(Signal::SIGKILL);
    daemon.child.wait().unwrap();
    let sent = sensor.unplug();
    let session = bench.sessions().remove(0);
    assert!(!session.manifest().complete && session.problems()[0].contains("not closed"));
    let found = packets_in(&bench);
    assert!(found > 100 && found <= sent, "{found} of {sent}");
    let told =
        Command::new(env!("CARGO_BIN_EXE_outrigger")).arg("inspect").arg(session.dir()).output().unwrap();
    let text = String::from_utf8_lossy(&told.stdout);
    assert!(told.status.code() == Some(3) && text.contains("the session was not closed"), "{text}");
}

/// `timeout` signals its child and then the group that the child is in: one wish, told twice.
pub fn a_stop_signal_sent_twice_closes_the_session() {
    for round in 0..4 {
        let bench = Bench::new(&["left"], "");
        let mut daemon = bench.start(&["--record"]);
        let sensor = Sending::ouster(daemon.sensor(0));
        daemon.wait("packets were recorded", |status| status["recorder"]["packets"].as_u64() > Some(10));
        daemon.signal(Signal::SIGINT);
        std::thread::sleep(std::time::Duration::from_millis(2 * round));
        let _ = kill(Pid::from_raw(daemon.child.id() as i32), Signal::SIGINT); // it may have ended by the first
        assert_eq!(daemon.child.wait().unwrap().code(), Some(0), "{round}");
        sensor.unplug();
        let session = bench.sessions().remove(0);
        assert!(session.manifest().complete && session.problems().is_empty(), "{round}");
    }
}

/// Packets in the file of the only session, as far as it is written.
fn packets_in(bench: &Bench) -> u64 {
    let mut packets = bench.sessions()[0].packets().unwrap();
    std::iter::from_fn(|| packets.next().unwrap().map(drop)).count() as u64
}

/// One session is moved, the next deleted with the folder of all of them: recording goes on, and what is lost is counted.
pub fn a_session_that_is_removed_goes_on_in_another() {
    let bench = Bench::new(&["left"], "");
    let daemon = bench.start(&["--record"]);
    let sensor = Sending::ouster(daemon.sensor(0));
    let recorded = |status: &serde_json::Value| status["recorder"]["packets"].as_u64() > Some(50);
    let name = |status: &serde_json::Value| status["recorder"]["session"].as_str().unwrap().to_owned();
    let first = name(&daemon.wait("packets were recorded", recorded));
    std::fs::rename(bench.path("sessions").join(&first), bench.path("moved")).unwrap();
    let words = daemon.wait_for_problem("session_displaced");
    assert!(
        words.contains("was moved to") && words.contains(&bench.path("moved").display().to_string()),
        "{words}"
    );
    let status = daemon.wait("packets are recorded again", recorded);
    let second = name(&status);
    assert!(status["recorder"]["recording"] == true && status["recorder"]["lost"] == 0, "{status}");
    delete_under(&daemon.child, &bench.path("sessions"));
    daemon.wait("another session is deleted", |status| status["recorder"]["sessions"] == 2);
    assert!(daemon.wait_for_problem("session_displaced").contains(&format!("{second} was deleted")));
    daemon.wait("packets are recorded once more", recorded);
    sensor.unplug();
    let (code, log) = daemon.end();
    assert!(code == Some(3) && log.contains("session_displaced"), "{code:?} {log}");
    let moved = Session::open(&bench.path("moved")).unwrap();
    assert!(moved.manifest().complete && moved.problems().is_empty(), "{:?}", moved.problems());
    assert!(moved.manifest().sensors[0].packets > 50);
    let sessions = bench.sessions();
    let [last] = &sessions[..] else { panic!("{} sessions", sessions.len()) };
    let manifest = last.manifest();
    assert!(manifest.complete && last.problems().is_empty(), "{:?}", last.problems());
    assert!(manifest.follows.as_ref().unwrap().contains(&format!("{second} was deleted")), "{manifest:?}");
    assert!(
        manifest.losses.deleted > 50 && manifest.losses.total() == manifest.losses.deleted,
        "{manifest:?}"
    );
    let events: Vec<serde_json::Value> = last.events().unwrap();
    assert!(events.iter().any(|event| event["event"] == "session_displaced"), "{events:?}");
}

pub fn a_slow_disk_is_named_and_its_losses_counted() {
    let bench = Bench::new(&["left"], "");
    let daemon = bench.start(&["--record", "--hold-up-writes-ms", "700"]);
    let sensor = Sending::ouster(daemon.sensor(0));
    assert!(daemon.wait_for_problem("disk_slow").contains("wait in memory"));
    let status =
        daemon.wait("the picture goes on", |status| status["sensors"][0]["frames"].as_u64() > Some(1));
    assert_eq!(status["recorder"]["session_lost"], 0, "they wait, none is lost yet");
    let sent = sensor.unplug();
    let (code, log) = daemon.end();
    assert_eq!(code, Some(0), "{log}");
    assert_eq!(bench.sessions()[0].manifest().sensors[0].packets, sent, "all of them came to the disk");
}

/// A disk that takes nearly nothing, and packets until no more may wait: memory ends at the bound that the state names.
pub fn a_flood_fills_memory_to_its_bound_and_no_further() {
    let bench = Bench::new(&["left"], "");
    let daemon = bench.start(&["--record", "--hold-up-writes-ms", "3000"]);
    let (to, sender) = (daemon.sensor(0), std::net::UdpSocket::bind("127.0.0.1:0").unwrap());
    let of = |status: &serde_json::Value, name: &str| status["memory"][name].as_u64().unwrap();
    let mut sent = 0;
    let status = daemon.wait("no more may wait", |status| {
        for _ in 0..200 {
            sent += u64::from(sender.send_to(&[9; 30_000], to).is_ok());
        }
        status["sensors"][0]["losses"]["queue_dropped"].as_u64() > Some(0)
    });
    let (queue, limit) = (of(&status, "queue_most"), of(&status, "queue_limit"));
    assert!(queue <= limit && queue > limit - 100_000, "{}", status["memory"]);
    // beside what waits: what the recorder and the live thread hold, a batch of 64 each, and one being read into
    let packets = of(&status, "packets");
    assert!(packets <= limit + of(&status, "picture_limit") + 130 * 30_208, "{}", status["memory"]);
    assert!(of(&status, "resident") < packets + (100 << 20), "{}", status["memory"]);
    daemon.signal(Signal::SIGKILL); // writing all that at this pace would take minutes
    assert!(sent > 2000);
}

/// In a mount name space of its own, as root or as a user who may be root there.
fn unshared(script: &str) -> Command {
    let mut command = Command::new("unshare");
    command.args(["--mount", "--map-root-user", "sh", "-ec", script]);
    command
}

/// Whether a small file system can be mounted.
pub fn can_mount() -> bool {
    let folder = tempfile::tempdir().unwrap();
    let mut command = unshared("mount -t tmpfs -o size=1m tmpfs \"$0\"");
    command.arg(folder.path()).stderr(Stdio::null()).status().is_ok_and(|status| status.success())
}

/// A daemon whose sessions lie on a disk of 6 MiB; they are copied out when it ends.
fn on_a_small_disk(bench: &Bench, arguments: &[&str]) -> Running {
    std::fs::create_dir(bench.path("disk")).unwrap();
    let script = "mount -t tmpfs -o size=6m tmpfs \"$0\"; saved=$1; shift; set +e
        trap : TERM
        \"$@\" & child=$!; trap 'kill -TERM $child' TERM
        wait $child; code=$?; while kill -0 $child 2>/dev/null; do wait $child; code=$?; done
        cp -r \"$0/sessions\" \"$saved\"; exit $code";
    let mut command = unshared(script);
    command.arg(bench.path("disk")).arg(bench.path("saved")).arg(env!("CARGO_BIN_EXE_outrigger"));
    command.args(bench.arguments(&bench.path("disk/sessions"), arguments));
    Running::start(command)
}

/// Fills the disk with so many packets a moment.
fn end_of_a_small_disk(bench: &Bench, arguments: &[&str], packets: usize, kind: &str) -> (String, Session) {
    let daemon = on_a_small_disk(bench, arguments);
    let sensor = Sending::ouster(daemon.sensor(0));
    // faster than the sensor alone: the same packets' size from a second sender on its port
    let (to, other) = (daemon.sensor(0), std::net::UdpSocket::bind("127.0.0.1:0").unwrap());
    let begun = std::time::Instant::now();
    let status = loop {
        for _ in 0..packets {
            other.send_to(&[7; 8000], to).unwrap();
        }
        assert!(begun.elapsed() < PATIENCE, "the disk fills up");
        let status = daemon.status();
        if super::program::has_problem(&status, kind) {
            break status;
        }
        std::thread::sleep(std::time::Duration::from_millis(30));
    };
    assert_eq!(status["recorder"]["recording"], false, "{status}");
    assert_eq!(status["recorder"]["ended_early"], true, "{status}");
    let said = daemon.wait_for_problem(kind);
    daemon.wait("the daemon goes on without recording", |status| status["sensors"][0]["state"] == "ok");
    drop(sensor);
    let (code, log) = daemon.end();
    assert_eq!(code, Some(3), "a recording that ended by itself: {log}");
    (said, sessions_in(&bench.path("saved")).remove(0))
}

pub fn a_disk_that_fills_up_ends_the_recording_in_order() {
    let bench = Bench::new(&["left"], "");
    let (said, session) = end_of_a_small_disk(&bench, &["--record", "--warn-below-mib", "3"], 5, "disk_full");
    assert!(said.contains("nearly full"), "{said}");
    assert!(session.problems().is_empty() && session.manifest().complete, "{:?}", session.problems());
    assert_eq!(session.manifest().losses.not_written, 0);
    let events: Vec<serde_json::Value> = session.events().unwrap();
    let order: Vec<&str> = events.iter().map(|event| event["event"].as_str().unwrap()).collect();
    let place = |event: &str| {
        order.iter().position(|other| *other == event).unwrap_or_else(|| panic!("{event}: {order:?}"))
    };
    assert!(place("low_disk") < place("disk_full"), "a warning before: {order:?}");
}

pub fn a_full_disk_keeps_what_was_recorded() {
    let bench = Bench::new(&["left"], "");
    let arguments = ["--record", "--stop-below-mib", "0", "--warn-below-mib", "0"];
    let (said, session) = end_of_a_small_disk(&bench, &arguments, 40, "recording_failed");
    assert!(said.contains("disk full"), "{said}");
    let manifest = session.manifest();
    assert!(!manifest.complete && manifest.losses.not_written > 0, "{manifest:?}");
    let mut packets = session.packets().unwrap();
    let mut found = 0;
    while packets.next().unwrap().is_some() {
        found += 1;
    }
    assert_eq!(manifest.sensors[0].packets, found);
    assert!(found > 100, "{found}");
}
