//! Whether the host's clock was set while a session was recorded, and whether its stamps are on one clock all the same.

use super::session::{MountedSession, feed_session};
use crate::live::clocks::{ClockWatch, Jump, Moved};
use crate::recording::observer::Observer;
use crate::recording::source::RecordingError;
use crate::recording::{ServoReport, Session};
use crate::rig::Rig;

/// A pause of a stream that is looked into, and a step back, ns: steps of clocks show as one of them.
const PAUSE_NS: i128 = 20_000_000;
const BACK_NS: i128 = -1_000_000;
/// What several sensors see of one step differs by less, s.
const SAME_S: f64 = 0.05;
const SAME_TIME_NS: u64 = 2_000_000_000;

/// One step, as the sensors' own clocks show it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Inferred {
    /// The host's stamp of the first frame behind it, ns.
    pub host_ns: u64,
    /// How far forward, s.
    pub step_s: f64,
    /// Sensors with clocks that ran on.
    pub sensors: Vec<String>,
}

impl Inferred {
    /// In words, the time from `begin_ns` on.
    pub(crate) fn words(&self, begin_ns: u64) -> String {
        let side = if self.step_s > 0.0 { "forward" } else { "back" };
        let as_before_s = (self.host_ns as f64 - begin_ns as f64) * 1e-9 - self.step_s;
        format!(
            "the host's clock was set {side} by {:.3} s at about {as_before_s:.1} s: its stamps jump, and the clock of {} ran on",
            self.step_s.abs(),
            self.sensors.join(" and ")
        )
    }
}

/// Steps of the host's clock, each once, from the jumps that clocks of sensors show.
pub(crate) fn inferred<'a>(jumps: impl IntoIterator<Item = (&'a str, &'a Jump)>) -> Vec<Inferred> {
    let mut steps: Vec<Inferred> = Vec::new();
    for (sensor, jump) in jumps.into_iter().filter(|(_, jump)| jump.moved == Moved::Host) {
        let same = steps.iter_mut().find(|step| {
            step.host_ns.abs_diff(jump.host_ns) < SAME_TIME_NS && (step.step_s - jump.change_s).abs() < SAME_S
        });
        match same {
            Some(step) => step.sensors.push(sensor.to_owned()),
            None => steps.push(Inferred {
                host_ns: jump.host_ns,
                step_s: jump.change_s,
                sensors: vec![sensor.to_owned()],
            }),
        }
    }
    steps
}

/// Brings the packets of a session onto the clock of its rig's readings, where they are not; what the user should know of it.
pub(crate) fn settle(
    session: &mut Session,
    rig: &Rig,
    observer: Observer,
) -> Result<Vec<String>, RecordingError> {
    if let Some(steps) = session.clock_steps()? {
        let begin_ns = session.manifest().created_ns;
        let words = steps
            .iter()
            .map(|step| format!("{}: everything is stamped as if it had not been", step.words(begin_ns)));
        return Ok(words.collect());
    }
    // from before that was so: without readings there is nothing to bring together
    if session.servo::<ServoReport>()?.is_empty() {
        return Ok(Vec::new());
    }
    let Some(begin_ns) = odd_stamps(session)? else { return Ok(Vec::new()) };
    let mut clocks: Vec<ClockWatch> = rig.sensors.iter().map(|_| ClockWatch::default()).collect();
    let advance = (observer.stage)("looking whether the host's clock was set while recording");
    let mounted_session = MountedSession { session, rig, tilts: &[], calibrations: &[] };
    feed_session(&mounted_session, &advance, &mut |mounted_frame| {
        if let Some([first_ns, _]) = mounted_frame.frame.time_span_ns() {
            clocks[mounted_frame.sensor].add(mounted_frame.frame.host_time_ns[0], first_ns);
        }
    })?;
    drop(advance);
    let names = rig.sensors.iter().map(|sensor| sensor.name.as_str());
    let reports: Vec<_> =
        names.zip(&clocks).filter_map(|(name, clock)| Some((name, clock.report()?))).collect();
    let jumps =
        || reports.iter().flat_map(|(name, report)| report.jumps.iter().map(move |jump| (*name, jump)));
    let steps = inferred(jumps());
    session.undo_clock_steps(steps.iter().map(|step| (step.step_s * 1e9).round() as i64).collect());
    let removed = |step: &Inferred| {
        format!(
            "{}; the step is removed, as the rig's readings are on a clock that was not set",
            step.words(begin_ns)
        )
    };
    let doubtful = jumps().filter(|(_, jump)| jump.moved == Moved::Unknown).map(|(name, jump)| {
        format!(
            "{name}: its clock and the host's moved apart by {:.3} s, and it is unknown which of them was set: the angles of \
             the axes may be those of other times",
            jump.change_s
        )
    });
    Ok(steps.iter().map(removed).chain(doubtful).collect())
}

/// Whether the stamps of any stream pause or run back; the first of all.
fn odd_stamps(session: &Session) -> Result<Option<u64>, RecordingError> {
    let mut last_ns: Vec<Option<u64>> = vec![None; session.manifest().sensors.len()];
    let (mut first_ns, mut is_odd) = (None, false);
    let mut packets = session.packets()?;
    while let Some((stream, packet)) = packets.next()? {
        let time_ns = packet.host_time_ns;
        let gap_ns =
            last_ns[stream].replace(time_ns).map_or(0, |last_ns| i128::from(time_ns) - i128::from(last_ns));
        first_ns.get_or_insert(time_ns);
        is_odd |= !(BACK_NS..PAUSE_NS).contains(&gap_ns);
    }
    Ok(first_ns.filter(|_| is_odd))
}
