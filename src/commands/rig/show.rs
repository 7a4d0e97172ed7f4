//! The rig's state and a dry run.

use std::path::Path;

use anyhow::bail;
use serde_json::{Value, json};

use crate::commands::{Context, output};
use crate::drive::{Applied, Rig, RigError, RigStatus};
use crate::report::Report;

pub(super) fn nothing_latched(status: &RigStatus) -> anyhow::Result<()> {
    let latched = status.axes.iter().filter(|axis| !axis.faults.is_empty());
    let latched: Vec<_> =
        latched.map(|axis| format!("{} (axis {})", axis.faults.join(", "), axis.axis)).collect();
    if latched.is_empty() {
        return Ok(());
    }
    bail!(
        "fault {} is latched, and nothing moves: take its cause away, then run `outrigger rig clear`",
        latched.join(", ")
    )
}

pub(super) fn try_out(rig: &Rig, pitches_rad: &[f64], homes: bool, context: Context) -> anyhow::Result<()> {
    if !pitches_rad.is_empty() {
        rig.check(pitches_rad)?;
    }
    let status = rig.status()?;
    nothing_latched(&status)?;
    let moves: Vec<_> = status
        .axes
        .iter()
        .zip(pitches_rad)
        .map(|(axis, to_rad)| {
            json!({ "axis": axis.axis, "from_deg": axis.position_deg, "to_deg": to_rad.to_degrees(), "homed": axis.homed })
        })
        .collect();
    let document = json!({ "dry_run": true, "moves": moves, "homing_moves": status.homing_moves });
    let mut report = Report::new("Dry run", "");
    for (axis, to_rad) in status.axes.iter().zip(pitches_rad) {
        let homed = if axis.homed { "" } else { " (not homed yet)" };
        let (from_deg, to_deg) = (axis.position_deg, to_rad.to_degrees());
        report.figure(&format!("axis {}", axis.axis), format!("{from_deg:.3}° -> {to_deg:.3}°{homed}"));
    }
    if moves.is_empty() || homes {
        report.note(match status.homing_moves {
            true => "homing moves every axis to its switch or zero, one after the other",
            false => "homing moves nothing on this rig: it has neither switch nor zero to seek",
        });
    } else if status.axes.iter().any(|axis| !axis.homed) {
        report.note("without --home, or `rig home --arm` before it, this would be refused");
    }
    if !moves.is_empty() {
        report.note(
            "a keep-out region of the firmware, where it has one, is known to it alone and not looked at",
        );
    }
    report.note("nothing was moved");
    output::print_result(context.json, &document, &report, &[])
}

pub(super) fn show(status: &RigStatus, applied: Option<&Applied>, context: Context) -> anyhow::Result<()> {
    output::print_result(context.json, &document(status, applied)?, &report(status), &[])
}

fn document(status: &RigStatus, applied: Option<&Applied>) -> anyhow::Result<Value> {
    let mut document = serde_json::to_value(status)?;
    if let (Some(applied), Some(fields)) = (applied, document.as_object_mut()) {
        let axes: Vec<_> = applied
            .axes
            .iter()
            .map(|axis| {
                json!({
                    "target_deg": axis.target_rad.to_degrees(),
                    "measured_deg": axis.measured_rad.to_degrees(),
                    "error_deg": (axis.measured_rad - axis.target_rad).to_degrees(),
                    "uncertainty_deg": axis.uncertainty_rad.map(f64::to_degrees),
                    "scatter_deg": axis.scatter_rad.to_degrees(),
                    "readings": axis.readings,
                    "source": axis.source,
                    "approach": axis.approach,
                    "age_ms": axis.age_s * 1e3,
                })
            })
            .collect();
        fields.insert("applied".into(), axes.into());
    }
    Ok(document)
}

fn report(status: &RigStatus) -> Report {
    let armed = if status.armed { "armed" } else { "disarmed" };
    let sentence = format!(
        "rig {} on {}: firmware {}, {armed}, last start: {}, {} frames, {} damaged",
        status.uid, status.port, status.firmware, status.reset_cause, status.frames, status.damaged
    );
    let mut report = Report::new("The rig", &sentence);
    for axis in &status.axes {
        let homed = if axis.homed { "homed" } else { "not homed" };
        let within = axis.uncertainty_deg.map_or(String::new(), |half_deg| format!(" ± {half_deg:.3}"));
        let mut words = format!(
            "{:8.3}{within}° ({}, {:.0} ms ago), target {:8.3}°, {}, {homed}",
            axis.position_deg, axis.source, axis.age_ms, axis.target_deg, axis.state
        );
        if !axis.faults.is_empty() {
            words += &format!(", FAULT {}", axis.faults.join(", "));
        }
        if !axis.device_errors.is_empty() {
            words += &format!(", the device says: {}", axis.device_errors.join(", "));
        }
        report.figure(&format!("axis {}", axis.axis), words);
    }
    report
}

/// Whether the servos are driven by this program: what it knows of them ends with it.
pub(super) fn is_driven_here(port: &Path) -> bool {
    let port = port.to_string_lossy();
    ["dynamixel:", "feetech:", "cia402:"].iter().any(|word| port.starts_with(word))
}

pub(super) fn explain(error: anyhow::Error, port: &Path) -> anyhow::Error {
    match error.downcast_ref() {
        Some(RigError::Refused { code: firmware_protocol::AckCode::NotHomed, .. }) => {
            let advice = if is_driven_here(port) {
                "positions are not trusted yet: say --home, as this program drives these servos and homes them each time"
            } else {
                "positions are not trusted yet: run `outrigger rig home --arm` first, or say --home"
            };
            error.context(advice)
        }
        Some(RigError::Fault { .. } | RigError::Refused { code: firmware_protocol::AckCode::Fault, .. }) => error.context(
            "from now on nothing moves until the fault is cleared: take its cause away, then run `outrigger rig clear`",
        ),
        _ => error,
    }
}
