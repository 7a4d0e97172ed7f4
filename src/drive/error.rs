//! What goes wrong between host and rig. Every error says what to look at.

use std::os::unix::fs::FileTypeExt as _;
use std::time::Duration;

use firmware_protocol::{AckCode, ResetCause};

/// The cable or the device file.
#[derive(Clone, Debug, thiserror::Error)]
pub enum LinkError {
    /// The device file cannot be opened.
    #[error("rig cable: cannot open {path}: {reason}")]
    Open {
        /// The device file.
        path: String,
        /// The system's reason.
        reason: String,
    },
    /// Another program has it.
    #[error("rig cable: {path} is in use by another program")]
    InUse {
        /// The device file.
        path: String,
    },
    /// The other end is gone.
    #[error("rig cable: {path} hung up ({reason}): unplugged, or the rig lost power")]
    HungUp {
        /// The device file.
        path: String,
        /// The system's reason.
        reason: String,
    },
    /// The other end does not read.
    #[error("rig cable: {path} took no bytes for {after:?}: the rig does not read")]
    WriteTimeout {
        /// The device file.
        path: String,
        /// How long was waited.
        after: Duration,
    },
    /// The interface's queue takes no more.
    #[error(
        "rig cable: the send queue of {path} stayed full for {after:?} ({offers} offers): no device on the bus acknowledges \
         (check bit rate, cable and termination), or it is overloaded; the message was not sent"
    )]
    QueueFull {
        /// The interface.
        path: String,
        /// How long was waited.
        after: Duration,
        /// How often the message was offered.
        offers: u32,
    },
    /// A CAN adapter refused a command.
    #[error(
        "rig cable: the CAN adapter {path} refused {command} with BEL, expected a carriage return: {advice}"
    )]
    AdapterRefused {
        /// The adapter.
        path: String,
        /// What it was asked.
        command: String,
        /// What to do.
        advice: String,
    },
    /// The first move went otherwise than ordered.
    #[error(
        "rig: {path}, axis {axis}: stopped in the first move: ordered {ordered_deg:.3} deg, by {by} moved {moved_deg:.3} deg, \
         expected as far as ordered; the unit is wrong{units}: correct it, then connect again"
    )]
    WrongScale {
        /// The bus.
        path: String,
        /// The axis.
        axis: usize,
        /// Ordered so far, degrees.
        ordered_deg: f64,
        /// What measured it.
        by: &'static str,
        /// How far it went, degrees.
        moved_deg: f64,
        /// What the device says of its units.
        units: String,
    },
}

impl LinkError {
    /// A serial device that could not be opened.
    pub(super) fn refused(path: &str, error: &serialport::Error) -> Self {
        let path = path.to_owned();
        if error.description.contains("exclusive lock") {
            return Self::InUse { path };
        }
        // the system calls it no typewriter, also where it is a device of another kind
        let is_other = error.description.contains("typewriter")
            || std::fs::metadata(&path).is_ok_and(|file| !file.file_type().is_char_device());
        let reason = if is_other { "it is no serial device".into() } else { error.to_string() };
        Self::Open { path, reason }
    }
}

/// A conversation with a rig that did not end as wanted.
#[derive(Clone, Debug, thiserror::Error)]
pub enum RigError {
    /// The cable.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// Nothing sensible comes back.
    #[error("rig: no answer to {what} within {within:?} ({received})")]
    NoAnswer {
        /// What was asked.
        what: &'static str,
        /// How long.
        within: Duration,
        /// What arrived meanwhile.
        received: String,
    },
    /// It speaks another version.
    #[error(
        "rig: the firmware speaks protocol version {found}, this program speaks {expected}: update one of them"
    )]
    Version {
        /// What the rig speaks.
        found: u8,
        /// What this program speaks.
        expected: u8,
    },
    /// Another number of pitches than the rig has axes.
    #[error("rig: {given} {} for a rig with {axes} axes", if *given == 1 { "pitch" } else { "pitches" })]
    AxisCount {
        /// Pitches given.
        given: usize,
        /// Axes of the rig.
        axes: usize,
    },
    /// A pitch that is no number.
    #[error("rig: axis {axis}: the pitch {value_deg} deg is no angle")]
    NoAngle {
        /// The axis.
        axis: usize,
        /// What was given, degrees.
        value_deg: f64,
    },
    /// A pitch outside limits known here.
    #[error(
        "rig: axis {axis}: {target_deg:.3} deg is outside {limits_of} limits {minimum_deg:.3}..{maximum_deg:.3} deg"
    )]
    OutsideLimits {
        /// The axis.
        axis: usize,
        /// Where it should have gone, degrees.
        target_deg: f64,
        /// `the configured`, `the firmware's` or `the servo's own`.
        limits_of: &'static str,
        /// Lowest angle, degrees.
        minimum_deg: f64,
        /// Highest angle, degrees.
        maximum_deg: f64,
    },
    /// The path leads through the configured keep-out region.
    #[error("rig: the path from {from_deg:?} to {to_deg:?} deg leads through the configured keep-out region")]
    KeepOut {
        /// Where the pair stands, degrees.
        from_deg: [f64; 2],
        /// Where it should have gone, degrees.
        to_deg: [f64; 2],
    },
    /// The rig refused an order.
    #[error("rig: {what} refused: {}{}", explain(*code), axis_text(*axis))]
    Refused {
        /// What was ordered.
        what: &'static str,
        /// Why not.
        code: AckCode,
        /// The axis concerned, if the reason has one.
        axis: Option<usize>,
    },
    /// The rig latched faults.
    #[error("rig: fault {}{}", faults.join(", "), axis_text(*axis))]
    Fault {
        /// Their names.
        faults: Vec<String>,
        /// The axis of the first, if it has one.
        axis: Option<usize>,
    },
    /// A latched fault cannot be cleared yet.
    #[error("rig: fault {fault}{} is not cleared: its cause is still there", axis_text(*axis))]
    CauseRemains {
        /// Its name.
        fault: &'static str,
        /// Its axis, if it has one.
        axis: Option<usize>,
    },
    /// The rig restarted and forgot where it is.
    #[error("rig: it restarted ({}): not homed, connect and home again", cause.name())]
    Restarted {
        /// Why it started.
        cause: ResetCause,
    },
    /// Another program opened a session with the rig.
    #[error("rig: another program took it over; it is disarmed until one of them is alone")]
    OtherHost,
    /// Two rigs answer with one node number.
    #[error("rig: two rigs answer as node {node} ({}): give one of them another number", uids.map(|uid| format!("{uid:016x}")).join(" and "))]
    SameNode {
        /// The node number.
        node: u8,
        /// The rigs' unique numbers.
        uids: [u64; 2],
    },
    /// The overall time ran out; it has the order to hold.
    #[error("rig: {what} did not end within {within:?}; ordered it to hold")]
    Late {
        /// What it was doing.
        what: &'static str,
        /// The overall time.
        within: Duration,
    },
    /// It stands elsewhere.
    #[error("rig: axis {axis} stands at {measured_deg:.3} deg, not at {target_deg:.3} deg")]
    NotReached {
        /// The axis.
        axis: usize,
        /// Where it stands, degrees.
        measured_deg: f64,
        /// Where it should stand, degrees.
        target_deg: f64,
    },
    /// The user stopped it.
    #[error("rig: interrupted, {action}")]
    Interrupted {
        /// What the rig does.
        action: &'static str,
    },
    /// The thread that talks to the rig is gone.
    #[error("rig: the conversation ended")]
    Closed,
}

fn axis_text(axis: Option<usize>) -> String {
    axis.map_or_else(String::new, |axis| format!(" (axis {axis})"))
}

fn explain(code: AckCode) -> &'static str {
    match code {
        AckCode::Accepted => "accepted",
        AckCode::Busy => "it is busy",
        AckCode::Fault => "a fault is latched",
        AckCode::Limit => "outside the firmware's limits",
        AckCode::ServoLimit => "outside the servo's own limits",
        AckCode::KeepOut => {
            "the straight path there leads through the keep-out region of its firmware, in which the pair would touch"
        }
        AckCode::NotHomed => "not homed",
        AckCode::NotArmed => "not armed",
        AckCode::NoSession => "no session",
        AckCode::BadArgument => "an argument means nothing to it",
        AckCode::CauseRemains => "the cause of the fault is still there",
        AckCode::Locked => "the rig's own e-stop switch is open: close it first",
        AckCode::Outdated => "a later order came before",
    }
}
