//! What a moving sensor measures in a scene: ranges, column by column, each at its own time and azimuth.

mod spin;

pub use spin::Spin;

use rayon::prelude::*;
use sensors::{Frame, Layer, SensorModel};

use super::column::ColumnCaster;
use crate::base::geometry::Pose;
use crate::base::rng::Rng;
use crate::world::scene::Scene;
use crate::world::trajectory::Trajectory;

/// A sensor on its path through a scene.
#[derive(Clone, Copy)]
pub struct Scan<'a> {
    /// What it sees.
    pub scene: &'a Scene,
    /// Where the platform is.
    pub trajectory: &'a Trajectory,
    /// Beams and limits.
    pub model: &'a SensorModel,
    /// Where the sensor sits on the platform, at a time in ns.
    pub body_from_sensor: &'a (dyn Fn(u64) -> Pose + Sync),
    /// Standard deviation of the range noise, m.
    pub noise_m: f64,
    /// Seed of the noise.
    pub seed: u64,
    /// What one count of the sent range stands for, mm: the sensor rounds to it.
    pub range_step_mm: u32,
}

/// One firing of all beams.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Column {
    /// When, ns.
    pub time_ns: u64,
    /// Encoder azimuth, rad, clockwise.
    pub azimuth_rad: f64,
}

impl Scan<'_> {
    /// Measures one frame. Columns outside the trajectory's time never come.
    pub fn frame(&self, frame_id: u32, columns: &[Column], azimuth_rate_rad_per_ns: f64) -> Frame {
        let channels = self.model.channels();
        let came = |column: &Column| self.trajectory.at(column.time_ns).is_some();
        let mut frame = Frame {
            frame_id,
            channels,
            column_time_ns: columns
                .iter()
                .map(|column| if came(column) { column.time_ns } else { 0 })
                .collect(),
            column_azimuth_rad: columns.iter().map(|column| column.azimuth_rad).collect(),
            column_valid: columns.iter().map(came).collect(),
            azimuth_rate_rad_per_ns,
            complete: true,
            ..Frame::default()
        };
        let caster = ColumnCaster::new(self.model);
        let samples: Vec<Sample> = columns
            .par_iter()
            .flat_map_iter(|column| self.column(&caster, column, azimuth_rate_rad_per_ns * 1e9))
            .collect();
        frame.first = Layer {
            range_mm: samples.iter().map(|sample| sample.range_mm).collect(),
            reflectivity: samples.iter().map(|sample| sample.reflectivity).collect(),
            signal: samples.iter().map(|sample| sample.signal).collect(),
            near_ir: vec![AMBIENT; samples.len()],
            ..Layer::default()
        };
        frame
    }

    fn column(
        &self,
        caster: &ColumnCaster<'_>,
        column: &Column,
        spin_rad_s: f64,
    ) -> impl Iterator<Item = Sample> + use<> {
        let ranges_m = match self.trajectory.at(column.time_ns) {
            Some(world_from_body) => {
                let world_from_sensor = world_from_body * (self.body_from_sensor)(column.time_ns);
                caster.cast(self.scene, world_from_sensor, column.azimuth_rad, spin_rad_s)
            }
            None => vec![None; self.model.channels()],
        };
        let mut noise = Rng::new(self.seed, column.time_ns);
        let (noise_m, step_mm) = (self.noise_m, f64::from(self.range_step_mm.max(1)));
        ranges_m.into_iter().map(move |range_m| {
            // drawn for every sample, hit or not: a different scene has the same noise
            let error_m = if noise_m > 0.0 { noise_m * noise.normal() } else { 0.0 };
            let Some(range_m) = range_m else { return Sample::default() };
            let range_mm = ((range_m + error_m) * 1e3 / step_mm).round().max(1.0) * step_mm;
            let signal = SIGNAL_AT_1_M / range_m.max(1.0).powi(2);
            Sample { range_mm: range_mm as u32, reflectivity: REFLECTIVITY, signal: signal as u16 }
        })
    }
}

/// A matt wall: half of the light comes back.
const REFLECTIVITY: u8 = 50;
/// Photons from such a wall at 1 m: any number of the size real sensors report.
const SIGNAL_AT_1_M: f64 = 20_000.0;
/// Ambient light of an indoor scene, counts.
const AMBIENT: u16 = 80;

#[derive(Clone, Copy, Default)]
struct Sample {
    range_mm: u32,
    reflectivity: u8,
    signal: u16,
}
