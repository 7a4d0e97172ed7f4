//! The rig's thread: connects, reads the state, carries out commands, and stops for whoever asks.

use std::collections::BTreeSet;
use std::sync::atomic::Ordering;
use std::sync::{Arc, MutexGuard};
use std::time::{Duration, Instant};

use super::{RigCommandError, Shared, lock, telling};
use crate::daemon::status::RigState;
use crate::daemon::supervision::Pulse;
use crate::drive::{Options, Rig, RigError, RigStatus};
use crate::live::clocks::host::steady_now_ns;
use crate::recording::ServoReport;

/// How often its state is read while nothing moves.
const LOOK: Duration = Duration::from_millis(100);
/// Time between two tries to find a rig.
const RETRY: Duration = Duration::from_secs(1);
impl Shared {
    pub(super) fn connect(&self) -> Result<(), RigError> {
        // a session of its own each time: the rig knows an old one from a new one
        let options = Options { session: Options::new_session().session, ..self.settings.options.clone() };
        let rig = Rig::connect_with(&self.settings.port, options)?;
        *lock(&self.interrupt) = Some(rig.interrupt());
        let status = rig.status()?;
        *lock(&self.rig) = Some(Arc::new(rig));
        for axis in &status.axes {
            self.turn(axis.axis, &axis.source, axis.position_deg.to_radians());
        }
        let mut state = lock(&self.state);
        let (pitches, axes) = (state.mount_pitches_deg.len(), status.axes.len());
        if pitches != 0 && pitches != axes && state.status.is_none() {
            let words = format!(
                "the mount names {pitches} sensors, the rig has {axes} axes: axis 0 is assumed to turn the first of them, and \
                 the mount cannot be applied from here; `sensors` under [rig.apply] says which sit on axis 0, 1, ..."
            );
            self.journal.tell("mount_of_others", words);
        }
        (state.connected, state.error) = (true, None);
        state.take(status);
        Ok(())
    }

    pub(super) fn lost(&self, error: &RigError) {
        *lock(&self.rig) = None;
        *lock(&self.interrupt) = None;
        let error = error.to_string();
        let mut state = lock(&self.state);
        let is_news = state.error.as_ref() != Some(&error); // each try fails for the same reason
        (state.connected, state.error) = (false, Some(error.clone()));
        if let Some(status) = &mut state.status {
            status.armed = false;
            status.axes.iter_mut().for_each(|axis| axis.source = "stale".into());
        }
        drop(state);
        if is_news {
            self.journal.tell("rig_lost", error);
        }
    }

    pub(super) fn run(&self, pulse: &Pulse) {
        // an unwatched rig is let go of: it misses its heartbeat and disarms itself
        let _unwatched = LetGo(self);
        while !self.quit.load(Ordering::Relaxed) {
            let rig = lock(&self.rig).clone();
            let Some(rig) = rig else {
                self.pause(RETRY);
                if !self.quit.load(Ordering::Relaxed) {
                    match self.connect() {
                        Ok(()) => {
                            self.journal.tell("rig_back", "the rig is connected; home it before it moves")
                        }
                        Err(error) => self.lost(&error),
                    }
                }
                continue;
            };
            if let Err(error) = self.watch(&rig, pulse) {
                self.lost(&error);
            }
        }
    }

    /// Follows the rig until it is lost or the daemon ends.
    fn watch(&self, rig: &Rig, pulse: &Pulse) -> Result<(), RigError> {
        let reports = rig.reports();
        let mut looked = Instant::now();
        let mut latched = BTreeSet::new();
        while !self.quit.load(Ordering::Relaxed) {
            pulse.beat();
            match reports.recv_timeout(LOOK) {
                Ok(report) => self.take(report),
                Err(std::sync::mpsc::RecvTimeoutError::Timeout) => {}
                Err(std::sync::mpsc::RecvTimeoutError::Disconnected) => {
                    return Err(rig.status().err().unwrap_or(RigError::Closed));
                }
            }
            // a rig that carries out a command answers after it; its reports come all the same
            if looked.elapsed() >= LOOK && lock(&self.state).busy.is_none() {
                looked = Instant::now();
                let commands = self.commands.load(Ordering::SeqCst);
                let status = rig.status()?;
                self.disarm_idle(rig, &status)?;
                telling::faults(&self.journal, &status, &mut latched);
                let mut state = lock(&self.state);
                // a command that ended since has shown what is newer
                if self.commands.load(Ordering::SeqCst) == commands {
                    state.take(status);
                }
            }
        }
        Ok(())
    }

    fn disarm_idle(&self, rig: &Rig, status: &RigStatus) -> Result<(), RigError> {
        if status.armed && lock(&self.last_command).elapsed() >= self.settings.disarm_after {
            rig.disarm()?;
            self.journal.tell("rig_disarmed", "disarmed: no command came for a while");
        }
        Ok(())
    }

    /// The sensor on an axis turned with it; one without a known zero is assumed at its mount's pitch.
    fn turn(&self, axis: usize, source: &str, pitch_rad: f64) {
        match source {
            "measured" => self.motion.set_pitch_rad(axis, pitch_rad),
            "not_homed" => self.motion.set_pitch_rad(axis, f64::NAN),
            _ => {}
        }
    }

    fn take(&self, report: ServoReport) {
        self.turn(report.axis, &report.source, f64::from(report.position_urad) * 1e-6);
        let deg = |urad: i32| (f64::from(urad) * 1e-6).to_degrees();
        let mut state = lock(&self.state);
        if let Some(axis) = state.status.as_mut().and_then(|status| status.axes.get_mut(report.axis)) {
            axis.position_deg = deg(report.position_urad);
            axis.target_deg = deg(report.target_urad);
            axis.state.clone_from(&report.state);
            axis.source.clone_from(&report.source);
            axis.faults.clone_from(&report.faults);
            axis.uncertainty_deg = report.uncertainty_urad.map(deg);
            let age_ns = steady_now_ns().saturating_sub(report.time_ns);
            axis.age_ms = age_ns as f64 * 1e-6;
            let now = Instant::now();
            state.axes_as_of[report.axis] = now.checked_sub(Duration::from_nanos(age_ns)).unwrap_or(now);
        }
        drop(state);
        self.journal.servo(report);
    }

    pub(super) fn show_progress(&self, measured_rad: &[f64], target_rad: &[f64]) {
        let mut state = lock(&self.state);
        let axes = state.status.iter_mut().flat_map(|status| &mut status.axes);
        for ((axis, measured_rad), target_rad) in axes.zip(measured_rad).zip(target_rad) {
            (axis.position_deg, axis.target_deg) = (measured_rad.to_degrees(), target_rad.to_degrees());
        }
    }

    /// Carries out a command, one at a time.
    pub(super) fn command(
        &self,
        word: &'static str,
        moves: bool,
        work: impl FnOnce(&Rig) -> Result<(), RigError>,
    ) -> Result<(), RigCommandError> {
        let rig = self.connected()?;
        {
            let mut state = lock(&self.state);
            if let Some(other) = state.busy {
                return Err(RigCommandError::Busy(other));
            }
            if moves && !state.status.as_ref().is_some_and(|status| status.armed) {
                return Err(RigCommandError::NotArmed);
            }
            state.busy = Some(word);
        }
        *lock(&self.last_command) = Instant::now();
        let outcome = work(&rig);
        *lock(&self.last_command) = Instant::now();
        let status = rig.status().ok();
        let has_moved = moves && outcome.as_ref().is_err_and(telling::ends_a_move);
        let mut state = self.conclude(word, &outcome, status, has_moved);
        // while it is locked: what was asked of the rig before this is older than what is shown now
        self.commands.fetch_add(1, Ordering::SeqCst);
        state.busy = None;
        drop(state);
        Ok(outcome?)
    }

    /// Shows and writes down how an order ended, and where it left the axes, where that `is_news`. The state is still locked:
    /// whoever sees the end of a command may give the next.
    fn conclude(
        &self,
        word: &str,
        outcome: &Result<(), RigError>,
        status: Option<RigStatus>,
        is_news: bool,
    ) -> MutexGuard<'_, RigState> {
        let words = telling::ended(&self.journal, word, outcome, status.as_ref().filter(|_| is_news));
        let mut state = lock(&self.state);
        state.last_command = Some(words);
        if let Some(status) = status {
            state.take(status);
        }
        state
    }

    /// Interrupts the present move: once to hold, twice for an emergency stop.
    pub(super) fn stop(&self, level: u8) -> Result<(), RigCommandError> {
        let interrupt = lock(&self.interrupt).clone();
        let Some(interrupt) = interrupt else { return Err(self.not_connected()) };
        let asked = Instant::now();
        // two who say hold at once must not make an emergency stop
        while interrupt.level() < level {
            interrupt.raise();
        }
        let rig = self.connected()?;
        // the rig's thread obeys the interrupt first; this waits for it
        let (word, outcome) = if level >= 2 {
            ("e-stop", rig.e_stop_since(asked))
        } else {
            ("hold", rig.hold().and_then(|()| rig.status()))
        };
        interrupt.reset();
        let (status, outcome) = match outcome {
            Ok(status) => (Some(status), Ok(())),
            Err(error) => (rig.status().ok(), Err(error)),
        };
        drop(self.conclude(word, &outcome, status, true));
        Ok(outcome?)
    }

    fn connected(&self) -> Result<Arc<Rig>, RigCommandError> {
        lock(&self.rig).clone().ok_or_else(|| self.not_connected())
    }

    fn not_connected(&self) -> RigCommandError {
        RigCommandError::NotConnected(lock(&self.state).error.clone().unwrap_or_default())
    }

    fn pause(&self, time: Duration) {
        let until = Instant::now() + time;
        while Instant::now() < until && !self.quit.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

/// Says that the rig is lost when its watch panics.
struct LetGo<'a>(&'a Shared);

impl Drop for LetGo<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.lost(&RigError::Closed);
        }
    }
}
