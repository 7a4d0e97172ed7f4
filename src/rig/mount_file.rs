//! `mount.json`: the sensors of a rig, their models and mounts, as the optimizer writes and everything else reads them.
//!
//! ```json
//! { "format": "outrigger-mount/1",
//!   "frame": "mount: x right, y forward, z up",
//!   "sensors": [ { "name": "right", "model": "os1-64", "x_m": 0.06, "y_m": 0.0, "z_m": 0.0,
//!                  "pitch_deg": 25.0, "roll_deg": 0.0 } ],
//!   "preset": "paper-os1-64", "objective": 30701.3,
//!   "found_with": { "path": "lateral", "voxel_m": 0.5, "azimuths": 180, "sub_poses": 1, "phase": "locked",
//!                   "lambda": [2000.0], "registration_weight": 0.0, "least_conditioning": 0.0, "least_distance_m": 0.0 },
//!   "masters": [ [0.06, 0.0, 0.0, 25.0, 0.0] ] }
//! ```
//!
//! A sensor may have `"yaw_deg"` (how it is turned on its plate, about its own spin axis, after the pitch) and
//! `"angle_tolerance_deg"` (how far each angle may be off when it is built).
//!
//! The last four are optional: which experiment the mount was found in (of a rig of several models the experiments of
//! all, with commas between them), its score there and what else that rests on, and the sensors before mirroring (x_m, y_m, z_m, pitch_deg,
//! roll_deg); their models are then listed as `"master_models": ["os1-64"]`. So is `"calibrations": { "right": "right.json" }`: by
//! name of a sensor, the file (as seen from the mount file) with the calibration of the unit in its place. Angles stay in degrees here, so
//! that writing and reading loses nothing.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use sensors::catalogue;

use super::doubts::{self, Doubted};
use super::{FoundWith, Mount, MountedSensor};
use crate::base::files;

/// What `format` says.
pub const FORMAT: &str = "outrigger-mount/1";

/// What `frame` says.
pub const FRAME: &str = "mount: x right, y forward, z up";

/// The content of a mount file.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MountFile {
    format: String,
    frame: String,
    /// Every physical sensor, mirrored ones included.
    pub sensors: Vec<SensorEntry>,
    /// Calibration of the unit in a sensor's place, by its name. In the file a path is as seen from its folder, here as
    /// seen from where the program runs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibrations: Option<BTreeMap<String, PathBuf>>,
    /// Sensors before mirroring: `[x_m, y_m, z_m, pitch_deg, roll_deg]` each.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub masters: Option<Vec<[f64; 5]>>,
    /// Model of each of them, where a rig mixes models.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub master_models: Option<Vec<String>>,
    /// The experiment in which the mount was found; of a mixed rig several, with commas between them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub preset: Option<String>,
    /// Its score there.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub objective: Option<f64>,
    /// What that score rests on besides the experiment.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub found_with: Option<Box<FoundWith>>,
}

/// One sensor of a mount file.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorEntry {
    /// Name within the rig.
    pub name: String,
    /// Name of a sensor model (`os1-64`).
    pub model: String,
    /// Right of the platform's origin, m.
    pub x_m: f64,
    /// Ahead of it, m.
    pub y_m: f64,
    /// Above it, m.
    pub z_m: f64,
    /// About the forward axis, degrees.
    pub pitch_deg: f64,
    /// About the lateral axis, degrees.
    pub roll_deg: f64,
    /// About its own spin axis, degrees: counterclockwise seen from its top.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub yaw_deg: f64,
    /// How far each angle may be off when it is built, degrees, where somebody decided that.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub angle_tolerance_deg: Option<f64>,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde hands over a reference")]
fn is_zero(angle_deg: &f64) -> bool {
    *angle_deg == 0.0
}

impl SensorEntry {
    /// A mounted sensor.
    pub(crate) fn of(sensor: &MountedSensor) -> Self {
        let Mount { x_m, y_m, z_m, pitch_rad, roll_rad, yaw_rad } = sensor.mount;
        Self {
            name: sensor.name.clone(),
            model: sensor.model.name.clone(),
            x_m,
            y_m,
            z_m,
            pitch_deg: pitch_rad.to_degrees(),
            roll_deg: roll_rad.to_degrees(),
            yaw_deg: yaw_rad.to_degrees(),
            angle_tolerance_deg: None,
        }
    }

    /// The mount, in radians.
    pub fn mount(&self) -> Mount {
        Mount {
            x_m: self.x_m,
            y_m: self.y_m,
            z_m: self.z_m,
            pitch_rad: self.pitch_deg.to_radians(),
            roll_rad: self.roll_deg.to_radians(),
            yaw_rad: self.yaw_deg.to_radians(),
        }
    }

    fn doubted(&self) -> Doubted<'_> {
        Doubted {
            name: &self.name,
            position_m: [("x_m", self.x_m), ("y_m", self.y_m), ("z_m", self.z_m)],
            angles_deg: [
                ("pitch_deg", self.pitch_deg),
                ("roll_deg", self.roll_deg),
                ("yaw_deg", self.yaw_deg),
            ],
            angle_tolerance_deg: self.angle_tolerance_deg,
        }
    }

    fn numbers(&self) -> [(&'static str, f64); 7] {
        [
            ("x_m", self.x_m),
            ("y_m", self.y_m),
            ("z_m", self.z_m),
            ("pitch_deg", self.pitch_deg),
            ("roll_deg", self.roll_deg),
            ("yaw_deg", self.yaw_deg),
            ("angle_tolerance_deg", self.angle_tolerance_deg.unwrap_or_default()),
        ]
    }
}

impl MountFile {
    /// A file of these sensors.
    pub fn new(sensors: Vec<SensorEntry>) -> Self {
        Self {
            format: FORMAT.into(),
            frame: FRAME.into(),
            sensors,
            calibrations: None,
            masters: None,
            master_models: None,
            preset: None,
            objective: None,
            found_with: None,
        }
    }

    /// The same of a file that travels with its folder, from whoever made it: what it names lies in the folder, too.
    pub(crate) fn read_inside(folder: &Path, name: &str) -> Result<Self, MountFileError> {
        let path = folder.join(name);
        let text = files::read_inside(folder, name).and_then(files::text);
        let text = text.map_err(|source| MountFileError::Unreadable { path: path.clone(), source })?;
        let wrong = |reason| MountFileError::Wrong { path: path.clone(), reason };
        let mut file = Self::from_json(&text).map_err(wrong)?;
        for (sensor, calibration) in file.calibrations.iter_mut().flatten() {
            *calibration = files::inside(folder, calibration).map_err(|error| {
                wrong(format!("calibrations of {sensor}, {}: {error}", calibration.display()))
            })?;
        }
        Ok(file)
    }

    /// The same with its sensors in the order of a rig's axes: those of these names first, then those that no axis turns.
    ///
    /// # Errors
    /// A name that it does not have, or has been given before; in words.
    pub(crate) fn by_axis(mut self, names: &[String]) -> Result<Self, String> {
        let known = self.sensors.iter().map(|sensor| sensor.name.as_str()).collect::<Vec<_>>().join(", ");
        for (axis, name) in names.iter().enumerate() {
            if names[..axis].contains(name) {
                return Err(format!("{name} is given twice; each axis carries another sensor"));
            }
            let Some(at) = self.sensors.iter().position(|sensor| sensor.name == *name) else {
                return Err(format!("no sensor `{name}`; there are {known}"));
            };
            self.sensors[axis..=at].rotate_right(1); // the others keep their order
        }
        Ok(self)
    }

    /// Pitch of each axis, degrees, of a file in the order of axes: of the sensors with these names, or of all where none is
    /// named.
    pub(crate) fn axis_pitches_deg(&self, names: &[String]) -> Vec<f64> {
        let turned = if names.is_empty() { self.sensors.len() } else { names.len() };
        self.sensors.iter().take(turned).map(|sensor| sensor.pitch_deg).collect()
    }

    /// Writes a file, whole or not at all. What [`MountFile::read`] would refuse is not written.
    pub fn write(&self, path: &Path) -> Result<(), MountFileError> {
        self.check().map_err(|reason| MountFileError::Wrong { path: path.to_owned(), reason })?;
        let text = serde_json::to_string_pretty(&self.seen_from(files::folder_of(path)))
            .map_err(|error| MountFileError::Wrong { path: path.to_owned(), reason: error.to_string() })?;
        files::write_whole(path, format!("{text}\n").as_bytes())
            .map_err(|source| MountFileError::Unwritable { path: path.to_owned(), source })
    }

    /// The same with paths as seen from a folder: absolute ones where they do not lie in it.
    fn seen_from(&self, folder: &Path) -> Self {
        let mut file = self.clone();
        for path in file.calibrations.iter_mut().flat_map(BTreeMap::values_mut) {
            *path = match path.strip_prefix(folder) {
                Ok(inside) => inside.to_owned(),
                Err(_) => std::path::absolute(&*path).unwrap_or_else(|_| path.clone()),
            };
        }
        file
    }

    /// What can be meant and seldom is, a line each.
    pub(crate) fn doubts(&self) -> Vec<String> {
        doubts::of_rig(&self.sensors.iter().map(SensorEntry::doubted).collect::<Vec<_>>())
    }

    pub(super) fn check(&self) -> Result<(), String> {
        if self.format != FORMAT {
            return Err(format!("format is {:?}, this program reads {FORMAT:?}", self.format));
        }
        if self.frame != FRAME {
            return Err(format!(
                "frame is {:?}, expected {FRAME:?}: convert the positions and say so",
                self.frame
            ));
        }
        if self.sensors.is_empty() {
            return Err("sensors is empty: list at least one sensor".into());
        }
        for (index, sensor) in self.sensors.iter().enumerate() {
            if sensor.name.is_empty() {
                return Err(format!("sensors[{index}].name is empty: give each sensor a name"));
            }
            if let Some(twin) = self.sensors[..index].iter().position(|other| other.name == sensor.name) {
                return Err(format!(
                    "sensors[{index}].name is {:?} like that of sensors[{twin}]: names must differ",
                    sensor.name
                ));
            }
            // a sensor of the user's own is known by its file
            if !self.calibrations.as_ref().is_some_and(|files| files.contains_key(&sensor.name)) {
                catalogue::nominal(&sensor.model)
                    .map_err(|error| format!("sensors[{index}].model: {error}"))?;
            }
            for (field, value) in sensor.numbers() {
                finite(&format!("sensors[{index}].{field}"), value)?;
            }
            doubts::ensure_plausible(index, &sensor.doubted())?;
        }
        for name in self.calibrations.iter().flat_map(BTreeMap::keys) {
            if !self.sensors.iter().any(|sensor| sensor.name == *name) {
                return Err(format!("calibrations names {name:?}, but no sensor is called so"));
            }
        }
        for (index, master) in self.masters.iter().flatten().enumerate() {
            for (place, value) in master.iter().enumerate() {
                finite(&format!("masters[{index}][{place}]"), *value)?;
            }
        }
        if let Some(models) = &self.master_models {
            let masters = self.masters.as_ref().map_or(0, Vec::len);
            if models.len() != masters {
                return Err(format!(
                    "master_models names {} models, but masters lists {masters}",
                    models.len()
                ));
            }
            for (index, model) in models.iter().enumerate() {
                catalogue::nominal(model).map_err(|error| format!("master_models[{index}]: {error}"))?;
            }
        }
        if let Some(found) = &self.found_with {
            let prices = found.lambda.iter().map(|price| ("found_with.lambda", *price));
            let others = [
                ("found_with.voxel_m", found.voxel_m),
                ("found_with.registration_weight", found.registration_weight),
                ("found_with.least_conditioning", found.least_conditioning),
                ("found_with.least_distance_m", found.least_distance_m),
            ];
            prices.chain(others).try_for_each(|(field, value)| finite(field, value))?;
            let presets = self.preset.as_ref().map_or(found.lambda.len(), |names| names.split(',').count());
            if found.lambda.len() != presets {
                return Err(format!(
                    "found_with.lambda holds {} prices, expected one for each of the {presets} presets",
                    found.lambda.len()
                ));
            }
        }
        self.objective.map_or(Ok(()), |value| finite("objective", value))
    }
}

fn finite(field: &str, value: f64) -> Result<(), String> {
    if value.is_finite() { Ok(()) } else { Err(format!("{field} is {value}: give a finite number")) }
}

/// What can be wrong with a mount file.
#[derive(Debug, thiserror::Error)]
pub enum MountFileError {
    /// It cannot be read.
    #[error("mount file {path}: cannot be read", path = path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// It cannot be written.
    #[error("mount file {path}: cannot be written", path = path.display())]
    Unwritable {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Its content is not a mount.
    #[error("mount file {path}: {reason}", path = path.display())]
    Wrong {
        /// The file.
        path: PathBuf,
        /// Field, what was found, what was expected.
        reason: String,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(name: &str) -> SensorEntry {
        SensorEntry {
            name: name.into(),
            model: "os1-64".into(),
            x_m: 0.1 + 0.2,
            y_m: -0.25,
            z_m: 1.0 / 3.0,
            pitch_deg: 25.23,
            ..SensorEntry::default()
        }
    }

    #[test]
    fn what_is_written_is_read_to_the_bit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mount.json");
        let mut file = MountFile::new(vec![entry("left"), entry("right")]);
        file.masters = Some(vec![[0.1 + 0.2, 0.0, 1.0 / 3.0, 25.23, 0.0]]);
        file.objective = Some(30701.0 + 1.0 / 3.0);
        file.write(&path).unwrap();
        assert_eq!(MountFile::read(&path).unwrap(), file);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn each_kind_of_wrong_content_is_named() {
        let good = serde_json::to_string(&MountFile::new(vec![entry("left")])).unwrap();
        assert!(MountFile::from_json(&good).is_ok());
        for (from, to, words) in [
            ("\"pitch_deg\":25.23", "\"pitch_deg\":NaN", &["sensors[0].pitch_deg", "line 1"][..]),
            ("\"pitch_deg\":25.23", "\"pitch_deg\":null", &["sensors[0].pitch_deg", "null"]),
            ("\"pitch_deg\":25.23", "\"pitch_deg\":1e999", &["sensors[0].pitch_deg", "out of range"]),
            ("\"pitch_deg\":25.23,", "", &["sensors[0]", "pitch_deg"]),
            ("\"pitch_deg\"", "\"pitch_rad\"", &["pitch_rad", "unknown field"]),
            ("os1-64", "os9-64", &["sensors[0].model", "os9-64", "os1-64"]),
            ("mount/1", "mount/2", &["outrigger-mount/2", "outrigger-mount/1"]),
            ("x right", "x forward", &["frame", "x right"]),
            ("left", "", &["sensors[0].name"]),
        ] {
            let bad = good.replace(from, to);
            assert_ne!(bad, good, "{from}");
            let reason = MountFile::from_json(&bad).unwrap_err();
            assert!(words.iter().all(|word| reason.contains(word)), "{to}: {reason}");
        }
        assert!(MountFile::from_json(&format!("{good} 1")).unwrap_err().contains("trailing"));
        assert!(MountFile::from_json("").unwrap_err().contains("EOF"));
        let twins = MountFile::new(vec![entry("left"), entry("left")]);
        assert!(twins.check().unwrap_err().contains("names must differ"));
    }

    #[test]
    fn sensors_come_in_the_order_of_axes() {
        let file = MountFile::new(["a", "b", "c", "d"].map(entry).into());
        let order = |names: &[&str]| {
            let names: Vec<String> = names.iter().map(|name| (*name).to_owned()).collect();
            let sensors = |file: MountFile| file.sensors.into_iter().map(|sensor| sensor.name).collect();
            file.clone().by_axis(&names).map(sensors).map(|names: Vec<String>| names.concat())
        };
        assert_eq!(order(&[]).unwrap(), "abcd");
        assert_eq!(order(&["c", "a"]).unwrap(), "cabd");
        assert_eq!(order(&["d", "c", "b", "a"]).unwrap(), "dcba");
        assert!(order(&["c", "c"]).unwrap_err().contains("twice"));
        assert!(order(&["c", "x"]).unwrap_err().contains("no sensor `x`; there are a, b, c, d"));
    }

    #[test]
    fn nothing_is_written_that_cannot_be_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mount.json");
        let mut file = MountFile::new(vec![entry("left")]);
        file.sensors[0].z_m = f64::NAN;
        assert!(file.write(&path).unwrap_err().to_string().contains("sensors[0].z_m"));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
