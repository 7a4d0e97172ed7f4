//! The recorder alone at four times the packet rate of the rig that the daemon's bench has: two OS1-128 with two returns
//! and a VLP-16, over loopback, received, checksummed and written, beside the senders on the same cores.
//!
//!     cargo bench --bench recorder                      # 4 times for 20 s
//!     OUTRIGGER_BENCH_RATE=2 OUTRIGGER_BENCH_SECONDS=60 cargo bench --bench recorder
//!
//! Sessions go to the system's temporary folder (`TMPDIR`): 170 MB a second at four times the rate. Ends with exit status
//! 1 when packets are missing that nobody counted.

#![allow(clippy::unwrap_used)] // a bench that cannot run may say so and end

use std::io::{BufRead as _, BufReader};
use std::net::SocketAddr;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use glam::DVec3;
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use outrigger::base::geometry::Pose;
use outrigger::mock::sensor::{MockSensor, Surroundings};
use outrigger::mock::transmit::{Clock, Pace, Transmitter};
use outrigger::recording::Session;
use outrigger::world::scene::{BoxScene, Scene};
use outrigger::world::trajectory::Trajectory;
use sensors::ouster::{Metadata, Profile, Synthetic};
use sensors::velodyne::{Product, ReturnMode};

#[path = "support.rs"]
mod support;
use support::{Usage, environment, median};

/// A sensor's packets of a second or so, each with its time, ns.
type Stream = Vec<(u64, Vec<u8>)>;

/// What a sensor sends in half a second.
fn stream(mut sensor: MockSensor) -> Stream {
    let scene = Scene::Box(BoxScene::closed(DVec3::new(-12.0, -8.0, -1.5), DVec3::new(12.0, 8.0, 4.0)));
    let still = vec![(0, Pose::IDENTITY), (500_000_000, Pose::IDENTITY)];
    let around = Surroundings {
        scene: &scene,
        trajectory: &Trajectory::new(still).unwrap(),
        body_from_sensor: &|_| Pose::IDENTITY,
        noise_m: 0.0,
        seed: 0,
    };
    let mut packets = Vec::new();
    let run = sensor.run(&around, |time_ns, payload| {
        packets.push((time_ns, payload.to_vec()));
        Ok::<_, ()>(())
    });
    run.unwrap();
    packets
}

/// Sends them again and again, so many times faster; packets sent.
fn send(stream: &Stream, to: SocketAddr, rate: f64, until: Instant) -> u64 {
    let mut line = Transmitter::new(None, to, Clock::new(Pace::Rate(rate), Some(0))).unwrap();
    let turn_ns = stream.last().unwrap().0 + (stream[1].0 - stream[0].0) - stream[0].0;
    let mut sent = 0;
    for turn in 0.. {
        for (time_ns, payload) in stream {
            if Instant::now() >= until {
                return sent;
            }
            line.send(turn * turn_ns + time_ns - stream[0].0, payload, to).unwrap();
            sent += 1;
        }
    }
    sent
}

/// A recorder that listens.
fn recorder(folder: &std::path::Path) -> (Child, Vec<SocketAddr>, std::thread::JoinHandle<()>) {
    let mut child = Command::new(env!("CARGO_BIN_EXE_outrigger"))
        .args(["record", "--listen", "left=127.0.0.1:0", "--listen", "right=127.0.0.1:0"])
        .args(["--listen", "front=127.0.0.1:0", "--receive-buffer", "32", "--out"])
        .arg(folder)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines().map_while(Result::ok);
    let said = lines.by_ref().filter_map(|line| {
        println!("{line}");
        line.split_once("listening on ").map(|(_, address)| address.trim().parse().unwrap())
    });
    let addresses: Vec<SocketAddr> = said.take(3).collect();
    let rest = std::thread::spawn(move || lines.for_each(|line| println!("{line}")));
    (child, addresses, rest)
}

fn main() {
    let seconds = environment("OUTRIGGER_BENCH_SECONDS", 20.0);
    let rate = environment("OUTRIGGER_BENCH_RATE", 4.0);
    let ouster = |serial: u64| {
        let wanted = Synthetic::new("os1-128", serial, Profile::Rng19Rfl8Sig16Nir16Dual).columns(1024, 16);
        stream(MockSensor::ouster(Metadata::synthetic(&wanted).unwrap()))
    };
    let front = MockSensor::velodyne(Product::Vlp16, ReturnMode::Strongest, 10.0).unwrap();
    let streams = [ouster(992_000_000_001), ouster(992_000_000_002), stream(front)];
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path().join("session");
    let (mut child, addresses, rest) = recorder(&dir);
    assert_eq!(addresses.len(), 3, "the recorder listens");
    let begun = Instant::now();
    let until = begun + Duration::from_secs_f64(seconds);
    let (sent, memory, usage) = std::thread::scope(|scope| {
        let senders: Vec<_> = streams
            .iter()
            .zip(&addresses)
            .map(|(stream, to)| scope.spawn(move || send(stream, *to, rate, until)))
            .collect();
        let mut memory = Vec::new();
        while Instant::now() < until {
            std::thread::sleep(Duration::from_millis(250));
            memory.push(Usage::of(&child).resident_mib);
        }
        let usage = Usage::of(&child);
        (senders.into_iter().map(|sender| sender.join().unwrap()).collect::<Vec<u64>>(), memory, usage)
    });
    let took_s = begun.elapsed().as_secs_f64();
    kill(Pid::from_raw(child.id() as i32), Signal::SIGINT).unwrap();
    let code = child.wait().unwrap().code();
    rest.join().unwrap();
    let session = Session::open(&dir).unwrap();
    let (mut unexplained, mut bytes) = (0, 0.0);
    println!("sensor      sent  recorded  kernel  queue  of the rate asked for");
    for ((entry, sent), stream) in session.manifest().sensors.iter().zip(&sent).zip(&streams) {
        let turn_s = stream.len() as f64 / (stream[stream.len() - 1].0 - stream[0].0) as f64 * 1e9;
        let missing = sent - entry.packets.min(*sent);
        unexplained += missing.saturating_sub(entry.losses.total());
        bytes += entry.packets as f64 * stream[0].1.len() as f64;
        println!(
            "{:<8} {:>7} {:>9} {:>7} {:>6} {:>6.1} %",
            entry.name,
            sent,
            entry.packets,
            entry.losses.kernel_dropped,
            entry.losses.queue_dropped,
            100.0 * *sent as f64 / (turn_s * rate * took_s)
        );
    }
    let lost = session.manifest().losses.total();
    println!(
        "{rate} times for {took_s:.1} s: {:.0} MB a second to the session, {lost} packets lost; processor {:.2} cores; \
         resident {:.0} MiB, {:.0} MiB at most; exit code {}",
        bytes * 1e-6 / took_s,
        usage.cpu_s / took_s,
        median(memory.clone()),
        memory.iter().copied().fold(0.0, f64::max),
        code.unwrap_or(-1)
    );
    println!("missing and not counted: {unexplained} packets; session problems: {:?}", session.problems());
    if unexplained > 0 || !session.problems().is_empty() {
        std::process::exit(1);
    }
}
