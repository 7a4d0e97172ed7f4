//! How to talk to a rig, how to stop it from outside, and what comes of a move.

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use firmware_protocol::KeepOut;

/// How to talk to a rig.
#[derive(Clone, Debug)]
pub struct Options {
    /// Name of the session; another one each time. Not zero.
    pub session: u32,
    /// The rig's node number.
    pub node: u8,
    /// How long the rig may miss the host before it stops and holds.
    pub heartbeat_timeout: Duration,
    /// How long a connected rig, which says something every 20 ms, may say nothing at all.
    pub link_timeout: Duration,
    /// Time between repeats of an order that is not acknowledged.
    pub retry: Duration,
    /// How long an answer may take, repeats included.
    pub answer_within: Duration,
    /// How long homing or one move may take.
    pub settle_within: Duration,
    /// Distance from the target that counts as there, rad.
    pub tolerance_rad: f64,
    /// How far below its target an axis goes first, when it does not come from there anyway: play then lies on the same
    /// side each time. 0 goes straight there.
    pub approach_rad: f64,
    /// The configured limits of each axis, rad; an axis without one has only those of firmware and servo.
    pub limits_rad: Vec<(f64, f64)>,
    /// The configured keep-out region of the pair; the firmware has its own.
    pub keep_out: KeepOut,
    /// Time between reports of one axis.
    pub report_every: Duration,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            session: 1,
            node: 1,
            heartbeat_timeout: Duration::from_secs(1),
            link_timeout: Duration::from_secs(1),
            retry: Duration::from_millis(120),
            answer_within: Duration::from_millis(1500),
            settle_within: Duration::from_secs(20),
            tolerance_rad: 0.3f64.to_radians(),
            approach_rad: 1f64.to_radians(),
            limits_rad: Vec::new(),
            keep_out: KeepOut::NONE,
            report_every: Duration::from_millis(50),
        }
    }
}

impl Options {
    /// The usual options for a session with a name of its own.
    pub fn new_session() -> Self {
        let unix = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let session = unix.as_nanos() as u32 ^ std::process::id().rotate_left(16);
        Self { session: session.max(1), ..Self::default() }
    }
}

/// Stops an operation from outside: the first time the rig decelerates and holds, the second time it stops at once.
#[derive(Clone, Debug, Default)]
pub struct Interrupt(Arc<AtomicU8>);

impl Interrupt {
    /// Asks once more; returns how often it was asked.
    pub fn raise(&self) -> u8 {
        self.0.fetch_add(1, Ordering::Relaxed).saturating_add(1)
    }

    /// Forgets that it was asked: motion is allowed again.
    pub fn reset(&self) {
        self.0.store(0, Ordering::Relaxed);
    }

    /// How often it was asked.
    pub(crate) fn level(&self) -> u8 {
        self.0.load(Ordering::Relaxed)
    }
}

/// How far a move is.
#[derive(Clone, Debug, PartialEq)]
pub struct Progress {
    /// Angle of each axis, rad.
    pub measured_rad: Vec<f64>,
    /// Target of each axis, rad.
    pub target_rad: Vec<f64>,
}

/// One axis after a move.
#[derive(Clone, Debug, PartialEq)]
pub struct AppliedAxis {
    /// Its setpoint, rad.
    pub target_rad: f64,
    /// Where it is, rad: the mean of the readings since it holds.
    pub measured_rad: f64,
    /// How that is known: `measured` or `commanded`.
    pub source: &'static str,
    /// The side it came from: `from_below`, or `either` where limits left no room for that.
    pub approach: &'static str,
    /// How old the reading is, s.
    pub age_s: f64,
    /// Half the width in which the true angle lies around it, rad: what the encoder errs and resolves, the scatter, and the
    /// play between encoder and load unless it came from below. None where nothing measures the angle.
    pub uncertainty_rad: Option<f64>,
    /// Half the distance between the lowest and the highest reading while it held, rad.
    pub scatter_rad: f64,
    /// How many readings that were.
    pub readings: usize,
}

/// The axes after a move.
#[derive(Clone, Debug, PartialEq)]
pub struct Applied {
    /// One per axis.
    pub axes: Vec<AppliedAxis>,
}
