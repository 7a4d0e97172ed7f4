//! The report of what a recording holds.

use sensors::DecodeStats;

use super::Report;
use crate::base::numbers::counted;
use crate::live::watch::SensorReport;
use crate::recording::flows::FlowReport;
use crate::recording::inspection::Document;
use crate::recording::unread;

/// Sensors, streams, what is missing and what would help.
pub(crate) fn report(document: &Document) -> Report {
    let counters = &document.capture_counters;
    let held = match document.duration_s {
        Some(duration_s) => format!("{} datagrams in {duration_s:.3} s", counters.datagrams),
        None if !document.topics.is_empty() => format!("no packets in {} messages", counters.frames),
        None => format!("no UDP datagrams in {} frames", counters.frames),
    };
    let mut report = Report::new("What a recording holds", &format!("{}: {held}", document.capture));
    for count in &document.topics {
        let packets = if count.packets > 0 { format!(", {} packets", count.packets) } else { String::new() };
        report.figure(&count.topic, format!("({}) {} messages{packets}", count.kind, count.messages));
    }
    document.host_clock.iter().for_each(|step| report.note(&step.words));
    document.sensors.iter().for_each(|sensor| sensor_section(&mut report, sensor));
    report.heading("Streams");
    document.flows.iter().for_each(|flow| report.note(stream(flow)));
    let oddities = unread::oddities(counters).map(|(count, what)| format!("{count} {what}")).collect();
    for (title, texts) in [
        ("Missing", &document.losses),
        ("To note", &document.notes),
        ("What would help", &document.advice),
        ("Also in the file", &oddities),
    ] {
        report.heading(title);
        report.findings(texts);
    }
    report
}

fn stream(flow: &FlowReport) -> String {
    let rate = flow.rate_hz.map_or(String::new(), |rate_hz| format!(", {rate_hz:.1}/s"));
    let serial = flow.serial.map_or(String::new(), |serial| format!(", sensor {serial}"));
    let mode = flow.columns_per_frame.map_or(String::new(), |columns| format!(", {columns} columns"));
    let FlowReport { source, length, packets, looks_like, .. } = flow;
    let destination = match flow.destination.as_str() {
        "" => String::new(),
        receiver => format!(" -> {receiver}"),
    };
    let assignment = flow.assignment();
    format!("{source}{destination}: {packets} x {length} bytes{rate}: {looks_like}{serial}{mode}{assignment}")
}

fn sensor_section(report: &mut Report, sensor: &SensorReport) {
    let known = |what: &str, value: &str| (!value.is_empty()).then(|| format!("{what} {value}"));
    let source = sensor.source.as_deref().unwrap_or_default();
    let about = [known("serial", &sensor.serial), known("firmware", &sensor.firmware), known("from", source)];
    let described = [format!("{} {}", sensor.vendor, sensor.model), sensor.format.clone()];
    let described: Vec<String> = described.into_iter().chain(about.into_iter().flatten()).collect();
    report.heading(&format!("{}: {}", sensor.id, described.join(", ")));
    let rate = sensor.frame_rate_hz.map_or(String::new(), |rate_hz| format!(", {rate_hz:.2} Hz"));
    let points = sensor.points_per_frame.map_or(String::new(), |points| format!(", {points:.0} points each"));
    let second = sensor
        .points_second_per_frame
        .map_or(String::new(), |points| format!(" and {points:.0} second returns"));
    let frames = counted(sensor.frames, "frame");
    report.figure("frames", format!("{frames}, {} whole{rate}{points}{second}", sensor.complete_frames));
    report.figure("beams", &sensor.beams);
    let counters = &sensor.counters;
    report.figure(
        "packets",
        format!(
            "{}: {}, {} foreign; {} restarts",
            counters.packets,
            losses(counters),
            counters.foreign,
            counters.init_id_changes,
        ),
    );
    for (count, what) in [
        (sensor.imu_samples, "inertial samples"),
        (sensor.position_packets, "position packets"),
        (sensor.zone_reports, "zone reports"),
    ] {
        report.figures((count > 0).then(|| (what, count.to_string())));
    }
    if let Some(clock) = &sensor.clock {
        let mode = sensor.timestamp_mode.as_ref().map_or(String::new(), |mode| format!("({mode}) "));
        report.figure("clock", format!("{mode}{}", clock.text()));
    }
    let pulse = sensor.pulse.map(|pulse| ("pulse per second", format!("{pulse:?}").to_lowercase()));
    report.figures(pulse);
    report.figures(sensor.hours_in_use.map(|hours| ("in use", format!("{hours} hours"))));
    if let Some(sentence) = &sensor.gps_sentence {
        let valid = match sensor.gps_valid {
            Some(true) => "valid",
            Some(false) => "no fix",
            None => "unreadable",
        };
        report.figure("GPS", format!("({valid}) {sentence}"));
    }
    if !sensor.silent_beams.is_empty() {
        let rings: Vec<String> = sensor.silent_beams.iter().map(u16::to_string).collect();
        let rings = rings.join(", ");
        report.note(format!("beams that never return, and their neighbours do: ring {rings}"));
    }
    sensor.remark.iter().chain(&sensor.warnings).for_each(|remark| report.note(remark));
}

/// What happened to the packets of a sensor.
pub(super) fn losses(counters: &DecodeStats) -> String {
    format!(
        "{} lost, {} duplicated, {} reordered, {} late, {} malformed, {} with a wrong checksum",
        counters.lost_packets,
        counters.duplicated,
        counters.reordered,
        counters.late,
        counters.malformed,
        counters.crc_errors,
    )
}
