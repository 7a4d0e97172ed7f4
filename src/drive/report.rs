//! What the rig says, in the shapes that files and screens use.

use serde::{Deserialize, Serialize};

use crate::recording::ServoReport;

/// One reading in the keys and units of [`AxisStatus`], as `rig watch` prints it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WatchedAxis {
    /// When the angle was read, ns since the Unix epoch on the host's clock.
    pub time_ns: u64,
    /// The axis.
    pub axis: usize,
    /// What the rig is doing.
    pub state: String,
    /// The angle, degrees.
    pub position_deg: f64,
    /// Its setpoint, degrees.
    pub target_deg: f64,
    /// How the angle is known: `measured`, `commanded`, `stale` or `not_homed`.
    pub source: String,
    /// Half the width in which the true angle lies around the reading, degrees; null where it is not measured.
    pub uncertainty_deg: Option<f64>,
    /// Names of latched faults.
    pub faults: Vec<String>,
}

impl From<ServoReport> for WatchedAxis {
    fn from(report: ServoReport) -> Self {
        let deg = |urad: i32| (f64::from(urad) * 1e-6).to_degrees();
        Self {
            time_ns: report.time_ns,
            axis: report.axis,
            state: report.state,
            position_deg: deg(report.position_urad),
            target_deg: deg(report.target_urad),
            source: report.source,
            uncertainty_deg: report.uncertainty_urad.map(deg),
            faults: report.faults,
        }
    }
}

impl WatchedAxis {
    /// An axis of which no reading comes any more: its last one, and what else is known.
    pub(crate) fn last_of(status: &AxisStatus, now_ns: u64) -> Self {
        Self {
            time_ns: now_ns.saturating_sub((status.age_ms * 1e6) as u64),
            axis: status.axis,
            state: status.state.clone(),
            position_deg: status.position_deg,
            target_deg: status.target_deg,
            source: status.source.clone(),
            uncertainty_deg: status.uncertainty_deg,
            faults: status.faults.clone(),
        }
    }
}

/// One axis, as `rig status` shows it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AxisStatus {
    /// The axis.
    pub axis: usize,
    /// What the rig is doing.
    pub state: String,
    /// The angle, degrees.
    pub position_deg: f64,
    /// Its setpoint, degrees.
    pub target_deg: f64,
    /// How the angle is known: `measured`, `commanded`, `stale`, or `not_homed` where the encoder's zero is not known.
    pub source: String,
    /// How old the reading is at most, ms: since it was asked for.
    pub age_ms: f64,
    /// Half the width in which the true angle lies around the reading, degrees; none where it is not measured now.
    pub uncertainty_deg: Option<f64>,
    /// Whether the axis was homed since the rig started.
    pub homed: bool,
    /// The firmware's limits, degrees.
    pub limits_deg: [f64; 2],
    /// Motor current, mA.
    pub current_ma: Option<i16>,
    /// Supply, mV.
    pub supply_mv: Option<u16>,
    /// Temperature, °C.
    pub temperature_c: Option<i8>,
    /// Names of latched faults.
    pub faults: Vec<String>,
    /// What the device at the end of a bus says of its own errors, in words; empty for a rig with its own firmware.
    pub device_errors: Vec<String>,
}

/// A rig, as `rig status` shows it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RigStatus {
    /// The line.
    pub port: String,
    /// The rig's unique number, hexadecimal.
    pub uid: String,
    /// Firmware version.
    pub firmware: String,
    /// Why it last started.
    pub reset_cause: String,
    /// Whether motion is allowed.
    pub armed: bool,
    /// Whether homing moves the axes: to a switch, or as a drive finds its zero.
    pub homing_moves: bool,
    /// Its axes.
    pub axes: Vec<AxisStatus>,
    /// Whole frames received.
    pub frames: u32,
    /// Damaged frames received.
    pub damaged: u32,
}
