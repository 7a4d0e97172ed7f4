//! Processors, clock and disk of this machine.

use std::fs;
use std::io::Write as _;
use std::path::Path;
use std::process::Command;
use std::time::Instant;

use super::{Check, CheckState};
use crate::base::files::temporary_near;
use crate::recording::{RecordingError, free_bytes};

/// Written to see how fast the disk is.
const TRIED_BYTES: usize = 128 << 20;
const BLOCK_BYTES: usize = 4 << 20;
/// Two OS1-128 with two returns and a VLP-16 send 43 MB a second (the `daemon` bench).
const GREAT_RIG_MB_S: f64 = 43.0;
/// What a disk must do for each byte that comes.
const SPARE: f64 = 1.2;

pub(crate) fn processors() -> Check {
    let count = std::thread::available_parallelism().map_or(1, usize::from);
    let state = if count > 1 { CheckState::Ok } else { CheckState::Warning };
    Check::new("processors", state, count.to_string(), "receiving and decoding want a core each")
}

pub(crate) fn governor() -> Check {
    let path = "/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor";
    match fs::read_to_string(path) {
        Ok(name) => {
            let state = if name.trim() == "powersave" { CheckState::Warning } else { CheckState::Ok };
            Check::new(
                "cpu governor",
                state,
                name.trim(),
                "`cpupower frequency-set -g performance` while recording",
            )
        }
        Err(_) => Check::new("cpu governor", CheckState::Ok, "none", ""),
    }
}

/// Whether the host's own clock follows another; host times tell sensors and servos apart otherwise by chance.
pub(crate) fn clock() -> Check {
    let output = Command::new("timedatectl").args(["show", "-p", "NTPSynchronized", "--value"]).output();
    let output = output.ok().filter(|output| output.status.success());
    match output.as_ref().map(|output| output.stdout.trim_ascii()) {
        Some(b"yes") => Check::new("host clock", CheckState::Ok, "follows NTP", ""),
        Some(b"no") => Check::new(
            "host clock",
            CheckState::Warning,
            "follows nothing",
            "start systemd-timesyncd or chrony: sensors by PTP or GPS and this host then share one time",
        ),
        _ => Check::new("host clock", CheckState::Unknown, "cannot tell: no timedatectl answers here", ""),
    }
}

/// Space and speed, for what comes now, or else what the configured sensors can send, or else a great rig.
pub(crate) fn disk(
    folder: &Path,
    measured_bytes_s: Option<f64>,
    configured_bytes_s: Option<f64>,
) -> Result<Vec<Check>, RecordingError> {
    // recording makes the folder
    let there = folder.ancestors().find(|above| above.is_dir()).unwrap_or(Path::new("."));
    let free = free_bytes(there)
        .map_err(|source| RecordingError::File { name: there.display().to_string(), source })?;
    let (mb_s, source) = match (measured_bytes_s, configured_bytes_s) {
        (Some(bytes_s), _) => (bytes_s * 1e-6, "that come now"),
        (None, Some(bytes_s)) => (bytes_s * 1e-6, "that the sensors of the rig.toml can send"),
        (None, None) => (GREAT_RIG_MB_S, "of two OS1-128 with two returns"),
    };
    let hours = free as f64 / (mb_s * 1e6 * 3600.0);
    let state = if hours > 1.0 { CheckState::Ok } else { CheckState::Warning };
    let found = format!("{} GiB, {hours:.1} hours of the {mb_s:.1} MB/s {source}", free >> 30);
    let room =
        Check::new("disk space", state, found, "the recorder warns when it runs low and keeps what it has");
    let place = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
    let place = place.display();
    let speed = match written_mb_s(there) {
        Ok(written_mb_s) => {
            let state = if written_mb_s > SPARE * mb_s { CheckState::Ok } else { CheckState::Bad };
            let made = if folder.is_dir() { "" } else { ", which recording will make" };
            let advice = format!("recording needs {mb_s:.0} MB/s and some to spare: take another disk");
            Check::new("disk speed", state, format!("{written_mb_s:.0} MB/s to {place}{made}"), &advice)
        }
        Err(error) => {
            let found = format!("{place}: {error}");
            Check::new("disk speed", CheckState::Bad, found, "recordings cannot be written there")
        }
    };
    Ok(vec![room, speed])
}

/// Speed to the disk itself, not to memory.
fn written_mb_s(folder: &Path) -> std::io::Result<f64> {
    let mut file = temporary_near(&folder.join("speed"))?;
    // what a disk compresses would look faster than packets are
    let mut block = vec![0_u8; BLOCK_BYTES];
    let mut rng = crate::base::rng::Rng::new(1, 0);
    block.chunks_mut(8).for_each(|chunk| chunk.copy_from_slice(&rng.below(u64::MAX).to_le_bytes()));
    let start = Instant::now();
    for _ in 0..TRIED_BYTES / BLOCK_BYTES {
        file.write_all(&block)?;
    }
    file.as_file().sync_all()?;
    Ok(TRIED_BYTES as f64 * 1e-6 / start.elapsed().as_secs_f64())
}
