//! From a frame to points.
//!
//! [`points_f64`] goes sample by sample through [`SensorModel::ray`] and is the reference. [`Projector`] gives the same
//! points faster: a point is a channel's line in a frame that turns with the encoder, then one rotation per column,
//! so a frame needs a sine per column and per channel and none per sample. The correction of a calibrated HDL-64E for
//! nearness, which is no straight line, follows in the lidar frame.

mod kernel;
mod elements;
mod tables;

use glam::DVec3;

use crate::{Frame, Layer, Ray, SensorModel};
use kernel::Kernel;
use tables::Tables;

/// Encoder azimuth at the moment a beam fires, rad, clockwise.
pub fn sample_azimuth_rad(model: &SensorModel, frame: &Frame, column: usize, channel: usize) -> f64 {
    let fire_offset_ns = model.beams()[channel].fire_offset_ns;
    frame.column_azimuth_rad[column] + frame.azimuth_rate_rad_per_ns * fire_offset_ns
}

/// When a beam fires in a column, ns on the sensor's clock.
pub fn sample_time_ns(model: &SensorModel, frame: &Frame, column: usize, channel: usize) -> u64 {
    let fired_ns = model.beams()[channel].fire_offset_ns.round() as i64;
    frame.column_time_ns[column].saturating_add_signed(fired_ns)
}

/// The first returns in the valid columns of a frame, column by column: column, channel and range, mm.
pub fn returns<'a>(
    model: &SensorModel,
    frame: &'a Frame,
) -> impl Iterator<Item = (usize, usize, u32)> + use<'a> {
    let channels = frame.channels.min(model.channels());
    let columns = (0..frame.columns()).filter(|column| frame.column_valid[*column]);
    columns.flat_map(move |column| {
        (0..channels).filter_map(move |channel| {
            let range_mm = frame.first.range_mm[frame.index(column, channel)];
            (range_mm > 0).then_some((column, channel, range_mm))
        })
    })
}

/// The ray a sample was measured along, in the sensor frame.
pub fn sample_ray(model: &SensorModel, frame: &Frame, column: usize, channel: usize) -> Ray {
    model.ray(channel, sample_azimuth_rad(model, frame, column, channel))
}

/// Points of one layer in the sensor frame, m: one per sample in the order of the layer, [`DVec3::ZERO`] where
/// nothing came back or the column is not valid. `out` is cleared first. Exact: this is the reference for every faster version.
pub fn points_f64(model: &SensorModel, frame: &Frame, layer: &Layer, out: &mut Vec<DVec3>) {
    out.clear();
    out.reserve(layer.range_mm.len());
    for column in 0..frame.columns() {
        for channel in 0..frame.channels {
            let range_mm = layer.range_mm[frame.index(column, channel)];
            out.push(match range_mm {
                _ if !frame.column_valid[column] => DVec3::ZERO,
                0 => DVec3::ZERO,
                _ => {
                    let azimuth_rad = sample_azimuth_rad(model, frame, column, channel);
                    model.point(channel, azimuth_rad, f64::from(range_mm) * 1e-3)
                }
            });
        }
    }
}

/// Points of one sensor's frames, fast: keeps what does not change from frame to frame.
pub struct Projector {
    model: SensorModel,
    double: Tables<f64>,
    single: Tables<f32>,
}

impl Projector {
    /// For frames of this sensor.
    pub fn new(model: &SensorModel) -> Self {
        Self { double: Tables::new(model), single: Tables::new(model), model: model.clone() }
    }

    /// Goes on with another model, if it differs: a sensor may learn its calibration during the recording.
    pub fn follow(&mut self, model: &SensorModel) {
        if self.model != *model {
            *self = Self::new(model);
        }
    }

    /// As [`points_f64`], within 1e-9 m.
    pub fn points_f64(&mut self, frame: &Frame, layer: &Layer, out: &mut Vec<[f64; 3]>) {
        self.double.prepare(&self.model, frame);
        f64::points(&self.double, &frame.column_valid, &layer.range_mm, out);
    }

    /// As [`points_f64`], in single precision: within half a millionth of the distance, and 2 um.
    pub fn points_f32(&mut self, frame: &Frame, layer: &Layer, out: &mut Vec<[f32; 3]>) {
        self.single.prepare(&self.model, frame);
        f32::points(&self.single, &frame.column_valid, &layer.range_mm, out);
    }
}

#[cfg(test)]
mod tests {
    use super::elements::Portable;
    use super::*;
    use crate::BeamCorrection;
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
        // near and far: half of them are corrected for nearness
        frame.first.range_mm =
            (0..channels * columns).map(|at| random() % [300_000, 30_000][at % 2]).collect();
        frame.first.range_mm[channels + 7] = 0;
        frame.first.range_mm[2 * channels..4 * channels].fill(0);
        for column in [0, 9, 10, columns - 1] {
            frame.column_valid[column] = false;
        }
        frame
    }

    /// Models of every kind: any number of channels, upright and tilted housings, calibrated units.
    fn models() -> Vec<SensorModel> {
        let tilted =
            DAffine3::from_rotation_translation(DQuat::from_rotation_x(0.3), DVec3::new(0.1, -0.2, 0.3));
        let mut models = Vec::new();
        for name in ["os0-128", "os1-16", "vlp-16", "vls-128", "hdl-32e", "hdl-64e-s2"] {
            let model = crate::catalogue::nominal(name).unwrap();
            let corrections = (0..model.channels()).map(|channel| BeamCorrection {
                origin_left_m: 0.026 - 0.05 * (channel % 2) as f64,
                near_distance_m: (channel % 5 > 0).then_some([1.2, 1.3 + 0.01 * channel as f64]),
                ..BeamCorrection::default()
            });
            let calibrated = model.clone().with_corrections(corrections.collect());
            let few = model.beams()[..11].to_vec();
            models.extend([
                SensorModel::new("tilted", model.beams().to_vec(), tilted),
                SensorModel::new("tilted and calibrated", model.beams().to_vec(), tilted)
                    .with_corrections(calibrated.corrections().to_vec()),
                SensorModel::new("few beams", few, model.sensor_from_lidar()),
                model,
                calibrated,
            ]);
        }
        models
    }

    #[test]
    fn fast_points_agree_with_the_exact_ones() {
        for model in models() {
            let name = &model.name;
            let mut projector = Projector::new(&model);
            for rate_rad_per_ns in [6.28e-8, 1.2e-7] {
                let frame = frame(model.channels(), 37, rate_rad_per_ns);
                let (mut exact, mut fast, mut single) = (Vec::new(), Vec::new(), vec![[9.0; 3]; 3]);
                points_f64(&model, &frame, &frame.first, &mut exact);
                projector.points_f64(&frame, &frame.first, &mut fast);
                projector.points_f32(&frame, &frame.first, &mut single);
                assert_eq!((fast.len(), single.len()), (exact.len(), exact.len()));
                for ((exact, fast), single) in exact.iter().zip(&fast).zip(&single) {
                    assert!((*exact - DVec3::from(*fast)).length() < 1e-9, "{name}: {exact} {fast:?}");
                    let single = DVec3::from(single.map(f64::from));
                    let bound_m = 2e-6 + 5e-7 * exact.length();
                    assert!((*exact - single).length() < bound_m, "{name}: {exact} {single}");
                }
                for at in [7, model.channels() + 7] {
                    assert_eq!((exact[at], fast[at], single[at]), (DVec3::ZERO, [0.0; 3], [0.0; 3]));
                }
            }
        }
    }

    #[test]
    fn every_build_of_the_kernel_gives_the_same_bits() {
        for model in models() {
            let frame = frame(model.channels(), 37, 6.28e-8);
            let ranges_mm = &frame.first.range_mm;
            let mut projector = Projector::new(&model);
            let (mut double, mut single) = (Vec::new(), Vec::new());
            projector.points_f64(&frame, &frame.first, &mut double);
            projector.points_f32(&frame, &frame.first, &mut single);
            let mut portable = vec![[0.0; 3]; ranges_mm.len()];
            kernel::points_in::<Portable<f64>>(
                &projector.double,
                &frame.column_valid,
                ranges_mm,
                &mut portable,
            );
            assert!(
                portable
                    .iter()
                    .flatten()
                    .map(|x| x.to_bits())
                    .eq(double.iter().flatten().map(|x| x.to_bits()))
            );
            let mut portable = vec![[0.0; 3]; ranges_mm.len()];
            kernel::points_in::<Portable<f32>>(
                &projector.single,
                &frame.column_valid,
                ranges_mm,
                &mut portable,
            );
            assert!(
                portable
                    .iter()
                    .flatten()
                    .map(|x| x.to_bits())
                    .eq(single.iter().flatten().map(|x| x.to_bits()))
            );
        }
    }
}
