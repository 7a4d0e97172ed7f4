//! Published value, ours, spread.

use super::super::rows::{chosen, number, numbers};
use super::super::searches::best_after;
use super::super::{Figure, Row, Spread, Table};
use super::data::{LAMBDAS, TABLE_3, TABLE_8};
use crate::report::chart::{self, LineChart, Series};

/// Evaluations at which convergence is read off.
const CHECKPOINTS: [f64; 9] = [12.0, 25.0, 56.0, 80.0, 150.0, 300.0, 1000.0, 3500.0, 7500.0];

/// Median and range of a field, scaled.
pub(crate) fn spread(rows: &[&Row], field: &str, scale: f64) -> Option<Spread> {
    Spread::of(&numbers(rows, field).into_iter().map(|value| scale * value).collect::<Vec<_>>())
}

fn words(rows: &[&Row], field: &str, scale: f64, decimals: usize) -> String {
    spread(rows, field, scale).map_or("none".into(), |spread| spread.words(decimals))
}

pub(crate) fn table_3(rows: &[Row]) -> Table {
    let mut table = Table::new(
        "table-3",
        "Table 3: three methods, both sensors",
        "First the published value, then ours: median over the seeds and, in brackets, the range. The published J, voxels and \
         overlap are of the re-score with noisy rays; so are ours, next to the J that was searched. Published seconds are of \
         MATLAB on the authors' machine.",
        &[
            "sensor",
            "method",
            "J publ.",
            "J ours, noisy",
            "J ours, searched",
            "voxels publ.",
            "voxels ours",
            "overlap % publ.",
            "overlap % ours",
            "angle publ.",
            "angle ours",
            "evaluations publ.",
            "evaluations ours",
            "s publ.",
            "s ours",
        ],
    );
    for row in &TABLE_3 {
        let ours =
            chosen(rows, &[("part", "table 3"), ("preset", row.preset), ("method", row.method.name())]);
        let n = chart::number;
        table.rows.push(vec![
            row.preset.into(),
            row.method.name().into(),
            n(row.objective, 1),
            words(&ours, "j_noisy", 1.0, 1),
            words(&ours, "j", 1.0, 1),
            n(row.unique_voxels, 0),
            words(&ours, "unique_voxels_noisy", 1.0, 0),
            n(row.overlap_percent, 1),
            words(&ours, "overlap_ratio_noisy", 100.0, 1),
            n(row.min_angle_deg, 1),
            words(&ours, "min_angle_deg", 1.0, 1),
            n(row.evaluations, 0),
            words(&ours, "used_evaluations", 1.0, 0),
            n(row.runtime_s, 1),
            words(&ours, "wall_s", 1.0, 3),
        ]);
    }
    table
}

pub(crate) fn table_4(rows: &[Row]) -> Table {
    let mut table = Table::new(
        "table-4",
        "Table 4: J per second and per evaluation",
        "J over seconds measures the machine and the language, J over evaluations mostly the number of evaluations asked for: \
         all J are alike. The last column is the share of the time that the search itself took, not the objective.",
        &[
            "sensor",
            "method",
            "J/s publ.",
            "J/s ours",
            "J/evaluation publ.",
            "J/evaluation ours",
            "search's own share %",
        ],
    );
    for row in &TABLE_3 {
        let ours =
            chosen(rows, &[("part", "table 3"), ("preset", row.preset), ("method", row.method.name())]);
        let ratio = |by: &str| {
            let values: Vec<f64> =
                ours.iter().filter_map(|r| Some(number(r, "j")? / number(r, by)?.max(1e-9))).collect();
            Spread::of(&values)
        };
        let own: Vec<f64> = ours
            .iter()
            .filter_map(|r| {
                Some(100.0 * (1.0 - number(r, "wall_objective_s")? / number(r, "wall_s")?.max(1e-9)))
            })
            // with several threads the objective's time is a sum over them
            .map(|share| share.max(0.0))
            .collect();
        let show = |spread: Option<Spread>, decimals| spread.map_or("none".into(), |s| s.words(decimals));
        table.rows.push(vec![
            row.preset.into(),
            row.method.name().into(),
            chart::number(row.objective_per_s, 0),
            show(ratio("wall_s"), 0),
            chart::number(row.objective_per_evaluation, 1),
            show(ratio("used_evaluations"), 1),
            show(Spread::of(&own), 0),
        ]);
    }
    table
}

/// Medians of the best J after so many evaluations; a search that has stopped keeps its best.
pub(crate) fn figure_10(rows: &[Row]) -> Table {
    let mut table = Table::new(
        "figure-10",
        "Figure 10: best J after so many evaluations",
        "Medians over the seeds of the runs of Table 3; a run that has stopped keeps its best.",
        &["sensor", "method"],
    );
    table.columns.extend(CHECKPOINTS.map(|count| chart::number(count, 0)));
    for row in &TABLE_3 {
        let ours =
            chosen(rows, &[("part", "table 3"), ("preset", row.preset), ("method", row.method.name())]);
        let mut cells = vec![row.preset.to_owned(), row.method.name().to_owned()];
        cells.extend(CHECKPOINTS.map(|count| {
            median_after(&ours, count).map_or(String::new(), |median| chart::number(median, 1))
        }));
        table.rows.push(cells);
    }
    table
}

pub(crate) fn median_after(rows: &[&Row], evaluations: f64) -> Option<f64> {
    let values: Vec<f64> = rows.iter().filter_map(|row| best_after(row, evaluations)).collect();
    Spread::of(&values).map(|spread| spread.median)
}

pub(crate) fn convergence(rows: &[Row]) -> Vec<Figure> {
    let of_sensor = |preset: &str| {
        let series = TABLE_3.iter().filter(|row| row.preset == preset).map(|row| {
            let ours =
                chosen(rows, &[("part", "table 3"), ("preset", preset), ("method", row.method.name())]);
            let most = numbers(&ours, "used_evaluations").into_iter().fold(0.0, f64::max);
            let points = (50..=200).filter_map(|step| {
                // evenly spaced in the logarithm
                let count = 10f64.powf(f64::from(step) / 50.0).round();
                (count <= most).then(|| Some([count, median_after(&ours, count)?]))?
            });
            Series { name: row.method.name().into(), points: points.collect() }
        });
        let chart = LineChart {
            title: format!("Convergence, {preset}"),
            x_label: "evaluations".into(),
            x_decades: true,
            y_label: "best J so far, median".into(),
            series: series.collect(),
            steps: true,
        };
        let caption =
            format!("Figure 10 again, {preset}: from the tenth evaluation on, medians over the seeds.");
        Figure { svg: chart.svg(), caption }
    };
    if chosen(rows, &[("part", "table 3")]).is_empty() {
        return Vec::new();
    }
    vec![of_sensor("paper-os1-64"), of_sensor("paper-vlp-16")]
}

/// Pitch of the first master, without its sign.
pub(crate) fn pitches_deg(rows: &[&Row]) -> Vec<f64> {
    rows.iter().filter_map(|row| row.get("mounts")?.get(0)?.get(3)?.as_f64()).map(f64::abs).collect()
}

pub(crate) fn lambda(rows: &[Row]) -> Table {
    let mut table = Table::new(
        "lambda",
        "The price of a sensor, ±20 %",
        "Published: two sensors at every price; OS1-64 pitch unchanged at 25.23 degrees, VLP-16 within 4.34 degrees. As \
         published is Bayesian optimization with its rule of stopping, converged the default method.",
        &[
            "sensor",
            "lambda",
            "sensors, as publ.",
            "pitch, as publ.",
            "sensors, converged",
            "pitch, converged",
            "J, converged",
        ],
    );
    for preset in ["paper-os1-64", "paper-vlp-16"] {
        for price in LAMBDAS {
            let of = |part: &str| -> Vec<&Row> {
                let all = chosen(rows, &[("part", part), ("preset", preset)]);
                all.into_iter().filter(|row| number(row, "lambda") == Some(price)).collect()
            };
            let (ours, best) = (of("lambda"), of("lambda, converged"));
            let pitch = |rows: &[&Row]| Spread::of(&pitches_deg(rows)).map_or("none".into(), |s| s.words(2));
            table.rows.push(vec![
                preset.into(),
                chart::number(price, 0),
                words(&ours, "sensors", 1.0, 0),
                pitch(&ours),
                words(&best, "sensors", 1.0, 0),
                pitch(&best),
                words(&best, "j", 1.0, 1),
            ]);
        }
    }
    table
}

/// Rows of one setting of Table 8.
pub(crate) fn of_roll<'a>(rows: &'a [Row], part: &str, preset: &str, roll_deg: Option<f64>) -> Vec<&'a Row> {
    let all = chosen(rows, &[("part", part), ("preset", preset)]);
    all.into_iter().filter(|row| number(row, "roll_deg") == roll_deg).collect()
}

pub(crate) fn table_8(rows: &[Row]) -> Table {
    let mut table = Table::new(
        "table-8",
        "Table 8: roll fixed and free",
        "As published is Bayesian optimization with its rule of stopping; converged is the default method with more \
         evaluations. The published numbers are one run each, re-scored with noisy rays.",
        &[
            "sensor",
            "roll",
            "J publ.",
            "J, as publ.",
            "J, converged",
            "voxels publ.",
            "voxels, as publ.",
            "pitch publ.",
            "pitch, as publ.",
        ],
    );
    for row in &TABLE_8 {
        let ours = of_roll(rows, "table 8", row.preset, row.roll_deg);
        let best = of_roll(rows, "table 8, converged", row.preset, row.roll_deg);
        table.rows.push(vec![
            row.preset.into(),
            row.roll_deg.map_or("free".into(), |roll| format!("{roll:+.0}")),
            chart::number(row.objective, 0),
            words(&ours, "j", 1.0, 0),
            words(&best, "j", 1.0, 0),
            chart::number(row.unique_voxels, 0),
            words(&ours, "unique_voxels", 1.0, 0),
            chart::number(row.pitch_deg, 1),
            Spread::of(&pitches_deg(&ours)).map_or("none".into(), |s| s.words(1)),
        ]);
    }
    table
}
