//! Maps and charts of the demo's report page.

use super::document::Document;
use crate::report::chart::{CellClass, LineChart, Series, number};
use crate::report::figures::where_different;
use crate::report::{Report, unfold_box};
use crate::verify::compare::{CellKinds, Replayed, cell_kinds};

fn who_saw(document: &Document) -> [CellClass; 4] {
    let name = |sensor: usize| document.rig.get(sensor).map_or("-", |axis| axis.sensor.as_str());
    [
        CellClass::new("c-both", "seen by both"),
        CellClass::new("c-left", format!("{} only", name(0))),
        CellClass::new("c-right", format!("{} only", name(1))),
        CellClass::new("c-none", "not seen"),
    ]
}

pub(super) fn pictures(report: &mut Report, document: &Document, replayed: &Replayed) {
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
        "The hall unfolded: floor and ceiling seen from above with the walking direction up the page, walls from inside.",
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

pub(super) fn search_section(report: &mut Report, document: &Document) {
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
    report.chart(&chart.svg(), &caption);
}
