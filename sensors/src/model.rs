//! Where a sensor's beams point: the one definition of beam geometry, used to place measured ranges and to cast
//! predicted ones.

use glam::{DAffine3, DVec3};

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
#[derive(Clone, Debug, PartialEq)]
pub struct SensorModel {
    /// Name as in the model list (`os1-64`, `vlp-16`) or the product line of a calibrated unit.
    pub name: String,
    /// Least range that is reported, m.
    pub min_range_m: f64,
    /// Greatest range that is reported, m.
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
        }
    }

    /// The same sensor with other beams, such as those of a calibrated unit.
    pub fn with_beams(mut self, beams: Vec<Beam>) -> Self {
        self.beams = beams;
        self
    }

    /// Beams in channel order.
    pub fn beams(&self) -> &[Beam] {
        &self.beams
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
    /// documentation, "3D points"; Velodyne VLP-16 manual 63-9243, chapter 9.
    pub fn ray(&self, channel: usize, azimuth_rad: f64) -> Ray {
        let beam = &self.beams[channel];
        let encoder = -azimuth_rad;
        let (sin_bearing, cos_bearing) = (encoder - beam.azimuth_offset_rad).sin_cos();
        let (sin_elevation, cos_elevation) = beam.elevation_rad.sin_cos();
        let direction = DVec3::new(cos_bearing * cos_elevation, sin_bearing * cos_elevation, sin_elevation);
        let (sin_encoder, cos_encoder) = encoder.sin_cos();
        let origin = DVec3::new(
            beam.origin_radial_m * cos_encoder,
            beam.origin_radial_m * sin_encoder,
            beam.origin_z_m,
        );
        Ray {
            origin_m: self.sensor_from_lidar.transform_point3(origin),
            direction: self.sensor_from_lidar.transform_vector3(direction),
            range_offset_m: beam.range_offset_m,
        }
    }
}
