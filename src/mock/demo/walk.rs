//! Third stage: the platform walks, two mock sensors speak over UDP, everything is recorded as from real devices.

use std::net::{Ipv4Addr, SocketAddr};
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use crate::base::errors::with_causes;
use crate::live::receive::{self, Listen, Receiver, now_ns};
use crate::mock::sensor::MockSensor;
use crate::mock::transmit::{Clock, Pace};
use crate::recording::{LiveRecording, Manifest, SensorInfo, SessionWriter};
use crate::rig::Mount;
use crate::simulate::Progress;

use super::error::DemoError;
use super::sensors::{SensorProgress, mock_sensor, send_packets, write_reports};
use super::setup::{DemoFault, Walk};
use super::tilt::Tilted;

/// Time after the last packet for the receiver to empty its sockets.
const DRAIN: Duration = Duration::from_millis(200);

/// What came of it.
pub(crate) struct Walked {
    pub manifest: Manifest,
    pub packets_sent: Vec<u64>,
    /// What ended the walk early.
    pub failure: Option<DemoError>,
}

/// Walks and records into a new session. Whatever fails, the session is closed and can be opened.
pub(crate) fn record(
    walk: &Walk<'_>,
    tilted: Tilted,
    session: &Path,
    progress: &dyn Fn(Progress),
) -> Result<Walked, DemoError> {
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
    let recording = LiveRecording::start(receiver, writer)?;
    let sent: Vec<AtomicU64> = devices.iter().map(|_| AtomicU64::new(0)).collect();
    let failure = walk_along(walk, tilted, &recording, devices, &sent, progress);
    std::thread::sleep(DRAIN);
    if let Err(failure) = &failure {
        // the disk may be what failed; the manifest says so too
        let _ = recording.session().write_event(&Event { time_ns: now_ns(), event: with_causes(failure) });
    }
    let manifest = recording.stop()?;
    let packets_sent = sent.iter().map(|count| count.load(Ordering::Relaxed)).collect();
    Ok(Walked { manifest, packets_sent, failure: failure.err() })
}

#[derive(serde::Serialize)]
struct Event {
    time_ns: u64,
    event: String,
}

/// Runs the mock sensors to the end of the trajectory, or to the first thing that fails.
fn walk_along(
    walk: &Walk<'_>,
    tilted: Tilted,
    recording: &LiveRecording,
    devices: Vec<(MockSensor, SocketAddr)>,
    sent: &[AtomicU64],
    progress: &dyn Fn(Progress),
) -> Result<(), DemoError> {
    let Tilted { device, servo, true_pitch_rad } = tilted;
    let mut device = Some(device);
    let reports = servo.reports();
    let [start_ns, end_ns] = walk.trajectory.time_span_ns();
    progress(Progress::Total(end_ns - start_ns));
    let at_ns: Vec<AtomicU64> = devices.iter().map(|_| AtomicU64::new(start_ns)).collect();
    let unplugged: Vec<AtomicBool> = devices.iter().map(|_| AtomicBool::new(false)).collect();
    // what a busy machine loses is no finding about the tool
    let clock = Clock::new(Pace::Rate(walk.rate), Some(start_ns)).patient();
    std::thread::scope(|scope| {
        let mut running = Vec::new();
        for (index, (mut sensor, address)) in devices.into_iter().enumerate() {
            let mount = Mount { pitch_rad: true_pitch_rad[index % 2], ..walk.rig.sensors[index].mount };
            let shared =
                SensorProgress { at_ns: &at_ns[index], unplugged: &unplugged[index], sent: &sent[index] };
            running
                .push(scope.spawn(move || send_packets(walk, &mut sensor, &mount, address, clock, &shared)));
        }
        let middle_ns = start_ns + (end_ns - start_ns) / 2;
        let pull_every_plug = || unplugged.iter().for_each(|plug| plug.store(true, Ordering::Relaxed));
        let mut outcome = Ok(());
        while running.iter().any(|sensor| !sensor.is_finished()) {
            let farthest_ns = at_ns.iter().map(|at| at.load(Ordering::Relaxed)).max().unwrap_or(start_ns);
            progress(Progress::At(farthest_ns - start_ns));
            if farthest_ns >= middle_ns {
                match walk.fault {
                    Some(DemoFault::CutCable) => drop(device.take()),
                    Some(DemoFault::KillSensor) => unplugged[0].store(true, Ordering::Relaxed),
                    None => {}
                }
            }
            let written = write_reports(walk, recording, &servo, &reports);
            if written.is_err() {
                pull_every_plug();
                outcome = written;
                break;
            }
        }
        for sensor in running {
            match sensor.join() {
                Ok(sensor) => outcome = outcome.and(sensor),
                Err(_) => outcome = outcome.and(Err(DemoError::SensorPanicked)),
            }
        }
        outcome
    })
}
