//! What coverage costs: the most voxels seen for each number of sensors and each least angle between spin axes.
//!
//! A front by constraints (Haimes, Lasdon, Wismer 1971, doi:10.1109/TSMC.1971.4308298): one search for each number of
//! sensors and angle, an angle that is too small being so dear that no better coverage pays for it.

use serde_json::Value;

use super::rows::{chosen, number, numbers};
use super::searches::{self, SearchTask};
use super::{Figure, Findings, Row, Size, Study, StudyError, Table};
use crate::design::optimize::Kind;
use crate::report::chart::{self, LineChart, Series};

const ANGLES_DEG: [f64; 6] = [0.0, 30.0, 60.0, 90.0, 120.0, 150.0];
const EVALUATIONS: usize = 1000;
const QUICK_EVALUATIONS: usize = 40;

/// See the module.
#[derive(Debug)]
pub struct Pareto;

impl Study for Pareto {
    fn name(&self) -> &'static str {
        "pareto"
    }

    fn about(&self) -> &'static str {
        "How much coverage does each sensor add, and how much does a wider angle between the spin axes cost?"
    }

    fn tasks(&self, size: &Size) -> Result<Vec<Value>, StudyError> {
        let mut tasks = Vec::new();
        for preset in ["paper-os1-64", "paper-vlp-16"] {
            for path in ["lateral", "forward"] {
                for masters in 1..=2 {
                    for angle_deg in ANGLES_DEG {
                        for seed in 1..=size.seeds {
                            tasks.push(SearchTask {
                                path: path.into(),
                                masters: [masters, masters],
                                least_angle_deg: Some(angle_deg),
                                evaluations: if size.quick { QUICK_EVALUATIONS } else { EVALUATIONS },
                                as_published: false,
                                ..SearchTask::published("pareto", preset, Kind::Staged, seed)
                            });
                        }
                    }
                }
            }
        }
        Ok(searches::values(&tasks))
    }

    fn run(&self, task: &Value) -> Result<Vec<Row>, StudyError> {
        Ok(vec![searches::task(task)?.run()?.row])
    }

    fn findings(&self, rows: &[Row]) -> Findings {
        let mut table = Table::new(
            "pareto",
            "Most voxels seen, by number of sensors and least angle",
            "Best over the seeds among mounts that keep the angle; a point is on the front unless another with as few sensors and \
             as wide an angle sees more.",
            &[
                "sensor",
                "path",
                "sensors",
                "least angle asked",
                "angle",
                "voxels",
                "overlap %",
                "on the front",
            ],
        );
        let mut figures = Vec::new();
        for preset in ["paper-os1-64", "paper-vlp-16"] {
            for path in ["lateral", "forward"] {
                let points = points(rows, preset, path);
                let dominated = |p: &Point| {
                    let beats = |q: &&Point| {
                        q.sensors <= p.sensors && q.angle_deg >= p.angle_deg && q.voxels > p.voxels
                    };
                    points.iter().any(|q| beats(&q))
                };
                for point in &points {
                    table.rows.push(vec![
                        preset.into(),
                        path.into(),
                        chart::number(point.sensors, 0),
                        chart::number(point.asked_deg, 0),
                        chart::number(point.angle_deg, 1),
                        chart::number(point.voxels, 0),
                        chart::number(100.0 * point.overlap_ratio, 1),
                        if dominated(point) { "no".into() } else { "yes".into() },
                    ]);
                }
                figures.push(figure(&points, preset, path));
            }
        }
        let front = table.rows.iter().filter(|row| row.last().is_some_and(|cell| cell == "yes")).count();
        let summary = format!("{front} of {} settings lie on a front.", table.rows.len());
        Findings { summary, tables: vec![table], figures, ..Findings::default() }
    }
}

struct Point {
    sensors: f64,
    asked_deg: f64,
    angle_deg: f64,
    voxels: f64,
    overlap_ratio: f64,
}

fn points(rows: &[Row], preset: &str, path: &str) -> Vec<Point> {
    let here = chosen(rows, &[("preset", preset), ("path", path)]);
    let mut points = Vec::new();
    for sensors in [2.0, 4.0] {
        for asked_deg in ANGLES_DEG {
            let best = here
                .iter()
                .filter(|row| {
                    number(row, "sensors") == Some(sensors)
                        && number(row, "least_angle_deg") == Some(asked_deg)
                })
                .filter(|row| number(row, "min_angle_deg").is_some_and(|angle| angle >= asked_deg))
                .max_by(|a, b| {
                    numbers(&[a], "unique_voxels")[0].total_cmp(&numbers(&[b], "unique_voxels")[0])
                });
            let Some(row) = best else { continue };
            let field = |name: &str| number(row, name).unwrap_or(0.0);
            points.push(Point {
                sensors,
                asked_deg,
                angle_deg: field("min_angle_deg"),
                voxels: field("unique_voxels"),
                overlap_ratio: field("overlap_ratio"),
            });
        }
    }
    points
}

fn figure(points: &[Point], preset: &str, path: &str) -> Figure {
    let series = [2.0, 4.0].map(|sensors| Series {
        name: format!("{sensors:.0} sensors"),
        points: points.iter().filter(|p| p.sensors == sensors).map(|p| [p.asked_deg, p.voxels]).collect(),
    });
    let chart = LineChart {
        title: format!("Coverage against angle, {preset}, path {path}"),
        x_label: "least angle between spin axes, degrees".into(),
        y_label: "voxels seen".into(),
        series: series.into_iter().filter(|series| !series.points.is_empty()).collect(),
        ..LineChart::default()
    };
    let caption = format!("{preset}, path {path}: most voxels found with at least this angle.");
    Figure { svg: chart.svg(), caption }
}
