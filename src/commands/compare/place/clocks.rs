//! The offset between the clocks of recording and trajectory.

use anyhow::Context as _;

use super::Place;
use super::args::Offset;
use crate::commands::recorded::Recorded;
use crate::verify::compare::{Field, time_offset};
use crate::world::trajectory::Trajectory;

/// Rays among which the time offset is looked for, and how far to each side.
const SEARCH_RAYS: usize = 20_000;
const SEARCH_NS: i64 = 2_000_000_000;

/// What is added to the recording's times; where it is searched, around what.
pub(super) fn time_offset_ns(
    offset: Offset,
    recorded: &Recorded,
    trajectory: &Trajectory,
) -> anyhow::Result<i64> {
    let from_start = || -> anyhow::Result<i64> {
        let first_ns = recorded.span_ns()?.context("no frame to take the start from")?[0];
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

impl Place {
    /// Looks for the time offset with an even share of the recorded rays.
    pub(super) fn search_time_offset(&mut self, recorded: &Recorded) -> anyhow::Result<()> {
        let sample = recorded.rays(SEARCH_RAYS)?;
        let (scene, trajectory) = (&self.scene, &self.trajectory);
        let field =
            Field { scene, trajectory, sensors: &sample.sensors, rays: &sample.rays, agree_within_m: 0.1 };
        let found = time_offset(&field, self.time_offset_ns, SEARCH_NS).with_context(|| {
            format!(
                "--time-offset search looked {} s to each side of {:.2} s; for clocks farther apart it takes seconds, or start",
                SEARCH_NS as f64 * 1e-9,
                self.time_offset_ns as f64 * 1e-9
            )
        })?;
        self.notices
            .push(format!("time offset found: {:.4} s +- {:.4} s (95 %)", found.seconds, found.u95_s));
        self.time_offset_ns = (found.seconds * 1e9).round() as i64;
        self.time_offset = Some(found);
        Ok(())
    }
}
