//! What is wrong, in plain words, and what to do about it.

mod rig;
mod sensor;

use super::status::{ComponentState, CoverageStatus, Problem, RecorderStatus, Severity, Status};

pub(super) use rig::OFF_MOUNT_DEG;

/// A write that takes longer than this is worth a word, s.
const SLOW_WRITE_S: f64 = 0.5;

/// A state, or what it has of the recorder, that is older is named, ms.
const LATE_MS: f64 = 2000.0;

/// Everything that is wrong with a state, worst first.
pub(super) fn problems(status: &Status) -> Vec<Problem> {
    let mut list = List::default();
    status.sensors.iter().for_each(|sensor| sensor::problems(sensor, &mut list));
    status.rig.iter().for_each(|rig| rig::problems(rig, status.recorder.recording, &mut list));
    of_recorder(&status.recorder, &mut list);
    if status.recorder.recording {
        status.coverage.iter().for_each(|coverage| of_coverage(coverage, &mut list)); // before, no trajectory has begun
    }
    if let Some(jump_s) = status.host_clock_jump_s {
        list.warn(
            "host",
            "host_clock_jump",
            format!("The clock of this computer was set by {jump_s:.3} s."),
            "Times of packets before and after do not fit together. Let chrony or ptp4l slew it, or set it before \
             recording.",
        );
    }
    list.sorted()
}

/// Adds what is wrong with the daemon itself at the moment at which it is asked.
pub(super) fn of_daemon(status: &mut Status) {
    let mut list = List(std::mem::take(&mut status.problems));
    for component in &status.components {
        if component.state == ComponentState::Dead {
            let (name, why) = (&component.name, component.why.as_deref().unwrap_or_default());
            let advice = if component.essential {
                "The daemon ends in order now: what was received is in the session. Start it again, and report the line \
                 component_dead of its log."
            } else {
                "The rest goes on. Start the daemon again between two recordings, and report the line component_dead of \
                 its log."
            };
            list.error(
                "daemon",
                "component_dead",
                format!("A part of the daemon died: {name}: {why}."),
                advice,
            );
        }
    }
    let late = |age_ms: f64| age_ms > LATE_MS;
    if late(status.age_ms) {
        let what =
            format!("This state is {:.0} s old: nothing newer was put together.", status.age_ms * 1e-3);
        list.error(
            "daemon",
            "state_late",
            what,
            "This computer is overloaded, or the daemon hangs: start it again.",
        );
    }
    if late(status.recorder.age_ms) {
        let what = format!("The recorder has been silent for {:.0} s.", status.recorder.age_ms * 1e-3);
        list.error(
            "recorder",
            "recorder_late",
            what,
            "Its disk holds it up. Look at the disk or the network that it is on.",
        );
    }
    if let Some(error) = &status.log.error {
        let what = format!("The log cannot be written ({error}): {} lines are lost.", status.log.lost_lines);
        list.warn(
            "log",
            "log_lost",
            what,
            "Everything else goes on. What happens stands in the events here and in each session.",
        );
    } else if status.log.stuck_s > 0.0 {
        let what = format!(
            "The reader of the log has read nothing for {:.0} s: {} lines are lost.",
            status.log.stuck_s, status.log.lost_lines
        );
        list.warn(
            "log",
            "log_stuck",
            what,
            "Everything else goes on. Let its reader go on, or start the daemon with its log in a file.",
        );
    }
    status.problems = list.sorted();
}

#[derive(Default)]
struct List(Vec<Problem>);

impl List {
    fn sorted(mut self) -> Vec<Problem> {
        self.0.sort_by_key(|problem| problem.severity);
        self.0
    }

    fn add(
        &mut self,
        severity: Severity,
        about: &str,
        kind: &'static str,
        what: String,
        advice: impl Into<String>,
    ) {
        self.0.push(Problem { severity, kind, about: about.to_owned(), what, advice: advice.into() });
    }

    fn error(&mut self, about: &str, kind: &'static str, what: String, advice: impl Into<String>) {
        self.add(Severity::Error, about, kind, what, advice);
    }

    fn warn(&mut self, about: &str, kind: &'static str, what: String, advice: impl Into<String>) {
        self.add(Severity::Warning, about, kind, what, advice);
    }
}

fn of_coverage(coverage: &CoverageStatus, list: &mut List) {
    if coverage.without_pose > 0 {
        list.warn(
            "coverage",
            "no_pose",
            format!(
                "{} points are not in the coverage: the trajectory does not say where the platform was.",
                coverage.without_pose
            ),
            "They are recorded all the same. Give a trajectory of this walk, or none at all for a platform that stands.",
        );
    }
}

fn of_recorder(recorder: &RecorderStatus, list: &mut List) {
    let free_mib = recorder.free_bytes.unwrap_or(0) >> 20;
    let make_room = "Delete or move old sessions, then record again. What was recorded is safe.";
    if let (false, Some(last)) = (recorder.recording, &recorder.last) {
        if let Some(failure) = &last.failure {
            list.error(
                "recorder",
                "recording_failed",
                format!("Recording ended: {failure}."),
                if failure.contains("disk full") {
                    make_room
                } else {
                    "Look at the disk, then record again."
                },
            );
        } else if last.why == "disk_full" {
            let what = format!("Recording ended: the disk is nearly full ({free_mib} MiB left).");
            list.error("recorder", "disk_full", what, make_room);
        }
    }
    if let (true, Some(last)) =
        (recorder.recording, recorder.last.as_ref().filter(|last| last.why == "displaced"))
    {
        let what = format!(
            "{}.",
            last.failure.as_deref().unwrap_or("A session was moved or deleted while recording")
        );
        let on = recorder.session.as_deref().unwrap_or("another session");
        let advice =
            format!("Recording goes on in {on}. Leave the folder of a session alone until it is closed.");
        list.error("recorder", "session_displaced", what, advice);
    }
    if recorder.low_disk {
        let left = match recorder.seconds_left {
            Some(left_s) if recorder.recording => format!(", about {:.0} min at this rate", left_s / 60.0),
            _ => String::new(),
        };
        list.warn(
            "recorder",
            "low_disk",
            format!("{free_mib} MiB are left on the disk{left}."),
            "Make room before recording ends.",
        );
    }
    if recorder.stalled_s > SLOW_WRITE_S {
        list.error(
            "recorder",
            "disk_slow",
            format!("The disk has accepted no packets for {:.1} s; they wait in memory.", recorder.stalled_s),
            "If this lasts, packets are lost. Record to a faster disk.",
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_disk_says_what_to_do() {
        let mut recorder = RecorderStatus { free_bytes: Some(5 << 20), ..RecorderStatus::default() };
        recorder.last = Some(super::super::status::LastSession {
            name: "a".into(),
            dir: "a".into(),
            why: "disk_full",
            complete: true,
            packets: 1,
            bytes: 1,
            lost: 0,
            failure: None,
        });
        let mut list = List::default();
        of_recorder(&recorder, &mut list);
        assert!(list.0[0].what.contains("5 MiB") && list.0[0].advice.contains("Delete"), "{:?}", list.0);
    }
}
