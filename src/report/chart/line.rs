//! Line charts.

use std::fmt::Write as _;

use super::axis::Axis;
use super::{escape, metadata};

/// A chart of one or more lines over a common x.
#[derive(Clone, Debug, Default)]
pub struct LineChart {
    /// What the picture shows, for readers and screen readers.
    pub title: String,
    /// Label of the x axis, with unit.
    pub x_label: String,
    /// Label of the y axis, with unit.
    pub y_label: String,
    /// Lines.
    pub series: Vec<Series>,
    /// Values between steps hold (best so far), instead of being joined by slanted lines.
    pub steps: bool,
    /// The x axis shows decades.
    pub x_decades: bool,
}

/// One line.
#[derive(Clone, Debug, Default)]
pub struct Series {
    /// Name, written at the line's end.
    pub name: String,
    /// Points in order of x.
    pub points: Vec<[f64; 2]>,
}

const WIDTH: f64 = 720.0;
const HEIGHT: f64 = 300.0;
const LEFT: f64 = 72.0;
const RIGHT: f64 = 110.0;
const TOP: f64 = 14.0;
const BOTTOM: f64 = 44.0;
/// Least distance between two names at the right edge, px.
const NAME_GAP: f64 = 14.0;

impl LineChart {
    /// The picture.
    pub fn svg(&self) -> String {
        let all = || self.series.iter().flat_map(|series| &series.points);
        let xs = all().map(|p| p[0]);
        let x = match self.x_decades {
            true => Axis::decades(xs, LEFT, WIDTH - RIGHT),
            false => Axis::around(xs, LEFT, WIDTH - RIGHT, 8),
        };
        let y = Axis::around(all().map(|p| p[1]), HEIGHT - BOTTOM, TOP, 5);
        let mut svg = format!(
            "<svg class=\"chart\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{}\">",
            escape(&self.title)
        );
        for (at, label) in y.ticks() {
            let _ = write!(
                svg,
                "<path class=\"grid\" d=\"M{LEFT} {at:.1}H{:.1}\"/><text x=\"{:.1}\" y=\"{:.1}\" \
                 text-anchor=\"end\">{label}</text>",
                WIDTH - RIGHT,
                LEFT - 6.0,
                at + 4.0
            );
        }
        for (at, label) in x.ticks() {
            let _ = write!(
                svg,
                "<path class=\"grid\" d=\"M{at:.1} {:.1}v4\"/><text x=\"{at:.1}\" y=\"{:.1}\" \
                 text-anchor=\"middle\">{label}</text>",
                HEIGHT - BOTTOM,
                HEIGHT - BOTTOM + 17.0
            );
        }
        let middle = (HEIGHT - BOTTOM + TOP) / 2.0;
        let _ = write!(
            svg,
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>\
             <text transform=\"translate(14 {middle:.1}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
            (LEFT + WIDTH - RIGHT) / 2.0,
            HEIGHT - 8.0,
            escape(&self.x_label),
            escape(&self.y_label)
        );
        let mut names = Vec::new();
        for (place, series) in self.series.iter().enumerate() {
            let Some(last) = series.points.last() else { continue };
            // colours come round again: from there on lines are broken
            let dashes = if place < 6 { "" } else { " stroke-dasharray=\"6 3\"" };
            let path = self.path(series, &x, &y);
            let _ = write!(svg, "<path class=\"line s{}\"{dashes} d=\"{path}\"/>", place % 6);
            names.push((y.px(last[1]) + 4.0, place, &series.name));
        }
        names.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut free_from = 0.0;
        for (wanted, place, name) in names {
            let at = f64::max(wanted, free_from);
            free_from = at + NAME_GAP;
            let _ = write!(
                svg,
                "<text class=\"s{}\" x=\"{:.1}\" y=\"{at:.1}\">{}</text>",
                place % 6,
                WIDTH - RIGHT + 6.0,
                escape(name)
            );
        }
        let rows =
            self.series.iter().flat_map(|series| series.points.iter().map(|at| (series.name.as_str(), *at)));
        svg += &metadata(["series", &self.x_label, &self.y_label], rows);
        svg.push_str("</svg>");
        svg
    }

    fn path(&self, series: &Series, x: &Axis, y: &Axis) -> String {
        let mut path = String::new();
        for (place, point) in series.points.iter().enumerate() {
            let (at_x, at_y) = (x.px(point[0]), y.px(point[1]));
            let _ = match (place, self.steps) {
                (0, _) => write!(path, "M{at_x:.1} {at_y:.1}"),
                (_, true) => write!(path, "H{at_x:.1}V{at_y:.1}"),
                (_, false) => write!(path, "L{at_x:.1} {at_y:.1}"),
            };
        }
        path
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_at_the_edge_do_not_collide() {
        let series =
            |name: &str, end: f64| Series { name: name.into(), points: vec![[0.0, 0.0], [1.0, end]] };
        let chart =
            LineChart { series: vec![series("a", 1.0), series("b<", 1.0001)], ..LineChart::default() };
        let svg = chart.svg();
        assert!(svg.contains("b&lt;") && !svg.contains("b<<"));
        assert!(
            svg.contains("<metadata>series,,\r\na,0,0\r\na,1,1\r\nb&lt;,0,0\r\nb&lt;,1,1.0001</metadata>"),
            "{svg}"
        );
        let heights: Vec<f64> = svg
            .split("<text class=\"s")
            .skip(1)
            .map(|text| text.split("y=\"").nth(1).unwrap().split('"').next().unwrap().parse().unwrap())
            .collect();
        assert!((heights[0] - heights[1]).abs() >= NAME_GAP - 0.2, "{heights:?}");
    }
}
