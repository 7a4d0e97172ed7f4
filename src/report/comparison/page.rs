//! The report page of a comparison.

use super::maps::difference_maps;
use super::rays::rays_section;
use super::text::tilt_rows;
use crate::report::chart::number;
use crate::report::values::{estimate, figure, interval, percent};
use crate::report::{Report, compared, orbit};
use crate::verify::compare::{Agreement, Replayed};
use crate::verify::judgement::comparison::Comparison;
use crate::world::local_origin::LocalOrigin;
use crate::world::scene::Scene;
use crate::world::trajectory::Trajectory;

/// The page: verdict, three numbers, what to do, the recording on its scene; below that what one may want to know.
pub(crate) fn page(
    comparison: &Comparison,
    (problems, zeros): (&[String], &[String]),
    replayed: &Replayed,
    scene: &Scene,
    trajectory: &Trajectory,
    (agree_within_m, origin): (f64, LocalOrigin),
    made_by: &str,
) -> Report {
    let mut report = compared("Predicted against recorded", comparison, problems, made_by);
    report.orbit(
        orbit::compared(replayed, scene, trajectory, agree_within_m, origin),
        "An even share of the recorded rays, each where it ends; the rig stands where the trajectory begins.",
    );
    report.heading("Findings");
    let findings = comparison.words.iter().chain(problems).chain(zeros);
    report.findings(findings.map(String::as_str));
    coverage_section(&mut report, comparison);
    tilt_section(&mut report, comparison);
    difference_maps(&mut report, replayed, scene, trajectory, origin);
    rays_section(&mut report, comparison, replayed);
    prediction_section(&mut report, comparison);
    report
}

fn counts_note(comparison: &Comparison) -> String {
    let counts = &comparison.coverage;
    format!(
        "{} voxels predicted, {} recorded",
        number(counts.as_driven as f64, 0),
        number(counts.recorded as f64, 0)
    )
}

fn coverage_section(report: &mut Report, comparison: &Comparison) {
    report.fold("Coverage", &counts_note(comparison));
    let counts = &comparison.coverage;
    let count = |value: u64| number(value as f64, 0);
    let mut rows = vec![
        vec!["cells planned".into(), count(counts.planned), "nominal mounts, planned trajectory".into()],
        vec![
            "cells as driven".into(),
            count(counts.as_driven),
            "measured mounts, recorded times and trajectory".into(),
        ],
        vec!["cells recorded".into(), count(counts.recorded), "rays that ended as predicted".into()],
        vec![
            "execution error".into(),
            figure(comparison.execution.iou),
            "IoU of planned and as driven".into(),
        ],
    ];
    if let Some(surface) = &comparison.surface {
        for (name, share, what) in [
            ("surface as driven", &surface.as_driven, "within 5 cm of a predicted point"),
            ("surface recorded", &surface.recorded, "within 5 cm of a predicted point of a ray that agrees"),
            (
                "surface as placed",
                &surface.placed,
                "within 5 cm of a measured point: noise and blur raise it",
            ),
        ] {
            rows.push(vec![
                name.into(),
                percent(share.of_observable),
                format!("of what can be seen; {what}"),
            ]);
        }
    }
    report.table(&["", "", "what it is"], &rows);
    let Some(agreement) = &comparison.agreement else { return };
    let patches = &agreement.patches;
    let placed = comparison.agreement_as_placed.as_ref();
    let row = |name: &str, of: fn(&Agreement) -> Option<f64>, ends: Option<[f64; 2]>| {
        let placed = figure(placed.and_then(|placed| of(&placed.agreement)));
        vec![name.to_owned(), figure(of(&patches.agreement)), interval(ends).trim().to_owned(), placed]
    };
    report.table(
        &["agreement of patches", "snapped to the ray", "95 % over blocks of 2 m", "as placed"],
        &[
            row("IoU", |a| a.iou, patches.iou_interval),
            row("kappa", |a| a.kappa, patches.kappa_interval),
            row("MCC", |a| a.mcc, None),
            row("precision", |a| a.precision, None),
            row("recall", |a| a.recall, None),
            row("prevalence", |a| a.prevalence, None),
        ],
    );
}

fn tilt_section(report: &mut Report, comparison: &Comparison) {
    report.fold("Where the sensors really sit", "measured mounts against nominal ones");
    let header = ["sensor", "pitch above nominal", "if there were none", "observable", "condition"];
    report.table(&header, &tilt_rows(comparison));
    let mut rows = Vec::new();
    for check in &comparison.mount {
        let mut row = vec![check.sensor.clone()];
        row.extend(check.translation_mm.iter().map(|shift| estimate(*shift, 1)));
        row.extend(check.rotation_deg.iter().map(|turn| estimate(*turn, 3)));
        row.push(estimate(check.range_offset_mm, 1));
        rows.push(row);
    }
    let header = [
        "sensor",
        "x right, mm",
        "y ahead, mm",
        "z up, mm",
        "roll, deg",
        "pitch, deg",
        "yaw, deg",
        "range, mm",
    ];
    report.table(&header, &rows);
    report.paragraph(
        "What both sensors share may as well be the trajectory's attitude error; what sets them apart is the mount. If \
         the trajectory was made from one of the sensors, its own pitch error has gone into the trajectory. Beam \
         calibration and flat walls limit real recordings to a few hundredths of a degree.",
    );
}

fn prediction_section(report: &mut Report, comparison: &Comparison) {
    let Some(prediction) = comparison.prediction.as_ref().filter(|null| null.healthy.runs > 0) else {
        return;
    };
    report.fold("Against healthy runs", &format!("{} simulated", prediction.healthy.runs));
    let healthy = &prediction.healthy;
    report.paragraph(&format!(
        "{} simulated runs of {} rays with the nominal mounts, a trajectory that is off by {:.0} mm and {:.2} degrees over \
         {:.1} s, a range deviation of {:.0} mm and {:.0} % of the returns lost: share of agreeing rays {} on average, {} \
         in the recording (p {}).",
        healthy.runs,
        number(prediction.rays as f64, 0),
        1e3 * healthy.pose.position_sd_m,
        healthy.pose.rotation_sd_rad.to_degrees(),
        healthy.pose.correlation_s,
        1e3 * healthy.range_sd_m,
        100.0 * healthy.drop_out,
        percent(prediction.agree_share_of_runs.map(|[mean, _]| mean)),
        percent(prediction.agree_share),
        prediction.agree_p_value.map_or("-".into(), |p| format!("{p:.3}")),
    ));
    let rows: Vec<Vec<String>> = prediction
        .calibration
        .curve
        .iter()
        .map(|[chance, outcome, patches]| {
            vec![percent(Some(*chance)), percent(Some(*outcome)), number(*patches, 0)]
        })
        .collect();
    report.table(&["chance of being covered", "covered", "patches"], &rows);
}
