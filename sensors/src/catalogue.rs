//! Sensor models by name: data files in `sensors/models`, compiled in. A new model is a new file there.

use glam::{DAffine3, DQuat, DVec3};
use include_dir::{Dir, include_dir};

use crate::model::{Beam, SensorModel};

static MODELS: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/models");

/// Names of all models, sorted.
pub fn names() -> Vec<&'static str> {
    let mut names: Vec<_> = MODELS.files().filter_map(|file| file.path().file_stem()?.to_str()).collect();
    names.sort_unstable();
    names
}

/// A nominal model by name (`os1-64`, `vlp-16`); letters of either case.
pub fn nominal(name: &str) -> Result<SensorModel, ModelError> {
    let wanted = name.to_ascii_lowercase();
    let file = MODELS
        .get_file(format!("{wanted}.toml"))
        .ok_or_else(|| ModelError::Unknown { name: name.to_owned(), known: names().join(", ") })?;
    from_toml(&wanted, file.contents_utf8().unwrap_or_default())
}

/// A model from the text of a model file.
pub fn from_toml(name: &str, text: &str) -> Result<SensorModel, ModelError> {
    let file: ModelFile = toml::from_str(text)
        .map_err(|error| ModelError::Malformed { name: name.to_owned(), reason: error.to_string() })?;
    file.into_model(name)
}

/// What can be wrong with a model's name or file.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// No file of that name.
    #[error("no sensor model is called {name:?}; known are {known}")]
    Unknown {
        /// As asked for.
        name: String,
        /// All that exist.
        known: String,
    },
    /// The file does not say what a model needs.
    #[error("sensor model {name}: {reason}")]
    Malformed {
        /// Model name.
        name: String,
        /// What is wrong, with the line where there is one.
        reason: String,
    },
}

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct ModelFile {
    #[serde(rename = "vendor")]
    _vendor: String,
    min_range_m: f64,
    max_range_m: f64,
    divergence_deg: f64,
    housing_radius_m: f64,
    housing_height_m: f64,
    origin_radial_m: f64,
    range_offset_m: f64,
    sensor_from_lidar_yaw_deg: f64,
    sensor_from_lidar_z_m: f64,
    beams: BeamTable,
}

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct BeamTable {
    elevation_deg: Vec<f64>,
    azimuth_offset_deg: Vec<f64>,
    origin_z_m: Vec<f64>,
    fire_offset_us: Vec<f64>,
}

impl ModelFile {
    fn into_model(self, name: &str) -> Result<SensorModel, ModelError> {
        let table = &self.beams;
        let channels = table.elevation_deg.len();
        for (column, length) in [
            ("azimuth_offset_deg", table.azimuth_offset_deg.len()),
            ("origin_z_m", table.origin_z_m.len()),
            ("fire_offset_us", table.fire_offset_us.len()),
        ] {
            if length != channels {
                let reason =
                    format!("beams.{column} has {length} numbers, beams.elevation_deg has {channels}");
                return Err(ModelError::Malformed { name: name.to_owned(), reason });
            }
        }
        let beams = (0..channels)
            .map(|channel| Beam {
                elevation_rad: table.elevation_deg[channel].to_radians(),
                azimuth_offset_rad: table.azimuth_offset_deg[channel].to_radians(),
                origin_radial_m: self.origin_radial_m,
                origin_z_m: table.origin_z_m[channel],
                range_offset_m: self.range_offset_m,
                fire_offset_ns: table.fire_offset_us[channel] * 1e3,
            })
            .collect();
        let sensor_from_lidar = DAffine3::from_rotation_translation(
            DQuat::from_rotation_z(self.sensor_from_lidar_yaw_deg.to_radians()),
            DVec3::new(0.0, 0.0, self.sensor_from_lidar_z_m),
        );
        let mut model = SensorModel::new(name, beams, sensor_from_lidar);
        model.min_range_m = self.min_range_m;
        model.max_range_m = self.max_range_m;
        model.divergence_rad = self.divergence_deg.to_radians();
        model.housing_radius_m = self.housing_radius_m;
        model.housing_height_m = self.housing_height_m;
        Ok(model)
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn every_model_file_loads() {
        let names = super::names();
        assert!(names.len() >= 18, "{names:?}");
        for name in names {
            let model = super::nominal(name).unwrap();
            assert!(model.channels() >= 16 && model.max_range_m > model.min_range_m, "{name}");
        }
    }

    #[test]
    fn an_unknown_name_lists_the_known_ones() {
        let error = super::nominal("os9-64").unwrap_err().to_string();
        assert!(error.contains("os9-64") && error.contains("vlp-16"), "{error}");
    }
}
