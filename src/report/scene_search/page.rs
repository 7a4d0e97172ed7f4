//! The page of a search in a scene.

use glam::DVec3;

use super::Document;
use crate::design::scene_search::Judged;
use crate::report::chart::{LineChart, Series, number};
use crate::report::{FromAbove, Report, figures};
use crate::world::coverage::Coverage;
use crate::world::local_origin::LocalOrigin;

/// What the page shows of the scene.
pub(crate) struct Pictured<'a> {
    pub coverage: &'a Coverage,
    pub bounds_m: [DVec3; 2],
    /// Voxels that some rig saw.
    pub observable: &'a [usize],
    pub origin: LocalOrigin,
    pub made_by: &'a str,
}

/// The answer, what it is compared with, how sure it is, and where it sees.
pub(crate) fn page(document: &Document, pictured: &Pictured<'_>) -> Report {
    let mut page = Report::new("Mounts for a scene", &document.sentence(), pictured.made_by);
    document.warnings.iter().for_each(|warning| page.paragraph(warning));
    mounts(&mut page, document);
    certainty(&mut page, document);
    search(&mut page, document);
    let names: Vec<&str> = document.best.judged.sensors.iter().map(|sensor| sensor.name.as_str()).collect();
    let (coverage, grid) = (pictured.coverage, pictured.coverage.grid());
    let mut above =
        FromAbove::new(pictured.bounds_m, grid.voxel_m, figures::WHO_CLASSES).around(pictured.origin);
    for cell in pictured.observable {
        above.add(grid.centre_m(*cell), figures::who_covers(coverage, *cell));
    }
    page.heading("Who sees what");
    let classes = figures::who_classes(&names, "seen by another mount only");
    figures::from_above(&mut page, &above, &classes, "scene");
    page
}

fn mounts(page: &mut Report, document: &Document) {
    page.heading("The mounts");
    let row = |(name, judged): (&str, &Judged)| {
        vec![
            name.to_owned(),
            document.percent(judged),
            number(judged.unique_voxels as f64, 0),
            format!("{:.1} %", 100.0 * judged.overlap_ratio),
            number(judged.objective, 1),
        ]
    };
    let rows: Vec<_> = document.compared().into_iter().map(row).collect();
    page.table(&["", "seen", "voxels", "overlap", "J"], &rows);
    let row = |sensor: &crate::rig::SensorEntry| {
        let position_m = [sensor.x_m, sensor.y_m, sensor.z_m].map(|value| number(value, 4));
        let angles_deg = [sensor.pitch_deg, sensor.roll_deg].map(|value| number(value, 3));
        let named = [sensor.name.clone(), sensor.model.clone()];
        named.into_iter().chain(position_m).chain(angles_deg).collect()
    };
    let rows: Vec<Vec<String>> = document.best.judged.sensors.iter().map(row).collect();
    page.table(&["sensor", "model", "x m", "y m", "z m", "pitch, deg", "roll, deg"], &rows);
    if !document.by_count.is_empty() {
        page.heading("How many sensors");
        let row = |found: &super::CountDocument| {
            vec![
                found.sensors.to_string(),
                format!("{:.2} %", 100.0 * found.observable_share),
                number(found.unique_voxels as f64, 0),
                number(found.objective, 1),
            ]
        };
        let rows: Vec<_> = document.by_count.iter().map(row).collect();
        page.table(&["sensors", "seen", "voxels", "J"], &rows);
    }
}

fn certainty(page: &mut Report, document: &Document) {
    page.heading("How sure, how flat");
    let answer = &document.answer;
    let rows: Vec<_> = answer
        .flat
        .iter()
        .map(|range| vec![range.coordinate.clone(), number(range.low, 3), number(range.high, 3)])
        .collect();
    page.table(&["loses less than 0.1 %", "from", "to"], &rows);
    page.paragraph(&document.tolerance_line());
    page.paragraph(&document.certainty_line());
    document.model_line().iter().for_each(|line| page.paragraph(line));
}

fn search(page: &mut Report, document: &Document) {
    page.heading("The search");
    let points = document.history.iter().map(|(at, best)| [*at as f64, *best]).collect();
    let chart = LineChart {
        title: "Best exact score over mounts that the model looked at".into(),
        x_label: "mounts".into(),
        y_label: "best score so far".into(),
        series: vec![Series { name: document.method.into(), points }],
        steps: true,
        ..LineChart::default()
    };
    page.figure(&chart.svg(), &document.cost_line());
}
