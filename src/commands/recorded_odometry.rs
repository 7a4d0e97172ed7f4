//! Odometry of a recording: its options, and the passes over the recording.

use anyhow::{bail, ensure};
use sensors::Decoded;

use super::recorded::Recorded;
use super::recorded::data_gaps;
use super::recording::Recording;
use super::scene_placement;
use super::{Context, unread};
use crate::base::geometry::Pose;
use crate::rig::{Mount, MountedSensor};
use crate::verify::compare::{FramePitch, RecordedRay, Thinning};
use crate::verify::odometry::{Limits, OdometryPass, Settings, Walked};
use crate::world::trajectory::suspicions;

/// Ranges that odometry uses where nothing else is asked for, m.
const NEAREST_M: f64 = 0.5;
const FARTHEST_M: f64 = 100.0;

/// How odometry samples a recording.
#[derive(clap::Args, Debug)]
pub struct OdometryArgs {
    /// Edge of a cell of odometry's map; by default a fifteenth of the median range, between 0.1 and 1 m.
    #[arg(long = "odometry-voxel", id = "odometry_voxel", value_name = "M", value_parser = crate::commands::ranges::within(0.01, 100.0))]
    voxel_m: Option<f64>,
    /// Returns nearer than this are not used by odometry: whoever carries the rig moves with it.
    #[arg(long = "odometry-min-range", id = "odometry_min_range", value_name = "M", default_value_t = NEAREST_M, value_parser = crate::commands::ranges::within(0.0, 10_000.0))]
    nearest_m: f64,
    /// Returns farther than this are not used by odometry.
    #[arg(long = "odometry-max-range", id = "odometry_max_range", value_name = "M", default_value_t = FARTHEST_M, value_parser = crate::commands::ranges::within(1e-3, 10_000.0))]
    farthest_m: f64,
}

impl Default for OdometryArgs {
    fn default() -> Self {
        Self { voxel_m: None, nearest_m: NEAREST_M, farthest_m: FARTHEST_M }
    }
}

impl OdometryArgs {
    /// Refuses what was typed about odometry where the trajectory is not found by it.
    pub(crate) fn ensure_not_typed(context: Context) -> anyhow::Result<()> {
        context.ensure_not_typed(
            &["odometry_voxel", "odometry_min_range", "odometry_max_range"],
            "is about a trajectory by odometry, and --trajectory names another",
        )
    }

    pub(crate) fn check(&self) -> anyhow::Result<()> {
        if !(0.0..self.farthest_m).contains(&self.nearest_m) {
            refuse!("--odometry-min-range {}, expected from 0 to the maximum range", self.nearest_m);
        }
        Ok(())
    }

    pub(crate) fn pass(&self, sensors: usize) -> OdometryPass {
        let limits = Limits { nearest_m: self.nearest_m, farthest_m: self.farthest_m };
        OdometryPass::new(sensors, limits, Settings { voxel_m: self.voxel_m, reach_m: 1.5 * self.farthest_m })
    }
}

/// A trajectory by odometry, with what was lost on it.
pub struct OdometryResult {
    pub walked: Walked,
    pub sensors: Vec<String>,
    /// Middle of every revolution of the first sensor, ns.
    pub revolutions_ns: Vec<u64>,
    pub losses: Vec<String>,
    /// What else is odd about its recording.
    pub notices: Vec<String>,
    /// An even share of its returns, in order of time; none where they were not asked for.
    pub rays: Vec<RecordedRay>,
    /// With the beams of their packets.
    pub mounted: Vec<MountedSensor>,
}

/// Where a rig of known mounts went.
pub(crate) fn of_rig(
    recorded: &Recorded,
    args: &OdometryArgs,
    keeps_rays: bool,
) -> anyhow::Result<OdometryResult> {
    args.check()?;
    let rig = &recorded.rig;
    let mut pass = args.pass(rig.sensors.len());
    let (mut share, mut mounted) =
        (keeps_rays.then(|| Thinning::new(scene_placement::RAYS)), rig.sensors.clone());
    let mut summary = recorded.feed(&mut |mounted_frame| {
        mounted_frame.tell_model(&mut mounted);
        if let Some(share) = &mut share {
            let pitch = mounted_frame.pitch_or(&rig.sensors[mounted_frame.sensor].mount);
            share.add_frame(mounted_frame.sensor, mounted_frame.model, &pitch, 0, mounted_frame.frame);
        }
        let body_from_sensor = mounted_frame.body_from_sensor(&rig.sensors[mounted_frame.sensor].mount);
        pass.add_frame(mounted_frame.sensor, mounted_frame.model, &body_from_sensor, mounted_frame.frame);
    })?;
    if let Some(([first, second], apart_s)) = data_gaps::apart(rig, &summary.data_spans) {
        bail!(
            "{second} begins {apart_s:.3} s after {first} has ended, by their clocks: a trajectory needs sensors recorded \
             at once, on one clock (PTP, or GPS)"
        );
    }
    let contradicted = recorded.contradicted(&summary);
    let (walked, revolutions_ns) = pass.finish(&mut summary.losses)?;
    Ok(OdometryResult {
        walked,
        revolutions_ns,
        sensors: rig.sensors.iter().map(|sensor| sensor.name.clone()).collect(),
        losses: summary.losses,
        notices: contradicted
            .into_iter()
            .chain(summary.faults.into_iter().map(|fault| fault.words))
            .collect(),
        rays: Thinning::joined(share),
        mounted,
    })
}

/// Where the only sensor of a recording went.
pub(crate) fn of_one(
    recording: &Recording,
    args: &OdometryArgs,
    keeps_rays: bool,
) -> anyhow::Result<OdometryResult> {
    let mut router = recording.router()?;
    let mut pass = args.pass(1);
    let mut sensors = 0;
    let mut share = keeps_rays.then(|| Thinning::new(scene_placement::RAYS));
    let mut hand = |at: usize, sensor: &sensors::router::Sensor, decoded: Decoded<'_>| {
        let (Decoded::Frame(frame), Some(model)) = (decoded, sensor.model()) else { return };
        sensors = sensors.max(at + 1);
        if at == 0 {
            pass.add_frame(0, model, &|_| Pose::IDENTITY, frame);
            if let Some(share) = &mut share {
                share.add_frame(0, model, &FramePitch::constant(0.0), 0, frame);
            }
        }
    };
    let ending = recording.each_packet(&mut |packet| {
        router.push(packet, &mut hand);
        Ok(())
    })?;
    router.finish(&mut hand);
    ensure!(sensors > 0, "{}", unread::why_nothing(recording, &router, &ending));
    ensure!(sensors == 1, "{} holds {sensors} sensors: --mount says where they sit", recording.name());
    recording.ensure_given_fits(&router)?;
    let mut losses = ending.losses();
    let names: Vec<String> = router.sensors().iter().map(|sensor| sensor.product().to_string()).collect();
    for (sensor, name) in router.sensors().iter().zip(&names) {
        losses.extend(unread::sensor_losses(name, sensor));
    }
    let notices = unread::unknown_sources(&router).chain(unread::beam_notices(&router)).collect();
    let (walked, revolutions_ns) = pass.finish(&mut losses)?;
    let only = router.sensors().first().and_then(|sensor| sensor.model().cloned()).zip(names.first());
    let mounted =
        only.map(|(model, name)| MountedSensor { name: name.clone(), model, mount: Mount::default() });
    let (rays, mounted) = (Thinning::joined(share), mounted.into_iter().collect());
    Ok(OdometryResult { walked, sensors: names, revolutions_ns, losses, notices, rays, mounted })
}

/// What is odd about a trajectory by odometry, in words.
pub(crate) fn remarks(result: &OdometryResult) -> Vec<String> {
    let mut remarks = result.losses.clone();
    remarks.extend(result.walked.problems.iter().cloned());
    remarks.extend(result.walked.open_direction());
    remarks.extend(suspicions(&result.walked.trajectory, "trajectory found"));
    remarks
}
