//! Messages from the device to the host.

use crate::coded::coded;
use crate::config::Limit;
use crate::fault::{Fault, Faults};
use crate::payload::{DecodeError, Fields, Payload, u48_bytes};

coded! {
    /// What the rig is doing.
    State {
        /// Powered up, the first readings have not come yet.
        Boot = 0 "boot",
        /// Disarmed: nothing moves.
        Idle = 1 "idle",
        /// Making positions trusted.
        Homing = 2 "homing",
        /// Moving to a target.
        Moving = 3 "moving",
        /// Armed and standing.
        Holding = 4 "holding",
        /// A fault is latched: decelerated, held, motion refused.
        Fault = 5 "fault",
        /// Emergency stop is latched.
        EStop = 6 "e_stop",
    }
}

coded! {
    /// Why the device started.
    ResetCause {
        /// Power was switched on.
        PowerOn = 0 "power_on",
        /// The supply sagged: positions are not to be trusted.
        BrownOut = 1 "brown_out",
        /// The device's own watchdog.
        Watchdog = 2 "watchdog",
        /// Restarted by software.
        Software = 3 "software",
    }
}

coded! {
    /// Where a position comes from.
    Source {
        /// Read from an encoder.
        Measured = 0 "measured",
        /// Only commanded: this servo measures nothing.
        Commanded = 1 "commanded",
        /// Measured, but not of late.
        Stale = 2 "stale",
        /// Read from an encoder without a known zero: it counts from where it was switched on, or was caught lying.
        NotHomed = 3 "not_homed",
    }
}

coded! {
    /// What became of an order.
    AckCode {
        /// Accepted.
        Accepted = 0 "accepted",
        /// Refused: something else is in progress.
        Busy = 1 "busy",
        /// Refused: a fault is latched.
        Fault = 2 "fault",
        /// Refused: outside the firmware's limits.
        Limit = 3 "limit",
        /// Refused: outside the servo's own limits.
        ServoLimit = 4 "servo_limit",
        /// Refused: the path leads through the keep-out region.
        KeepOut = 5 "keep_out",
        /// Refused: positions are not trusted yet.
        NotHomed = 6 "not_homed",
        /// Refused: not armed.
        NotArmed = 7 "not_armed",
        /// Refused: no session with an agreed version.
        NoSession = 8 "no_session",
        /// Refused: an argument means nothing here.
        BadArgument = 9 "bad_argument",
        /// Refused: the fault's cause is still there.
        CauseRemains = 10 "cause_remains",
        /// Refused: wrong key, or the local switch is open.
        Locked = 11 "locked",
        /// Refused: a later order came before.
        Outdated = 12 "outdated",
    }
}

/// A message from the device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Report {
    /// Answer to `Hello`, and unasked after a start.
    Info {
        /// Protocol version the device speaks.
        protocol: u8,
        /// How many axes it has.
        axes: u8,
        /// Bit 0: positions are measured.
        capabilities: u8,
        /// Why it started.
        reset: ResetCause,
        /// The session's nonce, 0 without a session.
        session: u32,
    },
    /// The device's unique number.
    Identity {
        /// 64 bits set by the maker.
        uid: u64,
    },
    /// What runs on it.
    Build {
        /// Version: major << 16 | minor << 8 | patch.
        firmware: u32,
        /// First 32 bits of the revision it was built from.
        revision: u32,
    },
    /// State, several times a second.
    Heartbeat {
        /// What it is doing.
        state: State,
        /// Motion is allowed.
        armed: bool,
        /// Every axis is homed.
        homed: bool,
        /// Latched faults.
        faults: Faults,
        /// The session's nonce, 0 without a session.
        session: u32,
    },
    /// Answer to `TimeSync`, stamped in the step that took the question.
    TimeSync {
        /// From the question.
        sequence: u16,
        /// The device's clock, µs, 48 bits.
        device_us: u64,
    },
    /// What became of an order.
    Ack {
        /// The order's number.
        id: u16,
        /// The order's message number.
        message: u8,
        /// What became of it.
        code: AckCode,
        /// The axis concerned, or 0.
        detail: i32,
    },
    /// A limit, when asked or set.
    Limit {
        /// The axis.
        axis: u8,
        /// Which limit.
        limit: Limit,
        /// Its value, in the limit's unit.
        value: i32,
    },
    /// Where an axis is.
    Position {
        /// The axis.
        axis: u8,
        /// How that is known.
        source: Source,
        /// The device's clock when it was read, ms, low 16 bits.
        time_ms: u16,
        /// The angle, µrad.
        position_urad: i32,
    },
    /// What an axis draws.
    Effort {
        /// The axis.
        axis: u8,
        /// Temperature, °C.
        temperature_c: i8,
        /// Current, mA.
        current_ma: i16,
        /// Supply, mV.
        supply_mv: u16,
        /// Speed, mrad/s.
        speed_mrad_s: i16,
    },
    /// A latched fault, repeated until it is cleared.
    Fault {
        /// Which.
        fault: Fault,
        /// The axis concerned, [`crate::ALL_AXES`] for none.
        axis: u8,
        /// The device's clock when it was latched, ms, low 16 bits.
        time_ms: u16,
        /// The value that broke the rule, in the rule's unit.
        detail: i32,
    },
    /// A move or homing ended.
    Done {
        /// The order's number.
        id: u16,
        /// The axis concerned, [`crate::ALL_AXES`] for all.
        axis: u8,
        /// Largest distance from the target, µrad.
        error_urad: i32,
    },
    /// Setpoint of an axis, and by which order.
    Target {
        /// The axis.
        axis: u8,
        /// What the rig is doing.
        state: State,
        /// Whether this axis is homed.
        homed: bool,
        /// Number of the last move or homing that was accepted.
        id: u16,
        /// The target, µrad.
        target_urad: i32,
    },
}

/// A byte that is a truth value.
pub(crate) fn flag(code: u8) -> Option<bool> {
    match code {
        0 => Some(false),
        1 => Some(true),
        _ => None,
    }
}

const HOMED: u8 = 0x80;

impl Report {
    /// The bytes.
    pub fn encode(&self) -> Payload {
        match *self {
            Self::Info { protocol, axes, capabilities, reset, session } => Payload::new(0x02)
                .with([protocol, axes, capabilities, reset.code()])
                .with(session.to_le_bytes()),
            Self::Heartbeat { state, armed, homed, faults, session } => Payload::new(0x04)
                .with([state.code(), u8::from(armed) | u8::from(homed) << 1])
                .with(faults.0.to_le_bytes())
                .with(session.to_le_bytes()),
            Self::TimeSync { sequence, device_us } => {
                Payload::new(0x05).with(sequence.to_le_bytes()).with(u48_bytes(device_us))
            }
            Self::Identity { uid } => Payload::new(0x06).with(uid.to_le_bytes()),
            Self::Build { firmware, revision } => {
                Payload::new(0x07).with(firmware.to_le_bytes()).with(revision.to_le_bytes())
            }
            Self::Ack { id, message, code, detail } => Payload::new(0x20)
                .with(id.to_le_bytes())
                .with([message, code.code()])
                .with(detail.to_le_bytes()),
            Self::Limit { axis, limit, value } => {
                Payload::new(0x21).with([axis, limit.code()]).with(value.to_le_bytes())
            }
            Self::Position { axis, source, time_ms, position_urad } => Payload::new(0x30)
                .with([axis, source.code()])
                .with(time_ms.to_le_bytes())
                .with(position_urad.to_le_bytes()),
            Self::Effort { axis, temperature_c, current_ma, supply_mv, speed_mrad_s } => Payload::new(0x31)
                .with([axis])
                .with(temperature_c.to_le_bytes())
                .with(current_ma.to_le_bytes())
                .with(supply_mv.to_le_bytes())
                .with(speed_mrad_s.to_le_bytes()),
            Self::Fault { fault, axis, time_ms, detail } => Payload::new(0x32)
                .with([fault.code(), axis])
                .with(time_ms.to_le_bytes())
                .with(detail.to_le_bytes()),
            Self::Done { id, axis, error_urad } => {
                Payload::new(0x33).with(id.to_le_bytes()).with([axis, 0]).with(error_urad.to_le_bytes())
            }
            Self::Target { axis, state, homed, id, target_urad } => Payload::new(0x34)
                .with([axis, state.code() | if homed { HOMED } else { 0 }])
                .with(id.to_le_bytes())
                .with(target_urad.to_le_bytes()),
        }
    }

    /// The message these bytes say. Errors name the message and what was wrong with it.
    pub fn decode(message: u8, data: &[u8]) -> Result<Self, DecodeError> {
        let expected = match message {
            0x21 => 6,
            0x02 | 0x04..=0x07 | 0x20 | 0x30..=0x34 => 8,
            unknown => return Err(DecodeError::UnknownMessage(unknown)),
        };
        let mut f = Fields::new(message, data, expected)?;
        Ok(match message {
            0x02 => Self::Info {
                protocol: f.u8(),
                axes: f.u8(),
                capabilities: f.u8(),
                reset: f.known(ResetCause::from_code)?,
                session: f.u32(),
            },
            0x04 => {
                let state = f.known(State::from_code)?;
                let flags = f.known(|flags| (flags < 4).then_some(flags))?;
                let (armed, homed) = (flags & 1 != 0, flags & 2 != 0);
                Self::Heartbeat { state, armed, homed, faults: Faults(f.u16()), session: f.u32() }
            }
            0x05 => Self::TimeSync { sequence: f.u16(), device_us: f.u48() },
            0x06 => Self::Identity { uid: f.u64() },
            0x07 => Self::Build { firmware: f.u32(), revision: f.u32() },
            0x20 => Self::Ack {
                id: f.u16(),
                message: f.u8(),
                code: f.known(AckCode::from_code)?,
                detail: f.i32(),
            },
            0x21 => Self::Limit { axis: f.u8(), limit: f.known(Limit::from_code)?, value: f.i32() },
            0x30 => Self::Position {
                axis: f.u8(),
                source: f.known(Source::from_code)?,
                time_ms: f.u16(),
                position_urad: f.i32(),
            },
            0x31 => Self::Effort {
                axis: f.u8(),
                temperature_c: f.i8(),
                current_ma: f.i16(),
                supply_mv: f.u16(),
                speed_mrad_s: f.i16(),
            },
            0x32 => Self::Fault {
                fault: f.known(Fault::from_code)?,
                axis: f.u8(),
                time_ms: f.u16(),
                detail: f.i32(),
            },
            0x33 => {
                let (id, axis, _) = (f.u16(), f.u8(), f.u8());
                Self::Done { id, axis, error_urad: f.i32() }
            }
            _ => {
                let axis = f.u8();
                let (state, homed) =
                    f.known(|code| State::from_code(code & !HOMED).map(|state| (state, code & HOMED != 0)))?;
                Self::Target { axis, state, homed, id: f.u16(), target_urad: f.i32() }
            }
        })
    }
}
