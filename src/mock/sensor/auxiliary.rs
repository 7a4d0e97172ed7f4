//! The auxiliary stream of a sensor: inertial samples (Ouster), GPS sentences and its clock (Velodyne).

use glam::DVec3;
use sensors::ouster::{ImuProfile, ImuSample, Metadata, OusterEncoder};
use sensors::velodyne::{Position, PulseState, rmc_sentence};

use super::Surroundings;
use crate::base::geometry::Pose;

/// LEGACY packets of a real sensor come at this rate; position packets are sent as often here.
const PERIOD_NS: u64 = 10_000_000;
/// Half the time over which motion is differentiated, ns.
const HALF_STEP_NS: u64 = 5_000_000;
/// What a sensor at rest feels, m/s^2 (BIPM, SI brochure, conventional value).
const GRAVITY_M_S2: f64 = 9.806_65;

/// The source of these packets.
pub(super) struct Auxiliary {
    kind: Kind,
    /// Between packets, ns.
    period_ns: u64,
    sent: u32,
}

enum Kind {
    Imu(Box<OusterEncoder>),
    Position,
}

impl Auxiliary {
    /// IMU packets in the profile of the metadata; none where that is off.
    pub(super) fn ouster(metadata: &Metadata) -> Option<Self> {
        let period_ns = match metadata.imu_profile {
            ImuProfile::Off => return None,
            ImuProfile::Legacy => PERIOD_NS,
            ImuProfile::Accel32Gyro32Nmea => {
                let packets_per_s = metadata.imu_packets_per_frame as f64 * metadata.frame_rate_hz;
                (1e9 / packets_per_s.max(1.0)) as u64
            }
        };
        let kind = Kind::Imu(Box::new(OusterEncoder::new(metadata.clone())));
        Some(Self { kind, period_ns, sent: 0 })
    }

    /// Position packets.
    pub(super) fn velodyne() -> Self {
        Self { kind: Kind::Position, period_ns: PERIOD_NS, sent: 0 }
    }

    /// Hands over every packet that is due by `until_ns`, with the device time of its last sample.
    pub(super) fn due<E>(
        &mut self,
        until_ns: u64,
        around: &Surroundings<'_>,
        out: &mut impl FnMut(u64, &[u8]) -> Result<(), E>,
    ) -> Result<(), E> {
        let start_ns = around.trajectory.time_span_ns()[0];
        loop {
            let due_ns = start_ns + (u64::from(self.sent) + 1) * self.period_ns;
            if due_ns > until_ns {
                return Ok(());
            }
            match &mut self.kind {
                Kind::Imu(encoder) => out(
                    due_ns,
                    inertial_packet(encoder, self.sent, [start_ns, due_ns], self.period_ns, around),
                )?,
                Kind::Position => out(due_ns, &position(due_ns).encode())?,
            }
            self.sent += 1;
        }
    }
}

/// The packet that ends at `due_ns`; its samples share the period evenly.
fn inertial_packet<'a>(
    encoder: &'a mut OusterEncoder,
    number: u32,
    [start_ns, due_ns]: [u64; 2],
    period_ns: u64,
    around: &Surroundings<'_>,
) -> &'a [u8] {
    let metadata = encoder.metadata();
    let (columns, rate_hz) = (metadata.columns_per_frame, metadata.frame_rate_hz);
    let count = metadata.imu_samples_per_packet.max(1) as u64;
    let samples: Vec<ImuSample> =
        (1..=count).map(|index| sample(due_ns - period_ns + period_ns * index / count, around)).collect();
    let turns = |time_ns: u64| (time_ns - start_ns) as f64 * 1e-9 * rate_hz;
    let encoder_columns: Vec<u16> =
        samples.iter().map(|sample| (turns(sample.time_ns).fract() * columns as f64) as u16).collect();
    let frame_id =
        if metadata.imu_packets_per_frame > 0 { number / metadata.imu_packets_per_frame as u32 } else { 0 };
    encoder.imu(frame_id, &samples, &encoder_columns, None)
}

/// Specific force and angular rate in the sensor frame, from central differences of the path.
fn sample(time_ns: u64, around: &Surroundings<'_>) -> ImuSample {
    let [first_ns, last_ns] = around.trajectory.time_span_ns();
    // at the ends the nearest time that has both neighbours stands in
    let middle_ns = time_ns.min(last_ns.saturating_sub(HALF_STEP_NS)).max(first_ns + HALF_STEP_NS);
    let world_from_sensor = |time_ns: u64| -> Option<Pose> {
        Some(around.trajectory.at(time_ns)? * (around.body_from_sensor)(time_ns))
    };
    let poses = [middle_ns - HALF_STEP_NS, middle_ns, middle_ns + HALF_STEP_NS].map(world_from_sensor);
    let [Some(before), Some(now), Some(after)] = poses else {
        return ImuSample { time_ns, ..ImuSample::default() }; // a path shorter than the step
    };
    let step_s = HALF_STEP_NS as f64 * 1e-9;
    let acceleration_m_s2 =
        (after.translation_m - 2.0 * now.translation_m + before.translation_m) / (step_s * step_s);
    let force_m_s2 = now.inverse().rotate(acceleration_m_s2 + DVec3::Z * GRAVITY_M_S2);
    let turn_rad = (before.rotation.inverse() * after.rotation).to_scaled_axis();
    ImuSample {
        time_ns,
        acceleration_m_s2: force_m_s2.to_array(),
        angular_rate_rad_s: (turn_rad / (2.0 * step_s)).to_array(),
    }
}

/// The clock locked to the pulse, and the sentence of the second that has just ended.
fn position(time_ns: u64) -> Position {
    let second_ns = time_ns - time_ns % 1_000_000_000;
    Position {
        stamp_us: (time_ns % 3_600_000_000_000 / 1000) as u32,
        pulse: PulseState::Locked,
        sentence: rmc_sentence(second_ns),
        ..Position::default()
    }
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;
    use crate::world::scene::{BoxScene, Scene};
    use crate::world::trajectory::Trajectory;

    /// On a circle the sensor feels gravity, the pull to the centre and the turn.
    #[test]
    fn a_circle_is_felt() {
        let (radius_m, rate_rad_s) = (3.0, 0.8);
        let start_ns = 1_700_000_000_000_000_000;
        let stamped = (0..2000).map(|step| {
            let angle_rad = f64::from(step) * 1e-3 * rate_rad_s;
            let place_m = DVec3::new(angle_rad.cos(), angle_rad.sin(), 0.0) * radius_m;
            let heading = DQuat::from_rotation_z(angle_rad + std::f64::consts::FRAC_PI_2);
            (start_ns + step as u64 * 1_000_000, Pose::new(heading, place_m))
        });
        let trajectory = Trajectory::new(stamped.collect()).unwrap();
        let scene = Scene::Box(BoxScene::closed(DVec3::splat(-5.0), DVec3::splat(5.0)));
        let around = Surroundings {
            scene: &scene,
            trajectory: &trajectory,
            body_from_sensor: &|_| Pose::IDENTITY,
            noise_m: 0.0,
            seed: 0,
        };
        for time_ns in [start_ns, start_ns + 900_000_000] {
            let felt = sample(time_ns, &around);
            let force = DVec3::from_array(felt.acceleration_m_s2);
            let pull = DVec3::new(0.0, radius_m * rate_rad_s * rate_rad_s, GRAVITY_M_S2);
            assert!(force.distance(pull) < 1e-3, "{force}");
            let rate = DVec3::from_array(felt.angular_rate_rad_s);
            assert!(rate.distance(DVec3::Z * rate_rad_s) < 1e-6, "{rate}");
        }
        assert_eq!(position(start_ns + 300_000_000).utc_ns(), Some(start_ns + 300_000_000));
    }
}
