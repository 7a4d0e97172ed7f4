//! Why a recording gave nothing, and what would help.

use std::fmt::Write as _;

use sensors::capture::CaptureCounters;
use sensors::router::{Router, Unclaimed};

use super::recording::Recording;

/// Lists what the file holds, and says what to do.
pub fn why_nothing(recording: &Recording, router: &Router, counters: &CaptureCounters) -> String {
    let mut text = format!("{}: no LiDAR data was decoded.", recording.name());
    let unclaimed: Vec<&Unclaimed> = router.unclaimed().collect();
    if counters.frames == 0 {
        text.push_str(" The file holds no packets at all.");
    } else if unclaimed.is_empty() {
        text.push_str(" It holds no UDP packets.");
    } else {
        text.push_str(" It holds:");
        for Unclaimed { port, length, packets, reason, .. } in &unclaimed {
            let _ = write!(text, "\n  {packets} packets of {length} bytes to port {port}: {reason}");
        }
    }
    for (count, what) in [
        (counters.not_ip, "frames that are not IP"),
        (counters.not_udp, "IP packets that are not UDP"),
        (counters.other_link_type, "frames of a link type that is not supported"),
        (counters.malformed, "frames with malformed headers"),
        (
            counters.cut_by_snap_length,
            "frames cut short by the recorder's snap length: record again with -s 0",
        ),
        (counters.fragments_incomplete, "datagrams of which fragments never came"),
    ] {
        if count > 0 {
            let _ = write!(text, "\n  {count} {what}");
        }
    }
    if unclaimed.iter().any(|entry| entry.needs_metadata) {
        let serials: Vec<u64> = unclaimed.iter().filter_map(|entry| entry.serial).collect();
        let beside = recording.metadata_beside(&serials);
        for path in &beside {
            let _ = write!(text, "\n{} lies beside it: try --meta {}", path.display(), path.display());
        }
        if beside.is_empty() {
            text.push_str(
                "\nAn Ouster recording needs its sensor's metadata: save http://SENSOR/api/v1/sensor/metadata as a file",
            );
        }
    }
    text
}
