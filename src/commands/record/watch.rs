//! A recording in progress, for the terminal.

use std::io::Write as _;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use indicatif::{HumanBytes, HumanCount};

use crate::commands::signals::StopRequests;
use crate::commands::stage::spinner;
use crate::live::receive::{DataTimeouts, Listen, now_ns};
use crate::live::watch::FirstLooks;
use crate::recording::{LiveRecording, Parts};

/// How often counters are looked at.
const LOOK: Duration = Duration::from_millis(100);

/// Shows what arrives until the time is up, a signal comes or recording ends by itself. What is wrong with the packets is
/// reported at once, and returned.
pub(super) async fn watch(
    recording: &mut LiveRecording,
    parts: &mut Parts,
    listens: &[Listen],
    looks: &FirstLooks,
    duration: Option<Duration>,
) -> anyhow::Result<Vec<String>> {
    let mut stop_requests = StopRequests::new().context("signals cannot be caught")?;
    let mut tick = tokio::time::interval(LOOK);
    let begun = Instant::now();
    let bar = spinner();
    let mut timeouts = DataTimeouts::new(listens.len(), begun);
    let mut low_disk_reported = false;
    let mut report_low_disk = |recording: &LiveRecording| {
        if let (Some(low), false) = (recording.session().low_disk(), low_disk_reported) {
            low_disk_reported = true;
            let left =
                low.seconds_left.map_or(String::new(), |left| format!(", about {left:.0} s at this rate"));
            bar.suspend(|| say(&format!("warning: {} left on the disk{left}", HumanBytes(low.free_bytes))));
        }
    };
    let (mut clock_steps, mut unread) = (0, Vec::new());
    while duration.is_none_or(|duration| begun.elapsed() < duration) && !recording.has_ended() {
        tokio::select! {
            () = stop_requests.next() => break,
            _ = tick.tick() => {}
        }
        bar.set_message(status_line(recording, listens));
        if let Some(displaced) = recording.session().displaced() {
            parts
                .go_on(recording, &displaced.words)
                .with_context(|| format!("{}, and recording cannot go on", displaced.words))?;
            let (words, dir) = (&displaced.words, parts.dir().display());
            bar.suspend(|| say(&format!("warning: {words}; recording goes on in {dir}")));
        }
        for news in timeouts.poll(recording.monitor(), Instant::now()) {
            let name = &listens[news.sensor].name;
            bar.suspend(|| say(&format!("{name}: {}", news.words)));
            let event = serde_json::json!({"time_ns": now_ns(), "event": news.event, "sensor": name});
            recording.session().write_event(&event)?;
        }
        for news in looks.news() {
            let words = unreadable(listens, &news);
            bar.suspend(|| say(&format!("warning: {words}")));
            let (name, text) = (&listens[news.0].name, &news.1);
            let event = serde_json::json!({"time_ns": now_ns(), "event": "not_decoded", "sensor": name, "text": text});
            recording.session().write_event(&event)?;
            unread.push(words);
        }
        for words in recording.session().clock_steps().into_iter().skip(clock_steps) {
            clock_steps += 1;
            bar.suspend(|| say(&format!("note: {words}; the session goes on as if it had not been")));
        }
        report_low_disk(recording);
    }
    // a small disk is full before the next look
    report_low_disk(recording);
    bar.finish_and_clear();
    Ok(unread)
}

fn status_line(recording: &LiveRecording, listens: &[Listen]) -> String {
    let monitor = recording.monitor();
    let lost: u64 = monitor.kernel_drops().iter().sum::<u64>()
        + monitor.sensors().iter().map(|sensor| sensor.queue_dropped).sum::<u64>();
    let sensors: Vec<String> = monitor
        .sensors()
        .iter()
        .zip(listens)
        .map(|(counters, listen)| format!("{} {}", listen.name, HumanCount(counters.packets)))
        .collect();
    format!("{} packets, {}, lost {lost}", sensors.join(", "), HumanBytes(recording.session().packet_bytes()))
}

pub(super) fn unreadable(listens: &[Listen], (sensor, words): &(usize, String)) -> String {
    format!("{}: {words}", listens[*sensor].name)
}

pub(super) fn say(message: &str) {
    let _ = writeln!(std::io::stderr(), "outrigger: {message}");
}
