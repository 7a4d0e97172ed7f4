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
    /// Between which times the encoder was sampled, µs: at a bus, when the question left and when the answer was there.
    /// Motion between two samples is judged by the longest time that may lie between them.
    pub sampled_us: [u64; 2],
    /// Progress of an actuator that finds its zero by itself.
    pub homing: ServoHoming,
}

impl Sense {
    /// What is known before an actuator was read.
    pub const UNREAD: Self = Self {
        reading: Reading::Missing,
        torque: false,
        current_ma: 0,
        supply_mv: u16::MAX,
        temperature_c: 0,
        home_switch: None,
        sampled_us: [0; 2],
        homing: ServoHoming::Idle,
    };
}

/// How far an actuator is with finding its zero by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ServoHoming {
    /// Not ordered, or not possible.
    Idle,
    /// It is about it.
    Underway,
    /// Its readings count from its zero now.
    Done,
    /// It gave up.
    Failed,
}

/// Setpoint of an actuator.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Setpoint {
    /// Drive the shaft at all.
    pub torque: bool,
    /// Where to be, µrad.
    pub position_urad: i32,
    /// How fast the set point moves, µrad/s.
    pub velocity_urad_s: i32,
    /// Most current to use, mA.
    pub current_limit_ma: i16,
    /// Find the zero by itself; where to be does not count meanwhile.
    pub home: bool,
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
