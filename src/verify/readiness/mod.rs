//! Whether a machine, its sensors and its rig are ready to record, and what to do where they are not.

mod machine;
mod sensors;
mod servos;
mod traffic;

use serde::Serialize;

pub(crate) use machine::{clock, disk, governor, processors};
pub(crate) use sensors::ConfiguredSensors;
pub(crate) use servos::check_rig;
pub(crate) use traffic::Traffic;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum CheckState {
    Ok,
    Warning,
    Bad,
    /// Not known here.
    Unknown,
}

/// One check.
#[derive(Debug, Serialize)]
pub(crate) struct Check {
    pub(crate) name: String,
    pub(crate) state: CheckState,
    pub(crate) found: String,
    /// What to do.
    pub(crate) advice: Option<String>,
}

/// All checks.
#[derive(Debug, Serialize)]
pub(crate) struct Readiness {
    pub(crate) format: &'static str,
    pub(crate) verdict: &'static str,
    pub(crate) checks: Vec<Check>,
}

impl Check {
    pub(crate) fn new(name: &str, state: CheckState, found: impl Into<String>, advice: &str) -> Self {
        let advice = (state != CheckState::Ok && !advice.is_empty()).then(|| advice.to_owned());
        Self { name: name.into(), state, found: found.into(), advice }
    }
}

impl Readiness {
    pub(crate) fn of(checks: Vec<Check>) -> Self {
        let is_ready = checks.iter().all(|check| check.state != CheckState::Bad);
        let verdict = if is_ready { "ready" } else { "mend" };
        Self { format: "outrigger-doctor/1", verdict, checks }
    }

    pub(crate) fn is_ready(&self) -> bool {
        self.verdict == "ready"
    }
}
