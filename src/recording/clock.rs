//! One clock for a whole session: that of the host when it began, going on steadily. Packets, readings of the rig and events
//! are stamped by clocks that part when the host's is set; they are put on that one as they are written, and each step is an
//! event, so that UTC can be had back.

use serde::Serialize;
use serde_json::Value;

use crate::live::clocks::host::{HostStep, HostTime, StreamPlace, Timeline, steady_ns};

/// Name of the event that the host's clock was set.
pub const HOST_CLOCK_STEP: &str = "host_clock_step";
/// Clocks that differ by less show the same, ns.
const SAME_NS: u64 = 1_000_000;

/// Where a session has the time from.
pub struct ClockSource {
    /// Reads the host's clocks.
    pub read: Box<dyn Fn() -> HostTime + Send>,
    /// What the clock that stamps readings of a rig shows at such a moment, ns.
    pub rig_ns: fn(&HostTime) -> u64,
}

impl Default for ClockSource {
    /// Those of the system.
    fn default() -> Self {
        Self { read: Box::new(HostTime::now), rig_ns: steady_ns }
    }
}

/// The clock of a session that is being written.
pub(super) struct SessionClock {
    read: Box<dyn Fn() -> HostTime + Send>,
    line: Timeline,
    /// From the clock of the rig's readings to the session's, ns: the host's may have been set before the session began.
    rig_shift_ns: i64,
    sensors: Vec<StreamPlace>,
    events: StreamPlace,
}

impl SessionClock {
    pub(crate) fn start(source: ClockSource, sensors: usize) -> Self {
        let begin = (source.read)();
        let shift_ns = begin.unix_ns.wrapping_sub((source.rig_ns)(&begin)) as i64;
        let is_same = shift_ns.unsigned_abs() <= SAME_NS + begin.apart_ns;
        Self {
            read: source.read,
            line: Timeline::new(begin),
            rig_shift_ns: if is_same { 0 } else { shift_ns },
            sensors: vec![StreamPlace::default(); sensors],
            events: StreamPlace::default(),
        }
    }

    /// What the host's clocks showed when it began.
    pub(crate) fn begin(&self) -> HostTime {
        self.line.begin()
    }

    /// Looks whether the host's clock was set: the event that says so.
    pub(crate) fn look(&mut self) -> Option<Value> {
        let step = self.line.sample((self.read)())?;
        Some(serde_json::json!({
            "time_ns": step.between_ns[1], "event": HOST_CLOCK_STEP, "step_ns": step.step_ns,
            "between_ns": step.between_ns, "words": step.words(self.line.begin().unix_ns),
        }))
    }

    /// The steps so far.
    pub(crate) fn steps(&self) -> &[HostStep] {
        self.line.steps()
    }

    /// The session's time of a packet that the kernel stamped, ns.
    pub(crate) fn packet_ns(&mut self, sensor: usize, stamp_ns: u64) -> u64 {
        self.sensors.get_mut(sensor).map_or(stamp_ns, |stream| self.line.place(stamp_ns, stream))
    }

    /// A line about the rig, with the session's time; none where it is right as it is.
    pub(crate) fn servo(&self, report: &impl Serialize) -> Option<Value> {
        if self.rig_shift_ns == 0 {
            return None;
        }
        restamped(report, |time_ns| time_ns.saturating_add_signed(self.rig_shift_ns))
    }

    /// The same for an event, which the host's clock stamped.
    pub(crate) fn event(&mut self, event: &impl Serialize) -> Option<Value> {
        if self.line.steps().is_empty() {
            return None;
        }
        let Self { line, events, .. } = self;
        restamped(event, |time_ns| line.place(time_ns, events))
    }
}

fn restamped(line: &impl Serialize, restamp: impl FnOnce(u64) -> u64) -> Option<Value> {
    let mut value = serde_json::to_value(line).ok()?;
    let time_ns = value.get("time_ns")?.as_u64()?;
    value["time_ns"] = restamp(time_ns).into();
    Some(value)
}

/// The steps that the events of a session tell of.
pub(super) fn steps_of(events: &[Value]) -> Vec<HostStep> {
    let steps = events.iter().filter(|event| event["event"] == HOST_CLOCK_STEP);
    steps.filter_map(|event| serde_json::from_value(event.clone()).ok()).collect()
}
