//! The demo's report.

use crate::report::chart::{count, number};
use crate::report::comparison::in_figures;
use crate::report::{Report, compared, orbit};
use crate::verify::compare::{Agreement, Gate, RayClasses, Replayed, Table};
use crate::world::local_origin::LocalOrigin;
use crate::world::scene::Scene;
use crate::world::trajectory::Trajectory;

use super::document::Document;
use super::pictures::{pictures, search_section};

/// What was done, whether it agrees, and where it does not.
pub(crate) fn report(
    document: &Document,
    replayed: &Replayed,
    scene: &Scene,
    trajectory: &Trajectory,
) -> Report {
    let mut report = compared("Outrigger demo", &document.compare, &document.problems);
    report.orbit(
        orbit::compared(replayed, scene, trajectory, Gate::default().agree_within_m, LocalOrigin::default()),
        "Recorded rays on the hall, the rig where the trajectory begins.",
    );
    report.heading("Findings");
    report.notices(&document.problems);
    report.findings(&document.compare.words);
    report.heading("In figures");
    in_figures(&mut report, &document.compare);
    coverage_section(&mut report, document);
    rays_section(&mut report, document);
    pictures(&mut report, document, replayed);
    search_section(&mut report, document);
    rig_section(&mut report, document);
    recording_section(&mut report, document);
    report
}

/// Of patches, as driven against recorded.
fn agreement(document: &Document) -> Agreement {
    let measured = document.compare.agreement.as_ref();
    measured.map_or_else(|| Table::default().agreement(), |measured| measured.patches.agreement)
}

fn coverage_section(report: &mut Report, document: &Document) {
    let counts = &document.compare.coverage;
    let agreement = agreement(document);
    report.fold("The three coverages", "planned, as driven, recorded");
    report.table(
        &["cells hit", "count", "what it is"],
        vec![
            row3("planned", counts.planned, "optimal mounts, planned path"),
            row3("as driven", counts.as_driven, "measured pitches, recorded trajectory and column times"),
            row3("recorded", counts.recorded, "decoded from the recorded packets"),
        ],
    );
    report.note(format!(
        "Execution error (planned against as driven): {}. Model error (as driven against recorded): {} of {} points of \
         the walls missed.",
        document.compare.execution.iou.map_or("nothing planned".into(), |iou| format!("IoU {iou:.5}")),
        count(agreement.missed),
        number(document.compare.agreement.as_ref().map_or(0.0, |a| a.patches.points as f64), 0),
    ));
    let figure = |name: &str, value: Option<f64>| {
        vec![name.to_owned(), value.map_or("-".into(), |v| format!("{v:.5}"))]
    };
    report.table(
        &["agreement of as driven and recorded", ""],
        vec![
            figure("IoU", agreement.iou),
            figure("kappa", agreement.kappa),
            figure("MCC", agreement.mcc),
            figure("precision", agreement.precision),
            figure("recall", agreement.recall),
        ],
    );
}

fn row3(name: &str, cells: u64, what: &str) -> Vec<String> {
    vec![name.to_owned(), count(cells), what.to_owned()]
}

fn rays_section(report: &mut Report, document: &Document) {
    report.fold("Every recorded ray", "by sensor");
    let rows: Vec<Vec<String>> = document
        .compare
        .rays
        .iter()
        .map(|(sensor, classes)| {
            let RayClasses { agree, short, long, drop, extra, nothing, unplaced } = classes.classes;
            let counts = [agree, short, long, drop, extra, nothing, unplaced];
            std::iter::once(sensor.clone()).chain(counts.map(count)).collect()
        })
        .collect();
    report.table(&["sensor", "agree", "short", "long", "drop", "extra", "nothing", "unplaced"], rows);
}

fn rig_section(report: &mut Report, document: &Document) {
    report.fold("The rig", "asked and measured pitches");
    let rows: Vec<Vec<String>> = document
        .rig
        .iter()
        .map(|axis| {
            let degrees = |value: f64| format!("{value:.3}");
            vec![
                axis.sensor.clone(),
                degrees(axis.target_pitch_deg),
                degrees(axis.measured_pitch_deg),
                format!("{:.4}", axis.measured_span_deg),
                axis.reports.to_string(),
            ]
        })
        .collect();
    report.table(
        &["sensor", "asked pitch, deg", "measured pitch, deg", "moved while recording, deg", "reports"],
        rows,
    );
}

fn recording_section(report: &mut Report, document: &Document) {
    report.fold("The recording", "packets sent and recorded");
    let rows: Vec<Vec<String>> = document
        .recording
        .iter()
        .map(|sensor| {
            vec![
                sensor.sensor.clone(),
                count(sensor.packets_sent),
                count(sensor.packets_recorded),
                count(sensor.lost),
                count(sensor.frames),
                count(sensor.complete_frames),
                count(sensor.points),
            ]
        })
        .collect();
    report.table(&["sensor", "packets sent", "recorded", "lost", "frames", "complete", "points"], rows);
}
