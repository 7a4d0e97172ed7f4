//! What is missing in a recording, why it gave nothing, and what would help.

use std::fmt::Write as _;
use std::path::PathBuf;

use sensors::capture::CaptureCounters;
use sensors::router::{Family, Router, Sensor, Unclaimed};

use super::bags::TopicCount;
use super::sensor_ids;
use super::source::{Ending, Recording};
use crate::live::watch::correction_words;

/// Lists what the file holds, and says what to do.
pub(crate) fn why_nothing(recording: &Recording, router: &Router, ending: &Ending) -> String {
    let counters = &ending.counters;
    let mut text = format!("{}: no LiDAR data was decoded.", recording.name());
    let unclaimed: Vec<&Unclaimed> = router.unclaimed().collect();
    if !ending.topics.is_empty() && counters.datagrams == 0 {
        text.push_str(
            " It has no topic with packets of an Ouster or a Velodyne that can be read; its topics:",
        );
        for TopicCount { topic, kind, messages, .. } in &ending.topics {
            let _ = write!(text, "\n  {topic} ({kind}): {messages} messages");
        }
        ending.notices.iter().for_each(|notice| text.push_str(&format!("\n  {notice}")));
    } else if counters.frames == 0 {
        text.push_str(" The file holds no packets at all.");
    } else if counters.datagrams == 0 {
        text.push_str(" It holds no whole UDP packet.");
    } else {
        text.push_str(" It holds:");
        for Unclaimed { port, length, packets, reason, .. } in &unclaimed {
            let _ = write!(text, "\n  {packets} packets of {length} bytes to port {port}: {reason}");
        }
        for words in router.sensors().iter().filter_map(Sensor::only_positions) {
            let _ = write!(text, "\n  {words}");
        }
    }
    for sensor in router.sensors() {
        if let Some(damage) = sensor.first_damage() {
            let malformed = sensor.stats().malformed;
            let _ = write!(
                text,
                "\n  {malformed} malformed packets of {}; the first: {damage}",
                sensor.product()
            );
        }
    }
    if let Some(session) = recording.session_around() {
        let _ = write!(
            text,
            "\n  it lies in the session {}, which has metadata: give that folder",
            session.display()
        );
    }
    for (count, what) in oddities(counters) {
        let _ = write!(text, "\n  {count} {what}");
    }
    for loss in ending.losses() {
        let _ = write!(text, "\n  {loss}");
    }
    if needs_metadata(router) {
        let nearby = nearby_metadata(recording, router);
        for path in &nearby {
            let _ = write!(text, "\n{} lies next to it: try --meta {}", path.display(), path.display());
        }
        let has_some = router.sensors().iter().any(|sensor| matches!(sensor.family(), Family::Ouster(_)));
        if nearby.is_empty() && !has_some {
            text.push_str(
                "\nAn Ouster recording needs its sensor's metadata: save http://SENSOR/api/v1/sensor/metadata as a file",
            );
        }
    }
    text
}

/// Whether other metadata than those given, if any, would help.
fn needs_metadata(router: &Router) -> bool {
    router.unclaimed().any(|entry| entry.needs_metadata)
        || router.sensors().iter().any(|sensor| sensor.misread_bytes().is_some())
}

/// Metadata files that lie next to a recording and would read what those given do not, of sensors with serial numbers that
/// were not found, or named like the recording.
pub(crate) fn nearby_metadata(recording: &Recording, router: &Router) -> Vec<PathBuf> {
    if !needs_metadata(router) {
        return Vec::new();
    }
    let unclaimed = router.unclaimed().filter(|entry| entry.is_ouster_lidar).map(|entry| entry.length);
    let misread = router.sensors().iter().filter_map(Sensor::misread_bytes);
    let serials_misread = router.sensors().iter().filter(|sensor| sensor.misread_bytes().is_some());
    let serials_misread = serials_misread.filter_map(|sensor| sensor.serial().parse().ok());
    let serials: Vec<u64> =
        router.unclaimed().filter_map(|entry| entry.serial).chain(serials_misread).collect();
    recording.nearby_metadata(&serials, &unclaimed.chain(misread).collect::<Vec<_>>())
}

/// Calibrations that serve no sensor, and sensors that are nothing without one.
pub(crate) fn beam_notices(router: &Router) -> Vec<String> {
    let ids = sensor_ids::ids(router);
    let off =
        router.sensors().iter().zip(&ids).filter_map(|(sensor, id)| Some((id, sensor.beams_are_off()?)));
    let off = off.map(|(id, what)| format!("{id}: {what}"));
    router.unused_calibrations().into_iter().chain(off).collect()
}

/// Sensor data that no sensor took.
pub(crate) fn unknown_sources(router: &Router) -> impl Iterator<Item = String> {
    router.unclaimed().filter(|entry| entry.is_sensor_data).map(|entry| {
        let Unclaimed { port, length, packets, reason, .. } = entry;
        format!("{packets} packets of {length} bytes to port {port}: {reason}")
    })
}

/// What a file holds besides UDP datagrams; losses are [`Ending::losses`].
pub(crate) fn oddities(counters: &CaptureCounters) -> impl Iterator<Item = (u64, &'static str)> {
    [
        (counters.not_ip, "frames that are not IP"),
        (counters.not_udp, "IP packets that are not UDP"),
        (counters.other_link_type, "frames of a link type that is not supported"),
        (counters.malformed, "frames with malformed headers"),
        (counters.fragments_duplicated, "fragments that came twice"),
    ]
    .into_iter()
    .filter(|(count, _)| *count > 0)
}

/// Packets of a sensor that its decoder could not use.
pub(crate) fn sensor_losses(id: &str, sensor: &Sensor) -> Vec<String> {
    let counters = sensor.stats();
    let rival = sensor.rival().zip(sensor.two_sources());
    let rival = rival.map(|(rival, words)| format!("{id}: {} packets: {words}", rival.packets));
    let mixed = sensor.mixed().map(|words| format!("{id}: {words}"));
    let counted = [
        (counters.lost_packets, "packets never came"),
        (counters.late, "packets came too late"),
        (counters.malformed, "packets are malformed"),
        (counters.crc_errors, "packets fail their checksum"),
        (counters.bad_blocks, "blocks are damaged; the rest of their packets was decoded"),
    ]
    .into_iter()
    .filter(|(count, _)| *count > 0)
    .map(|(count, what)| format!("{id}: {count} {what}"));
    counted.chain(rival).chain(mixed).collect()
}

/// What differs from the specification or from what one expects, and costs nothing.
pub(crate) fn sensor_notes(id: &str, sensor: &Sensor) -> Vec<String> {
    let counters = sensor.stats();
    let corrected = sensor.corrections().iter();
    let corrected = corrected.map(|correction| format!("{id}: {}", correction_words(sensor, correction)));
    let counted = [
        (counters.odd_stamps, "packets have a time stamp that contradicts their neighbours, which date them"),
        (
            counters.pauses,
            "pauses of seconds or more, by the host's clock too: nothing is known to be lost in them",
        ),
    ];
    let counted = counted.into_iter().filter(|(count, _)| *count > 0);
    let counted = counted.map(|(count, what)| format!("{id}: {count} {what}"));
    corrected.chain(counted).chain(sensor.does_not_turn().map(|words| format!("{id}: {words}"))).collect()
}
