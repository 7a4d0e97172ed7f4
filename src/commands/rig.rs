//! `outrigger rig`: read and set the servo rig.

mod calibrate;
mod show;
mod watch;

use std::path::Path;

use anyhow::bail;

use self::show::{explain, is_driven_here, nothing_latched, show, try_out};
pub use super::rig_args::Args;
use super::rig_args::{Action, options, refuse_unused};
use super::{Context, Outcome, output, signals};
use crate::drive::Rig;
use crate::rig::MountFile;

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    // what was typed is checked before anything is opened
    refuse_unused(args.action.name(), context)?;
    if let Action::Calibrate { session, mount } = &args.action {
        return calibrate::run(session, mount.as_deref(), context);
    }
    let Some(port) = &args.port else {
        let of_file = context.config.map_or(String::new(), |config| {
            format!(", or `port` under [rig] of {}, which names none", config.path.display())
        });
        refuse!("which rig? give its serial device with --port PATH or OUTRIGGER_RIG_PORT{of_file}");
    };
    let (pitches_rad, set_by_hand) = pitches(&args.action)?;
    let moves = matches!(args.action, Action::Set { .. } | Action::Apply { .. } | Action::Home);
    // what is typed wins over a file that says to try only
    let dry_run = args.dry_run && (!context.is_typed("arm") || context.is_typed("dry_run"));
    if moves && !args.arm && !dry_run {
        refuse!(
            "this moves the rig: say --arm to allow it, or --dry-run to see what would move; nothing was moved"
        );
    }
    let rig = Rig::connect_with(port, options(args, pitches_rad.len())?)?;
    if let Action::Apply { mount, sensors } = &args.action {
        fits(&rig, mount, sensors, pitches_rad.len())?;
        set_by_hand.iter().take(pitches_rad.len()).flatten().for_each(|part| output::say_notice(part));
    }
    if moves && dry_run {
        try_out(&rig, &pitches_rad, args.home, context)?;
        return Ok(Outcome::Done);
    }
    match &args.action {
        Action::Status => {
            let status = rig.status()?;
            show(&status, None, context)?;
            nothing_latched(&status)?;
        }
        Action::Home | Action::Set { .. } | Action::Apply { .. } => {
            move_axes(&rig, args, &pitches_rad, context).map_err(|error| explain(error, port))?;
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
        Action::Calibrate { .. } => {} // drives nothing: it has returned
    }
    if moves && !context.json {
        let unhomed = if is_driven_here(port) { "; what moves them next says --home" } else { "" };
        output::print_text(&format!(
            "disarmed as this program ends: the axes are idle, and hold where they stand{unhomed}\n"
        ))?;
    }
    Ok(Outcome::Done)
}

/// Pitch of each axis, rad; and of a mount file, what is set by hand.
fn pitches(action: &Action) -> anyhow::Result<(Vec<f64>, Vec<Option<String>>)> {
    Ok(match action {
        Action::Set { pitches_deg } => {
            (pitches_deg.iter().map(|pitch| pitch.to_radians()).collect(), Vec::new())
        }
        Action::Apply { mount, sensors } => {
            let file = MountFile::read_by_axis(mount, sensors)?;
            let pitches_deg = file.axis_pitches_deg(sensors);
            (pitches_deg.into_iter().map(f64::to_radians).collect(), file.set_by_hand().collect())
        }
        _ => (Vec::new(), Vec::new()),
    })
}

/// Homes, where that is asked for, then moves to the pitches, where there are any.
fn move_axes(rig: &Rig, args: &Args, pitches_rad: &[f64], context: Context) -> anyhow::Result<()> {
    apply_interrupts(rig)?;
    let is_move = !matches!(args.action, Action::Home);
    if is_move {
        rig.check(pitches_rad)?;
    }
    rig.arm()?;
    if args.home || !is_move {
        rig.home()?;
    }
    let applied = is_move.then(|| rig.apply(pitches_rad)).transpose()?;
    show(&rig.status()?, applied.as_ref(), context)
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
fn apply_interrupts(rig: &Rig) -> anyhow::Result<()> {
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
