//! The report of a search.

use super::Document;
use crate::design::objective::Objective;
use crate::report::chart::{LineChart, Series, count, number};
use crate::report::{Report, figures, orbit};
use crate::rig::{MountFile, Rig, SensorEntry};
use crate::world::coverage::Coverage;

/// What the pictures of a page show.
pub(crate) struct Pictures<'a> {
    pub objective: &'a Objective,
    pub rig: &'a Rig,
    pub coverage: &'a Coverage,
}

/// Mounts and search; with coverage, for a page.
pub(crate) fn report(document: &Document, file: &MountFile, pictures: Option<&Pictures<'_>>) -> Report {
    let evaluation = &document.best.evaluation;
    let mut report = Report::new(
        &format!("Mounts for {}", document.preset),
        &format!(
            "{}: {} sensors see {} of {} voxels that can be hit. Searched by {}; J = {}, {}.",
            document.preset,
            evaluation.sensors,
            count(evaluation.unique_voxels),
            count(evaluation.reachable_voxels),
            document.method.name(),
            number(evaluation.objective, 2),
            document.found_at()
        ),
    );
    report.figure("path", document.path.name());
    report.figure("overlap", format!("{:.2} % of the voxels seen", 100.0 * evaluation.overlap_ratio));
    report.figures(document.verdicts());
    if let Some(Pictures { objective, rig, coverage }) = pictures {
        report.orbit(
            orbit::published(objective, rig, coverage),
            "The box of the experiment; the rig in the middle of its path, its fields of view cut off.",
        );
    }
    mounts(&mut report, file, document);
    convergence(&mut report, document);
    if let Some(Pictures { coverage, .. }) = pictures {
        let names: Vec<&str> = file.sensors.iter().map(|sensor| sensor.name.as_str()).collect();
        figures::unfolded(&mut report, coverage, &names);
    }
    report
}

fn mounts(report: &mut Report, file: &MountFile, document: &Document) {
    let evaluation = &document.best.evaluation;
    report.heading("The mounts");
    let row = |(index, sensor): (usize, &SensorEntry)| {
        vec![
            sensor.name.clone(),
            sensor.model.clone(),
            number(sensor.x_m, 4),
            number(sensor.y_m, 4),
            number(sensor.z_m, 4),
            number(sensor.pitch_deg, 3),
            number(sensor.roll_deg, 3),
            count(evaluation.per_sensor_voxels[index]),
            count(evaluation.unique_per_sensor[index]),
        ]
    };
    report.table(
        &["sensor", "model", "x, m", "y, m", "z, m", "pitch, deg", "roll, deg", "voxels", "alone"],
        file.sensors.iter().enumerate().map(row).collect(),
    );
    report.detail("The terms of J");
    figures::terms_table(report, &evaluation.terms);
}

fn convergence(report: &mut Report, document: &Document) {
    report.heading("The search");
    let [all_s, objective_s, search_s] =
        [document.wall_s, document.objective_s, document.search_s].map(|seconds| number(seconds, 3));
    let rays = count(document.rays);
    report.figure(
        "cost",
        format!("{rays} rays in {all_s} s: objective {objective_s} s, search itself {search_s} s"),
    );
    let points = document.history.iter().filter_map(|(at, best)| Some([*at as f64, (*best)?])).collect();
    let chart = LineChart {
        title: "Best score so far over evaluations".into(),
        x_label: "evaluations".into(),
        y_label: "best score so far".into(),
        series: vec![Series { name: document.method.name().into(), points }],
        steps: true,
        ..LineChart::default()
    };
    report.chart(&chart.svg(), "The best J of all mounts tried until then.");
}
