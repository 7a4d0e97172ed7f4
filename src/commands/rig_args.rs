//! Flags of `rig`, which `doctor` and `daemon` read from a rig.toml, too.

mod options;
mod unused;
mod values;

use std::path::PathBuf;
use std::time::Duration;

use clap::Subcommand;

pub(super) use self::options::{axes_of, options};
use self::unused::hide_unused;
pub(super) use self::unused::refuse_unused;
use self::values::{approach, limits, move_time, tolerance, watched_for};

/// Arguments of `rig`.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// The rig's serial device, usb:SERIAL (of a USB device's serial number), can:INTERFACE, slcan:PATH@BITRATE,
    /// dynamixel:PATH@BAUD:ID,ID, feetech:PATH@BAUD:ID,ID, cia402:INTERFACE@NODE,NODE or cia402:slcan:PATH@BITRATE:NODE,NODE.
    #[arg(long, env = "OUTRIGGER_RIG_PORT", value_name = "PATH", global = true)]
    pub(super) port: Option<PathBuf>,
    /// Allow motion; without it nothing moves.
    #[arg(long, global = true)]
    pub(super) arm: bool,
    /// Home before the move: servos on a bus are homed by the program that moves them, so `home` alone does not last.
    #[arg(long, global = true)]
    pub(super) home: bool,
    /// Go this far below a pitch first, degrees, so that it is always approached from the same side of the gears' play.
    #[arg(long, value_name = "DEG", default_value_t = 1.0, value_parser = approach, global = true, allow_hyphen_values = true)]
    pub(super) approach_deg: f64,
    /// Check everything that is known here (angles, limits, faults) and print what would move, without moving.
    #[arg(long, global = true)]
    pub(super) dry_run: bool,
    /// Limits of an axis in degrees in addition to the firmware's and the servo's; once for every axis, or once for all.
    #[arg(long, value_name = "LOW,HIGH", value_parser = limits, allow_hyphen_values = true, global = true)]
    pub(super) limits_deg: Vec<(f64, f64)>,
    /// Distance from the target that counts as there, degrees.
    #[arg(long, value_name = "DEG", default_value_t = 0.3, value_parser = tolerance, global = true, allow_hyphen_values = true)]
    pub(super) tolerance_deg: f64,
    /// Longest time for homing or one move, seconds.
    #[arg(long, value_name = "S", default_value = "20", value_parser = move_time, global = true, allow_hyphen_values = true)]
    pub(super) timeout_s: Duration,
    /// When the line breaks while watching, wait for the rig and go on; with usb:SERIAL under whatever name it comes back.
    #[arg(long, global = true)]
    pub(super) reconnect: bool,
    /// The rig's node number.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=126), global = true)]
    pub(super) node: u8,
    #[command(subcommand)]
    pub(super) action: Action,
}

#[derive(Subcommand, Debug)]
pub(super) enum Action {
    /// Where every axis is, how that is known, and what is wrong; exit code 1 while a fault is latched.
    #[command(defer(hide_unused))]
    Status,
    /// Make positions trusted after a start.
    #[command(defer(hide_unused))]
    Home,
    /// Move every axis to a pitch.
    Set {
        /// Pitch of each axis, degrees.
        #[arg(required = true, allow_negative_numbers = true, value_name = "PITCH_DEG")]
        pitches_deg: Vec<f64>,
    },
    /// Move every axis to the pitch of its sensor in a mount file.
    Apply {
        /// The mount file.
        #[arg(value_name = "MOUNT.json")]
        mount: PathBuf,
        /// Names of the sensors on axis 0, 1, ...; the file's order when not given.
        #[arg(long, value_delimiter = ',', value_name = "NAME,NAME")]
        sensors: Vec<String>,
    },
    /// Print readings as they come; with --json one document a line, in the keys and units of `status`.
    #[command(defer(hide_unused))]
    Watch {
        /// End after this time, seconds; until Ctrl-C when not given.
        #[arg(long, value_name = "SECONDS", allow_hyphen_values = true, value_parser = watched_for)]
        r#for: Option<Duration>,
    },
    /// Decelerate, hold, disarm.
    #[command(defer(hide_unused))]
    Stop {
        /// Stop as fast as the rig can, and latch that (servos that this program drives itself stop; they do not latch).
        #[arg(long)]
        emergency: bool,
    },
    /// Clear latched faults without a cause any more.
    #[command(defer(hide_unused))]
    Clear,
    /// What each servo really does, from a session in which the rig did not move and its axes went through their range.
    #[command(
        defer(hide_unused),
        after_help = "Put the rig on firm ground with floor and walls in sight, record with the daemon, and drive each axis through \
                      settings over its range and back, two to five seconds each. The points of every setting are matched to the \
                      planes of the middle one: how far the sensor's turn differs from what its axis measured, the play between \
                      the two directions, and where the servo's axis lies. Nothing is changed. Exit codes: 0 the axes do as they \
                      measure, 1 failed, 3 they do not, it cannot be determined, or data was lost."
    )]
    Calibrate {
        /// Session folder.
        session: PathBuf,
        /// Where the sensors sit, in the order of the axes; without it the session's own.
        #[arg(long, value_name = "FILE")]
        mount: Option<PathBuf>,
    },
}

impl Action {
    pub(super) fn name(&self) -> &'static str {
        match self {
            Self::Status => "status",
            Self::Home => "home",
            Self::Set { .. } => "set",
            Self::Apply { .. } => "apply",
            Self::Watch { .. } => "watch",
            Self::Stop { .. } => "stop",
            Self::Clear => "clear",
            Self::Calibrate { .. } => "calibrate",
        }
    }
}
