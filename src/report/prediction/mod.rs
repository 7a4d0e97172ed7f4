//! What a mount will see of a site: the JSON document and the report of it.

mod sections;

pub(crate) use sections::{Pictures, report};

use serde::Serialize;

use super::counted::Counted;
use super::{BlindSpot, MAX_BLIND_SPOTS, blind_spots};
use crate::design::registration::PathRegistration;
use crate::design::scene_search::WeightRule;
use crate::rig::{Conflicts, MountedSensor};
use crate::simulate::prediction::{Omission, Prediction, SceneBaselines, Site, unknown_share};
use crate::simulate::quality::Quality;
use crate::simulate::scan::Scanner;
use crate::world::coverage::VoxelGrid;
use crate::world::local_origin::LocalOrigin;
use crate::world::scene::{MapSummary, MeshSummary, Scene, VoxelMap};
use crate::world::surface::{ObservableSurface, SurfaceShares};

/// Union bitmaps are hashed up to this many cells.
const HASHED_CELLS: usize = 1 << 33;

/// The document of a prediction.
#[derive(Serialize)]
pub(crate) struct Document {
    pub sensors: Vec<SensorDocument>,
    /// Those that can be seen are the walls of a room; of a mesh what has an observable surface sample; of a map its occupied cells
    /// with a line of sight.
    #[serde(flatten)]
    pub counted: Counted,
    /// Neighbouring voxels that could be seen and are not, the largest groups first.
    pub blind_spots: Vec<BlindSpot>,
    /// Null unless asked for.
    pub baselines: Option<SceneBaselines>,
    /// Of a mesh.
    #[serde(flatten)]
    pub surface: Option<SurfaceDocument>,
    /// Of a recording or a cloud.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub map: Option<MapDocument>,
    rays: u64,
    returns: u64,
    /// Returns beyond the scene's bounds by more than half a voxel: range noise.
    outside_grid: u64,
    grid: GridDocument,
    /// Union bitmap; null for grids of more than 2^33 cells.
    coverage_sha256: Option<String>,
    #[serde(flatten)]
    pub registration: PathRegistration,
    /// Whether every pair of housings is apart.
    feasible: bool,
    #[serde(flatten)]
    pub conflicts: Conflicts,
    /// What the model leaves out; null unless asked for.
    pub left_out: Option<Vec<Omission>>,
    trajectory_length_m: f64,
    /// When a voxel counts, where that was asked for; `reachable_voxels` has no such limit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub quality: Option<Quality>,
    pub warnings: Vec<String>,
    /// Seconds that the rig's own scan took.
    pub wall_s: f64,
    /// With the single sensors as baselines and what the model leaves out.
    pub total_s: f64,
}

#[derive(Serialize)]
pub(crate) struct SensorDocument {
    pub name: String,
    pub model: String,
    pub columns: u32,
    pub rays: u64,
    pub returns: u64,
    pub voxels: u64,
    pub unique_voxels: u64,
}

/// The grid, in the frame of the scene's file.
#[derive(Serialize)]
pub(super) struct GridDocument {
    origin_m: [f64; 3],
    pub voxel_m: f64,
    cells: [usize; 3],
}

impl GridDocument {
    pub(crate) fn of(grid: &VoxelGrid, origin: LocalOrigin) -> Self {
        Self { origin_m: origin.world(grid.origin_m).to_array(), voxel_m: grid.voxel_m, cells: grid.cells }
    }
}

/// How much of a mesh's surface is covered.
#[derive(Serialize)]
pub(crate) struct SurfaceDocument {
    #[serde(flatten)]
    pub shares: SurfaceShares,
    pub observable_share: f64,
    samples: usize,
    pub mesh: MeshSummary,
}

/// What is known of the map.
#[derive(Serialize)]
pub(crate) struct MapDocument {
    #[serde(flatten)]
    pub summary: MapSummary,
    /// Share of the beams that cross a cell of which the map knows nothing before they hit something, or leave the map;
    /// null where the map does not tell free cells from unknown ones.
    pub unknown_share: Option<f64>,
}

impl MapDocument {
    fn new(scanner: &Scanner<'_>, map: &VoxelMap, summary: &MapSummary) -> Self {
        let unknown_share = summary.knows_free().then(|| unknown_share(scanner, map));
        Self { summary: summary.clone(), unknown_share }
    }

    /// In words, each with a label.
    fn figures(&self) -> impl Iterator<Item = (&'static str, String)> {
        let unknown = self
            .unknown_share
            .map(|share| ("unknown space", format!("{:.2} % of the beams go into it", 100.0 * share)));
        [("map", self.summary.words())].into_iter().chain(unknown)
    }
}

impl Document {
    /// Counts everything. `observable` are the voxels that can be seen from the trajectory, ascending.
    pub(crate) fn new(
        scanner: &Scanner<'_>,
        site: &Site,
        prediction: &Prediction,
        surface: Option<&ObservableSurface>,
        observable: &[usize],
        weights: WeightRule,
    ) -> Self {
        let coverage = &prediction.coverage;
        let counts = coverage.counts();
        let sensor = |(index, sensor): (usize, &MountedSensor)| SensorDocument {
            name: sensor.name.clone(),
            model: sensor.model.name.clone(),
            columns: scanner.spins[index].columns,
            rays: scanner.columns(index) * sensor.model.channels() as u64,
            returns: prediction.returns[index],
            voxels: counts.per_sensor[index],
            unique_voxels: counts.unique_per_sensor[index],
        };
        let sensors: Vec<_> = scanner.rig.sensors.iter().enumerate().map(sensor).collect();
        let seen = coverage.union_cells();
        let unseen = observable.iter().copied().filter(|cell| seen.binary_search(cell).is_err());
        let conflicts = scanner.rig.conflicts();
        let grid = coverage.grid();
        let loaded = &site.loaded;
        let shares = surface.zip(prediction.shares.clone()).zip(loaded.mesh.as_ref());
        Self {
            counted: Counted::new(scanner.rig, &counts, observable.len() as u64, weights),
            blind_spots: blind_spots(grid, unseen, MAX_BLIND_SPOTS)
                .into_iter()
                .map(|spot| spot.in_world(loaded.origin))
                .collect(),
            baselines: None,
            surface: shares.map(|((surface, shares), mesh)| SurfaceDocument {
                shares,
                observable_share: surface.observable_share(),
                samples: surface.samples.len(),
                mesh: mesh.clone(),
            }),
            map: match (&loaded.scene, &loaded.map) {
                (Scene::Voxels(map), Some(summary)) => Some(MapDocument::new(scanner, map, summary)),
                _ => None,
            },
            rays: sensors.iter().map(|sensor| sensor.rays).sum(),
            returns: prediction.returns.iter().sum(),
            outside_grid: coverage.outside(),
            grid: GridDocument::of(grid, loaded.origin),
            coverage_sha256: (grid.len() <= HASHED_CELLS).then(|| coverage.union_sha256()),
            registration: PathRegistration::of_scanner(scanner),
            feasible: conflicts.violations.is_empty(),
            conflicts,
            left_out: None,
            trajectory_length_m: scanner.trajectory.length_m(),
            quality: None,
            warnings: loaded.warnings.clone(),
            wall_s: 0.0,
            total_s: 0.0,
            sensors,
        }
    }
}
