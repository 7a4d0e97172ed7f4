//! The daemon under load: two OS1-128 with two returns (5.2 million points a second together) and a VLP-16, recorded,
//! decoded and shown to one page, on whatever cores this machine has, shared with the senders.
//!
//!     cargo bench --bench daemon                        # 20 s
//!     OUTRIGGER_BENCH_SECONDS=600 cargo bench --bench daemon
//!
//!     OUTRIGGER_BENCH_SIEGE=1 OUTRIGGER_BENCH_SECONDS=300 cargo bench --bench daemon
//!
//! Besieged, sensors send 32 MB/s (one return each), while 200 connections from four addresses bring headers and bodies
//! letter by letter, 50 pages listen of which 10 never read, and emergency stops are asked for at random moments.
//!
//! Ends with exit status 1 when packets are missing that neither the kernel nor the daemon counted; besieged, also when
//! any packet was lost, or a stop took 100 ms.

#![allow(clippy::unwrap_used)] // a bench that cannot run may say so and end

use std::io::{BufRead as _, BufReader, Read as _};
use std::net::{SocketAddr, TcpStream};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use glam::DVec3;
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use outrigger::base::geometry::Pose;
use outrigger::daemon::POINTS_KIND;
use outrigger::live::receive::now_ns;
use outrigger::mock::rig::{MockConfig, MockRig};
use outrigger::mock::sensor::{MockSensor, Surroundings};
use outrigger::mock::transmit::{Clock, Pace, Transmitter};
use outrigger::recording::Session;
use outrigger::world::scene::{BoxScene, Scene};
use outrigger::world::trajectory::Trajectory;
use sensors::ouster::{Metadata, OusterDecoder, OusterEncoder, Profile, Synthetic};
use sensors::velodyne::{Product, ReturnMode};
use sensors::{Decoded, Decoder as _, Frame, Packet};
use serde_json::Value;

#[path = "../daemon/crowd.rs"]
mod crowd;
#[path = "daemon/siege.rs"]
mod siege;
#[path = "support.rs"]
mod support;
use support::{Usage, environment, median};

const SERIALS: [u64; 2] = [992_000_000_001, 992_000_000_002];

fn metadata(serial: u64) -> Metadata {
    let profile = if is_besieged() { Profile::Rng19Rfl8Sig16Nir16 } else { Profile::Rng19Rfl8Sig16Nir16Dual };
    let wanted = Synthetic::new("os1-128", serial, profile).columns(1024, 16);
    Metadata::synthetic(&wanted).unwrap()
}

fn is_besieged() -> bool {
    environment("OUTRIGGER_BENCH_SIEGE", 0.0) > 0.0
}

fn hall() -> Scene {
    Scene::Box(BoxScene::closed(DVec3::new(-12.0, -8.0, -1.5), DVec3::new(12.0, 8.0, 4.0)))
}

fn standing(seconds: f64) -> Trajectory {
    let start_ns = now_ns();
    let end_ns = start_ns + (seconds * 1e9) as u64;
    Trajectory::new(vec![(start_ns, Pose::IDENTITY), (end_ns, Pose::IDENTITY)]).unwrap()
}

/// Sensors at the body's own place.
fn around<'a>(scene: &'a Scene, trajectory: &'a Trajectory) -> Surroundings<'a> {
    Surroundings { scene, trajectory, body_from_sensor: &|_| Pose::IDENTITY, noise_m: 0.0, seed: 0 }
}

/// One revolution of a sensor, with both returns where it sends both.
fn revolution(metadata: &Metadata) -> Frame {
    let (scene, trajectory) = (hall(), standing(0.25));
    let around = around(&scene, &trajectory);
    let mut decoder = OusterDecoder::new(metadata.clone());
    let address: SocketAddr = "127.0.0.1:7502".parse().unwrap();
    let mut whole = None;
    let mut sensor = MockSensor::ouster(metadata.clone());
    let sent = sensor.run(&around, |host_time_ns, payload| {
        let packet =
            Packet { host_time_ns, source: address, destination: address, link: Default::default(), payload };
        decoder
            .push(&packet, &mut |decoded| {
                if let (Decoded::Frame(frame), None) = (decoded, &whole)
                    && frame.complete
                {
                    whole = Some(frame.clone());
                }
            })
            .map_err(|_| ())
    });
    sent.unwrap();
    let mut frame = whole.unwrap();
    frame.second = (!is_besieged()).then(|| frame.first.clone());
    frame
}

/// Sends an OS1-128 until told to stop; packets sent.
fn ouster(metadata: Metadata, to: SocketAddr, stop: &AtomicBool) -> u64 {
    let mut frame = revolution(&metadata);
    let mut encoder = OusterEncoder::new(metadata);
    let start_ns = now_ns();
    let mut line = Transmitter::new(None, to, Clock::new(Pace::Rate(1.0), Some(start_ns))).unwrap();
    let columns = frame.columns() as u64;
    let mut sent = 0;
    for turn in 0u64.. {
        frame.frame_id = (turn % 65_536) as u32;
        for (column, time_ns) in (0..).zip(&mut frame.column_time_ns) {
            *time_ns = start_ns + (turn * columns + column) * 100_000_000 / columns;
        }
        let mut times =
            frame.column_time_ns.chunks(16).map(|times| times[15]).collect::<Vec<u64>>().into_iter();
        encoder.frame(&frame, &mut |payload| {
            line.send(times.next().unwrap(), payload, to).unwrap();
            sent += 1;
        });
        if stop.load(Ordering::Relaxed) {
            break;
        }
    }
    sent
}

fn velodyne(to: SocketAddr, stop: &AtomicBool) -> u64 {
    let (scene, trajectory) = (hall(), standing(3600.0));
    let around = around(&scene, &trajectory);
    let start_ns = trajectory.time_span_ns()[0];
    let mut line = Transmitter::new(None, to, Clock::new(Pace::Rate(1.0), Some(start_ns))).unwrap();
    let mut sensor = MockSensor::velodyne(Product::Vlp16, ReturnMode::Strongest, 10.0).unwrap();
    let mut sent = 0;
    let _ = sensor.run(&around, |time_ns, payload| {
        if stop.load(Ordering::Relaxed) {
            return Err(());
        }
        line.send(time_ns, payload, to).unwrap();
        sent += 1;
        Ok(())
    });
    sent
}

/// Times from the kernel's stamp to a page's socket, ms, in order.
fn page(address: SocketAddr, stop: &AtomicBool) -> Vec<f64> {
    let stream = TcpStream::connect(address).unwrap();
    let (mut socket, _) = tungstenite::client(format!("ws://{address}/api/v1/stream"), stream).unwrap();
    let mut times_ms = Vec::new();
    while !stop.load(Ordering::Relaxed) {
        if let Ok(tungstenite::Message::Binary(bytes)) = socket.read()
            && bytes[0] == POINTS_KIND
        {
            let stamp_ns = u64::from_le_bytes(bytes[8..16].try_into().unwrap());
            times_ms.push(now_ns().saturating_sub(stamp_ns) as f64 * 1e-6);
        }
    }
    times_ms.sort_by(f64::total_cmp);
    times_ms
}

fn main() {
    let seconds = environment("OUTRIGGER_BENCH_SECONDS", 20.0);
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let mut config = "format = \"outrigger-rig/1\"\n".to_owned();
    for (name, serial) in ["left", "right"].into_iter().zip(SERIALS) {
        std::fs::write(path(&format!("{name}.json")), metadata(serial).to_json()).unwrap();
        config += &format!(
            "[[sensor]]\nname = \"{name}\"\nmodel = \"os1-128\"\nlisten = \"127.0.0.1:0\"\nmetadata = \"{name}.json\"\n"
        );
    }
    config += "[[sensor]]\nname = \"front\"\nmodel = \"vlp-16\"\nlisten = \"127.0.0.1:0\"\n[daemon]\nroom = \"-12,-8,-1.5,12,8,4\"\n";
    let rig = is_besieged().then(|| MockRig::start(MockConfig::default(), 3).unwrap());
    if let Some(rig) = &rig {
        config += &format!("[rig]\nport = \"{}\"\n", rig.path().display());
    }
    std::fs::write(path("rig.toml"), config).unwrap();
    let mut child = Command::new(env!("CARGO_BIN_EXE_outrigger"))
        .args(["--json", "daemon", "--record", "--listen", "127.0.0.1:0", "--config"])
        .arg(path("rig.toml"))
        .arg("--out")
        .arg(path("sessions"))
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
    let mut text = String::new();
    let ready: Value = loop {
        text += &lines.next().expect("the daemon starts").unwrap();
        if let Ok(ready) = serde_json::from_str(&text) {
            break ready;
        }
    };
    let at = |number: usize| -> SocketAddr {
        ready["sensors"][number]["address"].as_str().unwrap().parse().unwrap()
    };
    let web: SocketAddr =
        ready["url"].as_str().unwrap().trim_start_matches("http://").trim_end_matches('/').parse().unwrap();
    let stop = Arc::new(AtomicBool::new(false));
    while rig.is_some() && status(web)["rig"]["connected"] != true {
        std::thread::sleep(Duration::from_millis(50));
    }
    let load_before = load();
    let (sent, page_ms, memory, status, cpu_s, siege) = std::thread::scope(|scope| {
        let senders = [
            scope.spawn(|| ouster(metadata(SERIALS[0]), at(0), &stop)),
            scope.spawn(|| ouster(metadata(SERIALS[1]), at(1), &stop)),
            scope.spawn(|| velodyne(at(2), &stop)),
        ];
        let page = scope.spawn(|| page(web, &stop));
        let siege = rig.as_ref().map(|_| scope.spawn(|| siege::lay(web, &stop)));
        let begun = Instant::now();
        let mut memory = Vec::new();
        while begun.elapsed() < Duration::from_secs_f64(seconds) {
            std::thread::sleep(Duration::from_millis(500));
            memory.push(Usage::of(&child).resident_mib);
        }
        let status = status(web);
        let cpu_s = Usage::of(&child).cpu_s;
        stop.store(true, Ordering::Relaxed);
        let sent: Vec<u64> = senders.map(|sender| sender.join().unwrap()).to_vec();
        let siege = siege.map(|siege| siege.join().unwrap());
        (sent, page.join().unwrap(), memory, status, cpu_s, siege)
    });
    std::thread::sleep(Duration::from_millis(500));
    kill(Pid::from_raw(child.id() as i32), Signal::SIGTERM).unwrap();
    let code = child.wait().unwrap().code();
    let dir = std::fs::read_dir(path("sessions")).unwrap().next().unwrap().unwrap().path();
    let session = Session::open(&dir).unwrap();
    let (mut unexplained, mut lost_here) = (0, 0);
    println!("sensor   points/s    sent  recorded  kernel  queue  not drawn");
    for (number, (entry, sent)) in session.manifest().sensors.iter().zip(&sent).enumerate() {
        let live = &status["sensors"][number];
        let lost = entry.losses;
        lost_here += sent - entry.packets.min(*sent);
        unexplained += sent - entry.packets.min(*sent) - lost.total().min(sent - entry.packets.min(*sent));
        println!(
            "{:<8} {:>8.2} M {:>7} {:>9} {:>7} {:>6} {:>6} packets {} revolutions",
            entry.name,
            live["points_per_s"].as_f64().unwrap() * 1e-6,
            sent,
            entry.packets,
            lost.kernel_dropped,
            lost.queue_dropped,
            live["picture_dropped"],
            live["frames_not_drawn"],
        );
    }
    let share =
        |share: f64| page_ms.get(((page_ms.len() - 1) as f64 * share) as usize).copied().unwrap_or(f64::NAN);
    let latency = &status["recorder"]["latency"];
    println!(
        "kernel to session: p50 {:.2} ms, p99 {:.2} ms, most {:.1} ms (on the disk within the second after that)",
        latency["p50_ms"].as_f64().unwrap(),
        latency["p99_ms"].as_f64().unwrap(),
        latency["most_ms"].as_f64().unwrap()
    );
    println!(
        "last packet of a revolution to a page: p50 {:.1} ms, p99 {:.1} ms, {} revolutions",
        share(0.5),
        share(0.99),
        page_ms.len()
    );
    // around each moment: the median of a twentieth of all readings
    let around = |share: f64| {
        let (middle, half) = ((memory.len() as f64 * share) as usize, (memory.len() / 40).max(1));
        median(memory[middle.saturating_sub(half)..(middle + half).min(memory.len())].to_vec())
    };
    println!(
        "resident: {:.0} MiB after a quarter, {:.0} MiB after half, {:.0} MiB at the end, {:.0} MiB at most",
        around(0.25),
        around(0.5),
        around(1.0),
        memory.iter().copied().fold(0.0, f64::max)
    );
    let mib = |name: &str| status["memory"][name].as_f64().unwrap() / f64::from(1 << 20);
    println!(
        "of which packets {:.1} MiB, coverage {:.1} MiB; at most waited for the recorder {:.1} of {:.0} MiB, for the \
         picture {:.1} of {:.0} MiB",
        mib("packets"),
        mib("coverage"),
        mib("queue_most"),
        mib("queue_limit"),
        mib("picture_most"),
        mib("picture_limit")
    );
    println!("processor {:.2} cores; exit code {}", cpu_s / seconds, code.unwrap_or(-1));
    println!("missing and not counted: {unexplained} packets; session problems: {:?}", session.problems());
    let load = format!("load of the machine {load_before} before, {} after", load());
    println!("{load}");
    let has_held = siege.is_none_or(|siege| report(&siege, lost_here));
    if unexplained > 0 || !session.problems().is_empty() || !has_held {
        std::process::exit(1);
    }
}

/// One minute's load average (proc_loadavg(5)).
fn load() -> String {
    let text = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    text.split(' ').next().unwrap_or("?").to_owned()
}

/// Prints what became of a siege; whether all of it held.
fn report(siege: &siege::Outcome, lost: u64) -> bool {
    let at = |sorted: &[f64], share: f64| {
        let place = (sorted.len().saturating_sub(1) as f64 * share) as usize;
        sorted.get(place).copied().unwrap_or(f64::NAN)
    };
    let of = |share: f64| at(&siege.stops_ms, share);
    let (most_ms, late) = (of(1.0), siege.stops_ms.iter().filter(|ms| **ms >= 100.0).count());
    println!(
        "stop: median {:.1} ms, p99 {:.1} ms, most {most_ms:.1} ms, of {}; {late} took 100 ms or more, {} were refused",
        of(0.5),
        of(0.99),
        siege.stops_ms.len(),
        siege.refused_stops
    );
    println!(
        "who asked woke late from its sleep by: median {:.1} ms, p99 {:.1} ms, most {:.1} ms (that is the machine)",
        at(&siege.late_ms, 0.5),
        at(&siege.late_ms, 0.99),
        at(&siege.late_ms, 1.0)
    );
    println!(
        "slow connections opened: {}; streams opened: {}, refused: {}, read: {:.0} MB; packets lost: {lost}",
        siege.slow_opened,
        siege.streams_opened,
        siege.refused_streams,
        siege.stream_bytes as f64 * 1e-6
    );
    lost == 0 && late == 0 && siege.refused_stops == 0
}

fn status(web: SocketAddr) -> Value {
    use std::io::Write as _;
    let mut stream = TcpStream::connect(web).unwrap();
    write!(stream, "GET /api/v1/status HTTP/1.1\r\nHost: {web}\r\nConnection: close\r\n\r\n").unwrap();
    let mut text = String::new();
    stream.read_to_string(&mut text).unwrap();
    serde_json::from_str(text.split_once("\r\n\r\n").unwrap().1).unwrap()
}
