//! Where a sensor's beams point: the one definition of beam geometry, used to place measured ranges and to cast
//! predicted ones.

use glam::{DAffine3, DVec3};

use crate::pattern::Pattern;

/// One laser beam, as calibrated, in the lidar frame (x forward, y left, z up, spin axis z).
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Beam {
    /// Elevation above the spin plane, rad.
    pub elevation_rad: f64,
    /// Added to the encoder azimuth (clockwise), rad. Ouster `beam_azimuth_angles` as they are; Velodyne
    /// `rotCorrection` with its sign turned.
    pub azimuth_offset_rad: f64,
    /// Distance of the beam's origin from the spin axis along the encoder direction, m (Ouster
    /// `lidar_origin_to_beam_origin_mm`).
    pub origin_radial_m: f64,
    /// Height of the beam's origin above the lidar origin, m (Velodyne vertical offset).
    pub origin_z_m: f64,
    /// What the reported range counts before the beam leaves its origin, m (Ouster: the norm of the beam origin).
    pub range_offset_m: f64,
    /// When the beam fires after its column's time stamp, ns.
    pub fire_offset_ns: f64,
}

/// What the calibration of an HDL-64E says beyond a [`Beam`]. Source: HDL-64E S3 manual 63-HDL64ES3, appendix on
/// calibration (two-point distance correction, offsets, focal intensity compensation).
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct BeamCorrection {
    /// Offset of the beam's origin to the left of its bearing, m (`horizOffsetCorrection`).
    pub origin_left_m: f64,
    /// Distance correction at the near calibration distances, m, where it was measured: for the part of a distance
    /// along the sensor's lateral axis (`distCorrectionX`, at 2.40 m) and along its forward axis (`distCorrectionY`,
    /// at 1.93 m). Toward 25.04 m both become the far one, `-range_offset_m` of the [`Beam`]; reported ranges from
    /// there on take that one alone. Heights take the mean of both.
    pub near_distance_m: Option<[f64; 2]>,
    /// Distance at which the intensity needs no compensation, m, and the slope of the compensation; 0 is none.
    pub focal_distance_m: f64,
    /// See `focal_distance_m`.
    pub focal_slope: f64,
    /// Minimum and maximum intensity.
    pub intensity_limits: [u8; 2],
}

/// Distances of the near calibration targets on the lateral and the forward axis, and of the far one, m. Source:
/// HDL-64E S3 manual 63-HDL64ES3, appendix on calibration.
pub(crate) const NEAR_TARGETS_M: [f64; 2] = [2.40, 1.93];
pub(crate) const FAR_TARGET_M: f64 = 25.04;

/// A beam at one azimuth, in the sensor frame: the point at reported range r is
/// `origin_m + (r - range_offset_m) * direction`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where the beam starts, m.
    pub origin_m: DVec3,
    /// Unit vector.
    pub direction: DVec3,
    /// Part of the reported range that lies before the origin, m.
    pub range_offset_m: f64,
}

impl Ray {
    /// Point at a reported range, m.
    pub fn at_range(&self, range_m: f64) -> DVec3 {
        self.origin_m + (range_m - self.range_offset_m) * self.direction
    }
}

/// A sensor: its beams and the limits of what it measures.
///
/// ```
/// let model = sensors::catalogue::nominal("os1-64")?;
/// assert_eq!(model.channels(), 64);
/// let ray = model.ray(0, 0.0); // the highest beam, encoder at zero
/// assert!(ray.direction.z > 0.35 && (ray.direction.length() - 1.0).abs() < 1e-12);
/// assert_eq!(ray.at_range(12.0), model.point(0, 0.0, 12.0));
/// # Ok::<(), sensors::catalogue::ModelError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct SensorModel {
    /// Name as in the model list (`os1-64`, `vlp-16`) or the product line of a calibrated unit.
    pub name: String,
    /// Least range that is reported, m.
    pub min_range_m: f64,
    /// Longest range that the sensor reports, m.
    pub max_range_m: f64,
    /// Full beam divergence, rad; 0 when unknown.
    pub divergence_rad: f64,
    /// Radius of the housing around the sensor origin, m: what must not touch another sensor, and what occludes.
    pub housing_radius_m: f64,
    /// Height of the housing, m.
    pub housing_height_m: f64,
    /// Sensor frame (the housing's, z up) from lidar frame.
    sensor_from_lidar: DAffine3,
    beams: Vec<Beam>,
    /// One per beam, or none.
    corrections: Vec<BeamCorrection>,
    /// Directions over time, of a sensor without rings.
    pattern: Option<Pattern>,
}

impl SensorModel {
    /// A model from its beams. `sensor_from_lidar` must be rigid.
    pub fn new(name: impl Into<String>, beams: Vec<Beam>, sensor_from_lidar: DAffine3) -> Self {
        Self {
            name: name.into(),
            min_range_m: 0.0,
            max_range_m: f64::INFINITY,
            divergence_rad: 0.0,
            housing_radius_m: 0.0,
            housing_height_m: 0.0,
            sensor_from_lidar,
            beams,
            corrections: Vec::new(),
            pattern: None,
        }
    }

    /// The same sensor with other beams, such as those of a calibrated unit.
    pub fn with_beams(mut self, beams: Vec<Beam>) -> Self {
        self.beams = beams;
        self
    }

    /// The same sensor with corrections beyond its beams: one per beam, or none.
    pub(crate) fn with_corrections(mut self, corrections: Vec<BeamCorrection>) -> Self {
        assert!(corrections.is_empty() || corrections.len() == self.beams.len(), "one correction per beam");
        self.corrections = corrections;
        self
    }

    /// The same sensor without rings: its lines take the place of its channels, a period that of a revolution.
    pub(crate) fn with_pattern(mut self, pattern: Pattern) -> Self {
        let nothing = Beam {
            elevation_rad: 0.0,
            azimuth_offset_rad: 0.0,
            origin_radial_m: 0.0,
            origin_z_m: 0.0,
            range_offset_m: 0.0,
            fire_offset_ns: 0.0,
        };
        self.beams = vec![nothing; pattern.lines()];
        self.corrections = Vec::new();
        self.pattern = Some(pattern);
        self
    }

    /// The same sensor with rings.
    pub(crate) fn without_pattern(self) -> Self {
        let corrections = self.corrections.first().map_or(Vec::new(), |same| vec![*same; self.beams.len()]);
        Self { pattern: None, corrections, ..self }
    }

    /// Directions over time, of a sensor without rings.
    pub fn pattern(&self) -> Option<&Pattern> {
        self.pattern.as_ref()
    }

    /// Corrections beyond the beams, in channel order; empty except for calibrated HDL-64E and heads
    /// with an optical centre off their axis.
    pub fn corrections(&self) -> &[BeamCorrection] {
        &self.corrections
    }

    /// Beams in channel order.
    pub fn beams(&self) -> &[Beam] {
        &self.beams
    }

    /// Number of each channel by rising elevation, as ROS drivers number the rings of a Velodyne.
    pub fn rings_by_elevation(&self) -> Vec<u16> {
        let mut by_elevation: Vec<usize> = (0..self.beams.len()).collect();
        by_elevation.sort_by(|a, b| self.beams[*a].elevation_rad.total_cmp(&self.beams[*b].elevation_rad));
        let mut rings = vec![0; by_elevation.len()];
        for (ring, channel) in (0..).zip(by_elevation) {
            rings[channel] = ring;
        }
        rings
    }

    /// Number of channels.
    pub fn channels(&self) -> usize {
        self.beams.len()
    }

    /// Sensor frame from lidar frame.
    pub fn sensor_from_lidar(&self) -> DAffine3 {
        self.sensor_from_lidar
    }

    /// The ray of a channel at an encoder azimuth (rad, clockwise from the lidar's +x). Source: Ouster sensor
    /// documentation, "3D points"; Velodyne VLP-16 manual 63-9243, chapter 9. Of a sensor without rings a turn is a period of
    /// its pattern.
    pub fn ray(&self, channel: usize, azimuth_rad: f64) -> Ray {
        if let Some(pattern) = &self.pattern {
            let along = pattern.direction(channel, azimuth_rad / std::f64::consts::TAU);
            return Ray {
                origin_m: self.sensor_from_lidar.translation,
                direction: self.sensor_from_lidar.transform_vector3(along),
                range_offset_m: 0.0,
            };
        }
        let beam = &self.beams[channel];
        let encoder = -azimuth_rad;
        let (sin_bearing, cos_bearing) = (encoder - beam.azimuth_offset_rad).sin_cos();
        let (sin_elevation, cos_elevation) = beam.elevation_rad.sin_cos();
        let direction = DVec3::new(cos_bearing * cos_elevation, sin_bearing * cos_elevation, sin_elevation);
        let (sin_encoder, cos_encoder) = encoder.sin_cos();
        let mut origin = DVec3::new(
            beam.origin_radial_m * cos_encoder,
            beam.origin_radial_m * sin_encoder,
            beam.origin_z_m,
        );
        if let Some(correction) = self.corrections.get(channel) {
            origin += correction.origin_left_m * DVec3::new(-sin_bearing, cos_bearing, 0.0);
        }
        Ray {
            origin_m: self.sensor_from_lidar.transform_point3(origin),
            direction: self.sensor_from_lidar.transform_vector3(direction),
            range_offset_m: beam.range_offset_m,
        }
    }

    /// The point at a reported range, m, in the sensor frame: along [`SensorModel::ray`], and with the near-distance
    /// correction of a calibrated HDL-64E, which is no straight line.
    pub fn point(&self, channel: usize, azimuth_rad: f64, range_m: f64) -> DVec3 {
        let ray = self.ray(channel, azimuth_rad);
        let point = ray.at_range(range_m);
        let near = self.corrections.get(channel).and_then(|correction| correction.near_distance_m);
        let Some(near_m) = near.filter(|_| range_m < FAR_TARGET_M) else { return point };
        let far_m = -ray.range_offset_m;
        let from_sensor = self.sensor_from_lidar.inverse();
        let in_lidar = from_sensor.transform_point3(point);
        let direction = from_sensor.transform_vector3(ray.direction);
        let more_m = |axis: usize, along_m: f64| {
            let share = (FAR_TARGET_M - along_m.abs()) / (FAR_TARGET_M - NEAR_TARGETS_M[axis]);
            (near_m[axis] - far_m) * share
        };
        // lateral axis: the lidar's y; forward axis: its x
        let (lateral_m, forward_m) = (more_m(0, in_lidar.y), more_m(1, in_lidar.x));
        let more = DVec3::new(forward_m, lateral_m, 0.5 * (forward_m + lateral_m));
        self.sensor_from_lidar.transform_point3(in_lidar + direction * more)
    }

    /// The intensity of a return as the calibration of an HDL-64E compensates it, 0 to 255; other sensors report it
    /// calibrated. `range_m` is the reported range.
    pub fn intensity(&self, channel: usize, range_m: f64, reported: u8) -> f64 {
        let Some(correction) = self.corrections.get(channel) else { return f64::from(reported) };
        let square = |value: f64| value * value;
        // 65535 units of 2 mm are 131 m
        let (full_m, focal_m) = (131.07, correction.focal_distance_m);
        let off_focus = (square(1.0 - focal_m / 131.0) - square(1.0 - range_m / full_m)).abs();
        let [least, most] = correction.intensity_limits.map(f64::from);
        (f64::from(reported) + 256.0 * correction.focal_slope * off_focus).min(most).max(least)
    }
}
