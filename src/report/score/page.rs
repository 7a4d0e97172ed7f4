//! The page of a score.

use super::Document;
use crate::design::fidelity::MountFidelity;
use crate::report::chart::number;
use crate::report::{Report, figures};
use crate::world::coverage::Coverage;

/// What was scored, term by term, and who saw what.
pub(crate) fn page(document: &Document, coverage: &Coverage, made_by: &str) -> Report {
    let evaluation = &document.evaluation;
    let share = 100.0 * evaluation.unique_voxels as f64 / evaluation.reachable_voxels as f64;
    let gain = document.baselines.as_ref().map_or(String::new(), |baselines| {
        format!(
            ", {} more than the best single sensor",
            number(baselines.best_single.seen.gain_voxels as f64, 0)
        )
    });
    let summary = format!(
        "J = {}: {} sensors see {} of {} voxels that can be hit ({share:.1} %){gain}.",
        number(evaluation.objective, 1),
        evaluation.sensors,
        number(evaluation.unique_voxels as f64, 0),
        number(evaluation.reachable_voxels as f64, 0),
    );
    let mut report = Report::new(&format!("Score in {}", document.preset), &summary, made_by);
    for violation in &evaluation.violations {
        report.paragraph(&format!("Not allowed: {violation}."));
    }
    for pair in &document.touching {
        report.paragraph(&format!("Cannot be built: {pair}."));
    }
    terms(&mut report, document);
    sensors(&mut report, document);
    baselines(&mut report, document);
    let names: Vec<String> = (1..=coverage.sensors()).map(|sensor| format!("sensor {sensor}")).collect();
    figures::unfolded(&mut report, coverage, &names.iter().map(String::as_str).collect::<Vec<_>>());
    report.heading("Blind spots");
    figures::blind_spot_table(&mut report, &document.blind_spots, document.voxel_m);
    let least = document.registration_path.iter().map(|[at_m, least, _]| [*at_m, *least]).collect();
    figures::registration_section(
        &mut report,
        evaluation.registration.as_ref(),
        "place on the walk, m from its middle",
        least,
    );
    report
}

fn terms(report: &mut Report, document: &Document) {
    let terms = &document.evaluation.terms;
    report.heading("The terms of J");
    let row = |name: &str, value: f64| vec![name.to_owned(), number(value, 2)];
    let rows = [
        row("coverage", terms.coverage),
        row("overlap", terms.overlap),
        row("angular", terms.angular),
        row("cost", terms.cost),
        row("registration", terms.registration),
        row("J", document.evaluation.objective),
    ];
    report.table(&["term", "value"], &rows);
    let angle = document.evaluation.min_angle_deg;
    report.paragraph(&format!(
        "Overlap {:.2} % of the voxels seen; least angle between spin axes {}; path {}, {} columns, {} poses per m.",
        100.0 * document.evaluation.overlap_ratio,
        angle.map_or("none (one sensor)".into(), |angle| format!("{angle:.1} degrees")),
        document.path.name(),
        document.azimuths,
        document.sub_poses
    ));
    let verdicts: Vec<_> = document.fidelity.iter().flat_map(MountFidelity::verdicts).collect();
    if !verdicts.is_empty() {
        let rows: Vec<_> = verdicts.into_iter().map(|(title, words)| vec![title.to_owned(), words]).collect();
        report.table(&["sampled more finely", ""], &rows);
    }
    if let Some(rescored) = &document.rescored {
        report.paragraph(&format!("Scored again {}.", rescored.line().trim_end()));
    }
}

fn sensors(report: &mut Report, document: &Document) {
    report.heading("The sensors");
    let row = |(index, mount): (usize, &[f64; 5])| {
        let mut row = vec![(index + 1).to_string(), document.evaluation.models[index].to_owned()];
        row.extend(mount.iter().map(|value| number(*value, 3)));
        let evaluation = &document.evaluation;
        row.push(number(evaluation.per_sensor_voxels[index] as f64, 0));
        row.push(number(evaluation.unique_per_sensor[index] as f64, 0));
        row
    };
    let rows: Vec<_> = document.mounts.iter().enumerate().map(row).collect();
    report.table(
        &["sensor", "model", "x, m", "y, m", "z, m", "pitch, deg", "roll, deg", "voxels", "alone"],
        &rows,
    );
}

fn baselines(report: &mut Report, document: &Document) {
    let Some(baselines) = &document.baselines else { return };
    let evaluation = &document.evaluation;
    let voxels = |count: u64| number(count as f64, 0);
    let mut rows = vec![vec![
        "the mounts".into(),
        "-".into(),
        number(evaluation.objective, 1),
        voxels(evaluation.unique_voxels),
        "-".into(),
    ]];
    rows.extend(baselines.named().map(|(name, single)| {
        vec![
            name.into(),
            number(single.pitch_deg, 1),
            number(single.seen.objective, 1),
            voxels(single.seen.unique_voxels),
            number(single.seen.gain_voxels as f64, 0),
        ]
    }));
    let header = ["", "pitch, deg", "J", "voxels seen", "the mounts see more"];
    let of_mounts = Some(evaluation.objective);
    figures::baselines_section(report, baselines, &header, &rows, "J", of_mounts);
}
