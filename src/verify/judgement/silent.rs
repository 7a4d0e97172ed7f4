//! Sensors and channels without data.

use crate::recording::Fault;
use crate::verify::compare::Replayed;

/// Sensors without data or returns, and channels without returns.
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
        let dead: Vec<String> = breakdown
            .by_channel()
            .iter()
            .enumerate()
            .filter(|(_, rays)| rays.drop >= 100 && rays.agree + rays.short + rays.long + rays.extra == 0)
            .map(|(channel, _)| channel.to_string())
            .collect();
        if !dead.is_empty() {
            let words = format!("{name}: no return in channels {} (counted from 0)", dead.join(", "));
            faults.push(fault("dead_channel", name, words));
        }
    }
    faults
}
