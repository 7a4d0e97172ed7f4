//! Speed against accuracy in this scene: what each count of what a mount sees takes, and by how much it is wrong.

use std::time::Instant;

use super::search::SceneSearch;
use crate::base::statistics::mean_and_deviation;
use crate::rig::Rig;
use crate::simulate::view::Seen;

/// Mounts that are counted.
const MOUNTS: usize = 8;
/// The model counts by one voxel in so many.
const VOXELS: [usize; 3] = [16, 4, 1];
/// And beams by one revolution in so many of those that judged while searching.
const REVOLUTIONS: [u64; 2] = [16, 4];

/// One count of what mounts see.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Fidelity {
    pub name: String,
    pub ms_per_mount: f64,
    /// Standard deviation of the difference from what judged while searching; an error that all mounts share is none.
    pub sd_voxels: f64,
    pub is_model: bool,
}

impl SceneSearch<'_> {
    /// Counts the best of those cast again by each of them; nothing where mounts are too few. `phase_sd_voxels` is what the starts of the
    /// revolutions make of the search's own beams.
    pub(crate) fn fidelities(&self, phase_sd_voxels: f64) -> Vec<Fidelity> {
        let mut cast: Vec<(&Rig, f64)> = self.cast().map(|(rig, seen)| (rig, seen.union)).collect();
        cast.sort_by(|a, b| b.1.total_cmp(&a.1));
        cast.truncate(MOUNTS);
        if cast.len() < 2 {
            return Vec::new();
        }
        let rigs: Vec<Rig> = cast.iter().map(|(rig, _)| (*rig).clone()).collect();
        let measured = |name: String, is_model: bool, see: &dyn Fn() -> Vec<Seen>| {
            let start = Instant::now();
            let seen = see();
            let ms_per_mount = 1e3 * start.elapsed().as_secs_f64() / seen.len() as f64;
            let off: Vec<f64> = seen.iter().zip(&cast).map(|(seen, (_, union))| seen.union - union).collect();
            Fidelity { name, ms_per_mount, sd_voxels: mean_and_deviation(&off).1, is_model }
        };
        let by_model = |stride: &usize| {
            let name = match stride {
                1 => "model, every voxel".to_owned(),
                _ => format!("model, one voxel in {stride}"),
            };
            measured(name, true, &|| self.model.see_roughly(&rigs, *stride))
        };
        let mut all: Vec<Fidelity> = VOXELS.iter().map(by_model).collect();
        let beams = self.judges.while_searching();
        for times in REVOLUTIONS {
            let view = beams.every(times);
            all.push(measured(format!("one revolution in {times}"), false, &|| view.see(&rigs)));
        }
        let own = measured("beams of the search".into(), false, &|| beams.see(&rigs[..1]));
        all.push(Fidelity { sd_voxels: phase_sd_voxels, ..own });
        all
    }
}
