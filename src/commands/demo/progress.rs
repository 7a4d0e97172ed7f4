//! What the demo is doing: a bar on a terminal, one line per stage elsewhere.

use std::collections::BTreeMap;
use std::io::{IsTerminal as _, Write as _};
use std::time::Instant;

use crate::commands::stage::Stage;

/// Stages done and in progress.
pub struct Progress {
    /// The present one.
    pub bar: Stage,
    begun: Option<Begun>,
    seconds: BTreeMap<&'static str, f64>,
}

struct Begun {
    name: &'static str,
    what: &'static str,
    at: Instant,
}

impl Progress {
    /// Nothing begun.
    pub(crate) fn new() -> Self {
        Self { bar: Stage::begin(""), begun: None, seconds: BTreeMap::new() }
    }

    /// Begins a stage; `name` is its key among the seconds, `what` what people read.
    pub(crate) fn stage(&mut self, name: &'static str, what: &'static str) {
        self.end();
        self.begun = Some(Begun { name, what, at: Instant::now() });
        self.bar.next(what);
        if !std::io::stderr().is_terminal() {
            let _ = writeln!(std::io::stderr(), "{what} ..."); // a demo without a reader runs all the same
        }
    }

    /// Ends the last stage; seconds per stage.
    pub(crate) fn finish(mut self) -> BTreeMap<&'static str, f64> {
        self.end();
        self.seconds
    }

    fn end(&mut self) {
        if let Some(Begun { name, what, at }) = self.begun.take() {
            let seconds = at.elapsed().as_secs_f64();
            self.seconds.insert(name, seconds);
            self.bar.leave(format!("{what} ({seconds:.1} s)"));
        }
    }
}
