//! The sensor itself: spins, measures, and makes its packets.

use std::sync::mpsc::sync_channel;

use sensors::ouster::{Metadata, OusterEncoder};
use sensors::velodyne::{Product, ReturnMode, VelodyneEncoder};
use sensors::{Frame, SensorModel, catalogue};

use super::auxiliary::Auxiliary;
use super::{Scan, Surroundings};
use crate::simulate::frames::Spin;

/// Revolutions measured ahead of the one being sent.
const AHEAD: usize = 2;

/// A sensor that can measure and speak.
pub struct MockSensor {
    model: SensorModel,
    spin: Spin,
    range_step_mm: u32,
    speech: Speech,
    auxiliary: Option<Auxiliary>,
}

/// Which of a sensor's two streams a packet belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PacketStream {
    /// What it measures.
    Lidar,
    /// IMU packets of an Ouster, position packets of a Velodyne.
    Auxiliary,
}

enum Speech {
    Ouster(Box<OusterEncoder>),
    Velodyne(Box<VelodyneEncoder>),
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
            auxiliary: None,
        }
    }

    /// A Velodyne of nominal beams that turns `rate_hz` times a second.
    pub fn velodyne(product: Product, mode: ReturnMode, rate_hz: f64) -> Result<Self, catalogue::ModelError> {
        let model = catalogue::nominal(product.name())?;
        let encoder = VelodyneEncoder::new(product, mode);
        let spin = Spin::Clock { cycle_ns: encoder.cycle_ns(), rate_hz };
        let range_step_mm = product.distance_unit_mm();
        let speech = Speech::Velodyne(Box::new(encoder));
        Ok(Self { model, spin, range_step_mm, speech, auxiliary: None })
    }

    /// The same sensor, with the auxiliary stream of real ones: IMU packets in the profile of the
    /// metadata, position packets with the clock locked to GPS.
    pub(crate) fn with_auxiliary(mut self) -> Self {
        self.auxiliary = match &self.speech {
            Speech::Ouster(encoder) => Auxiliary::ouster(encoder.metadata()),
            Speech::Velodyne(_) => Some(Auxiliary::velodyne()),
        };
        self
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
    pub(crate) fn metadata(&self) -> Option<&Metadata> {
        match &self.speech {
            Speech::Ouster(encoder) => Some(encoder.metadata()),
            Speech::Velodyne(_) => None,
        }
    }

    /// Measures along the whole trajectory, from azimuth 0 at its start, and hands each lidar packet with its device time
    /// to `out`: that of the first firing for a Velodyne, of the last column for an Ouster. The next revolutions are
    /// measured meanwhile.
    pub fn run<E>(
        &mut self,
        surroundings: &Surroundings<'_>,
        mut out: impl FnMut(u64, &[u8]) -> Result<(), E>,
    ) -> Result<(), E> {
        self.run_both(surroundings, |time_ns, line, packet| match line {
            PacketStream::Lidar => out(time_ns, packet),
            PacketStream::Auxiliary => Ok(()),
        })
    }

    /// [`MockSensor::run`] with auxiliary packets, each before the lidar packet that it precedes.
    pub(crate) fn run_both<E>(
        &mut self,
        surroundings: &Surroundings<'_>,
        mut out: impl FnMut(u64, PacketStream, &[u8]) -> Result<(), E>,
    ) -> Result<(), E> {
        let Surroundings { scene, trajectory, body_from_sensor, noise_m, seed } = *surroundings;
        let (spin, range_step_mm, model) = (self.spin, self.range_step_mm, &self.model);
        let scan = Scan { scene, trajectory, model, body_from_sensor, noise_m, seed, range_step_mm };
        let (speech, auxiliary) = (&mut self.speech, &mut self.auxiliary);
        let mut out = |time_ns: u64, packet: &[u8]| {
            if let Some(auxiliary) = auxiliary {
                auxiliary.due(time_ns, surroundings, &mut |time_ns, packet| {
                    out(time_ns, PacketStream::Auxiliary, packet)
                })?;
            }
            out(time_ns, PacketStream::Lidar, packet)
        };
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

#[cfg(test)]
mod tests {
    use std::convert::Infallible;

    use glam::DVec3;
    use sensors::ouster::{ImuProfile, OusterDecoder, Profile, Synthetic};
    use sensors::velodyne::{Options, VelodyneDecoder};
    use sensors::{Decoded, Decoder, Packet};

    use super::*;
    use crate::base::geometry::Pose;
    use crate::world::scene::{BoxScene, Scene};
    use crate::world::trajectory::Trajectory;

    const START_NS: u64 = 1_700_000_000_000_000_000;

    /// Runs a sensor for a second at a standstill and decodes what it sends; counts by kind.
    fn decoded(mut sensor: MockSensor, decoder: &mut dyn Decoder, ports: [u16; 2]) -> [usize; 3] {
        let still =
            Trajectory::new(vec![(START_NS, Pose::IDENTITY), (START_NS + 1_000_000_000, Pose::IDENTITY)]);
        let trajectory = still.unwrap();
        let scene = Scene::Box(BoxScene::closed(DVec3::splat(-5.0), DVec3::splat(5.0)));
        let surroundings = Surroundings {
            scene: &scene,
            trajectory: &trajectory,
            body_from_sensor: &|_| Pose::IDENTITY,
            noise_m: 0.0,
            seed: 0,
        };
        let [mut second_returns, mut inertial, mut positions] = [0; 3];
        let mut last_ns = [0; 2];
        let outcome = sensor.run_both(&surroundings, |time_ns, line, payload| {
            assert!(time_ns >= last_ns[line as usize], "packets leave in the order of their times");
            last_ns[line as usize] = time_ns;
            let destination = ([127, 0, 0, 1], ports[line as usize]).into();
            let source = ([127, 0, 0, 1], 50_000).into();
            let packet =
                Packet { host_time_ns: time_ns, source, destination, link: Default::default(), payload };
            let pushed = decoder.push(&packet, &mut |decoded| match decoded {
                Decoded::Imu(sample) => {
                    assert_eq!(sample.angular_rate_rad_s, [0.0; 3]);
                    assert!((sample.acceleration_m_s2[2] - 9.806_65).abs() < 1e-6);
                    inertial += 1;
                }
                Decoded::Position(position) => positions += usize::from(position.utc_ns() == Some(time_ns)),
                Decoded::Frame(frame) => {
                    second_returns += frame
                        .second
                        .iter()
                        .flat_map(|layer| &layer.range_mm)
                        .filter(|range_mm| **range_mm > 0)
                        .count();
                }
                Decoded::Zones(_) => {}
            });
            pushed.unwrap();
            Ok::<(), Infallible>(())
        });
        outcome.unwrap();
        [second_returns, inertial, positions]
    }

    #[test]
    fn an_ouster_sends_its_inertial_packets() {
        for (profile, samples) in [(ImuProfile::Legacy, 99), (ImuProfile::Accel32Gyro32Nmea, 79 * 8)] {
            let mut wanted = Synthetic::new("os1-32", 1, Profile::Rng15Rfl8Nir8).columns(512, 16);
            wanted.imu_profile = profile;
            let metadata = Metadata::synthetic(&wanted).unwrap();
            let ports = [metadata.lidar_port.unwrap(), metadata.imu_port.unwrap()];
            let mut decoder = OusterDecoder::new(metadata.clone());
            let sensor = MockSensor::ouster(metadata).with_auxiliary();
            let [_, inertial, _] = decoded(sensor, &mut decoder, ports);
            assert_eq!(inertial, samples, "{profile:?}");
        }
    }

    #[test]
    fn a_velodyne_sends_position_packets_in_dual_mode_too() {
        let sensor = MockSensor::velodyne(Product::Vlp16, ReturnMode::Dual, 10.0).unwrap().with_auxiliary();
        let mut decoder = VelodyneDecoder::new(Options::default());
        let [second_returns, _, positions] = decoded(sensor, &mut decoder, [2368, 8308]);
        // a wall answers once: the second return repeats the first and is left out
        assert_eq!((second_returns, positions), (0, 99));
        assert_eq!(decoder.return_mode(), Some(ReturnMode::Dual));
    }
}
