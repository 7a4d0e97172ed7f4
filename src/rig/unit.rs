//! One physical sensor as a user names it: a model of the catalogue, or the calibration of a unit (Ouster metadata,
//! Velodyne `db.xml` or YAML).

use std::path::{Path, PathBuf};
use std::str::FromStr;

use glam::DAffine3;
use sensors::ouster::{Metadata, MetadataError};
use sensors::velodyne::{Calibration, CalibrationError, Product};
use sensors::{SensorModel, catalogue};

use super::{MountFile, MountedSensor, Rig};
use crate::base::files;

/// Beams of two products that differ by less than this count as the same, rad (root mean square).
const SAME_BEAMS_RAD: f64 = 1e-6;

/// A sensor and its default rotation.
#[derive(Clone, Debug, PartialEq)]
pub struct Unit {
    /// Beams, limits and housing.
    pub model: SensorModel,
    /// Columns per revolution.
    pub columns: u32,
    /// Revolutions per second.
    pub rate_hz: f64,
    /// Where its IMU sits, of a calibrated Ouster.
    pub sensor_from_imu: Option<DAffine3>,
    /// What was concluded and not stated, for the user.
    pub notice: Option<String>,
}

/// The file with a sensor's calibration, to be stored with what was measured with it.
#[derive(Clone, Debug, PartialEq)]
pub struct CalibrationFile {
    /// Name of the sensor.
    pub sensor: String,
    /// Of the file's name: says which kind it is.
    pub ending: String,
    /// Its bytes.
    pub content: Vec<u8>,
}

/// Which sensor is meant: `[NAME=]MODEL`, `[NAME=]FILE` or `[NAME=]MODEL:FILE`.
#[derive(Clone, Debug, PartialEq)]
pub struct UnitChoice {
    /// The sensor of the rig that is meant; every one where none is named.
    pub sensor: Option<String>,
    /// Catalogue name, where given.
    pub model: Option<String>,
    /// Calibration, where given.
    pub file: Option<PathBuf>,
}

impl FromStr for UnitChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (sensor, what) = match text.split_once('=') {
            Some((name, what)) if !name.contains(['/', '.']) => (Some(name.to_owned()), what),
            _ => (None, text),
        };
        let known = |name: &str| catalogue::nominal(name).is_ok();
        let named = |model: &str| Some(model.to_owned());
        if known(what) {
            return Ok(Self { sensor, model: named(what), file: None });
        }
        if let Some((model, file)) = what.split_once(':').filter(|(model, _)| known(model)) {
            return Ok(Self { sensor, model: named(model), file: Some(file.into()) });
        }
        if FileKind::of(Path::new(what)).is_some() || what.contains('/') {
            return Ok(Self { sensor, model: None, file: Some(what.into()) });
        }
        Err(format!(
            "no sensor model is called {what:?}; known are {}; or give a calibration: Ouster metadata (.json), Velodyne \
             .xml or .yaml, MODEL:FILE; or a sensor of your own: a model file (.toml), a table of beams or a pattern (.csv)",
            catalogue::names().join(", ")
        ))
    }
}

#[derive(Clone, Copy, PartialEq)]
enum FileKind {
    Ouster,
    Velodyne,
    /// A model file as those of the catalogue.
    Model,
    /// A table of beams, or a pattern over time.
    Table,
}

impl FileKind {
    fn of(path: &Path) -> Option<Self> {
        match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "json" => Some(Self::Ouster),
            "xml" | "yaml" | "yml" => Some(Self::Velodyne),
            "toml" => Some(Self::Model),
            "csv" => Some(Self::Table),
            _ => None,
        }
    }
}

impl Unit {
    /// The nominal sensor of a catalogue name.
    pub fn nominal(name: &str) -> Result<Self, UnitError> {
        Ok(Self::of_entry(catalogue::entry(name)?))
    }

    pub(super) fn of_entry(entry: catalogue::Entry) -> Self {
        let catalogue::Entry { model, columns, rate_hz, unverified, .. } = entry;
        let notice = unverified.map(|what| format!("{}: unverified {what}", model.name));
        Self { model, columns, rate_hz, sensor_from_imu: None, notice }
    }

    /// The calibrated unit of a file; its ending says which kind. `stated` is the catalogue name of its model, where
    /// it is stated: limits and housing of Ouster metadata without a product line, and the product of a Velodyne.
    ///
    /// # Errors
    /// A file that cannot be read or is malformed, a stated model with other channels, or no model to take limits from.
    pub(crate) fn calibrated(path: &Path, stated: Option<&str>) -> Result<Self, UnitError> {
        let unreadable = |source| UnitError::Unreadable { path: path.to_owned(), source };
        match FileKind::of(path) {
            Some(FileKind::Ouster) => {
                let text = files::read_text(path).map_err(unreadable)?;
                Self::ouster(path, &text, stated)
            }
            Some(FileKind::Velodyne) => {
                let bytes = files::read(path).map_err(unreadable)?;
                Self::velodyne(path, &bytes, stated)
            }
            Some(kind) => {
                let text = files::read_text(path).map_err(unreadable)?;
                Self::of_own_file(path, &text, kind == FileKind::Model, stated)
            }
            None => Err(UnitError::UnknownKind { path: path.to_owned() }),
        }
    }

    fn ouster(path: &Path, text: &str, stated: Option<&str>) -> Result<Self, UnitError> {
        let metadata = Metadata::parse(text, &path.display().to_string())?;
        let mut model = metadata.model;
        let mut notice = None;
        if model.housing_radius_m == 0.0 {
            let stated = stated.ok_or_else(|| UnitError::NoProductLine { path: path.to_owned() })?;
            let nominal = catalogue::nominal(stated)?;
            model.name.clone_from(&nominal.name);
            model.min_range_m = nominal.min_range_m;
            model.max_range_m = nominal.max_range_m;
            model.divergence_rad = nominal.divergence_rad;
            model.housing_radius_m = nominal.housing_radius_m;
            model.housing_height_m = nominal.housing_height_m;
            notice = Some(format!("{}: names no product; limits and housing are {stated}'s", path.display()));
        }
        if let Some(stated) = stated {
            let channels = catalogue::nominal(stated)?.channels();
            if channels != model.channels() {
                let (path, found) = (path.to_owned(), model.channels());
                return Err(UnitError::Channels { path, found, stated: stated.into(), channels });
            }
        }
        let columns = u32::try_from(metadata.columns_per_frame).unwrap_or(u32::MAX);
        let sensor_from_imu = Some(metadata.sensor_from_imu);
        Ok(Self { model, columns, rate_hz: metadata.frame_rate_hz, sensor_from_imu, notice })
    }

    fn velodyne(path: &Path, bytes: &[u8], stated: Option<&str>) -> Result<Self, UnitError> {
        let wrong = |source| UnitError::Calibration { path: path.to_owned(), source };
        let calibration = Calibration::from_bytes(bytes).map_err(wrong)?;
        let (product, notice) = match stated {
            Some(stated) => {
                let product = Product::from_name(stated);
                let not = || UnitError::NotVelodyne { path: path.to_owned(), stated: stated.into() };
                (product.ok_or_else(not)?, None)
            }
            None => nearest(path, &calibration)?,
        };
        let model = calibration.model(product).map_err(wrong)?;
        Ok(Self { model, columns: 1800, rate_hz: 10.0, sensor_from_imu: None, notice })
    }
}

/// The product with nominal elevations nearest to those of a calibration, and a notice about the conclusion.
fn nearest(path: &Path, calibration: &Calibration) -> Result<(Product, Option<String>), UnitError> {
    let lasers = calibration.lasers.len();
    let far_rad = |product: Product| {
        let nominal = catalogue::nominal(product.name()).ok()?;
        let pairs = nominal.beams().iter().zip(&calibration.lasers);
        let square = |(beam, laser): (&sensors::Beam, &sensors::velodyne::LaserCalibration)| {
            (beam.elevation_rad - laser.vertical_rad).powi(2)
        };
        (nominal.channels() == lasers).then(|| (pairs.map(square).sum::<f64>() / lasers as f64).sqrt())
    };
    let mut ranked: Vec<(f64, Product)> =
        Product::ALL.into_iter().filter_map(|product| Some((far_rad(product)?, product))).collect();
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
    let Some((far, product)) = ranked.first().copied() else {
        return Err(UnitError::Lasers { path: path.to_owned(), lasers });
    };
    let alike = ranked.iter().skip(1).take_while(|(other, _)| other - far < SAME_BEAMS_RAD);
    let alike: Vec<_> = alike.map(|(_, product)| product.name()).collect();
    let others = if alike.is_empty() { String::new() } else { format!(" (like {})", alike.join(", ")) };
    let (path, name) = (path.display(), product.name());
    let notice = format!(
        "{path}: identified as a {name} by its elevations{others}; {name}:{path} states it, or another"
    );
    Ok((product, Some(notice)))
}

impl MountFile {
    /// The units of the rig, in order. A sensor is what `choices` say (the last one that names it, or that names none),
    /// else its calibration in the file, else the nominal model.
    ///
    /// # Errors
    /// As [`Unit::calibrated`], and a choice for a sensor that the rig has not.
    pub(crate) fn units(&self, choices: &[UnitChoice]) -> Result<Vec<Unit>, UnitError> {
        let has = |name: &str| self.sensors.iter().any(|sensor| sensor.name == name);
        if let Some(name) = choices.iter().filter_map(|c| c.sensor.as_deref()).find(|name| !has(name)) {
            let known: Vec<_> = self.sensors.iter().map(|sensor| sensor.name.as_str()).collect();
            return Err(UnitError::NoSuchSensor { name: name.into(), known: known.join(", ") });
        }
        let unit = |entry: &super::SensorEntry| {
            let about = |choice: &&UnitChoice| choice.sensor.as_ref() == Some(&entry.name);
            let choice = choices.iter().rfind(about).or(choices.iter().rfind(|c| c.sensor.is_none()));
            match choice {
                Some(UnitChoice { model, file: Some(file), .. }) => {
                    Unit::calibrated(file, Some(model.as_ref().unwrap_or(&entry.model)))
                }
                Some(UnitChoice { model: Some(model), .. }) => Unit::nominal(model),
                _ => match self.calibrations.as_ref().and_then(|files| files.get(&entry.name)) {
                    Some(file) => Unit::calibrated(file, Some(&entry.model)),
                    None => Unit::nominal(&entry.model),
                },
            }
        };
        self.sensors.iter().map(unit).collect()
    }

    /// The rig that the file describes, each sensor as calibrated there.
    ///
    /// # Errors
    /// As `Unit::calibrated`.
    pub fn rig(&self) -> Result<Rig, UnitError> {
        Ok(self.rig_of(&self.units(&[])?))
    }

    /// The calibrations that the file names, read, in order of the sensors' names.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn calibration_files(&self) -> Result<Vec<CalibrationFile>, UnitError> {
        let read = |(sensor, path): (&String, &PathBuf)| {
            let content =
                files::read(path).map_err(|source| UnitError::Unreadable { path: path.clone(), source })?;
            Ok(CalibrationFile { sensor: sensor.clone(), ending: files::ending(path), content })
        };
        self.calibrations.iter().flatten().map(read).collect()
    }

    /// The rig with these units on its mounts.
    pub(crate) fn rig_of(&self, units: &[Unit]) -> Rig {
        let mounted = self.sensors.iter().zip(units).map(|(entry, unit)| MountedSensor {
            name: entry.name.clone(),
            model: unit.model.clone(),
            mount: entry.mount(),
        });
        Rig { sensors: mounted.collect() }
    }
}

/// Why a sensor is not known.
#[derive(Debug, thiserror::Error)]
pub enum UnitError {
    /// The system does not give the file.
    #[error("{}: cannot be read", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The name says no kind of calibration.
    #[error(
        "{}: no calibration by its name; known are Ouster metadata (.json), Velodyne .xml, .yaml, .yml, model files (.toml) and \
         tables of beams (.csv)",
        path.display()
    )]
    UnknownKind {
        /// The file.
        path: PathBuf,
    },
    /// No Ouster metadata.
    #[error(transparent)]
    Metadata(#[from] MetadataError),
    /// Metadata that does not say which product it is about.
    #[error("{}: names no product line: give its model as MODEL:FILE (os1-64:{})", path.display(), path.display())]
    NoProductLine {
        /// The file.
        path: PathBuf,
    },
    /// As typed.
    #[error("{0}")]
    NotTyped(String),
    /// No model file and no table.
    #[error("{}: {source}", path.display())]
    Own {
        /// The file.
        path: PathBuf,
        /// What is wrong in it.
        source: catalogue::ModelError,
    },
    /// No Velodyne calibration.
    #[error("{}: {source}", path.display())]
    Calibration {
        /// The file.
        path: PathBuf,
        /// What is wrong in it.
        source: CalibrationError,
    },
    /// A calibration of a Velodyne for another maker's model.
    #[error("{}: a Velodyne calibration, but the sensor is specified as a {stated}", path.display())]
    NotVelodyne {
        /// The file.
        path: PathBuf,
        /// The catalogue name.
        stated: String,
    },
    /// Another number of channels than the stated model has.
    #[error("{}: {found} channels, but a {stated} has {channels}", path.display())]
    Channels {
        /// The file.
        path: PathBuf,
        /// Channels in it.
        found: usize,
        /// The catalogue name.
        stated: String,
        /// Channels of that model.
        channels: usize,
    },
    /// No Velodyne has so many lasers.
    #[error("{}: {lasers} lasers, expected 16, 32, 64 or 128", path.display())]
    Lasers {
        /// The file.
        path: PathBuf,
        /// Lasers in it.
        lasers: usize,
    },
    /// A choice for no sensor.
    #[error("no sensor of the rig is called {name:?}; it has {known}")]
    NoSuchSensor {
        /// As asked for.
        name: String,
        /// All that exist.
        known: String,
    },
    /// No nominal model.
    #[error(transparent)]
    Model(#[from] catalogue::ModelError),
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::SensorEntry;
    use sensors::ouster::{Profile, Synthetic};

    fn entry(name: &str, model: &str) -> SensorEntry {
        let (x_m, y_m, z_m, pitch_deg, roll_deg) = (0.1, 0.0, 0.0, 20.0, 0.0);
        SensorEntry {
            name: name.into(),
            model: model.into(),
            x_m,
            y_m,
            z_m,
            pitch_deg,
            roll_deg,
            ..SensorEntry::default()
        }
    }

    /// A calibration in the ROS driver's YAML with the beams of a nominal model, each a little higher.
    fn yaml(name: &str, more_rad: f64) -> String {
        let model = catalogue::nominal(name).unwrap();
        let mut text = "distance_resolution: 0.002\nlasers:\n".to_owned();
        for (id, beam) in model.beams().iter().enumerate() {
            let vertical = beam.elevation_rad + more_rad;
            text += &format!("- {{laser_id: {id}, vert_correction: {vertical}, rot_correction: 0}}\n");
        }
        text
    }

    #[test]
    fn choices_are_read_as_typed() {
        let choice = |text: &str| text.parse::<UnitChoice>();
        let whole = choice("left=vlp-16:unit.yaml").unwrap();
        assert_eq!(
            (whole.sensor.as_deref(), whole.model.as_deref(), whole.file.as_deref()),
            (Some("left"), Some("vlp-16"), Some(Path::new("unit.yaml")))
        );
        assert_eq!(choice("OS1-64").unwrap().model.as_deref(), Some("OS1-64"));
        assert_eq!(choice("../a=b/meta.json").unwrap().sensor, None);
        let error = choice("os9-64").unwrap_err();
        assert!(
            error.contains("os9-64") && error.contains("vlp-16") && error.contains("MODEL:FILE"),
            "{error}"
        );
    }

    #[test]
    fn a_calibration_brings_its_beams_and_the_model_its_limits() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("unit.yaml");
        std::fs::write(&path, yaml("vlp-32c", 1e-3)).unwrap();
        let nominal = catalogue::nominal("vlp-32c").unwrap();
        let found = Unit::calibrated(&path, None).unwrap();
        assert!(found.notice.unwrap().contains("vlp-32c"), "of all with 32 lasers the nearest");
        assert_eq!(found.model.housing_radius_m, nominal.housing_radius_m);
        let raised = found.model.beams()[3].elevation_rad - nominal.beams()[3].elevation_rad;
        assert!((raised - 1e-3).abs() < 1e-12);
        assert!(Unit::calibrated(&path, Some("vlp-16")).unwrap_err().to_string().contains("32"));
        assert!(Unit::calibrated(&path, Some("os1-32")).unwrap_err().to_string().contains("os1-32"));
    }

    #[test]
    fn metadata_bring_beams_columns_and_rate() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("left.json");
        let wanted = Synthetic::new("os0-32", 7, Profile::Rng19Rfl8Sig16Nir16).columns(2048, 16);
        let text = sensors::ouster::Metadata::synthetic(&wanted).unwrap().to_json();
        std::fs::write(&path, &text).unwrap();
        let found = Unit::calibrated(&path, None).unwrap();
        assert_eq!((found.columns, found.model.channels(), found.rate_hz), (2048, 32, 10.0));
        assert_eq!(found.model.housing_radius_m, 0.0435);
        assert!(Unit::calibrated(&path, Some("os0-128")).unwrap_err().to_string().contains("32 channels"));
        // without a product its beams tell, and those of no product do not
        let text = text.replace("OS-0-32", "");
        std::fs::write(&path, &text).unwrap();
        assert_eq!(Unit::calibrated(&path, None).unwrap().model.name, "os0-32");
        let mut of_none: serde_json::Value = serde_json::from_str(&text).unwrap();
        of_none["beam_intrinsics"]["beam_altitude_angles"][0] = 40.0.into();
        std::fs::write(&path, of_none.to_string()).unwrap();
        assert!(Unit::calibrated(&path, None).unwrap_err().to_string().contains("MODEL:FILE"));
        let stated = Unit::calibrated(&path, Some("os0-32")).unwrap();
        assert!(stated.notice.unwrap().contains("os0-32") && stated.model.max_range_m == 75.0);
    }

    #[test]
    fn the_last_statement_about_a_sensor_counts() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("front.yaml"), yaml("vlp-16", 2e-3)).unwrap();
        let mut file = MountFile::new(vec![entry("left", "os1-64"), entry("front", "vlp-16")]);
        file.calibrations = Some([("front".to_owned(), folder.path().join("front.yaml"))].into());
        let units = file.units(&[]).unwrap();
        assert_eq!((units[0].columns, units[1].columns), (1024, 1800));
        assert_ne!(units[1].model, catalogue::nominal("vlp-16").unwrap());
        let choice = |text: &str| text.parse::<UnitChoice>().unwrap();
        let units = file.units(&[choice("front=vlp-16"), choice("os0-32")]).unwrap();
        assert_eq!(units[1].model, catalogue::nominal("vlp-16").unwrap());
        assert_eq!(file.rig_of(&units).sensors[0].model.name, "os0-32");
        let error = file.units(&[choice("rear=vlp-16")]).unwrap_err().to_string();
        assert!(error.contains("rear") && error.contains("left, front"), "{error}");
    }
}
