//! The YAML that the ROS driver's `gen_calibration.py` writes; velodyne_decoder reads and writes it too.

use super::{Calibration, CalibrationError, LaserCalibration, in_order};

#[derive(serde::Deserialize)]
struct File {
    #[serde(default)]
    distance_resolution: Option<f64>,
    #[serde(default)]
    num_lasers: Option<usize>,
    lasers: Vec<Laser>,
}

#[derive(serde::Deserialize)]
struct Laser {
    laser_id: i64,
    vert_correction: f64,
    #[serde(default)]
    rot_correction: f64,
    #[serde(default)]
    dist_correction: f64,
    #[serde(default)]
    two_pt_correction_available: Option<bool>,
    #[serde(default)]
    dist_correction_x: Option<f64>,
    #[serde(default)]
    dist_correction_y: Option<f64>,
    #[serde(default)]
    vert_offset_correction: Option<f64>,
    #[serde(default)]
    horiz_offset_correction: Option<f64>,
    #[serde(default)]
    focal_distance: f64,
    #[serde(default)]
    focal_slope: f64,
    #[serde(default)]
    min_intensity: Option<f64>,
    #[serde(default)]
    max_intensity: Option<f64>,
}

pub(super) fn parse(text: &str) -> Result<Calibration, CalibrationError> {
    let file: File = serde_saphyr::from_str(text)
        .map_err(|error| CalibrationError::Syntax { reason: error.to_string() })?;
    if let Some(count) = file.num_lasers
        && count != file.lasers.len()
    {
        return Err(super::content(
            "num_lasers",
            format!("{count}, but {} lasers follow", file.lasers.len()),
        ));
    }
    let lasers = file.lasers.iter().map(|laser| (laser.laser_id, laser.calibration())).collect();
    Ok(Calibration { distance_unit_m: file.distance_resolution, lasers: in_order(lasers)? })
}

impl Laser {
    fn calibration(&self) -> LaserCalibration {
        // the S1 file of the ROS driver has zeros for what was never measured
        let near_distance_m = match (self.dist_correction_x, self.dist_correction_y) {
            (Some(x), Some(y)) => Some([x, y]),
            _ => None,
        }
        .filter(|near_m| self.two_pt_correction_available.unwrap_or(*near_m != [0.0; 2]));
        let level =
            |value: Option<f64>, otherwise| value.map_or(otherwise, |value| value.clamp(0.0, 255.0) as u8);
        LaserCalibration {
            vertical_rad: self.vert_correction,
            rotation_rad: self.rot_correction,
            distance_m: self.dist_correction,
            near_distance_m,
            vertical_offset_m: self.vert_offset_correction,
            horizontal_offset_m: self.horiz_offset_correction.unwrap_or(0.0),
            focal_distance_m: self.focal_distance,
            focal_slope: self.focal_slope,
            intensity_limits: [level(self.min_intensity, 0), level(self.max_intensity, 255)],
            enabled: true,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::Calibration;
    use crate::velodyne::Product;

    #[test]
    fn lasers_are_put_in_order() {
        let text = "distance_resolution: 0.002\nnum_lasers: 2\nlasers:\n\
                    - {laser_id: 1, rot_correction: 0.1, vert_correction: -0.2}\n\
                    - {laser_id: 0, rot_correction: 0, vert_correction: 0.3, dist_correction: 1.2,\n\
                    \x20  dist_correction_x: 1.3, dist_correction_y: 1.4, vert_offset_correction: 0.2,\n\
                    \x20  horiz_offset_correction: -0.026, min_intensity: 40, max_intensity: 250}\n";
        let calibration = Calibration::from_bytes(text.as_bytes()).unwrap();
        assert_eq!(calibration.lasers.len(), 2);
        assert_eq!(calibration.lasers[0].near_distance_m, Some([1.3, 1.4]));
        assert_eq!(calibration.lasers[0].intensity_limits, [40, 250]);
        assert_eq!(calibration.lasers[1].rotation_rad, 0.1);
        let error = calibration.model(Product::Vlp16).unwrap_err().to_string();
        assert!(error.contains("2 given") && error.contains("16"), "{error}");
    }

    #[test]
    fn errors_name_what_is_wrong() {
        let refused = |text: &str, words: &[&str]| {
            let error = Calibration::from_yaml(text).unwrap_err().to_string();
            assert!(words.iter().all(|word| error.contains(word)), "{error}");
        };
        refused("lasers:\n- {laser_id: 0}\n", &["vert_correction"]);
        refused("lasers:\n- {laser_id: 0, vert_correction: x}\n", &["2"]);
        refused("lasers: []\n", &["0 lasers"]);
        refused("num_lasers: 3\nlasers:\n- {laser_id: 0, vert_correction: 0}\n", &["num_lasers", "3"]);
        refused("lasers:\n- {laser_id: 7, vert_correction: 0}\n", &["laser 7"]);
        refused("lasers:\n- {laser_id: 0, vert_correction: -15}\n", &["laser 0", "degrees"]);
        refused("lasers:\n- {laser_id: 0, vert_correction: .nan}\n", &["finite"]);
        refused("\"", &["calibration"]);
    }
}
