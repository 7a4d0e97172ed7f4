//! Values of the flags of `rig`.

use std::time::{Duration, Instant};

/// No move takes longer.
const LONGEST_MOVE: Duration = Duration::from_secs(3600);

pub(super) fn limits(text: &str) -> Result<(f64, f64), String> {
    let wrong = || format!("`{text}`: expected LOW,HIGH in degrees, low first");
    let (low, high) = text.split_once(',').ok_or_else(wrong)?;
    match (low.trim().parse::<f64>(), high.trim().parse::<f64>()) {
        (Ok(low), Ok(high)) if low < high && low.abs() <= 360.0 && high.abs() <= 360.0 => Ok((low, high)),
        _ => Err(wrong()),
    }
}

pub(super) fn approach(text: &str) -> Result<f64, String> {
    let angle_deg = text.parse().ok().filter(|angle_deg| (0.0..90.0).contains(angle_deg));
    angle_deg.ok_or_else(|| "expected an angle below 90 degrees, or 0 to go straight there".into())
}

pub(super) fn tolerance(text: &str) -> Result<f64, String> {
    let angle_deg = text.parse().ok().filter(|angle_deg| *angle_deg > 0.0 && *angle_deg < 90.0);
    angle_deg.ok_or_else(|| "expected an angle above 0 and below 90 degrees".into())
}

pub(super) fn move_time(text: &str) -> Result<Duration, String> {
    let time = text.parse().ok().and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
    time.filter(|time| !time.is_zero() && *time <= LONGEST_MOVE)
        .ok_or_else(|| format!("expected a time above 0 and up to {} s", LONGEST_MOVE.as_secs()))
}

pub(super) fn watched_for(text: &str) -> Result<Duration, String> {
    let time = text.parse().ok().and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
    time.filter(|time| Instant::now().checked_add(*time).is_some())
        .ok_or_else(|| format!("`{text}`: expected seconds, 0 or more"))
}
