//! What the state machine needs from an actuator.

/// What an actuator says about its angle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reading {
    /// Read from an encoder just now, µrad.
    Measured(i32),
    /// This actuator measures nothing.
    Unmeasured,
    /// The encoder has not answered since the last step.
    Missing,
    /// The encoder answers that it has no valid angle.
    Invalid,
}

/// What an actuator says about itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sense {
    /// Its angle.
    pub reading: Reading,
    /// Whether it drives its shaft.
    pub torque: bool,
    /// Motor current, mA.
    pub current_ma: i16,
    /// Supply, mV.
    pub supply_mv: u16,
    /// Temperature, °C.
    pub temperature_c: i8,
    /// Whether the home switch is closed; `None` for an actuator without one.
    pub home_switch: Option<bool>,
}

/// What an actuator is told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Setpoint {
    /// Drive the shaft at all.
    pub torque: bool,
    /// Where to be, µrad.
    pub position_urad: i32,
    /// How fast the set point moves, µrad/s.
    pub velocity_urad_s: i32,
    /// Most current to use, mA.
    pub current_limit_ma: i16,
}

/// An actuator of one axis.
pub trait Servo {
    /// Reads it. Called once a step, before [`Servo::drive`].
    fn sense(&mut self, now_us: u64) -> Sense;

    /// Tells it where to be.
    fn drive(&mut self, now_us: u64, setpoint: Setpoint);

    /// The actuator's own lowest and highest angle, µrad: its end stops or what is set in its memory.
    fn range_urad(&self) -> (i32, i32);
}
