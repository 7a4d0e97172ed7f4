//! The sensor itself: spins, measures, and makes its packets.

use std::sync::mpsc::sync_channel;

use sensors::velodyne::{Product, ReturnMode, VelodyneEncoder};
use sensors::{Frame, SensorModel, catalogue};

use super::{Scan, Spin};

/// Revolutions measured ahead of the one being sent.
const AHEAD: usize = 2;

/// A sensor that can measure and speak.
#[derive(Debug)]
pub struct MockSensor {
    model: SensorModel,
    spin: Spin,
    speech: Speech,
}

#[derive(Debug)]
enum Speech {
    Velodyne(Box<VelodyneEncoder>),
}

/// Why there is no such sensor.
#[derive(Debug, thiserror::Error)]
pub enum MockSensorError {
    /// The name is none of the catalogue.
    #[error(transparent)]
    Model(#[from] catalogue::ModelError),
}

impl MockSensor {
    /// A Velodyne that turns `rate_hz` times a second.
    pub fn velodyne(product: Product, mode: ReturnMode, rate_hz: f64) -> Result<Self, MockSensorError> {
        let model = catalogue::nominal(product.name())?;
        let encoder = VelodyneEncoder::new(product, mode);
        let spin = Spin::Clock { cycle_ns: encoder.cycle_ns(), rate_hz };
        Ok(Self { model, spin, speech: Speech::Velodyne(Box::new(encoder)) })
    }

    /// Its beams.
    pub fn model(&self) -> &SensorModel {
        &self.model
    }

    /// How it turns.
    pub fn spin(&self) -> Spin {
        self.spin
    }

    /// Measures along the whole trajectory of the scan, starting at azimuth 0 when the trajectory starts, and hands
    /// each packet with the device time of its first firing to `out`. The next revolutions are measured meanwhile.
    pub fn run<E>(
        &mut self,
        scan: &Scan<'_>,
        mut out: impl FnMut(u64, &[u8]) -> Result<(), E>,
    ) -> Result<(), E> {
        let [start_ns, end_ns] = scan.trajectory.time_span_ns();
        let revolutions = ((end_ns - start_ns) as f64 * 1e-9 * self.spin.rate_hz()).ceil() as u32;
        let spin = self.spin;
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
                self.speech.say(&frame, &mut out)?;
            }
            self.speech.end(&mut out)
        })
    }
}

impl Speech {
    fn say<E>(&mut self, frame: &Frame, out: &mut impl FnMut(u64, &[u8]) -> Result<(), E>) -> Result<(), E> {
        let mut outcome = Ok(());
        match self {
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
        match self {
            Speech::Velodyne(encoder) => encoder.finish(&mut |time_ns, packet| {
                if outcome.is_ok() {
                    outcome = out(time_ns, packet);
                }
            }),
        }
        outcome
    }
}
