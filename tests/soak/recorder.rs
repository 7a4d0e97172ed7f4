//! Sessions begun and ended, a disk that fills up, and the books: what was sent is recorded or counted as lost.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use outrigger::base::rng::Rng;
use outrigger::recording::{Session, free_bytes};
use serde_json::Value;

use super::feed::{Feed, Gate};
use super::sensors_lane::pause;
use super::watch::{PATIENCE, Watch, has};

/// Free space that ends a recording, as the daemon was told, and less than that.
const TOO_LITTLE_BYTES: u64 = 48 << 20;

fn of_sensor(status: &Value, number: usize) -> u64 {
    let sensor = &status["sensors"][number];
    let count = |value: &Value| value.as_u64().unwrap();
    count(&sensor["packets"])
        + count(&sensor["losses"]["kernel_dropped"])
        + count(&sensor["losses"]["queue_dropped"])
        + count(&sensor["losses"]["foreign_source"])
}

/// Waits, with nothing under way, until the daemon has counted every packet that was sent; calls `then` before packets
/// flow again. The kernel tells of what it dropped with the next packet: then a few more are let through.
fn at_rest<T>(
    watch: &Watch,
    gate: &Gate,
    feeds: &[Feed; 3],
    what: &str,
    then: impl FnOnce() -> T,
) -> Option<T> {
    let begun = Instant::now();
    loop {
        let closed = gate.write().unwrap();
        let sent: Vec<u64> = feeds.iter().map(Feed::sent).collect();
        let halted = Instant::now();
        let mut counted = Vec::new();
        while halted.elapsed() < Duration::from_millis(1500) {
            let status = watch.daemon().status();
            counted = (0..feeds.len()).map(|number| of_sensor(&status, number)).collect();
            if counted == sent {
                std::thread::sleep(Duration::from_millis(300)); // what is counted also comes to the session
                return Some(then());
            }
            std::thread::sleep(Duration::from_millis(50));
        }
        drop(closed);
        if begun.elapsed() > PATIENCE {
            watch.log.fail(format!("{what}: {sent:?} packets were sent, {counted:?} are counted"));
            return None;
        }
        std::thread::sleep(Duration::from_millis(200));
    }
}

/// The daemon's counters are those of the senders.
pub fn balance(watch: &Watch, gate: &Gate, feeds: &[Feed; 3], what: &str) {
    at_rest(watch, gate, feeds, what, || ());
}

/// What a session must account for, by sensor; none where it did not begin or end at rest.
type Books = Option<Vec<u64>>;

/// Opens a session, verifies it by `inspect` too, and deletes it.
fn verify(watch: &Watch, program: &Path, dir: &Path, books: &Books, is_whole: bool) {
    let name = dir.display();
    let session = match Session::open(dir) {
        Ok(session) => session,
        Err(error) => return watch.log.fail(format!("{name}: {error}")),
    };
    let manifest = session.manifest();
    if !session.problems().is_empty() || (is_whole && !manifest.complete) {
        watch.log.fail(format!("{name}: {:?}, complete {}", session.problems(), manifest.complete));
    }
    let recorded: Vec<u64> =
        manifest.sensors.iter().map(|sensor| sensor.packets + sensor.losses.total()).collect();
    if books.as_ref().is_some_and(|sent| *sent != recorded) {
        watch.log.fail(format!(
            "{name}: {books:?} packets were sent, {recorded:?} are recorded or counted as lost"
        ));
    }
    if manifest.losses.total() > 0 {
        watch.log.lose_data();
    }
    let mut packets = session.packets().unwrap();
    let mut found = 0;
    while packets.next().unwrap().is_some() {
        found += 1;
    }
    let said: u64 = manifest.sensors.iter().map(|sensor| sensor.packets).sum();
    if found != said {
        watch.log.fail(format!("{name}: the manifest says {said} packets, the file has {found}"));
    }
    let output = Command::new(program).args(["--json", "inspect"]).arg(dir).output().unwrap();
    let document: Result<Value, _> = serde_json::from_slice(&output.stdout);
    if !matches!(output.status.code(), Some(0 | 3)) || document.is_err() {
        watch.log.fail(format!(
            "{name}: inspect ends with {:?}: {}",
            output.status,
            String::from_utf8_lossy(&output.stderr)
        ));
    }
    watch.log.count_session(found);
    std::fs::remove_dir_all(dir).unwrap();
}

fn order(watch: &Watch, path: &str) -> Option<Value> {
    let (code, answer) = watch.daemon().post(path, "");
    if code != 200 {
        watch.log.fail(format!("{path}: {code} {answer}"));
        return None;
    }
    Some(answer)
}

/// Takes nearly all of the disk.
fn fill(disk: &Path) -> PathBuf {
    let (path, zeros) = (disk.join("ballast"), vec![0; 1 << 20]);
    let mut ballast = std::fs::File::create(&path).unwrap();
    while free_bytes(disk).unwrap() > TOO_LITTLE_BYTES {
        std::io::Write::write_all(&mut ballast, &zeros).unwrap();
    }
    path
}

pub fn lane(watch: &Watch, gate: &Gate, feeds: &[Feed; 3], disk: &Path, program: &Path, seed: u64) {
    let mut rng = Rng::new(seed, 15);
    let sessions = disk.join("sessions");
    while watch.goes_on() {
        pause(&mut rng, [0.5, 5.0]);
        let (at_rest_too, disk_fills) = (rng.below(3) > 0, rng.below(4) == 0);
        let counts = || feeds.iter().map(Feed::sent).collect::<Vec<u64>>();
        let foreign = || {
            (0..3)
                .map(|number| {
                    watch.daemon().status()["sensors"][number]["losses"]["foreign_source"].as_u64().unwrap()
                })
                .collect::<Vec<u64>>()
        };
        let start = || (order(watch, "/api/v1/recording/start"), counts(), foreign());
        let begun =
            if at_rest_too { at_rest(watch, gate, feeds, "a session begins", start) } else { Some(start()) };
        let Some((Some(_), sent_before, foreign_before)) = begun else { continue };
        pause(&mut rng, [3.0, 30.0]);
        let mut books = None;
        if disk_fills {
            let ballast = fill(disk);
            watch.explained("disk nearly full", "recorder", |status| {
                has(status, "recorder", "disk_full") && status["recorder"]["recording"] == false
            });
            watch.log.fill_disk();
            std::fs::remove_file(ballast).unwrap();
        } else {
            let stop = || (order(watch, "/api/v1/recording/stop"), counts(), foreign());
            if at_rest_too {
                let ended = at_rest(watch, gate, feeds, "a session ends", stop);
                books = ended.map(|(_, sent, foreign)| {
                    (0..3)
                        .map(|at| (sent[at] - sent_before[at]) - (foreign[at] - foreign_before[at]))
                        .collect()
                });
            } else {
                stop();
            }
        }
        for entry in std::fs::read_dir(&sessions).unwrap() {
            verify(watch, program, &entry.unwrap().path(), &books, true);
        }
    }
    balance(watch, gate, feeds, "when all lanes ended");
}
