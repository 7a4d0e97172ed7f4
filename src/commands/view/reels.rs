//! A recording with mounts and trajectory, as the player takes it.

use std::sync::Arc;

use sensors::router::{Router, Sensor};

use crate::base::errors::with_causes;
use crate::recording::playback::{Placement, Take, Tape, World};
use crate::recording::{Recording, sensor_ids};
use crate::rig::MountFile;

/// What is played.
pub(super) struct Reels {
    pub recording: Recording,
    pub mount: Option<MountFile>,
    pub world: Option<Arc<World>>,
}

impl Tape for Reels {
    fn router(&self) -> Result<Router, String> {
        self.recording.router().map_err(|error| with_causes(&error))
    }

    fn packets(&self, take: &mut Take<'_>) -> Result<(), String> {
        let mut is_enough = false;
        let ended = self.recording.each_packet_until(&mut |packet| {
            let flow = take(packet);
            is_enough = flow.is_break();
            flow
        });
        match ended {
            Ok(ending) if !is_enough => ending.losses().into_iter().next().map_or(Ok(()), Err),
            Ok(_) => Ok(()),
            Err(error) => Err(with_causes(&error)),
        }
    }

    fn name(&self, sensor: &Sensor, names: &mut Vec<String>) -> String {
        sensor_ids::next_id(sensor, names)
    }

    fn placement(&self, name: &str) -> Placement {
        let mut entries = self.mount.iter().flat_map(|mount| &mount.sensors);
        let entry = entries.find(|entry| entry.name == name);
        Placement {
            body_from_sensor: entry.map(|entry| entry.mount().body_from_sensor()),
            world: self.world.clone(),
        }
    }
}
