//! From a frame to points.
//!
//! [`points_f64`] goes sample by sample through [`SensorModel::ray`] and is the reference. [`Projector`] gives the same
//! points faster: a point is a channel's line in a frame that turns with the encoder, then one rotation per column,
//! so a frame needs a sine per column and per channel and none per sample.

mod kernel;

use glam::{DMat3, DVec3};

use crate::{Beam, Frame, Layer, Ray, SensorModel};
use kernel::{Channels, Column};

/// Encoder azimuth at the moment a beam fires, rad, clockwise.
pub fn sample_azimuth_rad(model: &SensorModel, frame: &Frame, column: usize, channel: usize) -> f64 {
    let fire_offset_ns = model.beams()[channel].fire_offset_ns;
    frame.column_azimuth_rad[column] + frame.azimuth_rate_rad_per_ns * fire_offset_ns
}

/// The ray a sample was measured along, in the sensor frame.
pub fn sample_ray(model: &SensorModel, frame: &Frame, column: usize, channel: usize) -> Ray {
    model.ray(channel, sample_azimuth_rad(model, frame, column, channel))
}

/// Points of one layer in the sensor frame, m: one per sample in the order of the layer, [`DVec3::ZERO`] where
/// nothing came back. `out` is cleared first. Exact: this is the reference for every faster way.
pub fn points_f64(model: &SensorModel, frame: &Frame, layer: &Layer, out: &mut Vec<DVec3>) {
    out.clear();
    out.reserve(layer.range_mm.len());
    for column in 0..frame.columns() {
        for channel in 0..frame.channels {
            let range_mm = layer.range_mm[frame.index(column, channel)];
            out.push(match range_mm {
                0 => DVec3::ZERO,
                _ => {
                    let azimuth_rad = sample_azimuth_rad(model, frame, column, channel);
                    model.point(channel, azimuth_rad, f64::from(range_mm) * 1e-3)
                }
            });
        }
    }
}

fn bent_points<T>(
    model: &SensorModel,
    frame: &Frame,
    layer: &Layer,
    out: &mut Vec<T>,
    of: impl Fn(DVec3) -> T,
) {
    let mut exact = Vec::new();
    points_f64(model, frame, layer, &mut exact);
    out.clear();
    out.extend(exact.into_iter().map(of));
}

/// Points of one sensor's frames, fast: keeps what does not change from frame to frame.
pub struct Projector {
    model: SensorModel,
    beams: Vec<Beam>,
    sensor_from_lidar: DMat3,
    translation_m: DVec3,
    /// Encoder rate that `channels` are made for, rad/ns.
    rate_rad_per_ns: f64,
    channels: Channels<f64>,
    channels_f32: Channels<f32>,
    /// Azimuths that `columns` are made for, rad.
    azimuths_rad: Vec<f64>,
    columns: Vec<Column<f64>>,
    columns_f32: Vec<Column<f32>>,
}

impl Projector {
    /// For frames of this sensor.
    pub fn new(model: &SensorModel) -> Self {
        let mut projector = Self {
            model: model.clone(),
            beams: model.beams().to_vec(),
            sensor_from_lidar: model.sensor_from_lidar().matrix3,
            translation_m: model.sensor_from_lidar().translation,
            rate_rad_per_ns: 0.0,
            channels: Channels::default(),
            channels_f32: Channels::default(),
            azimuths_rad: Vec::new(),
            columns: Vec::new(),
            columns_f32: Vec::new(),
        };
        projector.set_channels();
        projector
    }

    /// Goes on with another model, if it is another: that of a sensor that learns its calibration on the way.
    pub fn follow(&mut self, model: &SensorModel) {
        if self.model != *model {
            *self = Self::new(model);
        }
    }

    /// As [`points_f64`], within 1e-9 m.
    pub fn points_f64(&mut self, frame: &Frame, layer: &Layer, out: &mut Vec<[f64; 3]>) {
        if !self.model.corrections().is_empty() {
            return bent_points(&self.model, frame, layer, out, |point| point.to_array());
        }
        self.prepare(frame);
        kernel::points(&self.channels, &self.columns, &layer.range_mm, out);
    }

    /// As [`points_f64`], in single precision: within 0.1 mm at 300 m.
    pub fn points_f32(&mut self, frame: &Frame, layer: &Layer, out: &mut Vec<[f32; 3]>) {
        if !self.model.corrections().is_empty() {
            return bent_points(&self.model, frame, layer, out, |point| point.as_vec3().to_array());
        }
        self.prepare(frame);
        kernel::points(&self.channels_f32, &self.columns_f32, &layer.range_mm, out);
    }

    fn prepare(&mut self, frame: &Frame) {
        assert_eq!(frame.channels, self.beams.len(), "the frame has the channels of the model");
        if self.rate_rad_per_ns != frame.azimuth_rate_rad_per_ns {
            self.rate_rad_per_ns = frame.azimuth_rate_rad_per_ns;
            if self.beams.iter().any(|beam| beam.fire_offset_ns != 0.0) {
                self.set_channels();
            }
        }
        if self.azimuths_rad != frame.column_azimuth_rad {
            self.azimuths_rad.clone_from(&frame.column_azimuth_rad);
            self.set_columns();
        }
    }

    /// A channel's line in the frame that turns with the encoder: the ray of [`SensorModel::ray`] at azimuth 0, turned
    /// on by what the encoder moves until the beam fires.
    fn set_channels(&mut self) {
        self.channels.clear();
        self.channels_f32.clear();
        for beam in &self.beams {
            let turned_rad = self.rate_rad_per_ns * beam.fire_offset_ns;
            let (sin_bearing, cos_bearing) = (-turned_rad - beam.azimuth_offset_rad).sin_cos();
            let (sin_elevation, cos_elevation) = beam.elevation_rad.sin_cos();
            let direction =
                DVec3::new(cos_bearing * cos_elevation, sin_bearing * cos_elevation, sin_elevation);
            let (sin_turned, cos_turned) = (-turned_rad).sin_cos();
            let radial_m = beam.origin_radial_m;
            let origin_m = DVec3::new(radial_m * cos_turned, radial_m * sin_turned, beam.origin_z_m);
            // the part of the range before the origin goes into the origin
            let origin_m = origin_m - beam.range_offset_m * direction;
            self.channels.push(direction.to_array(), origin_m.to_array());
            self.channels_f32.push(direction.as_vec3().to_array(), origin_m.as_vec3().to_array());
        }
    }

    fn set_columns(&mut self) {
        self.columns.clear();
        self.columns_f32.clear();
        for azimuth_rad in &self.azimuths_rad {
            let rotation = self.sensor_from_lidar * DMat3::from_rotation_z(-azimuth_rad);
            let t = self.translation_m;
            let rows = rotation.transpose();
            self.columns.push(Column {
                rows: [rows.x_axis, rows.y_axis, rows.z_axis].map(|row| row.to_array()),
                translation: t.to_array(),
            });
            self.columns_f32.push(Column {
                rows: [rows.x_axis, rows.y_axis, rows.z_axis].map(|row| row.as_vec3().to_array()),
                translation: t.as_vec3().to_array(),
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DAffine3, DQuat};

    fn frame(channels: usize, columns: usize, rate_rad_per_ns: f64) -> Frame {
        let mut seed = 1u32;
        let mut random = || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            seed >> 8
        };
        let mut frame = Frame {
            channels,
            column_time_ns: vec![1; columns],
            column_azimuth_rad: (0..columns).map(|_| f64::from(random()) * 3.7e-7).collect(),
            column_valid: vec![true; columns],
            azimuth_rate_rad_per_ns: rate_rad_per_ns,
            ..Frame::default()
        };
        frame.first.range_mm = (0..channels * columns).map(|_| random() % 300_000).collect();
        frame.first.range_mm[7] = 0;
        frame
    }

    #[test]
    fn the_fast_way_agrees_with_the_exact_one() {
        let tilted =
            DAffine3::from_rotation_translation(DQuat::from_rotation_x(0.3), DVec3::new(0.1, -0.2, 0.3));
        for name in ["os0-128", "os1-16", "vlp-16", "vls-128", "hdl-32e"] {
            let model = crate::catalogue::nominal(name).unwrap();
            let turned = SensorModel::new("turned", model.beams().to_vec(), tilted);
            for model in [model, turned] {
                let mut projector = Projector::new(&model);
                for rate_rad_per_ns in [6.28e-8, 1.2e-7] {
                    let frame = frame(model.channels(), 37, rate_rad_per_ns);
                    let (mut exact, mut fast, mut single) = (Vec::new(), Vec::new(), vec![[9.0; 3]; 3]);
                    points_f64(&model, &frame, &frame.first, &mut exact);
                    projector.points_f64(&frame, &frame.first, &mut fast);
                    projector.points_f32(&frame, &frame.first, &mut single);
                    assert_eq!((fast.len(), single.len()), (exact.len(), exact.len()));
                    for ((exact, fast), single) in exact.iter().zip(&fast).zip(&single) {
                        assert!((*exact - DVec3::from(*fast)).length() < 1e-9, "{name}");
                        let single = DVec3::from(single.map(f64::from));
                        assert!((*exact - single).length() < 1e-4, "{name}: {exact} {single}");
                    }
                    assert_eq!((exact[7], fast[7], single[7]), (DVec3::ZERO, [0.0; 3], [0.0; 3]));
                }
            }
        }
    }
}
