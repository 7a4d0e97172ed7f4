//! What `cut` prints.

use std::collections::BTreeMap;

use serde::Serialize;

/// What was written.
#[derive(Debug, Default, Serialize)]
pub(crate) struct Document {
    pub(crate) format: &'static str,
    pub(crate) out: String,
    pub(crate) packets: u64,
    /// Packets by sensor, where they were assigned to one.
    pub(crate) sensors: BTreeMap<String, u64>,
    /// Packets that no sensor takes, which a bag has no topic for.
    pub(crate) unassigned: u64,
    /// Packets before --from, from --to on, and of other sensors.
    pub(crate) left_out: u64,
    pub(crate) losses: Vec<String>,
}
