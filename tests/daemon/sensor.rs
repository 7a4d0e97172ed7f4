//! Mock sensors that send in real time from a thread of the test.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;

use glam::DVec3;
use outrigger::base::geometry::Pose;
use outrigger::live::receive::now_ns;
use outrigger::mock::sensor::{MockSensor, Surroundings};
use outrigger::mock::transmit::{Clock, Pace, Transmitter};
use outrigger::rig::{Mount, SensorEntry};
use outrigger::world::scene::{BoxScene, Scene};
use outrigger::world::trajectory::Trajectory;
use sensors::ouster::{Metadata, Profile, Synthetic};

/// The room that mock sensors stand in: least and greatest corner.
pub const ROOM: &str = "-6,-4,-1.5,6,4,2";

pub const SERIAL: u64 = 992_000_000_007;

/// Metadata of a small Ouster.
pub fn metadata(serial: u64, init_id: u32) -> Metadata {
    let mut wanted = Synthetic::new("os1-16", serial, Profile::Rng19Rfl8Sig16Nir16).columns(512, 16);
    wanted.init_id = init_id;
    Metadata::synthetic(&wanted).unwrap()
}

/// A sensor in a mount file, beside the middle of the platform, so high.
pub fn entry(name: &str, model: &str, [x_m, z_m]: [f64; 2], pitch_deg: f64) -> SensorEntry {
    SensorEntry {
        name: name.into(),
        model: model.into(),
        x_m,
        y_m: 0.0,
        z_m,
        pitch_deg,
        ..SensorEntry::default()
    }
}

/// An Ouster that sends until it is unplugged.
pub struct Sending {
    stop: Arc<AtomicBool>,
    sent: Arc<AtomicU64>,
    thread: Option<JoinHandle<()>>,
}

impl Sending {
    /// A small Ouster at zero pitch.
    pub fn ouster(to: SocketAddr) -> Self {
        Self::start(MockSensor::ouster(metadata(SERIAL, 1)), to, Mount::default(), 0, None)
    }

    /// Any sensor, whose clock is so many ns ahead, on a mount, from an address.
    pub fn start(
        mut sensor: MockSensor,
        to: SocketAddr,
        mount: Mount,
        ahead_ns: i64,
        from: Option<SocketAddr>,
    ) -> Self {
        let (stop, sent) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicU64::new(0)));
        let (stopped, count) = (Arc::clone(&stop), Arc::clone(&sent));
        let thread = std::thread::spawn(move || {
            let start_ns = now_ns().checked_add_signed(ahead_ns).unwrap();
            let an_hour_ns = 3_600_000_000_000;
            let still = vec![(start_ns, Pose::IDENTITY), (start_ns + an_hour_ns, Pose::IDENTITY)];
            let trajectory = Trajectory::new(still).unwrap();
            let corners = ROOM.split(',').map(|part| part.parse().unwrap()).collect::<Vec<f64>>();
            let (low, high) = (DVec3::from_slice(&corners[..3]), DVec3::from_slice(&corners[3..]));
            let scene = Scene::Box(BoxScene::closed(low, high));
            let body_from_sensor = mount.body_from_sensor();
            let around = Surroundings {
                scene: &scene,
                trajectory: &trajectory,
                body_from_sensor: &|_| body_from_sensor,
                noise_m: 0.0,
                seed: 0,
            };
            let clock = Clock::new(Pace::Rate(1.0), Some(start_ns));
            let mut line = Transmitter::new(from, to, clock).unwrap();
            let _ = sensor.run(&around, |time_ns, payload| {
                if stopped.load(Ordering::Relaxed) {
                    return Err(());
                }
                line.send(time_ns, payload, to).unwrap();
                count.fetch_add(1, Ordering::Relaxed);
                Ok(())
            });
        });
        Self { stop, sent, thread: Some(thread) }
    }

    /// Packets sent so far.
    pub fn sent(&self) -> u64 {
        self.sent.load(Ordering::Relaxed)
    }

    /// Stops sending; how many packets were sent.
    pub fn unplug(mut self) -> u64 {
        self.end();
        self.sent()
    }

    fn end(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.join().unwrap();
        }
    }
}

impl Drop for Sending {
    fn drop(&mut self) {
        self.end();
    }
}
