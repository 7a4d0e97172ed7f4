//! The host's side of the conversation with a rig: connect, home, arm, move, wait, read back, hold.

use std::time::{Duration, Instant};

use firmware_protocol::command::CLEAR_KEY;
use firmware_protocol::{
    ALL_AXES, AckCode, Command, Fault, Limit, Order, PROTOCOL_VERSION, ResetCause, State,
};

use super::view::{TargetView, View};
use super::{AxisStatus, Link, RigError, RigStatus};
use crate::recording::ServoReport;

mod options;
mod talk;

pub use options::{Applied, AppliedAxis, Interrupt, Options, Progress};

/// The conversation with one rig over one line.
pub struct RigController<L> {
    link: L,
    options: Options,
    view: View,
    sequence: u8,
    next_id: u16,
    next_heartbeat_ns: u64,
    next_clock_ns: u64,
    clock_sequence: u16,
    connected: bool,
    interrupt: Interrupt,
    handled_interrupts: u8,
    /// When the newest emergency stop was seen to be one.
    stopped: Option<Instant>,
    reports_to: Option<ReportSink>,
}

/// Takes every report as it comes.
pub type ReportSink = Box<dyn FnMut(ServoReport) + Send>;

/// The side from which play does not count.
const FROM_BELOW: &str = "from_below";
/// Readings of a hold that say how much they scatter, and how long they are waited for.
const HELD: usize = 10;
const HELD_WITHIN: Duration = Duration::from_millis(400);

fn rad(urad: i32) -> f64 {
    f64::from(urad) * 1e-6
}

fn deg(urad: i32) -> f64 {
    rad(urad).to_degrees()
}

impl<L: Link> RigController<L> {
    /// Says hello, checks the version, reads every axis' limits and first position.
    pub fn connect(link: L, options: Options) -> Result<Self, RigError> {
        let mut controller = Self {
            link,
            options,
            view: View::default(),
            sequence: 0,
            next_id: 0,
            next_heartbeat_ns: 0,
            next_clock_ns: 0,
            clock_sequence: 0,
            connected: false,
            interrupt: Interrupt::default(),
            handled_interrupts: 0,
            stopped: None,
            reports_to: None,
        };
        controller.open_session()?;
        Ok(controller)
    }

    fn open_session(&mut self) -> Result<(), RigError> {
        let session = self.options.session;
        let hello = Command::Hello {
            protocol_min: PROTOCOL_VERSION,
            protocol_max: PROTOCOL_VERSION,
            heartbeat_timeout_ms: self.options.heartbeat_timeout.as_millis().clamp(100, 5000) as u16,
            nonce: session,
        };
        let other = |view: &View| view.info.is_some_and(|info| info.protocol != PROTOCOL_VERSION);
        self.ask("hello", &[hello], |view| {
            other(view) || (view.info.is_some_and(|info| info.session == session) && view.firmware.is_some())
        })?;
        if let Some(info) = self.view.info {
            if info.protocol != PROTOCOL_VERSION {
                return Err(RigError::Version { found: info.protocol, expected: PROTOCOL_VERSION });
            }
            self.view.axes = vec![Default::default(); usize::from(info.axes)];
        }
        self.connected = true;
        for axis in 0..self.axis_count() {
            for limit in Limit::ALL {
                let question = Command::GetLimit { axis: axis as u8, limit: *limit };
                self.ask("a limit", &[question], |view| view.limit(axis, *limit).is_some())?;
            }
        }
        self.ask("a first position", &[], |view| {
            view.heartbeat.is_some()
                && view
                    .axes
                    .iter()
                    .all(|axis| axis.position.is_some() && axis.target.is_some() && axis.effort.is_some())
        })
    }

    /// How many axes the rig has.
    pub(crate) fn axis_count(&self) -> usize {
        self.view.axes.len()
    }

    /// The line.
    pub fn link(&self) -> &L {
        &self.link
    }

    /// A handle that stops the present move.
    pub fn interrupt(&self) -> Interrupt {
        self.interrupt.clone()
    }

    /// Sends every report there from now on.
    pub fn reports_to(&mut self, sink: ReportSink) {
        self.reports_to = Some(sink);
    }

    /// Allows motion.
    pub fn arm(&mut self) -> Result<(), RigError> {
        self.refuse_when_interrupted()?;
        self.order("arm", Order::Arm { armed: true }).map(drop)
    }

    /// Forbids motion again; the axes hold.
    pub(crate) fn disarm(&mut self) -> Result<(), RigError> {
        self.order("disarm", Order::Arm { armed: false }).map(drop)
    }

    /// Makes the positions of all axes trusted.
    pub fn home(&mut self) -> Result<(), RigError> {
        self.refuse_when_interrupted()?;
        self.view.from_below = false;
        let id = self.order("home", Order::Home { axis: ALL_AXES })?;
        self.wait_for("homing", id, &mut |_| {})
    }

    /// Decelerates and holds; stays armed.
    pub(crate) fn hold(&mut self) -> Result<(), RigError> {
        self.order("hold", Order::Hold).map(drop)
    }

    /// Decelerates, holds, disarms.
    pub fn stop(&mut self) -> Result<(), RigError> {
        self.order("stop", Order::Stop { deceleration_mrad_s2: 0 })?;
        self.see("a standing rig", |state| !matches!(state, State::Moving | State::Homing | State::Holding))
    }

    /// Stops as fast as the rig can and latches that.
    pub(crate) fn e_stop(&mut self) -> Result<(), RigError> {
        self.stop_now()?;
        self.hear_fault()
    }

    /// An emergency stop that is known to be one; what it latched is reported later.
    fn stop_now(&mut self) -> Result<(), RigError> {
        self.order("e-stop", Order::EStop)?;
        self.see("an emergency stop", |state| state == State::EStop)?;
        self.stopped = Some(Instant::now());
        Ok(())
    }

    /// The same, unless there has been one since this moment.
    pub(in crate::drive) fn stop_since(&mut self, asked: Instant) -> Result<(), RigError> {
        if self.stopped.is_some_and(|stopped| stopped >= asked) { Ok(()) } else { self.stop_now() }
    }

    /// Waits for what an emergency stop latched: it comes with the next heartbeat.
    pub(in crate::drive) fn hear_fault(&mut self) -> Result<(), RigError> {
        let is_latched = |view: &View| view.heartbeat.is_some_and(|heartbeat| !heartbeat.faults.is_empty());
        self.ask("a heartbeat with the fault", &[], is_latched).or_else(|error| match error {
            RigError::NoAnswer { .. } => Ok(()),
            other => Err(other),
        })
    }

    /// Clears every latched fault without a cause any more; an error names the first that stays.
    pub fn clear_faults(&mut self) -> Result<(), RigError> {
        let faults = self.view.heartbeat.map_or_else(Default::default, |heartbeat| heartbeat.faults);
        for fault in faults.iter() {
            let cleared = self.order("clear fault", Order::ClearFault { fault, key: CLEAR_KEY });
            cleared.map_err(|error| match error {
                RigError::Refused { code: AckCode::CauseRemains, .. } => {
                    RigError::CauseRemains { fault: fault.name(), axis: self.axis_of(fault) }
                }
                other => other,
            })?;
        }
        if faults.is_empty() {
            // what a servo on a bus latched before this program came is no fault here, and goes with any clearing
            self.order("clear fault", Order::ClearFault { fault: Fault::TorqueLost, key: 0 })?;
        }
        self.ask("a heartbeat without faults", &[], |view| {
            view.heartbeat.is_some_and(|heartbeat| heartbeat.faults.is_empty())
        })?;
        // who asks for the state next must not see the one from before
        self.see("a rig without faults", |state| !matches!(state, State::Fault | State::EStop))
    }

    /// Talks for a while: heartbeats out, positions in.
    pub fn idle(&mut self, time: Duration) -> Result<(), RigError> {
        let until_ns = self.link.now_ns() + time.as_nanos() as u64;
        while self.link.now_ns() < until_ns {
            self.pump(until_ns)?;
        }
        Ok(())
    }

    /// Refuses pitches that the configured limits, the firmware or the servo do not allow, each looked at by itself.
    pub(crate) fn check(&self, pitches_rad: &[f64]) -> Result<Vec<i32>, RigError> {
        if pitches_rad.len() != self.axis_count() {
            return Err(RigError::AxisCount { given: pitches_rad.len(), axes: self.axis_count() });
        }
        let mut targets = Vec::new();
        for (axis, pitch_rad) in pitches_rad.iter().enumerate() {
            if !pitch_rad.is_finite() || pitch_rad.abs() > 8.0 {
                return Err(RigError::NoAngle { axis, value_deg: pitch_rad.to_degrees() });
            }
            let urad = (pitch_rad * 1e6).round() as i32;
            let known =
                |minimum, maximum| Some((self.view.limit(axis, minimum)?, self.view.limit(axis, maximum)?));
            let configured = self.options.limits_rad.get(axis);
            let layers = [
                (
                    "the configured",
                    configured.map(|(low, high)| ((low * 1e6).ceil() as i32, (high * 1e6).floor() as i32)),
                ),
                ("the firmware's", known(Limit::Minimum, Limit::Maximum)),
                ("the servo's own", known(Limit::ServoMinimum, Limit::ServoMaximum)),
            ];
            for (limits_of, limits) in layers {
                let Some((low, high)) = limits else { continue };
                if !(low..=high).contains(&urad) {
                    return Err(RigError::OutsideLimits {
                        axis,
                        target_deg: pitch_rad.to_degrees(),
                        limits_of,
                        minimum_deg: deg(low),
                        maximum_deg: deg(high),
                    });
                }
            }
            targets.push(urad);
        }
        if let ([a, b], [from_a, from_b]) = (&targets[..], &self.view.axes[..]) {
            let from = [from_a, from_b].map(|axis| axis.position.map_or(0, |(urad, ..)| urad));
            if self.options.keep_out.crosses(from, [*a, *b], 0) {
                return Err(RigError::KeepOut { from_deg: from.map(deg), to_deg: [deg(*a), deg(*b)] });
            }
        }
        Ok(targets)
    }

    /// Moves every axis to its pitch, waits until they stand, and reads back where they are.
    pub fn apply(
        &mut self,
        pitches_rad: &[f64],
        mut progress: impl FnMut(&Progress),
    ) -> Result<Applied, RigError> {
        let targets = self.check(pitches_rad)?;
        self.refuse_when_interrupted()?;
        let approach = self.go_below(pitches_rad, &mut progress)?;
        self.go(&targets, &mut progress)?;
        self.view.from_below = approach == FROM_BELOW;
        self.read_back(&targets, approach)
    }

    /// Moves below the pitches where an axis would come from above; the side from which it then comes.
    fn go_below(
        &mut self,
        pitches_rad: &[f64],
        progress: &mut impl FnMut(&Progress),
    ) -> Result<&'static str, RigError> {
        let below: Vec<f64> =
            pitches_rad.iter().map(|pitch_rad| pitch_rad - self.options.approach_rad).collect();
        let at = |axis: usize| self.view.axes[axis].position.map_or(f64::INFINITY, |(urad, ..)| rad(urad));
        let tolerance_rad = self.options.tolerance_rad;
        if self.options.approach_rad == 0.0 {
            return Ok("either");
        }
        if below.iter().enumerate().all(|(axis, below_rad)| at(axis) <= below_rad + tolerance_rad) {
            return Ok(FROM_BELOW);
        }
        let moved = self.check(&below).and_then(|targets| self.go(&targets, progress));
        match moved {
            Ok(()) => Ok(FROM_BELOW),
            // no room below: straight there
            Err(
                RigError::OutsideLimits { .. }
                | RigError::KeepOut { .. }
                | RigError::Refused { code: AckCode::KeepOut | AckCode::Limit | AckCode::ServoLimit, .. },
            ) => Ok("either"),
            Err(error) => Err(error),
        }
    }

    /// Moves to angles, a pair together, and waits until all stand.
    fn go(&mut self, targets: &[i32], progress: &mut impl FnMut(&Progress)) -> Result<(), RigError> {
        self.view.from_below = false;
        if let [a_urad, b_urad] = *targets {
            let id = self.order("move", Order::MovePair { a_urad, b_urad })?;
            return self.wait_for("the move", id, progress);
        }
        for (axis, position_urad) in targets.iter().enumerate() {
            self.refuse_when_interrupted()?;
            let order = Order::MoveTo { axis: axis as u8, position_urad: *position_urad };
            let id = self.order("move", order)?;
            self.wait_for("the move", id, progress)?;
        }
        Ok(())
    }

    /// Angles read after the move ended, compared with the targets.
    fn read_back(&mut self, targets: &[i32], approach: &'static str) -> Result<Applied, RigError> {
        let settled_ns = self.link.now_ns();
        self.view.axes.iter_mut().for_each(|axis| axis.held.forget());
        self.ask("a position after the move", &[], |view| {
            view.axes.iter().all(|axis| axis.position.is_some_and(|(.., read_ns)| read_ns >= settled_ns))
        })?;
        // one reading says where it stands, several say how well
        let until_ns = settled_ns + HELD_WITHIN.as_nanos() as u64;
        while self.link.now_ns() < until_ns && self.view.axes.iter().any(|axis| axis.held.count() < HELD) {
            self.pump(until_ns)?;
        }
        let now_ns = self.link.now_ns();
        let mut axes = Vec::new();
        for (axis, target) in targets.iter().enumerate() {
            let view = &self.view.axes[axis];
            let Some((urad, source, read_ns)) = view.position else { continue };
            let measured_rad = view.held.mean_urad().map_or(rad(urad), |mean_urad| mean_urad * 1e-6);
            if (measured_rad - rad(*target)).abs() > self.options.tolerance_rad {
                let (measured_deg, target_deg) = (measured_rad.to_degrees(), deg(*target));
                return Err(RigError::NotReached { axis, measured_deg, target_deg });
            }
            axes.push(AppliedAxis {
                target_rad: rad(*target),
                measured_rad,
                source: source.name(),
                approach,
                age_s: now_ns.saturating_sub(read_ns) as f64 * 1e-9,
                uncertainty_rad: self.view.uncertainty_urad(axis, source).map(rad),
                scatter_rad: rad(view.held.scatter_urad()),
                readings: view.held.count(),
            });
        }
        Ok(Applied { axes })
    }

    /// Waits until the rig says that it is in such a state.
    fn see(&mut self, what: &'static str, wanted: fn(State) -> bool) -> Result<(), RigError> {
        let since_ns = self.link.now_ns();
        self.ask(what, &[], |view| {
            let seen = |target: TargetView| target.received_ns >= since_ns && wanted(target.state);
            view.axes.iter().all(|axis| axis.target.is_some_and(seen))
        })
    }

    /// Everything known about the rig now.
    pub fn status(&mut self) -> Result<RigStatus, RigError> {
        self.idle(Duration::from_millis(1))?;
        let now_ns = self.link.now_ns();
        let mut axes = Vec::new();
        for (axis, view) in self.view.axes.iter().enumerate() {
            let (Some((urad, source, read_ns)), Some(target)) = (view.position, view.target) else {
                continue;
            };
            let limit = |limit| deg(self.view.limit(axis, limit).unwrap_or(0));
            let source = View::source_now(source, read_ns, now_ns);
            axes.push(AxisStatus {
                axis,
                state: target.state.name().to_owned(),
                position_deg: deg(urad),
                target_deg: deg(target.target_urad),
                source: source.name().to_owned(),
                age_ms: now_ns.saturating_sub(read_ns) as f64 * 1e-6,
                uncertainty_deg: self.view.uncertainty_urad(axis, source).map(deg),
                homed: target.homed,
                limits_deg: [limit(Limit::Minimum), limit(Limit::Maximum)],
                current_ma: view.effort.map(|(current, ..)| current),
                supply_mv: view.effort.map(|(_, supply, _)| supply),
                temperature_c: view.effort.map(|(.., temperature)| temperature),
                faults: self.view.faults_of(axis),
                device_errors: self.link.device_errors(axis),
            });
        }
        let counters = self.link.counters();
        let version = self.view.firmware.unwrap_or(0);
        Ok(RigStatus {
            port: self.link.name().to_owned(),
            uid: format!("{:016x}", self.view.uid.unwrap_or(0)),
            firmware: format!("{}.{}.{}", version >> 16, version >> 8 & 0xFF, version & 0xFF),
            reset_cause: self.reset_cause().name().to_owned(),
            homing_moves: self.view.info.is_some_and(|info| info.homing_moves),
            armed: self.view.heartbeat.is_some_and(|heartbeat| heartbeat.armed),
            axes,
            frames: counters.frames,
            damaged: counters.checksum_errors
                + counters.malformed
                + counters.overlong
                + counters.other_version,
        })
    }

    fn reset_cause(&self) -> ResetCause {
        self.view.info.map_or(ResetCause::PowerOn, |info| info.reset)
    }
}
