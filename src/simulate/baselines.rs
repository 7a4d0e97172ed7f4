//! The single sensors with which a rig is compared: one level, and the best one, where the middle of the rig is.

use serde::Serialize;

use crate::rig::{Mount, Rig};

/// Single sensors and what they see.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Baselines<T> {
    /// One sensor, spin axis upright.
    pub level_single: Single<T>,
    /// The best pitch of one sensor, as the search found it.
    pub best_single: Single<T>,
    /// The rig's own first sensor without the others.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub first_single: Option<Single<T>>,
    /// `[pitch_deg, value]` of every pitch that was tried.
    pub pitch_search: Vec<[f64; 2]>,
    /// What the search compared.
    pub search_by: &'static str,
}

/// One sensor alone.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Single<T> {
    pub model: String,
    pub x_m: f64,
    pub y_m: f64,
    pub z_m: f64,
    pub pitch_deg: f64,
    pub roll_deg: f64,
    #[serde(flatten)]
    pub seen: T,
}

impl<T> Single<T> {
    /// A sensor and what it sees.
    pub(crate) fn new(model: &str, mount: &Mount, seen: T) -> Self {
        Self {
            model: model.into(),
            x_m: mount.x_m,
            y_m: mount.y_m,
            z_m: mount.z_m,
            pitch_deg: mount.pitch_rad.to_degrees(),
            roll_deg: mount.roll_rad.to_degrees(),
            seen,
        }
    }
}

impl<T> Baselines<T> {
    /// The baselines by name, for tables.
    pub(crate) fn named(&self) -> impl Iterator<Item = (&'static str, &Single<T>)> {
        let first = self.first_single.as_ref().map(|single| ("first single", single));
        [("level single", &self.level_single), ("best single", &self.best_single)].into_iter().chain(first)
    }
}

/// A level sensor on the rig's plane of symmetry, at the mean height and place along the rig of its sensors.
pub(crate) fn level_mount(mounts: &[Mount]) -> Mount {
    let mean = |value: fn(&Mount) -> f64| mounts.iter().map(value).sum::<f64>() / mounts.len().max(1) as f64;
    Mount { y_m: mean(|mount| mount.y_m), z_m: mean(|mount| mount.z_m), ..Mount::default() }
}

/// The pitch with the largest value (of equals the smallest pitch), and every value.
pub(crate) fn best_pitch(pitches_deg: &[f64], value: impl Fn(f64) -> f64) -> (f64, Vec<[f64; 2]>) {
    let tried: Vec<[f64; 2]> = pitches_deg.iter().map(|pitch_deg| [*pitch_deg, value(*pitch_deg)]).collect();
    let best = tried.iter().max_by(|a, b| a[1].total_cmp(&b[1]).then(b[0].abs().total_cmp(&a[0].abs())));
    (best.map_or(0.0, |best| best[0]), tried)
}

/// One level sensor and the best single one, where a value costs a scan: pitches are compared by some revolutions, what
/// was found is cast whole.
pub(crate) fn by_scans<T: Clone>(
    mounts: &[Mount],
    value_of_some: impl Fn(Mount) -> f64,
    alone: impl Fn(Mount) -> Single<T>,
    value: impl Fn(&T) -> f64,
    search_by: &'static str,
) -> Baselines<T> {
    let level = level_mount(mounts);
    let tilted = |pitch_deg: f64| Mount { pitch_rad: pitch_deg.to_radians(), ..level };
    let (best_deg, pitch_search) =
        best_pitch(&SCAN_PITCHES_DEG, |pitch_deg| value_of_some(tilted(pitch_deg)));
    let level_single = alone(level);
    let mut best_single = if best_deg == 0.0 { level_single.clone() } else { alone(tilted(best_deg)) };
    // the search saw a part of the path only
    if value(&best_single.seen) < value(&level_single.seen) {
        best_single = level_single.clone();
    }
    Baselines { level_single, best_single, first_single: None, pitch_search, search_by }
}

/// The sensor with the most channels, of equals the first.
pub(crate) fn strongest(rig: &Rig) -> usize {
    let sensors = &rig.sensors;
    (0..sensors.len()).rev().max_by_key(|sensor| sensors[*sensor].model.channels()).unwrap_or(0)
}

/// Pitches tried in such a search: every 5 degrees to both sides.
pub(crate) const SCAN_PITCHES_DEG: [f64; 19] = [
    -45.0, -40.0, -35.0, -30.0, -25.0, -20.0, -15.0, -10.0, -5.0, 0.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0,
    35.0, 40.0, 45.0,
];

/// Every so many revolutions are cast in such a search, so that about 24 of them stand for the path.
pub(crate) fn search_step(revolutions: u64) -> u64 {
    (revolutions / 24).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_tilted_of_equals_is_best() {
        let (best, tried) = best_pitch(&SCAN_PITCHES_DEG, |pitch_deg| -(pitch_deg.abs() - 20.0).abs());
        assert_eq!((best.abs(), tried.len()), (20.0, 19));
        assert_eq!(best_pitch(&SCAN_PITCHES_DEG, |_| 1.0).0, 0.0);
    }
}
