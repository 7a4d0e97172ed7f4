//! Ways from a frame's ranges to points: time against error.

use std::time::Instant;

use glam::DVec3;
use sensors::projection::{Projector, points_f64};
use sensors::{Frame, SensorModel};
use serde_json::{Value, json};

use crate::base::rng::Rng;
use crate::base::statistics::{quantile, sorted};
use crate::report::chart::{self, NamedPoint, ScatterChart};
use crate::study::rows::{Row, chosen, number, text};
use crate::study::{Figure, Findings, StudyError, Table};

/// Sensors and columns of their frames.
const SENSORS: [(&str, usize); 3] = [("os1-64", 1024), ("vlp-16", 1800), ("hdl-64e-s2", 2083)];
const METHODS: [&str; 3] = ["sample by sample, f64", "tables, f64", "tables, f32"];
const PART: &str = "decoders";
/// Max range, mm.
const FARTHEST_MM: u64 = 100_000;

pub(super) fn tasks(quick: bool) -> Vec<Value> {
    let task = |(sensor, columns): (&str, usize), method: &str| json!({"part": PART, "sensor": sensor, "columns": columns, "way": method, "frames": if quick { 5 } else { 101 }});
    SENSORS.into_iter().flat_map(|sensor| METHODS.map(|method| task(sensor, method))).collect()
}

pub(super) fn is_mine(task: &Value) -> bool {
    task["part"] == PART
}

/// A revolution with a return of a random range for every sample.
fn frame(model: &SensorModel, columns: usize) -> Frame {
    let mut rng = Rng::new(1, 0);
    let turn_rad = std::f64::consts::TAU / columns as f64;
    let mut frame = Frame {
        channels: model.channels(),
        column_time_ns: vec![1; columns],
        column_azimuth_rad: (0..columns).map(|column| turn_rad * column as f64).collect(),
        column_valid: vec![true; columns],
        // 10 revolutions per second
        azimuth_rate_rad_per_ns: 10.0 * std::f64::consts::TAU * 1e-9,
        ..Frame::default()
    };
    let samples = columns * model.channels();
    frame.first.range_mm = (0..samples).map(|_| 500 + rng.below(FARTHEST_MM - 500) as u32).collect();
    frame
}

pub(super) fn run(task: &Value) -> Result<Vec<Row>, StudyError> {
    let missing = || StudyError(format!("the task is none of the decoders: {task}"));
    let sensor = task["sensor"].as_str().ok_or_else(missing)?;
    let columns = task["columns"].as_u64().ok_or_else(missing)? as usize;
    let frames = task["frames"].as_u64().ok_or_else(missing)? as usize;
    let method = task["way"].as_str().ok_or_else(missing)?;
    let model = sensors::catalogue::nominal(sensor).map_err(StudyError::of)?;
    let frame = frame(&model, columns);
    let mut exact = Vec::new();
    points_f64(&model, &frame, &frame.first, &mut exact);
    let mut projector = Projector::new(&model);
    let (mut times_ns, mut points) = (Vec::new(), Vec::new());
    let (mut double, mut single) = (Vec::new(), Vec::new());
    for _ in 0..frames {
        let start = Instant::now();
        match method {
            "tables, f64" => projector.points_f64(&frame, &frame.first, &mut double),
            "tables, f32" => projector.points_f32(&frame, &frame.first, &mut single),
            _ => points_f64(&model, &frame, &frame.first, &mut points),
        }
        times_ns.push(start.elapsed().as_nanos() as f64 / exact.len() as f64);
    }
    match method {
        "tables, f64" => points = double.iter().map(|point| DVec3::from(*point)).collect(),
        "tables, f32" => points = single.iter().map(|point| DVec3::from(point.map(f64::from))).collect(),
        _ => {}
    }
    let errors_mm = sorted(points.iter().zip(&exact).map(|(point, exact)| 1e3 * point.distance(*exact)));
    let mut row = task.as_object().cloned().unwrap_or_default();
    row.insert("points".into(), json!(exact.len()));
    row.insert("median_error_mm".into(), json!(quantile(&errors_mm, 0.5)));
    row.insert("greatest_error_mm".into(), json!(quantile(&errors_mm, 1.0)));
    row.insert("wall_ns_per_point".into(), json!(quantile(&sorted(times_ns), 0.5)));
    Ok(vec![row])
}

/// A chart and a table of all sensors.
pub(super) fn add_findings(rows: &[Row], findings: &mut Findings) {
    let mine = chosen(rows, &[("part", PART)]);
    if mine.is_empty() {
        return;
    }
    let mut table = Table::new(
        PART,
        "From ranges to points",
        "One revolution with a return of 0.5 to 100 m for every sample, against the exact method: sample by sample in f64. Times \
         are medians on one thread, in times.csv.",
        &["sensor", "method", "points", "median error, mm", "max error, mm"],
    );
    let of = |row: &Row, name: &str| number(row, name).unwrap_or(f64::NAN);
    for row in &mine {
        table.rows.push(vec![
            text(row, "sensor").into(),
            text(row, "way").into(),
            chart::number(of(row, "points"), 0),
            format!("{:.1e}", of(row, "median_error_mm")),
            format!("{:.1e}", of(row, "greatest_error_mm")),
        ]);
    }
    let point = |row: &&Row| NamedPoint {
        name: format!("{}: {}", text(row, "sensor"), text(row, "way")),
        at: [of(row, "wall_ns_per_point"), of(row, "greatest_error_mm")],
        group: SENSORS.iter().position(|(name, _)| *name == text(row, "sensor")).unwrap_or(0) + 1,
    };
    let chart = ScatterChart {
        title: "Error against time: from ranges to points".into(),
        x_label: "time per point on one thread, ns".into(),
        y_label: "max error, mm".into(),
        points: mine.iter().map(point).collect(),
    };
    findings.figures.push(Figure {
        svg: chart.svg(),
        caption: "From ranges to points; filled ones lie on the front. The exact method is its own reference and stands on the \
                  edge."
            .into(),
    });
    findings.tables.push(table);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_are_as_near_as_they_say() {
        let rows: Vec<Row> = tasks(true).iter().flat_map(|task| run(task).unwrap()).collect();
        assert_eq!(rows.len(), 9);
        for row in &rows {
            let error_mm = number(row, "greatest_error_mm").unwrap();
            match text(row, "way") {
                "tables, f64" => assert!(error_mm > 0.0 && error_mm < 1e-6, "{row:?}"),
                "tables, f32" => assert!(error_mm > 1e-4 && error_mm < 0.06, "{row:?}"),
                _ => assert_eq!(error_mm, 0.0),
            }
            assert!(number(row, "wall_ns_per_point").unwrap() > 0.0);
        }
        let mut findings = Findings::default();
        add_findings(&rows, &mut findings);
        assert_eq!((findings.tables[0].rows.len(), findings.figures.len()), (9, 1));
    }
}
