//! `outrigger rig watch`: readings as they come.

use std::cell::Cell;
use std::time::{Duration, Instant};

use crate::commands::rig_args::{Args, options};
use crate::commands::{Context, output, signals};
use crate::drive::{Rig, WatchedAxis};
use crate::live::clocks::host::steady_now_ns;

/// How often axes that send no readings are reported while watching.
const LOOK: Duration = Duration::from_secs(1);

/// Prints until the time is over or somebody stops it.
pub(super) fn watch(args: &Args, first: Rig, time: Option<Duration>, context: Context) -> anyhow::Result<()> {
    let signals = signals::interrupts()?;
    let end = time.map(|time| Instant::now() + time);
    let stopped = Cell::new(false);
    let goes_on = || {
        stopped.set(stopped.get() || signals.try_recv().is_ok());
        !stopped.get() && end.is_none_or(|end| Instant::now() < end)
    };
    let mut rig = Some(first);
    while goes_on() {
        let Some(connected) = &rig else {
            std::thread::sleep(Duration::from_millis(250));
            rig = args.port.as_ref().and_then(|port| Rig::connect_with(port, options(args, 0).ok()?).ok());
            if rig.is_some() {
                output::say_notice("the rig is back; home it before it moves");
            }
            continue;
        };
        let reports = connected.reports();
        let mut looked = Instant::now();
        while goes_on() {
            match reports.recv_timeout(Duration::from_millis(100)) {
                Ok(report) => print_reading(&report.into(), context)?,
                Err(std::sync::mpsc::RecvTimeoutError::Timeout) => {}
                Err(std::sync::mpsc::RecvTimeoutError::Disconnected) => break,
            }
            if looked.elapsed() >= LOOK {
                looked = Instant::now();
                let Ok(status) = connected.status() else { break };
                let silent = status.axes.iter().filter(|axis| axis.source == "stale");
                for axis in silent {
                    print_reading(&WatchedAxis::last_of(axis, steady_now_ns()), context)?;
                }
            }
        }
        // the conversation ended, and status says why; a dead device file is closed at once, or it comes back under
        // another name
        if let Err(error) = connected.status()
            && args.reconnect
        {
            output::say_notice(&format!("{error}; waiting for it"));
            rig = None;
        } else {
            connected.status()?;
        }
    }
    Ok(())
}

fn print_reading(report: &WatchedAxis, context: Context) -> anyhow::Result<()> {
    let line = if context.json {
        serde_json::to_string(report)?
    } else {
        format!(
            "{} axis {} {:9.4} deg, target {:9.4} deg, {}, {} {}",
            report.time_ns,
            report.axis,
            report.position_deg,
            report.target_deg,
            report.source,
            report.state,
            report.faults.join(", ")
        )
    };
    output::print_text(&(line + "\n"))
}
