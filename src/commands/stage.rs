//! What a long verb is at, for whoever sits before it: one line on a terminal, nothing elsewhere.

use std::io::IsTerminal as _;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

/// A verb at work; the line is taken away when it ends.
pub struct Stage(ProgressBar);

impl Stage {
    /// Begins the first part of the work.
    pub fn begin(what: impl Into<String>) -> Self {
        if !std::io::stderr().is_terminal() {
            return Self(ProgressBar::hidden());
        }
        let bar = ProgressBar::new_spinner();
        if let Ok(style) = ProgressStyle::with_template("{spinner} {elapsed} {wide_msg}") {
            bar.set_style(style);
        }
        bar.set_message(what.into());
        bar.enable_steady_tick(Duration::from_millis(200));
        Self(bar)
    }

    /// Goes on to the next part.
    pub fn next(&self, what: impl Into<String>) {
        self.0.set_message(what.into());
    }
}

impl Drop for Stage {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}
