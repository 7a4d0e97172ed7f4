//! From the clock of a sensor to that of a trajectory, and to the host's.

use std::str::FromStr;

use super::Target;
use crate::recording::export::{Cloud, FIRST_DATE_NS};
use crate::world::trajectory::Trajectory;

/// The most that clocks drift against each other: ten times what quartzes do.
const DRIFT: f64 = 1e-3;
/// A clock that moves more than this against the host's was set, ns.
const WAS_SET_NS: i128 = 1_000_000_000;

/// What is added to the recording's times to get those of the trajectory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum TimeOffset {
    /// ns.
    Fixed(i64),
    /// Both begin together.
    Start,
}

impl FromStr for TimeOffset {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "start" {
            return Ok(Self::Start);
        }
        let seconds = text.parse().ok().filter(|value: &f64| value.is_finite() && value.abs() < 9e9);
        let fixed = seconds.map(|seconds| Self::Fixed((seconds * 1e9).round() as i64));
        fixed.ok_or_else(|| format!("{text:?}: expected seconds, or start"))
    }
}

/// How one sensor's clock relates to the others.
pub(super) struct SensorClock {
    host_from_device_ns: i128,
    last_host_ns: u64,
    offset_ns: i64,
    /// Whether the trajectory is on the host's clock.
    is_host: bool,
    why: Option<String>,
    /// Begin and end of what was seen, on the trajectory's clock, ns.
    span_ns: Option<[i128; 2]>,
    /// Frames that begin outside of the trajectory's time by the sensor's clock, and by the host's.
    outside: [u64; 2],
}

impl SensorClock {
    /// As the first cloud shows it.
    pub(super) fn starting(cloud: &Cloud, target: &Target) -> Self {
        let (device_ns, host_ns) = (cloud.start_time_ns, cloud.host_time_ns);
        let mut clock = Self {
            host_from_device_ns: i128::from(host_ns) - i128::from(device_ns),
            last_host_ns: host_ns,
            offset_ns: 0,
            is_host: false,
            why: None,
            span_ns: None,
            outside: [0; 2],
        };
        let Some((trajectory, offset)) = target.trajectory() else { return clock };
        let [first_ns, last_ns] = trajectory.time_span_ns();
        match offset {
            TimeOffset::Start => clock.offset_ns = first_ns.wrapping_sub(device_ns) as i64,
            TimeOffset::Fixed(offset_ns) => {
                clock.offset_ns = offset_ns;
                let is_dated = |time_ns: u64| time_ns >= FIRST_DATE_NS;
                let is_within = |time_ns: u64| {
                    (i128::from(first_ns)..=i128::from(last_ns))
                        .contains(&(i128::from(time_ns) + i128::from(offset_ns)))
                };
                let is_other_kind =
                    is_dated(first_ns) != is_dated(device_ns) && is_dated(first_ns) == is_dated(host_ns);
                clock.is_host = host_ns > 0 && !is_within(device_ns) && (is_other_kind || is_within(host_ns));
                if clock.is_host {
                    clock.why = Some(format!(
                        "its clock ({:.3} s at the start) is not that of the trajectory ({:.3} to {:.3} s): placed by the host's \
                         ({:.3} s)",
                        device_ns as f64 * 1e-9,
                        first_ns as f64 * 1e-9,
                        last_ns as f64 * 1e-9,
                        host_ns as f64 * 1e-9
                    ));
                }
            }
        }
        clock
    }

    /// Follows the drift between the clocks; a packet that came late moves nothing.
    pub(super) fn follow(&mut self, device_ns: u64, host_ns: u64) {
        let off_ns = i128::from(host_ns) - i128::from(device_ns) - self.host_from_device_ns;
        let most_ns = (host_ns.saturating_sub(self.last_host_ns) as f64 * DRIFT) as i128;
        self.host_from_device_ns +=
            if off_ns.abs() > WAS_SET_NS { off_ns } else { off_ns.clamp(-most_ns, most_ns) };
        self.last_host_ns = host_ns.max(self.last_host_ns);
    }

    /// Added to a time of the sensor to get the host's, ns.
    pub(super) fn host_from_device_ns(&self) -> i128 {
        self.host_from_device_ns
    }

    /// A time of the sensor on the trajectory's clock, ns.
    pub(super) fn trajectory_ns(&self, device_ns: u64) -> Option<u64> {
        let host_ns = if self.is_host { self.host_from_device_ns } else { 0 };
        u64::try_from(i128::from(device_ns) + host_ns + i128::from(self.offset_ns)).ok()
    }

    /// Counts a frame.
    pub(super) fn count(&mut self, cloud: &Cloud, trajectory: &Trajectory) {
        let by_sensor = i128::from(cloud.start_time_ns) + i128::from(self.offset_ns);
        let by_host = by_sensor + self.host_from_device_ns;
        let [first_ns, last_ns] = trajectory.time_span_ns().map(i128::from);
        for (count, time_ns) in self.outside.iter_mut().zip([by_sensor, by_host]) {
            *count += u64::from(!(first_ns..=last_ns).contains(&time_ns));
        }
        let time_ns = if self.is_host { by_host } else { by_sensor };
        let [from_ns, to_ns] = self.span_ns.unwrap_or([time_ns; 2]);
        self.span_ns = Some([from_ns.min(time_ns), to_ns.max(time_ns)]);
    }

    pub(super) fn words_of_span(&self) -> Option<String> {
        let [from_ns, to_ns] = self.span_ns?.map(|time_ns| time_ns as f64 * 1e-9);
        Some(format!("{from_ns:.3} to {to_ns:.3} s"))
    }

    /// What the user should know of it.
    pub(super) fn notice(&self) -> Option<String> {
        let [by_sensor, by_host] = self.outside;
        let apart_s = self.host_from_device_ns as f64 * 1e-9;
        match self.is_host {
            false if by_host < by_sensor => Some(format!(
                "{by_sensor} revolutions begin outside of the trajectory's time by its clock and {by_host} by the host's: where the \
                 trajectory is on the host's clock, give --time-offset {apart_s:.3}"
            )),
            _ => self.why.clone(),
        }
    }
}
