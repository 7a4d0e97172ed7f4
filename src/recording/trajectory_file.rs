//! Trajectories from files: tables of poses, and what a bag holds.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use super::bags::{Surroundings, is_bag_at};
use super::source::RecordingError;
use crate::world::trajectory::{ReadTrajectory, Trajectory};

/// What `--trajectory` names.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum TrajectorySource {
    /// `still`: the rig does not move.
    Still,
    /// `odometry`: found from the recording.
    Odometry,
    File(PathBuf),
}

impl From<OsString> for TrajectorySource {
    fn from(name: OsString) -> Self {
        match name.to_str() {
            Some("still") => Self::Still,
            Some("odometry") => Self::Odometry,
            _ => Self::File(name.into()),
        }
    }
}

/// Reads a trajectory, in the frame of its file; how it was read, each line after the file's name.
pub(crate) fn read_trajectory(
    path: &Path,
    rate_hz: Option<f64>,
) -> Result<(Trajectory, Vec<String>), RecordingError> {
    let name = path.display().to_string();
    let (bag, topic) = bag_and_topic(path);
    if is_bag_at(bag) {
        if rate_hz.is_some() {
            return Err(RecordingError::RateOfBag { name });
        }
        return Ok(Surroundings::read(bag, &bag.display().to_string())?.platform_trajectory(bag, topic)?);
    }
    let bytes = crate::base::files::read(path)
        .map_err(|source| RecordingError::File { name: name.clone(), source })?;
    let read = Trajectory::read(&bytes, rate_hz)
        .map_err(|source| RecordingError::TrajectoryFile { name: name.clone(), source })?;
    let ReadTrajectory { trajectory, notes } = read;
    Ok((trajectory, notes.into_iter().map(|note| format!("{name}: {note}")).collect()))
}

/// The bag of `BAG:/TOPIC`, and the topic; the whole path where there is a file of that name.
fn bag_and_topic(path: &Path) -> (&Path, Option<&str>) {
    let parts = path.to_str().filter(|_| !path.exists()).and_then(|text| text.split_once(":/"));
    parts.map_or((path, None), |(bag, _)| {
        let topic = path.to_str().map(|text| &text[bag.len() + 1..]);
        (Path::new(bag), topic)
    })
}
