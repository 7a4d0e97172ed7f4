//! Fourth stage: the session is opened again, its packets are decoded, and what they cover is compared with what the
//! simulator says for the same rays, by the code of `compare`.

use super::error::DemoError;
use crate::recording::Session;
use crate::recording::mounted::{
    AxisSummary, AxisZeros, MountedSession, SensorSummary, data_gaps, feed_session, summaries, tilts,
};
use crate::rig::Rig;
use crate::simulate::Progress;
use crate::verify::compare::{Gate, Healthy, Replayed, Replaying, seen_patches};
use crate::verify::judgement::comparison::Comparison;
use crate::verify::judgement::judge::{Inputs, Step, judge};
use crate::world::coverage::Coverage;
use crate::world::local_origin::LocalOrigin;
use crate::world::scene::Scene;

/// Points of the hall's walls.
const SAMPLES: usize = 100_000;
/// Rays stored for the mount check and the healthy runs.
const KEEP_RAYS: usize = 60_000;
/// Distance between the points of the path from which lines of sight are drawn, m.
const STATION_STEP_M: f64 = 1.0;

/// A session laid against its scene.
pub(crate) struct Compared {
    pub replayed: Replayed,
    pub rig: Vec<AxisSummary>,
    pub sensors: Vec<SensorSummary>,
    pub compare: Comparison,
}

/// Opens a session, decodes it, compares it. `planned` is the coverage of the optimal mounts on the planned path.
pub(crate) fn compare(
    session: &Session,
    rig: &Rig,
    scene: &Scene,
    planned: &Coverage,
    progress: &dyn Fn(Progress),
    step: &dyn Fn(Step),
) -> Result<Compared, DemoError> {
    let trajectory = session.trajectory()?.ok_or(DemoError::NoTrajectory)?.trajectory;
    let tilts = tilts(session, rig, &AxisZeros::default())?.histories;
    // what the axis measured, never its setpoint; none of it is an error, not a silent default
    for (axis, (sensor, tilt)) in rig.sensors.iter().zip(&tilts).enumerate() {
        if !tilt.is_measured() {
            return Err(DemoError::NothingMeasured { axis, sensor: sensor.name.clone() });
        }
    }
    let patches = seen_patches(scene, 0.0, &trajectory, (SAMPLES, STATION_STEP_M, 1));
    let gate = Gate { keep_rays: KEEP_RAYS, ..Gate::default() };
    let mounted_session = MountedSession { session, rig, tilts: &tilts, calibrations: &[] };
    let replaying = Replaying {
        scene,
        trajectory: &trajectory,
        rig,
        grid: planned.grid(),
        gate,
        patches: patches.as_ref(),
        mapped: 0..0,
    };
    let (replayed, mut summary) = replaying.run(|take| feed_session(&mounted_session, progress, take))?;
    summary.faults.extend(data_gaps(rig, &summary.data_spans, trajectory.time_span_ns()));
    let compare = judge(
        Inputs {
            is_own_trajectory: false,
            scene,
            trajectory: &trajectory,
            origin: LocalOrigin::default(),
            patches: patches.as_ref(),
            planned: Some(planned),
            healthy: Healthy::default(),
            revolution_ns: summary.revolution_ns,
            agree_within_m: gate.agree_within_m,
            faults: std::mem::take(&mut summary.faults),
            report: step,
        },
        &replayed,
    );
    let axes = summaries(rig, &AxisZeros::default(), &summary.pitches);
    Ok(Compared { replayed, rig: axes, sensors: summary.sensors, compare })
}
