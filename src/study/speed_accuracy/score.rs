//! Cases scored by models.

use super::Task;
use super::cases::{Case, Scored, Site};
use super::models::{Model, box_scores, scene_scores};
use crate::base::rng::Rng;
use crate::design::fidelity::SceneLadder;
use crate::design::objective::Objective;
use crate::recording::read_trajectory;
use crate::rig::{Mount, MountDeg, Rig};
use crate::study::{StudyError, walks};
use crate::world::scene::{LoadedMesh, Scene, load_mesh};
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

const VOXEL_M: f64 = 0.2;

/// Masters of mirrored pairs at random.
fn random_masters(count: usize) -> Vec<MountDeg> {
    let mut rng = Rng::new(6, 0);
    let master = |_| MountDeg {
        x_m: rng.between(0.05, 0.15),
        y_m: rng.between(-0.25, 0.25),
        z_m: rng.between(-0.15, 0.15),
        pitch_deg: rng.between(-90.0, 90.0),
        ..MountDeg::default()
    };
    (0..count).map(master).collect()
}

impl Case {
    /// Scores random mounts and a line of pitches with a model; the second converged one the line alone.
    pub(crate) fn score(&self, model: &Model, task: &Task) -> Result<Scored, StudyError> {
        let count = if matches!(model, Model::Again { .. }) { 0 } else { task.random() };
        let masters = random_masters(count);
        let line: Vec<MountDeg> = task
            .pitches_deg()
            .into_iter()
            .map(|pitch_deg| MountDeg { x_m: 0.1, pitch_deg, ..MountDeg::default() })
            .collect();
        let start = Instant::now();
        let mut scored = match self.place {
            Site::Box { preset, walk } => {
                let objective = Objective::published(preset, |experiment| experiment.path = walk);
                let objective = objective.map_err(StudyError::of)?;
                let pairs = |masters: &[MountDeg]| -> Vec<Rig> {
                    masters.iter().map(|master| objective.rig(&[*master])).collect()
                };
                box_scores(&objective, model, &pairs(&masters), &pairs(&line))?
            }
            Site::Mesh { sensor } => {
                let path = task.scene.as_deref();
                let path = path.ok_or_else(|| StudyError("which scene? Give --scene MESH".into()))?;
                let ladder = ladder(path, task.trajectory.as_deref(), sensor)?;
                let pairs = |masters: &[MountDeg]| -> Vec<Vec<Mount>> {
                    masters.iter().map(|master| vec![master.mount(), master.mirrored().mount()]).collect()
                };
                scene_scores(&ladder, model, &pairs(&masters), &pairs(&line))?
            }
        };
        scored.wall_ms_per_mount = start.elapsed().as_secs_f64() * 1e3 / (count + line.len()).max(1) as f64;
        Ok(scored)
    }
}

/// The mesh with a walk through it, a straight one where none is given.
fn ladder(path: &Path, trajectory: Option<&Path>, sensor: &str) -> Result<SceneLadder, StudyError> {
    let LoadedMesh { mesh, origin, .. } = load_mesh(path, None, None).map_err(StudyError::of)?;
    let scene = Scene::Mesh(Arc::new(mesh));
    let model = sensors::catalogue::nominal(sensor).map_err(StudyError::of)?;
    let walk = match trajectory {
        Some(file) => origin.local_trajectory(read_trajectory(file, None).map_err(StudyError::of)?.0),
        None => walks::Walk::Straight.through(&scene).map_err(|error| StudyError::at(path, error))?,
    };
    Ok(SceneLadder::new(scene, walk, &model, VOXEL_M))
}
