//! Sensors and channels without data.

use crate::live::watch::silent_channels;
use crate::recording::Fault;
use crate::rig::rings;
use crate::verify::compare::Replayed;

/// Predicted returns of a channel, all of which are missing, that say something.
const LEAST_DROPS: u64 = 100;

/// Sensors without data or returns, and channels without returns between others that have some.
pub(super) fn silent(replayed: &Replayed, known: &[Fault]) -> Vec<Fault> {
    let fault = |name, sensor: &str, words| Fault::new(name, vec![sensor.to_owned()], words);
    let mut faults = Vec::new();
    for (sensor, breakdown) in replayed.sensors.iter().zip(&replayed.breakdown) {
        let name = &sensor.name;
        let total = breakdown.total();
        let explained = known.iter().any(|fault| fault.sensors.contains(name));
        if total.informative() + total.nothing + total.unplaced == 0 {
            if !explained {
                faults.push(fault("dead_sensor", name, format!("{name} is dead: not one revolution of it")));
            }
            continue;
        }
        let returns = total.agree + total.short + total.long + total.extra;
        if returns == 0 && total.drop > 0 {
            let words = format!("{name} is dead: its packets hold no return");
            faults.push(fault("dead_sensor", name, words));
            continue;
        }
        let shares: Vec<f64> = breakdown
            .by_channel()
            .iter()
            .map(|rays| {
                let returns = rays.agree + rays.short + rays.long + rays.extra;
                // where few should have returned none may have: that is not called silent
                let is_known = returns > 0 || rays.drop >= LEAST_DROPS;
                if is_known { returns as f64 / (returns + rays.drop).max(1) as f64 } else { 1.0 }
            })
            .collect();
        let numbers = rings(&sensor.model);
        let mut dead: Vec<u16> =
            silent_channels(&sensor.model, &shares).into_iter().map(|channel| numbers[channel]).collect();
        dead.sort_unstable();
        if !dead.is_empty() {
            let dead: Vec<String> = dead.iter().map(u16::to_string).collect();
            let words =
                format!("{name}: no return in ring {}, and its neighbours have some", dead.join(", "));
            faults.push(fault("dead_channel", name, words));
        }
    }
    faults
}
