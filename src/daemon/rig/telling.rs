//! What the rig did, in words for the journal.

use std::collections::BTreeSet;

use crate::daemon::journal::Journal;
use crate::drive::{RigError, RigStatus};

/// Writes down what is latched and was not.
pub(super) fn faults(journal: &Journal, status: &RigStatus, latched: &mut BTreeSet<String>) {
    let named = |name: &String| {
        let of = status.axes.iter().filter(|axis| axis.faults.contains(name));
        let axes: Vec<String> = of.map(|axis| axis.axis.to_string()).collect();
        format!("fault {name} is latched (axis {})", axes.join(", "))
    };
    let now: BTreeSet<String> = status.axes.iter().flat_map(|axis| axis.faults.iter().cloned()).collect();
    for name in now.difference(latched) {
        journal.tell("rig_fault", named(name));
    }
    *latched = now;
}

/// Writes down how an order ended, and where it left the axes, where that is given; in words.
pub(super) fn ended(
    journal: &Journal,
    word: &str,
    outcome: &Result<(), RigError>,
    left: Option<&RigStatus>,
) -> String {
    let (event, how) = match outcome {
        Ok(()) => ("rig_command", "done".to_owned()),
        Err(error) => ("rig_command_failed", error.to_string()),
    };
    let stands = left.map_or(String::new(), |status| format!("; {}", standing(status)));
    let words = format!("{word}: {how}{stands}");
    journal.tell(event, words.clone());
    words
}

/// Whether an error may come while axes move: what is refused has moved none.
pub(super) fn ends_a_move(error: &RigError) -> bool {
    use RigError::{Fault, Interrupted, Late, NotReached, OtherHost, Restarted};
    matches!(
        error,
        Fault { .. } | Interrupted { .. } | Late { .. } | NotReached { .. } | Restarted { .. } | OtherHost
    )
}

/// Where each axis is.
fn standing(status: &RigStatus) -> String {
    let each = status.axes.iter().map(|axis| match axis.source.as_str() {
        "stale" => format!("axis {} was last read at {:.2} degrees", axis.axis, axis.position_deg),
        _ => format!("axis {} stands at {:.2} degrees", axis.axis, axis.position_deg),
    });
    each.collect::<Vec<_>>().join(", ")
}
