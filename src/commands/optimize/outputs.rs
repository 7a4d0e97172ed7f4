//! What `optimize` writes beside its document: mount file, CSV, page.

use std::path::Path;

use anyhow::Context as _;

use super::{Document, summary};
use crate::report::chart::{LineChart, Series, number};

use crate::base::files;
use crate::design::optimize::MountProblem;
use crate::report::Report;
use crate::report::figures;
use crate::rig::{MountFile, SensorEntry};
use crate::simulate::published::Placement;

/// The mount file of these masters.
pub fn mount_file(problem: &MountProblem, masters: &[Placement], objective: f64) -> MountFile {
    let experiment = problem.objective().simulator().experiment();
    let entry = |(index, sensor): (usize, Placement)| SensorEntry {
        name: sensor_name(index, experiment.mirror, masters.len()),
        model: experiment.model_of(&sensor).into(),
        x_m: sensor.x_m,
        y_m: sensor.y_m,
        z_m: sensor.z_m,
        pitch_deg: sensor.pitch_deg,
        roll_deg: sensor.roll_deg,
    };
    let mut file = MountFile::new(experiment.sensors(masters).into_iter().enumerate().map(entry).collect());
    file.masters = Some(masters.iter().map(|master| (*master).into()).collect());
    if experiment.is_mixed() {
        let models = masters.iter().map(|master| experiment.model_of(master).to_owned());
        file.master_models = Some(models.collect());
    }
    file.preset = Some(experiment.name());
    file.objective = Some(objective);
    file.found_with = Some(Box::new(problem.objective().settings()));
    file
}

/// `master` and `mirrored`, numbered where there are several.
fn sensor_name(index: usize, is_mirrored: bool, masters: usize) -> String {
    let (master, side) = match is_mirrored {
        true => (index / 2, if index.is_multiple_of(2) { "master" } else { "mirrored" }),
        false => (index, "sensor"),
    };
    if masters == 1 { side.into() } else { format!("{side}-{}", master + 1) }
}

/// One line per sensor.
pub fn write_csv(path: &Path, file: &MountFile, document: &Document) -> anyhow::Result<()> {
    let mut text = String::from("sensor,model,x_m,y_m,z_m,pitch_deg,roll_deg,voxels,unique_voxels\r\n");
    let evaluation = &document.best.evaluation;
    for (index, sensor) in file.sensors.iter().enumerate() {
        text += &format!(
            "{},{},{},{},{},{},{},{},{}\r\n",
            sensor.name,
            sensor.model,
            sensor.x_m,
            sensor.y_m,
            sensor.z_m,
            sensor.pitch_deg,
            sensor.roll_deg,
            evaluation.per_sensor_voxels[index],
            evaluation.unique_per_sensor[index]
        );
    }
    files::write_whole(path, text.as_bytes()).with_context(|| path.display().to_string())
}

/// Convergence, mounts and coverage on one page.
pub fn write_report(
    path: &Path,
    problem: &MountProblem,
    file: &MountFile,
    masters: &[Placement],
    document: &Document,
) -> anyhow::Result<()> {
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
            summary::search(document)
        ),
        &document.command,
    );
    mounts(&mut page, file, document);
    convergence(&mut page, document);
    let simulator = problem.objective().simulator();
    let seen = simulator.see(&simulator.experiment().sensors(masters))?.coverage;
    let names: Vec<&str> = file.sensors.iter().map(|sensor| sensor.name.as_str()).collect();
    figures::unfolded(&mut page, &seen, &names);
    page.write(path).with_context(|| path.display().to_string())
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
        summary::verdicts(document).into_iter().map(|(title, words)| vec![title.to_owned(), words]).collect();
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
