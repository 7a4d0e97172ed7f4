//! What a rig will see of a site, by every ray of it; and what single sensors would see.

mod baselines;
mod doubts;
mod omissions;
mod site;

pub(crate) use baselines::{SceneBaselines, baselines};
pub(crate) use doubts::doubts;
pub(crate) use omissions::{Omission, omissions};
pub(crate) use site::{Site, grid_of};

use std::collections::HashMap;
use std::hash::BuildHasherDefault;
use std::ops::Range;

use rayon::prelude::*;

use super::Progress;
use super::baselines::search_step;
use super::rounds::{is_worth_settling, rounds};
use super::scan::Scanner;
use super::view::CellHasher;
use crate::world::coverage::{Coverage, VoxelGrid};
use crate::world::scene::VoxelMap;
use crate::world::surface::{Completeness, ObservableSurface, SurfaceShares, THRESHOLDS_M};

/// What a rig will see.
pub(crate) struct Prediction {
    pub coverage: Coverage,
    /// Returns by sensor.
    pub returns: Vec<u64>,
    /// Of a mesh.
    pub shares: Option<SurfaceShares>,
}

/// Returns by voxel.
#[derive(Default)]
struct Hits(HashMap<usize, u64, BuildHasherDefault<CellHasher>>);

impl Hits {
    fn add(&mut self, cell: usize, returns: u64) {
        *self.0.entry(cell).or_default() += returns;
    }
}

/// Scans the whole path.
pub(crate) fn predict(
    scanner: &Scanner<'_>,
    grid: &VoxelGrid,
    surface: Option<&ObservableSurface>,
    progress: &(dyn Fn(Progress) + Sync),
) -> Prediction {
    let sensors = scanner.rig.sensors.len();
    let sweeps: Vec<_> = (0..sensors).map(|sensor| scanner.sweep(sensor)).collect();
    let turns: Vec<_> = (0..sensors).flat_map(|sensor| turns(scanner, sensor)).collect();
    progress(Progress::Total(turns.len() as u64));
    let mut completeness = surface.map(|surface| Completeness::new(&surface.samples, &THRESHOLDS_M));
    let parts = 2 * rayon::current_num_threads();
    let nothing = |_| (Coverage::new(grid.clone(), sensors), vec![0; sensors], Hits::default());
    let mut seen: Vec<_> = (0..parts).map(nothing).collect();
    for (round, chosen) in rounds(turns.len() as u64).iter().enumerate() {
        let shares = chosen.par_chunks(chosen.len().div_ceil(parts).max(1));
        seen.par_iter_mut().zip(shares).for_each(|((coverage, returns, hits), share)| {
            let mut found = completeness.as_ref().map(|completeness| (completeness, completeness.adder()));
            for (sensor, columns) in share.iter().map(|turn| turns[*turn as usize].clone()) {
                sweeps[sensor].columns(columns, |column| {
                    returns[sensor] += column.returns.len() as u64;
                    for back in &column.returns {
                        coverage.add(sensor, back.point_m);
                        if scanner.min_hits > 1 {
                            grid.index(back.point_m).iter().for_each(|cell| hits.add(*cell, 1));
                        }
                        found
                            .iter_mut()
                            .for_each(|(completeness, adder)| completeness.add(adder, back.point_m));
                    }
                });
                progress(Progress::Done(1));
            }
        });
        if is_worth_settling(round) {
            completeness.iter_mut().for_each(Completeness::settle);
        }
    }
    let mut coverage = Coverage::new(grid.clone(), sensors);
    let mut returns = vec![0; sensors];
    let mut hits = Hits::default();
    for (more, counts, more_hits) in &seen {
        coverage.join(more);
        returns.iter_mut().zip(counts).for_each(|(all, count)| *all += count);
        more_hits.0.iter().for_each(|(cell, count)| hits.add(*cell, *count));
    }
    if scanner.min_hits > 1 {
        coverage.retain(|cell| hits.0.get(&cell).is_some_and(|count| *count >= u64::from(scanner.min_hits)));
    }
    let shares = surface.zip(completeness.as_ref()).map(|(surface, found)| surface.shares(found));
    Prediction { coverage, returns, shares }
}

/// The revolutions of a sensor, the last one as far as it goes.
fn turns(scanner: &Scanner<'_>, sensor: usize) -> impl Iterator<Item = (usize, Range<u64>)> {
    let (columns, per_turn) = (scanner.columns(sensor), u64::from(scanner.spins[sensor].columns));
    (0..columns.div_ceil(per_turn))
        .map(move |turn| (sensor, turn * per_turn..columns.min((turn + 1) * per_turn)))
}

/// Share of the beams, every 8th column of about 24 revolutions, of which a map does not know where they end: they cross
/// an unseen voxel, or leave the map.
pub(crate) fn unknown_share(scanner: &Scanner<'_>, map: &VoxelMap) -> f64 {
    const COLUMN_STEP: usize = 8;
    let count = |sensor: usize| {
        let sweep = scanner.sweep(sensor);
        let turns: Vec<_> = turns(scanner, sensor).map(|(_, columns)| columns).collect();
        let step = search_step(turns.len() as u64) as usize;
        let columns: Vec<u64> = turns.into_iter().step_by(step).flatten().step_by(COLUMN_STEP).collect();
        let of_column = |column: &u64| {
            let rays = sweep.rays(*column);
            let unknown =
                rays.iter().filter(|(origin_m, direction)| map.is_unknown(*origin_m, *direction)).count();
            [unknown as u64, rays.len() as u64]
        };
        columns.par_iter().map(of_column).reduce(|| [0, 0], |a, b| [a[0] + b[0], a[1] + b[1]])
    };
    let counts = (0..scanner.rig.sensors.len()).map(count);
    let [unknown, all] = counts.fold([0, 0], |a, b| [a[0] + b[0], a[1] + b[1]]);
    unknown as f64 / all.max(1) as f64
}
