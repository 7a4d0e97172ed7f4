//! Orders and questions, repeated until they are answered; waiting; heartbeats out and reports in.

use std::time::Duration;

use firmware_protocol::{ALL_AXES, AckCode, Command, Fault, Frame, Order, State};

use super::{Progress, RigController, rad};
use crate::drive::view::{TargetView, View};
use crate::drive::{Link, RigError};

/// A rig brakes what moves when it hears none for 150 ms: six may be late or lost.
const HEARTBEAT_EVERY: Duration = Duration::from_millis(25);
const CLOCK_EVERY: Duration = Duration::from_millis(500);
/// This many heartbeats of another session in a row mean that the rig restarted; fewer may be late ones.
const OTHER_HEARTBEATS: u32 = 5;

/// After a hold order the rig has this long to stop.
const STANDS_WITHIN: Duration = Duration::from_secs(5);

impl<L: Link> RigController<L> {
    /// Sends an order until it is acknowledged; the order's number.
    pub(super) fn order(&mut self, what: &'static str, order: Order) -> Result<u16, RigError> {
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

    /// Sends questions again and again until their answer is in.
    pub(super) fn ask(
        &mut self,
        what: &'static str,
        questions: &[Command],
        mut is_answered: impl FnMut(&View) -> bool,
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
            let was_busy = self.link.is_busy();
            self.pump(if end_ns > now_ns { repeat_ns.min(end_ns) } else { repeat_ns })?;
            if is_answered(&self.view) {
                return Ok(());
            }
            if self.link.now_ns() >= end_ns && !was_busy && !self.link.is_busy() {
                let counters = self.link.counters();
                let other = self.view.other_node.map_or(String::new(), |(node, _)| {
                    format!("; node {node} sends, {} was asked for: --node {node}?", self.options.node)
                });
                let received = format!(
                    "received {} frames, {} of them for others; {} damaged since the start{other}",
                    counters.frames - frames_before,
                    self.view.not_understood,
                    counters.checksum_errors + counters.malformed + counters.overlong,
                );
                return Err(RigError::NoAnswer { what, within: self.options.answer_within, received });
            }
        }
    }

    /// Waits until the rig holds after the order with this number.
    pub(super) fn wait_for(
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
            self.apply_interrupt()?;
            if !self.fault_names().is_empty() {
                return Err(self.fault_error());
            }
            progress(&self.progress());
            let ended = |target: TargetView| {
                target.received_ns >= accepted_ns && target.id == id && target.state == State::Holding
            };
            if self.view.axes.iter().all(|axis| axis.target.is_some_and(ended)) {
                return Ok(());
            }
            if self.link.now_ns() >= end_ns {
                self.hold()?;
                self.stand()?;
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
    pub(in crate::drive) fn apply_interrupt(&mut self) -> Result<(), RigError> {
        let level = self.interrupt.level();
        let before = std::mem::replace(&mut self.handled_interrupts, level);
        if level <= before {
            return Ok(());
        }
        if level == 1 {
            self.hold()?;
            let stands = self.stand()?;
            let action =
                if stands { "the rig holds" } else { "the rig has the order to hold and still moves" };
            return Err(RigError::Interrupted { action });
        }
        self.stop_at_once()
    }

    fn stop_at_once(&mut self) -> Result<(), RigError> {
        self.handled_interrupts = self.interrupt.level();
        self.stop_now()?;
        Err(RigError::Interrupted { action: "emergency stop" })
    }

    /// Waits until the axes with a hold order stand: whoever leaves earlier cannot stop them any more. Whether they do.
    fn stand(&mut self) -> Result<bool, RigError> {
        let since_ns = self.link.now_ns();
        loop {
            let now_ns = self.link.now_ns();
            self.pump(now_ns + 20_000_000)?;
            if self.interrupt.level() > 1 && self.interrupt.level() > self.handled_interrupts {
                self.stop_at_once()?;
            }
            let stands = |target: TargetView| {
                target.received_ns >= since_ns && !matches!(target.state, State::Moving | State::Homing)
            };
            if self.view.axes.iter().all(|axis| axis.target.is_some_and(stands)) {
                return Ok(true);
            }
            if now_ns >= since_ns + STANDS_WITHIN.as_nanos() as u64 {
                return Ok(false);
            }
        }
    }

    /// What was stopped from outside does not begin again before [`Interrupt::reset`].
    pub(super) fn refuse_when_interrupted(&self) -> Result<(), RigError> {
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
        let axis = faults.iter().find(|fault| self.view.fault_axis[usize::from(fault.code())].is_some());
        RigError::Fault { faults: self.fault_names(), axis: axis.and_then(|fault| self.axis_of(fault)) }
    }

    /// The axis of a reported fault; none where it concerns them all.
    pub(super) fn axis_of(&self, fault: Fault) -> Option<usize> {
        let axis = self.view.fault_axis[usize::from(fault.code())];
        axis.filter(|axis| *axis != ALL_AXES).map(usize::from)
    }

    fn send(&mut self, command: &Command) -> Result<(), RigError> {
        let frame = Frame::command(self.sequence, self.options.node, command);
        self.sequence = self.sequence.wrapping_add(1);
        Ok(self.link.send(&frame)?)
    }

    /// One round: what is due goes out, at least one frame is waited for (not beyond `until_ns`), all that came is read.
    pub(super) fn pump(&mut self, until_ns: u64) -> Result<(), RigError> {
        let now_ns = self.link.now_ns();
        let session = self.options.session;
        if self.connected && now_ns >= self.next_heartbeat_ns {
            self.next_heartbeat_ns = now_ns + HEARTBEAT_EVERY.as_nanos() as u64;
            self.send(&Command::Heartbeat { session, time_ms: (now_ns / 1_000_000) as u32 })?;
        }
        if self.connected && now_ns >= self.next_clock_ns {
            let again = if self.view.has_clock() { CLOCK_EVERY } else { self.options.retry };
            self.next_clock_ns = now_ns + again.as_nanos() as u64;
            self.clock_sequence = self.clock_sequence.wrapping_add(1);
            self.view.ask_clock(self.clock_sequence, now_ns);
            self.send(&Command::TimeSync { sequence: self.clock_sequence })?;
        }
        let next_ns = if self.connected { until_ns.min(self.next_heartbeat_ns) } else { until_ns };
        // what ends a time of setting up comes before its end: asked for now, as an answer may lie between
        let was_busy = self.link.is_busy();
        let mut wait = Duration::from_nanos(next_ns.saturating_sub(now_ns)).max(Duration::from_micros(100));
        let every_ns = self.options.report_every.as_nanos() as u64;
        while let Some(received) = self.link.receive(wait)? {
            let report = self.view.hear(&received, self.options.node, session, every_ns);
            if let (Some(report), Some(sink)) = (report, &mut self.reports_to) {
                sink(report);
            }
            wait = Duration::ZERO;
        }
        if let (Some(first), Some(second)) = (self.view.uid, self.view.second_uid) {
            return Err(RigError::SameNode { node: self.options.node, uids: [first, second] });
        }
        if self.connected && self.view.other_heartbeats >= OTHER_HEARTBEATS && self.view.other_session != 0 {
            return Err(RigError::OtherHost);
        }
        if self.connected && self.view.other_heartbeats >= OTHER_HEARTBEATS {
            return Err(RigError::Restarted { cause: self.reset_cause() });
        }
        let silence_ns = self.link.now_ns().saturating_sub(self.view.received_ns);
        let within = self.options.link_timeout;
        // a rig without power behind a living adapter
        if self.connected && silence_ns > within.as_nanos() as u64 && !was_busy && !self.link.is_busy() {
            let received = match self.view.other_node {
                Some((other, received_ns)) if received_ns > self.view.received_ns => format!(
                    "node {} says nothing any more, node {other} does: another number was given to it, or to another rig",
                    self.options.node
                ),
                _ => "it says nothing at all: no power, another program's hands on it, or a mock on too busy a machine"
                    .to_owned(),
            };
            return Err(RigError::NoAnswer { what: "heartbeats", within, received });
        }
        Ok(())
    }
}
