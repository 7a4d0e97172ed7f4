//! Single rays of a recording, stored to be cast again: under another mount, another pose, another reading of the scene.

use glam::DVec3;
use sensors::projection::{returns, sample_azimuth_rad, sample_time_ns};
use sensors::{Frame, SensorModel};

use crate::base::geometry::Pose;
use crate::recording::FramePitch;
use crate::rig::{Mount, MountedSensor};
use crate::world::scene::Scene;
use crate::world::trajectory::Trajectory;

/// One ray as it was recorded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RecordedRay {
    /// Sensor of the rig.
    pub sensor: usize,
    /// Beam.
    pub channel: usize,
    /// On the trajectory's clock, ns.
    pub time_ns: u64,
    /// Encoder azimuth, rad.
    pub azimuth_rad: f64,
    /// Pitch of the mount at its time, rad.
    pub pitch_rad: f64,
    /// As the sensor reported it, m; none where nothing came back.
    pub range_m: Option<f64>,
}

/// A ray placed in the world.
#[derive(Clone, Copy, Debug)]
pub struct PlacedRay {
    /// Where the beam starts, m.
    pub origin_m: DVec3,
    /// Unit vector.
    pub direction: DVec3,
    /// Part of the reported range before the origin, m.
    pub range_offset_m: f64,
}

impl RecordedRay {
    /// Mount of its sensor at its time.
    pub(crate) fn mount(&self, sensors: &[MountedSensor]) -> Mount {
        Mount { pitch_rad: self.pitch_rad, ..sensors[self.sensor].mount }
    }

    /// The ray where its nominal mount and a trajectory put it; none outside the trajectory's time.
    pub(crate) fn place_on(
        &self,
        sensors: &[MountedSensor],
        trajectory: &Trajectory,
        time_ns: u64,
    ) -> Option<PlacedRay> {
        let world_from_body = trajectory.at(time_ns)?;
        Some(self.place(sensors, &(world_from_body * self.mount(sensors).body_from_sensor())))
    }

    /// The ray in the world of a sensor placed there.
    pub fn place(&self, sensors: &[MountedSensor], world_from_sensor: &Pose) -> PlacedRay {
        let ray = sensors[self.sensor].model.ray(self.channel, self.azimuth_rad);
        PlacedRay {
            origin_m: world_from_sensor.transform_point(ray.origin_m),
            direction: world_from_sensor.rotate(ray.direction),
            range_offset_m: ray.range_offset_m,
        }
    }
}

impl PlacedRay {
    /// Range that a sensor of these limits reports in a scene, m, and the normal there.
    pub fn cast(&self, scene: &Scene, sensor: &MountedSensor) -> Option<(f64, DVec3)> {
        let hit = scene.cast(self.origin_m, self.direction)?;
        let range_m = hit.distance_m + self.range_offset_m;
        (sensor.model.min_range_m..=sensor.model.max_range_m)
            .contains(&range_m)
            .then_some((range_m, hit.normal))
    }

    /// Point at a reported range, m.
    pub(crate) fn at_range(&self, range_m: f64) -> DVec3 {
        self.origin_m + (range_m - self.range_offset_m) * self.direction
    }
}

/// Keeps an even share of a stream of rays, however long it is: which rays does not depend on the order or the number
/// of threads.
#[derive(Clone, Debug)]
pub struct Thinning {
    most: usize,
    mask: u64,
    rays: Vec<RecordedRay>,
}

impl Thinning {
    /// Keeps between a half and all of `most` rays of a stream that has so many.
    pub fn new(most: usize) -> Self {
        Self { most: most.max(2), mask: 0, rays: Vec::new() }
    }

    /// Whether a ray would be held: asked before the work of making one.
    #[inline]
    pub(crate) fn wants(&self, sensor: usize, channel: usize, time_ns: u64) -> bool {
        scatter(sensor, channel, time_ns) & self.mask == 0
    }

    /// One more ray of the stream.
    pub(crate) fn push(&mut self, ray: RecordedRay) {
        if self.wants(ray.sensor, ray.channel, ray.time_ns) {
            self.rays.push(ray);
            self.thin();
        }
    }

    /// The returns of a frame of a sensor that then had this pitch, rad, by its clock; `offset_ns` leads from its clock to the
    /// trajectory's.
    pub fn add_frame(
        &mut self,
        sensor: usize,
        model: &SensorModel,
        pitch: &FramePitch,
        offset_ns: i64,
        frame: &Frame,
    ) {
        for (column, channel, range_mm) in returns(model, frame) {
            let device_ns = sample_time_ns(model, frame, column, channel);
            let time_ns = device_ns.saturating_add_signed(offset_ns);
            if self.wants(sensor, channel, time_ns) {
                let pitch_rad = pitch.at(device_ns);
                let azimuth_rad = sample_azimuth_rad(model, frame, column, channel);
                let range_m = Some(f64::from(range_mm) * 1e-3);
                self.push(RecordedRay { sensor, channel, time_ns, azimuth_rad, pitch_rad, range_m });
            }
        }
    }

    /// All rays of several streams, in order of time.
    pub fn joined(parts: impl IntoIterator<Item = Self>) -> Vec<RecordedRay> {
        let mut parts = parts.into_iter();
        let Some(mut all) = parts.next() else { return Vec::new() };
        for part in parts {
            all.mask |= part.mask;
            all.rays.extend(part.rays);
        }
        let mask = all.mask;
        all.rays.retain(|ray| scatter(ray.sensor, ray.channel, ray.time_ns) & mask == 0);
        all.thin();
        all.rays.sort_by_key(|ray| (ray.time_ns, ray.sensor, ray.channel));
        all.rays
    }

    fn thin(&mut self) {
        while self.rays.len() > self.most {
            self.mask = self.mask << 1 | 1;
            let mask = self.mask;
            self.rays.retain(|ray| scatter(ray.sensor, ray.channel, ray.time_ns) & mask == 0);
        }
    }
}

/// A number as good as random for each ray (the finalizer of `SplitMix64`, Steele et al. 2014,
/// doi:10.1145/2660193.2660195).
#[inline]
fn scatter(sensor: usize, channel: usize, time_ns: u64) -> u64 {
    let mut z = time_ns ^ (sensor as u64) << 56 ^ (channel as u64) << 44;
    z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ z >> 31
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_thread_and_three_sample_the_same_rays() {
        let ray = |n: u64| RecordedRay {
            sensor: (n % 2) as usize,
            channel: (n % 16) as usize,
            time_ns: 1_000_000 + n / 16 * 55_296,
            azimuth_rad: 0.0,
            pitch_rad: 0.0,
            range_m: None,
        };
        let mut one = Thinning::new(1000);
        let mut three = vec![Thinning::new(1000); 3];
        for n in 0..50_000 {
            one.push(ray(n));
            three[(n / 7 % 3) as usize].push(ray(n));
        }
        let one = Thinning::joined([one]);
        assert!((500..=1000).contains(&one.len()), "{}", one.len());
        assert_eq!(one, Thinning::joined(three));
        let of_first = one.iter().filter(|ray| ray.sensor == 0).count();
        assert!((300..700).contains(&(of_first * 1000 / one.len())), "{of_first}");
    }
}
