//! `outrigger rig`: read and set the servo rig.

mod watch;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::bail;
use clap::Subcommand;
use serde_json::json;

use super::defaults::{long_name, section};
use super::{Context, Outcome, Verb, output, signals};
use crate::drive::{Applied, Options, Rig, RigError, RigStatus};
use crate::live::config::Config;
use crate::rig::MountFile;

/// No move takes longer.
const LONGEST_MOVE: Duration = Duration::from_secs(3600);

/// Arguments of `rig`.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// The rig's serial device, usb:SERIAL (of a USB device's serial number), can:INTERFACE, slcan:PATH@BITRATE,
    /// dynamixel:PATH@BAUD:ID,ID, feetech:PATH@BAUD:ID,ID, cia402:INTERFACE@NODE,NODE or cia402:slcan:PATH@BITRATE:NODE,NODE.
    #[arg(long, env = "OUTRIGGER_RIG_PORT", value_name = "PATH", global = true)]
    pub(super) port: Option<PathBuf>,
    /// Allow motion; without it nothing moves.
    #[arg(long, global = true)]
    arm: bool,
    /// Home before the move: servos on a bus are homed by the program that moves them, so `home` alone does not last.
    #[arg(long, global = true)]
    home: bool,
    /// Go this far below a pitch first, degrees, so that it is always approached from the same side of the gears' play.
    #[arg(long, value_name = "DEG", default_value_t = 1.0, value_parser = approach, global = true, allow_hyphen_values = true)]
    approach_deg: f64,
    /// Check everything that is known here (angles, limits, faults) and print what would move, without moving.
    #[arg(long, global = true)]
    dry_run: bool,
    /// Limits of an axis in degrees beside the firmware's and the servo's; once for every axis, or once for all.
    #[arg(long, value_name = "LOW,HIGH", value_parser = limits, allow_hyphen_values = true, global = true)]
    limits_deg: Vec<(f64, f64)>,
    /// Distance from the target that counts as there, degrees.
    #[arg(long, value_name = "DEG", default_value_t = 0.3, value_parser = tolerance, global = true, allow_hyphen_values = true)]
    tolerance_deg: f64,
    /// Longest time for homing or one move, seconds.
    #[arg(long, value_name = "S", default_value = "20", value_parser = move_time, global = true, allow_hyphen_values = true)]
    timeout_s: Duration,
    /// When the line breaks while watching, wait for the rig and go on; with usb:SERIAL under whatever name it comes back.
    #[arg(long, global = true)]
    reconnect: bool,
    /// The rig's node number.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=126), global = true)]
    node: u8,
    #[command(subcommand)]
    action: Action,
}

#[derive(Subcommand, Debug)]
enum Action {
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
        /// Stop as fast as the rig can, and latch that (servos that this program drives itself stop; nobody latches it for them).
        #[arg(long)]
        emergency: bool,
    },
    /// Take latched faults away whose causes are gone.
    #[command(defer(hide_unused))]
    Clear,
}

impl Action {
    fn name(&self) -> &'static str {
        match self {
            Self::Status => "status",
            Self::Home => "home",
            Self::Set { .. } => "set",
            Self::Apply { .. } => "apply",
            Self::Watch { .. } => "watch",
            Self::Stop { .. } => "stop",
            Self::Clear => "clear",
        }
    }
}

/// Arguments that not every verb has a use for, and which have.
const USED_BY: [(&str, &[&str]); 8] = [
    ("arm", &["home", "set", "apply"]),
    ("home", &["home", "set", "apply"]),
    ("approach_deg", &["set", "apply"]),
    ("dry_run", &["home", "set", "apply"]),
    ("limits_deg", &["set", "apply"]),
    ("tolerance_deg", &["set", "apply"]),
    ("timeout_s", &["home", "set", "apply"]),
    ("reconnect", &["watch"]),
];

/// The arguments that a verb has no use for, and the verbs that have.
fn unused_by(verb: &str) -> impl Iterator<Item = &'static (&'static str, &'static [&'static str])> {
    USED_BY.iter().filter(move |(_, verbs)| !verbs.contains(&verb))
}

/// A verb's help without what it refuses.
fn hide_unused(verb: clap::Command) -> clap::Command {
    let has = |id: &str| verb.get_arguments().any(|arg| arg.get_id() == id);
    let unused: Vec<&str> = unused_by(verb.get_name()).map(|(id, _)| *id).filter(|id| has(id)).collect();
    unused.into_iter().fold(verb, |verb, id| verb.mut_arg(id, |arg| arg.hide(true)))
}

fn refuse_unused(action: &Action, context: Context) -> anyhow::Result<()> {
    let verb = action.name();
    if verb == "stop" {
        // whoever stops a rig stops it, whatever else was typed
        if let Some((argument, _)) = unused_by(verb).find(|(argument, _)| context.is_typed(argument)) {
            output::say_notice(&format!("a stop is a stop: --{} changes nothing", long_name(argument)));
        }
        return Ok(());
    }
    unused_by(verb).try_for_each(|(argument, verbs)| {
        let users = verbs.join("`, `rig ");
        context
            .ensure_not_typed(&[*argument], format!("is about `rig {users}`: `rig {verb}` has no use for it"))
    })
}

fn limits(text: &str) -> Result<(f64, f64), String> {
    let wrong = || format!("`{text}`: expected LOW,HIGH in degrees, low first");
    let (low, high) = text.split_once(',').ok_or_else(wrong)?;
    match (low.trim().parse::<f64>(), high.trim().parse::<f64>()) {
        (Ok(low), Ok(high)) if low < high && low.abs() <= 360.0 && high.abs() <= 360.0 => Ok((low, high)),
        _ => Err(wrong()),
    }
}

fn approach(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|angle_deg| (0.0..90.0).contains(angle_deg))
        .ok_or_else(|| "expected an angle below 90 degrees, or 0 to go straight there".into())
}

fn tolerance(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|angle_deg| *angle_deg > 0.0 && *angle_deg < 90.0)
        .ok_or_else(|| "expected an angle above 0 and below 90 degrees".into())
}

fn move_time(text: &str) -> Result<Duration, String> {
    let time = text.parse().ok().and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
    time.filter(|time| !time.is_zero() && *time <= LONGEST_MOVE)
        .ok_or_else(|| format!("expected a time above 0 and up to {} s", LONGEST_MOVE.as_secs()))
}

fn watched_for(text: &str) -> Result<Duration, String> {
    let time = text.parse().ok().and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
    time.filter(|time| Instant::now().checked_add(*time).is_some())
        .ok_or_else(|| format!("`{text}`: expected seconds, 0 or more"))
}

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    // what was typed is checked before anything is opened
    refuse_unused(&args.action, context)?;
    let Some(port) = &args.port else {
        let of_file = context.config.map_or(String::new(), |config| {
            format!(", or `port` under [rig] of {}, which names none", config.path.display())
        });
        refuse!("which rig? give its serial device with --port PATH or OUTRIGGER_RIG_PORT{of_file}");
    };
    let mut unset = Vec::new();
    let pitches_rad = match &args.action {
        Action::Set { pitches_deg } => pitches_deg.iter().map(|pitch| pitch.to_radians()).collect(),
        Action::Apply { mount, sensors } => {
            let file = by_axis(MountFile::read(mount)?, mount, sensors)?;
            unset.extend(set_by_no_servo(&file));
            file.axis_pitches_deg(sensors).into_iter().map(f64::to_radians).collect()
        }
        _ => Vec::new(),
    };
    let moves = matches!(args.action, Action::Set { .. } | Action::Apply { .. } | Action::Home);
    // what is typed wins over a file that says to try only
    let dry_run = args.dry_run && (!context.is_typed("arm") || context.is_typed("dry_run"));
    if moves && !args.arm && !dry_run {
        refuse!(
            "this moves the rig: say --arm to allow it, or --dry-run to see what would move; nothing was moved"
        );
    }
    let options = options(args, pitches_rad.len())?;
    let rig = Rig::connect_with(port, options)?;
    let explain = |error| explain(error, port);
    if let Action::Apply { mount, sensors } = &args.action {
        fits(&rig, mount, sensors, pitches_rad.len())?;
        unset.iter().take(pitches_rad.len()).flatten().for_each(|unset| output::say_notice(unset));
    }
    match &args.action {
        Action::Status => {
            let status = rig.status()?;
            show(&status, None, context)?;
            nothing_latched(&status)?;
        }
        _ if moves && dry_run => try_out(&rig, &pitches_rad, args.home, context)?,
        Action::Home => {
            obey_interrupts(&rig)?;
            rig.arm().and_then(|()| rig.home()).map_err(explain)?;
            show(&rig.status()?, None, context)?;
        }
        Action::Set { .. } | Action::Apply { .. } => {
            obey_interrupts(&rig)?;
            rig.check(&pitches_rad)?;
            rig.arm().map_err(explain)?;
            if args.home {
                rig.home().map_err(explain)?;
            }
            let applied = rig.apply(&pitches_rad).map_err(explain)?;
            show(&rig.status()?, Some(&applied), context)?;
        }
        Action::Watch { r#for } => watch::watch(args, rig, *r#for, context)?,
        Action::Stop { emergency } => {
            if *emergency { rig.e_stop() } else { rig.stop() }?;
            let status = rig.status()?;
            show(&status, None, context)?;
            nothing_latched(&status).unwrap_or_else(|latched| output::say_notice(&latched.to_string()));
        }
        Action::Clear => {
            rig.clear_faults()?;
            show(&rig.status()?, None, context)?;
        }
    }
    if moves && !dry_run && !context.json {
        let unhomed = if is_driven_here(port) { "; what moves them next says --home" } else { "" };
        output::print_text(&format!(
            "disarmed as this program ends: the axes are idle, and hold where they stand{unhomed}\n"
        ))?;
    }
    Ok(Outcome::Done)
}

pub(super) fn options(args: &Args, axes: usize) -> anyhow::Result<Options> {
    let approach_rad = args.approach_deg.to_radians();
    let mut limits_rad: Vec<_> =
        args.limits_deg.iter().map(|(low, high)| (low.to_radians(), high.to_radians())).collect();
    if let [all] = limits_rad[..] {
        limits_rad = vec![all; axes];
    } else if !limits_rad.is_empty() && axes > 0 && limits_rad.len() != axes {
        refuse!("--limits-deg is given {} times for {axes} pitches", limits_rad.len());
    }
    let tolerance_rad = args.tolerance_deg.to_radians();
    Ok(Options {
        settle_within: args.timeout_s,
        tolerance_rad,
        limits_rad,
        approach_rad,
        node: args.node,
        ..Options::new_session()
    })
}

/// Names of the sensors on axis 0, 1, ..., as a rig.toml has them under [rig.apply]; empty where it says nothing of it.
pub(super) fn axes_of(config: &Config) -> anyhow::Result<Vec<String>> {
    let args: Args = section(config, &["rig", "apply", "-"], |verb| match verb {
        Verb::Rig(args) => Some(args),
        _ => None,
    })?;
    Ok(if let Action::Apply { sensors, .. } = args.action { sensors } else { Vec::new() })
}

/// The sensors of a mount file in the order of the axes that these names say.
pub(super) fn by_axis(file: MountFile, path: &Path, names: &[String]) -> anyhow::Result<MountFile> {
    file.by_axis(names)
        .map_err(|reason| anyhow::anyhow!("{}: --sensors {}: {reason}", path.display(), names.join(",")))
}

/// What a mount says of each sensor beside its pitch, in words: nobody but a hand with a screwdriver sets that.
fn set_by_no_servo(file: &MountFile) -> impl Iterator<Item = Option<String>> {
    file.sensors.iter().map(|sensor| {
        let degrees = [("roll", sensor.roll_deg)];
        let metres = [("x", sensor.x_m), ("y", sensor.y_m), ("z", sensor.z_m)];
        let degrees =
            degrees.map(|(name, value)| (value != 0.0).then(|| format!("{name} {value:+.2} degrees")));
        let metres = metres.map(|(name, value)| (value != 0.0).then(|| format!("{name} {value:+.3} m")));
        let parts: Vec<String> = degrees.into_iter().chain(metres).flatten().collect();
        (!parts.is_empty()).then(|| {
            format!(
                "{}: the rig sets its pitch alone; no servo sets {}: see that it is screwed on so",
                sensor.name,
                parts.join(", ")
            )
        })
    })
}

/// Whether a mount file, or what was named of it, has a pitch for every axis.
fn fits(rig: &Rig, mount: &Path, names: &[String], pitches: usize) -> anyhow::Result<()> {
    let axes = rig.axis_count();
    if pitches == axes {
        return Ok(());
    }
    let (has, advice) = match names {
        [] => ("has", "--sensors NAME,NAME says which sit on axis 0, 1, ..."),
        _ => ("gives, by --sensors,", "name one for each axis"),
    };
    bail!("{} {has} {pitches} sensors, the rig {axes} axes: {advice}", mount.display())
}

/// Ctrl-C once holds, twice is an emergency stop.
fn obey_interrupts(rig: &Rig) -> anyhow::Result<()> {
    let (signals, interrupt) = (signals::interrupts()?, rig.interrupt());
    std::thread::spawn(move || {
        for () in signals {
            let what = if interrupt.raise() == 1 {
                "braking, then holding; Ctrl-C again for e-stop"
            } else {
                "e-stop"
            };
            output::say_notice(what);
        }
    });
    Ok(())
}

/// Whether the servos are driven by this program: what it knows of them ends with it.
fn is_driven_here(port: &Path) -> bool {
    let port = port.to_string_lossy();
    ["dynamixel:", "feetech:", "cia402:"].iter().any(|word| port.starts_with(word))
}

fn explain(error: RigError, port: &Path) -> anyhow::Error {
    match error {
        RigError::Refused { code: firmware_protocol::AckCode::NotHomed, .. } => {
            let advice = if is_driven_here(port) {
                "positions are not trusted yet: say --home, as this program drives these servos and homes them anew each time"
            } else {
                "positions are not trusted yet: run `outrigger rig home --arm` first, or say --home"
            };
            anyhow::Error::new(error).context(advice)
        }
        RigError::Fault { .. } | RigError::Refused { code: firmware_protocol::AckCode::Fault, .. } => {
            anyhow::Error::new(error).context(
                "from now on nothing moves until the fault is cleared: take its cause away, then run `outrigger rig clear`",
            )
        }
        error => error.into(),
    }
}

fn nothing_latched(status: &RigStatus) -> anyhow::Result<()> {
    let latched = status.axes.iter().filter(|axis| !axis.faults.is_empty());
    let latched: Vec<_> =
        latched.map(|axis| format!("{} (axis {})", axis.faults.join(", "), axis.axis)).collect();
    if latched.is_empty() {
        return Ok(());
    }
    bail!(
        "fault {} is latched, and nothing moves: take its cause away, then run `outrigger rig clear`",
        latched.join(", ")
    )
}

fn try_out(rig: &Rig, pitches_rad: &[f64], homes: bool, context: Context) -> anyhow::Result<()> {
    if !pitches_rad.is_empty() {
        rig.check(pitches_rad)?;
    }
    let status = rig.status()?;
    nothing_latched(&status)?;
    let moves: Vec<_> = status
        .axes
        .iter()
        .zip(pitches_rad)
        .map(|(axis, to_rad)| {
            json!({ "axis": axis.axis, "from_deg": axis.position_deg, "to_deg": to_rad.to_degrees(), "homed": axis.homed })
        })
        .collect();
    if context.json {
        return output::print_json(
            &json!({ "dry_run": true, "moves": moves, "homing_moves": status.homing_moves }),
        );
    }
    let mut text = String::new();
    for (axis, to_rad) in status.axes.iter().zip(pitches_rad) {
        let homed = if axis.homed { "" } else { " (not homed yet)" };
        text += &format!(
            "axis {}: {:.3} deg -> {:.3} deg{homed}\n",
            axis.axis,
            axis.position_deg,
            to_rad.to_degrees()
        );
    }
    if moves.is_empty() || homes {
        text += if status.homing_moves {
            "homing moves every axis to its switch or zero, one after the other\n"
        } else {
            "homing moves nothing on this rig: it has neither switch nor zero to seek\n"
        };
    } else if status.axes.iter().any(|axis| !axis.homed) {
        text += "without --home, or `rig home --arm` before it, this would be refused\n";
    }
    if !moves.is_empty() {
        text +=
            "a keep-out region of the firmware, where it has one, is known to it alone and not looked at\n";
    }
    output::print_text(&(text + "nothing was moved\n"))
}

fn show(status: &RigStatus, applied: Option<&Applied>, context: Context) -> anyhow::Result<()> {
    if context.json {
        let mut document = serde_json::to_value(status)?;
        if let (Some(applied), Some(fields)) = (applied, document.as_object_mut()) {
            let axes: Vec<_> = applied
                .axes
                .iter()
                .map(|axis| {
                    json!({
                        "target_deg": axis.target_rad.to_degrees(),
                        "measured_deg": axis.measured_rad.to_degrees(),
                        "error_deg": (axis.measured_rad - axis.target_rad).to_degrees(),
                        "uncertainty_deg": axis.uncertainty_rad.map(f64::to_degrees),
                        "scatter_deg": axis.scatter_rad.to_degrees(),
                        "readings": axis.readings,
                        "source": axis.source,
                        "approach": axis.approach,
                        "age_ms": axis.age_s * 1e3,
                    })
                })
                .collect();
            fields.insert("applied".into(), axes.into());
        }
        return output::print_json(&document);
    }
    let armed = if status.armed { "armed" } else { "disarmed" };
    let mut text = format!(
        "rig {} on {}: firmware {}, {armed}, last start: {}, {} frames, {} damaged\n",
        status.uid, status.port, status.firmware, status.reset_cause, status.frames, status.damaged
    );
    for axis in &status.axes {
        let homed = if axis.homed { "homed" } else { "not homed" };
        let within = axis.uncertainty_deg.map_or(String::new(), |half_deg| format!(" ±{half_deg:.3}"));
        text += &format!(
            "axis {}: {:8.3} deg{within} ({}, {:.0} ms ago), target {:8.3} deg, {}, {homed}",
            axis.axis, axis.position_deg, axis.source, axis.age_ms, axis.target_deg, axis.state
        );
        if !axis.faults.is_empty() {
            text += &format!(", FAULT {}", axis.faults.join(", "));
        }
        if !axis.device_errors.is_empty() {
            text += &format!(", the device says: {}", axis.device_errors.join(", "));
        }
        text.push('\n');
    }
    output::print_text(&text)
}
