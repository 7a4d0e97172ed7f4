//! What a prediction leaves out of the model, and what that is worth.

use serde::Serialize;

use crate::base::numbers::number;
use crate::simulate::baselines::search_step;
use crate::simulate::detection::Detection;
use crate::simulate::occluder::Occluder;
use crate::simulate::scan::{Scanner, SensorErrors};
use crate::world::coverage::{Coverage, VoxelGrid};

/// Columns that are cast together, and from how many.
const COLUMNS: (u64, usize) = (4, 32);
const SUB_RAYS: u32 = 8;
/// A dark wall: what data sheets state the least range of.
const DARK: f64 = 0.1;
/// Range noise of a spinning sensor at its worst, m.
const NOISE_M: f64 = 0.03;

/// Something that the model leaves out.
#[derive(Serialize)]
pub(crate) struct Omission {
    what: String,
    /// Change of the voxels seen with it, share of them, on some of the columns; null where it was not measured.
    worth: Option<f64>,
    why: String,
}

impl Omission {
    /// In words.
    pub(crate) fn words(&self) -> String {
        let worth =
            self.worth.map_or(String::new(), |worth| format!("{:+.2} % of the voxels; ", 100.0 * worth));
        format!("{}: {worth}{}", self.what, self.why)
    }
}

/// Effects that were not asked for, each measured by itself on some of the columns.
pub(crate) fn omissions(scanner: &Scanner<'_>, grid: &VoxelGrid) -> Vec<Omission> {
    let plain = voxels_of_some(scanner, grid);
    let sensor_errors = scanner.sensor_errors;
    let mut all = Vec::new();
    let mut effect = |what: String, why: String, scanner: &Scanner<'_>| {
        let worth = (plain > 0).then(|| voxels_of_some(scanner, grid) as f64 / plain as f64 - 1.0);
        all.push(Omission { what, worth, why });
    };
    let with = |sensor_errors: SensorErrors| Scanner { sensor_errors, ..scanner.clone() };
    if sensor_errors.sub_rays == 0 {
        let wide = scanner.rig.sensors.iter().map(|sensor| sensor.model.divergence_rad).fold(0.0, f64::max);
        effect(
            "width of the beams".into(),
            format!(
                "{} mm at 10 m, voxels of {} mm; --sub-rays {SUB_RAYS} models it",
                number(10_000.0 * wide, 0),
                number(1000.0 * grid.voxel_m, 0)
            ),
            &with(SensorErrors { sub_rays: SUB_RAYS, ..sensor_errors }),
        );
    }
    if sensor_errors.detection.is_none() {
        effect(
            format!("surfaces of {} % reflectivity", 100.0 * DARK),
            format!("lost far off and at grazing angles; --reflectivity {DARK} models them"),
            &with(SensorErrors { detection: Some(Detection { reflectivity: DARK }), ..sensor_errors }),
        );
    }
    if sensor_errors.range_noise_m == 0.0 {
        effect(
            format!("range noise of {} mm", 1000.0 * NOISE_M),
            format!("it fills voxels next to the surface; --range-noise {NOISE_M} models it"),
            &with(SensorErrors { range_noise_m: NOISE_M, ..sensor_errors }),
        );
    }
    if scanner.rig.sensors.len() > 1 && scanner.occluders.iter().all(|solids| !has_housing(solids)) {
        let mut shaded = scanner.clone();
        for (sensor, solids) in shaded.occluders.iter_mut().enumerate() {
            solids.extend(Occluder::other_housings(scanner.rig, sensor));
        }
        effect("housings of the other sensors".into(), "left out by --no-housings".into(), &shaded);
    }
    if !scanner.occluders.iter().flatten().any(is_operator) {
        all.push(Omission {
            what: "operator".into(),
            worth: None,
            why: "position unknown; --operator models them".into(),
        });
    }
    all
}

fn is_operator(solid: &Occluder) -> bool {
    matches!(solid, Occluder::Capsule { .. })
}

fn has_housing(solids: &[Occluder]) -> bool {
    solids.iter().any(|solid| !is_operator(solid))
}

/// Voxels that every eighth column of about 24 revolutions sees.
fn voxels_of_some(scanner: &Scanner<'_>, grid: &VoxelGrid) -> u64 {
    let (together, of) = COLUMNS;
    let mut coverage = Coverage::new(grid.clone(), scanner.rig.sensors.len());
    for sensor in 0..scanner.rig.sensors.len() {
        let (sweep, columns) = (scanner.sweep(sensor), scanner.columns(sensor));
        let per_turn = u64::from(scanner.spins[sensor].columns);
        let turns = (0..columns).step_by((per_turn * search_step(columns / per_turn)) as usize);
        for first in turns.flat_map(|turn| (turn..columns.min(turn + per_turn)).step_by(of)) {
            sweep.columns(first..columns.min(first + together), |column| {
                column.returns.iter().for_each(|back| coverage.add(sensor, back.point_m));
            });
        }
    }
    coverage.union_count()
}
