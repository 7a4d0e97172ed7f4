//! Fourth stage: the session is opened again, its packets are decoded, and what they cover is compared with what the
//! simulator says for the same rays.

use std::collections::BTreeMap;

use anyhow::Context as _;
use sensors::ouster::{Metadata, OusterDecoder};
use sensors::velodyne::{Options, VelodyneDecoder};
use sensors::{Decoded, Decoder};

use crate::compare::{Agreement, CoverageCounts, Replay, TiltHistory, Verdict, surface_cells};
use crate::coverage::Coverage;
use crate::record::Session;
use crate::rig::{MountedSensor, Rig};
use crate::scene::Scene;
use crate::servo::ServoReport;

use super::document::{AxisSummary, Comparison, SensorSummary};

/// By sensor of the session.
type Decoders = Vec<Box<dyn Decoder>>;

/// A session laid against its scene.
pub struct Replayed {
    pub as_driven: Coverage,
    pub recorded: Coverage,
    pub rig: Vec<AxisSummary>,
    pub sensors: Vec<SensorSummary>,
    pub compare: Comparison,
}

/// Opens a session, decodes it, compares it. `planned` is the coverage of the optimal mounts on the planned path.
pub fn compare(
    session: &Session,
    rig: &Rig,
    scene: &Scene,
    planned: &Coverage,
    progress: &mut dyn FnMut(u64),
) -> anyhow::Result<Replayed> {
    let trajectory = session.trajectory()?.context("the session holds no trajectory")?;
    let reports: Vec<ServoReport> = session.servo()?;
    let mut tilts = Vec::new();
    let mut axes = Vec::new();
    for (axis, sensor) in rig.sensors.iter().enumerate() {
        let (tilt, summary) = measured_tilt(axis, sensor, &reports)?;
        tilts.push(tilt);
        axes.push(summary);
    }
    let (mut decoders, placed) = decoders(session, rig)?;
    let mut replay = Replay::new(scene, &trajectory, placed, planned.grid());
    let mut sensors: Vec<SensorSummary> = session
        .manifest()
        .sensors
        .iter()
        .map(|entry| SensorSummary {
            sensor: entry.name.clone(),
            lost: entry.losses.total(),
            ..SensorSummary::default()
        })
        .collect();
    let mut packets = session.packets()?;
    let mut bytes = 0;
    while let Some((sensor, packet)) = packets.next()? {
        sensors[sensor].packets_recorded += 1;
        bytes += packet.payload.len() as u64;
        let summary = &mut sensors[sensor];
        let mut take = |decoded: Decoded<'_>| lay(decoded, sensor, &tilts[sensor], &mut replay, summary);
        // what a decoder refuses it has counted
        let _ = decoders[sensor].push(&packet, &mut take);
        progress(bytes);
    }
    for (sensor, decoder) in decoders.iter_mut().enumerate() {
        let summary = &mut sensors[sensor];
        decoder.finish(&mut |decoded| lay(decoded, sensor, &tilts[sensor], &mut replay, summary));
        let stats = decoder.stats();
        summary.lost += stats.lost_packets + stats.malformed + stats.crc_errors + stats.late;
        summary.complete_frames = stats.complete_frames;
    }
    let Replay { as_driven, recorded, rays, .. } = replay;
    let universe = surface_cells(scene, planned.grid());
    let agreement = Agreement::between(&as_driven.union(), &recorded.union(), universe.as_deref());
    let compare = Comparison {
        verdict: Verdict::of(&agreement, &rays),
        rays: rig.sensors.iter().map(|sensor| sensor.name.clone()).zip(rays).collect::<BTreeMap<_, _>>(),
        agreement,
        execution: Agreement::between(&planned.union(), &as_driven.union(), universe.as_deref()),
        coverage: CoverageCounts {
            planned: planned.union_count(),
            as_driven: as_driven.union_count(),
            recorded: recorded.union_count(),
        },
    };
    Ok(Replayed { as_driven, recorded, rig: axes, sensors, compare })
}

fn lay(
    decoded: Decoded<'_>,
    sensor: usize,
    tilt: &TiltHistory,
    replay: &mut Replay<'_>,
    summary: &mut SensorSummary,
) {
    let Decoded::Frame(frame) = decoded else { return };
    let [first_ns, last_ns] = frame.host_time_ns;
    if let Some(pitch_rad) = tilt.pitch_rad_at(first_ns + (last_ns.saturating_sub(first_ns)) / 2) {
        replay.set_pitch(sensor, pitch_rad);
    }
    summary.frames += 1;
    summary.points += frame.first.points() as u64;
    replay.add_frame(sensor, frame);
}

/// What the axis measured, never what it was told; none of it is an error, not a silent default.
fn measured_tilt(
    axis: usize,
    sensor: &MountedSensor,
    reports: &[ServoReport],
) -> anyhow::Result<(TiltHistory, AxisSummary)> {
    let measured: Vec<(u64, f64)> = reports
        .iter()
        .filter(|report| report.axis == axis && report.source == "measured")
        .map(|report| (report.time_ns, f64::from(report.position_urad) * 1e-6))
        .collect();
    let count = measured.len();
    let sum: f64 = measured.iter().map(|(_, pitch_rad)| pitch_rad).sum();
    let tilt = TiltHistory::new(measured);
    let [least, greatest] = tilt
        .span_rad()
        .with_context(|| format!("no measured angle of axis {axis} ({}) was recorded", sensor.name))?;
    let summary = AxisSummary {
        sensor: sensor.name.clone(),
        target_pitch_deg: sensor.mount.pitch_rad.to_degrees(),
        measured_pitch_deg: (sum / count as f64).to_degrees(),
        measured_span_deg: (greatest - least).to_degrees(),
        reports: count,
    };
    Ok((tilt, summary))
}

/// A decoder per sensor of the session, and the sensors with the beams their packets are placed by.
fn decoders(session: &Session, rig: &Rig) -> anyhow::Result<(Decoders, Vec<MountedSensor>)> {
    let mut decoders: Decoders = Vec::new();
    let mut placed = Vec::new();
    for sensor in &rig.sensors {
        match session.metadata(&sensor.name)? {
            Some(text) => {
                let metadata = Metadata::parse(&text, &sensor.name)?;
                placed.push(MountedSensor { model: metadata.model.clone(), ..sensor.clone() });
                decoders.push(Box::new(OusterDecoder::new(metadata)));
            }
            None => {
                placed.push(sensor.clone());
                decoders.push(Box::new(VelodyneDecoder::new(Options::default())));
            }
        }
    }
    Ok((decoders, placed))
}
