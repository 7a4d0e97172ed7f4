//! Where sensors sit, as other programs write it, read back into a mount file: URDF, tf YAML, 4x4 matrices, and the
//! extrinsics of Ouster's programs.

mod from_json;
mod from_text;
mod from_tf;
mod from_urdf;
mod graph;
mod matrix;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use sensors::catalogue;

use self::graph::Graph;
use super::frames::{BASE, OUSTER_LIDAR, OUSTER_SENSOR, VELODYNE};
use super::{Mount, MountFile, NamedFrame, SensorEntry};
use crate::base::files;
use crate::base::geometry::Pose;

/// How finely numbers are rounded: nanometres, and billionths of a degree.
const STEPS_OF_ONE: f64 = 1e9;
/// The most bytes of a file; extrinsics are a page of text.
const MOST_BYTES: usize = 16 << 20;

/// What files say about where frames sit.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Extrinsics {
    /// Frames and where they sit in others.
    links: Vec<NamedFrame>,
    /// Model of the sensor of a frame, where the file says so, and its name where it has one of its own.
    known: BTreeMap<String, Known>,
    /// What was corrected or concluded.
    pub notices: Vec<String>,
}

/// What a file states of a sensor in addition to its pose.
#[derive(Clone, Debug, Default, PartialEq)]
struct Known {
    name: Option<String>,
    model: Option<String>,
    /// The file itself, where it is the calibration of the unit.
    calibration: Option<PathBuf>,
}

/// What can be wrong with extrinsics.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ExtrinsicsError {
    /// The system does not give the file.
    #[error("{}: cannot be read", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// Its content says no place of a sensor.
    #[error("{}: {reason}", path.display())]
    Wrong {
        /// The file.
        path: PathBuf,
        /// Place in it, what was found, what was expected.
        reason: String,
    },
    /// The files together are no rig.
    #[error("{0}")]
    NoRig(String),
}

/// Whether a text is a mount file, of this program or of the published one.
fn is_mount_file(text: &str) -> bool {
    let object = serde_json::from_str::<BTreeMap<String, serde::de::IgnoredAny>>(text);
    object.is_ok_and(|object| ["format", "sensor_type"].iter().any(|key| object.contains_key(*key)))
}

impl Extrinsics {
    /// What a file says; none where it is a mount file, which is read as such.
    ///
    /// # Errors
    /// It cannot be read, or is none of the kinds that are known.
    pub(crate) fn read(path: &Path) -> Result<Option<Self>, ExtrinsicsError> {
        let unreadable = |source| ExtrinsicsError::Unreadable { path: path.to_owned(), source };
        let wrong = |reason| ExtrinsicsError::Wrong { path: path.to_owned(), reason };
        let text = files::read_text(path).map_err(unreadable)?;
        if text.len() > MOST_BYTES {
            return Err(wrong(format!("{} bytes; extrinsics have at most {MOST_BYTES}", text.len())));
        }
        let stem =
            path.file_stem().map_or_else(|| "sensor".into(), |stem| stem.to_string_lossy().into_owned());
        let ending = files::ending(path);
        match (ending.as_str(), text.trim_start().chars().next()) {
            (_, None) => Err(wrong(
                "is empty; expected a mount file, URDF, tf YAML, a 4x4 matrix or Ouster metadata".into(),
            )),
            ("urdf" | "xml" | "xacro", _) | (_, Some('<')) => {
                from_urdf::parse(&text).map(Some).map_err(wrong)
            }
            ("yaml" | "yml", _) => from_tf::parse(&text).map(Some).map_err(wrong),
            (_, Some('{')) if is_mount_file(&text) => Ok(None),
            ("json", _) | (_, Some('{' | '[')) => {
                from_json::parse(&text, &stem, path).map(Some).map_err(wrong)
            }
            _ if text.contains("transforms:") || text.contains("frame_id:") => {
                from_tf::parse(&text).map(Some).map_err(wrong)
            }
            _ => from_text::parse(&text, &stem).map(Some).map_err(wrong),
        }
    }

    /// Adds what another file says.
    pub(crate) fn add(&mut self, other: Self) {
        self.links.extend(other.links);
        self.known.extend(other.known);
        self.notices.extend(other.notices);
    }

    /// One frame in the platform's.
    fn put(&mut self, name: &str, base_from_frame: Pose) {
        self.links.push(NamedFrame {
            name: name.to_owned(),
            parent: BASE.into(),
            parent_from_frame: base_from_frame,
        });
    }

    /// The mount file of the sensors that the frames name. `models` says which model a sensor is, by its name or, without
    /// a name, of all.
    ///
    /// # Errors
    /// Frames that do not hang together, no sensor among them, or one without a model.
    pub(crate) fn mount_file(
        &self,
        models: &[(Option<String>, String)],
    ) -> Result<(MountFile, Vec<String>), ExtrinsicsError> {
        let no_rig = ExtrinsicsError::NoRig;
        let graph = Graph::new(&self.links).map_err(no_rig)?;
        let mut notices = self.notices.clone();
        let mut entries = Vec::new();
        let mut calibrations = BTreeMap::new();
        for (frame, kind) in self.sensor_frames(&graph) {
            let known = self.known.get(&frame).cloned().unwrap_or_default();
            let name = known.name.unwrap_or_else(|| name_of(&frame, kind));
            let stated = models.iter().rfind(|(of, _)| of.as_ref() == Some(&name));
            let stated =
                stated.or(models.iter().rfind(|(of, _)| of.is_none())).map(|(_, model)| model.clone());
            let model = stated.or(known.model).ok_or_else(|| {
                no_rig(format!(
                    "frame {frame:?} does not say which model {name} is: add --sensor {name}=MODEL, one of {}",
                    catalogue::names().join(", ")
                ))
            })?;
            let nominal = catalogue::nominal(&model).map_err(|error| no_rig(format!("{name}: {error}")))?;
            let mut base_from_sensor = graph.base_from(&frame).map_err(no_rig)?;
            if kind == Kind::OusterLidar {
                let lidar = nominal.sensor_from_lidar();
                let sensor_from_lidar = Pose::new(glam::DQuat::from_mat3(&lidar.matrix3), lidar.translation);
                base_from_sensor = base_from_sensor * sensor_from_lidar.inverse();
                notices.push(format!(
                    "{name}: {frame} is the lidar's frame; the sensor's own lies {:.1} mm below it, turned by half a turn",
                    1000.0 * lidar.translation.z
                ));
            }
            if let Some(calibration) = known.calibration {
                calibrations.insert(name.clone(), calibration);
            }
            entries.push(entry(name, model, &Mount::from_body(&base_from_sensor)));
        }
        let mut file = MountFile::new(entries);
        file.calibrations = (!calibrations.is_empty()).then_some(calibrations);
        file.check().map_err(no_rig)?;
        Ok((file, notices))
    }

    /// The frames at which sensors sit: those with a driver's name, or, where there is none, those that carry no other.
    fn sensor_frames(&self, graph: &Graph<'_>) -> Vec<(String, Kind)> {
        let of = |suffix: &'static str, kind: Kind| {
            let named = self.links.iter().filter(move |link| has_suffix(&link.name, suffix));
            named.map(move |link| (link.name.clone(), kind))
        };
        let mut found: Vec<_> =
            of(OUSTER_SENSOR, Kind::OusterSensor).chain(of(VELODYNE, Kind::Velodyne)).collect();
        for (lidar, kind) in of(OUSTER_LIDAR, Kind::OusterLidar) {
            let prefix = lidar.strip_suffix(OUSTER_LIDAR).unwrap_or_default();
            if !found.iter().any(|(frame, _)| frame.strip_suffix(OUSTER_SENSOR) == Some(prefix)) {
                found.push((lidar, kind));
            }
        }
        let listed = self.links.iter().filter(|link| self.known.contains_key(&link.name));
        for link in listed {
            if !found.iter().any(|(frame, _)| *frame == link.name) {
                found.push((link.name.clone(), Kind::Other));
            }
        }
        if found.is_empty() {
            let leaves = self.links.iter().filter(|link| graph.is_leaf(&link.name));
            found.extend(leaves.map(|link| (link.name.clone(), Kind::Other)));
        }
        // in the order of the files
        found.sort_by_key(|(frame, _)| self.links.iter().position(|link| link.name == *frame));
        found.dedup();
        found
    }
}

/// Which of a sensor's frames one is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    OusterSensor,
    OusterLidar,
    Velodyne,
    /// The sensor's own, whatever it is called.
    Other,
}

/// Whether a frame is called so, alone or behind a prefix.
fn has_suffix(frame: &str, suffix: &str) -> bool {
    frame.strip_suffix(suffix).is_some_and(|prefix| prefix.is_empty() || prefix.ends_with(['_', '/']))
}

/// Name of the sensor of a frame: without what the driver adds.
fn name_of(frame: &str, kind: Kind) -> String {
    let suffix = match kind {
        Kind::OusterSensor => OUSTER_SENSOR,
        Kind::OusterLidar => OUSTER_LIDAR,
        Kind::Velodyne => VELODYNE,
        Kind::Other => "",
    };
    let prefix = frame.strip_suffix(suffix).unwrap_or(frame).trim_matches(['_', '/']);
    let bare = if kind == Kind::Velodyne { VELODYNE } else { "os" };
    if prefix.is_empty() { bare.into() } else { prefix.to_owned() }
}

fn entry(name: String, model: String, mount: &Mount) -> SensorEntry {
    let rounded = |number: f64| (number * STEPS_OF_ONE).round() / STEPS_OF_ONE + 0.0;
    SensorEntry {
        name,
        model,
        x_m: rounded(mount.x_m),
        y_m: rounded(mount.y_m),
        z_m: rounded(mount.z_m),
        pitch_deg: rounded(mount.pitch_rad.to_degrees()),
        roll_deg: rounded(mount.roll_rad.to_degrees()),
        yaw_deg: rounded(mount.yaw_rad.to_degrees()),
        angle_tolerance_deg: None,
    }
}
