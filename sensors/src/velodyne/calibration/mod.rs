//! The calibration of one unit: from VeloView's `db.xml`, from the YAML of the ROS driver, or from the status bytes
//! that an HDL-64E S2 or S3 sends along.

mod db_xml;
mod status;
mod yaml;

pub(crate) use status::encode_status_bytes;
pub use status::{GpsState, Health, StatusReader, UnitStatus, Warnings};

use super::product::Product;
use crate::catalogue::{self, ModelError};
use crate::model::{BeamCorrection, SensorModel};

/// Most lasers a calibration may list.
const MOST_LASERS: usize = 128;

/// Calibration of all lasers, in the order of their ids.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    /// One unit of the distance field, m, where the file says so.
    pub distance_unit_m: Option<f64>,
    /// Lasers `0..`.
    pub lasers: Vec<LaserCalibration>,
}

/// Calibration of one laser.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LaserCalibration {
    /// Elevation, rad.
    pub vertical_rad: f64,
    /// Subtracted from the encoder azimuth, rad (`rotCorrection`).
    pub rotation_rad: f64,
    /// Added to the measured distance, m; as measured at 25.04 m.
    pub distance_m: f64,
    /// The same at 2.40 m on the lateral and at 1.93 m on the forward axis, where it was measured.
    pub near_distance_m: Option<[f64; 2]>,
    /// Height of the beam's origin, m; none where the file says nothing.
    pub vertical_offset_m: Option<f64>,
    /// Offset of the beam's origin to the left, m.
    pub horizontal_offset_m: f64,
    /// Focal distance of the intensity compensation, m.
    pub focal_distance_m: f64,
    /// Slope of the intensity compensation.
    pub focal_slope: f64,
    /// Minimum and maximum intensity.
    pub intensity_limits: [u8; 2],
    /// Whether the laser is in use.
    pub enabled: bool,
}

/// Why a calibration was not read.
#[derive(Debug, thiserror::Error)]
pub enum CalibrationError {
    /// The text is no XML or no YAML.
    #[error("calibration: {reason}")]
    Syntax {
        /// What the parser says, with line and column.
        reason: String,
    },
    /// The text is well-formed and does not say what is needed.
    #[error("calibration: {place}: {reason}")]
    Content {
        /// Element, key or laser.
        place: String,
        /// What was found and what was expected.
        reason: String,
    },
    /// The nominal model is missing.
    #[error(transparent)]
    Model(#[from] ModelError),
}

impl Calibration {
    /// Reads a file of either kind: text that begins with `<` is XML.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, CalibrationError> {
        let text = std::str::from_utf8(bytes).map_err(|error| CalibrationError::Syntax {
            reason: format!("byte {} is not UTF-8", error.valid_up_to()),
        })?;
        if text.trim_start_matches('\u{feff}').trim_start().starts_with('<') {
            Self::from_db_xml(text)
        } else {
            Self::from_yaml(text)
        }
    }

    /// Reads the `db.xml` of VeloView and of the disk that comes with an HDL-64E: degrees and centimetres.
    pub(crate) fn from_db_xml(text: &str) -> Result<Self, CalibrationError> {
        db_xml::parse(text)?.checked()
    }

    /// Reads the YAML of the ROS driver: radians and metres.
    pub(crate) fn from_yaml(text: &str) -> Result<Self, CalibrationError> {
        yaml::parse(text)?.checked()
    }

    /// The model of a unit of `product`: times and whatever the calibration leaves open from the nominal model.
    pub fn model(&self, product: Product) -> Result<SensorModel, CalibrationError> {
        let nominal = catalogue::nominal(product.name())?;
        if self.lasers.len() != nominal.channels() {
            return Err(CalibrationError::Content {
                place: "lasers".to_owned(),
                reason: format!("{} given, a {product} has {}", self.lasers.len(), nominal.channels()),
            });
        }
        let is_hdl_64e = product.is_hdl_64e();
        let mut beams = nominal.beams().to_vec();
        for (beam, laser) in beams.iter_mut().zip(&self.lasers) {
            beam.elevation_rad = laser.vertical_rad;
            beam.azimuth_offset_rad = -laser.rotation_rad;
            beam.range_offset_m = -laser.distance_m;
            match (laser.vertical_offset_m, is_hdl_64e) {
                (Some(offset_m), _) => beam.origin_z_m = offset_m,
                // distances of a calibrated unit and heights of a nominal one do not belong together
                (None, true) => beam.origin_z_m = 0.0,
                (None, false) => {}
            }
        }
        let corrections = self.lasers.iter().map(|laser| BeamCorrection {
            origin_left_m: laser.horizontal_offset_m,
            near_distance_m: laser.near_distance_m,
            focal_distance_m: laser.focal_distance_m,
            focal_slope: laser.focal_slope,
            intensity_limits: laser.intensity_limits,
        });
        let corrections: Vec<_> = corrections.collect();
        let plain = corrections.iter().all(|correction| *correction == PLAIN);
        let model = nominal.with_beams(beams);
        Ok(if plain { model } else { model.with_corrections(corrections) })
    }

    fn checked(self) -> Result<Self, CalibrationError> {
        for (id, laser) in self.lasers.iter().enumerate() {
            let values = [
                laser.vertical_rad,
                laser.rotation_rad,
                laser.distance_m,
                laser.horizontal_offset_m,
                laser.focal_distance_m,
                laser.focal_slope,
                laser.vertical_offset_m.unwrap_or(0.0),
            ];
            if values
                .into_iter()
                .chain(laser.near_distance_m.into_iter().flatten())
                .any(|value| !value.is_finite())
            {
                return Err(content(format!("laser {id}"), "a value is not finite"));
            }
            if laser.vertical_rad.abs() > std::f64::consts::FRAC_PI_2 {
                return Err(content(
                    format!("laser {id}"),
                    format!(
                        "elevation of {} rad, expected at most pi/2; is it in degrees?",
                        laser.vertical_rad
                    ),
                ));
            }
        }
        Ok(self)
    }
}

/// A correction that changes nothing.
const PLAIN: BeamCorrection = BeamCorrection {
    origin_left_m: 0.0,
    near_distance_m: None,
    focal_distance_m: 0.0,
    focal_slope: 0.0,
    intensity_limits: [0, 255],
};

fn content(place: impl Into<String>, reason: impl Into<String>) -> CalibrationError {
    CalibrationError::Content { place: place.into(), reason: reason.into() }
}

/// Puts lasers in the order of their ids, each exactly once.
fn in_order(lasers: Vec<(i64, LaserCalibration)>) -> Result<Vec<LaserCalibration>, CalibrationError> {
    let count = lasers.len();
    if count == 0 || count > MOST_LASERS {
        return Err(content("lasers", format!("{count} lasers, expected 1 to {MOST_LASERS}")));
    }
    let mut ordered = vec![None; count];
    for (id, laser) in lasers {
        let place = usize::try_from(id).ok().and_then(|id| ordered.get_mut(id));
        match place {
            Some(place @ None) => *place = Some(laser),
            Some(_) => return Err(content(format!("laser {id}"), "given twice")),
            None => return Err(content(format!("laser {id}"), format!("expected an id below {count}"))),
        }
    }
    // as many lasers as places, none twice: all are filled
    Ok(ordered.into_iter().flatten().collect())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const YAML: &str =
        "distance_resolution: 0.002\nlasers:\n- {laser_id: 0, vert_correction: 0.1, rot_correction: 0}\n";
    const XML: &str = "<boost_serialization><DB><points_><item><px><id_>0</id_><rotCorrection_>1</rotCorrection_>\
        <vertCorrection_>2</vertCorrection_><distCorrection_>3</distCorrection_></px></item></points_></DB>\
        </boost_serialization>";

    /// Points and intensities that velodyne_decoder 3.1.0 gives for this calibration: laser, azimuth (0.01 degree), raw
    /// distance and intensity of the packet, then x, y, z (m) and intensity.
    const PEER: [(usize, u32, u32, u8, [f64; 3], f64); 8] = [
        (0, 0, 6653, 85, [14.52883, -0.73837, 0.709], 88.941),
        (32, 0, 22_961, 185, [46.73761, 0.45019, -6.03642], 255.0),
        (0, 35, 6656, 94, [14.53005, -0.82778, 0.7092], 97.97),
        (32, 35, 20_391, 110, [41.64467, 0.14956, -5.35662], 233.199),
        (32, 52, 742, 77, [2.76691, 0.026, -0.16917], 134.064),
        (32, 726, 8579, 198, [18.12858, -2.12155, -2.23829], 220.559),
        (0, 743, 17_752, 44, [36.08025, -6.61506, 1.48095], 146.734),
        (0, 760, 8219, 21, [17.3673, -3.2347, 0.81788], 40.126),
    ];

    #[test]
    fn a_calibrated_hdl_64e_places_points_as_its_peer() {
        let laser = |id: u32| LaserCalibration {
            vertical_rad: (2.0 - 0.3 * f64::from(id)).to_radians(),
            rotation_rad: (0.11 * f64::from(id) - 3.0).to_radians(),
            distance_m: 1.2 + 0.001 * f64::from(id),
            near_distance_m: Some([1.3, 1.31]),
            vertical_offset_m: Some(0.2),
            horizontal_offset_m: if id.is_multiple_of(2) { 0.026 } else { -0.026 },
            focal_distance_m: 12.5,
            focal_slope: 1.4,
            intensity_limits: [30, 255],
            enabled: true,
        };
        let calibration = Calibration { distance_unit_m: Some(0.002), lasers: (0..64).map(laser).collect() };
        let model = calibration.model(Product::Hdl64eS2).unwrap();
        for (laser, counts, distance, level, position_m, intensity) in PEER {
            let range_m = f64::from(distance) * 0.002;
            let point = model.point(laser, (f64::from(counts) * 0.01).to_radians(), range_m);
            assert!(point.distance(position_m.into()) < 5e-5, "laser {laser} at {range_m} m: {point}");
            assert!((model.intensity(laser, range_m, level) - intensity).abs() < 2e-3);
        }
    }

    #[test]
    fn hostile_files_are_refused() {
        for text in
            ["<a>".repeat(200_000), "[".repeat(200_000), "- ".repeat(200_000), "a: &a [*a]\n".to_owned()]
        {
            assert!(Calibration::from_bytes(text.as_bytes()).is_err());
        }
        let laughs = "a: &a [x,x,x,x,x,x,x,x,x]\nb: &b [*a,*a,*a,*a,*a,*a,*a]\nc: &c [*b,*b,*b,*b,*b,*b,*b]\n\
                      d: &d [*c,*c,*c,*c,*c,*c,*c]\ne: &e [*d,*d,*d,*d,*d,*d,*d]\nlasers: [*e,*e,*e,*e,*e,*e]\n";
        assert!(Calibration::from_yaml(laughs).is_err());
    }

    proptest! {
        #[test]
        fn any_bytes_get_an_answer(bytes in proptest::collection::vec(any::<u8>(), 0..400)) {
            let _any_answer = Calibration::from_bytes(&bytes);
        }

        #[test]
        fn a_damaged_file_gets_an_answer(xml: bool, at in 0_usize..300, byte: u8, cut in 0_usize..300) {
            let mut bytes = if xml { XML } else { YAML }.as_bytes().to_vec();
            prop_assert!(Calibration::from_bytes(&bytes).is_ok());
            let at = at % bytes.len();
            bytes[at] = byte;
            bytes.truncate(bytes.len().saturating_sub(cut % 40));
            let _any_answer = Calibration::from_bytes(&bytes);
        }
    }
}
