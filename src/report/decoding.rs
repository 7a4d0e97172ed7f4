//! The report of what was decoded.

use super::Report;
use super::inspection::losses;
use crate::base::numbers::counted;
use crate::recording::decoding::{Document, FrameRow, SensorReport};

/// A section for each sensor; its frames are a detail.
pub(crate) fn report(document: &Document) -> Report {
    let mut report = Report::new("What was decoded", "");
    for sensor in &document.sensors {
        let about = |words: &str, value: &str| match value {
            "" => String::new(),
            value => format!(", {words} {value}"),
        };
        let serial = about("serial", &sensor.serial);
        let source = about("from", sensor.source.as_deref().unwrap_or_default());
        let SensorReport { id, vendor, model, format, beams, .. } = sensor;
        report.heading(&format!("{id}: {vendor} {model}, {format}{serial}{source}, beams {beams}"));
        let points = sensor.totals.points + sensor.totals.points_second;
        report
            .figure("decoded", format!("{}, {points} points", counted(sensor.totals.frames as u64, "frame")));
        let counters = &sensor.counters;
        // clouds of a bag come without packets
        if counters.packets > 0 {
            report.figure("packets", format!("{}, {}", counters.packets, losses(counters)));
        }
        report.figures(sensor.clock.clone().map(|clock| ("clock", clock)));
        report.detail("");
        report.table(
            &["frame", "points", "second", "columns", "packets", ""],
            sensor.frames.iter().map(frame_row).collect(),
        );
    }
    report.heading("");
    report.figures(
        document.files.iter().map(|file| ("wrote", format!("{} ({} points)", file.path, file.points))),
    );
    report
}

fn frame_row(frame: &FrameRow) -> Vec<String> {
    let expected = frame.expected_packets.map_or(String::new(), |packets| format!("/{packets}"));
    vec![
        frame.frame_id.to_string(),
        frame.points.to_string(),
        frame.points_second.map_or("-".into(), |points| points.to_string()),
        frame.valid_columns.to_string(),
        format!("{}{expected}", frame.packets),
        if frame.complete { String::new() } else { "incomplete".into() },
    ]
}
