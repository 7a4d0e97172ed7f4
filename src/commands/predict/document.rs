//! What `predict` says: the JSON document, the summary, the coverage file.

use serde::Serialize;

use super::Place;
use super::left_out::LeftOut;
use super::scan::{Alone, Scanned, unknown_share};
use crate::commands::baselines::Baselines;
use crate::commands::ground::MeshTaken;
use crate::commands::output;
use crate::commands::registration::{Tied, along_way};
use crate::commands::scene_file::MapTaken;
use crate::commands::surface::{Covered, Surface};
use crate::design::registration::RegistrationQuality;
use crate::report::{BlindSpot, blind_spots};
use crate::rig::{Clearance, MountedSensor, Rig, Touching};
use crate::simulate::scan::Scanner;
use crate::world::coverage::Coverage;
use crate::world::scene::{Scene, VoxelMap};

/// Union bitmaps are hashed up to this many cells.
const HASHED_CELLS: usize = 1 << 33;
/// Blind spots listed, the largest first.
const MOST_BLIND_SPOTS: usize = 10;

/// The document that `predict` prints.
#[derive(Serialize)]
pub struct Document {
    pub sensors: Vec<SensorDocument>,
    pub unique_voxels: u64,
    /// Voxels that could be seen from the path: the walls of a room; of a mesh what has an observable surface
    /// sample; of a map its occupied cells with a line of sight.
    pub reachable_voxels: u64,
    pub overlap_ratio: f64,
    /// Neighbouring voxels that could be seen and are not, the largest groups first.
    pub blind_spots: Vec<BlindSpot>,
    /// Null where they were left out.
    pub baselines: Option<Baselines<Alone>>,
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
    pub tied: Tied,
    /// Whether every pair of housings is apart.
    feasible: bool,
    /// Pairs that are not.
    pub violations: Vec<Clearance>,
    /// Pairs of housings that touch as they are tilted, far apart as their origins may be.
    pub touching: Vec<Touching>,
    /// What the model leaves out; null unless asked for.
    pub left_out: Option<Vec<LeftOut>>,
    trajectory_length_m: f64,
    pub warnings: Vec<String>,
    /// Seconds that the rig's own scan took.
    wall_s: f64,
    /// With the single sensors beside it and what the model leaves out.
    pub total_s: f64,
}

#[derive(Serialize)]
pub struct SensorDocument {
    pub name: String,
    pub model: String,
    pub columns: u32,
    pub rays: u64,
    pub returns: u64,
    pub voxels: u64,
    pub unique_voxels: u64,
}

#[derive(Serialize)]
struct GridDocument {
    origin_m: [f64; 3],
    voxel_m: f64,
    cells: [usize; 3],
}

/// How much of a mesh's surface is covered.
#[derive(Serialize)]
pub struct SurfaceDocument {
    #[serde(flatten)]
    pub covered: Covered,
    pub observable_share: f64,
    samples: usize,
    pub mesh: MeshTaken,
}

/// What is known of the place.
#[derive(Serialize)]
pub struct MapDocument {
    #[serde(flatten)]
    pub taken: MapTaken,
    /// Share of the beams that cross a cell of which the map knows nothing before they hit something, or leave the map;
    /// null where the map does not tell free cells from unknown ones.
    pub unknown_share: Option<f64>,
}

impl MapDocument {
    fn new(scanner: &Scanner<'_>, map: &VoxelMap, taken: &MapTaken) -> Self {
        let unknown_share = taken.knows_free().then(|| unknown_share(scanner, map));
        Self { taken: taken.clone(), unknown_share }
    }

    /// In words.
    pub fn line(&self) -> String {
        let unknown = self.unknown_share.map_or(String::new(), |share| {
            format!("{:15}{:.2} % of the beams go where nobody has looked\n", "", 100.0 * share)
        });
        self.taken.line() + &unknown
    }
}

impl Document {
    /// Counts everything.
    pub fn new(
        scanner: &Scanner<'_>,
        place: &Place,
        scanned: &Scanned,
        surface: Option<&Surface>,
        reachable: &[usize],
        baselines: Option<Baselines<Alone>>,
        wall_s: f64,
    ) -> Self {
        let coverage = &scanned.coverage;
        let counts = coverage.counts();
        let sensor = |(index, sensor): (usize, &MountedSensor)| SensorDocument {
            name: sensor.name.clone(),
            model: sensor.model.name.clone(),
            columns: scanner.spins[index].columns,
            rays: scanner.columns(index) * sensor.model.channels() as u64,
            returns: scanned.returns[index],
            voxels: counts.per_sensor[index],
            unique_voxels: counts.unique_per_sensor[index],
        };
        let sensors: Vec<_> = scanner.rig.sensors.iter().enumerate().map(sensor).collect();
        let seen = coverage.union_cells();
        let unseen = reachable.iter().copied().filter(|cell| seen.binary_search(cell).is_err());
        let violations: Vec<_> =
            scanner.rig.clearances(0.0).into_iter().filter(|pair| !pair.is_kept()).collect();
        let grid = coverage.grid();
        let covered = surface.zip(scanned.covered.clone()).zip(place.mesh.as_ref());
        Self {
            unique_voxels: counts.union,
            reachable_voxels: reachable.len() as u64,
            overlap_ratio: counts.overlap_ratio(),
            blind_spots: blind_spots(grid, unseen, MOST_BLIND_SPOTS),
            baselines,
            surface: covered.map(|((surface, covered), (_, mesh))| SurfaceDocument {
                covered,
                observable_share: surface.observable_share(),
                samples: surface.samples.len(),
                mesh: mesh.clone(),
            }),
            map: match (&place.scene, &place.map) {
                (Scene::Voxels(map), Some(taken)) => Some(MapDocument::new(scanner, map, taken)),
                _ => None,
            },
            rays: sensors.iter().map(|sensor| sensor.rays).sum(),
            returns: scanned.returns.iter().sum(),
            outside_grid: coverage.outside(),
            grid: GridDocument {
                origin_m: grid.origin_m.to_array(),
                voxel_m: grid.voxel_m,
                cells: grid.cells,
            },
            coverage_sha256: (grid.len() <= HASHED_CELLS).then(|| coverage.union_sha256()),
            tied: along_way(scanner),
            feasible: violations.is_empty(),
            violations,
            touching: scanner.rig.touching(),
            left_out: None,
            trajectory_length_m: scanner.trajectory.length_m(),
            warnings: place.warnings.clone(),
            wall_s,
            total_s: wall_s,
            sensors,
        }
    }

    /// The result in words.
    pub fn summary(&self) -> String {
        let mut text = format!(
            "{:.2} m of way, {} rays, {} returns\n\
             voxels seen    {} of {} of {} m that can be seen, {:.2} % of them by two sensors or more\n\
             sensor                 model      columns   returns   voxels    alone\n",
            self.trajectory_length_m,
            self.rays,
            self.returns,
            self.unique_voxels,
            self.reachable_voxels,
            self.grid.voxel_m,
            100.0 * self.overlap_ratio,
        );
        for sensor in &self.sensors {
            text += &format!(
                "{:22} {:10}{:8}{:10}{:9}{:9}\n",
                sensor.name,
                sensor.model,
                sensor.columns,
                sensor.returns,
                sensor.voxels,
                sensor.unique_voxels
            );
        }
        for (name, single) in self.baselines.iter().flat_map(Baselines::named) {
            text += &format!(
                "{name:15}{} at pitch {:.0}: {} voxels; the rig sees {:+}\n",
                single.model, single.pitch_deg, single.seen.unique_voxels, single.seen.gain_voxels
            );
        }
        if let (Some(baselines), true) = (&self.baselines, self.surface.is_some()) {
            text += &format!("{:15}best by {}\n", "", baselines.search_by);
        }
        if let Some(surface) = &self.surface {
            text += &surface.mesh.line();
            text += &format!(
                "observable     {:.3} % of {} surface samples\n{:15}   2 cm    5 cm   10 cm  of observable at 5 cm (all in %)\n",
                100.0 * surface.observable_share,
                surface.samples,
                ""
            );
            let line = |name: &str, covered: &Covered| format!("{name:15}{}\n", covered.percent().join("  "));
            text += &line("rig", &surface.covered);
            for (name, single) in self.baselines.iter().flat_map(Baselines::named) {
                text += &single.seen.covered.as_ref().map_or(String::new(), |covered| line(name, covered));
            }
        }
        text += &self.map.as_ref().map_or(String::new(), MapDocument::line);
        text += &self.tied.registration.as_ref().map_or(String::new(), RegistrationQuality::line);
        for left in self.left_out.iter().flatten() {
            text += &format!("left out       {}\n", left.words());
        }
        text += &output::cannot_be_built(&self.violations, &self.touching);
        text + &format!("{:.2} s, {:.2} s of it for the rig\n", self.total_s, self.wall_s)
    }
}

/// Voxel centres with one bit per sensor.
pub fn ply(coverage: &Coverage, rig: &Rig) -> Vec<u8> {
    let grid = coverage.grid();
    let cells = coverage.union_cells();
    let [x, y, z] = grid.origin_m.to_array();
    let [nx, ny, nz] = grid.cells;
    let mut text = format!(
        "ply\nformat binary_little_endian 1.0\n\
         comment outrigger coverage, world frame, metres\n\
         comment grid origin {x} {y} {z} voxel {} cells {nx} {ny} {nz}\n",
        grid.voxel_m
    );
    for (bit, sensor) in rig.sensors.iter().enumerate() {
        let name: String = sensor.name.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
        text += &format!("comment sensors bit {bit}: {name}\n");
    }
    text += &format!(
        "element vertex {}\nproperty double x\nproperty double y\nproperty double z\nproperty uint sensors\nend_header\n",
        cells.len()
    );
    let mut bytes = text.into_bytes();
    for cell in cells {
        for value in grid.centre_m(cell).to_array() {
            bytes.extend(value.to_le_bytes());
        }
        let seen_by = |mask, sensor| mask | u32::from(coverage.contains(sensor, cell)) << sensor;
        bytes.extend((0..rig.sensors.len()).fold(0u32, seen_by).to_le_bytes());
    }
    bytes
}
