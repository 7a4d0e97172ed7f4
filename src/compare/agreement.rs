//! How well two coverages agree, and what to call it.

use serde::Serialize;

use crate::coverage::{Coverage, VoxelGrid};
use crate::scene::Scene;

use super::RayClasses;

/// Coverage as driven and recorded is called the same from here on: a replay of noise-free packets through millimetre
/// ranges reaches 0.9999, a mount one degree off stays below 0.99 in rooms.
const MATCH_IOU: f64 = 0.99;
/// Share of informative rays that must end where predicted. Undisturbed recordings keep above 0.95; a tilt of one degree
/// over ranges of ten metres leaves about 0.94 (measured in a simulated house).
const MATCH_AGREE_SHARE: f64 = 0.95;
/// Fewer rays than one revolution of the smallest sensor say nothing.
const LEAST_RAYS: u64 = 5_000;

/// The three coverages, in cells hit by any sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct CoverageCounts {
    /// Optimal mounts, planned path.
    pub planned: u64,
    /// Measured mounts, recorded trajectory and column times.
    pub as_driven: u64,
    /// What the packets say.
    pub recorded: u64,
}

/// Agreement of two sets of cells. Shares are null where they would divide by nothing.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Agreement {
    /// Cells in both over cells in either.
    pub iou: Option<f64>,
    /// Agreement beyond chance over the surface's cells (Cohen 1960, doi:10.1177/001316446002000104).
    pub kappa: Option<f64>,
    /// Matthews correlation over the surface's cells (doi:10.1016/0005-2795(75)90109-9).
    pub mcc: Option<f64>,
    /// Of the predicted cells, the share recorded.
    pub precision: Option<f64>,
    /// Of the recorded cells, the share predicted.
    pub recall: Option<f64>,
    /// Predicted, not recorded.
    pub missed: u64,
    /// Recorded, not predicted.
    pub unexpected: u64,
    /// Share of the surface's cells that were predicted.
    pub prevalence: Option<f64>,
}

impl Agreement {
    /// Compares two bitmaps; `universe` holds the cells that could be covered at all, where that is known.
    pub fn between(predicted: &[u64], recorded: &[u64], universe: Option<&[u64]>) -> Self {
        let count = |combine: &dyn Fn(u64, u64) -> u64| -> u64 {
            predicted.iter().zip(recorded).map(|(p, r)| u64::from(combine(*p, *r).count_ones())).sum()
        };
        let both = count(&|p, r| p & r);
        let missed = count(&|p, r| p & !r);
        let unexpected = count(&|p, r| !p & r);
        let share = |part: f64, whole: f64| (whole > 0.0).then_some(part / whole);
        let [tp, fp, fneg] = [both as f64, missed as f64, unexpected as f64];
        let inside = universe.map(|bits| {
            let either = predicted.iter().zip(recorded).map(|(p, r)| p | r);
            bits.iter().zip(either).map(|(u, e)| u64::from((u | e).count_ones())).sum::<u64>() as f64
        });
        let tn = inside.map(|all| all - tp - fp - fneg);
        let chance = |tn: f64| {
            let all = tp + fp + fneg + tn;
            let observed = (tp + tn) / all;
            let expected = ((tp + fp) * (tp + fneg) + (tn + fneg) * (tn + fp)) / (all * all);
            share(observed - expected, 1.0 - expected)
        };
        let correlation = |tn: f64| {
            let spread = ((tp + fp) * (tp + fneg) * (tn + fp) * (tn + fneg)).sqrt();
            share(tp * tn - fp * fneg, spread)
        };
        Self {
            iou: share(tp, tp + fp + fneg),
            kappa: tn.and_then(chance),
            mcc: tn.and_then(correlation),
            precision: share(tp, tp + fp),
            recall: share(tp, tp + fneg),
            missed,
            unexpected,
            prevalence: inside.and_then(|all| share(tp + fp, all)),
        }
    }
}

/// What the comparison comes to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// The recording covers what was promised.
    Matches,
    /// It does not.
    Differs,
    /// Too little was recorded to say.
    CannotTell,
}

impl Verdict {
    /// From the agreement and every sensor's rays. One sensor that says nothing is enough not to call it a match.
    pub fn of(agreement: &Agreement, rays: &[RayClasses]) -> Self {
        if rays.is_empty() || rays.iter().all(|sensor| sensor.informative() < LEAST_RAYS) {
            return Verdict::CannotTell;
        }
        let agreeing = |sensor: &RayClasses| {
            sensor.informative() >= LEAST_RAYS
                && sensor.agree as f64 >= MATCH_AGREE_SHARE * sensor.informative() as f64
        };
        let same_cells = agreement.iou.is_some_and(|iou| iou >= MATCH_IOU);
        if same_cells && rays.iter().all(agreeing) { Verdict::Matches } else { Verdict::Differs }
    }
}

/// Cells that the scene's surfaces pass through, where the scene can say so.
pub fn surface_cells(scene: &Scene, grid: &VoxelGrid) -> Option<Vec<u64>> {
    let Scene::Box(walls) = scene else { return None };
    let mut bits = vec![0u64; grid.len().div_ceil(64)];
    for index in 0..grid.len() {
        let centre = grid.centre_m(index);
        let half = 0.5 * grid.voxel_m;
        let touches = (0..3).any(|axis| {
            [walls.min_m[axis], walls.max_m[axis]]
                .iter()
                .zip(walls.faces[axis])
                .any(|(plane, present)| present && (centre[axis] - plane).abs() <= half)
        });
        if touches {
            bits[index / 64] |= 1 << (index % 64);
        }
    }
    Some(bits)
}

/// Each cell's part in the comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CellKinds {
    /// Predicted and recorded.
    Both,
    /// Predicted, not recorded.
    Missed,
    /// Recorded, not predicted.
    Unexpected,
    /// Neither.
    Neither,
}

/// What a cell is in a comparison of two coverages.
pub fn cell_kinds(predicted: &Coverage, recorded: &Coverage) -> Vec<CellKinds> {
    let (predicted_bits, recorded_bits) = (predicted.union(), recorded.union());
    (0..predicted.grid().len())
        .map(|index| {
            let bit = |bits: &[u64]| bits[index / 64] >> (index % 64) & 1 == 1;
            match (bit(&predicted_bits), bit(&recorded_bits)) {
                (true, true) => CellKinds::Both,
                (true, false) => CellKinds::Missed,
                (false, true) => CellKinds::Unexpected,
                (false, false) => CellKinds::Neither,
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_of_a_table_worked_by_hand() {
        // 16 cells: tp 6, fp 2, fn 1, tn 7
        let predicted = [0b1111_1111u64];
        let recorded = [0b1_0011_1111u64];
        let universe = [0xffffu64];
        let agreement = Agreement::between(&predicted, &recorded, Some(&universe));
        let near = |value: Option<f64>, wanted: f64| (value.unwrap() - wanted).abs() < 1e-12;
        assert_eq!((agreement.missed, agreement.unexpected), (2, 1));
        assert!(near(agreement.iou, 6.0 / 9.0));
        assert!(near(agreement.precision, 0.75) && near(agreement.recall, 6.0 / 7.0));
        // po = 13/16, pe = (8*7 + 8*9)/256
        assert!(near(agreement.kappa, (13.0 / 16.0 - 0.5) / 0.5));
        assert!(near(agreement.mcc, (42.0 - 2.0) / (8.0f64 * 7.0 * 9.0 * 8.0).sqrt()));
    }

    #[test]
    fn nothing_against_nothing_is_null_not_one() {
        let agreement = Agreement::between(&[0], &[0], Some(&[1]));
        assert_eq!(agreement.iou, None);
        assert_eq!(agreement.precision, None);
        assert_eq!(Verdict::of(&agreement, &[RayClasses::default()]), Verdict::CannotTell);
    }

    #[test]
    fn a_silent_sensor_is_never_a_match() {
        let agreement = Agreement::between(&[1], &[1], None);
        let good = RayClasses { agree: 100_000, ..RayClasses::default() };
        assert_eq!(Verdict::of(&agreement, &[good, good]), Verdict::Matches);
        assert_eq!(Verdict::of(&agreement, &[good, RayClasses::default()]), Verdict::Differs);
    }
}
