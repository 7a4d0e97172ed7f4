//! What `cut` prints.

use std::collections::BTreeMap;

use serde::Serialize;

/// What was written.
#[derive(Debug, Default, Serialize)]
pub(crate) struct Document {
    pub(super) format: &'static str,
    pub(super) out: String,
    pub(super) packets: u64,
    /// Packets by sensor, where they were assigned to one.
    pub(super) sensors: BTreeMap<String, u64>,
    /// Packets that no sensor takes, which a bag has no topic for.
    pub(super) unassigned: u64,
    /// Packets before --from, from --to on, and of other sensors.
    pub(super) left_out: u64,
    pub(crate) losses: Vec<String>,
}

impl Document {
    pub(crate) fn text(&self) -> String {
        let mut text = format!("{}: {} packets\n", self.out, self.packets);
        for (sensor, packets) in &self.sensors {
            text += &format!("  {sensor}: {packets}\n");
        }
        if self.left_out > 0 {
            text += &format!("  {} packets of other times or sensors left out\n", self.left_out);
        }
        text
    }
}
