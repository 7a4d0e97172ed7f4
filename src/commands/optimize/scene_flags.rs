//! What `optimize` is asked for about a scene.

use std::path::PathBuf;
use std::str::FromStr;

use sensors::catalogue;

use crate::commands::scene_args::{MeshArgs, Operator, QualityArgs, Room};
use crate::commands::scene_file::MapArgs;
use crate::design::scene_search::WeightRule;
use crate::recording::walk_text::WalkText;

/// All sensors that can be searched with.
fn sensors_help() -> String {
    format!(
        "Models of the sensors, with commas between them; two of a kind are a mirrored pair unless --no-mirror. Known are {} (* \
         has unverified parts); or a file of your own: a model file (.toml), a table of beams (.csv: elevation_deg, \
         rot_correction_deg, vertical_offset_m, fire_us) or a pattern (.csv: time, azimuth, zenith angle), MODEL:FILE with \
         limits and housing of a known one",
        catalogue::marked_names().join(", ")
    )
}

/// From the fewest sensors to the most.
#[derive(Clone, Copy, Debug)]
pub(super) struct Counts(pub usize, pub usize);

impl FromStr for Counts {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (first, last) = text.split_once("..").unwrap_or((text, text));
        match (first.trim().parse(), last.trim().parse()) {
            (Ok(first), Ok(last)) if 1 <= first && first <= last && last <= 8 => Ok(Self(first, last)),
            _ => Err(format!("{text:?}: give numbers of sensors from 1 to 8, such as 1..4")),
        }
    }
}

/// A scene and the trajectory through it; a walk is planned where there is none.
#[derive(Clone, Debug)]
pub(super) struct SiteArg {
    pub scene: PathBuf,
    pub trajectory: Option<WalkText>,
}

impl FromStr for SiteArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (scene, walk) = text.rsplit_once('=').map_or((text, None), |(scene, walk)| (scene, Some(walk)));
        if scene.is_empty() || walk.is_some_and(str::is_empty) {
            return Err(format!(
                "{text:?}: give SCENE=TRAJECTORY, such as house.ply=walk.tum, or SCENE alone"
            ));
        }
        Ok(Self { scene: scene.into(), trajectory: walk.map(str::parse).transpose()? })
    }
}

/// Arguments of a search in a scene.
#[derive(clap::Args, Debug)]
pub struct SceneSearchArgs {
    /// Search in this scene in place of a published experiment: a surface (.ply, .obj, .stl, .gltf or .glb), a recorded
    /// session, or a point cloud (.ply without faces, .pcd, .las or .laz).
    #[arg(long, value_name = "PATH", help_heading = "Scene")]
    pub(super) scene: Option<PathBuf>,
    /// A closed room instead: "x,y,z,x,y,z" of its minimum and maximum corner, m.
    #[arg(
        long,
        allow_hyphen_values = true,
        conflicts_with = "scene",
        value_name = "CORNERS",
        help_heading = "Scene"
    )]
    pub(super) room: Option<Room>,
    /// A scene and its trajectory; several: one mount for all (see --robust).
    #[arg(long, value_name = "SCENE=WALK", conflicts_with_all = ["scene", "room", "trajectory"], help_heading = "Scene")]
    pub(super) site: Vec<SiteArg>,
    #[command(flatten)]
    pub(super) mesh: MeshArgs,
    #[command(flatten)]
    pub(super) map: MapArgs,
    /// Trajectory of the body through the scene: a TUM file, a KITTI file with --rate, or waypoints "x,y x,y ..." that are
    /// walked 1.6 m above the floor ("x,y,z" gives the height of the rig) [default: a walk through all of the free floor].
    #[arg(long, value_name = "WALK", allow_hyphen_values = true, help_heading = "Scene")]
    pub(super) trajectory: Option<WalkText>,
    /// Poses per second of a trajectory in KITTI format.
    #[arg(long, value_name = "HZ", help_heading = "Scene", value_parser = crate::commands::ranges::within(1e-3, 1e6))]
    pub(super) rate: Option<f64>,
    /// Write the trajectory as it was used (TUM).
    #[arg(long, value_name = "FILE.tum", help_heading = "Output")]
    pub(super) trajectory_out: Option<PathBuf>,
    #[arg(long, value_delimiter = ',', value_name = "MODEL,MODEL", help_heading = "Model", help = sensors_help())]
    pub(super) sensors: Vec<String>,
    /// Search with each number of sensors from A to B, all of the one model of --sensors, and compare what they see.
    #[arg(long, value_name = "A..B", conflicts_with = "resume", help_heading = "Model")]
    pub(super) count: Option<Counts>,
    /// Search with ideal beams, as `predict --ideal` has them.
    #[arg(long, help_heading = "Model")]
    pub(super) ideal: bool,
    /// The operator, who shades beams: "x,y,z,x,y,z,radius", the ends of a capsule in the body frame (x forward, y left, z up), m.
    /// Housings of the other sensors shade, too, unless --ideal.
    #[arg(long, allow_hyphen_values = true, value_name = "CAPSULE", help_heading = "Model")]
    pub(super) operator: Option<Operator>,
    #[command(flatten)]
    pub(super) quality: QualityArgs,
    /// Judge by every N-th revolution [default: by the number of beams].
    #[arg(long, value_name = "N", help_heading = "Model", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub(super) scan_stride: Option<u32>,
    /// Coefficients of the score: the published ones as shares of the voxels that can be seen here, or as they are.
    #[arg(long, value_enum, default_value_t, help_heading = "Model")]
    pub(super) weights: WeightRule,
    /// The present mount: it is judged with the best one.
    #[arg(long, value_name = "MOUNT.json", help_heading = "Scene")]
    pub(super) present: Option<PathBuf>,
}
