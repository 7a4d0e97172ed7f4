//! How sure the agreement of patches is: what other pieces of the same place would give.

use std::collections::BTreeMap;

use super::{Agreement, Patches, Table};
use crate::base::rng::Rng;

/// Edge of a block: coverage is alike over about the size of a piece of furniture, m.
const BLOCK_M: f64 = 2.0;
/// Draws.
const DRAWS: usize = 1000;

/// Agreement of patches, with intervals.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct PatchAgreement {
    /// All figures; counts are observable sample points.
    #[serde(flatten)]
    pub agreement: Agreement,
    /// 95 % of the IoU over blocks of 2 m drawn with replacement; none without two blocks.
    pub iou_interval: Option<[f64; 2]>,
    /// The same for kappa.
    pub kappa_interval: Option<[f64; 2]>,
    /// Patches compared.
    pub patches: u64,
    /// Their observable points.
    pub points: u64,
}

impl PatchAgreement {
    /// Compares flags of patches over all that are observable.
    pub(crate) fn between(patches: &Patches, predicted: &[bool], recorded: &[bool], seed: u64) -> Self {
        let mut blocks: BTreeMap<[i64; 3], Table> = BTreeMap::new();
        let mut compared = 0;
        for patch in (0..patches.len()).filter(|patch| patches.weight(*patch) > 0) {
            let block = patches.block_of(patches.centre_m(patch), BLOCK_M);
            let empty = Table { neither: Some(0.0), ..Table::default() };
            let table = blocks.entry(block).or_insert(empty);
            table.count(predicted[patch], recorded[patch], f64::from(patches.weight(patch)));
            compared += 1;
        }
        let blocks: Vec<Table> = blocks.into_values().collect();
        let all = sum(blocks.iter());
        let mut rng = Rng::new(seed, 0x6b6f);
        let (mut ious, mut kappas) = (Vec::new(), Vec::new());
        if blocks.len() > 1 {
            for _ in 0..DRAWS {
                let drawn = sum((0..blocks.len()).map(|_| &blocks[rng.below(blocks.len() as u64) as usize]));
                ious.extend(drawn.iou());
                kappas.extend(drawn.kappa());
            }
        }
        Self {
            agreement: all.agreement(),
            iou_interval: middle_95(ious),
            kappa_interval: middle_95(kappas),
            patches: compared,
            points: all.all() as u64,
        }
    }
}

fn sum<'a>(tables: impl Iterator<Item = &'a Table>) -> Table {
    tables.fold(Table { neither: Some(0.0), ..Table::default() }, |sum, table| Table {
        both: sum.both + table.both,
        missed: sum.missed + table.missed,
        unexpected: sum.unexpected + table.unexpected,
        neither: sum.neither.zip(table.neither).map(|(a, b)| a + b),
    })
}

/// The 2.5th and the 97.5th percentile.
fn middle_95(mut values: Vec<f64>) -> Option<[f64; 2]> {
    if values.is_empty() {
        return None;
    }
    values.sort_by(f64::total_cmp);
    let at = |share: f64| values[((values.len() - 1) as f64 * share).round() as usize];
    Some([at(0.025), at(0.975)])
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::world::scene::{BoxScene, Scene};

    #[test]
    fn the_interval_covers_the_truth_as_often_as_it_says() {
        let room = Scene::Box(BoxScene::closed(DVec3::new(-10.0, -10.0, 0.0), DVec3::new(10.0, 10.0, 3.0)));
        let patches = Patches::of_scene(&room, 80_000, 1, &[DVec3::new(0.1, 0.2, 1.5)]).unwrap();
        assert!(patches.observable_share() > 0.999);
        let all = vec![true; patches.len()];
        let mut inside = 0;
        for seed in 0..100 {
            let mut rng = Rng::new(seed, 9);
            let recorded: Vec<bool> = (0..patches.len()).map(|_| rng.uniform() < 0.9).collect();
            let found = PatchAgreement::between(&patches, &all, &recorded, seed);
            let [low, high] = found.iou_interval.unwrap();
            assert!(found.agreement.iou.unwrap() >= low && found.agreement.iou.unwrap() <= high);
            assert!(high - low < 0.05);
            inside += u32::from((low..=high).contains(&0.9));
        }
        // binomial: 95 of 100, 4 standard deviations
        assert!((86..=100).contains(&inside), "{inside}");
    }
}
