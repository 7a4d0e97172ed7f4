//! What a long verb is at, for whoever sits before it: one line on a terminal, nothing elsewhere.

use std::io::IsTerminal as _;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

use super::output;
use crate::recording::Observer;
use crate::simulate::Progress;
use crate::verify::judgement::judge::Step;

/// A verb at work; the line disappears when it ends.
pub struct Stage(ProgressBar);

/// Shows on the terminal how far a recording is read.
pub(crate) fn observer() -> Observer {
    Observer {
        stage: |what| {
            let stage = Stage::begin(what);
            Box::new(move |progress| stage.progress()(progress))
        },
        reading: |bytes| {
            let bar = ProgressBar::new(bytes);
            if let Ok(style) = ProgressStyle::with_template("{bar:40} {bytes}/{total_bytes} {eta}") {
                bar.set_style(style);
            }
            let stage = Stage(bar);
            Box::new(move |position| stage.at(position))
        },
        notice: output::say_notice,
    }
}

/// Without and with a known amount of work.
const UNCOUNTED: &str = "{spinner} {elapsed} {wide_msg}";
const COUNTED: &str = "{bar:24} {percent:>3} %, {eta} left: {wide_msg}";

/// A bar without a known amount of work that others fill in.
pub(crate) fn spinner() -> ProgressBar {
    let bar = ProgressBar::new_spinner();
    if let Ok(style) = ProgressStyle::with_template(UNCOUNTED) {
        bar.set_style(style);
    }
    bar
}

impl Stage {
    /// Begins the first part of the work.
    pub(crate) fn begin(what: impl Into<String>) -> Self {
        let is_seen = std::io::stderr().is_terminal() && !output::is_quiet();
        let stage = Self(if is_seen { ProgressBar::new_spinner() } else { ProgressBar::hidden() });
        stage.next(what);
        if is_seen {
            stage.0.enable_steady_tick(Duration::from_millis(200));
        }
        stage
    }

    /// Goes on to the next part, with an unknown amount of work.
    pub(crate) fn next(&self, what: impl Into<String>) {
        let what = what.into();
        output::say_step(&what);
        self.style(UNCOUNTED);
        self.say(what);
    }

    /// Says it in other words.
    pub(crate) fn say(&self, what: impl Into<String>) {
        self.0.set_message(what.into());
    }

    /// How much there is to do in this part, `done` of it already.
    pub(crate) fn counts(&self, all: u64, done: u64) {
        self.0.set_length(all);
        self.0.set_position(done);
        self.0.reset_eta();
        self.style(COUNTED);
    }

    /// How much of it is done.
    pub(crate) fn at(&self, done: u64) {
        self.0.set_position(done);
    }

    /// So much more of it is done.
    pub(crate) fn more(&self, done: u64) {
        self.0.inc(done);
    }

    /// Follows what a library reports.
    pub(crate) fn progress(&self) -> impl Fn(Progress) + Sync + '_ {
        |progress| match progress {
            Progress::Total(all) => self.counts(all, 0),
            Progress::Done(more) => self.more(more),
            Progress::At(done) => self.at(done),
        }
    }

    /// Follows a recording's judgement.
    pub(crate) fn judging(&self) -> impl Fn(Step) + '_ {
        |step| match step {
            Step::HealthyRuns(runs) => {
                self.next(format!("simulating {runs} healthy runs (--nulls)"));
                self.counts(runs, 0);
            }
            Step::HealthyRun => self.more(1),
            Step::Mounts => self.next("looking where the sensors really sit"),
        }
    }

    /// Leaves a line above, on a terminal.
    pub(crate) fn leave(&self, line: impl AsRef<str>) {
        self.0.println(line);
    }

    fn style(&self, template: &str) {
        if let Ok(style) = ProgressStyle::with_template(template) {
            self.0.set_style(style);
        }
    }
}

impl Drop for Stage {
    fn drop(&mut self) {
        // an error message must not stand next to half a bar
        self.0.finish_and_clear();
    }
}
