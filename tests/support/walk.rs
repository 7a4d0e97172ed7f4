//! Walks of mock sensors, as a session holds them.

use std::net::SocketAddr;

use outrigger::mock::sensor::{MockSensor, Surroundings};
use outrigger::recording::SessionWriter;
use outrigger::rig::Mount;
use outrigger::world::scene::Scene;
use outrigger::world::trajectory::Trajectory;
use sensors::Packet;
use sensors::ouster::Metadata;

/// What surrounds the sensors, and what their ranges are off by.
pub struct Walk<'a> {
    pub scene: &'a Scene,
    pub trajectory: &'a Trajectory,
    pub noise_m: f64,
    pub seed: u64,
}

impl Walk<'_> {
    /// Writes what Ousters send on it; by sensor of the session its metadata, mount, and where its packets go.
    pub fn write(
        &self,
        writer: &SessionWriter,
        sensors: impl IntoIterator<Item = (Metadata, Mount, SocketAddr)>,
    ) {
        for (sensor, (metadata, mount, destination)) in sensors.into_iter().enumerate() {
            let pose = mount.body_from_sensor();
            let surroundings = Surroundings {
                scene: self.scene,
                trajectory: self.trajectory,
                body_from_sensor: &|_| pose,
                noise_m: self.noise_m,
                seed: self.seed,
            };
            let source = SocketAddr::from(([10, 0, 0, 1 + sensor as u8], 50_000));
            let link = Default::default();
            MockSensor::ouster(metadata)
                .run(&surroundings, |host_time_ns, payload| {
                    writer.write_packet(sensor, &Packet { host_time_ns, source, destination, link, payload })
                })
                .unwrap();
        }
    }
}
