//! Rays by sensor, channel, azimuth and incidence.

use crate::report::Report;
use crate::report::chart::{CellClass, CellMap, LineChart, Series, count};
use crate::report::values::percent;
use crate::verify::compare::{Breakdown, RayClasses, Replayed, SECTORS};
use crate::verify::judgement::comparison::Comparison;

pub(super) fn rays_section(report: &mut Report, comparison: &Comparison, replayed: &Replayed) {
    report.fold("Every recorded ray", "by sensor, channel, azimuth and incidence");
    let rows: Vec<Vec<String>> = comparison
        .rays
        .iter()
        .map(|(sensor, rays)| {
            let c = &rays.classes;
            let counts = [c.agree, c.short, c.long, c.drop, c.extra, c.nothing, c.unplaced];
            let head = [sensor.clone(), percent(rays.agree_share)];
            head.into_iter().chain(counts.map(count)).collect()
        })
        .collect();
    let header = ["sensor", "agree", "agree", "short", "long", "drop", "extra", "nothing", "unplaced"];
    report.table(&header, rows);
    let classes = strip_classes();
    for (sensor, breakdown) in replayed.sensors.iter().zip(&replayed.breakdown) {
        let strips = [strip(&sensor.name, breakdown)];
        if strips[0].cells.iter().flatten().all(|class| *class == 0) {
            report.note(format!("{}: in every direction at least 95 % of the rays agree.", sensor.name));
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
    report.chart(&chart.svg(), "The more obliquely a surface is seen, the more a pose error shows.");
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
    let class = |cell: &RayClasses| {
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
    CellMap {
        title: name.to_owned(),
        width: SECTORS,
        cells: breakdown.strip.iter().map(class).collect(),
        plan: None,
    }
}
