//! What projection looks up: a line per channel in a frame that turns with the encoder, and a rotation per column.

use std::f64::consts::TAU;
use std::sync::LazyLock;

use glam::{DAffine3, DVec3};

use super::elements::{BLOCK, Real};
use crate::model::{FAR_TARGET_M, NEAR_TARGETS_M};
use crate::{Frame, SensorModel};

/// Ranges below this are corrected for nearness, mm.
pub(super) const NEAR_LIMIT_MM: u32 = (FAR_TARGET_M * 1e3) as u32;

/// Channels' lines, `origin + range * direction`, component by component; filled up with zeros.
#[derive(Clone, Copy, Default)]
#[repr(align(64))] // a cache line, which no part then straddles
pub(super) struct Lines<T> {
    pub(super) direction: [[T; BLOCK]; 3],
    pub(super) origin: [[T; BLOCK]; 3],
    /// What is added along the direction per metre that a point lies nearer than the far target on the forward and on
    /// the lateral axis.
    pub(super) near: [[T; BLOCK]; 2],
}

/// A column's rotation, row by row, and translation.
#[derive(Clone, Copy, Default)]
pub(super) struct Column<T> {
    pub(super) rows: [[T; 3]; 3],
    pub(super) translation: [T; 3],
}

/// The near-distance correction of a calibrated HDL-64E, which needs points in the lidar frame.
pub(super) struct Near<T> {
    pub(super) limit_m: T,
    pub(super) half: T,
    pub(super) sensor_from_lidar: Column<T>,
}

/// Everything for frames of one model in one precision. Made for the encoder rate and the azimuths of the latest frame.
pub(super) struct Tables<T> {
    pub(super) channels: usize,
    pub(super) lines: Vec<Lines<T>>,
    pub(super) columns: Vec<Column<T>>,
    pub(super) near: Option<Near<T>>,
    /// What columns turn into: the sensor frame, or the lidar frame where nearness is to be corrected.
    turned_from_lidar: DAffine3,
    rate_rad_per_ns: f64,
    azimuths_rad: Vec<f64>,
}

impl<T: Real> Tables<T> {
    pub(super) fn new(model: &SensorModel) -> Self {
        let is_near = model.corrections().iter().any(|correction| correction.near_distance_m.is_some());
        let sensor_from_lidar = model.sensor_from_lidar();
        let near = is_near.then(|| Near {
            limit_m: T::from_f64(FAR_TARGET_M),
            half: T::from_f64(0.5),
            sensor_from_lidar: Column::of(&sensor_from_lidar),
        });
        let mut tables = Self {
            channels: model.channels(),
            lines: Vec::new(),
            columns: Vec::new(),
            turned_from_lidar: if is_near { DAffine3::IDENTITY } else { sensor_from_lidar },
            near,
            rate_rad_per_ns: 0.0,
            azimuths_rad: Vec::new(),
        };
        tables.set_lines(model);
        tables
    }

    /// Columns turn about the vertical and nothing else.
    pub(super) fn is_flat(&self) -> bool {
        let matrix = &self.turned_from_lidar.matrix3;
        [matrix.z_axis.x, matrix.z_axis.y, matrix.x_axis.z, matrix.y_axis.z] == [0.0; 4]
    }

    pub(super) fn prepare(&mut self, model: &SensorModel, frame: &Frame) {
        assert_eq!(frame.channels, self.channels, "the frame has the channels of the model");
        assert_eq!(frame.column_valid.len(), frame.columns(), "the frame says which columns came");
        if self.rate_rad_per_ns != frame.azimuth_rate_rad_per_ns {
            self.rate_rad_per_ns = frame.azimuth_rate_rad_per_ns;
            if model.beams().iter().any(|beam| beam.fire_offset_ns != 0.0) {
                self.set_lines(model);
            }
        }
        if self.azimuths_rad != frame.column_azimuth_rad {
            self.azimuths_rad.clone_from(&frame.column_azimuth_rad);
            self.set_columns();
        }
    }

    /// A channel's line in the frame that turns with the encoder: the ray of [`SensorModel::ray`] at azimuth 0, turned
    /// on by what the encoder moves until the beam fires.
    fn set_lines(&mut self, model: &SensorModel) {
        self.lines.clear();
        self.lines.resize(self.channels.div_ceil(BLOCK), Lines::default());
        for (channel, beam) in model.beams().iter().enumerate() {
            let turned_rad = self.rate_rad_per_ns * beam.fire_offset_ns;
            let (sin_bearing, cos_bearing) = (-turned_rad - beam.azimuth_offset_rad).sin_cos();
            let (sin_elevation, cos_elevation) = beam.elevation_rad.sin_cos();
            let direction =
                DVec3::new(cos_bearing * cos_elevation, sin_bearing * cos_elevation, sin_elevation);
            let (sin_turned, cos_turned) = (-turned_rad).sin_cos();
            let radial_m = beam.origin_radial_m;
            let mut origin_m = DVec3::new(radial_m * cos_turned, radial_m * sin_turned, beam.origin_z_m);
            let mut near = [0.0; 2];
            if let Some(correction) = model.corrections().get(channel) {
                origin_m += correction.origin_left_m * DVec3::new(-sin_bearing, cos_bearing, 0.0);
                if let Some([lateral_m, forward_m]) = correction.near_distance_m {
                    let [lateral_at_m, forward_at_m] = NEAR_TARGETS_M;
                    near = [(forward_m, forward_at_m), (lateral_m, lateral_at_m)]
                        .map(|(near_m, at_m)| (near_m + beam.range_offset_m) / (FAR_TARGET_M - at_m));
                }
            }
            // the part of the range before the origin goes into the origin
            let origin_m = origin_m - beam.range_offset_m * direction;
            let (lines, element) = (&mut self.lines[channel / BLOCK], channel % BLOCK);
            for axis in 0..3 {
                lines.direction[axis][element] = T::from_f64(direction[axis]);
                lines.origin[axis][element] = T::from_f64(origin_m[axis]);
            }
            for (lines, near) in lines.near.iter_mut().zip(near) {
                lines[element] = T::from_f64(near);
            }
        }
    }

    fn set_columns(&mut self) {
        let sines = &*SINES;
        let base = &self.turned_from_lidar;
        let [rx, ry, rz] = rows(base);
        let translation = base.translation.to_array().map(T::from_f64);
        self.columns.clear();
        self.columns.extend(self.azimuths_rad.iter().map(|azimuth_rad| {
            let (sin, cos) = sines.sin_cos(*azimuth_rad);
            // the rotation by the azimuth, clockwise, then that of the housing
            let row = |row: DVec3| [row.x * cos - row.y * sin, row.x * sin + row.y * cos, row.z];
            Column { rows: [rx, ry, rz].map(|base| row(base).map(T::from_f64)), translation }
        }));
    }
}

impl<T: Real> Column<T> {
    fn of(transform: &DAffine3) -> Self {
        Self {
            rows: rows(transform).map(|row| row.to_array().map(T::from_f64)),
            translation: transform.translation.to_array().map(T::from_f64),
        }
    }
}

fn rows(transform: &DAffine3) -> [DVec3; 3] {
    let transposed = transform.matrix3.transpose();
    [transposed.x_axis, transposed.y_axis, transposed.z_axis]
}

/// Sines and cosines of every 1024th part of a turn. Between them a short series is exact to the last bits, and several
/// times faster than the general function: Velodyne frames need thousands, other ones each time.
struct Sines([[f64; 2]; STEPS]);

const STEPS: usize = 1024;

/// Added to a number it leaves whole numbers, in the low bits; every processor adds, few round.
const TO_WHOLE: f64 = 6_755_399_441_055_744.0; // 1.5 * 2^52

static SINES: LazyLock<Sines> = LazyLock::new(|| {
    Sines(std::array::from_fn(|step| {
        let (sin, cos) = (step as f64 * (TAU / STEPS as f64)).sin_cos();
        [sin, cos]
    }))
});

impl Sines {
    /// Sine and cosine, within 1e-15; angles of some turns at most, rad.
    #[inline]
    fn sin_cos(&self, angle_rad: f64) -> (f64, f64) {
        let shifted = angle_rad * (STEPS as f64 / TAU) + TO_WHOLE;
        let step = shifted - TO_WHOLE;
        let rest = angle_rad - step * (TAU / STEPS as f64);
        let square = rest * rest;
        let sin_rest = rest - rest * square * (1.0 / 6.0 - square * (1.0 / 120.0));
        let cos_rest = 1.0 - square * (0.5 - square * (1.0 / 24.0));
        let [sin, cos] = self.0[shifted.to_bits() as usize % STEPS];
        (sin * cos_rest + cos * sin_rest, cos * cos_rest - sin * sin_rest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sines_between_the_steps_are_exact() {
        for part in 0..100_000 {
            let angle_rad = f64::from(part) * 1.3e-4 - 6.5;
            let (sin, cos) = SINES.sin_cos(angle_rad);
            assert!((sin - angle_rad.sin()).abs() < 1e-15, "{angle_rad}");
            assert!((cos - angle_rad.cos()).abs() < 1e-15, "{angle_rad}");
        }
    }
}
