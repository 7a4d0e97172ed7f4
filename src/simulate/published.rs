//! The published experiment, exactly as its released program runs it: a closed box, a straight walk, sensors that are
//! mirrored across the platform's plane of symmetry.
//!
//! Definition (method: "Mixed Discrete-Continuous Constrained Optimization of Symmetric Multi-LiDAR Mount
//! Configurations for Mapping Systems", section 4.2, and its released program where the two differ). Coordinates are
//! the mount frame's. A ray's hit is the exit point of the box, each coordinate clamped to a quarter voxel inside;
//! the voxel is `floor(coordinate / voxel)`. A ray with a world direction component that is exactly zero is lost: a
//! quirk of the released slab test, kept here ([`Preset::loses_axis_parallel_rays`]) and nowhere else in the program.

mod brute;
mod divergence;
mod fast;
mod shell;
mod sparse;

pub use divergence::PUBLISHED_DIVERGENCE_RAD;

use crate::coverage::{Counts, Coverage, VoxelGrid};
use crate::rig::Mount;

/// A published experiment as data.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Preset {
    /// Name on the command line.
    pub name: &'static str,
    /// Sensor model whose housing counts.
    pub model: &'static str,
    /// Beams, evenly spaced.
    pub beams: usize,
    /// From the lowest to the highest beam, degrees.
    pub field_of_view_deg: f64,
    /// Columns per revolution.
    pub azimuths: usize,
    /// Least corner of the box, m.
    pub box_min_m: [f64; 3],
    /// Greatest corner of the box, m.
    pub box_max_m: [f64; 3],
    /// Length of the walk, centred in the box, m.
    pub path_length_m: f64,
    /// Height of the platform's origin, m.
    pub platform_height_m: f64,
    /// Edge of a voxel, m.
    pub voxel_m: f64,
    /// Whether rays with a zero direction component are lost.
    pub loses_axis_parallel_rays: bool,
}

/// Ouster OS1-64 in the published experiment.
const OS1_64: Preset = Preset {
    name: "paper-os1-64",
    model: "os1-64",
    beams: 64,
    field_of_view_deg: 42.4,
    azimuths: 180,
    box_min_m: [-25.0, -25.0, 0.0],
    box_max_m: [25.0, 25.0, 20.0],
    path_length_m: 40.0,
    platform_height_m: 1.6,
    voxel_m: 0.5,
    loses_axis_parallel_rays: true,
};

/// Velodyne VLP-16 in the published experiment.
const VLP_16: Preset =
    Preset { name: "paper-vlp-16", model: "vlp-16", beams: 16, field_of_view_deg: 30.0, ..OS1_64 };

/// Every preset.
pub const PRESETS: &[Preset] = &[OS1_64, VLP_16];

impl Preset {
    /// By name.
    pub fn named(name: &str) -> Result<&'static Self, ExperimentError> {
        PRESETS
            .iter()
            .find(|preset| preset.name == name)
            .ok_or_else(|| ExperimentError::UnknownPreset { name: name.to_owned(), known: Self::names() })
    }

    /// Names of all presets, for messages.
    pub fn names() -> String {
        PRESETS.iter().map(|preset| preset.name).collect::<Vec<_>>().join(", ")
    }
}

/// Along which axis of the mount frame the platform walks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Path {
    /// x: sideways, as the released program runs it.
    #[default]
    Lateral,
    /// y: ahead, as the text describes it.
    Forward,
}

impl Path {
    fn axis(self) -> usize {
        match self {
            Path::Lateral => 0,
            Path::Forward => 1,
        }
    }
}

/// What happens to the roll of a mount.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Roll {
    /// Replaced by this angle, degrees.
    Fixed(f64),
    /// Taken as it is.
    Free,
}

/// Where the first azimuth of each revolution lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Phase {
    /// At zero at every pose, as published: the pattern repeats from pose to pose.
    #[default]
    Locked,
    /// Moved on by the golden ratio of an azimuth step from pose to pose: no two poses share a pattern. Rays with a
    /// zero direction component are then not lost.
    Free,
}

/// One sensor of the published decision vector; angles in degrees, because the published rotations are exact at
/// multiples of 90 degrees.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Placement {
    /// Right of the platform's origin, m.
    pub x_m: f64,
    /// Ahead of it, m.
    pub y_m: f64,
    /// Above it, m.
    pub z_m: f64,
    /// About the forward axis, degrees.
    pub pitch_deg: f64,
    /// About the lateral axis, degrees.
    pub roll_deg: f64,
}

impl Placement {
    /// The mirror image across the platform's plane of symmetry (YZ).
    pub fn mirrored(&self) -> Self {
        Self { x_m: -self.x_m, pitch_deg: -self.pitch_deg, ..*self }
    }

    /// The same in radians.
    pub fn mount(&self) -> Mount {
        Mount {
            x_m: self.x_m,
            y_m: self.y_m,
            z_m: self.z_m,
            pitch_rad: self.pitch_deg.to_radians(),
            roll_rad: self.roll_deg.to_radians(),
        }
    }

    /// `Rx(roll) * Ry(pitch)`, row by row, in the published order of operations.
    pub(crate) fn rotation_rows(&self) -> [[f64; 3]; 3] {
        let (sp, cp) = sin_cos_deg(self.pitch_deg);
        let (sr, cr) = sin_cos_deg(self.roll_deg);
        [[cp, 0.0, sp], [sr * sp, cr, -sr * cp], [-cr * sp, sr, cr * cp]]
    }

    /// The spin axis (+z of the sensor) in the mount frame.
    pub fn spin_axis(&self) -> [f64; 3] {
        self.rotation_rows().map(|row| row[2])
    }
}

impl From<[f64; 5]> for Placement {
    /// From `[x_m, y_m, z_m, pitch_deg, roll_deg]`.
    fn from([x_m, y_m, z_m, pitch_deg, roll_deg]: [f64; 5]) -> Self {
        Self { x_m, y_m, z_m, pitch_deg, roll_deg }
    }
}

impl From<Placement> for [f64; 5] {
    fn from(placement: Placement) -> Self {
        [placement.x_m, placement.y_m, placement.z_m, placement.pitch_deg, placement.roll_deg]
    }
}

/// Sine and cosine of an angle in degrees, exact at multiples of 90.
fn sin_cos_deg(angle_deg: f64) -> (f64, f64) {
    if angle_deg % 90.0 == 0.0 {
        match (angle_deg / 90.0).rem_euclid(4.0) as u8 {
            0 => (0.0, 1.0),
            1 => (1.0, 0.0),
            2 => (0.0, -1.0),
            _ => (-1.0, 0.0),
        }
    } else {
        angle_deg.to_radians().sin_cos()
    }
}

/// A preset with what may be changed about it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Experiment {
    /// What stays.
    pub preset: Preset,
    /// Direction of the walk.
    pub path: Path,
    /// Edge of a voxel, m: 5 m divided by a whole number.
    pub voxel_m: f64,
    /// Columns per revolution.
    pub azimuths: usize,
    /// What happens to the roll of masters.
    pub roll: Roll,
    /// Whether every master gets a mirror image.
    pub mirror: bool,
    /// Poses per metre of the walk.
    pub sub_poses: usize,
    /// Where each revolution starts.
    pub phase: Phase,
    /// Where the first one starts, shares of an azimuth step; only where the phase is free.
    pub phase_shift: f64,
}

impl Experiment {
    /// The preset as published: path lateral, roll fixed at 0, mirrored, one pose per metre, phase locked.
    pub fn published(preset: &Preset) -> Self {
        Self {
            preset: *preset,
            path: Path::Lateral,
            voxel_m: preset.voxel_m,
            azimuths: preset.azimuths,
            roll: Roll::Fixed(0.0),
            mirror: true,
            sub_poses: 1,
            phase: Phase::Locked,
            phase_shift: 0.0,
        }
    }

    /// Every physical sensor of these masters: roll rule applied, each master followed by its mirror image.
    pub fn sensors(&self, masters: &[Placement]) -> Vec<Placement> {
        let mut sensors = Vec::with_capacity(masters.len() * (1 + usize::from(self.mirror)));
        for master in masters {
            let roll_deg = match self.roll {
                Roll::Fixed(roll_deg) => roll_deg,
                Roll::Free => master.roll_deg,
            };
            let sensor = Placement { roll_deg, ..*master };
            sensors.push(sensor);
            if self.mirror {
                sensors.push(sensor.mirrored());
            }
        }
        sensors
    }

    /// Whether the roll rule changes one of these masters.
    pub fn replaces_a_roll(&self, masters: &[Placement]) -> bool {
        match self.roll {
            Roll::Fixed(roll_deg) => masters.iter().any(|master| master.roll_deg != roll_deg),
            Roll::Free => false,
        }
    }

    /// Number of poses.
    pub fn poses(&self) -> usize {
        (self.preset.path_length_m * self.sub_poses as f64).round() as usize + 1
    }

    /// Rays of one sensor over the whole walk.
    pub fn rays_per_sensor(&self) -> u64 {
        self.poses() as u64 * self.azimuths as u64 * self.preset.beams as u64
    }
}

/// An experiment made ready: beams, poses and grid. Sensors are then seen in turn.
#[derive(Clone, Debug)]
pub struct Simulator {
    experiment: Experiment,
    cells: [usize; 3],
    /// Voxel index of the box's least corner.
    base: [f64; 3],
    /// Elevations as sine and cosine, lowest beam first.
    elevations: Vec<[f64; 2]>,
    /// Place of each pose on the walk, m from its middle.
    stations_m: Vec<f64>,
    /// Tables of the fast way, where the experiment allows it.
    plan: Option<fast::Plan>,
}

impl Simulator {
    /// Checks the experiment and prepares its tables.
    pub fn new(experiment: &Experiment) -> Result<Self, ExperimentError> {
        let preset = &experiment.preset;
        let voxel_m = experiment.voxel_m;
        if !(voxel_m.is_finite() && voxel_m > 0.0) {
            return Err(ExperimentError::Voxel { voxel_m });
        }
        let mut cells = [0; 3];
        let mut base = [0.0; 3];
        for axis in 0..3 {
            let low = whole(preset.box_min_m[axis] / voxel_m);
            let high = whole(preset.box_max_m[axis] / voxel_m);
            let (Some(low), Some(high)) = (low, high) else {
                return Err(ExperimentError::Voxel { voxel_m });
            };
            base[axis] = low;
            cells[axis] = (high - low) as usize;
        }
        const MOST_CELLS: usize = 1 << 30;
        if cells.iter().try_fold(1usize, |all, n| all.checked_mul(*n)).is_none_or(|all| all > MOST_CELLS) {
            return Err(ExperimentError::TooManyVoxels { voxel_m });
        }
        if !(1..=1 << 20).contains(&experiment.azimuths) {
            return Err(ExperimentError::Azimuths { azimuths: experiment.azimuths });
        }
        if !(1..=1000).contains(&experiment.sub_poses) {
            return Err(ExperimentError::SubPoses { sub_poses: experiment.sub_poses });
        }
        if let Roll::Fixed(roll_deg) = experiment.roll
            && !roll_deg.is_finite()
        {
            return Err(ExperimentError::NotFinite { what: "the fixed roll".into() });
        }
        let half_deg = preset.field_of_view_deg / 2.0;
        let spacing_deg = preset.field_of_view_deg / (preset.beams - 1) as f64;
        let elevations = (0..preset.beams)
            .map(|beam| {
                let (sin, cos) = (-half_deg + beam as f64 * spacing_deg).to_radians().sin_cos();
                [sin, cos]
            })
            .collect();
        let start_m = -preset.path_length_m / 2.0;
        let stations_m =
            (0..experiment.poses()).map(|pose| start_m + pose as f64 / experiment.sub_poses as f64).collect();
        let mut simulator = Self { experiment: *experiment, cells, base, elevations, stations_m, plan: None };
        simulator.plan = fast::Plan::new(&simulator);
        Ok(simulator)
    }

    /// The experiment.
    pub fn experiment(&self) -> &Experiment {
        &self.experiment
    }

    /// The grid, in the mount frame's axes, walls on voxel faces.
    pub fn grid(&self) -> VoxelGrid {
        VoxelGrid {
            origin_m: self.experiment.preset.box_min_m.into(),
            voxel_m: self.experiment.voxel_m,
            cells: self.cells,
        }
    }

    /// Voxels that any ray could hit: those along the faces of the box.
    pub fn reachable(&self) -> u64 {
        let all: usize = self.cells.iter().product();
        let inner: usize = self.cells.iter().map(|n| n.saturating_sub(2)).product();
        (all - inner) as u64
    }

    /// Which voxels each sensor sees.
    pub fn see(&self, sensors: &[Placement]) -> Result<Seen, ExperimentError> {
        let Some(plan) = &self.plan else {
            return self.coverage_by_definition(sensors);
        };
        self.check(sensors)?;
        let shells = fast::see(self, plan, sensors);
        let bitmaps = shells.iter().map(|shell| self.bitmap(shell)).collect();
        let lost_rays = sensors.iter().map(|sensor| brute::lost_rays(self, sensor)).collect();
        Ok(Seen { coverage: Coverage::from_bitmaps(self.grid(), bitmaps), lost_rays })
    }

    /// How many voxels the sensors see: the counts of [`Simulator::see`] without its bitmaps.
    pub fn count(&self, sensors: &[Placement]) -> Result<Counts, ExperimentError> {
        let Some(plan) = &self.plan else {
            return Ok(self.coverage_by_definition(sensors)?.coverage.counts());
        };
        self.check(sensors)?;
        Ok(fast::counts(&fast::see(self, plan, sensors)))
    }

    fn bitmap(&self, shell: &shell::Shell) -> Vec<u64> {
        let [nx, ny, nz] = self.cells;
        let mut bitmap = vec![0u64; (nx * ny * nz).div_ceil(64)];
        for [u, w, z] in shell.voxels() {
            let (x, y) = if self.experiment.path == Path::Lateral { (u, w) } else { (w, u) };
            let index = x + nx * (y + ny * z);
            bitmap[index / 64] |= 1 << (index % 64);
        }
        bitmap
    }

    /// Which voxels each sensor sees, straight from the definition: every ray at every pose.
    pub fn coverage_by_definition(&self, sensors: &[Placement]) -> Result<Seen, ExperimentError> {
        self.check(sensors)?;
        let (bitmaps, lost_rays) = sensors.iter().map(|sensor| brute::see(self, sensor)).unzip();
        Ok(Seen { coverage: Coverage::from_bitmaps(self.grid(), bitmaps), lost_rays })
    }

    fn check(&self, sensors: &[Placement]) -> Result<(), ExperimentError> {
        if sensors.is_empty() {
            return Err(ExperimentError::NoSensors);
        }
        let preset = &self.experiment.preset;
        for (index, sensor) in sensors.iter().enumerate() {
            for (name, value) in
                ["x_m", "y_m", "z_m", "pitch_deg", "roll_deg"].iter().zip(<[f64; 5]>::from(*sensor))
            {
                if !value.is_finite() {
                    return Err(ExperimentError::NotFinite {
                        what: format!("{name} of sensor {}", index + 1),
                    });
                }
            }
            let position_m = [sensor.x_m, sensor.y_m, sensor.z_m + preset.platform_height_m];
            let walls_m = preset.box_min_m.iter().zip(preset.box_max_m);
            for (axis, (at_m, (low_m, high_m))) in position_m.iter().zip(walls_m).enumerate() {
                let half_path_m =
                    if axis == self.experiment.path.axis() { preset.path_length_m / 2.0 } else { 0.0 };
                if at_m - half_path_m <= *low_m || at_m + half_path_m >= high_m {
                    return Err(ExperimentError::OutsideBox { sensor: index + 1 });
                }
            }
        }
        Ok(())
    }
}

/// What sensors saw.
#[derive(Clone, Debug, PartialEq)]
pub struct Seen {
    /// Voxels by sensor.
    pub coverage: Coverage,
    /// Rays that the quirk lost, by sensor.
    pub lost_rays: Vec<u64>,
}

fn whole(value: f64) -> Option<f64> {
    let rounded = value.round();
    ((value - rounded).abs() < 1e-9 && rounded.abs() < 1e9).then_some(rounded)
}

/// What can be wrong with an experiment or the sensors in it.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum ExperimentError {
    /// No preset of that name.
    #[error("no preset is called {name:?}; known are {known}")]
    UnknownPreset {
        /// As asked for.
        name: String,
        /// All that exist.
        known: String,
    },
    /// Walls would not lie on voxel faces.
    #[error(
        "voxels of {voxel_m} m do not fill the box: give 5 m divided by a whole number (1, 0.5, 0.25, 0.2 ...)"
    )]
    Voxel {
        /// As asked for.
        voxel_m: f64,
    },
    /// The grid would not fit in memory.
    #[error("voxels of {voxel_m} m make more than 2^30 cells: give larger voxels")]
    TooManyVoxels {
        /// As asked for.
        voxel_m: f64,
    },
    /// No or too many columns.
    #[error("{azimuths} azimuths: give 1 to 1048576")]
    Azimuths {
        /// As asked for.
        azimuths: usize,
    },
    /// No or too many poses.
    #[error("{sub_poses} poses per metre: give 1 to 1000")]
    SubPoses {
        /// As asked for.
        sub_poses: usize,
    },
    /// A number is not one.
    #[error("{what} is not a finite number")]
    NotFinite {
        /// Which.
        what: String,
    },
    /// A sensor would leave the box on its way.
    #[error("sensor {sensor} does not stay inside the box along the whole walk")]
    OutsideBox {
        /// Position in the list, from 1.
        sensor: usize,
    },
    /// Nothing to look with.
    #[error("no sensors: give at least one")]
    NoSensors,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quarter_turns_are_exact() {
        for (angle_deg, expected) in [
            (0.0, (0.0, 1.0)),
            (90.0, (1.0, 0.0)),
            (180.0, (0.0, -1.0)),
            (-90.0, (-1.0, 0.0)),
            (450.0, (1.0, 0.0)),
        ] {
            assert_eq!(sin_cos_deg(angle_deg), expected, "{angle_deg}");
        }
    }

    #[test]
    fn experiments_that_make_no_sense_are_refused() {
        let good = Experiment::published(&OS1_64);
        for (bad, words) in [
            (Experiment { voxel_m: 0.3, ..good }, "0.3 m do not fill"),
            (Experiment { voxel_m: f64::NAN, ..good }, "NaN m"),
            (Experiment { voxel_m: 0.001, ..good }, "2^30"),
            (Experiment { azimuths: 0, ..good }, "0 azimuths"),
            (Experiment { sub_poses: 0, ..good }, "0 poses"),
            (Experiment { roll: Roll::Fixed(f64::INFINITY), ..good }, "fixed roll"),
        ] {
            let error = Simulator::new(&bad).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
        let simulator = Simulator::new(&good).unwrap();
        assert_eq!(simulator.reachable(), 35_048);
        let outside = Placement { x_m: 5.0, ..Placement::default() };
        assert_eq!(
            simulator.coverage_by_definition(&[outside]).unwrap_err(),
            ExperimentError::OutsideBox { sensor: 1 }
        );
        let nan = Placement { pitch_deg: f64::NAN, ..Placement::default() };
        assert!(
            simulator
                .coverage_by_definition(&[nan])
                .unwrap_err()
                .to_string()
                .contains("pitch_deg of sensor 1")
        );
        assert_eq!(simulator.coverage_by_definition(&[]).unwrap_err(), ExperimentError::NoSensors);
    }

    /// Poses between metres, odd numbers of azimuths, free phases: what no published number covers.
    #[test]
    fn the_fast_way_is_the_definition_wherever_it_goes() {
        let masters = [[0.0604, 0.21, -0.08, 32.7, 0.0], [0.07, 0.17, -0.05, -41.3, 7.0], [0.0; 5]];
        for path in [Path::Lateral, Path::Forward] {
            for (sub_poses, phase, azimuths) in [
                (2, Phase::Locked, 36),
                (3, Phase::Locked, 25),
                (8, Phase::Locked, 12),
                (1, Phase::Free, 30),
                (3, Phase::Free, 11),
            ] {
                let experiment = Experiment {
                    path,
                    sub_poses,
                    phase,
                    azimuths,
                    roll: Roll::Free,
                    ..Experiment::published(&VLP_16)
                };
                let simulator = Simulator::new(&experiment).unwrap();
                let sensors = experiment.sensors(&masters.map(Placement::from));
                let fast = simulator.see(&sensors).unwrap();
                let definition = simulator.coverage_by_definition(&sensors).unwrap();
                assert_eq!(fast.lost_rays, definition.lost_rays, "{experiment:?}");
                assert!(fast == definition, "{experiment:?}");
                assert_eq!(simulator.count(&sensors).unwrap(), definition.coverage.counts());
            }
        }
    }
}
