//! Sections that several pages share: who saw what, blind spots, registration along the path, baselines.

use glam::DVec3;

use super::{BlindSpot, FromAbove, Report, unfold_mount_box};
use crate::design::objective::Terms;
use crate::design::registration::{DEGENERATE, RegistrationQuality};
use crate::report::chart::{CellClass, LineChart, Series, count, number};
use crate::simulate::baselines::Baselines;
use crate::world::coverage::Coverage;

/// Number of classes of [`who_saw`].
pub const WHO_CLASSES: usize = 5;
/// The class of unseen cells, in [`who_saw`].
pub const UNSEEN: usize = 4;
/// Steps of the unseen share.
const UNSEEN_STEPS: usize = 5;

/// Classes by who saw a cell: several, the first sensor alone, the second alone, another alone, unseen.
pub(crate) fn who_classes(names: &[&str], unseen: &str) -> [CellClass; WHO_CLASSES] {
    let only = |sensor: usize| match names {
        [_] => "seen".to_owned(),
        _ => names.get(sensor).map_or("-".into(), |name| format!("{name} only")),
    };
    [
        CellClass::new("c-both", if names.len() > 2 { "seen by several" } else { "seen by both" }),
        CellClass::new("c-left", only(0)),
        CellClass::new("c-right", only(1)),
        CellClass::new("c-odd", "another one only"),
        CellClass::new("c-bad", unseen),
    ]
}

/// The class of a cell, from whether each sensor saw it.
pub(crate) fn who_saw(seen: impl Iterator<Item = bool>) -> usize {
    let mut seeing = seen.enumerate().filter(|(_, seen)| *seen).map(|(sensor, _)| sensor);
    match (seeing.next(), seeing.next()) {
        (None, _) => UNSEEN,
        (Some(_), Some(_)) => 0,
        (Some(sensor), None) => 1 + sensor.min(2),
    }
}

/// The class of a cell of a coverage.
pub(crate) fn who_covers(coverage: &Coverage, cell: usize) -> usize {
    who_saw((0..coverage.sensors()).map(|sensor| coverage.contains(sensor, cell)))
}

/// Voxels with their classes.
pub(crate) fn who_covers_each<'a>(
    coverage: &'a Coverage,
    cells: &'a [usize],
) -> impl Iterator<Item = (DVec3, usize)> + 'a {
    cells.iter().map(|cell| (coverage.grid().centre_m(*cell), who_covers(coverage, *cell)))
}

/// Who saw what on the walls of a box, with coverage in the mount frame's axes.
pub(crate) fn unfolded(report: &mut Report, coverage: &Coverage, names: &[&str]) {
    report.heading("Who saw what");
    report.maps(
        "Voxels by who saw them",
        &unfold_mount_box(coverage.grid(), &|cell| Some(who_covers(coverage, cell))),
        &who_classes(names, "observable, but unseen"),
        "The box unfolded: floor and ceiling seen from above, the platform's front (+y) up the page; walls from inside.",
    );
}

/// Who saw what from above, and the unseen share of each place.
pub(crate) fn from_above(report: &mut Report, above: &FromAbove, classes: &[CellClass], what: &str) {
    report.maps(
        &format!("Who saw what, {what} seen from above"),
        &above.majority(),
        classes,
        "Seen from above in layers of height, world x up the page and y to the left; each square shows what holds for \
         most of the surface in it.",
    );
    report.detail("Blind spots");
    let steps = |step: usize| {
        let percent = |step: usize| 100 * step / UNSEEN_STEPS;
        format!("{} to {} % unseen", percent(step), percent(step + 1))
    };
    const CSS: [&str; UNSEEN_STEPS] = ["c-s0", "c-s1", "c-s2", "c-s3", "c-s4"];
    let shares: Vec<_> = (0..UNSEEN_STEPS).map(|step| CellClass::new(CSS[step], steps(step))).collect();
    report.maps(
        &format!("Unseen share of the {what}"),
        &above.share(UNSEEN, UNSEEN_STEPS),
        &shares,
        "Share of the surface in each square that could be seen from the path and is not.",
    );
}

/// The largest groups of unseen cells.
pub(crate) fn blind_spot_table(report: &mut Report, spots: &[BlindSpot], voxel_m: f64) {
    if spots.is_empty() {
        report.note("Nothing that could be seen is missed.");
        return;
    }
    let metres = |values: [f64; 3]| values.map(|value| number(value, 2)).join(", ");
    let row = |spot: &BlindSpot| {
        vec![
            count(spot.cells as u64),
            number(spot.cells as f64 * voxel_m * voxel_m, 2),
            metres(spot.centre_m),
            metres(spot.extent_m),
        ]
    };
    let header = ["voxels", "about, m²", "centre x, y, z, m", "extent x, y, z, m"];
    report.table(&header, spots.iter().map(row).collect());
}

/// The terms of J and their sum.
pub(crate) fn terms_table(report: &mut Report, terms: &Terms) {
    let row = |name: &str, value: f64| vec![name.to_owned(), number(value, 2)];
    let rows = [
        row("coverage", terms.coverage),
        row("overlap", terms.overlap),
        row("angular", terms.angular),
        row("cost", terms.cost),
        row("registration", terms.registration),
        row("J", terms.objective()),
    ];
    report.table(&["term", "value"], rows.to_vec());
}

/// How well scans can be registered.
pub(crate) fn registration_figures(report: &mut Report, quality: &RegistrationQuality) {
    report.figure("strength", quality.words());
    let [median, p5] = [quality.rotation_median_m2, quality.rotation_p5_m2];
    report.figure("of rotation", format!("{median:.3} m² (5th percentile {p5:.3} m²)"));
    if let Some(direction) = quality.weakest_direction {
        let [x, y, z] = direction.map(|value| number(value, 2));
        report.figure("weakest direction", format!("({x}, {y}, {z}) in the worst scan"));
    }
}

/// Registration strength, and the min translation eigenvalue along the trajectory: `[x, eigenvalue]`.
pub(crate) fn registration_section(
    report: &mut Report,
    quality: Option<&RegistrationQuality>,
    x_label: &str,
    least: Vec<[f64; 2]>,
) {
    let (Some(quality), Some(first), Some(last)) = (quality, least.first(), least.last()) else { return };
    report.heading("Registration strength");
    registration_figures(report, quality);
    let degenerate = vec![[first[0], DEGENERATE], [last[0], DEGENERATE]];
    let chart = LineChart {
        title: "Least translation eigenvalue per hit along the trajectory".into(),
        x_label: x_label.into(),
        y_label: "least eigenvalue per hit".into(),
        series: vec![
            Series { name: "translation".into(), points: least },
            Series { name: "degenerate".into(), points: degenerate },
        ],
        ..LineChart::default()
    };
    let caption = format!("A scan with a direction of translation below {DEGENERATE} is degenerate.");
    report.chart(&chart.svg(), &caption);
}

/// A table of single sensors, and what one sensor reaches at each pitch, with the mounts' value (`of_mounts`).
pub(crate) fn baselines_section<T>(
    report: &mut Report,
    baselines: &Baselines<T>,
    header: &[&str],
    rows: Vec<Vec<String>>,
    y_label: &str,
    of_mounts: Option<f64>,
) {
    report.heading("Baselines: single sensors");
    report.table(header, rows);
    let searched = baselines.pitch_search.clone();
    let (Some(first), Some(last)) = (searched.first().copied(), searched.last().copied()) else { return };
    let best_deg = baselines.best_single.pitch_deg;
    let mut series = vec![Series { name: "one sensor".into(), points: searched }];
    series.extend(of_mounts.map(|value| Series {
        name: "the mounts".into(),
        points: vec![[first[0], value], [last[0], value]],
    }));
    let chart = LineChart {
        title: format!("{y_label} of one sensor over its pitch; best at {best_deg:.0} degrees"),
        x_label: "pitch of the single sensor, degrees".into(),
        y_label: y_label.into(),
        series,
        ..LineChart::default()
    };
    let caption =
        format!("One sensor in the middle of the mounts; best at a pitch of {best_deg:.0} degrees.");
    report.chart(&chart.svg(), &caption);
}

/// Classes of cells in the pictures.
pub(crate) fn where_different() -> [CellClass; 4] {
    [
        CellClass::new("c-both", "predicted and recorded"),
        CellClass::new("c-bad", "missed: predicted, not recorded"),
        CellClass::new("c-odd", "unexpected: recorded, not predicted"),
        CellClass::new("c-none", "neither"),
    ]
}
