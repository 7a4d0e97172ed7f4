//! Registration strength along the path of a scanner.

use serde::Serialize;

use super::{Information, RegistrationQuality, least_along};
use crate::simulate::scan::Scanner;

/// Every so many columns of a revolution count.
const COLUMN_STEP: u64 = 8;
/// Revolutions that are sampled, spread evenly over the path.
const MAX_TURNS: u64 = 400;

/// The registration quality of the scans along a path.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct PathRegistration {
    /// Null for a path shorter than a revolution of the first sensor, or without a hit.
    pub registration: Option<RegistrationQuality>,
    /// `[distance travelled m, translation, rotation m^2]`: least eigenvalues per hit of each sampled revolution.
    pub registration_path: Vec<[f64; 3]>,
}

impl PathRegistration {
    /// The least translation eigenvalue over the distance travelled.
    pub(crate) fn least_translation(&self) -> Vec<[f64; 2]> {
        self.registration_path.iter().map(|[travelled_m, least, _]| [*travelled_m, *least]).collect()
    }
}

impl PathRegistration {
    /// Casts every 8th column of whole revolutions of the first sensor, and what the others return meanwhile.
    pub(crate) fn of_scanner(scanner: &Scanner<'_>) -> Self {
        let turns = scanner.columns(0).saturating_sub(1) / u64::from(scanner.spins[0].columns);
        let step = turns.div_ceil(MAX_TURNS).max(1);
        let sampled: Vec<u64> = (0..turns).step_by(step as usize).collect();
        let scans: Vec<Information> = sampled.iter().map(|turn| of_turn(scanner, *turn)).collect();
        let (mut travelled_m, mut before) = (0.0, None);
        let at = |(turn, [translation, rotation_m2]): (&u64, [f64; 2])| {
            let here = scanner.trajectory.at(turn_ns(scanner, *turn)).map(|pose| pose.translation_m);
            travelled_m +=
                here.zip(before).map_or(0.0, |(here, before): (glam::DVec3, _)| here.distance(before));
            before = here.or(before);
            [travelled_m, translation, rotation_m2]
        };
        Self {
            registration: RegistrationQuality::of_scans(&scans),
            registration_path: sampled.iter().zip(least_along(&scans)).map(at).collect(),
        }
    }
}

fn turn_ns(scanner: &Scanner<'_>, turn: u64) -> u64 {
    let spin = &scanner.spins[0];
    scanner.trajectory.time_span_ns()[0] + spin.offset_ns(turn * u64::from(spin.columns))
}

/// The hits of all sensors in the time of one revolution of the first.
fn of_turn(scanner: &Scanner<'_>, turn: u64) -> Information {
    let mut information = Information::default();
    let Some(world_from_body) = scanner.trajectory.at(turn_ns(scanner, turn)) else { return information };
    for (sensor, spin) in scanner.spins.iter().enumerate() {
        let per_turn = f64::from(spin.columns) * spin.rate_hz / scanner.spins[0].rate_hz;
        let [first, end] = [turn, turn + 1].map(|turn| (turn as f64 * per_turn).round() as u64);
        for column in (first..end).step_by(COLUMN_STEP as usize) {
            let Some(column) = scanner.column(sensor, column) else { continue };
            for back in &column.returns {
                information.add(back.point_m - world_from_body.translation_m, back.normal);
            }
        }
    }
    information
}
