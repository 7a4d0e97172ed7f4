//! What can be broken in a mock rig, and its names on the command line.

use std::str::FromStr;
use std::time::Duration;

use firmware_protocol::simulated::AxisFault;

/// A fault on demand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MockFault {
    /// Something in one axis.
    Axis(usize, AxisFault),
    /// Mends an axis.
    Repair(usize),
    /// The supply sags for a moment: the microcontroller restarts, the axes stand where they stood.
    Reboot,
    /// Every answer comes this much later, ms; 0 ends it.
    Late(u64),
    /// The rig answers with another node number, or with its own again.
    WrongId(bool),
    /// The cable is cut.
    HangUp,
    /// The local e-stop switch opens or closes.
    Switch {
        /// Whether it is closed.
        closed: bool,
    },
}

/// Names that [`MockFault::from_str`] knows.
pub const NAMES: &str = "stuck, slow, backlash, jump, freeze, invalid, overheat, under-volt, torque-lost, repair \
                         (each with [:AXIS][=VALUE]), reboot, late[=MS], wrong-id, hang-up, e-stop";

impl FromStr for MockFault {
    type Err = String;

    /// `NAME[:AXIS][=VALUE]`; angles in degrees, times in ms, heat in °C/s, supply in mV, speed in percent.
    fn from_str(text: &str) -> Result<Self, String> {
        let (head, value) = text.split_once('=').map_or((text, None), |(head, value)| (head, Some(value)));
        let (name, axis) = head.split_once(':').map_or((head, None), |(name, axis)| (name, Some(axis)));
        let axis = match axis {
            None => 0,
            Some(axis) => match axis.parse() {
                Ok(axis @ 0..=1) => axis,
                _ => return Err(format!("fault `{text}`: axis `{axis}` is neither 0 nor 1")),
            },
        };
        let number = |default: f64| match value {
            None => Ok(default),
            Some(value) => match value.parse::<f64>() {
                Ok(number) if number.is_finite() && number.abs() < 1e6 => Ok(number),
                _ => Err(format!("fault `{text}`: `{value}` is no number")),
            },
        };
        let urad = |default_deg: f64| number(default_deg).map(|deg| (deg.to_radians() * 1e6) as i32);
        let fault = match name {
            "stuck" => AxisFault::Stuck,
            "slow" => AxisFault::Slow(number(10.0)?.clamp(0.0, 100.0) as u8),
            "backlash" => AxisFault::Backlash(urad(3.0)?),
            "jump" => AxisFault::EncoderJump(urad(10.0)?),
            "freeze" => AxisFault::EncoderFreeze,
            "invalid" => AxisFault::EncoderInvalid,
            "overheat" => AxisFault::Overheat(number(30.0)?.clamp(-1000.0, 1000.0) as i16),
            "under-volt" => AxisFault::UnderVoltage(number(8000.0)?.clamp(0.0, 65_535.0) as u16),
            "torque-lost" => AxisFault::TorqueLost,
            "repair" => return Ok(Self::Repair(axis)),
            "reboot" => return Ok(Self::Reboot),
            "late" => return Ok(Self::Late(number(400.0)?.max(0.0) as u64)),
            "wrong-id" => return Ok(Self::WrongId(true)),
            "hang-up" => return Ok(Self::HangUp),
            "e-stop" => return Ok(Self::Switch { closed: false }),
            _ => return Err(format!("fault `{text}` is unknown; known are {NAMES}")),
        };
        Ok(Self::Axis(axis, fault))
    }
}

/// A fault after a time from the start.
#[derive(Clone, Debug)]
pub(crate) struct ScheduledFault {
    pub(crate) fault: MockFault,
    pub(crate) text: String,
    pub(crate) after: Duration,
}

impl FromStr for ScheduledFault {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (fault, seconds) =
            text.rsplit_once('@').ok_or_else(|| format!("`{text}` says no time: expected FAULT@SECONDS"))?;
        let after = seconds
            .parse::<f64>()
            .ok()
            .and_then(|seconds| Duration::try_from_secs_f64(seconds).ok())
            .ok_or_else(|| format!("`{seconds}` in `{text}` is no time in seconds"))?;
        Ok(Self { fault: fault.parse()?, text: fault.to_owned(), after })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_axes_and_values_are_read() {
        assert_eq!("stuck:1".parse(), Ok(MockFault::Axis(1, AxisFault::Stuck)));
        assert_eq!("jump=10".parse(), Ok(MockFault::Axis(0, AxisFault::EncoderJump(174_532))));
        assert_eq!("late=50".parse(), Ok(MockFault::Late(50)));
        for wrong in ["melt", "stuck:2", "slow=fast", "jump=nan"] {
            assert!(wrong.parse::<MockFault>().unwrap_err().contains(wrong));
        }
    }
}
