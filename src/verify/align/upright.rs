//! The up direction of a walk, and how high it lies in a scene.

use glam::{DQuat, DVec3};

use super::surface::Patch;

/// Gravity lies at most so far from the trajectory's z axis.
const OFF_LEVEL_DEG: f64 = 12.0;
/// Patches among which the direction that most share is looked for, and how near they must be to share it.
const MODES: usize = 1500;
const SHARED_DEG: f64 = 2.0;
/// Fewer level patches say nothing about the vertical.
const LEAST_PATCHES: usize = 20;
/// Bins of heights, and how far apart two candidates lie, m.
const BIN_M: f64 = 0.05;
const APART_M: f64 = 0.4;
/// Candidates for the height: storeys.
const MOST_HEIGHTS: usize = 4;

/// The rotation that turns a walk upright: floors and ceilings level. None where it saw hardly any.
pub(super) fn upright_from_walk(patches: &[Patch]) -> Option<DQuat> {
    let near = OFF_LEVEL_DEG.to_radians().cos();
    let up = |patch: &Patch| patch.normal.map(|normal| if normal.z < 0.0 { -normal } else { normal });
    let normals: Vec<DVec3> = patches.iter().filter_map(up).filter(|normal| normal.z > near).collect();
    let step = normals.len().div_ceil(MODES).max(1);
    let shared = SHARED_DEG.to_radians().cos();
    let sharing = |of: DVec3| normals.iter().step_by(step).filter(|normal| normal.dot(of) > shared).count();
    let mut best: Option<(usize, DVec3)> = None;
    for normal in normals.iter().step_by(step) {
        let count = sharing(*normal);
        if best.is_none_or(|(most, _)| count > most) {
            best = Some((count, *normal));
        }
    }
    let mut mean = best?.1;
    let mut count = 0;
    for _ in 0..5 {
        let about: Vec<DVec3> = normals.iter().copied().filter(|normal| normal.dot(mean) > shared).collect();
        count = about.len();
        mean = about.into_iter().sum::<DVec3>().try_normalize()?;
    }
    (count >= LEAST_PATCHES).then(|| DQuat::from_rotation_arc(mean, DVec3::Z))
}

/// What to add to the heights of a walk so that its floors and ceilings lie where the scene has such, best first; `within_m`:
/// where the height of the walk's own origin may lie.
pub(super) fn heights_m(walk: &[Patch], scene: &[Patch], within_m: [f64; 2]) -> Vec<f64> {
    let bin = |z_m: f64| (z_m / BIN_M).round() as i64;
    let level = |patches: &[Patch]| -> Vec<i64> {
        patches.iter().filter(|patch| patch.is_level()).map(|patch| bin(patch.at_m.z)).collect()
    };
    let [walk, scene] = [level(walk), level(scene)].map(Histogram::of);
    let middle_m = 0.5 * (within_m[0] + within_m[1]);
    let (Some(walk), Some(scene)) = (walk, scene) else { return vec![middle_m] };
    let shifts = bin(within_m[0])..=bin(within_m[1]);
    let mut scored: Vec<(f64, i64)> = shifts.map(|shift| (walk.matched(&scene, shift), shift)).collect();
    scored.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut found: Vec<f64> = Vec::new();
    for (score, shift) in scored {
        let height_m = shift as f64 * BIN_M;
        let is_apart = found.iter().all(|other| (other - height_m).abs() >= APART_M);
        if score > 0.0 && is_apart {
            found.push(height_m);
        }
        if found.len() == MOST_HEIGHTS {
            break;
        }
    }
    if found.is_empty() { vec![middle_m] } else { found }
}

/// How much level surface lies at each height.
struct Histogram {
    first: i64,
    /// Roots: one large floor does not outweigh all the rest.
    roots: Vec<f64>,
}

impl Histogram {
    fn of(bins: Vec<i64>) -> Option<Self> {
        let (first, last) = (bins.iter().min()? - 1, bins.iter().max()? + 1);
        let mut counts = vec![0.0; (last - first + 1) as usize];
        for bin in bins {
            let at = (bin - first) as usize;
            counts[at] += 1.0;
            counts[at - 1] += 0.5;
            counts[at + 1] += 0.5;
        }
        Some(Self { first, roots: counts.into_iter().map(f64::sqrt).collect() })
    }

    fn matched(&self, other: &Self, shift: i64) -> f64 {
        let of_other = |at: usize| {
            let index = usize::try_from(self.first + at as i64 + shift - other.first).ok()?;
            other.roots.get(index)
        };
        self.roots.iter().enumerate().filter_map(|(at, root)| Some(root * of_other(at)?)).sum()
    }
}
