//! How well two coverages agree, and what to call it.

use serde::Serialize;

use crate::world::coverage::{Coverage, VoxelGrid};
use crate::world::scene::Scene;

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

/// Cells or patches by what became of them; patches count by their area.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Table {
    /// Predicted and recorded.
    pub both: f64,
    /// Predicted, not recorded.
    pub missed: f64,
    /// Recorded, not predicted.
    pub unexpected: f64,
    /// Neither; none where it is not known what there is to cover.
    pub neither: Option<f64>,
}

impl Table {
    /// One more of this weight.
    pub(crate) fn count(&mut self, predicted: bool, recorded: bool, weight: f64) {
        match (predicted, recorded) {
            (true, true) => self.both += weight,
            (true, false) => self.missed += weight,
            (false, true) => self.unexpected += weight,
            (false, false) => *self.neither.get_or_insert(0.0) += weight,
        }
    }

    /// Everything counted.
    pub(crate) fn all(&self) -> f64 {
        self.both + self.missed + self.unexpected + self.neither.unwrap_or(0.0)
    }

    /// In both over in either.
    pub(crate) fn iou(&self) -> Option<f64> {
        share(self.both, self.both + self.missed + self.unexpected)
    }

    /// Agreement beyond chance.
    pub(crate) fn kappa(&self) -> Option<f64> {
        let Self { both: tp, missed: fp, unexpected: fneg, neither } = *self;
        let tn = neither?;
        let all = tp + fp + fneg + tn;
        let observed = (tp + tn) / all;
        let expected = ((tp + fp) * (tp + fneg) + (tn + fneg) * (tn + fp)) / (all * all);
        share(observed - expected, 1.0 - expected)
    }

    /// All figures.
    pub(crate) fn agreement(&self) -> Agreement {
        let Self { both: tp, missed: fp, unexpected: fneg, neither } = *self;
        let correlation = |tn: f64| {
            let spread = ((tp + fp) * (tp + fneg) * (tn + fp) * (tn + fneg)).sqrt();
            share(tp * tn - fp * fneg, spread)
        };
        Agreement {
            iou: self.iou(),
            kappa: self.kappa(),
            mcc: neither.and_then(correlation),
            precision: share(tp, tp + fp),
            recall: share(tp, tp + fneg),
            missed: fp as u64,
            unexpected: fneg as u64,
            prevalence: neither.and_then(|tn| share(tp + fp, tp + fp + fneg + tn)),
        }
    }
}

fn share(part: f64, whole: f64) -> Option<f64> {
    (whole > 0.0).then_some(part / whole)
}

impl Agreement {
    /// Compares two bitmaps; `universe` holds the cells that could be covered at all, where that is known.
    pub fn between(predicted: &[u64], recorded: &[u64], universe: Option<&[u64]>) -> Self {
        let count = |combine: &dyn Fn(u64, u64) -> u64| -> f64 {
            predicted.iter().zip(recorded).map(|(p, r)| u64::from(combine(*p, *r).count_ones())).sum::<u64>()
                as f64
        };
        let both = count(&|p, r| p & r);
        let missed = count(&|p, r| p & !r);
        let unexpected = count(&|p, r| !p & r);
        let neither = universe.map(|bits| {
            let either = predicted.iter().zip(recorded).map(|(p, r)| p | r);
            let inside = bits.iter().zip(either).map(|(u, e)| u64::from((u | e).count_ones())).sum::<u64>();
            inside as f64 - both - missed - unexpected
        });
        Table { both, missed, unexpected, neither }.agreement()
    }
}

/// Cells that the scene's surfaces pass through, where the scene can say so.
pub(crate) fn surface_cells(scene: &Scene, grid: &VoxelGrid) -> Option<Vec<u64>> {
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
pub(crate) fn cell_kinds(predicted: &Coverage, recorded: &Coverage) -> Vec<CellKinds> {
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
    }
}
