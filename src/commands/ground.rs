//! What the verbs about places share: the mesh with its unit and axis, the way through it.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use glam::DVec3;
use serde::Serialize;

use crate::rig::Mount;
use crate::world::scene::{BoxScene, LoadedMesh, Mesh, MeshFileError, MeshUnit, Scene, UpAxis, load_mesh};
use crate::world::trajectory::{PoseError, Trajectory, WalkLimits};

/// Way between the points of the path from which lines of sight are drawn, m.
const STATION_STEP_M: f64 = 0.5;
/// A mesh higher than this, m, whose unit nobody stated may be in centimetres.
const HIGH_M: f64 = 100.0;

/// What a mesh file does not say itself.
#[derive(clap::Args, Debug, Clone, Copy, Default)]
pub struct MeshArgs {
    /// Unit of the mesh file [default: m, refused where the size makes that absurd].
    #[arg(long, value_name = "UNIT")]
    mesh_unit: Option<UnitArg>,
    /// Axis of the mesh file that points up [default: z; y for glTF].
    #[arg(long, value_name = "AXIS")]
    up: Option<UpArg>,
}

#[derive(clap::ValueEnum, Clone, Copy, Debug)]
enum UnitArg {
    M,
    Cm,
    Mm,
}

#[derive(clap::ValueEnum, Clone, Copy, Debug)]
enum UpArg {
    Z,
    Y,
}

/// How a mesh file was taken.
#[derive(Clone, Debug, Serialize)]
pub struct MeshTaken {
    unit: &'static str,
    up: &'static str,
    /// Whether the user or the format said the unit.
    is_unit_stated: bool,
    /// Whether the user or the format said the axis.
    is_up_stated: bool,
    extent_m: [f64; 3],
}

/// A mesh as read.
pub struct ReadMesh {
    pub mesh: Mesh,
    pub taken: MeshTaken,
    pub warnings: Vec<String>,
}

impl MeshArgs {
    /// Reads a mesh; what nobody stated and the format does not say is taken as metres, z up.
    pub fn read(&self, path: &Path) -> anyhow::Result<ReadMesh> {
        let unit = self.mesh_unit.map(|unit| match unit {
            UnitArg::M => MeshUnit::Metre,
            UnitArg::Cm => MeshUnit::Centimetre,
            UnitArg::Mm => MeshUnit::Millimetre,
        });
        let up = self.up.map(|up| match up {
            UpArg::Z => UpAxis::Z,
            UpArg::Y => UpAxis::Y,
        });
        let LoadedMesh { mesh, mut warnings } = match load_mesh(path, unit, up) {
            Err(error @ MeshFileError::UnitUnclear { extent_units, .. }) => {
                bail!("{error}: pass --mesh-unit m, cm or mm{}", guess(extent_units))
            }
            loaded => loaded?,
        };
        let says = path
            .extension()
            .is_some_and(|ending| ["gltf", "glb"].iter().any(|e| ending.eq_ignore_ascii_case(e)));
        let extent = mesh.bounds_m()[1] - mesh.bounds_m()[0];
        if unit.is_none() && !says && extent.z > HIGH_M {
            warnings.push(format!(
                "{}: the mesh is {:.0} m high: if the file is in centimetres, pass --mesh-unit cm",
                path.display(),
                extent.z
            ));
        }
        let taken = MeshTaken {
            unit: match unit {
                None | Some(MeshUnit::Metre) => "m",
                Some(MeshUnit::Centimetre) => "cm",
                Some(MeshUnit::Millimetre) => "mm",
            },
            up: match up {
                None if says => "y",
                None | Some(UpAxis::Z) => "z",
                Some(UpAxis::Y) => "y",
            },
            is_unit_stated: says || unit.is_some(),
            is_up_stated: says || up.is_some(),
            extent_m: extent.to_array(),
        };
        Ok(ReadMesh { mesh, taken, warnings })
    }
}

/// The unit in which an extent looks like a building.
fn guess(extent_units: [f64; 3]) -> String {
    let largest = extent_units.into_iter().fold(0.0, f64::max);
    for (name, per_m) in [("mm", 1e3), ("cm", 1e2)] {
        if (2.0..=500.0).contains(&(largest / per_m)) {
            let [x, y, z] = extent_units.map(|units| units / per_m);
            return format!(" (in {name} it would be {x:.2} x {y:.2} x {z:.2} m)");
        }
    }
    String::new()
}

impl MeshTaken {
    /// One line of a summary.
    pub fn line(&self) -> String {
        format!("mesh           {}\n", self.words())
    }

    /// In words.
    pub fn words(&self) -> String {
        let [x, y, z] = self.extent_m;
        let guessed = match (self.is_unit_stated, self.is_up_stated) {
            (true, true) => "",
            (false, true) => "; nobody stated the unit (--mesh-unit)",
            (true, false) => "; nobody stated the axis (--up)",
            (false, false) => "; nobody stated either (--mesh-unit, --up)",
        };
        format!("{x:.2} x {y:.2} x {z:.2} m, read in {}, {} up{guessed}", self.unit, self.up)
    }
}

/// Way of the body.
#[derive(clap::Args, Debug, Clone)]
pub struct TrajectoryArgs {
    /// Way of the body: TUM format, or KITTI poses with --rate.
    #[arg(long, value_name = "FILE")]
    trajectory: PathBuf,
    /// Poses per second of a trajectory in KITTI format.
    #[arg(long, value_name = "HZ", value_parser = crate::commands::ranges::within(1e-3, 1e6))]
    rate: Option<f64>,
}

impl TrajectoryArgs {
    /// The file's name.
    pub fn name(&self) -> String {
        self.trajectory.display().to_string()
    }

    /// Reads the file.
    pub fn read(&self) -> anyhow::Result<Trajectory> {
        read_trajectory(&self.trajectory, self.rate).with_context(|| self.name())
    }

    /// What is odd about the trajectory, alone and within a mesh or room of these bounds.
    pub fn doubts(&self, what: &str, bounds_m: [DVec3; 2], trajectory: &Trajectory) -> Vec<String> {
        let name = self.name();
        let mut doubts = suspicions(trajectory, &name);
        doubts.extend(outside(trajectory, what, bounds_m).map(|words| format!("{name}: {words}")));
        doubts
    }
}

/// What is odd about a way in itself, each line after a name; the first three in full.
pub fn suspicions(trajectory: &Trajectory, name: &str) -> Vec<String> {
    let found = trajectory.suspicions(&WalkLimits::default());
    let mut lines: Vec<String> =
        found.iter().take(3).map(|suspicion| format!("{name}: {suspicion}")).collect();
    if found.len() > 3 {
        lines.push(format!("{name}: {} more gaps, jumps or spins", found.len() - 3));
    }
    lines
}

/// Says so when points of the path lie outside a mesh, room or map of these bounds.
pub fn outside(trajectory: &Trajectory, what: &str, [low, high]: [DVec3; 2]) -> Option<String> {
    let stations_m = trajectory.stations_m(STATION_STEP_M);
    let outside = stations_m.iter().filter(|at| at.cmplt(low).any() || at.cmpgt(high).any()).count();
    (outside > 0).then(|| {
        format!(
            "{outside} of {} points of the path lie outside the {what}; do both use the same frame, unit and up axis?",
            stations_m.len()
        )
    })
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
    pub fn error(&self) -> PoseError {
        PoseError {
            position_sd_m: self.pose_sd,
            rotation_sd_rad: self.attitude_sd.to_radians(),
            correlation_s: self.pose_memory,
        }
    }
}

/// Reads a trajectory: TUM, or KITTI where a rate is given.
pub fn read_trajectory(path: &Path, rate_hz: Option<f64>) -> anyhow::Result<Trajectory> {
    let text = crate::base::files::read_text(path)?;
    Ok(match rate_hz {
        Some(rate_hz) => Trajectory::from_kitti(&text, rate_hz)?,
        None => Trajectory::from_tum(&text).map_err(|error| {
            let is_kitti = Trajectory::from_kitti(&text, 1.0).is_ok();
            let error = anyhow::Error::new(error);
            if is_kitti { error.context("these are poses in KITTI format: give --rate") } else { error }
        })?,
    })
}

/// Points of the path at the sensors' mean height.
pub fn stations(trajectory: &Trajectory, mounts: &[Mount]) -> Vec<DVec3> {
    let height_m = mounts.iter().map(|mount| mount.z_m).sum::<f64>() / mounts.len() as f64;
    trajectory.stations_m(STATION_STEP_M).into_iter().map(|at| at + height_m * DVec3::Z).collect()
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

/// A closed room by its least and its greatest corner.
#[derive(Clone, Copy, Debug)]
pub struct Room([DVec3; 2]);

impl Room {
    /// Six walls, seen from within.
    pub fn scene(&self) -> Scene {
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
