//! What single sensors would see: by a tenth of the rig's rays, and the rig by the same ones.

use std::collections::HashMap;
use std::hash::BuildHasherDefault;
use std::ops::Range;

use rayon::prelude::*;
use serde::Serialize;

use super::{Hits, turns};
use crate::base::statistics::mean_and_deviation;
use crate::rig::{Mount, MountedSensor, Rig};
use crate::simulate::Progress;
use crate::simulate::baselines::{Baselines, SCAN_PITCHES_DEG, Single, by_scans, search_step, strongest};
use crate::simulate::occluder::Occluder;
use crate::simulate::rounds::{is_worth_settling, rounds};
use crate::simulate::scan::Scanner;
use crate::simulate::view::CellHasher;
use crate::world::coverage::{Coverage, VoxelGrid};
use crate::world::surface::{Completeness, MAIN_RANK, ObservableSurface, SurfaceShares, THRESHOLDS_M};

/// Every so many revolutions are cast, and no fewer than so many.
const EVERY: usize = 10;
const LEAST_TURNS: usize = 10;
/// Each of these leaves out its part of the revolutions: how much a difference changes then says how sure it is.
const BLOCKS: usize = 10;

/// The rig and single sensors by the same rays.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct SceneBaselines {
    /// Share of the rig's rays that these are.
    pub rays_share: f64,
    pub rig: RigByThese,
    #[serde(flatten)]
    pub singles: Baselines<SinglePrediction>,
}

/// What the rig sees by these rays.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct RigByThese {
    pub unique_voxels: u64,
    #[serde(flatten)]
    pub shares: Option<SurfaceShares>,
}

/// What one sensor sees.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct SinglePrediction {
    pub unique_voxels: u64,
    /// Voxels of the rig less those of the single sensor, by the same revolutions.
    pub gain_voxels: i64,
    /// Its standard deviation over the choice of revolutions (jackknife).
    pub gain_sd_voxels: f64,
    #[serde(flatten)]
    pub shares: Option<SurfaceShares>,
}

impl SceneBaselines {
    /// In words: by which rays.
    pub(crate) fn rays_words(&self) -> String {
        format!("by {:.0} % of the rays", 100.0 * self.rays_share)
    }

    /// How much of the surface the rig and each single sensor cover by these rays, by name.
    pub(crate) fn shares(&self) -> impl Iterator<Item = (String, &SurfaceShares)> {
        let rig = ("rig by these".to_owned(), self.rig.shares.as_ref());
        let singles =
            self.singles.named().map(|(name, single)| (name.to_owned(), single.seen.shares.as_ref()));
        std::iter::once(rig).chain(singles).filter_map(|(name, shares)| Some((name, shares?)))
    }
}

impl SinglePrediction {
    /// In words: how much more the rig sees.
    pub(crate) fn gain_words(&self) -> String {
        format!("{:+} ± {:.0}", self.gain_voxels, self.gain_sd_voxels)
    }
}

/// One level sensor and the best single one, of the rig's model with the most channels.
pub(crate) fn baselines(
    scanner: &Scanner<'_>,
    grid: &VoxelGrid,
    surface: Option<&ObservableSurface>,
    progress: &(dyn Fn(Progress) + Sync),
) -> SceneBaselines {
    let sensors = &scanner.rig.sensors;
    let strongest = strongest(scanner.rig);
    let rig_of = |mount: Mount| Rig {
        sensors: vec![MountedSensor { mount, name: "single".into(), ..sensors[strongest].clone() }],
    };
    let all: usize = (0..sensors.len()).map(|sensor| turns(scanner, sensor).count()).sum();
    let of_rig = chosen(scanner).len();
    let of_one = chosen_of(scanner, strongest).count();
    let tried = turns(scanner, strongest).step_by(step(scanner, strongest)).count() as u64;
    progress(Progress::Total(SCAN_PITCHES_DEG.len() as u64 * tried + (of_rig + 2 * of_one) as u64));
    let rig = scan(scanner, grid, surface, progress);
    let mounts: Vec<_> = sensors.iter().map(|sensor| sensor.mount).collect();
    let singles = by_scans(
        &mounts,
        |mount| {
            let rig = rig_of(mount);
            let value = value_of_some(&single(scanner, strongest, &rig), grid, surface);
            progress(Progress::Done(tried));
            value
        },
        |mount| {
            let alone = rig_of(mount);
            let alone = scan(&single(scanner, strongest, &alone), grid, surface, progress);
            let (gain_voxels, gain_sd_voxels) = rig.gain_over(&alone);
            let (unique_voxels, shares) = (alone.union, alone.shares);
            let seen = SinglePrediction { unique_voxels, gain_voxels, gain_sd_voxels, shares };
            Single::new(&sensors[strongest].model.name, &mount, seen)
        },
        |seen| seen.shares.as_ref().map_or(seen.unique_voxels as f64, SurfaceShares::main),
        match surface {
            Some(_) => "completeness at 0.05 m on some revolutions",
            None => "unique_voxels on some revolutions",
        },
    );
    SceneBaselines {
        rays_share: of_rig as f64 / all.max(1) as f64,
        rig: RigByThese { unique_voxels: rig.union, shares: rig.shares },
        singles,
    }
}

/// What is seen by some revolutions.
struct SomeSeen {
    union: u64,
    /// The same without each block.
    without: [u64; BLOCKS],
    shares: Option<SurfaceShares>,
}

impl SomeSeen {
    /// Voxels seen more than by another, and the jackknife's standard deviation of that.
    fn gain_over(&self, other: &Self) -> (i64, f64) {
        let less = |own: u64, other: u64| own as i64 - other as i64;
        let gains: Vec<f64> =
            (0..BLOCKS).map(|block| less(self.without[block], other.without[block]) as f64).collect();
        let (_, deviation) = mean_and_deviation(&gains);
        (less(self.union, other.union), deviation * (BLOCKS - 1) as f64 / (BLOCKS as f64).sqrt())
    }
}

/// The revolutions that are cast: by sensor, in order.
fn chosen(scanner: &Scanner<'_>) -> Vec<(usize, Range<u64>)> {
    (0..scanner.rig.sensors.len()).flat_map(|sensor| chosen_of(scanner, sensor)).collect()
}

fn chosen_of(scanner: &Scanner<'_>, sensor: usize) -> impl Iterator<Item = (usize, Range<u64>)> {
    let every = (turns(scanner, sensor).count() / LEAST_TURNS).clamp(1, EVERY);
    turns(scanner, sensor).step_by(every)
}

fn scan(
    scanner: &Scanner<'_>,
    grid: &VoxelGrid,
    surface: Option<&ObservableSurface>,
    progress: &(dyn Fn(Progress) + Sync),
) -> SomeSeen {
    let sweeps: Vec<_> = (0..scanner.rig.sensors.len()).map(|sensor| scanner.sweep(sensor)).collect();
    let chosen = chosen(scanner);
    let completeness = surface.map(|surface| Completeness::new(&surface.samples, &THRESHOLDS_M));
    let of_block = |block: usize| {
        let mut hits = Hits::default();
        let mut found = completeness.as_ref().map(|completeness| (completeness, completeness.adder()));
        for (sensor, columns) in chosen.iter().skip(block).step_by(BLOCKS) {
            sweeps[*sensor].columns(columns.clone(), |column| {
                for back in &column.returns {
                    grid.index(back.point_m).iter().for_each(|cell| hits.add(*cell, 1));
                    found.iter_mut().for_each(|(completeness, adder)| completeness.add(adder, back.point_m));
                }
            });
            progress(Progress::Done(1));
        }
        hits
    };
    let blocks: Vec<Hits> = (0..BLOCKS).into_par_iter().map(of_block).collect();
    let mut by_cell: HashMap<usize, [u64; BLOCKS], BuildHasherDefault<CellHasher>> = HashMap::default();
    for (block, hits) in blocks.iter().enumerate() {
        for (cell, count) in &hits.0 {
            by_cell.entry(*cell).or_default()[block] = *count;
        }
    }
    let needed = u64::from(scanner.min_hits.max(1));
    let (mut union, mut without) = (0, [0; BLOCKS]);
    for counts in by_cell.values() {
        let all: u64 = counts.iter().sum();
        union += u64::from(all >= needed);
        for (without, count) in without.iter_mut().zip(counts) {
            *without += u64::from(all - count >= needed);
        }
    }
    let shares = surface.zip(completeness.as_ref()).map(|(surface, found)| surface.shares(found));
    SomeSeen { union, without, shares }
}

/// Which of a sensor's revolutions are cast in a search: about 24 speak for the path.
fn step(scanner: &Scanner<'_>, sensor: usize) -> usize {
    search_step(scanner.columns(sensor) / u64::from(scanner.spins[sensor].columns)) as usize
}

/// The scanner with one sensor: no other housing stands before it, the operator does.
fn single<'a>(scanner: &Scanner<'a>, sensor: usize, rig: &'a Rig) -> Scanner<'a> {
    let solids = scanner.occluders[sensor].iter();
    let operator = solids.filter(|solid| matches!(solid, Occluder::Capsule { .. })).copied().collect();
    Scanner { rig, spins: vec![scanner.spins[sensor]], occluders: vec![operator], ..scanner.clone() }
}

/// A revolution in parts for several threads.
fn quarters(columns: &Range<u64>) -> impl Iterator<Item = Range<u64>> + use<> {
    let (start, end) = (columns.start, columns.end);
    let step = (end - start).div_ceil(4).max(1);
    (start..end).step_by(step as usize).map(move |first| first..end.min(first + step))
}

/// What some revolutions of the only sensor see: share of the surface within 5 cm, or voxels where there is no surface.
fn value_of_some(scanner: &Scanner<'_>, grid: &VoxelGrid, surface: Option<&ObservableSurface>) -> f64 {
    let turns: Vec<_> = turns(scanner, 0).map(|(_, columns)| columns).collect();
    let sweep = scanner.sweep(0);
    let chosen: Vec<_> = turns.into_iter().step_by(step(scanner, 0)).collect();
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
