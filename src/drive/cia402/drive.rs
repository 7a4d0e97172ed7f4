//! One drive: its last messages, and its power state machine (CiA 402-2, "Statusword", "Controlword").

use std::time::{Duration, Instant};

use firmware_protocol::{Reading, Sense, ServoHoming};

use super::object::{self, Answer, Object, error_name};
use crate::drive::hosted::{Questions, Sample};

/// How long switching on may take.
const SWITCHING_WITHIN: Duration = Duration::from_secs(2);

/// Where a drive is in its power state machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Power {
    /// Not ready, or no message yet.
    Unknown,
    /// Switch on disabled.
    Disabled,
    /// Ready to switch on.
    Ready,
    /// Switched on.
    On,
    /// Operation enabled: it follows its target.
    Enabled,
    /// Quick stop active.
    QuickStop,
    /// Fault, or going into it.
    Fault,
}

impl Power {
    /// The state that a status word says.
    pub(crate) fn of(status: u16) -> Self {
        match (status & 0x4F, status & 0x6F) {
            (0x08 | 0x0F, _) => Self::Fault,
            (0x40, _) => Self::Disabled,
            (_, 0x21) => Self::Ready,
            (_, 0x23) => Self::On,
            (_, 0x27) => Self::Enabled,
            (_, 0x07) => Self::QuickStop,
            _ => Self::Unknown,
        }
    }

    /// The control word that leads one step towards [`Power::Enabled`].
    pub(crate) fn next_control(self) -> u16 {
        match self {
            Self::Ready => 0x07,
            Self::On | Self::Enabled => 0x0F,
            Self::QuickStop => 0x00,
            Self::Unknown | Self::Disabled | Self::Fault => 0x06,
        }
    }
}

/// How far a drive is with finding its zero by itself (CiA 402-2, "Homing mode").
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Zero {
    /// Not ordered.
    Idle,
    /// Ordered at this time, and whether the drive has shown that it homes.
    Seeking(Instant, bool),
    Found,
    /// It gave up.
    Failed,
}

/// Bits of the status word in homing mode.
const TARGET_REACHED: u16 = 1 << 10;
const HOMING_ATTAINED: u16 = 1 << 12;
const HOMING_ERROR: u16 = 1 << 13;
/// The bits are those of the mode before for a moment.
const BITS_SETTLE: Duration = Duration::from_millis(250);

impl Zero {
    /// Goes on by a status word.
    pub(crate) fn hear(self, status: u16) -> Self {
        let Self::Seeking(since, seen) = self else { return self };
        let seen = seen || status & (HOMING_ATTAINED | HOMING_ERROR) == 0;
        let settled = seen || since.elapsed() > BITS_SETTLE;
        if settled && status & HOMING_ERROR != 0 {
            Self::Failed
        } else if settled && status & HOMING_ATTAINED != 0 && status & TARGET_REACHED != 0 {
            Self::Found
        } else {
            Self::Seeking(since, seen)
        }
    }

    fn homing(self) -> ServoHoming {
        match self {
            Self::Idle => ServoHoming::Idle,
            Self::Seeking(..) => ServoHoming::Underway,
            Self::Found => ServoHoming::Done,
            Self::Failed => ServoHoming::Failed,
        }
    }
}

/// One drive, as last received.
#[derive(Clone, Debug)]
pub struct Drive {
    /// Its node number.
    pub node: u8,
    /// Counts (position units) of a turn of the shaft.
    pub counts_per_turn: f64,
    /// Increments of a turn of the shaft, where it says how many and where it stands in them.
    pub increments_per_turn: Option<f64>,
    /// What it says of its units.
    pub units: String,
    /// State, as last received.
    pub power: Power,
    /// Position, counts.
    pub position: Option<i32>,
    /// Position and state came since the last look.
    pub fresh: bool,
    /// Between which times the position was sampled.
    between: [Instant; 2],
    /// SYNCs that it may still answer.
    pub syncs: Questions,
    /// Its last status word.
    pub status: u16,
    /// How far it is with finding its zero.
    pub zero: Zero,
    /// Answers to the question what it is: more than questions mean two devices of one number.
    pub kinds: u32,
    /// A slow reading that was asked for, and when.
    pub asked: Option<(Object, Instant)>,
    /// It restarted: what it counts from is not known, and its configuration is gone.
    pub restarted: bool,
    /// Error code of the last emergency message or fault; 0 for none.
    pub error: u16,
    /// What it refused, in words.
    pub refused: Option<String>,
    /// Torque was switched on since it was last to be off: should it vanish, it was the drive that dropped it.
    pub switched_on: bool,
    /// Since when it is led towards [`Power::Enabled`].
    pub switching_since: Option<Instant>,
    /// Its slow readings: current, supply.
    pub slow: (i16, u16),
    /// Its rated current, mA.
    pub rated_ma: i64,
}

impl Drive {
    /// A drive that sent nothing yet.
    pub(crate) fn new(node: u8) -> Self {
        Self {
            node,
            counts_per_turn: 1.0,
            increments_per_turn: None,
            units: String::new(),
            power: Power::Unknown,
            position: None,
            fresh: false,
            between: [Instant::now(); 2],
            syncs: Questions::default(),
            status: 0,
            zero: Zero::Idle,
            kinds: 0,
            asked: None,
            restarted: false,
            error: 0,
            refused: None,
            switched_on: false,
            switching_since: None,
            slow: (Sense::UNREAD.current_ma, Sense::UNREAD.supply_mv),
            rated_ma: 0,
        }
    }

    /// Takes a message of this node that came now.
    pub(crate) fn hear(&mut self, now: Instant, identifier: u16, data: &[u8]) {
        let node = u16::from(self.node);
        match (identifier.checked_sub(node), data) {
            (Some(0x180), [low, high, a, b, c, d]) => {
                self.status = u16::from_le_bytes([*low, *high]);
                self.power = Power::of(self.status);
                self.between = self.syncs.answer(now);
                self.position = Some(i32::from_le_bytes([*a, *b, *c, *d]));
                self.fresh = true;
            }
            (Some(0x080), [low, high, ..]) => self.error = u16::from_le_bytes([*low, *high]),
            (Some(0x700), [0]) => self.restarted = true,
            (Some(0x580), data) => {
                self.kinds += u32::from(object::answer(object::DEVICE_TYPE, data).is_some());
                if let Some((object, _)) = self.asked
                    && let Some(answer) = object::answer(object, data)
                {
                    self.asked = None;
                    self.take_slow(object, answer);
                }
            }
            _ => {}
        }
    }

    /// Takes a slow reading.
    pub(crate) fn take_slow(&mut self, object: Object, answer: Answer) {
        let Answer::Value(value) = answer else { return };
        match object {
            object::RATED_CURRENT => self.rated_ma = i64::from(value),
            object::CURRENT => {
                let share = i64::from(value as u16 as i16).abs();
                self.slow.0 = (share * self.rated_ma / 1000).min(i16::MAX.into()) as i16;
            }
            object::SUPPLY => self.slow.1 = value.min(u16::MAX.into()) as u16,
            object::ERROR_CODE if self.power == Power::Fault => self.error = value as u16,
            _ => {}
        }
    }

    /// Whether it goes to [`Power::Enabled`], and still has time for that.
    fn is_switching(&self) -> bool {
        self.power != Power::Fault
            && self.switching_since.is_some_and(|since| since.elapsed() < SWITCHING_WITHIN)
    }

    /// Takes note of its state; the control word that it is to be sent when it shall drive its shaft, `None` when it
    /// dropped its torque and the operator is to know.
    pub(crate) fn lead(&mut self) -> Option<u16> {
        if self.power == Power::Enabled {
            (self.switched_on, self.switching_since) = (true, None);
        } else if self.switched_on || self.power == Power::Fault || self.restarted {
            self.switching_since = None;
            return None;
        } else {
            self.switching_since.get_or_insert_with(Instant::now);
        }
        Some(self.power.next_control())
    }

    /// Its shaft is not to be driven by this program.
    pub(crate) fn rest(&mut self) {
        (self.switched_on, self.switching_since) = (false, None);
    }

    /// Counts to an angle, µrad.
    pub(crate) fn urad(&self, counts: i32) -> i32 {
        (f64::from(counts) * std::f64::consts::TAU * 1e6 / self.counts_per_turn).round() as i32
    }

    /// One count, µrad, rounded up.
    pub(crate) fn resolution_urad(&self) -> i32 {
        (std::f64::consts::TAU * 1e6 / self.counts_per_turn).ceil().clamp(1.0, 1e6) as i32
    }

    /// An angle to the nearest count.
    pub(crate) fn counts(&self, urad: i32) -> i32 {
        (f64::from(urad) * self.counts_per_turn / (std::f64::consts::TAU * 1e6)).round() as i32
    }

    /// The drive for the state machine. A fault shows as torque that is gone, and by its code as what caused it.
    pub(crate) fn sample(&mut self) -> Sample {
        Sample { between: self.between, sense: self.sense() }
    }

    fn sense(&mut self) -> Sense {
        let fresh = std::mem::take(&mut self.fresh);
        let (current_ma, supply_mv) = self.slow;
        let mut sense = Sense {
            reading: match self.position {
                _ if self.restarted => Reading::Invalid,
                Some(counts) if fresh => Reading::Measured(self.urad(counts)),
                _ => Reading::Missing,
            },
            torque: self.power == Power::Enabled || self.is_switching(),
            current_ma,
            supply_mv,
            homing: self.zero.homing(),
            ..Sense::UNREAD
        };
        match self.error {
            0x2000..=0x2FFF => sense.current_ma = i16::MAX,
            0x3220 => sense.supply_mv = 0,
            0x4000..=0x4FFF => sense.temperature_c = i8::MAX,
            0x7300..=0x73FF => sense.reading = Reading::Invalid,
            _ => {}
        }
        sense
    }

    /// Its errors in words.
    pub(crate) fn errors(&self) -> Vec<String> {
        let error =
            (self.error != 0).then(|| format!("error 0x{:04x} ({})", self.error, error_name(self.error)));
        let fault =
            (self.power == Power::Fault && self.error == 0).then(|| "fault without a code".to_owned());
        let restarted = self.restarted.then(|| "it restarted".to_owned());
        error.into_iter().chain(fault).chain(restarted).chain(self.refused.clone()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn status_words_lead_to_enabled() {
        let words = [
            (0x0250, Power::Disabled, 0x06),
            (0x0631, Power::Ready, 0x07),
            (0x0633, Power::On, 0x0F),
            (0x0637, Power::Enabled, 0x0F),
            (0x0617, Power::QuickStop, 0x00),
            (0x0638, Power::Fault, 0x06),
            (0x001F, Power::Fault, 0x06),
            (0x0000, Power::Unknown, 0x06),
        ];
        for (status, power, control) in words {
            assert_eq!((Power::of(status), power.next_control()), (power, control), "{status:04x}");
        }
    }

    #[test]
    fn torque_that_is_dropped_is_not_switched_on_again() {
        let mut drive = Drive::new(1);
        let hear =
            |drive: &mut Drive, status: u8| drive.hear(Instant::now(), 0x181, &[status, 0x06, 0, 0, 0, 0]);
        for (status, control) in [(0x50, 0x06), (0x31, 0x07), (0x33, 0x0F), (0x37, 0x0F)] {
            hear(&mut drive, status);
            assert_eq!(drive.lead(), Some(control));
            assert!(drive.sense().torque, "going there, or there");
        }
        hear(&mut drive, 0x50);
        assert_eq!((drive.lead(), drive.sense().torque), (None, false));
        drive.rest();
        assert_eq!(drive.lead(), Some(0x06));
        hear(&mut drive, 0x38);
        assert_eq!((drive.lead(), drive.sense().torque), (None, false));
    }

    #[test]
    fn messages_of_the_node_are_accepted_and_no_others() {
        let mut drive = Drive { counts_per_turn: 36_000.0, ..Drive::new(5) };
        drive.hear(Instant::now(), 0x186, &[0x37, 0x06, 1, 0, 0, 0]);
        assert_eq!(drive.sense().reading, Reading::Missing);
        drive.hear(Instant::now(), 0x185, &[0x37, 0x06, 0x28, 0x23, 0, 0]);
        assert_eq!(
            drive.sense(),
            Sense { reading: Reading::Measured(1_570_796), torque: true, ..Sense::UNREAD }
        );
        assert_eq!(drive.counts(1_570_796), 9000);
        assert_eq!(drive.sense().reading, Reading::Missing, "a reading counts once");
        drive.hear(Instant::now(), 0x085, &[0x11, 0x86, 0, 0, 0, 0, 0, 0]);
        drive.hear(Instant::now(), 0x185, &[0x38, 0x06, 0x28, 0x23, 0, 0]);
        assert!(!drive.sense().torque);
        assert_eq!(drive.errors(), ["error 0x8611 (following error)"]);
        drive.hear(Instant::now(), 0x705, &[0]);
        assert_eq!(drive.sense().reading, Reading::Invalid);
    }
}
