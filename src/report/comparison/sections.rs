//! The report of a comparison.

use super::Pictures;
use super::maps::difference_maps;
use super::rays::rays_section;
use crate::report::chart::{count, decimals_of, number, signed};
use crate::report::values::{estimate, figure, interval, p_value, percent};
use crate::report::{Report, compared, orbit};
use crate::verify::compare::{Agreement, CoverageCounts};
use crate::verify::judgement::comparison::{Comparison, Measured};

/// Verdict, findings and figures; with the recording on its scene and what one may want to know, for a page.
pub(crate) fn report(
    comparison: &Comparison,
    problems: &[String],
    zeros: &[String],
    pictures: Option<&Pictures<'_>>,
) -> Report {
    let mut report = compared("Predicted against recorded", comparison, problems);
    report.figure("reason", comparison.reason.line());
    if let Some(Pictures { replayed, scene, trajectory, agree_within_m, origin }) = pictures {
        report.orbit(
            orbit::compared(replayed, scene, trajectory, *agree_within_m, *origin),
            "An even share of the recorded rays, each where it ends; the rig stands where the trajectory begins.",
        );
    }
    report.heading("Findings");
    report.findings(&comparison.words);
    report.findings(zeros);
    report.notices(problems);
    report.heading("In figures");
    in_figures(&mut report, comparison);
    coverage_section(&mut report, comparison);
    tilt_section(&mut report, comparison);
    if let Some(pictures) = pictures {
        difference_maps(&mut report, pictures);
        rays_section(&mut report, comparison, pictures.replayed);
    }
    prediction_section(&mut report, comparison);
    report
}

/// The result in a few lines.
pub(crate) fn in_figures(report: &mut Report, comparison: &Comparison) {
    if let Some(surface) = &comparison.surface {
        let [as_driven, recorded] =
            [&surface.as_driven, &surface.recorded].map(|share| percent(share.of_observable));
        let all = percent(Some(surface.observable_share));
        let words = format!(
            "as driven {as_driven}, recorded {recorded} of what can be seen from the path ({all} of all)"
        );
        report.figure("surface", words);
    }
    let CoverageCounts { planned, as_driven, recorded, .. } = &comparison.coverage;
    let [planned, as_driven, recorded] = [planned, as_driven, recorded].map(|voxels| count(*voxels));
    report.figure("voxels", format!("planned {planned}, as driven {as_driven}, recorded {recorded}"));
    if let Some(Measured { patches, p_value }) = &comparison.agreement {
        let [iou, kappa] = [patches.agreement.iou, patches.agreement.kappa].map(figure);
        let p = p_value.map_or("-".into(), |p| format!("{p:.3}"));
        report
            .figure("patches", format!("IoU {iou}{}, kappa {kappa}, p {p}", interval(patches.iou_interval)));
    }
    for (sensor, rays) in &comparison.rays {
        let classes = &rays.classes;
        let [short, long, drop, extra] =
            [classes.short, classes.long, classes.drop, classes.extra].map(count);
        let (share, all) = (percent(rays.agree_share), count(classes.informative()));
        let words = format!("{share} of {all} agree; short {short}, long {long}, drop {drop}, extra {extra}");
        report.figure(&format!("rays of {sensor}"), words);
    }
    if let Some(conflicts) = &comparison.conflicts {
        let counts = [conflicts.agree, conflicts.gone.cells, conflicts.unforeseen.cells, conflicts.unknown];
        let [agree, gone, unforeseen, unknown] = counts.map(count);
        report.figure(
            &format!("cells of {} m", conflicts.cell_m),
            format!(
                "{agree} occupied in both, {gone} looked through, {unforeseen} hit where the scene is empty, {unknown} known \
                 to one alone"
            ),
        );
    }
    for mut row in tilt_rows(comparison) {
        let sensor = row.remove(0);
        row.retain(|words| !words.is_empty());
        report.figure(&format!("pitch of {sensor}"), row.join(", "));
    }
}

fn counts_note(comparison: &Comparison) -> String {
    let counts = &comparison.coverage;
    format!("{} voxels predicted, {} recorded", count(counts.as_driven), count(counts.recorded))
}

fn coverage_section(report: &mut Report, comparison: &Comparison) {
    report.fold("Coverage", &counts_note(comparison));
    let counts = &comparison.coverage;
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
    report.table(&["", "", "what it is"], rows);
    let Some(agreement) = &comparison.agreement else { return };
    let patches = &agreement.patches;
    let placed = comparison.agreement_as_placed.as_ref();
    let row = |name: &str, of: fn(&Agreement) -> Option<f64>, ends: Option<[f64; 2]>| {
        let placed = figure(placed.and_then(|placed| of(&placed.agreement)));
        vec![name.to_owned(), figure(of(&patches.agreement)), interval(ends).trim().to_owned(), placed]
    };
    report.table(
        &["agreement of patches", "snapped to the ray", "95 % over blocks of 2 m", "as placed"],
        vec![
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
    report.table(&header, tilt_rows(comparison));
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
    report.table(&header, rows);
    report.note(
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
    report.note(format!(
        "{} simulated runs of {} rays with the nominal mounts, a trajectory that is off by {:.0} mm and {:.2} degrees over \
         {:.1} s, a range deviation of {:.0} mm and {:.0} % of the returns lost: share of agreeing rays {} on average, {} \
         in the recording (p {}).",
        healthy.runs,
        count(prediction.rays as u64),
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
    report.table(&["chance of being covered", "covered", "patches"], rows);
}

/// How well the beam angles of a good sensor are known, degrees (data sheets of the Ouster OS1).
const BEAMS_DEG: f64 = 0.01;

fn tilt_rows(comparison: &Comparison) -> Vec<Vec<String>> {
    let degrees = |value: f64, u95: f64| {
        let digits = decimals_of(u95);
        format!("{} ± {u95:.digits$}°", signed(value, digits))
    };
    let mut rows: Vec<Vec<String>> = Vec::new();
    for check in &comparison.mount {
        let tilt = check.tilt_error_deg.zip(check.u95_deg);
        rows.push(vec![
            check.sensor.clone(),
            tilt.map_or("cannot tell here".into(), |(value, u95)| degrees(value, u95)),
            check.p_value.map_or("-".into(), p_value),
            format!(
                "observable: {}",
                if check.observable.is_empty() { "nothing".into() } else { check.observable.join(" ") }
            ),
            check.condition_number.map_or("condition -".into(), |value| format!("condition {value:.1}")),
        ]);
    }
    if let Some(relative) = &comparison.relative_tilt {
        rows.push(vec![
            relative.sensors.join(" - "),
            degrees(relative.error_deg, relative.u95_deg),
            p_value(relative.p_value),
            match relative.error_deg.abs() + relative.u95_deg < BEAMS_DEG {
                true => "less than beams are calibrated to".into(),
                false => String::new(),
            },
            String::new(),
        ]);
    }
    rows
}
