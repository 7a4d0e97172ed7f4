//! The demo's report page.

use crate::report::chart::{CellClass, LineChart, Series, number};
use crate::report::figures::where_different;
use crate::report::{Report, unfold_box};
use crate::verify::compare::{Agreement, CellKinds, RayClasses, Replayed, Table, cell_kinds};
use crate::verify::judgement::comparison::Verdict;

use super::document::Document;

fn who_saw(document: &Document) -> [CellClass; 4] {
    let name = |sensor: usize| document.rig.get(sensor).map_or("-", |axis| axis.sensor.as_str());
    [
        CellClass::new("c-both", "seen by both"),
        CellClass::new("c-left", format!("{} only", name(0))),
        CellClass::new("c-right", format!("{} only", name(1))),
        CellClass::new("c-none", "not seen"),
    ]
}

/// The page: what was done, whether it agrees, and where it does not.
pub(crate) fn page(document: &Document, replayed: &Replayed) -> Report {
    let agreement = agreement(document);
    let iou = agreement.iou.map_or("nothing to compare".to_owned(), |iou| format!("IoU {iou:.5}"));
    let verdict = match document.compare.verdict {
        Verdict::Matches if !document.problems.is_empty() => {
            "What was recorded is as predicted, but data was lost"
        }
        Verdict::Matches => "The recording covers what was predicted",
        Verdict::Differs => "The recording does not cover what was predicted",
        Verdict::CannotTell => "Too little was recorded to tell",
    };
    let summary = format!("{verdict} ({iou} of recorded and as-driven patches).");
    let mut report = Report::new("Outrigger demo", &summary, &document.command);
    for words in document.problems.iter().chain(&document.compare.words) {
        report.paragraph(words);
    }
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
    report.heading("The three coverages");
    report.table(
        &["cells hit", "count", "what it is"],
        &[
            row3("planned", counts.planned, "optimal mounts, planned path"),
            row3("as driven", counts.as_driven, "measured pitches, recorded trajectory and column times"),
            row3("recorded", counts.recorded, "decoded from the recorded packets"),
        ],
    );
    report.paragraph(&format!(
        "Execution error (planned against as driven): {}. Model error (as driven against recorded): {} of {} points of \
         the walls missed.",
        document.compare.execution.iou.map_or("nothing planned".into(), |iou| format!("IoU {iou:.5}")),
        number(agreement.missed as f64, 0),
        number(document.compare.agreement.as_ref().map_or(0.0, |a| a.patches.points as f64), 0),
    ));
    let figure = |name: &str, value: Option<f64>| {
        vec![name.to_owned(), value.map_or("-".into(), |v| format!("{v:.5}"))]
    };
    report.table(
        &["agreement of as driven and recorded", ""],
        &[
            figure("IoU", agreement.iou),
            figure("kappa", agreement.kappa),
            figure("MCC", agreement.mcc),
            figure("precision", agreement.precision),
            figure("recall", agreement.recall),
        ],
    );
}

fn row3(name: &str, count: u64, what: &str) -> Vec<String> {
    vec![name.to_owned(), number(count as f64, 0), what.to_owned()]
}

fn rays_section(report: &mut Report, document: &Document) {
    report.heading("Every recorded ray");
    let rows: Vec<Vec<String>> = document
        .compare
        .rays
        .iter()
        .map(|(sensor, classes)| {
            let RayClasses { agree, short, long, drop, extra, nothing, unplaced } = classes.classes;
            let counts = [agree, short, long, drop, extra, nothing, unplaced];
            std::iter::once(sensor.clone()).chain(counts.map(|count| number(count as f64, 0))).collect()
        })
        .collect();
    report.table(&["sensor", "agree", "short", "long", "drop", "extra", "nothing", "unplaced"], &rows);
}

fn pictures(report: &mut Report, document: &Document, replayed: &Replayed) {
    let Replayed { as_driven, recorded, .. } = replayed;
    let grid = recorded.grid();
    let (who_saw, where_different) = (who_saw(document), where_different());
    report.heading("Who saw what");
    let bit = |sensor: usize, index: usize| recorded.contains(sensor, index);
    let seen = unfold_box(grid, &|index| {
        let others = (1..recorded.sensors()).any(|sensor| bit(sensor, index));
        Some(match (bit(0, index), others) {
            (true, true) => 0,
            (true, false) => 1,
            (false, true) => 2,
            (false, false) => 3,
        })
    });
    report.maps(
        "Recorded cells, by sensor",
        &seen,
        &who_saw,
        "The hall unfolded: floor and ceiling seen from above with the way ahead up the page, walls from inside.",
    );
    report.heading("Where they differ");
    let kinds = cell_kinds(as_driven, recorded);
    let different = unfold_box(grid, &|index| {
        Some(match kinds[index] {
            CellKinds::Both => 0,
            CellKinds::Missed => 1,
            CellKinds::Unexpected => 2,
            CellKinds::Neither => 3,
        })
    });
    report.maps(
        "Cells predicted against cells recorded",
        &different,
        &where_different,
        "As driven against recorded.",
    );
}

fn search_section(report: &mut Report, document: &Document) {
    let search = &document.optimize;
    report.heading("The search");
    let points = search.history.iter().map(|(evaluation, best)| [*evaluation as f64, *best]).collect();
    let chart = LineChart {
        title: "Best objective so far over evaluations".into(),
        x_label: "evaluations".into(),
        y_label: "best J so far (voxels)".into(),
        series: vec![Series { name: search.method.clone(), points }],
        steps: true,
        ..LineChart::default()
    };
    let caption = format!(
        "J = {} after {} evaluations ({} s): preset {}, the platform walking along its own forward axis.",
        number(search.objective, 1),
        search.evaluations,
        number(search.wall_s, 2),
        search.preset,
    );
    report.figure(&chart.svg(), &caption);
}

fn rig_section(report: &mut Report, document: &Document) {
    report.heading("The rig");
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
        &rows,
    );
}

fn recording_section(report: &mut Report, document: &Document) {
    report.heading("The recording");
    let rows: Vec<Vec<String>> = document
        .recording
        .iter()
        .map(|sensor| {
            let count = |value: u64| number(value as f64, 0);
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
    report.table(&["sensor", "packets sent", "recorded", "lost", "frames", "complete", "points"], &rows);
}
