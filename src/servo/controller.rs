//! The host's side of the conversation with a rig: connect, home, arm, move, wait, read back, hold.

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use firmware_protocol::command::CLEAR_KEY;
use firmware_protocol::{
    ALL_AXES, AckCode, Command, Fault, Frame, KeepOut, Limit, Order, PROTOCOL_VERSION, ResetCause, State,
};

use super::view::View;
use super::{AxisStatus, Link, RigError, RigStatus, ServoReport};

const HEARTBEAT_EVERY: Duration = Duration::from_millis(80);
const CLOCK_EVERY: Duration = Duration::from_millis(500);
/// This many heartbeats of another session in a row mean that the rig restarted; fewer may be late ones.
const STRANGERS: u32 = 5;
/// A rig says something every 20 ms; this much silence is a rig without power behind a living adapter.
const SILENCE: Duration = Duration::from_secs(1);

/// How to talk to a rig.
#[derive(Clone, Debug)]
pub struct Options {
    /// Name of the session; another one each time. Not zero.
    pub session: u32,
    /// The rig's node number.
    pub node: u8,
    /// How long the rig may miss the host before it stops and holds.
    pub heartbeat_timeout: Duration,
    /// Time between repeats of an order that is not acknowledged.
    pub retry: Duration,
    /// How long an answer may take, repeats included.
    pub answer_within: Duration,
    /// How long homing or one move may take.
    pub settle_within: Duration,
    /// Distance from the target that counts as there, rad.
    pub tolerance_rad: f64,
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
            retry: Duration::from_millis(120),
            answer_within: Duration::from_millis(1500),
            settle_within: Duration::from_secs(20),
            tolerance_rad: 0.3f64.to_radians(),
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
    pub fn level(&self) -> u8 {
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
    /// Where it was told to be, rad.
    pub target_rad: f64,
    /// Where it is, rad.
    pub measured_rad: f64,
    /// How that is known: `measured` or `commanded`.
    pub source: &'static str,
    /// How old the reading is, s.
    pub age_s: f64,
    /// Half the width in which the true angle lies around the reading, rad.
    pub uncertainty_rad: f64,
}

/// The axes after a move.
#[derive(Clone, Debug, PartialEq)]
pub struct Applied {
    /// One per axis.
    pub axes: Vec<AppliedAxis>,
}

/// The conversation with one rig over one line.
pub struct RigController<L> {
    pub(super) link: L,
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
    reports_to: Option<ReportSink>,
}

/// Takes every report as it comes.
pub type ReportSink = Box<dyn FnMut(ServoReport) + Send>;

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
    pub fn axis_count(&self) -> usize {
        self.view.axes.len()
    }

    /// The line.
    pub fn link(&self) -> &L {
        &self.link
    }

    /// A handle that stops what is under way.
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
    pub fn disarm(&mut self) -> Result<(), RigError> {
        self.order("disarm", Order::Arm { armed: false }).map(drop)
    }

    /// Makes the positions of all axes trusted.
    pub fn home(&mut self) -> Result<(), RigError> {
        self.refuse_when_interrupted()?;
        let id = self.order("home", Order::Home { axis: ALL_AXES })?;
        self.wait_for("homing", id, &mut |_| {})
    }

    /// Decelerates and holds; stays armed.
    pub fn hold(&mut self) -> Result<(), RigError> {
        self.order("hold", Order::Hold).map(drop)
    }

    /// Decelerates, holds, disarms.
    pub fn stop(&mut self) -> Result<(), RigError> {
        self.order("stop", Order::Stop { deceleration_mrad_s2: 0 })?;
        self.see("a standing rig", |state| !matches!(state, State::Moving | State::Homing | State::Holding))
    }

    /// Stops as fast as the rig can and latches that.
    pub fn e_stop(&mut self) -> Result<(), RigError> {
        self.order("e-stop", Order::EStop)?;
        self.see("an emergency stop", |state| state == State::EStop)
    }

    /// Takes every latched fault away whose cause is gone; an error names the first that stays.
    pub fn clear_faults(&mut self) -> Result<(), RigError> {
        let faults = self.view.heartbeat.map_or_else(Default::default, |heartbeat| heartbeat.faults);
        for fault in faults.iter() {
            self.order("clear fault", Order::ClearFault { fault, key: CLEAR_KEY })?;
        }
        self.ask("a heartbeat without faults", &[], |view| {
            view.heartbeat.is_some_and(|heartbeat| heartbeat.faults.is_empty())
        })
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
    pub fn check(&self, pitches_rad: &[f64]) -> Result<Vec<i32>, RigError> {
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
            for (whose, limits) in layers {
                let Some((low, high)) = limits else { continue };
                if !(low..=high).contains(&urad) {
                    return Err(RigError::OutsideLimits {
                        axis,
                        target_deg: pitch_rad.to_degrees(),
                        whose,
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
        if let [a_urad, b_urad] = targets[..] {
            let id = self.order("move", Order::MovePair { a_urad, b_urad })?;
            self.wait_for("the move", id, &mut progress)?;
        } else {
            for (axis, position_urad) in targets.iter().enumerate() {
                self.refuse_when_interrupted()?;
                let order = Order::MoveTo { axis: axis as u8, position_urad: *position_urad };
                let id = self.order("move", order)?;
                self.wait_for("the move", id, &mut progress)?;
            }
        }
        self.read_back(&targets)
    }

    /// Angles read after the move ended, compared with the targets.
    fn read_back(&mut self, targets: &[i32]) -> Result<Applied, RigError> {
        let settled_ns = self.link.now_ns();
        self.ask("a position after the move", &[], |view| {
            view.axes.iter().all(|axis| axis.position.is_some_and(|(.., read_ns)| read_ns >= settled_ns))
        })?;
        let now_ns = self.link.now_ns();
        let mut axes = Vec::new();
        for (axis, target) in targets.iter().enumerate() {
            let Some((urad, source, read_ns)) = self.view.axes[axis].position else { continue };
            if rad(urad.saturating_sub(*target)).abs() > self.options.tolerance_rad {
                return Err(RigError::NotReached { axis, measured_deg: deg(urad), target_deg: deg(*target) });
            }
            axes.push(AppliedAxis {
                target_rad: rad(*target),
                measured_rad: rad(urad),
                source: source.name(),
                age_s: now_ns.saturating_sub(read_ns) as f64 * 1e-9,
                uncertainty_rad: rad(self.view.limit(axis, Limit::Uncertainty).unwrap_or(0)),
            });
        }
        Ok(Applied { axes })
    }

    /// Waits until the rig says that it is in such a state.
    fn see(&mut self, what: &'static str, wanted: fn(State) -> bool) -> Result<(), RigError> {
        let since_ns = self.link.now_ns();
        self.ask(what, &[], |view| {
            let seen = |target: super::view::TargetView| target.heard_ns >= since_ns && wanted(target.state);
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
            axes.push(AxisStatus {
                axis,
                state: target.state.name().to_owned(),
                position_deg: deg(urad),
                target_deg: deg(target.target_urad),
                source: View::source_now(source, read_ns, now_ns).name().to_owned(),
                age_ms: now_ns.saturating_sub(read_ns) as f64 * 1e-6,
                uncertainty_deg: limit(Limit::Uncertainty),
                homed: target.homed,
                limits_deg: [limit(Limit::Minimum), limit(Limit::Maximum)],
                current_ma: view.effort.map(|(current, ..)| current),
                supply_mv: view.effort.map(|(_, supply, _)| supply),
                temperature_c: view.effort.map(|(.., temperature)| temperature),
                faults: self.view.faults_of(axis),
            });
        }
        let counters = self.link.counters();
        let version = self.view.firmware.unwrap_or(0);
        Ok(RigStatus {
            port: self.link.name().to_owned(),
            uid: format!("{:016x}", self.view.uid.unwrap_or(0)),
            firmware: format!("{}.{}.{}", version >> 16, version >> 8 & 0xFF, version & 0xFF),
            reset_cause: self.reset_cause().name().to_owned(),
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

    /// Sends an order until it is acknowledged; the order's number.
    fn order(&mut self, what: &'static str, order: Order) -> Result<u16, RigError> {
        self.next_id = self.next_id.wrapping_add(1);
        let (id, message) = (self.next_id, order.message());
        self.view.ack = None;
        let mut answer = None;
        self.ask(what, &[Command::Order { id, order }], |view| {
            if let Some((theirs, their_message, code, detail)) = view.ack
                && (theirs, their_message) == (id, message)
            {
                answer = Some((code, detail));
            }
            answer.is_some()
        })?;
        match answer {
            Some((AckCode::Accepted, _)) | None => Ok(id),
            Some((AckCode::Fault, _)) if !self.fault_names().is_empty() => Err(self.fault_error()),
            Some((code, detail)) => {
                let axis = matches!(code, AckCode::Limit | AckCode::ServoLimit | AckCode::NotHomed)
                    .then_some(detail.max(0) as usize);
                Err(RigError::Refused { what, code, axis })
            }
        }
    }

    /// Sends questions again and again until what they ask for was heard.
    fn ask(
        &mut self,
        what: &'static str,
        questions: &[Command],
        mut heard: impl FnMut(&View) -> bool,
    ) -> Result<(), RigError> {
        let start_ns = self.link.now_ns();
        let end_ns = start_ns + self.options.answer_within.as_nanos() as u64;
        let frames_before = self.link.counters().frames;
        let mut repeat_ns = start_ns;
        loop {
            let now_ns = self.link.now_ns();
            if now_ns >= repeat_ns {
                for question in questions {
                    self.send(question)?;
                }
                repeat_ns = now_ns + self.options.retry.as_nanos() as u64;
            }
            self.pump(repeat_ns.min(end_ns))?;
            if heard(&self.view) {
                return Ok(());
            }
            if self.link.now_ns() >= end_ns {
                let counters = self.link.counters();
                let heard = format!(
                    "heard {} frames, {} of them for others; {} damaged since the start",
                    counters.frames - frames_before,
                    self.view.not_understood,
                    counters.checksum_errors + counters.malformed + counters.overlong,
                );
                return Err(RigError::NoAnswer { what, within: self.options.answer_within, heard });
            }
        }
    }

    /// Waits until the rig holds after the order with this number.
    fn wait_for(
        &mut self,
        what: &'static str,
        id: u16,
        progress: &mut impl FnMut(&Progress),
    ) -> Result<(), RigError> {
        let accepted_ns = self.link.now_ns();
        let end_ns = accepted_ns + self.options.settle_within.as_nanos() as u64;
        loop {
            let now_ns = self.link.now_ns();
            self.pump(now_ns + 20_000_000)?;
            self.obey_interrupt()?;
            if !self.fault_names().is_empty() {
                return Err(self.fault_error());
            }
            progress(&self.progress());
            let ended = |target: super::view::TargetView| {
                target.heard_ns >= accepted_ns && target.id == id && target.state == State::Holding
            };
            if self.view.axes.iter().all(|axis| axis.target.is_some_and(ended)) {
                return Ok(());
            }
            if self.link.now_ns() >= end_ns {
                self.hold()?;
                return Err(RigError::Late { what, within: self.options.settle_within });
            }
        }
    }

    fn progress(&self) -> Progress {
        let axes = &self.view.axes;
        Progress {
            measured_rad: axes
                .iter()
                .map(|axis| axis.position.map_or(f64::NAN, |(urad, ..)| rad(urad)))
                .collect(),
            target_rad: axes
                .iter()
                .map(|axis| axis.target.map_or(f64::NAN, |target| rad(target.target_urad)))
                .collect(),
        }
    }

    /// Does what an interrupt asks for: hold, then e-stop.
    pub(super) fn obey_interrupt(&mut self) -> Result<(), RigError> {
        let level = self.interrupt.level();
        let before = std::mem::replace(&mut self.handled_interrupts, level);
        if level <= before {
            return Ok(());
        }
        if level == 1 {
            self.hold()?;
            return Err(RigError::Interrupted { action: "the rig holds" });
        }
        self.e_stop()?;
        Err(RigError::Interrupted { action: "emergency stop" })
    }

    /// What was stopped from outside does not begin again before [`Interrupt::reset`].
    fn refuse_when_interrupted(&self) -> Result<(), RigError> {
        match self.interrupt.level() {
            0 => Ok(()),
            _ => Err(RigError::Interrupted { action: "nothing more was moved" }),
        }
    }

    fn fault_names(&self) -> Vec<String> {
        let faults = self.view.heartbeat.map_or_else(Default::default, |heartbeat| heartbeat.faults);
        faults.iter().map(|fault| fault.name().to_owned()).collect()
    }

    fn fault_error(&self) -> RigError {
        let faults = self.view.heartbeat.map_or_else(Default::default, |heartbeat| heartbeat.faults);
        let axis = |fault: Fault| self.view.fault_axis[usize::from(fault.code())];
        let axis = faults.iter().find_map(axis).filter(|axis| *axis != ALL_AXES).map(usize::from);
        RigError::Fault { faults: self.fault_names(), axis }
    }

    fn send(&mut self, command: &Command) -> Result<(), RigError> {
        let frame = Frame::command(self.sequence, self.options.node, command);
        self.sequence = self.sequence.wrapping_add(1);
        Ok(self.link.send(&frame)?)
    }

    /// One round: what is due goes out, at least one frame is waited for (not beyond `until_ns`), all that came is heard.
    fn pump(&mut self, until_ns: u64) -> Result<(), RigError> {
        let now_ns = self.link.now_ns();
        let session = self.options.session;
        if self.connected && now_ns >= self.next_heartbeat_ns {
            self.next_heartbeat_ns = now_ns + HEARTBEAT_EVERY.as_nanos() as u64;
            self.send(&Command::Heartbeat { session, time_ms: (now_ns / 1_000_000) as u32 })?;
        }
        if self.connected && now_ns >= self.next_clock_ns {
            self.next_clock_ns = now_ns + CLOCK_EVERY.as_nanos() as u64;
            self.clock_sequence = self.clock_sequence.wrapping_add(1);
            self.view.asked_clock = Some((self.clock_sequence, now_ns));
            self.send(&Command::TimeSync { sequence: self.clock_sequence })?;
        }
        let next_ns = if self.connected { until_ns.min(self.next_heartbeat_ns) } else { until_ns };
        let mut wait = Duration::from_nanos(next_ns.saturating_sub(now_ns)).max(Duration::from_micros(100));
        let every_ns = self.options.report_every.as_nanos() as u64;
        while let Some(received) = self.link.receive(wait)? {
            let report = self.view.hear(&received, self.options.node, session, every_ns);
            if let (Some(report), Some(sink)) = (report, &mut self.reports_to) {
                sink(report);
            }
            wait = Duration::ZERO;
        }
        if self.connected && self.view.strangers >= STRANGERS {
            return Err(RigError::Restarted { cause: self.reset_cause() });
        }
        let silence_ns = self.link.now_ns().saturating_sub(self.view.heard_ns);
        if self.connected && silence_ns > SILENCE.as_nanos() as u64 {
            let heard = "it says nothing at all: no power, or another program's hands on it".to_owned();
            return Err(RigError::NoAnswer { what: "heartbeats", within: SILENCE, heard });
        }
        Ok(())
    }
}
