//! What an axis of the rig reported while it was recorded.

use serde::{Deserialize, Serialize};

/// One reading of one axis: a line of a session's `servo.jsonl`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ServoReport {
    /// When the angle was read, ns since the Unix epoch on the host's clock.
    pub time_ns: u64,
    /// The axis.
    pub axis: usize,
    /// The angle, µrad.
    pub position_urad: i32,
    /// Half the width in which the true angle lies around it, µrad: encoder, scatter while holding, play by the side it came
    /// from. Absent where nothing measures the angle, and in sessions from before it was recorded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub uncertainty_urad: Option<i32>,
    /// Setpoint of the axis, µrad.
    pub target_urad: i32,
    /// How the angle is known: `measured`, `commanded`, `stale` or `not_homed`.
    pub source: String,
    /// Whether the axis was homed since the rig started; absent in sessions from before it was recorded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub homed: Option<bool>,
    /// What the rig is doing: `boot`, `idle`, `homing`, `moving`, `holding`, `fault`, `e_stop`.
    pub state: String,
    /// Names of latched faults of this axis.
    pub faults: Vec<String>,
}
