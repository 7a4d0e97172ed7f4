//! `outrigger predict`

mod experiment;
mod ideal;
mod ideal_sensors;
mod scene;
mod scene_rig;
mod sensing;

use std::path::PathBuf;

use super::experiment_args::{ExperimentArgs, FidelityArg};
use super::scene_args::{MeshArgs, Room, SampleArgs};
use super::scene_file::MapArgs;
use super::trajectory_args::TrajectoryArgs;
use super::{Context, Outcome, output};
use crate::design::scene_search::WeightRule;
use crate::rig::{Masters, UnitChoice};

/// Arguments of `predict`.
#[derive(clap::Args, Debug)]
#[command(
    group = clap::ArgGroup::new("place"),
    group = clap::ArgGroup::new("mounted"),
    after_help = "In a scene every channel is cast at its own time and azimuth with the model's beam geometry; --ideal casts the \
                  published ideal sensor. The rig is compared with one level sensor and the best single one. --preset scores the \
                  mounts in a published experiment, which the mount file may name itself. docs/design-a-mount.md says how a mount \
                  file is made up."
)]
pub struct Args {
    /// Sensors of the rig.
    #[arg(long, group = "mounted", value_name = "FILE")]
    mount: Option<PathBuf>,
    /// Sensors as they are: "x,y,z,pitch_deg,roll_deg;..." in metres and degrees.
    #[arg(long, group = "mounted", allow_hyphen_values = true, value_name = "LIST")]
    mounts: Option<Masters>,
    /// Masters of a published experiment, mirrored by the program: "x,y,z,pitch_deg,roll_deg;..."; on a mixed rig each ends
    /// with its model ("x,y,z,pitch_deg,roll_deg,vlp-16;...").
    #[arg(
        long,
        group = "mounted",
        allow_hyphen_values = true,
        conflicts_with = "place",
        value_name = "LIST"
    )]
    masters: Option<Masters>,
    /// Models of the sensors of --mounts: one for all, or one for each, with commas between them. A model alone is one level
    /// sensor at the platform's origin.
    #[arg(long, value_delimiter = ',', conflicts_with_all = ["mount", "masters"], value_name = "MODEL,MODEL")]
    sensors: Vec<String>,
    /// Another model or the calibration of a sensor (of every one without NAME=): a name of the catalogue, Ouster
    /// metadata (.json), Velodyne calibration (.xml, .yaml), or MODEL:FILE. May be given several times.
    #[arg(long, value_name = "[NAME=]MODEL")]
    sensor: Vec<UnitChoice>,
    /// Surface (.ply, .obj, .stl, .off, .gltf or .glb), or what a map is made of: a recorded session, or a point cloud in the
    /// trajectory's frame (.ply without faces, .pcd, .las, .laz, .e57 or text).
    #[arg(long, group = "place", value_name = "PATH")]
    scene: Option<PathBuf>,
    /// A closed room instead: "x,y,z,x,y,z" of its min and max corner, m.
    #[arg(long, group = "place", allow_hyphen_values = true, value_name = "CORNERS")]
    room: Option<Room>,
    #[command(flatten)]
    experiment: ExperimentArgs,
    #[command(flatten)]
    scoring: experiment::ScoringArgs,
    #[command(flatten)]
    mesh: MeshArgs,
    #[command(flatten)]
    map: MapArgs,
    #[command(flatten)]
    trajectory: TrajectoryArgs,
    #[command(flatten)]
    ideal: ideal::IdealArgs,
    #[command(flatten)]
    sensing: sensing::SensingArgs,
    #[command(flatten)]
    samples: SampleArgs,
    /// Coefficients of the score in a scene: shares of the voxels that can be seen, or as published.
    #[arg(long, value_enum, default_value_t)]
    weights: WeightRule,
    /// Seed of everything random: noise and drop-out, drawn samples, the re-score.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// auto: in a scene, also measure what the model leaves out; in a published experiment, cast as many rays as it takes to
    /// know J within --tolerance. given: neither [default: auto; given for an experiment as published].
    #[arg(long)]
    fidelity: Option<FidelityArg>,
    /// Compare with single sensors, one level and the best one; in a scene by a tenth of the rays.
    #[arg(long)]
    baselines: bool,
    /// Coverage file (PLY): the voxel centres seen, one bit per sensor.
    #[arg(short, long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Write a page with pictures.
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
}

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    output::check_places([&args.out, &args.report, &args.ideal.covered_out])?;
    if args.scene.is_none() && args.room.is_none() {
        context.ensure_none_of::<MeshArgs>(WITHOUT_PLACE)?;
        context.ensure_none_of::<MapArgs>(WITHOUT_PLACE)?;
        context.ensure_none_of::<TrajectoryArgs>(WITHOUT_PLACE)?;
        context.ensure_none_of::<ideal::IdealArgs>(WITHOUT_PLACE)?;
        context.ensure_none_of::<sensing::SensingArgs>(WITHOUT_PLACE)?;
        context.ensure_none_of::<SampleArgs>(WITHOUT_PLACE)?;
        context.ensure_not_typed(&["mounts", "sensors", "sensor", "out", "weights"], WITHOUT_PLACE)?;
        return experiment::run(args, context);
    }
    context.ensure_none_of::<experiment::ScoringArgs>(IN_A_PLACE)?;
    context.ensure_not_typed(&ExperimentArgs::ONLY_PUBLISHED, IN_A_PLACE)?;
    context.ensure_not_typed(&["roll", "no_mirror"], IN_A_PLACE)?;
    context.ensure_not_typed(&["registration_weight", "min_conditioning"], REGISTRATION_IS_SHOWN)?;
    scene::run(args, context)
}

const WITHOUT_PLACE: &str = "is about a place of your own: add --scene or --room";
const REGISTRATION_IS_SHOWN: &str =
    "is about a search: in a scene `predict` states the registration strength as it is";
const IN_A_PLACE: &str = "is about a published experiment (--preset), and --scene or --room is another place";
