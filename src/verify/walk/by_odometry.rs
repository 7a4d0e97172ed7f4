//! Odometry of a recording: the passes over its frames.

use sensors::Decoded;

use super::error::WalkError;
use super::in_scene::RAYS;
use crate::base::geometry::Pose;
use crate::recording::mounted::{MountedRecording, apart};
use crate::recording::{FramePitch, Recording, RecordingError, unread};
use crate::rig::{Mount, MountedSensor};
use crate::verify::compare::{RecordedRay, Thinning};
use crate::verify::odometry::{Limits, OdometryPass, Settings, Walked};
use crate::world::trajectory::suspicions;

/// How odometry samples a recording.
#[derive(Clone, Copy, Debug)]
pub(crate) struct OdometrySpec {
    /// Edge of a voxel of the map, m; by default a share of the ranges.
    pub voxel_m: Option<f64>,
    /// Returns nearer or farther are not used, m.
    pub nearest_m: f64,
    pub farthest_m: f64,
}

impl Default for OdometrySpec {
    fn default() -> Self {
        Self { voxel_m: None, nearest_m: 0.5, farthest_m: 100.0 }
    }
}

impl OdometrySpec {
    pub(crate) fn check(&self) -> Result<(), WalkError> {
        match (0.0..self.farthest_m).contains(&self.nearest_m) {
            true => Ok(()),
            false => Err(WalkError::Ranges { nearest_m: self.nearest_m }),
        }
    }

    pub(super) fn pass(&self, sensors: usize) -> OdometryPass {
        let limits = Limits { nearest_m: self.nearest_m, farthest_m: self.farthest_m };
        OdometryPass::new(sensors, limits, Settings { voxel_m: self.voxel_m, reach_m: 1.5 * self.farthest_m })
    }
}

/// A trajectory by odometry, with what was lost on it.
pub(crate) struct OdometryResult {
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

impl OdometryResult {
    /// Where a rig of known mounts went.
    pub(crate) fn of_rig(
        recorded: &MountedRecording,
        spec: &OdometrySpec,
        keeps_rays: bool,
    ) -> Result<Self, WalkError> {
        spec.check()?;
        let rig = &recorded.rig;
        let mut pass = spec.pass(rig.sensors.len());
        let (mut share, mut mounted) = (keeps_rays.then(|| Thinning::new(RAYS)), rig.sensors.clone());
        let mut summary = recorded.feed(&mut |mounted_frame| {
            mounted_frame.tell_model(&mut mounted);
            if let Some(share) = &mut share {
                let pitch = mounted_frame.pitch_or(&rig.sensors[mounted_frame.sensor].mount);
                share.add_frame(mounted_frame.sensor, mounted_frame.model, &pitch, 0, mounted_frame.frame);
            }
            let body_from_sensor = mounted_frame.body_from_sensor(&rig.sensors[mounted_frame.sensor].mount);
            pass.add_frame(mounted_frame.sensor, mounted_frame.model, &body_from_sensor, mounted_frame.frame);
        })?;
        if let Some((names, apart_s)) = apart(rig, &summary.data_spans) {
            let [first, second] = names.map(str::to_owned);
            return Err(WalkError::Apart { first, second, apart_s });
        }
        let contradicted = recorded.contradicted(&summary);
        let (walked, revolutions_ns) = pass.finish(&mut summary.losses)?;
        Ok(Self {
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
        spec: &OdometrySpec,
        keeps_rays: bool,
    ) -> Result<Self, WalkError> {
        let mut router = recording.router()?;
        let mut pass = spec.pass(1);
        let mut sensors = 0;
        let mut share = keeps_rays.then(|| Thinning::new(RAYS));
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
        })?;
        router.finish(&mut hand);
        if sensors == 0 {
            let why = unread::why_nothing(recording, &router, &ending);
            return Err(RecordingError::NothingRead(why).into());
        }
        if sensors > 1 {
            return Err(WalkError::SeveralSensors { recording: recording.name(), sensors });
        }
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
        Ok(Self { walked, sensors: names, revolutions_ns, losses, notices, rays, mounted })
    }

    /// What is odd about the trajectory, in words.
    pub(crate) fn remarks(&self) -> Vec<String> {
        let mut remarks = self.losses.clone();
        remarks.extend(self.walked.problems.iter().cloned());
        remarks.extend(self.walked.open_direction());
        remarks.extend(suspicions(&self.walked.trajectory, "trajectory by odometry"));
        remarks
    }
}
