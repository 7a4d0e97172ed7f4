//! The report page of a comparison, and its text on the screen.

use std::fmt::Write as _;

use super::Document;
use crate::commands::output;
use crate::report::chart::{CellClass, CellMap, LineChart, Series, decimals_of, number, signed};
use crate::report::figures::where_different;
use crate::report::{Report, compared, orbit, unfold_box};
use crate::verify::compare::{Breakdown, CellKinds, Replayed, SECTORS, cell_kinds};
use crate::verify::judgement::comparison::Comparison;
use crate::world::coverage::Coverage;
use crate::world::local_origin::LocalOrigin;
use crate::world::scene::Scene;
use crate::world::trajectory::Trajectory;

/// A top view is drawn with at most so many cells along an edge.
const TOP_CELLS: usize = 240;

fn percent(share: Option<f64>) -> String {
    share.map_or("-".into(), |share| format!("{:.1} %", 100.0 * share))
}

fn figure(value: Option<f64>) -> String {
    value.map_or("-".into(), |value| format!("{value:.4}"))
}

/// What a terminal shows.
pub(crate) fn text(document: &Document) -> String {
    let comparison = &document.comparison;
    let mut text = format!("{}\n{}", comparison.headline(), comparison.reason.line());
    for words in &comparison.words {
        let _ = writeln!(text, "  - {words}");
    }
    if let Some(surface) = &comparison.surface {
        let _ = writeln!(
            text,
            "surface   as driven {}, recorded {} of what can be seen from the path ({} of all)",
            percent(surface.as_driven.of_observable),
            percent(surface.recorded.of_observable),
            percent(Some(surface.observable_share)),
        );
    }
    let counts = &comparison.coverage;
    let _ = writeln!(
        text,
        "cells     planned {}, as driven {}, recorded {}",
        counts.planned, counts.as_driven, counts.recorded
    );
    if let Some(agreement) = &comparison.agreement {
        let _ = writeln!(
            text,
            "patches   IoU {}{}, kappa {}, p {}",
            figure(agreement.patches.agreement.iou),
            interval(agreement.patches.iou_interval),
            figure(agreement.patches.agreement.kappa),
            agreement.p_value.map_or("-".into(), |p| format!("{p:.3}"))
        );
    }
    for (sensor, rays) in &comparison.rays {
        let classes = &rays.classes;
        let _ = writeln!(
            text,
            "{sensor:9} {} of {} rays agree; short {}, long {}, drop {}, extra {}",
            percent(rays.agree_share),
            classes.informative(),
            classes.short,
            classes.long,
            classes.drop,
            classes.extra
        );
    }
    if let Some(conflicts) = &comparison.conflicts {
        let _ = writeln!(
            text,
            "cells of {} m: {} occupied in both, {} looked through, {} hit where the scene is empty, {} known to one alone",
            conflicts.cell_m,
            conflicts.agree,
            conflicts.gone.cells,
            conflicts.unforeseen.cells,
            conflicts.unknown
        );
    }
    for row in tilt_rows(comparison) {
        let _ = writeln!(text, "pitch     {}", row.join("  "));
    }
    for offer in &document.servo_zero {
        let _ = writeln!(text, "zero      {}", offer.words());
    }
    text
}

fn interval(ends: Option<[f64; 2]>) -> String {
    ends.map_or(String::new(), |[low, high]| format!(" [{low:.4}, {high:.4}]"))
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
            check.p_value.map_or("-".into(), output::p_value),
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
            output::p_value(relative.p_value),
            match relative.error_deg.abs() + relative.u95_deg < BEAMS_DEG {
                true => "less than beams are calibrated to".into(),
                false => String::new(),
            },
            String::new(),
        ]);
    }
    rows
}

/// The page: verdict, three numbers, what to do, the recording on its scene; below that what one may want to know.
pub(crate) fn page(
    document: &Document,
    replayed: &Replayed,
    scene: &Scene,
    trajectory: &Trajectory,
    (agree_within_m, origin): (f64, LocalOrigin),
) -> Report {
    let comparison = &document.comparison;
    let mut report = compared("Predicted against recorded", comparison, &document.problems, &output::again());
    report.orbit(
        orbit::compared(replayed, scene, trajectory, agree_within_m, origin),
        "An even share of the recorded rays, each where it ends; the rig stands where the trajectory begins.",
    );
    report.heading("Findings");
    let zeros: Vec<String> = document.servo_zero.iter().map(super::ZeroOffer::words).collect();
    let findings = comparison.words.iter().chain(&document.problems).chain(&zeros);
    report.findings(findings.map(String::as_str));
    coverage_section(&mut report, comparison);
    tilt_section(&mut report, comparison);
    pictures(&mut report, replayed, scene, trajectory);
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
    let row =
        |name: &str, of: fn(&crate::verify::compare::Agreement) -> Option<f64>, ends: Option<[f64; 2]>| {
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
        row.extend(check.translation_mm.iter().map(|shift| output::estimate(*shift, 1)));
        row.extend(check.rotation_deg.iter().map(|turn| output::estimate(*turn, 3)));
        row.push(output::estimate(check.range_offset_mm, 1));
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

fn rays_section(report: &mut Report, comparison: &Comparison, replayed: &Replayed) {
    report.fold("Every recorded ray", "by sensor, channel, azimuth and incidence");
    let rows: Vec<Vec<String>> = comparison
        .rays
        .iter()
        .map(|(sensor, rays)| {
            let c = &rays.classes;
            let counts = [c.agree, c.short, c.long, c.drop, c.extra, c.nothing, c.unplaced];
            let head = [sensor.clone(), percent(rays.agree_share)];
            head.into_iter().chain(counts.map(|count| number(count as f64, 0))).collect()
        })
        .collect();
    let header = ["sensor", "agree", "agree", "short", "long", "drop", "extra", "nothing", "unplaced"];
    report.table(&header, &rows);
    let classes = strip_classes();
    for (sensor, breakdown) in replayed.sensors.iter().zip(&replayed.breakdown) {
        let strips = [strip(&sensor.name, breakdown)];
        if strips[0].cells.iter().flatten().all(|class| *class == 0) {
            report
                .paragraph(&format!("{}: in every direction at least 95 % of the rays agree.", sensor.name));
            continue;
        }
        report.maps(
            &format!("Rays of {} by channel and azimuth", sensor.name),
            &strips,
            &classes,
            "Channels up the page, encoder azimuth to the right: what most rays of a direction that do not agree became.",
        );
    }
    let series = replayed.sensors.iter().zip(&replayed.breakdown).map(|(sensor, breakdown)| Series {
        name: sensor.name.clone(),
        points: breakdown
            .by_incidence
            .iter()
            .enumerate()
            .filter_map(|(bin, rays)| Some([10.0 * bin as f64 + 5.0, 100.0 * rays.agree_share()?]))
            .collect(),
    });
    let chart = LineChart {
        title: "Agreeing rays by incidence".into(),
        x_label: "angle from the surface's normal (deg)".into(),
        y_label: "rays that agree (%)".into(),
        series: series.collect(),
        ..LineChart::default()
    };
    report.figure(&chart.svg(), "The more obliquely a surface is seen, the more a pose error shows.");
}

fn strip_classes() -> [CellClass; 6] {
    [
        CellClass::new("c-both", "agree (95 % or more)"),
        CellClass::new("c-right", "mostly short"),
        CellClass::new("c-odd", "mostly long"),
        CellClass::new("c-bad", "mostly dropped"),
        CellClass::new("c-left", "mostly extra"),
        CellClass::new("c-none", "nothing there"),
    ]
}

fn strip(name: &str, breakdown: &Breakdown) -> CellMap {
    let class = |cell: &crate::verify::compare::RayClasses| {
        let all = cell.informative();
        if all == 0 {
            return Some(5);
        }
        if cell.agree * 20 >= all * 19 {
            return Some(0);
        }
        let others = [cell.short, cell.long, cell.drop, cell.extra];
        others.iter().enumerate().max_by_key(|(_, count)| **count).map(|(place, _)| place + 1)
    };
    CellMap { title: name.to_owned(), width: SECTORS, cells: breakdown.strip.iter().map(class).collect() }
}

fn pictures(report: &mut Report, replayed: &Replayed, scene: &Scene, trajectory: &Trajectory) {
    report.fold("Where they differ", "plans");
    let classes = where_different();
    if matches!(scene, Scene::Box(_)) {
        let kinds = cell_kinds(&replayed.as_driven, &replayed.recorded);
        let faces = unfold_box(replayed.recorded.grid(), &|index| Some(kind_place(kinds[index])));
        report.maps(
            "Cells predicted against cells recorded",
            &faces,
            &classes,
            "The room unfolded: floor and ceiling seen from above with x up the page, walls from inside.",
        );
    }
    let mut with_path = classes.to_vec();
    with_path.push(CellClass::new("c-path", "trajectory"));
    let above = from_above(&replayed.as_driven, &replayed.recorded, &replayed.placed, trajectory);
    report.maps(
        "Seen from above",
        &[above],
        &with_path,
        "From above, x up the page and y to the left: a column is missed where a twentieth of its predicted cells is.",
    );
}

fn kind_place(kind: CellKinds) -> usize {
    match kind {
        CellKinds::Both => 0,
        CellKinds::Missed => 1,
        CellKinds::Unexpected => 2,
        CellKinds::Neither => 3,
    }
}

fn from_above(
    as_driven: &Coverage,
    recorded: &Coverage,
    placed: &Coverage,
    trajectory: &Trajectory,
) -> CellMap {
    let grid = recorded.grid();
    let [nx, ny, _] = grid.cells;
    let step = nx.max(ny).div_ceil(TOP_CELLS).max(1);
    let (width, height) = (ny.div_ceil(step), nx.div_ceil(step));
    // left of the page is +y
    let pixel = |cell: usize| {
        let (i, j) = (cell % nx, cell / nx % ny);
        (i / step) * width + (width - 1 - j / step)
    };
    let mut counts = vec![[0u32; 3]; width * height];
    let has = |coverage: &Coverage, cell: usize| (0..coverage.sensors()).any(|s| coverage.contains(s, cell));
    for cell in as_driven.union_cells() {
        counts[pixel(cell)][usize::from(!has(recorded, cell))] += 1;
    }
    for cell in placed.union_cells() {
        counts[pixel(cell)][2] += u32::from(!has(as_driven, cell));
    }
    let mut cells: Vec<Option<usize>> = counts
        .iter()
        .map(|[both, missed, unexpected]| match both + missed {
            0 if *unexpected == 0 => None,
            0 => Some(2),
            all if missed * 20 >= all => Some(1),
            _ => Some(0),
        })
        .collect();
    for (_, pose) in trajectory.stamped() {
        let mut at = pose.translation_m;
        at.z = grid.origin_m.z + 0.5 * grid.voxel_m;
        if let Some(cell) = grid.index(at) {
            cells[pixel(cell)] = Some(4);
        }
    }
    CellMap { title: "from above".into(), width, cells }
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
