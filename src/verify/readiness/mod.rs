//! Whether a machine, its sensors and its rig are ready to record, and what to do where they are not.

mod machine;
mod sensors;
mod servos;
mod traffic;

use std::fmt::Write as _;

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
    name: String,
    state: CheckState,
    found: String,
    /// What to do.
    advice: Option<String>,
}

/// All checks.
#[derive(Debug, Serialize)]
pub(crate) struct Readiness {
    format: &'static str,
    verdict: &'static str,
    checks: Vec<Check>,
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

    pub(crate) fn text(&self) -> String {
        let mut text = String::new();
        let width = self.checks.iter().map(|check| check.name.chars().count()).max().unwrap_or(0);
        for check in &self.checks {
            let state = match check.state {
                CheckState::Ok => "ok",
                CheckState::Warning => "WARN",
                CheckState::Bad => "MEND",
                CheckState::Unknown => "?",
            };
            let _ = writeln!(text, "{state:<5} {:<width$} {}", check.name, check.found);
            if let Some(advice) = &check.advice {
                let _ = writeln!(text, "{:indent$} -> {advice}", "", indent = width + 6);
            }
        }
        let count = |state: CheckState| self.checks.iter().filter(|check| check.state == state).count();
        let _ = match self.is_ready() {
            true => writeln!(text, "ready; {} to look at", count(CheckState::Warning)),
            false => writeln!(
                text,
                "{} to mend, {} to look at",
                count(CheckState::Bad),
                count(CheckState::Warning)
            ),
        };
        text
    }
}
