//! First stage: the mounts that see the most, the rig they make, and what it will cover.

use std::sync::atomic::AtomicBool;
use std::time::Instant;

use glam::DVec3;

use crate::design::objective::Objective;
use crate::design::optimize::{KeepApart, Kind, MountProblem, Search, Settings};
use crate::live::receive::now_ns;
use crate::rig::{MountDeg, MountFile, Path, Rig, SensorEntry};
use crate::simulate::frames::Spin;
use crate::simulate::scan::{self, Scanner};
use crate::world::coverage::{Coverage, VoxelGrid};
use crate::world::scene::{BoxScene, Scene};
use crate::world::trajectory::Trajectory;

use super::document::SearchSummary;
use super::error::DemoError;
use super::sensors::{SPIN_HZ, mock_sensor};
use super::setup::Walk;
use crate::simulate::Progress;

/// The optimal mounts of a mirrored pair that can be built.
pub(crate) struct Plan {
    objective: Objective,
    pub rig: Rig,
    pub mount: MountFile,
    pub summary: SearchSummary,
}

/// Searches one mirrored pair of housings that keep apart, the platform walking along its own forward axis.
pub(crate) fn search(
    preset: &str,
    evaluations: usize,
    seed: u64,
    progress: &dyn Fn(Progress),
) -> Result<Plan, DemoError> {
    let start = Instant::now();
    let objective = Objective::published(preset, |experiment| experiment.path = Path::Forward)?;
    let preset = &objective.simulator().experiment().preset;
    let problem = MountProblem::new(objective.clone(), 1, KeepApart::Housings);
    let settings = Settings::new(seed, evaluations);
    let mut search = Search::new(problem.space()?, Kind::Pattern, settings);
    progress(Progress::Total(evaluations as u64));
    search.run(
        evaluations,
        |values| problem.measure(values),
        |search| progress(Progress::At(search.evaluations() as u64)),
        &AtomicBool::new(false),
    )?;
    let best = search.best().filter(|best| best.violation <= 0.0);
    let Some(best) = best else {
        return Err(DemoError::NoMount { evaluations });
    };
    let masters = problem.masters(&best.candidate.values);
    let sensors = objective.sensors(&masters);
    let names = ["left", "right"];
    let on_its_side = |sensor: &MountDeg| names[usize::from(sensor.x_m > 0.0)].to_owned();
    let mut entries: Vec<SensorEntry> =
        sensors.iter().map(|sensor| sensor.entry(on_its_side(sensor), preset.model)).collect();
    entries.sort_by(|a, b| a.name.cmp(&b.name));
    let mut mount = MountFile::new(entries);
    mount.masters = Some(masters.iter().map(|master| (*master).into()).collect());
    mount.preset = Some(preset.name.into());
    mount.objective = Some(best.score);
    let summary = SearchSummary {
        preset: preset.name.into(),
        method: search.kind().name().into(),
        seed,
        evaluations: search.evaluations(),
        objective: best.score,
        masters: masters.iter().map(|master| (*master).into()).collect(),
        history: search.history().filter_map(|(evaluation, best)| Some((evaluation, best?))).collect(),
        wall_s: start.elapsed().as_secs_f64(),
    };
    Ok(Plan { rig: mount.rig()?, objective, mount, summary })
}

impl Plan {
    /// The hall of the experiment.
    pub(crate) fn hall(&self) -> Scene {
        let preset = &self.objective.simulator().experiment().preset;
        Scene::Box(BoxScene::closed(preset.box_min_m.into(), preset.box_max_m.into()))
    }

    /// Edge of its voxels, m.
    pub(crate) fn voxel_m(&self) -> f64 {
        self.objective.simulator().experiment().voxel_m
    }

    /// Along the platform's own forward axis through the middle of the hall.
    pub(crate) fn straight_path(&self, speed_m_s: f64) -> Trajectory {
        let preset = &self.objective.simulator().experiment().preset;
        let half_m = preset.path_length_m / 2.0;
        let at = |x_m: f64| DVec3::new(x_m, 0.0, preset.platform_height_m);
        Trajectory::straight(at(-half_m), at(half_m), speed_m_s, now_ns())
    }
}

/// Predicted coverage of the walk: perfect sensors on the mounts and the planned trajectory.
pub(crate) fn predict(walk: &Walk<'_>, grid: &VoxelGrid) -> Result<Coverage, DemoError> {
    let mut scanner = Scanner::new(walk.scene, walk.planned, walk.rig, scan::Spin::default());
    for (index, sensor) in walk.rig.sensors.iter().enumerate() {
        let columns = match mock_sensor(&sensor.model.name, index, 0)?.0.spin() {
            Spin::Angles { columns, .. } => columns as u32,
            Spin::Clock { cycle_ns, rate_hz } => (1e9 / (rate_hz * cycle_ns)).round() as u32,
        };
        scanner.spins[index] = scan::Spin { rate_hz: SPIN_HZ, columns, ..scan::Spin::default() };
    }
    // the mock sensors do not see each other either
    scanner.occluders.iter_mut().for_each(Vec::clear);
    let mut coverage = Coverage::new(grid.clone(), walk.rig.sensors.len());
    scanner.cover(&mut coverage);
    Ok(coverage)
}
