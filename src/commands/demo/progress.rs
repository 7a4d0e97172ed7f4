//! What the demo is doing: a bar on a terminal, one line per stage elsewhere.

use std::collections::BTreeMap;
use std::io::IsTerminal as _;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

/// Stages done and under way.
pub struct Progress {
    bar: ProgressBar,
    on_terminal: bool,
    stage: Option<(&'static str, Instant)>,
    seconds: BTreeMap<&'static str, f64>,
}

impl Progress {
    /// Nothing begun.
    pub fn new() -> Self {
        let on_terminal = std::io::stderr().is_terminal();
        let bar = if on_terminal { ProgressBar::new(0) } else { ProgressBar::hidden() };
        let style = ProgressStyle::with_template("{msg:34} {bar:30} {percent:>3} %")
            .unwrap_or_else(|_| ProgressStyle::default_bar());
        bar.set_style(style);
        Self { bar, on_terminal, stage: None, seconds: BTreeMap::new() }
    }

    /// Begins a stage; `name` is its key among the seconds, `what` what people read.
    pub fn stage(&mut self, name: &'static str, what: &str) {
        self.end();
        self.stage = Some((name, Instant::now()));
        self.bar.set_length(0);
        self.bar.set_position(0);
        self.bar.set_message(what.to_owned());
        self.bar.enable_steady_tick(Duration::from_millis(200));
        if !self.on_terminal {
            eprintln!("{what} ...");
        }
    }

    /// How much the stage has to do.
    pub fn length(&self, length: u64) {
        self.bar.set_length(length);
    }

    /// How much of it is done.
    pub fn at(&self, position: u64) {
        self.bar.set_position(position);
    }

    /// Ends the last stage; seconds per stage.
    pub fn finish(&mut self) -> BTreeMap<&'static str, f64> {
        self.end();
        self.bar.finish_and_clear();
        self.seconds.clone()
    }

    fn end(&mut self) {
        if let Some((name, start)) = self.stage.take() {
            let seconds = start.elapsed().as_secs_f64();
            self.seconds.insert(name, seconds);
            if self.on_terminal {
                self.bar.println(format!("{} ({seconds:.1} s)", self.bar.message()));
            }
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        // an error message must not stand beside half a bar
        self.bar.finish_and_clear();
    }
}
