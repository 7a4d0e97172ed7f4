//! The rig: found, lost and found again; one operator at a time gives it orders.
//!
//! Whatever moves needs the armed state. Hold and e-stop need nothing and wait for nothing.

mod error;
mod telling;
mod watch;

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
use super::supervision::{Role, Supervision};
use crate::drive::{Interrupt, LinkError, Options, Rig, RigError};

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
