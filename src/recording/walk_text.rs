//! Where a rig goes through a scene: a file, waypoints, or a walk that is planned.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use glam::DVec2;

use super::source::RecordingError;
use super::trajectory_file::read_trajectory;
use crate::simulate::walk::{self, Walk, Waypoint};
use crate::world::local_origin::LocalOrigin;
use crate::world::scene::Scene;
use crate::world::trajectory::suspicions;

/// A trajectory as typed: a file, or waypoints "x,y x,y ..." or "x,y,z ...", m.
#[derive(Clone, Debug)]
pub(crate) enum WalkText {
    File(PathBuf),
    Waypoints(Vec<Waypoint>),
}

impl WalkText {
    /// The walk in the local frame of a scene, which begins at `origin`; of none, one that is planned there. What is odd about
    /// it alone is among its doubts.
    pub(crate) fn walk_through(
        source: Option<&Self>,
        rate_hz: Option<f64>,
        scene: &Scene,
        origin: LocalOrigin,
    ) -> Result<Walk, RecordingError> {
        match source {
            None => Ok(walk::planned(scene)?),
            Some(Self::Waypoints(waypoints)) => {
                let local: Vec<_> = waypoints.iter().map(|waypoint| waypoint.local(origin)).collect();
                Ok(walk::along(scene, &local)?)
            }
            Some(Self::File(path)) => {
                let (trajectory, mut doubts) = read_trajectory(path, rate_hz)?;
                doubts.extend(suspicions(&trajectory, &path.display().to_string()));
                let trajectory = origin.local_trajectory(trajectory);
                Ok(Walk { trajectory, corners_m: Vec::new(), doubts })
            }
        }
    }

    /// As it stands in a file of that folder: what is a file lies there.
    pub(crate) fn text_in(text: &str, folder: &Path) -> OsString {
        match text.parse() {
            Ok(Self::File(path)) => folder.join(path).into_os_string(),
            _ => text.into(),
        }
    }
}

impl std::str::FromStr for WalkText {
    type Err = String;

    /// A path wins over numbers: a file may be called anything.
    fn from_str(text: &str) -> Result<Self, String> {
        let is_of_numbers = text.chars().all(|c| c.is_ascii_digit() || " \t.,;+-eE".contains(c));
        if !is_of_numbers || !text.contains(',') || Path::new(text).exists() {
            return Ok(Self::File(text.into()));
        }
        let mut waypoints = Vec::new();
        for (index, part) in text.split([' ', '\t', ';']).filter(|part| !part.is_empty()).enumerate() {
            let found = |what: String| format!("waypoint {} ({part:?}): {what}", index + 1);
            let numbers = part.split(',').map(|number| number.parse().ok().filter(|v: &f64| v.abs() < 1e8));
            let numbers: Option<Vec<f64>> = numbers.collect();
            let numbers = numbers.ok_or_else(|| found("every part must be a number, in m".into()))?;
            waypoints.push(match numbers[..] {
                [x, y] => Waypoint { at_m: DVec2::new(x, y), z_m: None },
                [x, y, z] => Waypoint { at_m: DVec2::new(x, y), z_m: Some(z) },
                _ => return Err(found(format!("{} numbers, expected x,y or x,y,z", numbers.len()))),
            });
        }
        match waypoints.len() {
            0 | 1 => Err(format!("{} waypoints, expected two or more: \"0,0 5,0 5,4\"", waypoints.len())),
            _ => Ok(Self::Waypoints(waypoints)),
        }
    }
}
