//! From the frames of the sensors to that of the files.

use sensors::Frame;
use sensors::router::Sensor;

use crate::base::geometry::Pose;
use crate::recording::export::Cloud;
use crate::recording::mounted::Mounts;
use crate::recording::registered::{Registration, WORLD};
use crate::recording::source::{Recording, RecordingError};
use crate::rig::{BASE, NamedFrame};

/// How points get into the frame of the files.
pub(super) struct Placing<'a> {
    /// None where they stay in their sensors' frames.
    pub mounts: Option<Mounts>,
    pub registration: Registration,
    pub recording: &'a Recording,
}

/// Where a sensor sits on the rig, and where the rig was while a cloud was measured: for files that state both.
#[derive(Default)]
pub(super) struct Transforms {
    /// In the rig's frame, and whether an axis moves it.
    pub(super) sensor: Option<(NamedFrame, bool)>,
    /// In the world, each at its time, ns.
    pub(super) rig: Vec<(u64, NamedFrame)>,
}

impl Transforms {
    /// Of a cloud that was moved, with the place of its sensor on the rig and whether an axis moves it.
    pub(super) fn of(
        body_from_sensor: Option<Pose>,
        is_moved: bool,
        sensor: usize,
        cloud: &Cloud,
        registration: &mut Registration,
    ) -> Self {
        let rig = registration.poses(sensor, cloud).into_iter();
        Self {
            sensor: body_from_sensor.map(|pose| (named(BASE, &cloud.source.id, pose), is_moved)),
            rig: rig.map(|(time_ns, pose)| (time_ns, named(WORLD, BASE, pose))).collect(),
        }
    }
}

fn named(parent: &str, name: &str, parent_from_frame: Pose) -> NamedFrame {
    NamedFrame { name: name.to_owned(), parent: parent.to_owned(), parent_from_frame }
}

impl Placing<'_> {
    /// Moves the points of a frame.
    pub(super) fn apply(
        &mut self,
        at: usize,
        sensor: &Sensor,
        frame: &Frame,
        cloud: &mut Cloud,
    ) -> Result<Transforms, RecordingError> {
        let Some(mounts) = &mut self.mounts else {
            self.registration.apply(at, cloud, &|_| Pose::IDENTITY);
            return Ok(Transforms::default());
        };
        let (slot, body_from_sensor) = mounts.body_from_sensor(self.recording, at, sensor, frame)?;
        let pose = body_from_sensor(cloud.start_time_ns);
        self.registration.apply(at, cloud, &body_from_sensor);
        let is_moved = mounts.is_moved(slot);
        Ok(Transforms::of(Some(pose), is_moved, at, cloud, &mut self.registration))
    }
}
