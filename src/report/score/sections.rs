//! The report of a score.

use super::Document;
use crate::design::fidelity::MountFidelity;
use crate::report::chart::{count, number};
use crate::report::{Report, figures};
use crate::world::coverage::Coverage;

/// What was scored, term by term; with who saw what, for a page.
pub(crate) fn report(document: &Document, pictured: Option<&Coverage>) -> Report {
    let evaluation = &document.evaluation;
    let mut report = Report::new(&format!("Score in {}", document.preset), &sentence(document));
    report.figure("path", document.path.name());
    let (columns, poses) = (document.azimuths, document.sub_poses);
    let rays = count(evaluation.rays);
    report.figure(
        "cast",
        format!("{rays} rays ({columns} columns, {poses} poses per m) in {:.4} s", document.wall_s),
    );
    report.figure("overlap", format!("{:.2} % of the voxels seen", 100.0 * evaluation.overlap_ratio));
    let angle = evaluation.min_angle_deg;
    report.figure(
        "least angle",
        angle.map_or("one sensor".into(), |angle| format!("{angle:.2}° between axes")),
    );
    report.figures(document.fidelity.iter().flat_map(MountFidelity::verdicts));
    report.figures(document.rescored.iter().map(|rescored| ("scored again", rescored.words())));
    let touching = document.touching.iter().map(|pair| ("cannot be built", pair.to_string()));
    let violations = evaluation.violations.iter().map(|violation| ("not allowed", violation.to_string()));
    report.figures(violations.chain(touching));
    report.figures(
        evaluation.feasible.then(|| ("allowed", "yes: every pair of sensors keeps its distance".into())),
    );
    evaluation.saturation().into_iter().for_each(|words| report.note(words));
    report.heading("The terms of J");
    figures::terms_table(&mut report, &evaluation.terms);
    sensors(&mut report, document);
    baselines(&mut report, document);
    if let Some(coverage) = pictured {
        let names: Vec<String> = (1..=coverage.sensors()).map(|sensor| format!("sensor {sensor}")).collect();
        figures::unfolded(&mut report, coverage, &names.iter().map(String::as_str).collect::<Vec<_>>());
    }
    report.detail("Blind spots");
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

fn sentence(document: &Document) -> String {
    let evaluation = &document.evaluation;
    let share = 100.0 * evaluation.unique_voxels as f64 / evaluation.reachable_voxels as f64;
    let gain = document.baselines.as_ref().map_or(String::new(), |baselines| {
        let gain = number(baselines.best_single.seen.gain_voxels as f64, 0);
        format!(", {gain} more than the best single sensor")
    });
    format!(
        "{}: {} sensors see {} of {} voxels that can be hit ({share:.1} %){gain}; J = {}.",
        document.preset,
        evaluation.sensors,
        count(evaluation.unique_voxels),
        count(evaluation.reachable_voxels),
        number(evaluation.objective, 2),
    )
}

fn sensors(report: &mut Report, document: &Document) {
    report.heading("The sensors");
    let row = |(index, mount): (usize, &[f64; 5])| {
        let mut row = vec![(index + 1).to_string(), document.evaluation.models[index].to_owned()];
        row.extend(mount.iter().map(|value| number(*value, 4)));
        let evaluation = &document.evaluation;
        row.push(count(evaluation.per_sensor_voxels[index]));
        row.push(count(evaluation.unique_per_sensor[index]));
        row
    };
    report.table(
        &["sensor", "model", "x, m", "y, m", "z, m", "pitch, deg", "roll, deg", "voxels", "alone"],
        document.mounts.iter().enumerate().map(row).collect(),
    );
}

fn baselines(report: &mut Report, document: &Document) {
    let Some(baselines) = &document.baselines else { return };
    let evaluation = &document.evaluation;
    let mounts = [
        "the mounts".into(),
        "-".into(),
        "-".into(),
        number(evaluation.objective, 1),
        count(evaluation.unique_voxels),
        "-".into(),
    ];
    let singles = baselines.named().map(|(name, single)| {
        vec![
            name.into(),
            single.model.clone(),
            number(single.pitch_deg, 1),
            number(single.seen.objective, 1),
            count(single.seen.unique_voxels),
            number(single.seen.gain_voxels as f64, 0),
        ]
    });
    let rows = std::iter::once(mounts.to_vec()).chain(singles).collect();
    let header = ["", "model", "pitch, deg", "J", "voxels seen", "the mounts see more"];
    let of_mounts = Some(evaluation.objective);
    figures::baselines_section(report, baselines, &header, rows, "J", of_mounts);
}
