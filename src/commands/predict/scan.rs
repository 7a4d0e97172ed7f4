//! The scans of a prediction: those of the rig, and those of the single sensors beside it.

use rayon::prelude::*;
use serde::Serialize;

use crate::commands::baselines::{Baselines, SCAN_PITCHES_DEG, Single, best_pitch, level_mount, search_step};
use crate::commands::surface::{Covered, Surface};
use crate::coverage::{Coverage, VoxelGrid};
use crate::rig::{Mount, MountedSensor, Rig};
use crate::simulate::occluder::Occluder;
use crate::simulate::scan::Scanner;
use crate::surface::{Completeness, THRESHOLDS_M};

/// What a rig saw.
pub struct Scanned {
    pub coverage: Coverage,
    /// Returns by sensor.
    pub returns: Vec<u64>,
    pub covered: Option<Covered>,
}

/// Scans the whole way.
pub fn scan(scanner: &Scanner<'_>, grid: &VoxelGrid, surface: Option<&Surface>) -> Scanned {
    let sensors = scanner.rig.sensors.len();
    let mut coverage = Coverage::new(grid.clone(), sensors);
    let mut returns = vec![0; sensors];
    let mut completeness = surface.map(|surface| Completeness::new(&surface.samples, &THRESHOLDS_M));
    let mut adder = completeness.as_ref().map(Completeness::adder);
    let mut last_sensor = 0;
    scanner.for_each_column(|sensor, column| {
        returns[sensor] += column.returns.len() as u64;
        if let (Some(completeness), Some(adder)) = (&mut completeness, &mut adder) {
            if sensor != last_sensor {
                last_sensor = sensor;
                completeness.settle();
            }
            column.returns.iter().for_each(|back| completeness.add(adder, back.point_m));
        }
        for back in &column.returns {
            coverage.add(sensor, back.point_m);
        }
    });
    let covered = surface.zip(completeness.as_ref()).map(|(surface, found)| surface.covered(found));
    Scanned { coverage, returns, covered }
}

/// What one sensor sees.
#[derive(Clone, Debug, Serialize)]
pub struct Alone {
    pub unique_voxels: u64,
    /// Voxels of the rig less those of the single sensor.
    pub gain_voxels: i64,
    #[serde(flatten)]
    pub covered: Option<Covered>,
}

/// One level sensor and the best single one, of the rig's model with the most channels.
pub fn baselines(
    scanner: &Scanner<'_>,
    grid: &VoxelGrid,
    surface: Option<&Surface>,
    scanned: &Scanned,
) -> Baselines<Alone> {
    let sensors = &scanner.rig.sensors;
    let mounts: Vec<_> = sensors.iter().map(|sensor| sensor.mount).collect();
    let level = level_mount(&mounts);
    // of equals the first
    let strongest =
        (0..sensors.len()).rev().max_by_key(|sensor| sensors[*sensor].model.channels()).unwrap_or(0);
    let rig_of = |mount: Mount| Rig {
        sensors: vec![MountedSensor { mount, name: "single".into(), ..sensors[strongest].clone() }],
    };
    let of_rig = scanned.coverage.union_count() as i64;
    let alone = |mount: Mount| {
        let rig = rig_of(mount);
        let seen = scan(&single(scanner, strongest, &rig), grid, surface);
        let unique_voxels = seen.coverage.union_count();
        let gain_voxels = of_rig - unique_voxels as i64;
        let seen = Alone { unique_voxels, gain_voxels, covered: seen.covered };
        Single::new(&sensors[strongest].model.name, &mount, seen)
    };
    let tilted = |pitch_deg: f64| Mount { pitch_rad: pitch_deg.to_radians(), ..level };
    let (best_deg, pitch_search) = best_pitch(&SCAN_PITCHES_DEG, |pitch_deg| {
        let rig = rig_of(tilted(pitch_deg));
        count_some(&single(scanner, strongest, &rig), grid) as f64
    });
    let level_single = alone(level);
    let mut best_single = if best_deg == 0.0 { level_single.clone() } else { alone(tilted(best_deg)) };
    // the search saw a part of the way only
    if best_single.seen.unique_voxels < level_single.seen.unique_voxels {
        best_single = level_single.clone();
    }
    Baselines {
        level_single,
        best_single,
        first_single: None,
        pitch_search,
        search_by: "unique_voxels on some revolutions",
    }
}

/// The scanner with one sensor: no other housing is in its way, the wearer is.
fn single<'a>(scanner: &Scanner<'a>, sensor: usize, rig: &'a Rig) -> Scanner<'a> {
    let solids = scanner.occluders[sensor].iter();
    let wearer = solids.filter(|solid| matches!(solid, Occluder::Capsule { .. })).copied().collect();
    Scanner { rig, spins: vec![scanner.spins[sensor]], occluders: vec![wearer], ..scanner.clone() }
}

/// Voxels seen on some revolutions of the only sensor.
fn count_some(scanner: &Scanner<'_>, grid: &VoxelGrid) -> u64 {
    let per_turn = u64::from(scanner.spins[0].columns);
    let columns = scanner.columns(0);
    let step = search_step(columns / per_turn);
    let chosen: Vec<u64> = (0..columns).filter(|column| (column / per_turn).is_multiple_of(step)).collect();
    let mut coverage = Coverage::new(grid.clone(), 1);
    for part in chosen.chunks(4096) {
        let made: Vec<_> = part.par_iter().filter_map(|column| scanner.column(0, *column)).collect();
        made.iter().flat_map(|column| &column.returns).for_each(|back| coverage.add(0, back.point_m));
    }
    coverage.union_count()
}
