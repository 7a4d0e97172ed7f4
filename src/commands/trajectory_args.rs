//! The trajectory through a scene, as typed: a file, waypoints, or a planned walk.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use glam::DVec2;

use crate::recording::read_trajectory;
use crate::simulate::walk::{self, Waypoint};
use crate::world::local_origin::LocalOrigin;
use crate::world::placement::Placement;
use crate::world::scene::Scene;
use crate::world::trajectory::{Trajectory, suspicions};

/// Trajectory of the body.
#[derive(clap::Args, Debug, Clone)]
pub struct TrajectoryArgs {
    /// Trajectory of the body: TUM, EuRoC or another table with named time, position and quaternion; KITTI poses with
    /// --rate; or waypoints "x,y x,y ..." that are walked 1.6 m above the floor [default: a path through all of the free floor].
    #[arg(long, value_name = "FILE", allow_hyphen_values = true)]
    trajectory: Option<WalkText>,
    /// Poses per second of a trajectory in KITTI format.
    #[arg(long, value_name = "HZ", value_parser = crate::commands::ranges::within(1e-3, 1e6))]
    rate: Option<f64>,
}

impl TrajectoryArgs {
    /// The file's name.
    pub(crate) fn name(&self) -> String {
        match &self.trajectory {
            Some(WalkText::File(path)) => path.display().to_string(),
            Some(WalkText::Waypoints(waypoints)) => format!("{} waypoints", waypoints.len()),
            None => "planned trajectory".into(),
        }
    }

    pub(crate) fn is_file(&self) -> bool {
        matches!(self.trajectory, Some(WalkText::File(_)))
    }

    /// Reads the file into the local frame of a scene, or plans a walk there; how it was made, and what is odd about it alone.
    pub(crate) fn read(
        &self,
        scene: &Scene,
        origin: LocalOrigin,
    ) -> anyhow::Result<(Trajectory, Vec<String>)> {
        let walk = match &self.trajectory {
            Some(WalkText::File(path)) => {
                let (trajectory, mut notes) = read_trajectory(path, self.rate)?;
                notes.extend(suspicions(&trajectory, &self.name()));
                return Ok((origin.local_trajectory(trajectory), notes));
            }
            Some(WalkText::Waypoints(waypoints)) => {
                let local: Vec<_> = waypoints.iter().map(|waypoint| waypoint.local(origin)).collect();
                walk::along(scene, &local)?
            }
            None => walk::planned(scene)?,
        };
        let legs = walk.corners_m.len().saturating_sub(1);
        let length_m = walk.trajectory.length_m();
        let mut notes =
            vec![format!("{}: {legs} legs, {length_m:.1} m; --trajectory gives another", self.name())];
        notes.extend(walk.doubts);
        Ok((walk.trajectory, notes))
    }

    /// Where the trajectory lies in a scene; sensors are `height_m` above it.
    pub(crate) fn placement(
        &self,
        scene: &Scene,
        trajectory: &Trajectory,
        height_m: f64,
        origin: LocalOrigin,
    ) -> Placement {
        let mut placement = Placement::new(scene, trajectory, height_m, origin);
        placement.doubts.iter_mut().for_each(|doubt| *doubt = format!("{}: {doubt}", self.name()));
        placement
    }
}

/// A trajectory as typed: a file, or waypoints "x,y x,y ..." or "x,y,z ...", m.
#[derive(Clone, Debug)]
pub enum WalkText {
    File(PathBuf),
    Waypoints(Vec<Waypoint>),
}

impl WalkText {
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
