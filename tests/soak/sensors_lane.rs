//! Trouble with each sensor, one after another.

use std::net::UdpSocket;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use outrigger::base::rng::Rng;
use outrigger::mock::sensor::{Faults, MockSensor};
use sensors::velodyne::{Product, ReturnMode};
use serde_json::Value;

use super::feed::Feed;
use super::sensor::{SERIAL, metadata};
use super::watch::{PATIENCE, Watch, has};

const NAMES: [&str; 3] = ["left", "right", "front"];

pub fn pause(rng: &mut Rng, [least_s, most_s]: [f64; 2]) {
    std::thread::sleep(Duration::from_secs_f64(rng.between(least_s, most_s)));
}

fn loss(status: &Value, feed: &Feed, name: &str) -> u64 {
    status["sensors"][feed.number]["losses"][name].as_u64().unwrap()
}

fn is_heard(status: &Value, feed: &Feed) -> bool {
    status["sensors"][feed.number]["state"] == "ok"
}

/// Damage on the way for some seconds: how many packets it struck, and how many of them the state counts.
fn damage(
    watch: &Watch,
    feed: &Feed,
    rng: &mut Rng,
    name: &'static str,
    faults: Faults,
    counters: &[&str],
) -> [u64; 2] {
    let total = |status: &Value| counters.iter().map(|counter| loss(status, feed, counter)).sum::<u64>();
    let unread = |status: &Value| status["sensors"][feed.number]["picture_dropped"].as_u64().unwrap();
    let first = watch.fresh();
    feed.begin_faults(Faults { seed: rng.bits(), ..faults });
    watch.explained(name, NAMES[feed.number], |status| total(status) > total(&first));
    pause(rng, [1.0, 4.0]);
    let done = feed.end_faults();
    let done = done.dropped + done.duplicated + done.reordered + done.corrupted;
    // what waits to be looked into is counted when its turn comes, what is missing with the revolutions that follow
    let is_counted =
        |status: &Value| total(status) - total(&first) >= done || unread(status) > unread(&first);
    let begun = Instant::now();
    let all_count = faults.drop + faults.duplicate > 0.0; // disorder and damage may leave less to be counted
    while all_count && !is_counted(&watch.fresh()) && begun.elapsed() < PATIENCE {}
    let seen = |status: &Value| status["sensors"][feed.number]["frames"].as_u64().unwrap();
    let (mut last, until) = (watch.fresh(), seen(&watch.fresh()) + 5);
    watch.wait(&format!("{name} of {} is counted", NAMES[feed.number]), |status| {
        last = std::sync::Arc::new(status.clone());
        seen(status) > until
    });
    let counted = total(&last) - total(&first);
    // a machine that is too busy records packets and does not look into them: then these counts are not exact
    if unread(&last) > unread(&first) { [done, done] } else { [done, counted] }
}

fn silence(watch: &Watch, feed: &Feed, rng: &mut Rng) {
    let name = NAMES[feed.number];
    feed.set_silent(true);
    watch.explained("silence", name, |status| has(status, name, "silent"));
    pause(rng, [0.0, 5.0]);
    feed.set_silent(false);
    watch.forgotten(name, &["silent"]);
    watch.wait(&format!("{name} is heard again"), |status| is_heard(status, feed));
}

/// An Ouster: its packets have numbers and an identity, so every kind of loss can be told.
pub fn ouster(watch: &Watch, feed: &Feed, seed: u64) {
    let (mut rng, mut init_id, mut ahead_ns) = (Rng::new(seed, 10), 1, 0);
    let plug = |init_id, ahead_ns| feed.plug(MockSensor::ouster(metadata(SERIAL, init_id)), ahead_ns);
    plug(init_id, ahead_ns);
    while watch.goes_on() {
        pause(&mut rng, [1.0, 6.0]);
        let share = rng.between(0.05, 0.3);
        match rng.below(7) {
            0 => {
                let faults = Faults { drop: share, ..Faults::default() };
                let [dropped, counted] =
                    damage(watch, feed, &mut rng, "packet loss", faults, &["on_the_way"]);
                if dropped != counted {
                    watch.log.fail(format!("{dropped} packets were lost on the way, {counted} are counted"));
                }
                watch.forgotten("left", &["lost_on_the_way"]);
            }
            1 => {
                let faults = Faults { duplicate: share, ..Faults::default() };
                let [done, counted] = damage(watch, feed, &mut rng, "duplicates", faults, &["duplicated"]);
                if done != counted {
                    watch.log.fail(format!("{done} packets came twice, {counted} are counted"));
                }
            }
            2 => {
                let faults = Faults { reorder: share, ..Faults::default() };
                damage(watch, feed, &mut rng, "disorder", faults, &["reordered", "late"]);
            }
            3 => {
                let faults = Faults { corrupt: share, ..Faults::default() };
                let counters = ["crc_errors", "malformed"];
                damage(watch, feed, &mut rng, "damaged packets", faults, &counters);
                watch.forgotten("left", &["damaged", "lost_on_the_way"]);
            }
            4 => silence(watch, feed, &mut rng),
            5 => {
                let before = watch.fresh()["sensors"][0]["restarts"].as_u64().unwrap();
                init_id = init_id % 1_000_000 + 1;
                plug(init_id, ahead_ns);
                watch.explained("sensor restart", "left", |status| {
                    has(status, "left", "restarted")
                        && status["sensors"][0]["restarts"].as_u64() > Some(before)
                });
                watch.forgotten("left", &["restarted"]);
            }
            _ => {
                // from one to ten minutes, to and fro
                let jump_ns = (rng.between(60.0, 600.0) * 1e9) as i64;
                ahead_ns = if ahead_ns > 0 { ahead_ns - jump_ns } else { ahead_ns + jump_ns };
                plug(init_id, ahead_ns);
                watch.explained("clock jump", "left", |status| has(status, "left", "clock_jump"));
                watch.forgotten("left", &["clock_jump"]);
            }
        }
    }
    feed.set_silent(false);
}

/// A Velodyne, with others who send to its port.
pub fn velodyne(watch: &Watch, feed: &Feed, seed: u64) {
    let mut rng = Rng::new(seed, 11);
    feed.plug(MockSensor::velodyne(Product::Vlp16, ReturnMode::Strongest, 10.0).unwrap(), 0);
    let stranger = UdpSocket::bind("127.0.0.2:0").unwrap();
    let insider = UdpSocket::bind("127.0.0.1:0").unwrap();
    while watch.goes_on() {
        pause(&mut rng, [1.0, 8.0]);
        let (kind, count) = (rng.below(3), 1 + rng.below(400));
        match kind {
            0 => silence(watch, feed, &mut rng),
            1 => {
                let before = loss(&watch.fresh(), feed, "foreign_source");
                for _ in 0..count {
                    feed.send_beside(&stranger, &[5; 700]);
                }
                watch.explained("a stranger sends", "right", |status| {
                    let counted = loss(status, feed, "foreign_source") - before;
                    has(status, "right", "foreign_source")
                        && (counted == count || loss(status, feed, "kernel_dropped") > 0)
                });
                watch.forgotten("right", &["foreign_source"]);
            }
            _ => {
                // what happens to look like a packet is damaged; a machine that is too busy does not look at all
                let strange = |status: &Value| {
                    loss(status, feed, "not_its_own")
                        + loss(status, feed, "malformed")
                        + status["sensors"][feed.number]["picture_dropped"].as_u64().unwrap()
                };
                let before = strange(&watch.fresh());
                for _ in 0..count {
                    let length = 1 + rng.below(1200) as usize;
                    let bytes: Vec<u8> = (0..length).map(|_| rng.bits() as u8).collect();
                    feed.send_beside(&insider, &bytes);
                }
                watch.explained("garbage", "right", |status| strange(status) >= before + count);
                watch.forgotten("right", &["foreign_packets", "damaged"]);
            }
        }
    }
    feed.set_silent(false);
}

/// A sensor that is a process of its own: it is held up and killed from outside.
pub fn process(watch: &Watch, feed: &Feed, program: &Path, seed: u64) {
    let mut rng = Rng::new(seed, 12);
    let to = feed.relay().to_string();
    let start = || {
        let arguments = ["mock", "sensor", "--model", "vlp-16", "--to", &to, "--box=-6,-4,-1.5,6,4,2"];
        let mut command = Command::new(program);
        Guard(command.args(arguments).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap())
    };
    let mut sensor = start();
    while watch.goes_on() {
        pause(&mut rng, [1.0, 8.0]);
        let name = if rng.below(2) == 0 {
            sensor.signal(Signal::SIGSTOP);
            watch.explained("process stopped", "front", |status| has(status, "front", "silent"));
            pause(&mut rng, [0.0, 5.0]);
            sensor.signal(Signal::SIGCONT);
            "goes on"
        } else {
            drop(sensor);
            watch.explained("process killed", "front", |status| has(status, "front", "silent"));
            sensor = start();
            "is back"
        };
        watch.wait(&format!("front {name}"), |status| {
            is_heard(status, feed) && !has(status, "front", "silent")
        });
    }
}

struct Guard(Child);

impl Guard {
    fn signal(&self, signal: Signal) {
        kill(Pid::from_raw(self.0.id() as i32), signal).unwrap();
    }
}

impl Drop for Guard {
    fn drop(&mut self) {
        let _ = self.0.kill(); // it may have ended
        let _ = self.0.wait();
    }
}
