//! The published experiment, exactly as its released program runs it: a closed box, a straight walk, sensors that are
//! mirrored across the platform's plane of symmetry.
//!
//! Definition (method: "Mixed Discrete-Continuous Constrained Optimization of Symmetric Multi-LiDAR Mount
//! Configurations for Mapping Systems", section 4.2, and its released program where the two differ). Coordinates are
//! the mount frame's. A ray's hit is the exit point of the box, each coordinate clamped to a quarter voxel inside;
//! the voxel is `floor(coordinate / voxel)`. A ray with a world direction component that is exactly zero is lost: a
//! quirk of the released slab test, reproduced here ([`Preset::loses_axis_parallel_rays`]) and nowhere else.

mod anywhere;
mod brute;
mod experiment;
mod fast;
mod elements;
mod mixed;
mod region;
mod shell;
mod sparse;
mod spread;
mod view;

pub use spread::PUBLISHED_SPREAD_DEG;

pub use experiment::{Experiment, ExperimentError, MOST_TYPES, MoreTypes, PRESETS, Preset};
pub use region::Reach;

use rayon::iter::{IntoParallelRefIterator as _, ParallelIterator as _};

use crate::base::instructions::Instructions;
use crate::rig::{MountDeg, Path, Phase, Roll};
use crate::world::coverage::{Counts, Coverage, VoxelGrid};

/// An experiment made ready: beams, poses and grid. Sensors are then seen in turn, each with the beams of its type.
#[derive(Clone, Debug)]
pub struct PublishedBox {
    experiment: Experiment,
    cells: [usize; 3],
    /// Voxel index of the box's least corner.
    base: [f64; 3],
    /// Elevations as sine and cosine, lowest beam first.
    elevations: Vec<[f64; 2]>,
    /// Place of each pose on the walk, m from its middle.
    stations_m: Vec<f64>,
    /// Tables of the fast method, where the experiment allows it.
    plan: Option<fast::Plan>,
    /// Tables of the method for any poses, where the numbers fit.
    faces: Option<anywhere::Faces>,
    /// The same box and walk with the beams of types 1, 2 ...; all else here is about type 0.
    more_types: Vec<PublishedBox>,
}

/// A sensor in the box, in the mount frame's axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoxPose {
    /// Rotation from the sensor, row by row.
    pub rows: [[f64; 3]; 3],
    /// Where it is, m.
    pub origin_m: [f64; 3],
    /// What is added to every azimuth, in steps from azimuth to azimuth.
    pub turn: f64,
}

impl PublishedBox {
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
        let more = experiment.types().skip(1);
        let more_types =
            more.map(|preset| Self::new(&experiment.of_type(preset))).collect::<Result<_, _>>()?;
        let mut simulator = Self {
            experiment: *experiment,
            cells,
            base,
            elevations,
            stations_m,
            plan: None,
            faces: None,
            more_types,
        };
        simulator.plan = fast::Plan::new(&simulator);
        simulator.faces = anywhere::Faces::new(&simulator);
        Ok(simulator)
    }

    /// The experiment.
    pub fn experiment(&self) -> &Experiment {
        &self.experiment
    }

    /// The grid, in the mount frame's axes, walls on voxel faces.
    pub(crate) fn grid(&self) -> VoxelGrid {
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

    /// The cells of the grid that any ray could hit, ascending.
    pub(crate) fn reachable_cells(&self) -> impl Iterator<Item = usize> + use<> {
        self.grid().outer_cells()
    }

    /// Which voxels each sensor sees.
    pub fn cover(&self, sensors: &[MountDeg]) -> Result<Covered, ExperimentError> {
        self.cover_with(sensors, Instructions::best())
    }

    /// As [`PublishedBox::cover`], with given instructions; the same to the bit.
    pub fn cover_with(
        &self,
        sensors: &[MountDeg],
        instructions: Instructions,
    ) -> Result<Covered, ExperimentError> {
        self.check(sensors)?;
        if self.plan.is_none() {
            return self.join(sensors, |simulator, sensors| {
                simulator.cover_along_with(&simulator.walks(sensors), instructions)
            });
        }
        let shells = self.shells(sensors, instructions);
        let bitmaps = shells.iter().map(|shell| self.bitmap(shell)).collect();
        let lost_rays = sensors.iter().map(|sensor| self.lost_rays(sensor)).collect();
        Ok(Covered { coverage: Coverage::from_bitmaps(self.grid(), bitmaps), lost_rays })
    }

    /// How many voxels the sensors see: the counts of [`PublishedBox::cover`] without its bitmaps.
    pub fn count(&self, sensors: &[MountDeg]) -> Result<Counts, ExperimentError> {
        self.count_with(sensors, Instructions::best())
    }

    /// As [`PublishedBox::count`], with given instructions.
    pub fn count_with(
        &self,
        sensors: &[MountDeg],
        instructions: Instructions,
    ) -> Result<Counts, ExperimentError> {
        if self.plan.is_none() {
            return Ok(self.cover_with(sensors, instructions)?.coverage.counts());
        }
        self.check(sensors)?;
        Ok(shell::counts(&self.shells(sensors, instructions), instructions))
    }

    /// Which voxels sensors of the first type see from any poses in the box, one list of poses for each.
    pub fn cover_along(&self, sensors: &[Vec<BoxPose>]) -> Result<Covered, ExperimentError> {
        self.cover_along_with(sensors, Instructions::best())
    }

    /// As [`PublishedBox::cover_along`], with given instructions; the same to the bit.
    pub fn cover_along_with(
        &self,
        sensors: &[Vec<BoxPose>],
        instructions: Instructions,
    ) -> Result<Covered, ExperimentError> {
        let Some(faces) = &self.faces else {
            return self.cover_along_by_definition(sensors);
        };
        self.check_poses(sensors)?;
        let see = |poses: &Vec<BoxPose>| anywhere::see(self, faces, poses, instructions);
        let (bitmaps, lost_rays) = sensors.par_iter().map(see).unzip();
        Ok(Covered { coverage: Coverage::from_bitmaps(self.grid(), bitmaps), lost_rays })
    }

    /// The poses of each sensor along the walk.
    pub fn walks(&self, sensors: &[MountDeg]) -> Vec<Vec<BoxPose>> {
        let poses = |sensor| (0..self.stations_m.len()).map(|pose| self.pose(sensor, pose)).collect();
        sensors.iter().map(poses).collect()
    }

    fn pose(&self, sensor: &MountDeg, pose: usize) -> BoxPose {
        let mut origin_m = [0.0, 0.0, self.experiment.preset.platform_height_m];
        origin_m[self.experiment.path.axis()] = self.stations_m[pose];
        BoxPose {
            rows: sensor.rotation_rows(),
            origin_m: [origin_m[0] + sensor.x_m, origin_m[1] + sensor.y_m, origin_m[2] + sensor.z_m],
            turn: self.turn(pose),
        }
    }

    /// How far the pattern has turned at a pose of the walk, in steps from azimuth to azimuth.
    fn turn(&self, pose: usize) -> f64 {
        self.experiment.phase.turn(pose as u64, self.experiment.phase_shift)
    }

    /// Whether rays with a zero component are lost.
    fn loses(&self) -> bool {
        self.experiment.preset.loses_axis_parallel_rays && self.experiment.phase == Phase::Locked
    }

    fn lost_rays(&self, sensor: &MountDeg) -> u64 {
        brute::lost_rays(self.of(sensor), &self.pose(sensor, 0)) * self.stations_m.len() as u64
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
    pub fn coverage_by_definition(&self, sensors: &[MountDeg]) -> Result<Covered, ExperimentError> {
        self.check(sensors)?;
        self.join(sensors, |simulator, sensors| {
            simulator.cover_along_by_definition(&simulator.walks(sensors))
        })
    }

    /// What [`PublishedBox::cover_along`] must find, straight from the definition.
    pub(crate) fn cover_along_by_definition(
        &self,
        sensors: &[Vec<BoxPose>],
    ) -> Result<Covered, ExperimentError> {
        self.check_poses(sensors)?;
        let (bitmaps, lost_rays) = sensors.iter().map(|poses| brute::see(self, poses)).unzip();
        Ok(Covered { coverage: Coverage::from_bitmaps(self.grid(), bitmaps), lost_rays })
    }

    fn check_poses(&self, sensors: &[Vec<BoxPose>]) -> Result<(), ExperimentError> {
        if sensors.is_empty() {
            return Err(ExperimentError::NoSensors);
        }
        let preset = &self.experiment.preset;
        for (index, pose) in
            sensors.iter().enumerate().flat_map(|(n, poses)| poses.iter().map(move |p| (n, p)))
        {
            let mut numbers = pose.rows.iter().flatten().chain(&pose.origin_m).chain([&pose.turn]);
            if !numbers.all(|number| number.is_finite()) {
                return Err(ExperimentError::NotFinite { what: format!("a pose of sensor {}", index + 1) });
            }
            let inside = |axis: usize| {
                pose.origin_m[axis] > preset.box_min_m[axis] && pose.origin_m[axis] < preset.box_max_m[axis]
            };
            if !(inside(0) && inside(1) && inside(2)) {
                return Err(ExperimentError::OutsideBox { sensor: index + 1 });
            }
        }
        Ok(())
    }

    /// # Errors
    /// The experiment cannot hold these sensors.
    pub(crate) fn check(&self, sensors: &[MountDeg]) -> Result<(), ExperimentError> {
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
            let types = 1 + self.more_types.len();
            if sensor.sensor_type >= types {
                let sensor_type = sensor.sensor_type;
                return Err(ExperimentError::UnknownType { sensor: index + 1, sensor_type, types });
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
pub struct Covered {
    /// Voxels by sensor.
    pub coverage: Coverage,
    /// Rays that the quirk lost, by sensor.
    pub lost_rays: Vec<u64>,
}

fn whole(value: f64) -> Option<f64> {
    let rounded = value.round();
    ((value - rounded).abs() < 1e-9 && rounded.abs() < 1e9).then_some(rounded)
}

#[cfg(test)]
mod tests {
    use super::experiment::{OS1_64, VLP_16};
    use super::*;

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
            let error = PublishedBox::new(&bad).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
        let simulator = PublishedBox::new(&good).unwrap();
        assert_eq!(simulator.reachable(), 35_048);
        let outside = MountDeg { x_m: 5.0, ..MountDeg::default() };
        assert_eq!(
            simulator.coverage_by_definition(&[outside]).unwrap_err(),
            ExperimentError::OutsideBox { sensor: 1 }
        );
        let nan = MountDeg { pitch_deg: f64::NAN, ..MountDeg::default() };
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
    fn the_fast_method_equals_the_definition_where_it_applies() {
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
                let simulator = PublishedBox::new(&experiment).unwrap();
                let sensors = experiment.sensors(&masters.map(MountDeg::from));
                let fast = simulator.cover(&sensors).unwrap();
                let definition = simulator.coverage_by_definition(&sensors).unwrap();
                assert_eq!(fast.lost_rays, definition.lost_rays, "{experiment:?}");
                assert!(fast == definition, "{experiment:?}");
                assert_eq!(simulator.count(&sensors).unwrap(), definition.coverage.counts());
            }
        }
    }

    /// Poses that no walk has: any rotation, anywhere in the box, near its walls and in its corners, any turn.
    #[test]
    fn any_poses_see_what_the_definition_sees() {
        let mut rng = crate::base::rng::Rng::new(5, 0);
        for (preset, phase) in [(&OS1_64, Phase::Locked), (&VLP_16, Phase::Free)] {
            let experiment = Experiment { phase, azimuths: 36, ..Experiment::published(preset) };
            let simulator = PublishedBox::new(&experiment).unwrap();
            let mut poses: Vec<BoxPose> = (0..40)
                .map(|_| {
                    let axis = glam::DVec3::new(rng.normal(), rng.normal(), rng.normal()).normalize();
                    let rotation = glam::DMat3::from_axis_angle(axis, rng.between(-4.0, 4.0));
                    let place = |low: f64, high: f64, rng: &mut crate::base::rng::Rng| rng.between(low, high);
                    BoxPose {
                        rows: rotation.transpose().to_cols_array_2d(),
                        origin_m: [
                            place(-24.9, 24.9, &mut rng),
                            place(-24.9, 24.9, &mut rng),
                            place(0.1, 19.9, &mut rng),
                        ],
                        turn: rng.uniform(),
                    }
                })
                .collect();
            // a hair's breadth from the floor, a wall and a corner; on voxel faces; on its side
            let upright = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
            let on_side = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]];
            for origin_m in [
                [0.0, 0.0, 1e-6],
                [0.0, 0.0, 1e-300],
                [24.999_999, 3.0, 1.0],
                [-24.999_999, -24.999_999, 19.999_999],
                [0.5, -7.0, 10.0],
            ] {
                poses.extend([upright, on_side].map(|rows| BoxPose { rows, origin_m, turn: 0.0 }));
            }
            // no rotations: very long, all but nothing, nothing
            for scale in [1e30, 1e-30, 0.0] {
                let rows = upright.map(|row| row.map(|component| scale * component));
                poses.push(BoxPose { rows, origin_m: [3.0, 1.0, 2.0], turn: 0.0 });
            }
            let sensors = [poses[..20].to_vec(), poses[20..].to_vec()];
            let definition = simulator.cover_along_by_definition(&sensors).unwrap();
            assert!(definition.lost_rays[1] > 0 || phase == Phase::Free);
            for instructions in Instructions::available() {
                let seen = simulator.cover_along_with(&sensors, instructions).unwrap();
                assert!(seen == definition, "{instructions:?}, {phase:?}");
            }
        }
        let simulator = PublishedBox::new(&Experiment::published(&VLP_16)).unwrap();
        let level = BoxPose { rows: [[0.0; 3]; 3], origin_m: [0.0, 0.0, 1.0], turn: 0.0 };
        let outside = BoxPose { origin_m: [0.0, 0.0, 20.0], ..level };
        assert_eq!(simulator.cover_along(&[vec![outside]]), Err(ExperimentError::OutsideBox { sensor: 1 }));
        let nan = BoxPose { turn: f64::NAN, ..level };
        assert!(
            simulator.cover_along(&[vec![level], vec![nan]]).unwrap_err().to_string().contains("sensor 2")
        );
    }

    #[test]
    fn coincident_sensors_see_the_same_and_nothing_alone() {
        let simulator = PublishedBox::new(&Experiment::published(&VLP_16)).unwrap();
        let sensor = MountDeg { pitch_deg: 21.0, ..MountDeg::default() };
        let counts = simulator.count(&[sensor, sensor]).unwrap();
        assert_eq!(counts.per_sensor, [counts.union; 2]);
        assert_eq!((counts.overlap, counts.unique_per_sensor), (counts.union, vec![0, 0]));
        assert_eq!(counts.union, simulator.count(&[sensor]).unwrap().union);
    }
}
