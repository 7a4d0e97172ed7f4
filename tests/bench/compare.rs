//! The whole of `outrigger compare` on a long recording: two OS1-64 on 47 m through the furnished house of
//! `OUTRIGGER_SHARED`, 391 revolutions of 1024 columns, 51 million rays, with its null runs: wall time, processor time
//! and memory of the process.
//!
//!     cargo bench --bench compare
//!     OUTRIGGER_BENCH_SECONDS=10 cargo bench --bench compare      # the first ten seconds of the walk
//!
//! The session goes to the system's temporary folder (`TMPDIR`), some hundred MB of it.

#![allow(clippy::unwrap_used)] // a bench that cannot run may say so and end

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

use outrigger::mock::sensor::{MockSensor, Surroundings};
use outrigger::recording::{SensorInfo, SessionWriter};
use outrigger::rig::{Mount, MountFile, SensorEntry};
use outrigger::world::scene::{Scene, load_mesh};
use outrigger::world::trajectory::{PoseError, Trajectory};
use sensors::Packet;
use sensors::ouster::{Metadata, Profile, Synthetic};
use serde_json::Value;

#[path = "support.rs"]
mod support;
use support::{Usage, environment};

const TILT_DEG: f64 = 32.7;
const SIDES: [(&str, f64); 2] = [("right", 1.0), ("left", -1.0)];

fn entry(name: &str, side: f64) -> SensorEntry {
    SensorEntry {
        name: name.into(),
        model: "os1-64".into(),
        x_m: 0.05 * side,
        y_m: 0.0,
        z_m: 0.1,
        pitch_deg: TILT_DEG * side,
        ..SensorEntry::default()
    }
}

/// A session of the walk, its poses a little off, as they are.
fn record(session: &Path, house: &Path, way: &Trajectory) {
    let scene = Scene::Mesh(std::sync::Arc::new(load_mesh(house, None, None).unwrap().mesh));
    let truth = PoseError::default().disturb(way, 1);
    let metadata = |number: u64| {
        let wanted = Synthetic::new("os1-64", 992_000_000_001 + number, Profile::Rng15Rfl8Nir8);
        Metadata::synthetic(&wanted.columns(1024, 16)).unwrap()
    };
    let infos: Vec<SensorInfo> = (0..2)
        .map(|number| SensorInfo {
            name: SIDES[number].0.into(),
            metadata: Some(metadata(number as u64).to_json()),
            ..SensorInfo::default()
        })
        .collect();
    let writer = SessionWriter::create(session, &infos).unwrap();
    let destination: SocketAddr = "10.0.0.100:7502".parse().unwrap();
    for (number, (_, side)) in SIDES.into_iter().enumerate() {
        let pitch_rad = (TILT_DEG * side).to_radians();
        let seat = Mount { x_m: 0.05 * side, z_m: 0.1, pitch_rad, ..Mount::default() }.body_from_sensor();
        let surroundings = Surroundings {
            scene: &scene,
            trajectory: &truth,
            body_from_sensor: &|_| seat,
            noise_m: 0.01,
            seed: number as u64,
        };
        let source: SocketAddr = format!("10.0.0.{}:50000", number + 1).parse().unwrap();
        MockSensor::ouster(metadata(number as u64))
            .run(&surroundings, |host_time_ns, payload| {
                writer.write_packet(
                    number,
                    &Packet { host_time_ns, source, destination, link: Default::default(), payload },
                )
            })
            .unwrap();
    }
    writer.put_mount(&MountFile::new(SIDES.map(|(name, side)| entry(name, side)).to_vec()), &[]).unwrap();
    writer.flush().unwrap();
    writer.put_trajectory(way).unwrap();
    writer.close(None).unwrap();
}

fn main() {
    let shared =
        std::env::var_os("OUTRIGGER_SHARED").map_or_else(|| PathBuf::from("../shared"), PathBuf::from);
    let (house, way) =
        (shared.join("scenes/house.ply"), shared.join("reference/validation/house_trajectory.tum"));
    let Ok(bytes) = std::fs::read(&way) else {
        println!("LEFT OUT: no {} (OUTRIGGER_SHARED)", way.display());
        return;
    };
    let whole = Trajectory::read(&bytes, None).unwrap().trajectory;
    let [start_ns, _] = whole.time_span_ns();
    let end_ns = start_ns.saturating_add((1e9 * environment("OUTRIGGER_BENCH_SECONDS", 1e6)) as u64);
    let way = Trajectory::new(whole.stamped().filter(|(time_ns, _)| *time_ns <= end_ns).collect()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let session = folder.path().join("session");
    let start = Instant::now();
    record(&session, &house, &way);
    println!("recorded in {:.1} s", start.elapsed().as_secs_f64());
    let out = std::fs::File::create(folder.path().join("said.json")).unwrap();
    let start = Instant::now();
    let mut child = Command::new(env!("CARGO_BIN_EXE_outrigger"))
        .args(["compare", "--json", "--scene"])
        .args([&house, &session])
        .stdout(Stdio::from(out))
        .spawn()
        .unwrap();
    let (mut most_mib, mut cpu_s) = (0.0, 0.0);
    let status = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        let usage = Usage::of(&child);
        most_mib = f64::max(most_mib, usage.resident_mib);
        cpu_s = f64::max(cpu_s, usage.cpu_s);
        std::thread::sleep(std::time::Duration::from_millis(100));
    };
    let wall_s = start.elapsed().as_secs_f64();
    let said = std::fs::read_to_string(folder.path().join("said.json")).unwrap();
    let document: Value = serde_json::from_str(&said).unwrap();
    let number = |sensor: &str, name: &str| document["rays"][sensor][name].as_f64().unwrap_or(0.0);
    let rays: f64 = SIDES
        .iter()
        .flat_map(|(sensor, _)| {
            ["agree", "short", "long", "drop", "extra", "nothing"].map(|name| number(sensor, name))
        })
        .sum();
    println!("{} exit {:?}, {:.1} million rays", document["verdict"], status.code(), 1e-6 * rays);
    println!("wall {wall_s:.1} s, processor {cpu_s:.1} s, {most_mib:.0} MiB at most");
    println!("tilt of one against the other: {}", document["relative_tilt"]);
}
