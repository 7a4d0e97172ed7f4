//! The rig's state, and whether it can go where the mount file says.

use std::path::Path;

use super::{Check, State};
use crate::commands::Verb;
use crate::commands::defaults::section;
use crate::drive::{LinkError, Options, Rig, RigError, RigStatus};
use crate::live::config::Config;

/// One pair of limits is for every axis of a rig, and these are their number.
const AXES: usize = 2;

pub(super) fn rig(port: &Path, config: Option<&Config>, pitches_deg: &[f64]) -> Vec<Check> {
    let name = format!("rig {}", port.display());
    let options = match config.map_or_else(|| Ok(Options::new_session()), options) {
        Ok(options) => options,
        Err(error) => return vec![Check::new(&name, State::Bad, format!("{error:#}"), "mend [rig]")],
    };
    let connected = Rig::connect_with(port, options).and_then(|rig| Ok((rig.status()?, rig)));
    let (status, rig) = match connected {
        Ok(connected) => connected,
        Err(error @ RigError::Link(LinkError::InUse { .. })) => {
            let advice = "a daemon that runs has it, and its page shows the rig: end it to look from here";
            return vec![Check::new(&name, State::Warning, error.to_string(), advice)];
        }
        Err(error) => {
            let advice = "is it plugged in and powered; may you open it (group dialout, or the udev rule)?";
            return vec![Check::new(&name, State::Bad, error.to_string(), advice)];
        }
    };
    let mut checks = vec![of_state(&name, &status)];
    let pitches_rad: Vec<f64> = pitches_deg.iter().map(|pitch_deg| pitch_deg.to_radians()).collect();
    let axes = status.axes.len();
    if !pitches_rad.is_empty() && pitches_rad.len() != axes {
        let found = format!("{axes} axes, {} sensors of the mount file for them", pitches_rad.len());
        checks.push(Check::new(
            &name,
            State::Warning,
            found,
            "`sensors` under [rig.apply] says which are on axis 0, 1, ...",
        ));
    } else if !pitches_rad.is_empty()
        && let Err(error) = rig.check(&pitches_rad)
    {
        let found = format!("cannot go where the mount file says: {error}");
        checks.push(Check::new(&name, State::Bad, found, "loosen `limits_deg`, or take another mount"));
    }
    checks
}

fn options(config: &Config) -> anyhow::Result<Options> {
    let args: crate::commands::rig_args::Args = section(config, &["rig", "status"], |verb| match verb {
        Verb::Rig(args) => Some(args),
        _ => None,
    })?;
    crate::commands::rig_args::options(&args, AXES)
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
        return Check::new(name, State::Bad, found, "mend the cause, then `outrigger rig clear`");
    }
    if status.axes.iter().any(|axis| !axis.homed) {
        return Check::new(
            name,
            State::Warning,
            format!("{found}, not homed"),
            "`outrigger rig home --arm` before the first move",
        );
    }
    Check::new(name, State::Ok, format!("{found}, homed"), "")
}
