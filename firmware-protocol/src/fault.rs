//! The faults a rig latches.

/// A latched fault; its number is its bit in [`Faults`] and its code on the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Fault {
    /// The host's heartbeat stayed away longer than agreed.
    Watchdog = 0,
    /// The axis is further from its set point than allowed.
    FollowingError = 1,
    /// The axis is away from its set point and does not move.
    Stall = 2,
    /// The motor current stayed above its limit.
    OverCurrent = 3,
    /// The servo is too hot.
    OverTemperature = 4,
    /// The supply is too low.
    UnderVoltage = 5,
    /// The encoder gives no valid reading.
    EncoderInvalid = 6,
    /// The encoder moved faster than the axis can.
    EncoderJump = 7,
    /// The axis was found outside its limits.
    SoftLimit = 8,
    /// The pair was found inside its keep-out region.
    KeepOut = 9,
    /// The servo dropped its torque by itself.
    TorqueLost = 10,
    /// Emergency stop, by message or by the local switch.
    EStop = 11,
}

impl Fault {
    /// Every fault, in the order of its bits.
    pub const ALL: [Self; 12] = [
        Self::Watchdog,
        Self::FollowingError,
        Self::Stall,
        Self::OverCurrent,
        Self::OverTemperature,
        Self::UnderVoltage,
        Self::EncoderInvalid,
        Self::EncoderJump,
        Self::SoftLimit,
        Self::KeepOut,
        Self::TorqueLost,
        Self::EStop,
    ];

    /// The fault with this code.
    pub(crate) fn from_code(code: u8) -> Option<Self> {
        Self::ALL.get(usize::from(code)).copied()
    }

    /// Its code on the wire.
    pub fn code(self) -> u8 {
        self as u8
    }

    /// Its name in files and on the screen.
    pub fn name(self) -> &'static str {
        match self {
            Self::Watchdog => "watchdog",
            Self::FollowingError => "following_error",
            Self::Stall => "stall",
            Self::OverCurrent => "over_current",
            Self::OverTemperature => "over_temperature",
            Self::UnderVoltage => "under_voltage",
            Self::EncoderInvalid => "encoder_invalid",
            Self::EncoderJump => "encoder_jump",
            Self::SoftLimit => "soft_limit",
            Self::KeepOut => "keep_out",
            Self::TorqueLost => "torque_lost",
            Self::EStop => "e_stop",
        }
    }
}

/// A set of faults, one bit each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Faults(pub u16);

impl Faults {
    /// Whether none is latched.
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Whether this one is latched.
    pub fn contains(self, fault: Fault) -> bool {
        self.0 & (1 << fault.code()) != 0
    }

    /// Latches one.
    pub fn insert(&mut self, fault: Fault) {
        self.0 |= 1 << fault.code();
    }

    /// Takes one away.
    pub fn remove(&mut self, fault: Fault) {
        self.0 &= !(1 << fault.code());
    }

    /// The latched ones.
    pub fn iter(self) -> impl Iterator<Item = Fault> {
        Fault::ALL.into_iter().filter(move |fault| self.contains(*fault))
    }
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use super::*;

    #[test]
    fn a_set_holds_what_was_latched_and_not_removed() {
        let mut faults = Faults::default();
        assert!(faults.is_empty());
        for fault in Fault::ALL {
            faults.insert(fault);
        }
        assert_eq!(faults, Faults(0x0FFF));
        faults.remove(Fault::Stall);
        faults.remove(Fault::EStop);
        faults.remove(Fault::EStop);
        assert_eq!(faults, Faults(0x07FB));
        let left: Vec<_> = Fault::ALL.into_iter().filter(|fault| faults.contains(*fault)).collect();
        assert!(left.len() == 10 && left.iter().copied().eq(faults.iter()) && !faults.is_empty());
    }

    /// Sessions and reports keep these names.
    #[test]
    fn names_are_those_in_files() {
        let names: Vec<_> = Fault::ALL.into_iter().map(Fault::name).collect();
        assert_eq!(
            names.join(" "),
            "watchdog following_error stall over_current over_temperature under_voltage encoder_invalid encoder_jump \
             soft_limit keep_out torque_lost e_stop"
        );
    }
}
