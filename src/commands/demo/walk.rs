//! Third stage: the platform walks, two mock sensors speak over UDP, everything is recorded as from real devices.

use std::net::{Ipv4Addr, SocketAddr};
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::RecvTimeoutError;
use std::time::Duration;

use anyhow::Context as _;
use sensors::ouster::{ImuProfile, Metadata, Profile, Synthetic};
use sensors::velodyne::{Product, ReturnMode};

use crate::base::geometry::Pose;
use crate::commands::stage::Stage;
use crate::drive::ServoReport;
use crate::live::receive::{self, Listen, Receiver, now_ns};
use crate::mock::sensor::{MockSensor, Surroundings};
use crate::mock::transmit::{Clock, Pace, Transmitter};
use crate::recording::{Manifest, Recording, SensorInfo, SessionWriter};
use crate::rig::{Mount, MountFile, Rig};
use crate::simulate::frames::Spin;
use crate::simulate::scan::{self, Scanner};
use crate::world::coverage::{Coverage, VoxelGrid};
use crate::world::scene::Scene;
use crate::world::trajectory::Trajectory;

use super::Fault;
use super::tilt::Tilted;

/// Columns per revolution of a mock Ouster.
const COLUMNS: usize = 512;
/// Revolutions per second.
const SPIN_HZ: f64 = 10.0;
/// Longest pause between two looks at the recording and the devices.
const LOOK_EVERY: Duration = Duration::from_millis(50);
/// Time after the last packet for the receiver to empty its sockets.
const DRAIN: Duration = Duration::from_millis(200);

/// What the walk is given.
pub struct Walk<'a> {
    pub scene: &'a Scene,
    /// The way as planned.
    pub planned: &'a Trajectory,
    /// The way as walked, which the session records.
    pub trajectory: &'a Trajectory,
    pub rig: &'a Rig,
    pub mount: &'a MountFile,
    /// How many times faster than life.
    pub rate: f64,
    pub fault: Option<Fault>,
    pub stop: &'a AtomicBool,
}

/// What came of it.
pub struct Walked {
    pub manifest: Manifest,
    pub packets_sent: Vec<u64>,
    /// What went wrong on the way and ended the walk early.
    pub failure: Option<anyhow::Error>,
}

/// Walks and records into a new session. Whatever fails on the way, the session is closed and can be opened.
pub(crate) fn record(
    walk: &Walk<'_>,
    tilted: Tilted,
    session: &Path,
    stage: &Stage,
) -> anyhow::Result<Walked> {
    let here = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
    let listens: Vec<Listen> = walk
        .rig
        .sensors
        .iter()
        .map(|sensor| Listen { name: sensor.name.clone(), address: here, source: Some(here.ip()) })
        .collect();
    let receiver = Receiver::start(&listens, receive::Options::default())?;
    let mut devices = Vec::new();
    let mut infos = Vec::new();
    for (index, sensor) in walk.rig.sensors.iter().enumerate() {
        let address = receiver.address(index);
        let (device, metadata) = mock_sensor(&sensor.model.name, index, address.port())?;
        infos.push(SensorInfo::of(&listens[index], address, metadata));
        devices.push((device, address));
    }
    let writer = SessionWriter::create(session, &infos)?;
    writer.put_mount(walk.mount, &[])?;
    writer.put_trajectory(walk.trajectory)?;
    let recording = Recording::start(receiver, writer)?;
    let sent: Vec<AtomicU64> = devices.iter().map(|_| AtomicU64::new(0)).collect();
    let failure = walk_along(walk, tilted, &recording, devices, &sent, stage);
    std::thread::sleep(DRAIN);
    if let Err(failure) = &failure {
        // the disk may be what failed; the manifest says so too
        let _ = recording.session().write_event(&Event { time_ns: now_ns(), event: format!("{failure:#}") });
    }
    let manifest = recording.stop()?;
    let packets_sent = sent.iter().map(|count| count.load(Ordering::Relaxed)).collect();
    Ok(Walked { manifest, packets_sent, failure: failure.err() })
}

/// Coverage that the walk promises: perfect sensors on the mounts and the way as planned.
pub(crate) fn promise(walk: &Walk<'_>, grid: &VoxelGrid) -> anyhow::Result<Coverage> {
    let mut scanner = Scanner::new(walk.scene, walk.planned, walk.rig, scan::Spin::default());
    for (index, sensor) in walk.rig.sensors.iter().enumerate() {
        let columns = match mock_sensor(&sensor.model.name, index, 0)?.0.spin() {
            Spin::Angles { columns, .. } => columns as u32,
            Spin::Clock { cycle_ns, rate_hz } => (1e9 / (rate_hz * cycle_ns)).round() as u32,
        };
        scanner.spins[index] = scan::Spin { rate_hz: SPIN_HZ, columns, ..scan::Spin::default() };
    }
    // the mock sensors do not see each other either
    scanner.occluders.iter_mut().for_each(Vec::clear);
    let mut coverage = Coverage::new(grid.clone(), walk.rig.sensors.len());
    scanner.cover(&mut coverage);
    Ok(coverage)
}

#[derive(serde::Serialize)]
struct Event {
    time_ns: u64,
    event: String,
}

fn mock_sensor(model: &str, index: usize, port: u16) -> anyhow::Result<(MockSensor, Option<String>)> {
    if let Some(product) = Product::from_name(model) {
        return Ok((MockSensor::velodyne(product, ReturnMode::Strongest, SPIN_HZ)?, None));
    }
    let serial = 122_000_000_001 + index as u64;
    let mut wanted = Synthetic::new(model, serial, Profile::Rng19Rfl8Sig16Nir16).columns(COLUMNS, 16);
    wanted.frame_rate_hz = SPIN_HZ;
    wanted.lidar_port = port;
    // it sends none, and two sensors that say they send it to one port are refused by ouster-sdk
    wanted.imu_profile = ImuProfile::Off;
    let metadata = Metadata::synthetic(&wanted)?;
    let text = metadata.to_json();
    Ok((MockSensor::ouster(metadata), Some(text)))
}

/// Runs the mock sensors to the end of the trajectory, or to the first thing that fails.
fn walk_along(
    walk: &Walk<'_>,
    tilted: Tilted,
    recording: &Recording,
    devices: Vec<(MockSensor, SocketAddr)>,
    sent: &[AtomicU64],
    stage: &Stage,
) -> anyhow::Result<()> {
    let Tilted { device, servo, true_pitch_rad } = tilted;
    let mut device = Some(device);
    let reports = servo.reports();
    let [start_ns, end_ns] = walk.trajectory.time_span_ns();
    stage.counts(end_ns - start_ns, 0);
    let at_ns: Vec<AtomicU64> = devices.iter().map(|_| AtomicU64::new(start_ns)).collect();
    let unplugged: Vec<AtomicBool> = devices.iter().map(|_| AtomicBool::new(false)).collect();
    let clock = Clock::new(Pace::Rate(walk.rate), Some(start_ns));
    std::thread::scope(|scope| {
        let mut running = Vec::new();
        for (index, (mut sensor, address)) in devices.into_iter().enumerate() {
            let mount = Mount { pitch_rad: true_pitch_rad[index % 2], ..walk.rig.sensors[index].mount };
            let (at_ns, unplugged, sent) = (&at_ns[index], &unplugged[index], &sent[index]);
            running.push(scope.spawn(move || -> anyhow::Result<()> {
                let mut line =
                    Transmitter::new(None, address, clock).context("a mock sensor has no socket")?;
                let body_from_sensor = |_| -> Pose { mount.body_from_sensor() };
                let around = Surroundings {
                    scene: walk.scene,
                    trajectory: walk.trajectory,
                    body_from_sensor: &body_from_sensor,
                    noise_m: 0.0,
                    seed: 0,
                };
                let outcome = sensor.run(&around, |time_ns, payload| {
                    if unplugged.load(Ordering::Relaxed) {
                        return Err(None::<std::io::Error>);
                    }
                    line.send(time_ns, payload, address).map_err(Some)?;
                    at_ns.store(time_ns, Ordering::Relaxed);
                    sent.fetch_add(1, Ordering::Relaxed);
                    Ok(())
                });
                match outcome {
                    Err(Some(error)) => Err(error).context("a mock sensor cannot send"),
                    Ok(()) | Err(None) => Ok(()),
                }
            }));
        }
        let half_way_ns = start_ns + (end_ns - start_ns) / 2;
        let pull_every_plug = || unplugged.iter().for_each(|plug| plug.store(true, Ordering::Relaxed));
        let mut outcome = Ok(());
        while running.iter().any(|sensor| !sensor.is_finished()) {
            let farthest_ns = at_ns.iter().map(|at| at.load(Ordering::Relaxed)).max().unwrap_or(start_ns);
            stage.at(farthest_ns - start_ns);
            if farthest_ns >= half_way_ns {
                match walk.fault {
                    Some(Fault::CutCable) => drop(device.take()),
                    Some(Fault::KillSensor) => unplugged[0].store(true, Ordering::Relaxed),
                    None => {}
                }
            }
            let looked = look(walk, recording, &servo, &reports);
            if looked.is_err() {
                pull_every_plug();
                outcome = looked;
                break;
            }
        }
        for sensor in running {
            match sensor.join() {
                Ok(sensor) => outcome = outcome.and(sensor),
                Err(_) => outcome = outcome.and(Err(anyhow::anyhow!("a mock sensor panicked"))),
            }
        }
        outcome
    })
}

/// Writes waiting servo reports; an error when the rig, the disk or the user ends the walk.
fn look(
    walk: &Walk<'_>,
    recording: &Recording,
    servo: &crate::drive::Rig,
    reports: &std::sync::mpsc::Receiver<ServoReport>,
) -> anyhow::Result<()> {
    anyhow::ensure!(!walk.stop.load(Ordering::Relaxed), "interrupted");
    // why it ended stands in the session, and closing it will say
    anyhow::ensure!(!recording.has_ended(), "the recording ended");
    match reports.recv_timeout(LOOK_EVERY) {
        Ok(report) => {
            recording.session().write_servo(&report)?;
            anyhow::ensure!(
                report.faults.is_empty(),
                "axis {} of the rig reports {}",
                report.axis,
                report.faults.join(", ")
            );
        }
        Err(RecvTimeoutError::Timeout) => {}
        Err(RecvTimeoutError::Disconnected) => {
            servo.status()?;
            anyhow::bail!("the rig no longer reports");
        }
    }
    Ok(())
}
