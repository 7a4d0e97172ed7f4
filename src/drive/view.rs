//! What the host knows about a rig from its messages.

use std::collections::VecDeque;

use firmware_protocol::{
    ALL_AXES, AckCode, Direction, Fault, Faults, Limit, Report, ResetCause, Source, State,
};

use super::Received;
use super::held::{Encoder, Held};
use crate::recording::ServoReport;

/// A reading older than this is shown as stale, ns.
const STALE_NS: u64 = 250_000_000;
/// Clock comparisons that are remembered; the quickest of them counts.
const CLOCK_SAMPLES: usize = 8;
/// Questions for the clock with an answer that may still come: seconds of them.
const ASKED_CLOCKS: usize = 16;

/// One axis, as last received.
#[derive(Clone, Debug, Default)]
pub(super) struct AxisView {
    /// Angle, how it is known, the earliest moment at which it may have been read.
    pub position: Option<(i32, Source, u64)>,
    /// Target, last order, what the rig does, whether homed.
    pub target: Option<TargetView>,
    pub effort: Option<(i16, u16, i8)>,
    pub limits: [Option<i32>; Limit::ALL.len()],
    /// Readings since it holds.
    pub held: Held,
    reported_ns: Option<u64>,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct TargetView {
    pub target_urad: i32,
    pub id: u16,
    pub state: State,
    pub homed: bool,
    pub received_ns: u64,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct InfoView {
    pub protocol: u8,
    pub axes: u8,
    pub reset: ResetCause,
    pub session: u32,
    /// Homing seeks a switch or a zero.
    pub homing_moves: bool,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct HeartbeatView {
    pub armed: bool,
    pub faults: Faults,
}

/// Everything received.
#[derive(Clone, Debug, Default)]
pub(super) struct View {
    pub info: Option<InfoView>,
    pub uid: Option<u64>,
    /// Another number than `uid` came from the same node.
    pub second_uid: Option<u64>,
    pub firmware: Option<u32>,
    pub heartbeat: Option<HeartbeatView>,
    /// Heartbeats of another session since the last one of ours; a few may be late ones from before.
    pub other_heartbeats: u32,
    /// The session of the last of them, 0 for none.
    pub other_session: u32,
    /// Time of the rig's last message.
    pub received_ns: u64,
    pub axes: Vec<AxisView>,
    /// The axes were brought where they stand from below.
    pub from_below: bool,
    pub ack: Option<(u16, u8, AckCode, i32)>,
    /// Axis of each latched fault, as reported.
    pub fault_axis: [Option<u8>; Fault::ALL.len()],
    asked_clocks: VecDeque<(u16, u64)>,
    /// Round trip, and device minus host at its middle, ns.
    clocks: VecDeque<(u64, i64)>,
    /// Messages that are none of this version's.
    pub not_understood: u32,
    /// Another node that sends, and when it last did.
    pub other_node: Option<(u8, u64)>,
}

impl View {
    /// Reads a message; a report line when it was a position that is due.
    pub(crate) fn hear(
        &mut self,
        received: &Received,
        node: u8,
        session: u32,
        every_ns: u64,
    ) -> Option<ServoReport> {
        let id = received.frame.id;
        if id.direction != Direction::ToHost || id.node != node {
            self.not_understood += 1;
            if id.direction == Direction::ToHost {
                self.other_node = Some((id.node, received.time_ns));
            }
            return None;
        }
        let Ok(report) = Report::decode(id.message, received.frame.data()) else {
            self.not_understood += 1;
            return None;
        };
        let now_ns = received.time_ns;
        self.received_ns = now_ns;
        match report {
            Report::Info { protocol, axes, reset, session, capabilities } => {
                let homing_moves = capabilities & 2 != 0;
                self.info = Some(InfoView { protocol, axes, reset, session, homing_moves });
            }
            Report::Identity { uid } if self.uid.is_some_and(|first| first != uid) => {
                self.second_uid = Some(uid);
            }
            Report::Identity { uid } => self.uid = Some(uid),
            Report::Build { firmware, .. } => self.firmware = Some(firmware),
            Report::Heartbeat { armed, faults, session: theirs, .. } => {
                if theirs == session {
                    self.other_heartbeats = 0;
                    self.heartbeat = Some(HeartbeatView { armed, faults });
                    for fault in Fault::ALL.into_iter().filter(|fault| !faults.contains(*fault)) {
                        self.fault_axis[usize::from(fault.code())] = None;
                    }
                } else if self.heartbeat.is_some() {
                    // before ours came, they are old messages: a line may hold seconds of them
                    self.other_heartbeats += 1;
                    self.other_session = theirs;
                }
            }
            Report::TimeSync { sequence, device_us } => self.compare_clocks(sequence, device_us, now_ns),
            Report::Ack { id, message, code, detail } => self.ack = Some((id, message, code, detail)),
            Report::Limit { axis, limit, value } => {
                if let Some(axis) = self.axes.get_mut(usize::from(axis)) {
                    axis.limits[usize::from(limit.code())] = Some(value);
                }
            }
            Report::Fault { fault, axis, .. } => self.fault_axis[usize::from(fault.code())] = Some(axis),
            Report::Effort { axis, temperature_c, current_ma, supply_mv, .. } => {
                if let Some(axis) = self.axes.get_mut(usize::from(axis)) {
                    axis.effort = Some((current_ma, supply_mv, temperature_c));
                }
            }
            Report::Target { axis, state, homed, id, target_urad } => {
                if let Some(axis) = self.axes.get_mut(usize::from(axis)) {
                    axis.target = Some(TargetView { target_urad, id, state, homed, received_ns: now_ns });
                }
            }
            Report::Position { axis, source, time_ms, position_urad } => {
                return self.hear_position(axis, source, time_ms, position_urad, now_ns, every_ns);
            }
            Report::Done { .. } => {} // the target's state says the same, and is repeated
        }
        None
    }

    fn hear_position(
        &mut self,
        axis: u8,
        source: Source,
        time_ms: u16,
        position_urad: i32,
        now_ns: u64,
        every_ns: u64,
    ) -> Option<ServoReport> {
        // before the first comparison its delay is not known
        let (read_ns, earliest_ns) = self.host_times_ns(time_ms, now_ns)?;
        let number = usize::from(axis);
        let source = self.source_of(source, number);
        let view = self.axes.get_mut(number)?;
        if view.position.is_some_and(|(_, _, before_ns)| earliest_ns < before_ns) {
            return None; // overtaken by a later one
        }
        view.position = Some((position_urad, source, earliest_ns));
        let target = view.target?;
        let holds = matches!(target.state, State::Holding | State::Idle);
        view.held.hear(holds, target.target_urad, position_urad);
        // half a period early is on time: readings come on their own beat
        let due = view.reported_ns.is_none_or(|last| read_ns + every_ns / 4 >= last + every_ns);
        if !due {
            return None;
        }
        view.reported_ns = Some(read_ns);
        Some(ServoReport {
            time_ns: read_ns,
            axis: number,
            position_urad,
            uncertainty_urad: self.uncertainty_urad(number, source),
            target_urad: target.target_urad,
            homed: Some(target.homed),
            source: source.name().to_owned(),
            state: target.state.name().to_owned(),
            faults: self.faults_of(number),
        })
    }

    /// How an angle is known. A rig with a switch to seek may have firmware that calls what it counts before that measured.
    fn source_of(&self, reported: Source, axis: usize) -> Source {
        let target = self.axes.get(axis).and_then(|view| view.target);
        let seeks = self.info.is_some_and(|info| info.homing_moves);
        match reported {
            Source::Measured if seeks && target.is_none_or(|target| !target.homed) => Source::NotHomed,
            reported => reported,
        }
    }

    /// A question for the rig's clock leaves.
    pub(crate) fn ask_clock(&mut self, sequence: u16, now_ns: u64) {
        if self.asked_clocks.len() == ASKED_CLOCKS {
            self.asked_clocks.pop_front();
        }
        self.asked_clocks.push_back((sequence, now_ns));
    }

    /// Whether the rig's clock was compared with the host's.
    pub(crate) fn has_clock(&self) -> bool {
        !self.clocks.is_empty()
    }

    fn compare_clocks(&mut self, sequence: u16, device_us: u64, now_ns: u64) {
        // an answer that is later than the next question is an answer
        let Some(place) = self.asked_clocks.iter().position(|(asked, _)| *asked == sequence) else { return };
        let Some((_, asked_ns)) = self.asked_clocks.remove(place) else { return };
        let round_trip_ns = now_ns.saturating_sub(asked_ns);
        let middle_ns = asked_ns + round_trip_ns / 2;
        if self.clocks.len() == CLOCK_SAMPLES {
            self.clocks.pop_front();
        }
        self.clocks.push_back((round_trip_ns, (device_us as i64 * 1000).wrapping_sub(middle_ns as i64)));
    }

    /// The host's time of a device stamp by the quickest clock comparison, and the earliest that it allows: half a round trip
    /// before. None before the first one.
    fn host_times_ns(&self, time_ms: u16, now_ns: u64) -> Option<(u64, u64)> {
        let (round_trip_ns, offset_ns) = self.clocks.iter().min()?;
        let device_ns = (now_ns as i64).wrapping_add(*offset_ns);
        let device_ms = device_ns.div_euclid(1_000_000);
        let ago_ms = i64::from((device_ms as u16).wrapping_sub(time_ms) as i16);
        let read_device_ns = (device_ms - ago_ms) * 1_000_000;
        let read_ns = (read_device_ns.wrapping_sub(*offset_ns) as u64).min(now_ns);
        Some((read_ns, read_ns.saturating_sub(round_trip_ns / 2)))
    }

    /// Names of latched faults of an axis; a fault without a reported axis belongs to all.
    pub(crate) fn faults_of(&self, axis: usize) -> Vec<String> {
        let faults = self.heartbeat.map_or(Faults::default(), |heartbeat| heartbeat.faults);
        faults
            .iter()
            .filter(|fault| match self.fault_axis[usize::from(fault.code())] {
                None | Some(ALL_AXES) => true,
                Some(reported) => usize::from(reported) == axis,
            })
            .map(|fault| fault.name().to_owned())
            .collect()
    }

    /// How an angle is known now: a measured one that has not come again is stale.
    pub(crate) fn source_now(source: Source, read_ns: u64, now_ns: u64) -> Source {
        if source == Source::Measured && now_ns.saturating_sub(read_ns) > STALE_NS {
            Source::Stale
        } else {
            source
        }
    }

    /// Half the width in which the true angle lies around the readings, µrad; none where it is not measured.
    pub(crate) fn uncertainty_urad(&self, axis: usize, source: Source) -> Option<i32> {
        let view = self.axes.get(axis).filter(|_| source == Source::Measured)?;
        let known = |limit| self.limit(axis, limit).unwrap_or(0);
        let encoder = Encoder {
            accuracy_urad: known(Limit::Accuracy),
            resolution_urad: known(Limit::Resolution),
            lost_motion_urad: known(Limit::LostMotion),
        };
        Some(view.held.uncertainty_urad(encoder, self.from_below))
    }

    pub(crate) fn limit(&self, axis: usize, limit: Limit) -> Option<i32> {
        self.axes.get(axis)?.limits[usize::from(limit.code())]
    }
}
