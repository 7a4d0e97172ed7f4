//! From a frame to points: the exact way, sample by sample through [`SensorModel::ray`].

use glam::DVec3;

use crate::{Frame, Layer, Ray, SensorModel};

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
