//! Breaking the axes of a rig that simulates them, over its line. Rigs with real axes do not know this message.

use crate::payload::{DecodeError, Fields, Payload};
use crate::simulated::AxisFault;

/// The message's number, outside those of rigs.
const MESSAGE: u8 = 0x70;

/// What to break.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Inject {
    /// The axis.
    pub axis: u8,
    /// What is wrong with it from now on; `None` mends it.
    pub fault: Option<AxisFault>,
}

impl Inject {
    /// The bytes: axis, kind of fault, its value.
    pub fn encode(&self) -> Payload {
        let (kind, value) = match self.fault {
            None => (0, 0),
            Some(AxisFault::Stuck) => (1, 0),
            Some(AxisFault::Slow(percent)) => (2, percent.into()),
            Some(AxisFault::Backlash(play_urad)) => (3, play_urad),
            Some(AxisFault::EncoderJump(step_urad)) => (4, step_urad),
            Some(AxisFault::EncoderFreeze) => (5, 0),
            Some(AxisFault::EncoderInvalid) => (6, 0),
            Some(AxisFault::Overheat(rate)) => (7, rate.into()),
            Some(AxisFault::UnderVoltage(supply_mv)) => (8, supply_mv.into()),
            Some(AxisFault::TorqueLost) => (9, 0),
        };
        Payload::new(MESSAGE).with([self.axis, kind]).with(i32::to_le_bytes(value))
    }

    /// The message these bytes say.
    pub fn decode(message: u8, data: &[u8]) -> Result<Self, DecodeError> {
        if message != MESSAGE {
            return Err(DecodeError::UnknownMessage(message));
        }
        let mut fields = Fields::new(message, data, 6)?;
        let (axis, kind, value) = (fields.u8(), fields.u8(), fields.i32());
        let out_of_range = |_| DecodeError::Value { message, found: kind };
        let fault = match kind {
            0 => None,
            1 => Some(AxisFault::Stuck),
            2 => Some(AxisFault::Slow(value.try_into().map_err(out_of_range)?)),
            3 => Some(AxisFault::Backlash(value)),
            4 => Some(AxisFault::EncoderJump(value)),
            5 => Some(AxisFault::EncoderFreeze),
            6 => Some(AxisFault::EncoderInvalid),
            7 => Some(AxisFault::Overheat(value.try_into().map_err(out_of_range)?)),
            8 => Some(AxisFault::UnderVoltage(value.try_into().map_err(out_of_range)?)),
            9 => Some(AxisFault::TorqueLost),
            found => return Err(DecodeError::Value { message, found }),
        };
        Ok(Self { axis, fault })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn what_decodes_encodes_to_the_same(axis: u8, kind in 0u8..12, value in prop_oneof![any::<i32>(), 0..300i32]) {
            let plain = Payload::new(MESSAGE).with([axis, kind]).with(value.to_le_bytes());
            if let Ok(inject) = Inject::decode(MESSAGE, plain.bytes()) {
                prop_assert_eq!(Inject::decode(MESSAGE, inject.encode().bytes()), Ok(inject));
            } else {
                prop_assert!(kind > 9 || [2, 7, 8].contains(&kind));
            }
        }
    }

    #[test]
    fn other_messages_are_none_of_its() {
        assert_eq!(Inject::decode(0x12, &[0; 6]), Err(DecodeError::UnknownMessage(0x12)));
        assert!(matches!(Inject::decode(MESSAGE, &[0; 5]), Err(DecodeError::Length { found: 5, .. })));
    }
}
