//! What an operator should know about a sensor, and what to do.

use std::net::IpAddr;

use serde_json::Value;

use super::{SensorState, Warning, text_of};

/// Inside an Ouster it may get this warm before it limits its shots, °C (OS1 data sheet: case 50 °C, inside about 30 more).
const OUSTER_WARM_C: f64 = 75.0;
/// The top board of a Velodyne, °C (VLP-16 manual, 9: the sensor shuts down above 80 °C inside).
const VELODYNE_WARM_C: f64 = 70.0;

fn warning(kind: &'static str, text: impl Into<String>) -> Warning {
    Warning { kind, text: text.into() }
}

pub(super) fn of_ouster(state: &SensorState, alerts: &Value, telemetry: &Value) -> Vec<Warning> {
    let mut warnings = Vec::new();
    match state.status.as_str() {
        "RUNNING" => {}
        "STANDBY" => warnings.push(warning(
            "not_running",
            "it is in stand-by and sends nothing: set operating_mode to NORMAL",
        )),
        "" => warnings.push(warning("unknown", "it does not say what it is doing")),
        "ERROR" => warnings.push(warning(
            "not_running",
            "it is in an error state: see its alerts, then power it off and on",
        )),
        other => warnings.push(warning("not_running", format!("it is {other}: wait until it runs"))),
    }
    warnings.extend(destination(&state.destination.host));
    warnings.extend(clock(state));
    for alert in alerts.pointer("/active").and_then(Value::as_array).into_iter().flatten() {
        let category = text_of(alert, "/category");
        let words = format!("{category} {}", text_of(alert, "/msg")).to_uppercase();
        let kind = match () {
            () if words.contains("SHOT") && words.contains("LIMIT") => "shot_limiting",
            () if ["TEMP", "THERMAL"].iter().any(|word| words.contains(word)) => "thermal",
            () => "alert",
        };
        let what = match kind {
            "shot_limiting" => "it is too warm and measures shorter ranges: give it air, or shade",
            "thermal" => "it is too warm, or cold, and may shut down: give it air, or shade",
            _ => "see the manual under this number",
        };
        let (id, level) = (text_of(alert, "/id"), text_of(alert, "/level"));
        warnings.push(warning(kind, format!("{level} {id} {category}: {} ({what})", text_of(alert, "/msg"))));
    }
    let countdowns = [
        ("shot_limiting", "/shot_limiting_countdown_s", "it will shorten its range"),
        ("thermal", "/thermal_shutdown_countdown_s", "it will shut down"),
    ];
    for (kind, path, what) in countdowns {
        if let Some(seconds) = super::number_of(telemetry, path).filter(|seconds| *seconds > 0.0) {
            warnings.push(warning(kind, format!("{what} in {seconds} s: give it air, or shade")));
        }
    }
    warm(state, OUSTER_WARM_C, &mut warnings);
    warnings
}

pub(super) fn of_velodyne(state: &SensorState, status: &Value, diagnosis: &Value) -> Vec<Warning> {
    let mut warnings = Vec::new();
    match text_of(status, "/laser/state").as_str() {
        "On" => {}
        "Disabled" => warnings.push(warning(
            "laser_disabled",
            "its lasers are disabled by its own protection (too warm, or the motor does not turn): cool it, then power it off and on",
        )),
        other => warnings.push(warning("not_running", format!("its lasers are {other}: set laser to on"))),
    }
    let (motor, rpm) =
        (text_of(status, "/motor/state"), super::number_of(status, "/motor/rpm").unwrap_or(0.0));
    let set = super::number_of(&state.settings, "/rpm").unwrap_or(0.0);
    if motor != "On" || set == 0.0 {
        warnings.push(warning("not_running", format!("its motor is {motor}, set to turn at {set} rpm")));
    } else if (rpm - set).abs() > 10.0 {
        warnings.push(warning("not_running", format!("its motor turns at {rpm} rpm, set to {set}")));
    }
    if state.destination.host == "255.255.255.255" {
        warnings.push(warning(
            "destination",
            "it sends to everybody on the network: set its destination to this host, and save it",
        ));
    }
    warnings.extend(clock(state));
    let counts = |path: &str| super::number_of(diagnosis, path);
    if counts("/volt_temp/top/lm20_temp") == Some(0.0) && counts("/volt_temp/top/pwr_5v") == Some(0.0) {
        warnings.push(warning(
            "thermal",
            "its head has no power: it shut down to protect itself, or the motor stands",
        ));
    }
    warm(state, VELODYNE_WARM_C, &mut warnings);
    warnings
}

fn warm(state: &SensorState, limit_c: f64, warnings: &mut Vec<Warning>) {
    if let Some(inside_c) = state.temperature_c.filter(|inside_c| *inside_c > limit_c) {
        warnings.push(warning(
            "thermal",
            format!("{inside_c:.0} °C inside, above {limit_c:.0}: give it air, or shade"),
        ));
    }
}

fn clock(state: &SensorState) -> Option<Warning> {
    let clock = &state.clock;
    (clock.locked == Some(false)).then(|| {
        let text = format!("its clock is to follow {} and does not: {}", clock.source, clock.detail);
        warning("clock_not_locked", text)
    })
}

fn destination(host: &str) -> Option<Warning> {
    let address: Option<IpAddr> = host.parse().ok();
    if host.is_empty() || address.is_some_and(|address| address.is_unspecified()) {
        return Some(warning("destination", "it has no destination for its packets: set one"));
    }
    let broadcast = address == Some(IpAddr::from([255, 255, 255, 255]));
    broadcast.then(|| {
        warning("destination", "it sends to everybody on the network: set its destination to this host")
    })
}

/// Where the metadata that a rig records with is not that of the sensor: a decoder would place every point wrongly, or none.
pub fn of_metadata(sensors: &str, recorded: &str) -> Result<Vec<Warning>, serde_json::Error> {
    const COMPARED: [&str; 11] = [
        "/sensor_info/prod_sn",
        "/config_params/lidar_mode",
        "/config_params/timestamp_mode",
        "/config_params/azimuth_window",
        "/config_params/signal_multiplier",
        "/config_params/udp_profile_imu",
        "/lidar_data_format/udp_profile_lidar",
        "/lidar_data_format/columns_per_frame",
        "/lidar_data_format/columns_per_packet",
        "/lidar_data_format/column_window",
        "/beam_intrinsics/beam_altitude_angles",
    ];
    let (sensors, recorded): (Value, Value) =
        (serde_json::from_str(sensors)?, serde_json::from_str(recorded)?);
    let find = |document: &Value, path: &str| {
        let flat = path.rsplit('/').next().map(|name| format!("/{name}"));
        document.pointer(path).or_else(|| document.pointer(&flat?)).cloned()
    };
    let mut warnings = Vec::new();
    for path in COMPARED {
        // what an older file does not say cannot contradict
        if let (Some(theirs), Some(ours)) = (find(&sensors, path), find(&recorded, path))
            && theirs != ours
        {
            let short = |value: Value| value.to_string().chars().take(60).collect::<String>();
            let text = format!(
                "{}: the sensor says {}, the metadata file {}",
                &path[1..],
                short(theirs),
                short(ours)
            );
            warnings.push(warning("metadata_mismatch", text));
        }
    }
    Ok(warnings)
}
