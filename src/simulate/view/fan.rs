//! The beams of one sensor, as views cast them: each fixed in a frame that turns with the column.

use std::f64::consts::TAU;
use std::sync::Arc;

use glam::{DMat3, DVec3};
use sensors::{Pattern, SensorModel};

use super::ViewError;
use crate::base::geometry::BODY_FROM_MOUNT_FRAME;
use crate::rig::{Mount, Unit};
use crate::simulate::quality::Quality;

/// Which beams are cast.
#[derive(Clone, Debug, PartialEq)]
pub struct Sampling {
    /// Every beam leaves the sensor's origin at its nominal elevation, in columns counted counter-clockwise from the mount's x
    /// axis; otherwise as calibrated, from its own origin at its own time.
    pub is_ideal: bool,
    /// Columns per revolution; the unit's own where none.
    pub columns: Option<u32>,
    /// Every so many columns one is cast.
    pub column_stride: u32,
    /// Revolutions per second; the unit's own where none.
    pub rate_hz: Option<f64>,
    /// Every so many revolutions one is cast, from the first.
    pub scan_stride: u32,
    /// Least range that counts, m; the model's where none.
    pub min_range_m: Option<f64>,
    /// What a return and a voxel must be to count.
    pub quality: Quality,
    /// How far the first column is turned on, in columns.
    pub phase: f64,
}

impl Default for Sampling {
    /// Everything as the units have it.
    fn default() -> Self {
        Self {
            is_ideal: false,
            columns: None,
            column_stride: 1,
            rate_hz: None,
            scan_stride: 1,
            min_range_m: None,
            quality: Quality::default(),
            phase: 0.0,
        }
    }
}

impl Sampling {
    /// One beam in so many, a power of two: columns and revolutions are thinned evenly.
    pub(crate) fn thinned(&self, times: u32) -> Self {
        let columns = 1 << times.ilog2().div_ceil(2);
        Self {
            column_stride: self.column_stride * columns,
            scan_stride: self.scan_stride * (times / columns).max(1),
            ..self.clone()
        }
    }
}

/// One beam in the frame of its column, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FanBeam {
    pub direction: DVec3,
    pub origin_m: DVec3,
    pub range_offset_m: f64,
    /// The beam of column c - shift points where an unstaggered beam of column c does.
    pub shift: usize,
}

impl FanBeam {
    /// Forward, from the sensor's origin.
    const FROM_ORIGIN: Self =
        Self { direction: DVec3::X, origin_m: DVec3::ZERO, range_offset_m: 0.0, shift: 0 };
}

/// The beams of a sensor and how it spins.
#[derive(Clone, Debug, PartialEq)]
pub struct Fan {
    /// Of the sensor.
    pub model: SensorModel,
    /// Columns per revolution.
    pub columns: usize,
    /// Revolutions per second.
    pub rate_hz: f64,
    /// Every so many revolutions one is cast.
    pub scan_stride: u64,
    /// Least range that counts, m.
    pub min_range_m: f64,
    /// Maximum range that counts, m.
    pub max_range_m: f64,
    /// Least cosine between a beam and the normal against it; 0 where any counts.
    pub(super) min_cosine: f64,
    is_ideal: bool,
    /// Sensor from the frame in which columns turn.
    sensor_from_lidar: (DMat3, DVec3),
    /// From a column to the next, counter-clockwise, rad.
    step_rad: f64,
    /// Sine and cosine of the turn of each column, counter-clockwise.
    turns: Vec<(f64, f64)>,
    /// From the lowest beam to the highest: neighbours see neighbouring surfaces.
    pub(super) beams: Vec<FanBeam>,
    /// Directions of a sensor without rings, column by column; none for others.
    pattern: Option<Arc<[DVec3]>>,
}

/// Elevations that are even within this are meant to be, degrees: tables of models are rounded.
const TABLE_ROUNDING_DEG: f64 = 1e-6;

impl Fan {
    /// The beams of a unit.
    ///
    /// # Errors
    /// Range limits that are out of order.
    pub fn new(unit: &Unit, sampling: &Sampling) -> Result<Self, ViewError> {
        let model = &unit.model;
        let columns = sampling.columns.unwrap_or(unit.columns) / sampling.column_stride.max(1);
        let columns = columns.max(1) as usize;
        let rate_hz = sampling.rate_hz.unwrap_or(unit.rate_hz);
        let min_range_m = sampling.min_range_m.unwrap_or(model.min_range_m);
        let max_range_m = sampling.quality.max_range_m.unwrap_or(model.max_range_m);
        if !(min_range_m >= 0.0 && max_range_m > min_range_m) {
            return Err(ViewError::Ranges { model: model.name.clone(), min_range_m, max_range_m });
        }
        let direction_of_turn = if sampling.is_ideal { 1.0 } else { -1.0 };
        let pattern = model.pattern().map(|pattern| directions(pattern, columns, sampling.phase));
        // a pattern turns by itself
        let turn_rad = if pattern.is_some() { 0.0 } else { TAU };
        let step_rad = direction_of_turn * turn_rad / columns as f64;
        let affine = model.sensor_from_lidar();
        let (sensor_from_lidar, mut beams) = if pattern.is_some() {
            ((affine.matrix3, affine.translation), vec![FanBeam::FROM_ORIGIN; model.channels()])
        } else if sampling.is_ideal {
            ((DMat3::IDENTITY, DVec3::ZERO), ideal_beams(unit))
        } else {
            ((affine.matrix3, affine.translation), calibrated_beams(unit, rate_hz, step_rad, columns))
        };
        beams.sort_by(|a, b| a.direction.z.total_cmp(&b.direction.z));
        Ok(Self {
            model: model.clone(),
            columns,
            rate_hz,
            scan_stride: u64::from(sampling.scan_stride.max(1)),
            min_range_m,
            max_range_m,
            min_cosine: sampling.quality.min_cosine(),
            is_ideal: sampling.is_ideal,
            sensor_from_lidar,
            step_rad,
            turns: turns(columns, step_rad, sampling.phase),
            beams,
            pattern,
        })
    }

    /// The same with the first column turned on by so many columns.
    pub(super) fn at_phase(&self, phase: f64) -> Self {
        let pattern = self.model.pattern().map(|pattern| directions(pattern, self.columns, phase));
        Self { turns: turns(self.columns, self.step_rad, phase), pattern, ..self.clone() }
    }

    /// A beam in the frame of a column.
    pub(super) fn beam(&self, column: usize, number: usize) -> FanBeam {
        let beam = self.beams[number];
        match &self.pattern {
            Some(directions) => FanBeam { direction: directions[column * self.beams.len() + number], ..beam },
            None => beam,
        }
    }

    /// The axis about which the beams are even, in the frame in which columns turn.
    pub(super) fn axis(&self) -> DVec3 {
        self.model.pattern().map_or(DVec3::Z, Pattern::axis)
    }

    /// Directions of a sensor without rings, column by column.
    pub(super) fn pattern(&self) -> Option<&[DVec3]> {
        self.pattern.as_deref()
    }

    /// Beams of one revolution.
    pub(crate) fn rays_per_scan(&self) -> u64 {
        (self.columns * self.beams.len()) as u64
    }

    /// Elevations, rad, ascending.
    pub(super) fn elevations_rad(&self) -> impl Iterator<Item = f64> {
        self.beams.iter().map(|beam| beam.direction.z.clamp(-1.0, 1.0).asin())
    }

    /// Body from the frame in which columns turn.
    pub(super) fn body_from_lidar(&self, mount: &Mount) -> (DMat3, DVec3) {
        if self.is_ideal && self.pattern.is_none() {
            return (BODY_FROM_MOUNT_FRAME * mount.rotation(), BODY_FROM_MOUNT_FRAME * mount.position_m());
        }
        let body_from_sensor = mount.body_from_sensor();
        let axes = DMat3::from_quat(body_from_sensor.rotation);
        let (turn, origin_m) = self.sensor_from_lidar;
        (axes * turn, body_from_sensor.transform_point(origin_m))
    }

    /// Target from the frame of a column, where the frame in which columns turn has these axes.
    pub(super) fn axes_of_column(&self, target_from_lidar: &DMat3, column: usize) -> DMat3 {
        let (sin, cos) = self.turns[column];
        let (x, y) = (target_from_lidar.x_axis, target_from_lidar.y_axis);
        DMat3::from_cols(cos * x + sin * y, cos * y - sin * x, target_from_lidar.z_axis)
    }
}

fn turns(columns: usize, step_rad: f64, phase: f64) -> Vec<(f64, f64)> {
    (0..columns).map(|column| (step_rad * (column as f64 + phase)).sin_cos()).collect()
}

/// The directions of a pattern at so many instants of its period, the first moved on by `phase` of them.
fn directions(pattern: &Pattern, columns: usize, phase: f64) -> Arc<[DVec3]> {
    let at = |column: usize| {
        let share = (column as f64 + phase) / columns as f64;
        (0..pattern.lines()).map(move |line| pattern.direction(line, share))
    };
    (0..columns).flat_map(at).collect()
}

fn ideal_beams(unit: &Unit) -> Vec<FanBeam> {
    let mut elevations_rad: Vec<f64> = unit.model.beams().iter().map(|beam| beam.elevation_rad).collect();
    elevations_rad.sort_by(f64::total_cmp);
    let beam = |elevation_rad: f64| {
        let (sin, cos) = elevation_rad.sin_cos();
        FanBeam { direction: DVec3::new(cos, 0.0, sin), origin_m: DVec3::ZERO, range_offset_m: 0.0, shift: 0 }
    };
    evened(&elevations_rad).into_iter().map(beam).collect()
}

/// Elevations without the rounding of a table, where they are meant to be even.
fn evened(elevations_rad: &[f64]) -> Vec<f64> {
    let (Some(low), Some(high)) = (elevations_rad.first(), elevations_rad.last()) else { return Vec::new() };
    let (low_deg, high_deg) = (low.to_degrees(), high.to_degrees());
    let step_deg = (high_deg - low_deg) / (elevations_rad.len() - 1).max(1) as f64;
    let even_deg = |row: usize| low_deg + step_deg * row as f64;
    let is_even = |(row, elevation_rad): (usize, &f64)| {
        (elevation_rad.to_degrees() - even_deg(row)).abs() < TABLE_ROUNDING_DEG
    };
    if elevations_rad.iter().enumerate().all(is_even) {
        (0..elevations_rad.len()).map(|row| even_deg(row).to_radians()).collect()
    } else {
        elevations_rad.to_vec()
    }
}

fn calibrated_beams(unit: &Unit, rate_hz: f64, step_rad: f64, columns: usize) -> Vec<FanBeam> {
    let lidar_from_sensor = unit.model.sensor_from_lidar().inverse();
    let spin_rad_s = TAU * rate_hz;
    let beam = |channel: usize| {
        let fired_rad = spin_rad_s * unit.model.beams()[channel].fire_offset_ns * 1e-9;
        let ray = unit.model.ray(channel, fired_rad);
        let direction = lidar_from_sensor.transform_vector3(ray.direction);
        let bearing_rad = direction.y.atan2(direction.x);
        let shift = (bearing_rad / step_rad).round() as i64;
        FanBeam {
            direction,
            origin_m: lidar_from_sensor.transform_point3(ray.origin_m),
            range_offset_m: ray.range_offset_m,
            shift: shift.rem_euclid(columns as i64) as usize,
        }
    };
    (0..unit.model.channels()).map(beam).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_calibrated_fan_has_the_rays_of_its_model() {
        for name in ["os1-64", "vlp-16", "hdl-32e"] {
            let unit = Unit::nominal(name).unwrap();
            let fan = Fan::new(&unit, &Sampling { columns: Some(900), ..Sampling::default() }).unwrap();
            let mount = Mount { x_m: 0.1, z_m: 0.2, pitch_rad: 0.4, roll_rad: -0.2, ..Mount::default() };
            let (axes, origin_m) = fan.body_from_lidar(&mount);
            let body_from_sensor = mount.body_from_sensor();
            for column in [0, 1, 250, 899] {
                let azimuth_rad = TAU * column as f64 / 900.0;
                let of_model: Vec<_> = (0..unit.model.channels())
                    .map(|channel| {
                        let fired_ns = unit.model.beams()[channel].fire_offset_ns;
                        let ray = unit.model.ray(channel, azimuth_rad + TAU * 10.0 * fired_ns * 1e-9);
                        let origin_m = body_from_sensor.transform_point(ray.origin_m);
                        (origin_m, body_from_sensor.rotate(ray.direction))
                    })
                    .collect();
                let turned = fan.axes_of_column(&axes, column);
                for beam in &fan.beams {
                    let (from_m, along) = (origin_m + turned * beam.origin_m, turned * beam.direction);
                    let is_same = |(other_m, other): &(DVec3, DVec3)| {
                        from_m.distance(*other_m) < 1e-9 && along.distance(*other) < 1e-9
                    };
                    assert!(of_model.iter().any(is_same), "{name} column {column}: {along}");
                }
            }
        }
    }

    #[test]
    fn even_elevations_lose_the_rounding_of_their_table() {
        let unit = Unit::nominal("os1-64").unwrap();
        let fan = Fan::new(&unit, &Sampling { is_ideal: true, ..Sampling::default() }).unwrap();
        for (row, elevation_rad) in fan.elevations_rad().enumerate() {
            let expected_deg = -21.2 + 42.4 / 63.0 * row as f64;
            assert!((elevation_rad.to_degrees() - expected_deg).abs() < 1e-12, "{row}");
        }
        let uneven = Unit::nominal("vlp-32c").unwrap();
        let fan = Fan::new(&uneven, &Sampling { is_ideal: true, ..Sampling::default() }).unwrap();
        let mut table: Vec<f64> = uneven.model.beams().iter().map(|beam| beam.elevation_rad).collect();
        table.sort_by(f64::total_cmp);
        assert!(fan.elevations_rad().zip(table).all(|(a, b)| (a - b).abs() < 1e-12));
    }
}
