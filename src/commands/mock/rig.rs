//! `outrigger mock rig`: a servo rig behind a pty or on a CAN interface, with faults on a schedule.

use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use anyhow::{Context as _, bail};

use crate::commands::{Context, Outcome, ensure_consistent, output, signals};
use crate::mock::Device;
use crate::mock::bus_servos::{Make, MockServos};
use crate::mock::rig::{AxisKind, MockConfig, MockFault, MockRig, ScheduledFault, run_on_can};
use crate::report::Report;

/// Arguments of `mock rig`.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Starting angles and encoder noise come from here.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Break something at a time: FAULT@SECONDS, such as stuck:1@3, jump=10@5, reboot@2, hang-up@8.
    #[arg(long = "fault", value_name = "FAULT@SECONDS")]
    faults: Vec<ScheduledFault>,
    /// Hobby servos that measure nothing, in place of motors with encoders.
    #[arg(long)]
    pulse: bool,
    /// Encoders that count from where they were switched on, and a switch on each axis that is closed at and below this angle,
    /// degrees: homing seeks it.
    #[arg(long, value_name = "DEG", allow_hyphen_values = true, value_parser = parse_switch, conflicts_with_all = ["pulse", "dynamixel"])]
    home_switch: Option<i32>,
    /// Encoders on the motors, before the gears' play: where the load stands then depends on the side it came from.
    #[arg(long, conflicts_with_all = ["pulse", "dynamixel"])]
    encoder_on_motor: bool,
    /// Put a CAN adapter with the LAWICEL text protocol in between: connect with slcan:PATH.
    #[arg(long)]
    slcan: bool,
    /// Two Dynamixel X servos of ids 1 and 2 in place of a rig with its own firmware: connect with dynamixel:PATH. Only
    /// faults of single axes can be scheduled.
    #[arg(long, conflicts_with_all = ["pulse", "slcan"])]
    dynamixel: bool,
    /// A rig on a CAN interface in place of one behind a pty: connect with can:INTERFACE.
    #[arg(long, value_name = "INTERFACE", conflicts_with_all = ["slcan", "dynamixel"])]
    can: Option<String>,
    /// Positions of each axis in a second.
    #[arg(long, value_name = "HZ", default_value_t = 50, value_parser = clap::value_parser!(u32).range(1..=500))]
    position_hz: u32,
    /// The rig's node number.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=126))]
    node: u8,
}

/// An angle that the axes reach, µrad.
fn parse_switch(text: &str) -> Result<i32, String> {
    match text.parse::<f64>() {
        Ok(angle_deg) if angle_deg.abs() <= 55.0 => Ok((angle_deg.to_radians() * 1e6) as i32),
        _ => Err(format!("`{text}`: expected an angle of -55 to 55 degrees")),
    }
}

/// Runs the verb until Ctrl-C or until the rig hangs up.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    let interrupts = signals::interrupts()?;
    let single = |fault: &ScheduledFault| matches!(fault.fault, MockFault::Axis(..));
    if let Some(fault) = args.faults.iter().find(|fault| !single(fault)) {
        let words = format!("--fault {}: bought servos have no such fault", fault.text);
        ensure_consistent([(args.dynamixel, words)])?;
    }
    let kind = if args.pulse { AxisKind::Pulse } else { AxisKind::Measured };
    let mut config =
        MockConfig { kind, slcan: args.slcan, node: args.node, ..MockConfig::default().of_number(args.seed) };
    if let Some(at_urad) = args.home_switch {
        config = config.with_home_switches(at_urad);
    }
    if args.encoder_on_motor {
        config = config.with_encoders_on_motors();
    }
    config.firmware.position_every_us = 1_000_000 / args.position_hz;
    if let Some(interface) = &args.can {
        return on_can(interface, config, args, context, &interrupts);
    }
    let started = if args.dynamixel {
        MockServos::start(Make::Dynamixel, args.seed).map(Device::Servos)
    } else {
        MockRig::start(config, args.seed).map(Device::Rig)
    };
    let rig = started.context("no pseudo terminal for the mock rig")?;
    say_port(&rig.path().display().to_string(), context)?;
    wait(args, &interrupts, || rig.is_running(), |fault| rig.inject(fault));
    Ok(Outcome::Done)
}

fn say_port(port: &str, context: Context) -> anyhow::Result<()> {
    let report = Report::new("A mock rig", port);
    output::print_result(context.json, &serde_json::json!({ "port": port }), &report, &[])
}

fn on_can(
    interface: &str,
    config: MockConfig,
    args: &Args,
    context: Context,
    interrupts: &Receiver<()>,
) -> anyhow::Result<Outcome> {
    let (faults, inbox) = channel();
    let (name, seed) = (interface.to_owned(), args.seed);
    let work = move || run_on_can(&name, config, seed, &inbox);
    let rig = std::thread::Builder::new().spawn(work).context("no thread for the rig can be started")?;
    say_port(&format!("can:{interface}"), context)?;
    wait(
        args,
        interrupts,
        || !rig.is_finished(),
        |fault| {
            let _ = faults.send(fault); // a rig that is gone has nothing left to break
        },
    );
    drop(faults);
    match rig.join() {
        Ok(ended) => ended.with_context(|| format!("the mock rig on {interface}"))?,
        Err(_) => bail!("the mock rig on {interface} panicked"),
    }
    Ok(Outcome::Done)
}

/// Breaks what is due until Ctrl-C or until the rig ends.
fn wait(args: &Args, interrupts: &Receiver<()>, runs: impl Fn() -> bool, inject: impl Fn(MockFault)) {
    let started = Instant::now();
    let mut faults = args.faults.clone();
    faults.sort_by_key(|fault| std::cmp::Reverse(fault.after));
    while runs() {
        while faults.last().is_some_and(|fault| fault.after <= started.elapsed()) {
            if let Some(due) = faults.pop() {
                output::say_notice(&format!("fault {} after {:.1} s", due.text, due.after.as_secs_f64()));
                inject(due.fault);
            }
        }
        match interrupts.recv_timeout(Duration::from_millis(50)) {
            Ok(()) | Err(RecvTimeoutError::Disconnected) => return,
            Err(RecvTimeoutError::Timeout) => {}
        }
    }
}
