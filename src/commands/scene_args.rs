//! Arguments that the verbs about scenes share: the mesh with its unit and axis, its samples, the trajectory through it.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use clap::builder::{PossibleValuesParser, TypedValueParser};
use glam::{DVec2, DVec3};

use crate::recording::bags::{Surroundings, is_bag_at};
use crate::simulate::walk::{self, Waypoint};
use crate::world::local_origin::LocalOrigin;
use crate::world::placement::Placement;
use crate::world::scene::{
    BoxScene, Mesh, MeshFile, MeshFileError, MeshUnit, Scene, UNITS, UpAxis, plausible_units,
};
use crate::world::surface::{SurfaceSamples, read_points};
use crate::world::trajectory::{PoseError, ReadTrajectory, Trajectory, suspicions};

/// One of some values, by its name.
pub(crate) fn one_of<T: Copy + Send + Sync + 'static>(
    values: &'static [(&'static str, T)],
) -> impl TypedValueParser<Value = T> {
    let named = |name: String| values.iter().find(|(known, _)| *known == name).map(|(_, value)| *value);
    PossibleValuesParser::new(values.iter().map(|(name, _)| *name))
        .try_map(move |name| named(name).ok_or("no such value"))
}

/// What a mesh file does not say itself.
#[derive(clap::Args, Debug, Clone, Copy, Default)]
pub struct MeshArgs {
    /// Unit of the mesh file [default: as a comment of the file says, else m, refused where the size makes that absurd].
    #[arg(long, value_name = "UNIT", value_parser = one_of(&UNITS))]
    mesh_unit: Option<MeshUnit>,
    /// Axis of the mesh file that points up [default: z; y for glTF].
    #[arg(long, value_name = "AXIS", value_parser = one_of(&[("z", UpAxis::Z), ("y", UpAxis::Y)]))]
    up: Option<UpAxis>,
}

impl MeshArgs {
    /// Reads a mesh; what is neither typed nor stated by the format is metres, z up.
    pub(crate) fn read(&self, path: &Path) -> anyhow::Result<MeshFile> {
        match MeshFile::read(path, self.mesh_unit, self.up) {
            Err(error @ MeshFileError::UnitUnclear { extent_units, .. }) => {
                let guess = MeshUnit::offer(&plausible_units(extent_units), extent_units.into());
                bail!("{error}: pass --mesh-unit {}{guess}", UNITS.map(|(name, _)| name).join(", "))
            }
            read => Ok(read?),
        }
    }
}

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

/// What a trajectory may be off by.
#[derive(clap::Args, Debug, Clone, Copy)]
pub struct PoseErrorArgs {
    /// Standard deviation of the trajectory's position along each axis.
    #[arg(long, value_name = "M", default_value_t = 0.02, value_parser = crate::commands::ranges::within(1e-9, 1000.0))]
    pose_sd: f64,
    /// Standard deviation of the trajectory's attitude about each axis.
    #[arg(long, value_name = "DEG", default_value_t = 0.1, value_parser = crate::commands::ranges::within(1e-9, 180.0))]
    attitude_sd: f64,
    /// Time in which an error of the trajectory is forgotten.
    #[arg(long, value_name = "S", default_value_t = 2.0, value_parser = crate::commands::ranges::within(1e-3, 1e9))]
    pose_memory: f64,
}

impl PoseErrorArgs {
    /// The same in SI units.
    pub(crate) fn error(&self) -> PoseError {
        PoseError {
            position_sd_m: self.pose_sd,
            rotation_sd_rad: self.attitude_sd.to_radians(),
            correlation_s: self.pose_memory,
        }
    }
}

/// Reads a trajectory, in the frame of its file; how it was read, each line after the file's name.
pub(crate) fn read_trajectory(
    path: &Path,
    rate_hz: Option<f64>,
) -> anyhow::Result<(Trajectory, Vec<String>)> {
    let name = path.display();
    let (bag, topic) = bag_and_topic(path);
    if is_bag_at(bag) {
        if rate_hz.is_some() {
            refuse!("--rate is for poses without times (KITTI): {name} is a bag, and its poses have times");
        }
        return Ok(Surroundings::read(bag, &bag.display().to_string())?.platform_trajectory(bag, topic)?);
    }
    let bytes = crate::base::files::read(path).with_context(|| name.to_string())?;
    let read = Trajectory::read(&bytes, rate_hz).with_context(|| name.to_string())?;
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

/// Where the samples of a surface come from.
#[derive(clap::Args, Debug)]
pub struct SampleArgs {
    /// Surface samples: a NumPy file of floats, shape (n, 3), metres, in the frame of the trajectory.
    #[arg(long, value_name = "FILE", conflicts_with = "sample_count")]
    samples: Option<PathBuf>,
    /// Samples drawn from the mesh, evenly over its area.
    #[arg(long, value_name = "N", default_value_t = 1_000_000, value_parser = clap::value_parser!(u32).range(1..=100_000_000))]
    sample_count: u32,
}

impl SampleArgs {
    /// Reads or draws the samples, in the local frame.
    pub(crate) fn samples(
        &self,
        mesh: &Mesh,
        origin: LocalOrigin,
        seed: u64,
    ) -> anyhow::Result<SurfaceSamples> {
        let Some(path) = &self.samples else {
            return Ok(SurfaceSamples::of_mesh(mesh, self.sample_count as usize, seed));
        };
        let bytes = crate::base::files::read(path).with_context(|| path.display().to_string())?;
        let points_m = read_points(&bytes).with_context(|| path.display().to_string())?;
        let points_m = points_m.into_iter().map(|point_m| origin.local(point_m)).collect();
        SurfaceSamples::new(points_m).with_context(|| path.display().to_string())
    }
}

/// So many finite numbers, separated by commas.
#[derive(Clone, Copy, Debug)]
pub struct Numbers<const N: usize>(pub [f64; N]);

impl<const N: usize> std::str::FromStr for Numbers<N> {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Option<Vec<f64>> =
            text.split(',').map(|part| part.trim().parse().ok().filter(|v: &f64| v.is_finite())).collect();
        let numbers = numbers.ok_or("every part must be a finite number")?;
        let found = numbers.len();
        numbers.try_into().map(Self).map_err(|_| format!("{found} numbers, expected {N}"))
    }
}

/// Longest edge of a room, m: its walls are counted in voxels.
const LONGEST_ROOM_M: f64 = 10_000.0;

/// A closed room by its min and its max corner.
#[derive(Clone, Copy, Debug)]
pub struct Room([DVec3; 2]);

impl Room {
    /// Six walls, seen from within.
    pub(crate) fn scene(&self) -> Scene {
        let Self([low_m, high_m]) = *self;
        Scene::Box(BoxScene::closed(low_m, high_m))
    }
}

impl std::str::FromStr for Room {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let Numbers([x0, y0, z0, x1, y1, z1]) = text.parse()?;
        let [low_m, high_m] = [DVec3::new(x0, y0, z0), DVec3::new(x1, y1, z1)];
        if !low_m.cmplt(high_m).all() {
            return Err("the first corner must lie below the second in x, y and z".into());
        }
        if (high_m - low_m).max_element() > LONGEST_ROOM_M
            || low_m.abs().max(high_m.abs()).max_element() > 1e8
        {
            return Err(format!("expected a room of {LONGEST_ROOM_M} m at most, within 1e8 m of 0"));
        }
        Ok(Self([low_m, high_m]))
    }
}
