//! The sensor itself: spins, measures, and makes its packets.

use std::sync::mpsc::sync_channel;

use sensors::ouster::{Metadata, OusterEncoder};
use sensors::velodyne::{Product, ReturnMode, VelodyneEncoder};
use sensors::{Frame, SensorModel, catalogue};

use super::{Scan, Spin};
use crate::geometry::Pose;
use crate::scene::Scene;
use crate::trajectory::Trajectory;

/// Revolutions measured ahead of the one being sent.
const AHEAD: usize = 2;

/// A sensor that can measure and speak.
pub struct MockSensor {
    model: SensorModel,
    spin: Spin,
    range_step_mm: u32,
    speech: Speech,
}

enum Speech {
    Ouster(Box<OusterEncoder>),
    Velodyne(Box<VelodyneEncoder>),
}

/// Where a mock sensor is and what it sees there.
#[derive(Clone, Copy)]
pub struct Surroundings<'a> {
    /// What stands around it.
    pub scene: &'a Scene,
    /// Where the platform is. The sensor's clock shows this trajectory's times.
    pub trajectory: &'a Trajectory,
    /// Where the sensor sits on the platform, at a time in ns.
    pub body_from_sensor: &'a (dyn Fn(u64) -> Pose + Sync),
    /// Standard deviation of the range noise, m.
    pub noise_m: f64,
    /// Seed of the noise.
    pub seed: u64,
}

impl MockSensor {
    /// An Ouster. It measures with the beams of its metadata.
    pub fn ouster(metadata: Metadata) -> Self {
        let spin = Spin::Angles { columns: metadata.columns_per_frame, rate_hz: metadata.frame_rate_hz };
        let range_step_mm = u32::from(metadata.profile.layout().first.range.scale);
        Self {
            model: metadata.model.clone(),
            spin,
            range_step_mm,
            speech: Speech::Ouster(Box::new(OusterEncoder::new(metadata))),
        }
    }

    /// A Velodyne of nominal beams that turns `rate_hz` times a second.
    pub fn velodyne(product: Product, mode: ReturnMode, rate_hz: f64) -> Result<Self, catalogue::ModelError> {
        let model = catalogue::nominal(product.name())?;
        let encoder = VelodyneEncoder::new(product, mode);
        let spin = Spin::Clock { cycle_ns: encoder.cycle_ns(), rate_hz };
        let range_step_mm = product.distance_unit_mm();
        Ok(Self { model, spin, range_step_mm, speech: Speech::Velodyne(Box::new(encoder)) })
    }

    /// Its beams.
    pub fn model(&self) -> &SensorModel {
        &self.model
    }

    /// How it turns.
    pub fn spin(&self) -> Spin {
        self.spin
    }

    /// What one count of the range in its packets stands for, mm.
    pub fn range_step_mm(&self) -> u32 {
        self.range_step_mm
    }

    /// Metadata of an Ouster.
    pub fn metadata(&self) -> Option<&Metadata> {
        match &self.speech {
            Speech::Ouster(encoder) => Some(encoder.metadata()),
            Speech::Velodyne(_) => None,
        }
    }

    /// Measures along the whole trajectory, from azimuth 0 at its start, and hands each packet with its device time to
    /// `out`: that of the first firing for a Velodyne, of the last column for an Ouster. The next revolutions are
    /// measured meanwhile.
    pub fn run<E>(
        &mut self,
        surroundings: &Surroundings<'_>,
        mut out: impl FnMut(u64, &[u8]) -> Result<(), E>,
    ) -> Result<(), E> {
        let Surroundings { scene, trajectory, body_from_sensor, noise_m, seed } = *surroundings;
        let (spin, range_step_mm, model) = (self.spin, self.range_step_mm, &self.model);
        let scan = Scan { scene, trajectory, model, body_from_sensor, noise_m, seed, range_step_mm };
        let speech = &mut self.speech;
        let [start_ns, end_ns] = trajectory.time_span_ns();
        let revolutions = ((end_ns - start_ns) as f64 * 1e-9 * spin.rate_hz()).ceil() as u32;
        std::thread::scope(|scope| {
            let (sender, frames) = sync_channel(AHEAD);
            scope.spawn(move || {
                for revolution in 0..revolutions {
                    let columns = spin.columns(start_ns, revolution);
                    let frame = scan.frame(revolution, &columns, spin.azimuth_rate_rad_per_ns());
                    if sender.send(frame).is_err() {
                        return;
                    }
                }
            });
            for frame in frames {
                speech.say(&frame, &mut out)?;
            }
            speech.end(&mut out)
        })
    }
}

impl Speech {
    fn say<E>(&mut self, frame: &Frame, out: &mut impl FnMut(u64, &[u8]) -> Result<(), E>) -> Result<(), E> {
        let mut outcome = Ok(());
        match self {
            Speech::Ouster(encoder) => {
                let per_packet = encoder.metadata().columns_per_packet;
                // the encoder leaves packets out of which no column came, and only these have no last time
                let mut due_ns = frame
                    .column_time_ns
                    .chunks(per_packet)
                    .filter_map(|times| times.iter().copied().filter(|time_ns| *time_ns > 0).max());
                encoder.frame(frame, &mut |packet| {
                    if let (Ok(()), Some(due_ns)) = (&outcome, due_ns.next()) {
                        outcome = out(due_ns, packet);
                    }
                });
            }
            Speech::Velodyne(encoder) => encoder.push_frame(frame, &mut |time_ns, packet| {
                if outcome.is_ok() {
                    outcome = out(time_ns, packet);
                }
            }),
        }
        outcome
    }

    fn end<E>(&mut self, out: &mut impl FnMut(u64, &[u8]) -> Result<(), E>) -> Result<(), E> {
        let mut outcome = Ok(());
        if let Speech::Velodyne(encoder) = self {
            encoder.finish(&mut |time_ns, packet| {
                if outcome.is_ok() {
                    outcome = out(time_ns, packet);
                }
            });
        }
        outcome
    }
}
