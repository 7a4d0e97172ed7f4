//! The rig: found, lost and found again; one operator at a time gives it orders.
//!
//! Whatever moves needs the armed state. Hold and e-stop need nothing and wait for nothing.

mod error;
mod telling;

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use firmware_protocol::KeepOut;

pub use error::RigCommandError;

use super::journal::Journal;
use super::site::Motion;
use super::status::RigState;
use super::supervision::{Pulse, Role, Supervision};
use crate::drive::{Interrupt, LinkError, Options, Rig, RigError, RigStatus, ServoReport};
use crate::live::clocks::host::steady_now_ns;

/// Time between two tries to find a rig.
const RETRY: Duration = Duration::from_secs(1);
/// How often its state is read while nothing moves.
const LOOK: Duration = Duration::from_millis(100);

/// A heartbeat comes within this time, on a busy machine too.
const HEARTBEAT: Duration = Duration::from_secs(3);

/// Which rig, and how to talk to it.
#[derive(Clone, Debug)]
pub struct RigSettings {
    /// Its address, as [`crate::drive::open`] knows them.
    pub port: PathBuf,
    /// Limits, tolerance, times.
    pub options: Options,
    /// Pitch of each axis in the configured mount, degrees.
    pub mount_pitches_deg: Vec<f64>,
    /// Disarm when no command came for so long.
    pub disarm_after: Duration,
}

/// A handle on the rig's thread.
pub(super) struct RigHost {
    shared: Arc<Shared>,
    thread: Mutex<Option<JoinHandle<()>>>,
}

struct Shared {
    settings: RigSettings,
    journal: Arc<Journal>,
    motion: Arc<Motion>,
    state: Mutex<RigState>,
    rig: Mutex<Option<Arc<Rig>>>,
    /// Apart from the rig's own lock, so that nothing delays a stop.
    interrupt: Mutex<Option<Interrupt>>,
    last_command: Mutex<Instant>,
    /// Commands that have ended.
    commands: AtomicU64,
    quit: AtomicBool,
}

impl RigHost {
    /// Connects. A rig in use by another program is an error; one that is not there may still come.
    pub(crate) fn start(
        settings: RigSettings,
        journal: Arc<Journal>,
        motion: Arc<Motion>,
        supervision: &Arc<Supervision>,
    ) -> Result<Self, RigError> {
        let limits_rad = settings.options.limits_rad.iter();
        let state = RigState {
            port: settings.port.display().to_string(),
            mount_pitches_deg: settings.mount_pitches_deg.clone(),
            recorded_pitches_deg: settings.mount_pitches_deg.clone(),
            limits_deg: limits_rad
                .map(|(low_rad, high_rad)| [low_rad.to_degrees(), high_rad.to_degrees()])
                .collect(),
            ..RigState::default()
        };
        let shared = Arc::new(Shared {
            settings,
            journal,
            motion,
            state: Mutex::new(state),
            rig: Mutex::default(),
            interrupt: Mutex::default(),
            last_command: Mutex::new(Instant::now()),
            commands: AtomicU64::new(0),
            quit: AtomicBool::new(false),
        });
        match shared.connect() {
            Err(error @ RigError::Link(LinkError::InUse { .. })) => return Err(error),
            Err(error) => shared.lost(&error),
            Ok(()) => {}
        }
        let worker = Arc::clone(&shared);
        let thread = supervision
            .spawn("rig-watch", Role::Dispensable, move |pulse| worker.run(pulse))
            .map_err(|_| RigError::Closed)?;
        Ok(Self { shared, thread: Mutex::new(Some(thread)) })
    }

    /// What it does now.
    pub(crate) fn state(&self) -> RigState {
        let mut state = lock(&self.shared.state).clone();
        if state.status.as_ref().is_some_and(|status| status.armed) {
            let idle = lock(&self.shared.last_command).elapsed();
            let left = self.shared.settings.disarm_after.saturating_sub(idle);
            state.disarms_in_s = Some(left.as_secs_f64());
        }
        state.count_ages();
        state
    }

    /// The configured limits of an axis, rad.
    pub(crate) fn limits_rad(&self, axis: usize) -> Option<(f64, f64)> {
        self.shared.settings.options.limits_rad.get(axis).copied()
    }

    /// The configured region that a pair of pitches keeps out of.
    pub(crate) fn keep_out(&self) -> KeepOut {
        self.shared.settings.options.keep_out
    }

    /// Allows motion, or forbids it.
    pub(crate) fn arm(&self, armed: bool) -> Result<(), RigCommandError> {
        let word = if armed { "arm" } else { "disarm" };
        self.shared.command(word, false, |rig| {
            if armed { rig.arm() } else { rig.disarm() }?;
            // the rig has agreed; that it is so comes with its next heartbeat
            let asked = Instant::now();
            while rig.status()?.armed != armed && asked.elapsed() < HEARTBEAT {
                std::thread::sleep(Duration::from_millis(10));
            }
            Ok(())
        })
    }

    /// Makes positions trusted.
    pub(crate) fn home(&self) -> Result<(), RigCommandError> {
        self.shared.command("home", true, Rig::home)
    }

    /// Moves every axis to its pitch.
    pub(crate) fn apply(&self, pitches_deg: &[f64]) -> Result<(), RigCommandError> {
        let pitches_rad: Vec<f64> = pitches_deg.iter().map(|pitch_deg| pitch_deg.to_radians()).collect();
        let shared = &self.shared;
        shared.command("apply", true, |rig| {
            let follow =
                |step: &crate::drive::Progress| shared.show_progress(&step.measured_rad, &step.target_rad);
            rig.apply_with(&pitches_rad, follow).map(drop)
        })
    }

    /// Moves every axis to the pitch of the configured mount.
    pub(crate) fn apply_mount(&self) -> Result<(), RigCommandError> {
        let pitches_deg = &self.shared.settings.mount_pitches_deg;
        if pitches_deg.is_empty() {
            return Err(RigCommandError::NoMount);
        }
        self.apply(pitches_deg)
    }

    /// From now on sessions have a mount with these pitches.
    pub(crate) fn record_with(&self, pitches_deg: &[f64]) {
        lock(&self.shared.state).recorded_pitches_deg = pitches_deg.to_vec();
    }

    /// Decelerates and holds, whatever moves.
    pub(crate) fn hold(&self) -> Result<(), RigCommandError> {
        self.shared.stop(1)
    }

    /// Stops as fast as the rig can and latches that.
    pub(crate) fn e_stop(&self) -> Result<(), RigCommandError> {
        self.shared.stop(2)
    }

    /// Clears latched faults without a cause any more.
    pub(crate) fn clear(&self) -> Result<(), RigCommandError> {
        self.shared.command("clear", false, Rig::clear_faults)
    }

    /// Disarms and lets go of the line.
    pub(crate) fn quit(&self) {
        self.shared.quit.store(true, Ordering::Relaxed);
        if let (Some(_), Some(interrupt)) = (self.state().busy, &*lock(&self.shared.interrupt)) {
            interrupt.raise(); // the present move ends with a hold
        }
        if let Some(thread) = lock(&self.thread).take() {
            let _ = thread.join();
        }
        *lock(&self.shared.rig) = None;
    }
}

impl Drop for RigHost {
    fn drop(&mut self) {
        self.quit();
    }
}

impl Shared {
    fn connect(&self) -> Result<(), RigError> {
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

    fn lost(&self, error: &RigError) {
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

    fn run(&self, pulse: &Pulse) {
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

    fn show_progress(&self, measured_rad: &[f64], target_rad: &[f64]) {
        let mut state = lock(&self.state);
        let axes = state.status.iter_mut().flat_map(|status| &mut status.axes);
        for ((axis, measured_rad), target_rad) in axes.zip(measured_rad).zip(target_rad) {
            (axis.position_deg, axis.target_deg) = (measured_rad.to_degrees(), target_rad.to_degrees());
        }
    }

    /// Carries out a command, one at a time.
    fn command(
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
    fn stop(&self, level: u8) -> Result<(), RigCommandError> {
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

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mock::rig::{MockConfig, MockRig};
    use crate::rig::Mount;

    #[test]
    fn a_rig_that_is_lost_is_assumed_to_stand_where_it_stood() {
        let start_urad = Some([300_000, -200_000]);
        let mock = MockRig::start(MockConfig { start_urad, ..MockConfig::default() }, 3).unwrap();
        let settings = RigSettings {
            port: mock.path().to_owned(),
            options: Options::new_session(),
            mount_pitches_deg: vec![40.0, -40.0],
            disarm_after: Duration::from_secs(600),
        };
        let (journal, _lines) = Journal::new();
        let motion = Arc::new(Motion::new(2));
        let stands_rad = |axis: usize| {
            let mount = Mount { pitch_rad: 0.7, ..Mount::default() };
            [0.3, -0.2, 0.7].into_iter().find(|pitch_rad| {
                let near = Mount { pitch_rad: *pitch_rad, ..mount }.body_from_sensor();
                let up = glam::DVec3::Z;
                (motion.body_from_sensor(axis, &mount).transform_point(up) - near.transform_point(up))
                    .length()
                    < 0.01
            })
        };
        assert_eq!(stands_rad(0), Some(0.7), "before it is found the mount is all that is known");
        let host = RigHost::start(settings, Arc::new(journal), Arc::clone(&motion), &Arc::default()).unwrap();
        assert_eq!([0, 1].map(stands_rad), [Some(0.3), Some(-0.2)], "from the first moment on");
        mock.close();
        while host.state().connected {
            std::thread::sleep(Duration::from_millis(10));
        }
        assert_eq!([0, 1].map(stands_rad), [Some(0.3), Some(-0.2)], "nothing turned it");
        let ages_ms = || {
            let state = host.state();
            let axes = state.status.unwrap().axes.into_iter();
            axes.map(|axis| axis.age_ms).chain(state.age_ms).collect::<Vec<f64>>()
        };
        let before_ms = ages_ms();
        std::thread::sleep(Duration::from_millis(100));
        let grown_ms = ages_ms().into_iter().zip(before_ms).map(|(now_ms, before_ms)| now_ms - before_ms);
        let grown_ms: Vec<f64> = grown_ms.collect();
        assert!(grown_ms.len() == 3 && grown_ms.iter().all(|ms| *ms >= 100.0), "{grown_ms:?}");
    }
}
