//! Messages from the host to the device.

use crate::config::Limit;
use crate::fault::Fault;
use crate::payload::{DecodeError, Fields, Payload, i24_bytes};

/// The largest angle that `MovePair` carries in either direction, µrad: three bytes each, so the pair fits one CAN frame.
pub const PAIR_RANGE_URAD: i32 = (1 << 23) - 1;

/// The key that `ClearFault` must carry to leave an emergency stop: the ASCII text `FREE`.
pub const CLEAR_KEY: u32 = u32::from_le_bytes(*b"FREE");

/// A message from the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Opens a session; answered by `Info`. The same nonce again changes nothing.
    Hello {
        /// Oldest protocol version the host speaks.
        protocol_min: u8,
        /// Newest protocol version the host speaks.
        protocol_max: u8,
        /// How long the host's heartbeat may stay away while armed, ms.
        heartbeat_timeout_ms: u16,
        /// The host's name for this session.
        nonce: u32,
    },
    /// Feeds the watchdog of this session.
    Heartbeat {
        /// The session's nonce.
        session: u32,
        /// The host's clock, ms.
        time_ms: u32,
    },
    /// Asks for the device's clock.
    TimeSync {
        /// Comes back in the answer.
        sequence: u16,
    },
    /// Asks for a limit; answered by `Report::Limit`.
    GetLimit {
        /// The axis.
        axis: u8,
        /// Which limit.
        limit: Limit,
    },
    /// An order, acknowledged by its number. The same number again is acknowledged again and not done again.
    Order {
        /// The order's number; later orders of a session have later numbers (wrapping).
        id: u16,
        /// What to do.
        order: Order,
    },
}

/// What to do; every order is acknowledged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// Move one axis along a straight segment of the axes' plane.
    MoveTo {
        /// The axis.
        axis: u8,
        /// Where to, µrad.
        position_urad: i32,
    },
    /// Set the speed of later moves.
    Profile {
        /// The axis.
        axis: u8,
        /// Largest speed, mrad/s.
        speed_mrad_s: u16,
        /// Largest acceleration, mrad/s².
        acceleration_mrad_s2: u16,
    },
    /// Move axes 0 and 1 together along a straight segment of their plane.
    MovePair {
        /// Where axis 0 goes, µrad.
        a_urad: i32,
        /// Where axis 1 goes, µrad.
        b_urad: i32,
    },
    /// Decelerate by the profile and hold; stays armed.
    Hold,
    /// Decelerate, hold, disarm.
    Stop {
        /// Deceleration, mrad/s²; 0 means the profile's.
        deceleration_mrad_s2: u16,
    },
    /// Make the position of an axis ([`crate::ALL_AXES`] for all) trusted.
    Home {
        /// The axis.
        axis: u8,
    },
    /// Stop as fast as the rig can, hold, latch [`Fault::EStop`].
    EStop,
    /// Take a latched fault away, if its cause is gone.
    ClearFault {
        /// Which one.
        fault: Fault,
        /// [`CLEAR_KEY`] for [`Fault::EStop`]; not looked at for others.
        key: u32,
    },
    /// Change a limit; only while disarmed.
    SetLimit {
        /// The axis.
        axis: u8,
        /// Which limit.
        limit: Limit,
        /// Its value, in the limit's unit.
        value: i32,
    },
    /// Allow motion, or forbid it again.
    Arm {
        /// Whether motion is allowed.
        armed: bool,
    },
}

impl Order {
    /// Its message number.
    pub fn message(&self) -> u8 {
        match self {
            Self::MoveTo { .. } => 0x10,
            Self::Profile { .. } => 0x11,
            Self::MovePair { .. } => 0x12,
            Self::Hold => 0x13,
            Self::Stop { .. } => 0x14,
            Self::Home { .. } => 0x15,
            Self::EStop => 0x16,
            Self::ClearFault { .. } => 0x17,
            Self::SetLimit { .. } => 0x18,
            Self::Arm { .. } => 0x19,
        }
    }
}

impl Command {
    /// The bytes. Angles of `MovePair` beyond [`PAIR_RANGE_URAD`] are clamped to it, which every rig refuses as out of
    /// limits.
    pub fn encode(&self) -> Payload {
        match *self {
            Self::Hello { protocol_min, protocol_max, heartbeat_timeout_ms, nonce } => Payload::new(0x01)
                .with([protocol_min, protocol_max])
                .with(heartbeat_timeout_ms.to_le_bytes())
                .with(nonce.to_le_bytes()),
            Self::Heartbeat { session, time_ms } => {
                Payload::new(0x03).with(session.to_le_bytes()).with(time_ms.to_le_bytes())
            }
            Self::TimeSync { sequence } => Payload::new(0x05).with(sequence.to_le_bytes()),
            Self::GetLimit { axis, limit } => Payload::new(0x1A).with([axis, limit.code()]),
            Self::Order { id, order } => {
                let payload = Payload::new(order.message()).with(id.to_le_bytes());
                match order {
                    Order::MoveTo { axis, position_urad } => {
                        payload.with([axis, 0]).with(position_urad.to_le_bytes())
                    }
                    Order::Profile { axis, speed_mrad_s, acceleration_mrad_s2 } => payload
                        .with([axis, 0])
                        .with(speed_mrad_s.to_le_bytes())
                        .with(acceleration_mrad_s2.to_le_bytes()),
                    Order::MovePair { a_urad, b_urad } => payload
                        .with(i24_bytes(a_urad.clamp(-PAIR_RANGE_URAD, PAIR_RANGE_URAD)))
                        .with(i24_bytes(b_urad.clamp(-PAIR_RANGE_URAD, PAIR_RANGE_URAD))),
                    Order::Hold | Order::EStop => payload,
                    Order::Stop { deceleration_mrad_s2 } => payload.with(deceleration_mrad_s2.to_le_bytes()),
                    Order::Home { axis } => payload.with([axis]),
                    Order::ClearFault { fault, key } => {
                        payload.with([fault.code(), 0]).with(key.to_le_bytes())
                    }
                    Order::SetLimit { axis, limit, value } => {
                        payload.with([axis, limit.code()]).with(value.to_le_bytes())
                    }
                    Order::Arm { armed } => payload.with([u8::from(armed)]),
                }
            }
        }
    }

    /// The message these bytes say. Errors name the message and what was wrong with it.
    pub fn decode(message: u8, data: &[u8]) -> Result<Self, DecodeError> {
        let fields = |expected| Fields::new(message, data, expected);
        let (id, order) = match message {
            0x01 => {
                let mut f = fields(8)?;
                return Ok(Self::Hello {
                    protocol_min: f.u8(),
                    protocol_max: f.u8(),
                    heartbeat_timeout_ms: f.u16(),
                    nonce: f.u32(),
                });
            }
            0x03 => {
                let mut f = fields(8)?;
                return Ok(Self::Heartbeat { session: f.u32(), time_ms: f.u32() });
            }
            0x05 => return Ok(Self::TimeSync { sequence: fields(2)?.u16() }),
            0x1A => {
                let mut f = fields(2)?;
                return Ok(Self::GetLimit { axis: f.u8(), limit: f.known(Limit::from_code)? });
            }
            0x10 => {
                let mut f = fields(8)?;
                let (id, axis, _) = (f.u16(), f.u8(), f.u8());
                (id, Order::MoveTo { axis, position_urad: f.i32() })
            }
            0x11 => {
                let mut f = fields(8)?;
                let (id, axis, _) = (f.u16(), f.u8(), f.u8());
                (id, Order::Profile { axis, speed_mrad_s: f.u16(), acceleration_mrad_s2: f.u16() })
            }
            0x12 => {
                let mut f = fields(8)?;
                (f.u16(), Order::MovePair { a_urad: f.i24(), b_urad: f.i24() })
            }
            0x13 => (fields(2)?.u16(), Order::Hold),
            0x14 => {
                let mut f = fields(4)?;
                (f.u16(), Order::Stop { deceleration_mrad_s2: f.u16() })
            }
            0x15 => {
                let mut f = fields(3)?;
                (f.u16(), Order::Home { axis: f.u8() })
            }
            0x16 => (fields(2)?.u16(), Order::EStop),
            0x17 => {
                let mut f = fields(8)?;
                let id = f.u16();
                let fault = f.known(Fault::from_code)?;
                f.u8();
                (id, Order::ClearFault { fault, key: f.u32() })
            }
            0x18 => {
                let mut f = fields(8)?;
                let (id, axis) = (f.u16(), f.u8());
                (id, Order::SetLimit { axis, limit: f.known(Limit::from_code)?, value: f.i32() })
            }
            0x19 => {
                let mut f = fields(3)?;
                (f.u16(), Order::Arm { armed: f.known(crate::report::flag)? })
            }
            unknown => return Err(DecodeError::UnknownMessage(unknown)),
        };
        Ok(Self::Order { id, order })
    }
}
