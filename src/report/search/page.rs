//! The page of a search.

use super::Document;
use crate::design::objective::Objective;
use crate::report::chart::{LineChart, Series, number};
use crate::report::{Report, figures, orbit};
use crate::rig::{MountFile, Rig, SensorEntry};
use crate::world::coverage::Coverage;

/// Convergence, mounts and coverage on one page.
pub(crate) fn page(
    document: &Document,
    file: &MountFile,
    coverage: &Coverage,
    (objective, rig): (&Objective, &Rig),
) -> Report {
    let evaluation = &document.best.evaluation;
    let mut page = Report::new(
        &format!("Mounts for {}", document.preset),
        &format!(
            "{} sensors see {} of {} voxels that can be hit. Searched by {}; J = {}, {}.",
            evaluation.sensors,
            number(evaluation.unique_voxels as f64, 0),
            number(evaluation.reachable_voxels as f64, 0),
            document.method.name(),
            number(evaluation.objective, 1),
            document.found_at()
        ),
        &document.command,
    );
    page.orbit(
        orbit::published(objective, rig, coverage),
        "The box of the experiment; the rig in the middle of its path, its fields of view cut off.",
    );
    mounts(&mut page, file, document);
    convergence(&mut page, document);
    let names: Vec<&str> = file.sensors.iter().map(|sensor| sensor.name.as_str()).collect();
    figures::unfolded(&mut page, coverage, &names);
    page
}

fn mounts(page: &mut Report, file: &MountFile, document: &Document) {
    let evaluation = &document.best.evaluation;
    page.heading("The mounts");
    let row = |(index, sensor): (usize, &SensorEntry)| {
        vec![
            sensor.name.clone(),
            sensor.model.clone(),
            number(sensor.x_m, 4),
            number(sensor.y_m, 4),
            number(sensor.z_m, 4),
            number(sensor.pitch_deg, 3),
            number(sensor.roll_deg, 3),
            number(evaluation.per_sensor_voxels[index] as f64, 0),
            number(evaluation.unique_per_sensor[index] as f64, 0),
        ]
    };
    let rows: Vec<_> = file.sensors.iter().enumerate().map(row).collect();
    page.table(
        &["sensor", "model", "x m", "y m", "z m", "pitch, deg", "roll, deg", "voxels", "seen by it alone"],
        &rows,
    );
    let terms = &evaluation.terms;
    let term = |name: &str, value: f64| vec![name.to_owned(), number(value, 1)];
    page.table(
        &["term of J", ""],
        &[
            term("coverage", terms.coverage),
            term("overlap", terms.overlap),
            term("angular", terms.angular),
            term("cost", terms.cost),
            term("registration", terms.registration),
        ],
    );
    let verdicts: Vec<_> =
        document.verdicts().into_iter().map(|(title, words)| vec![title.to_owned(), words]).collect();
    if !verdicts.is_empty() {
        page.table(&["this mount", ""], &verdicts);
    }
}

fn convergence(page: &mut Report, document: &Document) {
    page.heading("The search");
    let points = document.history.iter().filter_map(|(at, best)| Some([*at as f64, (*best)?])).collect();
    let chart = LineChart {
        title: "Best score so far over evaluations".into(),
        x_label: "evaluations".into(),
        y_label: "best score so far".into(),
        series: vec![Series { name: document.method.name().into(), points }],
        steps: true,
        ..LineChart::default()
    };
    let caption = format!(
        "{} rays in {} s, {} s of them the search's own.",
        number(document.rays as f64, 0),
        number(document.wall_s, 3),
        number(document.search_s, 3)
    );
    page.figure(&chart.svg(), &caption);
}
