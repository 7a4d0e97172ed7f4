//! What `cut` prints.

use std::collections::BTreeMap;

use serde::Serialize;

/// What was written.
#[derive(Debug, Default, Serialize)]
pub(super) struct Document {
    pub(super) format: &'static str,
    pub(super) out: String,
    pub(super) packets: u64,
    /// Packets by sensor, where they were assigned to one.
    pub(super) sensors: BTreeMap<String, u64>,
    /// Packets that no sensor takes, which a bag has no topic for.
    pub(super) unassigned: u64,
    /// Packets before --from, from --to on, and of other sensors.
    pub(super) left_out: u64,
    pub(super) losses: Vec<String>,
}

pub(super) fn text(document: &Document) -> String {
    let mut text = format!("{}: {} packets\n", document.out, document.packets);
    for (sensor, packets) in &document.sensors {
        text += &format!("  {sensor}: {packets}\n");
    }
    if document.left_out > 0 {
        text += &format!("  {} packets of other times or sensors left out\n", document.left_out);
    }
    text
}
