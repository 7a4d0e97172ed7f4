//! Sensor models by name: data files in `sensors/models`, compiled in. A new model is a new file there.

use std::sync::OnceLock;

use glam::{DAffine3, DQuat, DVec3};
use include_dir::{Dir, include_dir};

use crate::model::{Beam, BeamCorrection, SensorModel};
use crate::pattern::{self, Pattern};

static MODELS: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/models");

/// Names of all models, sorted.
pub fn names() -> Vec<&'static str> {
    let mut names: Vec<_> = MODELS.files().filter_map(|file| file.path().file_stem()?.to_str()).collect();
    names.sort_unstable();
    names
}

/// Names of the models that can be decoded, sorted.
pub fn decoded_names() -> Vec<&'static str> {
    headings().iter().filter(|heading| is_decoded(&heading.vendor)).map(|heading| heading.name).collect()
}

/// Names of all models, those with a star of which something is unverified.
pub fn marked_names() -> Vec<String> {
    let mark = |heading: &Heading| if heading.unverified.is_some() { "*" } else { "" };
    headings().iter().map(|heading| format!("{}{}", heading.name, mark(heading))).collect()
}

/// What a list of models needs to know of each: every command makes one, and a pattern takes milliseconds to make.
#[derive(serde::Deserialize)]
struct Heading {
    #[serde(skip)]
    name: &'static str,
    vendor: String,
    unverified: Option<String>,
}

fn headings() -> &'static [Heading] {
    static HEADINGS: OnceLock<Vec<Heading>> = OnceLock::new();
    HEADINGS.get_or_init(|| {
        let heading = |name| {
            let text = MODELS.get_file(format!("{name}.toml"))?.contents_utf8()?;
            Some(Heading { name, ..toml::from_str(text).ok()? })
        };
        names().into_iter().filter_map(heading).collect()
    })
}

/// What the catalogue knows of a sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// Beams, limits, housing.
    pub model: SensorModel,
    /// Columns per revolution.
    pub columns: u32,
    /// Revolutions per second: the usual rate.
    pub rate_hz: f64,
    /// Parts of the data that no source was read for, in words.
    pub unverified: Option<String>,
    /// Whether its packets are decoded here.
    pub is_decoded: bool,
}

/// A nominal model by name (`os1-64`, `vlp-16`); letters of either case.
pub fn nominal(name: &str) -> Result<SensorModel, ModelError> {
    Ok(entry(name)?.model)
}

/// The nominal model of a name that can be decoded.
pub fn decoded(name: &str) -> Result<SensorModel, ModelError> {
    let entry = entry(name)?;
    let not_decoded = || ModelError::NotDecoded { name: name.to_owned(), known: decoded_names().join(", ") };
    entry.is_decoded.then_some(entry.model).ok_or_else(not_decoded)
}

/// The catalogue's entry of a name; letters of either case.
pub fn entry(name: &str) -> Result<Entry, ModelError> {
    let wanted = name.to_ascii_lowercase();
    let file = MODELS
        .get_file(format!("{wanted}.toml"))
        .ok_or_else(|| ModelError::Unknown { name: name.to_owned(), known: names().join(", ") })?;
    from_toml(&wanted, file.contents_utf8().unwrap_or_default())
}

/// An entry from the text of a model file.
pub fn from_toml(name: &str, text: &str) -> Result<Entry, ModelError> {
    let malformed = |reason: String| ModelError::Malformed { name: name.to_owned(), reason };
    let file: ModelFile = toml::from_str(text).map_err(|error| malformed(error.to_string()))?;
    file.into_entry(name).map_err(malformed)
}

/// An entry like `base` with the beams of a table: a line for each channel, under a heading that names the columns
/// `elevation_deg` and, where there are any, `rot_correction_deg` (subtracted from the clockwise azimuth),
/// `vertical_offset_m` and `fire_us`. A table of time, azimuth and zenith angle is a pattern, `lines` of which fire together; its
/// period is its number of points over the base's rate of points.
pub fn from_csv(name: &str, text: &str, base: &Entry) -> Result<Entry, ModelError> {
    let malformed = |reason: String| ModelError::Malformed { name: name.to_owned(), reason };
    let heading = text.lines().next().unwrap_or_default().to_ascii_lowercase();
    let columns: Vec<&str> = heading.split(',').map(str::trim).collect();
    if columns.iter().any(|column| column.starts_with("elevation")) {
        let table = BeamTable::from_csv(&columns, text).map_err(malformed)?;
        let radial_m = base.model.beams().first().map_or(0.0, |beam| beam.origin_radial_m);
        let offset_m = base.model.beams().first().map_or(0.0, |beam| beam.range_offset_m);
        let mut model = base.model.clone().with_beams(table.beams(radial_m, offset_m)).without_pattern();
        name.clone_into(&mut model.name);
        return Ok(Entry { model, ..base.clone() });
    }
    let directions = pattern::directions_of(text).map_err(malformed)?;
    let lines = base.model.pattern().map_or(1, Pattern::lines);
    let points_per_s = base.rate_hz * f64::from(base.columns) * lines as f64;
    let period_s = directions.len() as f64 / points_per_s;
    let pattern = Pattern::new(directions, lines).ok_or_else(|| malformed("no beam and no point".into()))?;
    let columns = pattern.columns() as u32;
    let mut model = base.model.clone().with_pattern(pattern);
    name.clone_into(&mut model.name);
    Ok(Entry { model, columns, rate_hz: 1.0 / period_s, ..base.clone() })
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
    /// A sensor that is simulated only.
    #[error("packets of {name} are not decoded: it can be simulated only; decoded are {known}")]
    NotDecoded {
        /// As asked for.
        name: String,
        /// All that are decoded.
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
    vendor: String,
    columns: Option<u32>,
    #[serde(default)]
    rates_hz: Vec<f64>,
    unverified: Option<String>,
    min_range_m: f64,
    max_range_m: f64,
    #[serde(default)]
    divergence_deg: f64,
    housing_radius_m: f64,
    housing_height_m: f64,
    #[serde(default)]
    origin_radial_m: f64,
    #[serde(default)]
    origin_left_m: f64,
    #[serde(default)]
    range_offset_m: f64,
    #[serde(default)]
    sensor_from_lidar_yaw_deg: f64,
    #[serde(default)]
    sensor_from_lidar_z_m: f64,
    beams: Option<BeamTable>,
    pattern: Option<pattern::Recipe>,
}

/// Columns that are all zero may be left out.
#[derive(Default, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct BeamTable {
    elevation_deg: Vec<f64>,
    #[serde(default)]
    azimuth_offset_deg: Vec<f64>,
    #[serde(default)]
    origin_z_m: Vec<f64>,
    #[serde(default)]
    fire_offset_us: Vec<f64>,
}

/// Makers of the sensors that can be decoded.
const DECODED: [&str; 2] = ["ouster", "velodyne"];
fn is_decoded(vendor: &str) -> bool {
    DECODED.contains(&vendor)
}

/// Columns per revolution where a sensor's file gives none.
const OUSTER_COLUMNS: u32 = 1024;
const OTHER_COLUMNS: u32 = 1800;
/// Revolutions per second where the sensor has that rate.
const USUAL_RATE_HZ: f64 = 10.0;

impl ModelFile {
    fn into_entry(self, name: &str) -> Result<Entry, String> {
        let limits = [self.min_range_m, self.max_range_m, self.housing_radius_m, self.housing_height_m];
        if limits.iter().any(|limit| !(limit.is_finite() && *limit >= 0.0))
            || self.max_range_m <= self.min_range_m
        {
            return Err(format!(
                "ranges and housing {limits:?} m, expected 0 or more, max_range_m above min_range_m"
            ));
        }
        let sensor_from_lidar = DAffine3::from_rotation_translation(
            DQuat::from_rotation_z(self.sensor_from_lidar_yaw_deg.to_radians()),
            DVec3::new(0.0, 0.0, self.sensor_from_lidar_z_m),
        );
        let is_usual = self.rates_hz.is_empty() || self.rates_hz.contains(&USUAL_RATE_HZ);
        let mut rate_hz = if is_usual { USUAL_RATE_HZ } else { self.rates_hz[0] };
        let of_maker = if self.vendor == "ouster" { OUSTER_COLUMNS } else { OTHER_COLUMNS };
        let mut columns = self.columns.unwrap_or(of_maker);
        let mut model = match (&self.beams, &self.pattern) {
            (Some(table), None) => {
                table.check()?;
                let beams = table.beams(self.origin_radial_m, self.range_offset_m);
                let corrections = match self.origin_left_m {
                    0.0 => Vec::new(),
                    origin_left_m => {
                        let intensity_limits = [0, u8::MAX];
                        vec![
                            BeamCorrection { origin_left_m, intensity_limits, ..Default::default() };
                            beams.len()
                        ]
                    }
                };
                SensorModel::new(name, beams, sensor_from_lidar).with_corrections(corrections)
            }
            (None, Some(recipe)) => {
                let (pattern, period_s) = recipe.pattern()?;
                (columns, rate_hz) = (pattern.columns() as u32, 1.0 / period_s);
                SensorModel::new(name, Vec::new(), sensor_from_lidar).with_pattern(pattern)
            }
            _ => return Err("neither [beams] nor [pattern], or both: expected one of them".into()),
        };
        if columns == 0 || !(rate_hz.is_finite() && rate_hz > 0.0) {
            return Err(format!(
                "{columns} columns at {rate_hz} Hz, expected one column or more at a rate above 0"
            ));
        }
        model.min_range_m = self.min_range_m;
        model.max_range_m = self.max_range_m;
        model.divergence_rad = self.divergence_deg.to_radians();
        model.housing_radius_m = self.housing_radius_m;
        model.housing_height_m = self.housing_height_m;
        let is_decoded = is_decoded(&self.vendor);
        Ok(Entry { model, columns, rate_hz, unverified: self.unverified, is_decoded })
    }
}

impl BeamTable {
    fn check(&self) -> Result<(), String> {
        let channels = self.elevation_deg.len();
        if channels == 0 {
            return Err("beams.elevation_deg is empty, expected one number for each channel".into());
        }
        for (column, values) in [
            ("azimuth_offset_deg", &self.azimuth_offset_deg),
            ("origin_z_m", &self.origin_z_m),
            ("fire_offset_us", &self.fire_offset_us),
        ] {
            let length = values.len();
            if length != channels && length != 0 {
                return Err(format!(
                    "beams.{column} has {length} numbers, beams.elevation_deg has {channels}"
                ));
            }
        }
        let steep = self.elevation_deg.iter().position(|elevation| !(-90.0..=90.0).contains(elevation));
        steep.map_or(Ok(()), |at| {
            Err(format!("beams.elevation_deg[{at}] is {}, expected -90 to 90", self.elevation_deg[at]))
        })
    }

    fn beams(&self, origin_radial_m: f64, range_offset_m: f64) -> Vec<Beam> {
        let of = |column: &[f64], channel: usize| column.get(channel).copied().unwrap_or(0.0);
        let beam = |channel: usize| Beam {
            elevation_rad: self.elevation_deg[channel].to_radians(),
            azimuth_offset_rad: of(&self.azimuth_offset_deg, channel).to_radians(),
            origin_radial_m,
            origin_z_m: of(&self.origin_z_m, channel),
            range_offset_m,
            fire_offset_ns: of(&self.fire_offset_us, channel) * 1e3,
        };
        (0..self.elevation_deg.len()).map(beam).collect()
    }

    fn from_csv(columns: &[&str], text: &str) -> Result<Self, String> {
        let mut table = Self::default();
        for (number, line) in text.lines().enumerate().skip(1).filter(|(_, line)| !line.trim().is_empty()) {
            let parts: Vec<&str> = line.split(',').map(str::trim).collect();
            if parts.len() != columns.len() {
                let (found, expected) = (parts.len(), columns.len());
                return Err(format!(
                    "line {}: {found} columns, expected {expected} as in line 1",
                    number + 1
                ));
            }
            for (column, part) in columns.iter().zip(parts) {
                let (list, sign) = match *column {
                    column if column.starts_with("elevation") => (&mut table.elevation_deg, 1.0),
                    column if column.starts_with("rot_correction") => (&mut table.azimuth_offset_deg, -1.0),
                    column if column.starts_with("vertical_offset") => (&mut table.origin_z_m, 1.0),
                    "fire_us" => (&mut table.fire_offset_us, 1.0),
                    _ => continue,
                };
                let value: Option<f64> = part.parse().ok().filter(|value: &f64| value.is_finite());
                let wrong = || format!("line {}: {column} is {part:?}, expected a number", number + 1);
                list.push(sign * value.ok_or_else(wrong)?);
            }
        }
        table.check()?;
        Ok(table)
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn every_model_file_loads() {
        let names = super::names();
        assert!(names.len() >= 46, "{names:?}");
        for name in names {
            let super::Entry { model, columns, rate_hz, .. } = super::entry(name).unwrap();
            assert!(model.channels() >= 16 || model.pattern().is_some(), "{name}");
            assert!(model.max_range_m > model.min_range_m && model.housing_radius_m >= 0.03, "{name}");
            assert!(columns >= 600 && (1.0..=10.0).contains(&rate_hz), "{name}");
        }
        let entries: Vec<_> =
            super::names().into_iter().map(|name| (name, super::entry(name).unwrap())).collect();
        let decoded: Vec<_> =
            entries.iter().filter(|(_, entry)| entry.is_decoded).map(|(name, _)| *name).collect();
        assert_eq!(super::decoded_names(), decoded);
        let marks = |entry: &super::Entry| if entry.unverified.is_some() { "*" } else { "" };
        let marked: Vec<_> = entries.iter().map(|(name, entry)| format!("{name}{}", marks(entry))).collect();
        assert_eq!(super::marked_names(), marked);
        assert!(decoded.contains(&"vlp-16") && !decoded.contains(&"hesai-xt32"), "{decoded:?}");
        assert!(super::marked_names().iter().any(|name| name == "osdome-128*"));
    }

    #[test]
    fn a_table_of_beams_makes_a_sensor() {
        let base = super::entry("hesai-xt16").unwrap();
        let text = "laser_id,elevation_deg,rot_correction_deg(subtract),vertical_offset_m,fire_us\n0,10,-2,0.01,3\n1,-10,2,0,6\n";
        let own = super::from_csv("own", text, &base).unwrap();
        let beams = own.model.beams();
        assert_eq!((beams.len(), own.model.max_range_m, own.columns), (2, 120.0, 2000));
        assert!((beams[0].azimuth_offset_rad.to_degrees() - 2.0).abs() < 1e-12);
        assert_eq!((beams[0].origin_z_m, beams[1].fire_offset_ns), (0.01, 6e3));
        for (text, words) in [
            ("elevation_deg\n91\n", "91"),
            ("elevation_deg,fire_us\n1\n", "line 2"),
            ("elevation_deg\nx\n", "line 2"),
            ("elevation_deg\n", "empty"),
            ("time,azimuth,zenith\n", "no point"),
        ] {
            let error = super::from_csv("own", text, &base).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
    }

    #[test]
    fn a_pattern_file_keeps_the_rate_of_points() {
        let base = super::entry("livox-mid-360").unwrap();
        let text: String = (0..2000).map(|at| format!("{at},{},60\n", at % 360)).collect();
        let own = super::from_csv("own", &text, &base).unwrap();
        assert_eq!((own.model.pattern().unwrap().lines(), own.columns), (4, 500));
        assert!((own.rate_hz - 100.0).abs() < 1e-9, "{}", own.rate_hz);
    }

    #[test]
    fn an_unknown_name_lists_the_known_ones() {
        let error = super::nominal("os9-64").unwrap_err().to_string();
        assert!(error.contains("os9-64") && error.contains("vlp-16"), "{error}");
    }
}
