//! The offset between the clocks of recording and trajectory.

use std::str::FromStr;

use super::error::WalkError;
use crate::recording::mounted::MountedRecording;
use crate::verify::compare::{Field, RaySample, TimeOffset, time_offset};
use crate::world::scene::Scene;
use crate::world::trajectory::Trajectory;

/// Rays among which the time offset is looked for, and how far to each side.
const SEARCH_RAYS: usize = 20_000;
const SEARCH_NS: i64 = 2_000_000_000;

/// How the clocks stand to each other.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Offset {
    Seconds(f64),
    Start,
    Search,
}

impl FromStr for Offset {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "start" => return Ok(Self::Start),
            "search" => return Ok(Self::Search),
            _ => {}
        }
        let seconds = text.parse().ok().filter(|value: &f64| value.is_finite() && value.abs() < 9e9);
        seconds.map(Self::Seconds).ok_or_else(|| format!("{text:?}: expected seconds, start or search"))
    }
}

/// What is added to the recording's times; where it is searched, around what.
pub(super) fn time_offset_ns(
    offset: Offset,
    recorded: &MountedRecording,
    trajectory: &Trajectory,
) -> Result<i64, WalkError> {
    let from_start = || -> Result<i64, WalkError> {
        let [first_ns, _] = recorded.span_ns()?.ok_or(WalkError::NoStart)?;
        Ok(trajectory.time_span_ns()[0] as i64 - first_ns as i64)
    };
    match offset {
        Offset::Seconds(seconds) => Ok((seconds * 1e9).round() as i64),
        Offset::Start => from_start(),
        // clocks that have nothing in common are assumed to have begun together
        Offset::Search if overlap(recorded.span_ns()?, trajectory.time_span_ns()) => Ok(0),
        Offset::Search => from_start(),
    }
}

fn overlap(recorded: Option<[u64; 2]>, walked: [u64; 2]) -> bool {
    recorded.is_some_and(|[first_ns, last_ns]| first_ns <= walked[1] && walked[0] <= last_ns)
}

/// Looks for the time offset near `around_ns` with an even share of the recorded rays.
pub(super) fn search_time_offset(
    recorded: &MountedRecording,
    scene: &Scene,
    trajectory: &Trajectory,
    around_ns: i64,
) -> Result<TimeOffset, WalkError> {
    let RaySample { rays, sensors, .. } = RaySample::of(recorded, SEARCH_RAYS)?;
    let field = Field { scene, trajectory, sensors: &sensors, rays: &rays, agree_within_m: 0.1 };
    time_offset(&field, around_ns, SEARCH_NS).map_err(|source| {
        let (span_s, around_s) = (SEARCH_NS as f64 * 1e-9, around_ns as f64 * 1e-9);
        WalkError::NoTimeOffset { span_s, around_s, source }
    })
}
