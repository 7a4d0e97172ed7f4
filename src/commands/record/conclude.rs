//! What a recording holds and lost, when it ends.

use super::watch::say;
use crate::commands::{Context, Outcome, output};
use crate::live::receive::Monitor;
use crate::recording::{Manifest, Parts};

pub(super) fn conclude(
    manifest: &Manifest,
    monitor: &Monitor,
    parts: &Parts,
    mut warnings: Vec<String>,
    context: Context,
) -> anyhow::Result<Outcome> {
    warnings.extend(parts.displaced.iter().cloned());
    let dir = parts.dir();
    for socket in monitor.sockets() {
        if let (foreign @ 1.., Some(first)) =
            (socket.counters.foreign_source, socket.counters.first_foreign_source)
        {
            let named = socket.sensors.join(", ");
            warnings.push(format!(
                "{foreign} packets on {} came from others than {named}, first {first}",
                socket.address
            ));
        }
    }
    let came = monitor.sensors().into_iter().map(|counters| counters.packets);
    let silent = manifest.sensors.iter().zip(came).filter(|(_, came)| *came == 0);
    let silent: Vec<String> =
        silent.map(|(sensor, _)| format!("{}: not one packet came", sensor.name)).collect();
    let mut losses = manifest.losses;
    losses.add(parts.losses());
    let lost = losses.total() > 0 || !silent.is_empty() || !parts.displaced.is_empty();
    warnings.extend(silent);
    if context.json {
        output::print_json(&serde_json::json!({
            "session": dir, "complete": manifest.complete, "sensors": manifest.sensors, "sockets": manifest.sockets,
            "losses": losses, "files": manifest.files, "warnings": warnings,
        }))?;
    } else {
        for sensor in &manifest.sensors {
            say(&format!("{}: {} packets, {} lost", sensor.name, sensor.packets, sensor.losses.total()));
        }
        for warning in &warnings {
            say(&format!("warning: {warning}"));
        }
        if losses.total() > 0 {
            let (kernel, queue) = (losses.kernel_dropped, losses.queue_dropped);
            let deleted = match losses.deleted {
                0 => String::new(),
                deleted => format!(", {deleted} in a deleted file"),
            };
            say(&format!("lost: {kernel} in the kernel's buffer, {queue} in the queue to the disk{deleted}"));
        }
        output::print_text(&format!("{}\n", dir.display()))?;
    }
    Ok(if lost { Outcome::DataLost } else { Outcome::Done })
}
