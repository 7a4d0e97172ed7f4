//! The log on stderr, and panics in it.

use std::os::fd::AsFd as _;
use std::sync::Arc;

use anyhow::Context as _;

use super::{Args, LogFormat};
use crate::commands::Outcome;
use crate::daemon::{Ending, Log, Supervision, words};

pub(super) fn start_log(args: &Args) -> anyhow::Result<Log> {
    // not through the standard library's handle: its lock would be held by a write that waits
    let stderr = std::io::stderr().as_fd().try_clone_to_owned().context("stderr")?;
    let log = Log::start(std::fs::File::from(stderr)).context("no thread for the log")?;
    let writer = log.clone();
    let lines = tracing_subscriber::fmt()
        .with_writer(move || writer.clone())
        .with_ansi(false)
        .with_target(false)
        .with_max_level(args.log_level);
    // a program that has a log already keeps it
    let _ = match args.log_format {
        LogFormat::Text => lines.try_init(),
        LogFormat::Json => lines.json().flatten_event(true).try_init(),
    };
    Ok(log)
}

/// Panics go into the log without waiting, and to whoever watches the daemon's threads.
pub(super) fn say_panics(supervision: &Arc<Supervision>) {
    let supervision = Arc::clone(supervision);
    std::panic::set_hook(Box::new(move |panic| {
        let thread = std::thread::current().name().unwrap_or("unnamed").to_owned();
        let place = panic.location().map(ToString::to_string).unwrap_or_default();
        let what = words(panic.payload());
        tracing::error!(event = "panic", thread, "a defect of the program: panicked at {place}: {what}");
        supervision.panicked(&thread, &format!("{what} ({place})"));
    }));
}

/// The last lines, and how the program ends.
pub(super) fn conclude(ending: &Ending) -> Outcome {
    let recorder = &ending.recorder;
    match &recorder.last {
        Some(last) if last.packets == 0 => tracing::warn!(
            sessions = recorder.sessions,
            "the last session has no packets: nothing came from any sensor; {}",
            last.dir.display()
        ),
        Some(last) => tracing::info!(
            sessions = recorder.sessions,
            lost = recorder.lost,
            "the last session is {}",
            last.dir.display()
        ),
        None => tracing::info!("nothing was recorded"),
    }
    if !ending.deaths.is_empty() {
        tracing::error!("the daemon ended in order after a part of it died: {}", ending.deaths.join("; "));
        return Outcome::Defect;
    }
    if ending.data_lost { Outcome::DataLost } else { Outcome::Done }
}
