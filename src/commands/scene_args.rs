//! Arguments that the verbs about scenes share: the mesh with its unit and axis, its samples, a room.

mod shapes;

use std::path::PathBuf;

use anyhow::Context as _;
use clap::builder::{PossibleValuesParser, TypedValueParser};

use super::ensure_consistent;
use crate::simulate::quality::Quality;
use crate::world::local_origin::LocalOrigin;
use crate::world::scene::{Mesh, MeshUnit, Scene, UNITS, UpAxis};
use crate::world::surface::{SurfaceSamples, read_points};
use crate::world::trajectory::PoseError;

pub use shapes::{Numbers, Operator, Room};

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
    pub(super) mesh_unit: Option<MeshUnit>,
    /// Axis of the mesh file that points up [default: z; y for glTF].
    #[arg(long, value_name = "AXIS", value_parser = one_of(&[("z", UpAxis::Z), ("y", UpAxis::Y)]))]
    pub(super) up: Option<UpAxis>,
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

/// When a voxel counts as seen.
#[derive(clap::Args, Debug, Clone, Copy)]
pub struct QualityArgs {
    /// Maximum range at which a return counts [default: the model's].
    #[arg(long, value_name = "M", value_parser = crate::commands::ranges::within(1e-3, 10_000.0))]
    pub(super) max_range: Option<f64>,
    /// Maximum angle to the surface normal that counts [default: any].
    #[arg(long, value_name = "DEG", value_parser = crate::commands::ranges::within(1e-3, 90.0))]
    pub(super) max_incidence: Option<f64>,
    /// Returns of all sensors that make a voxel count.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=10_000))]
    min_hits: u16,
}

impl QualityArgs {
    pub(crate) fn quality(&self) -> Quality {
        let Self { max_range, max_incidence, min_hits } = *self;
        Quality { max_range_m: max_range, max_incidence_deg: max_incidence, min_hits }
    }

    /// Refuses an angle of incidence where surfaces have no normals.
    pub(crate) fn ensure_known_in(&self, scene: &Scene) -> anyhow::Result<()> {
        let words = "--max-incidence: the scene is a map of voxels, which has no surface normals: give a mesh behind --scene, \
                     or leave the flag out";
        ensure_consistent([(self.max_incidence.is_some() && matches!(scene, Scene::Voxels(_)), words.into())])
    }
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
