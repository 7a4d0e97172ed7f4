//! What a rig will see of a site, by every ray of it; and what single sensors would see.

mod doubts;
mod omissions;
mod site;

pub(crate) use doubts::doubts;
pub(crate) use omissions::{Omission, omissions};
pub(crate) use site::{Site, grid_of};

use std::collections::HashMap;
use std::hash::BuildHasherDefault;
use std::ops::Range;

use rayon::prelude::*;
use serde::Serialize;

use super::Progress;
use super::baselines::{Baselines, SCAN_PITCHES_DEG, Single, by_scans, search_step, strongest};
use super::occluder::Occluder;
use super::rounds::{is_worth_settling, rounds};
use super::scan::Scanner;
use super::view::CellHasher;
use crate::rig::{Mount, MountedSensor, Rig};
use crate::world::coverage::{Coverage, VoxelGrid};
use crate::world::scene::VoxelMap;
use crate::world::surface::{Completeness, MAIN_RANK, ObservableSurface, SurfaceShares, THRESHOLDS_M};

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
    let sensors = 0..scanner.rig.sensors.len();
    progress(Progress::Total(sensors.map(|sensor| turns(scanner, sensor).count() as u64).sum()));
    scan(scanner, grid, surface, progress)
}

fn scan(
    scanner: &Scanner<'_>,
    grid: &VoxelGrid,
    surface: Option<&ObservableSurface>,
    progress: &(dyn Fn(Progress) + Sync),
) -> Prediction {
    let sensors = scanner.rig.sensors.len();
    let sweeps: Vec<_> = (0..sensors).map(|sensor| scanner.sweep(sensor)).collect();
    let turns: Vec<_> = (0..sensors).flat_map(|sensor| turns(scanner, sensor)).collect();
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

/// A revolution in parts for several threads.
fn quarters(columns: &Range<u64>) -> impl Iterator<Item = Range<u64>> + use<> {
    let (start, end) = (columns.start, columns.end);
    let step = (end - start).div_ceil(4).max(1);
    (start..end).step_by(step as usize).map(move |first| first..end.min(first + step))
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

/// What one sensor sees.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct SinglePrediction {
    pub unique_voxels: u64,
    /// Voxels of the rig less those of the single sensor.
    pub gain_voxels: i64,
    #[serde(flatten)]
    pub shares: Option<SurfaceShares>,
}

/// One level sensor and the best single one, of the rig's model with the most channels.
pub(crate) fn baselines(
    scanner: &Scanner<'_>,
    grid: &VoxelGrid,
    surface: Option<&ObservableSurface>,
    of_rig: &Prediction,
    progress: &(dyn Fn(Progress) + Sync),
) -> Baselines<SinglePrediction> {
    let sensors = &scanner.rig.sensors;
    let strongest = strongest(scanner.rig);
    let rig_of = |mount: Mount| Rig {
        sensors: vec![MountedSensor { mount, name: "single".into(), ..sensors[strongest].clone() }],
    };
    // of the search some revolutions, of what was found all, and all of the level one
    let all = turns(scanner, strongest).count() as u64;
    let tried = all.div_ceil(step(scanner, strongest));
    progress(Progress::Total(SCAN_PITCHES_DEG.len() as u64 * tried + 2 * all));
    let voxels_of_rig = of_rig.coverage.union_count() as i64;
    let mounts: Vec<_> = sensors.iter().map(|sensor| sensor.mount).collect();
    by_scans(
        &mounts,
        |mount| {
            let rig = rig_of(mount);
            let value = value_of_some(&single(scanner, strongest, &rig), grid, surface);
            progress(Progress::Done(tried));
            value
        },
        |mount| {
            let rig = rig_of(mount);
            let alone = scan(&single(scanner, strongest, &rig), grid, surface, progress);
            let unique_voxels = alone.coverage.union_count();
            let gain_voxels = voxels_of_rig - unique_voxels as i64;
            let seen = SinglePrediction { unique_voxels, gain_voxels, shares: alone.shares };
            Single::new(&sensors[strongest].model.name, &mount, seen)
        },
        |seen| seen.shares.as_ref().map_or(seen.unique_voxels as f64, SurfaceShares::main),
        match surface {
            Some(_) => "completeness at 0.05 m on some revolutions",
            None => "unique_voxels on some revolutions",
        },
    )
}

/// Which of a sensor's revolutions are cast in a search: as many whole ones as there are speak for it.
fn step(scanner: &Scanner<'_>, sensor: usize) -> u64 {
    search_step(scanner.columns(sensor) / u64::from(scanner.spins[sensor].columns))
}

/// The scanner with one sensor: no other housing stands before it, the operator does.
fn single<'a>(scanner: &Scanner<'a>, sensor: usize, rig: &'a Rig) -> Scanner<'a> {
    let solids = scanner.occluders[sensor].iter();
    let operator = solids.filter(|solid| matches!(solid, Occluder::Capsule { .. })).copied().collect();
    Scanner { rig, spins: vec![scanner.spins[sensor]], occluders: vec![operator], ..scanner.clone() }
}

/// What some revolutions of the only sensor see: share of the surface within 5 cm, or voxels where there is no surface.
fn value_of_some(scanner: &Scanner<'_>, grid: &VoxelGrid, surface: Option<&ObservableSurface>) -> f64 {
    let turns: Vec<_> = turns(scanner, 0).map(|(_, columns)| columns).collect();
    let sweep = scanner.sweep(0);
    let chosen: Vec<_> = turns.into_iter().step_by(step(scanner, 0) as usize).collect();
    if let Some(surface) = surface {
        let mut found = Completeness::new(&surface.samples, &THRESHOLDS_M[MAIN_RANK..=MAIN_RANK]);
        for (round, numbers) in rounds(chosen.len() as u64).iter().enumerate() {
            let parts: Vec<_> =
                numbers.iter().flat_map(|number| quarters(&chosen[*number as usize])).collect();
            parts.par_iter().for_each(|columns| {
                let mut adder = found.adder();
                sweep.columns(columns.clone(), |column| {
                    column.returns.iter().for_each(|back| found.add(&mut adder, back.point_m));
                });
            });
            if is_worth_settling(round) {
                found.settle();
            }
        }
        return found.shares()[0];
    }
    let cover = |columns: &Range<u64>| {
        let mut coverage = Coverage::new(grid.clone(), 1);
        sweep.columns(columns.clone(), |column| {
            column.returns.iter().for_each(|back| coverage.add(0, back.point_m));
        });
        coverage
    };
    let join = |mut all: Coverage, more: Coverage| {
        all.join(&more);
        all
    };
    chosen.par_iter().map(cover).reduce_with(join).map_or(0.0, |seen| seen.union_count() as f64)
}
