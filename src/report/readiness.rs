//! The report of what a machine and a rig lack.

use super::Report;
use crate::verify::readiness::{Check, CheckState, Readiness};

/// A line for each check, with what to do below those that need it.
pub(crate) fn report(readiness: &Readiness) -> Report {
    let count = |state: CheckState| readiness.checks.iter().filter(|check| check.state == state).count();
    let (warnings, bad) = (count(CheckState::Warning), count(CheckState::Bad));
    let sentence = match readiness.is_ready() {
        true => format!("ready; {warnings} to look at"),
        false => format!("{bad} to mend, {warnings} to look at"),
    };
    let mut report = Report::new("Ready to record?", &sentence);
    let row = |check: &Check| {
        let state = match check.state {
            CheckState::Ok => "ok",
            CheckState::Warning => "WARN",
            CheckState::Bad => "MEND",
            CheckState::Unknown => "?",
        };
        let advice =
            check.advice.iter().map(|advice| vec![String::new(), String::new(), format!("-> {advice}")]);
        std::iter::once(vec![state.to_owned(), check.name.clone(), check.found.clone()])
            .chain(advice)
            .collect()
    };
    let rows: Vec<Vec<Vec<String>>> = readiness.checks.iter().map(row).collect();
    report.table(&["state", "check", "found"], rows.concat());
    report
}
