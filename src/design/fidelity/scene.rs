//! A real scene at any fineness.

use std::convert::Infallible;

use rayon::prelude::*;
use sensors::SensorModel;

use super::Ladder;
use crate::rig::{Mount, Phase, Rig};
use crate::simulate::fan::BeamFan;
use crate::simulate::scan::{Scanner, SensorErrors, Spin};
use crate::world::coverage::{Coverage, VoxelGrid};
use crate::world::scene::Scene;
use crate::world::trajectory::Trajectory;

/// Sensors carried through a scene, scored by the voxels that they see. The finest level has 1800 columns and eight
/// revolutions per metre; the others take an eighth of both, and ever more of what is left: nothing is cast twice.
#[derive(Clone, Debug)]
pub struct SceneLadder {
    scene: Scene,
    trajectory: Trajectory,
    grid: VoxelGrid,
    model: SensorModel,
    finest: BeamFan,
}

/// Columns per revolution of the finest level.
const AZIMUTHS: usize = 1800;
/// Parts into which its columns and its revolutions are dealt.
const PARTS: usize = 8;
/// The order in which parts are added: each in the largest gap of those before it.
const ORDER: [usize; PARTS] = [0, 4, 2, 6, 1, 5, 3, 7];
/// Parts of the columns and of the revolutions, level by level. Rays are first spread over more revolutions, because
/// a pattern misses the same cells from places close by.
const LEVELS: [[usize; 2]; 7] = [[1, 1], [1, 2], [1, 4], [1, 8], [2, 8], [4, 8], [8, 8]];

/// What a candidate has seen so far.
#[derive(Clone, Debug, Default)]
pub struct Seen {
    levels: usize,
    voxels: Option<Coverage>,
}

impl SceneLadder {
    /// The levels of a sensor model along a trajectory; voxels of `voxel_m`, the planes of the scene's bounds through
    /// their centres.
    pub(crate) fn new(scene: Scene, trajectory: Trajectory, model: &SensorModel, voxel_m: f64) -> Self {
        let grid = VoxelGrid::centred_on(scene.bounds_m(), voxel_m);
        let finest = fan(&trajectory, model, AZIMUTHS, PARTS as f64, Phase::Free);
        Self { scene, trajectory, grid, model: model.clone(), finest }
    }

    /// Columns per revolution, and revolutions spread evenly over the trajectory's time: so many per metre, at least one.
    pub(crate) fn fan(&self, azimuths: usize, per_metre: f64, phase: Phase) -> BeamFan {
        fan(&self.trajectory, &self.model, azimuths, per_metre, phase)
    }

    /// Voxels that mounts see with beams of any fineness.
    pub(crate) fn voxels(&self, fan: &BeamFan, mounts: &[Mount]) -> u64 {
        fan.coverage(&self.scene, &self.trajectory, mounts, &self.grid).0.union_count()
    }

    /// The same trajectory with other voxels.
    pub(crate) fn with_voxels(&self, voxel_m: f64) -> Self {
        Self { grid: VoxelGrid::centred_on(self.scene.bounds_m(), voxel_m), ..self.clone() }
    }

    /// Edge of a voxel, m.
    pub(crate) fn voxel_m(&self) -> f64 {
        self.grid.voxel_m
    }

    /// Voxels that mounts see by the whole sensor model (beam offsets, firing times) with as many columns and revolutions
    /// as the fan has.
    pub(crate) fn voxels_sensed(
        &self,
        fan: &BeamFan,
        mounts: &[Mount],
        sensor_errors: SensorErrors,
        with_housings: bool,
    ) -> u64 {
        let rig = Rig::of_model(&self.model, mounts);
        let spin = Spin { rate_hz: fan.rate_hz, columns: fan.columns() as u32, ..Spin::default() };
        let mut scanner =
            Scanner { sensor_errors, ..Scanner::new(&self.scene, &self.trajectory, &rig, spin) };
        if !with_housings {
            scanner.occluders.iter_mut().for_each(Vec::clear);
        }
        let mut coverage = Coverage::new(self.grid.clone(), mounts.len());
        scanner.cover(&mut coverage);
        coverage.union_count()
    }

    /// Rays that this takes.
    pub(crate) fn rays_of(&self, fan: &BeamFan, mounts: &[Mount]) -> u64 {
        fan.scans(&self.trajectory) * mounts.len() as u64 * fan.rays_per_scan()
    }

    /// Columns of each revolution that a level adds, by number.
    fn added(&self, level: usize) -> Vec<(u64, Vec<usize>)> {
        let scans = (0..self.finest.scans(&self.trajectory)).map(|scan| (scan, added_parts(level, scan)));
        let some = scans.filter(|(_, parts)| parts.contains(&true));
        some.map(|(scan, parts)| (scan, (0..AZIMUTHS).filter(|column| parts[column % PARTS]).collect()))
            .collect()
    }

    fn cast(&self, level: usize, mounts: &[Mount]) -> Coverage {
        let scans = self.added(level);
        let nothing = || Coverage::new(self.grid.clone(), 1);
        let parts: Vec<Coverage> = scans
            .par_chunks(scans.len().div_ceil(rayon::current_num_threads()).max(1))
            .map(|scans| {
                let mut coverage = nothing();
                for (scan, columns) in scans {
                    for mount in mounts {
                        let add = |hit_m| coverage.add(0, hit_m);
                        self.finest.cast_columns(&self.scene, &self.trajectory, mount, *scan, columns, add);
                    }
                }
                coverage
            })
            .collect();
        let mut coverage = nothing();
        parts.iter().for_each(|part| coverage.join(part));
        coverage
    }
}

fn fan(
    trajectory: &Trajectory,
    model: &SensorModel,
    azimuths: usize,
    per_metre: f64,
    phase: Phase,
) -> BeamFan {
    let [start_ns, end_ns] = trajectory.time_span_ns();
    let revolutions = (trajectory.length_m() * per_metre).ceil().max(1.0);
    let rate_hz = revolutions / ((end_ns - start_ns) as f64 * 1e-9).max(1e-9);
    let mut fan = BeamFan::nominal(model, azimuths, rate_hz);
    fan.phase = phase;
    fan
}

/// Parts of the columns of a revolution that a level adds to the levels before it: column c belongs to part c modulo
/// [`PARTS`].
fn added_parts(level: usize, scan: u64) -> [bool; PARTS] {
    let parts = PARTS as u64;
    let place = (scan % parts) as usize;
    // each revolution deals its columns from another one on
    let from = (PARTS as f64 * Phase::Free.turn(scan / parts, 0.0)) as usize + 3 * place;
    let has = |level: usize, part: usize| {
        let [columns, revolutions] = LEVELS[level];
        ORDER[..columns].contains(&((part + from) % PARTS)) && ORDER[..revolutions].contains(&place)
    };
    let had = |part: usize| level.checked_sub(1).is_some_and(|before| has(before, part));
    std::array::from_fn(|part| has(level, part) && !had(part))
}

impl Ladder for SceneLadder {
    type Candidate = Vec<Mount>;
    type Memo = Seen;
    type Error = Infallible;

    fn levels(&self) -> usize {
        LEVELS.len()
    }

    fn rays(&self, level: usize, mounts: &Vec<Mount>) -> u64 {
        let parts = |scan| added_parts(level, scan).into_iter().filter(|is_added| *is_added).count();
        let columns: usize =
            (0..self.finest.scans(&self.trajectory)).map(parts).sum::<usize>() * (AZIMUTHS / PARTS);
        columns as u64 * self.finest.beams() as u64 * mounts.len() as u64
    }

    fn name(&self, level: usize) -> String {
        let [columns, revolutions] = LEVELS[level];
        format!("{} azimuths, {revolutions} poses per metre", AZIMUTHS / PARTS * columns)
    }

    fn score(&self, level: usize, mounts: &Vec<Mount>, seen: &mut Seen) -> Result<f64, Infallible> {
        let voxels = seen.voxels.get_or_insert_with(|| Coverage::new(self.grid.clone(), 1));
        for level in seen.levels..=level {
            voxels.join(&self.cast(level, mounts));
        }
        seen.levels = level + 1;
        Ok(voxels.union_count() as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::scene::BoxScene;
    use glam::DVec3;

    #[test]
    fn levels_add_up_to_the_finest_and_cast_nothing_twice() {
        let room = Scene::Box(BoxScene::closed(DVec3::new(-5.0, -4.0, 0.0), DVec3::new(5.0, 4.0, 3.0)));
        let walk = Trajectory::straight(DVec3::new(-1.0, 0.3, 1.5), DVec3::new(1.0, 0.3, 1.5), 1.0, 0);
        let model = sensors::catalogue::nominal("vlp-16").unwrap();
        let ladder = SceneLadder::new(room, walk, &model, 0.1);
        let mounts = vec![Mount { pitch_rad: 0.5, ..Mount::default() }, Mount::default()];
        let mut seen = Seen::default();
        let (mut rays, mut scores) = (0, Vec::new());
        for level in 0..ladder.levels() {
            scores.push(ladder.score(level, &mounts, &mut seen).unwrap());
            rays += ladder.rays(level, &mounts);
            let coarsest = ladder.rays(0, &mounts);
            assert_eq!(rays, coarsest << level, "each level doubles the rays");
            let at_once = ladder.score(level, &mounts, &mut Seen::default()).unwrap();
            assert_eq!(at_once, scores[level]);
        }
        assert!(scores.is_sorted() && scores[0] < scores[6], "{scores:?}");
        let finest = ladder.fan(1800, 8.0, Phase::Free);
        assert_eq!(rays, ladder.rays_of(&finest, &mounts));
        assert_eq!(scores[6], ladder.voxels(&finest, &mounts) as f64);
    }
}
