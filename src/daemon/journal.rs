//! What happened: to the session, to the log, and the newest to the page.

use std::collections::{BTreeMap, VecDeque};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Mutex, PoisonError};

use crate::live::receive::now_ns;
use crate::recording::ServoReport;

/// Events for the page.
const MAX_EVENTS: usize = 100;
/// Lines that may wait for the recorder before they are dropped and counted.
const WAITING: usize = 4096;

/// Events that end a recording early, or take a session away.
const FAILURES: [&str; 3] = ["disk_full", "recording_failed", "session_displaced"];
/// Events that someone should see to.
const TROUBLES: [&str; 15] = [
    "axis_not_homed",
    "component_dead",
    "sensor_silent",
    "sensor_restarted",
    "sensor_settings",
    "clock_jump",
    "host_clock_jump",
    "low_disk",
    "disk_slow",
    "unseated",
    "mount_of_others",
    "rig_command_failed",
    "rig_fault",
    "rig_lost",
    "rotation_failed",
];

/// Something that happened, in words and for programs.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Event {
    /// When, UTC nanoseconds since 1970.
    pub time_ns: u64,
    /// What, for programs: `sensor_silent`, `rig_lost`.
    pub event: &'static str,
    /// Whom it concerns, where it is one sensor.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sensor: Option<String>,
    /// What, for people.
    pub words: String,
}

/// A line for the session.
#[derive(Debug)]
pub(super) enum Entry {
    Event(Event),
    Servo(ServoReport),
}

/// Takes events and servo reports from any thread, never waiting.
#[derive(Debug)]
pub(super) struct Journal {
    newest: Mutex<VecDeque<Event>>,
    lines: SyncSender<Entry>,
}

impl Journal {
    /// The journal, and the lines that the recorder is to write.
    pub(crate) fn new() -> (Self, Receiver<Entry>) {
        let (lines, waiting) = sync_channel(WAITING);
        (Self { newest: Mutex::default(), lines }, waiting)
    }

    /// Something happened to the daemon, the rig or the recorder.
    pub(crate) fn tell(&self, event: &'static str, words: impl Into<String>) {
        self.take(Event { time_ns: now_ns(), event, sensor: None, words: words.into() });
    }

    /// Something happened to a sensor.
    pub(crate) fn tell_of(&self, sensor: &str, event: &'static str, words: impl Into<String>) {
        let words = words.into();
        self.take(Event { time_ns: now_ns(), event, sensor: Some(sensor.to_owned()), words });
    }

    /// A reading of the rig, for the session only.
    pub(crate) fn servo(&self, report: ServoReport) {
        // a recorder that is that far behind is stalled by its disk, and says so
        let _ = self.lines.try_send(Entry::Servo(report));
    }

    /// Writes down that an axis has no zero, and that it has one again; `known` has what the session holds of each so far.
    pub(crate) fn tell_homing(&self, report: &ServoReport, known: &mut BTreeMap<usize, bool>) {
        let (axis, has_zero) = match report.source.as_str() {
            "measured" => (report.axis, true),
            "not_homed" => (report.axis, false),
            _ => return,
        };
        // an axis that is as it should be from the start on is no news
        if known.insert(axis, has_zero).unwrap_or(true) == has_zero {
            return;
        }
        if has_zero {
            self.tell("axis_homed", format!("axis {axis} is homed: its angles are measured from now on"));
        } else {
            let words = format!(
                "axis {axis} is not homed: its angles have no zero, and count for nothing until it is"
            );
            self.tell("axis_not_homed", words);
        }
    }

    /// The newest events, oldest first.
    pub(crate) fn newest(&self) -> Vec<Event> {
        self.newest.lock().unwrap_or_else(PoisonError::into_inner).iter().cloned().collect()
    }

    fn take(&self, event: Event) {
        match event.event {
            name if FAILURES.contains(&name) => {
                tracing::error!(event = name, sensor = event.sensor, "{}", event.words);
            }
            name if TROUBLES.contains(&name) => {
                tracing::warn!(event = name, sensor = event.sensor, "{}", event.words);
            }
            name => tracing::info!(event = name, sensor = event.sensor, "{}", event.words),
        }
        let mut newest = self.newest.lock().unwrap_or_else(PoisonError::into_inner);
        if newest.len() == MAX_EVENTS {
            newest.pop_front();
        }
        newest.push_back(event.clone());
        drop(newest);
        let _ = self.lines.try_send(Entry::Event(event)); // as with a reading
    }
}
