//! What `cut` knows of a recording's sensors before any packet is written: names, frames, times of revolutions.

use std::collections::BTreeMap;
use std::ops::{ControlFlow, RangeInclusive};

use ::sensors::Decoded;
use ::sensors::router::{Router, Sensor};

use super::{CuttingError, CuttingSpec};
use crate::recording::bags::{RecordedTrajectory, Surroundings};
use crate::recording::read_trajectory;
use crate::recording::registered::WORLD;
use crate::recording::sensor_ids;
use crate::recording::source::{Recording, RecordingError};
use crate::rig::{BASE, MountFile, NamedFrame, framed};
use crate::world::trajectory::Trajectory;

/// What has to be known before a packet is written.
#[derive(Clone, Copy)]
pub(super) struct Needs {
    /// Which sensor sent it.
    pub(super) sensors: bool,
    /// Which revolution it belongs to.
    pub(super) frames: bool,
    /// Where the sensors sit.
    pub(super) transforms: bool,
}

/// The sensors of one recording.
pub(super) struct SensorsOf<'a> {
    pub(super) recording: &'a Recording,
    pub(super) router: Router,
    /// When the packets of the wanted revolutions came, by sensor.
    pub(super) revolutions: BTreeMap<usize, RangeInclusive<u64>>,
    pub(super) first_names: Vec<String>,
    /// Name of each sensor, and whether it is wanted.
    pub(super) names: BTreeMap<usize, (String, bool)>,
    /// Still to be written.
    pub(super) transforms: Option<Vec<NamedFrame>>,
    pub(super) trajectory: Option<Poses>,
}

/// Where the rig was, as far as it is not written yet.
pub(super) struct Poses {
    trajectory: Trajectory,
    parent: String,
    child: String,
    written: usize,
    /// Whether a packet came in its time.
    is_met: bool,
}

impl Poses {
    /// From just before the first time that is asked for until just behind this one; host clock, ns.
    pub(super) fn until(&mut self, time_ns: u64) -> impl Iterator<Item = (u64, NamedFrame)> {
        let [first_ns, last_ns] = self.trajectory.time_span_ns();
        self.is_met |= (first_ns..=last_ns).contains(&time_ns);
        let until = self.trajectory.poses_until(time_ns);
        let first = if self.written == 0 { until.saturating_sub(1) } else { self.written };
        let behind = if until == 0 { 0 } else { until + 1 };
        self.written = self.written.max(behind);
        let frame = |(time_ns, pose)| {
            let (parent, name) = (self.parent.clone(), self.child.clone());
            (time_ns, NamedFrame { name, parent, parent_from_frame: pose })
        };
        self.trajectory.stamped().skip(first).take(behind.saturating_sub(first)).map(frame)
    }

    /// That no packet came in its time, in words.
    pub(super) fn loss(&self) -> Option<String> {
        let [first_ns, last_ns] = self.trajectory.time_span_ns().map(|time_ns| time_ns as f64 * 1e-9);
        (!self.is_met).then(|| {
            format!(
                "no packet came in the time of the trajectory, {first_ns:.3} to {last_ns:.3} s on the host's clock"
            )
        })
    }
}

impl<'a> SensorsOf<'a> {
    /// `is_first` says that nothing is written yet.
    pub(super) fn read(
        spec: &CuttingSpec,
        recording: &'a Recording,
        (needs, is_first): (Needs, bool),
    ) -> Result<Self, CuttingError> {
        let first_names = if needs.sensors { names_of(recording)? } else { Vec::new() };
        Ok(Self {
            recording,
            router: if needs.sensors { recording.router()? } else { Router::new() },
            revolutions: if needs.frames { revolutions(spec, recording)? } else { BTreeMap::new() },
            transforms: match needs.transforms && is_first {
                true => static_frames(spec, recording, &first_names)?,
                false => None,
            },
            trajectory: match needs.transforms && is_first {
                true => poses(spec, recording)?,
                false => None,
            },
            first_names,
            names: BTreeMap::new(),
        })
    }
}

/// Packets looked at before any is written, to know what the sensors are.
const LOOK_AHEAD: u64 = 20_000;

/// The frames of the sensors, by `--mount` or the recording itself.
fn static_frames(
    spec: &CuttingSpec,
    recording: &Recording,
    names: &[String],
) -> Result<Option<Vec<NamedFrame>>, CuttingError> {
    let mount = match (&spec.mount, recording.checked_session()) {
        (Some(path), _) => Some(MountFile::read(path)?),
        (None, Some(session)) => session.mount()?,
        (None, None) => None,
    };
    if let Some(mut mount) = mount {
        // sensors of a capture have no names of their own: they are those of the mount file in their order
        let is_named = names.iter().any(|name| mount.sensors.iter().any(|entry| entry.name == *name));
        for (entry, name) in mount.sensors.iter_mut().zip(names).filter(|_| !is_named) {
            entry.name.clone_from(name);
        }
        let units = mount.units(&[])?;
        let framed = framed(&mount, &units).map_err(CuttingError::Frames)?;
        return Ok(Some(framed.into_iter().flat_map(|sensor| sensor.frames).collect()));
    }
    if !recording.is_bag() {
        return Ok(None);
    }
    let frames: Vec<NamedFrame> =
        Surroundings::read(recording.path(), &recording.name())?.frames.links().collect();
    Ok((!frames.is_empty()).then_some(frames))
}

/// The trajectory of the rig, by `--trajectory` or the recording itself.
fn poses(spec: &CuttingSpec, recording: &Recording) -> Result<Option<Poses>, CuttingError> {
    let of_frames =
        |trajectory, parent, child| Poses { trajectory, parent, child, written: 0, is_met: false };
    let of_rig = |trajectory| of_frames(trajectory, WORLD.into(), BASE.into());
    if let Some(path) = &spec.trajectory {
        let (trajectory, notices) = read_trajectory(path, None)?;
        notices.iter().for_each(|notice| (recording.observer.notice)(notice));
        return Ok(Some(of_rig(trajectory)));
    }
    if let Some(session) = recording.checked_session() {
        let read = session.trajectory()?;
        read.iter().flat_map(|read| &read.notes).for_each(|note| (recording.observer.notice)(note));
        return Ok(read.map(|read| of_rig(read.trajectory)));
    }
    if !recording.is_bag() {
        return Ok(None);
    }
    let found = Surroundings::read(recording.path(), &recording.name())?.trajectories.into_iter().next();
    Ok(found.map(|of: RecordedTrajectory| of_frames(of.trajectory, of.parent, of.child)))
}

/// By sensor, when the packets of the revolutions that are wanted came: from the first of `--from` to the last before `--to`.
fn revolutions(
    spec: &CuttingSpec,
    recording: &Recording,
) -> Result<BTreeMap<usize, RangeInclusive<u64>>, CuttingError> {
    let [from, to] = spec.part.revolutions();
    let (from, to) = (from.unwrap_or(0), to.unwrap_or(u64::MAX));
    let mut router = recording.router()?;
    let mut counts: BTreeMap<usize, u64> = BTreeMap::new();
    let mut times_ns: BTreeMap<usize, RangeInclusive<u64>> = BTreeMap::new();
    let mut count = |at: usize, _: &Sensor, decoded: Decoded<'_>| {
        let Decoded::Frame(frame) = decoded else { return };
        let number = counts.entry(at).or_default();
        if (from..to).contains(number) {
            let [first_ns, last_ns] = frame.host_time_ns;
            let known = times_ns.entry(at).or_insert(first_ns..=last_ns);
            *known = *known.start()..=last_ns.max(*known.end());
        }
        *number += 1;
    };
    recording.each_packet(&mut |packet| {
        router.push(packet, &mut count);
    })?;
    router.finish(&mut count);
    if times_ns.is_empty() {
        let counts = counts.values().map(u64::to_string).collect::<Vec<_>>().join(", ");
        return Err(CuttingError::FewerRevolutions { recording: recording.name(), counts });
    }
    Ok(times_ns)
}

/// What the sensors of a recording are called, as `inspect` calls them: what some are shows only after some packets.
fn names_of(recording: &Recording) -> Result<Vec<String>, RecordingError> {
    let mut router = recording.router()?;
    let mut packets = 0;
    recording.each_packet_until(&mut |packet| {
        packets += 1;
        if packets > LOOK_AHEAD {
            return ControlFlow::Break(());
        }
        router.push(packet, &mut |_, _, _| {});
        ControlFlow::Continue(())
    })?;
    Ok(sensor_ids::ids(&router))
}
