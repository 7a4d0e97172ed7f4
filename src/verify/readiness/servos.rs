//! The rig's state, and whether it can go where the mount file says.

use std::path::Path;

use super::{Check, CheckState};
use crate::drive::{LinkError, Options, Rig, RigError, RigStatus};

/// Asks the rig at a port; `pitches_deg` are those of its axes by the mount file, where that is known.
pub(crate) fn check_rig(port: &Path, options: Options, pitches_deg: &[f64]) -> Vec<Check> {
    let name = format!("rig {}", port.display());
    let connected = Rig::connect_with(port, options).and_then(|rig| Ok((rig.status()?, rig)));
    let (status, rig) = match connected {
        Ok(connected) => connected,
        Err(error @ RigError::Link(LinkError::InUse { .. })) => {
            let advice = "a daemon that runs has it, and its page shows the rig: end it to look from here";
            return vec![Check::new(&name, CheckState::Warning, error.to_string(), advice)];
        }
        Err(error) => {
            let advice = "is it plugged in and powered; may you open it (group dialout, or the udev rule)?";
            return vec![Check::new(&name, CheckState::Bad, error.to_string(), advice)];
        }
    };
    let mut checks = vec![of_state(&name, &status)];
    let pitches_rad: Vec<f64> = pitches_deg.iter().map(|pitch_deg| pitch_deg.to_radians()).collect();
    let axes = status.axes.len();
    if !pitches_rad.is_empty() && pitches_rad.len() != axes {
        let found = format!("{axes} axes, {} sensors of the mount file for them", pitches_rad.len());
        checks.push(Check::new(
            &name,
            CheckState::Warning,
            found,
            "`sensors` under [rig.apply] says which are on axis 0, 1, ...",
        ));
    } else if !pitches_rad.is_empty()
        && let Err(error) = rig.check(&pitches_rad)
    {
        let found = format!("cannot go where the mount file says: {error}");
        checks.push(Check::new(&name, CheckState::Bad, found, "loosen `limits_deg`, or take another mount"));
    }
    checks
}

fn of_state(name: &str, status: &RigStatus) -> Check {
    let faults: Vec<String> = status
        .axes
        .iter()
        .filter(|axis| !axis.faults.is_empty())
        .map(|axis| format!("axis {}: {}", axis.axis, axis.faults.join(", ")))
        .collect();
    let found = format!("{} axes, firmware {}", status.axes.len(), status.firmware);
    if !faults.is_empty() {
        let found = format!("{found}; {}", faults.join("; "));
        return Check::new(name, CheckState::Bad, found, "mend the cause, then `outrigger rig clear`");
    }
    if status.axes.iter().any(|axis| !axis.homed) {
        return Check::new(
            name,
            CheckState::Warning,
            format!("{found}, not homed"),
            "`outrigger rig home --arm` before the first move",
        );
    }
    Check::new(name, CheckState::Ok, format!("{found}, homed"), "")
}
