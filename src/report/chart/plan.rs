//! What makes a map of cells a plan: ticks in metres along both sides, a scale bar, the trajectory and the sensors.

use std::fmt::Write as _;

use super::axis::round_step;
use super::{escape, number};

/// Longer side of a plan's cells, px.
const SIDE_PX: f64 = 560.0;
/// Room for labels left of the cells, below them, and at the other two sides, px.
const MARGINS_PX: [f64; 3] = [54.0, 78.0, 12.0];
/// Ticks along the longer side.
const TICKS: f64 = 6.0;
/// Colours of single sensors, as in the 3-D view.
const SENSOR_CSS: [&str; 3] = ["c-left", "c-right", "c-odd"];

/// A direction of a plan: what it is called, and metres at the edge of its first cell and from cell to cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PlanAxis {
    pub name: &'static str,
    pub first_m: f64,
    pub step_m: f64,
}

impl PlanAxis {
    fn cells(&self, value_m: f64) -> f64 {
        (value_m - self.first_m) / self.step_m
    }
}

/// Where a map lies, and what stands on it, m: across the page and up.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Plan {
    pub across: PlanAxis,
    pub up: PlanAxis,
    pub track_m: Vec<[f64; 2]>,
    pub sensors: Vec<(String, [f64; 2])>,
}

impl Plan {
    /// The same in squares of so many cells.
    pub(super) fn coarse(&self, step: usize) -> Self {
        let wider = |axis: PlanAxis| PlanAxis { step_m: step as f64 * axis.step_m, ..axis };
        Self { across: wider(self.across), up: wider(self.up), ..self.clone() }
    }

    /// Width of the picture, px.
    pub(super) fn width_px(cells: [usize; 2]) -> f64 {
        let [left, _, other] = MARGINS_PX;
        left + cells[0] as f64 * cell_px(cells) + other
    }

    /// The view box, and a picture's content around that of its cells.
    pub(super) fn around(&self, cells: [usize; 2], body: &str) -> (String, String) {
        let px = cell_px(cells);
        let [left, below, other] = MARGINS_PX;
        let [width, height] = cells.map(|count| count as f64 * px);
        let (bottom, right) = (other + height, left + width);
        let at = |[across_m, up_m]: [f64; 2]| {
            [left + px * self.across.cells(across_m), bottom - px * self.up.cells(up_m)]
        };
        let mut marks = String::new();
        let span_m = |axis: &PlanAxis, count: usize| (axis.step_m * count as f64).abs();
        let longest_m = span_m(&self.across, cells[0]).max(span_m(&self.up, cells[1]));
        let step_m = round_step(longest_m / TICKS);
        for value_m in ticks_m(&self.across, cells[0], step_m) {
            let [x, _] = at([value_m, self.up.first_m]);
            let label = label(value_m, step_m);
            let _ = write!(
                marks,
                "<path class=\"tick\" d=\"M{x:.1} {bottom:.1}v5\"/><text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{label}</text>",
                bottom + 17.0
            );
        }
        for value_m in ticks_m(&self.up, cells[1], step_m) {
            let [_, y] = at([self.across.first_m, value_m]);
            let label = label(value_m, step_m);
            let _ = write!(
                marks,
                "<path class=\"tick\" d=\"M{left:.1} {y:.1}h-5\"/><text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{label}</text>",
                left - 8.0,
                y + 4.0
            );
        }
        // the scale bar, and the names of the axes
        let bar_m = round_step(0.6 * step_m);
        let (bar_px, bar_y) = (bar_m / self.across.step_m.abs() * px, bottom + 38.0);
        let _ = write!(
            marks,
            "<path class=\"tick\" d=\"M{left:.1} {:.1}v8M{left:.1} {bar_y:.1}h{bar_px:.1}m0 -4v8\"/>\
             <text x=\"{:.1}\" y=\"{:.1}\">{} m</text>\
             <text x=\"{left:.1}\" y=\"{:.1}\">{} across, {} up, m</text>",
            bar_y - 4.0,
            left + bar_px + 6.0,
            bar_y + 4.0,
            number(bar_m, decimals(bar_m)),
            bar_y + 24.0,
            self.across.name,
            self.up.name
        );
        let track: Vec<String> =
            self.track_m.iter().map(|place| at(*place)).map(|[x, y]| format!("{x:.1} {y:.1}")).collect();
        if track.len() > 1 {
            let _ = write!(marks, "<path class=\"track\" d=\"M{}\"/>", track.join("L"));
        }
        for (at_sensor, (name, place)) in self.sensors.iter().enumerate() {
            let ([x, y], css) = (at(*place), SENSOR_CSS[at_sensor.min(SENSOR_CSS.len() - 1)]);
            let _ = write!(
                marks,
                "<circle class=\"sensor {css}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"5\"><title>{}</title></circle>",
                escape(name)
            );
        }
        let view = format!("0 0 {:.0} {:.0}", right + other, bottom + below);
        let content = format!(
            "<g transform=\"translate({left} {other}) scale({px:.4})\">{body}</g>\
             <rect class=\"frame\" x=\"{left}\" y=\"{other}\" width=\"{width:.1}\" height=\"{height:.1}\"/>\
             <g class=\"plan\" shape-rendering=\"auto\">{marks}</g>"
        );
        (view, content)
    }
}

fn cell_px([width, height]: [usize; 2]) -> f64 {
    SIDE_PX / width.max(height).max(1) as f64
}

/// Round values along a side.
fn ticks_m(axis: &PlanAxis, cells: usize, step_m: f64) -> impl Iterator<Item = f64> {
    let last_m = axis.first_m + axis.step_m * cells as f64;
    let (low_m, high_m) = (axis.first_m.min(last_m), axis.first_m.max(last_m));
    let first = (low_m / step_m - 1e-6).ceil() as i64;
    let last = (high_m / step_m + 1e-6).floor() as i64;
    (first..=last).map(move |at| at as f64 * step_m)
}

fn decimals(step_m: f64) -> usize {
    (-step_m.log10().floor()).max(0.0) as usize
}

fn label(value_m: f64, step_m: f64) -> String {
    number(value_m, decimals(step_m))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_stand_where_their_metres_are_and_the_bar_is_as_long_as_it_says() {
        let plan = Plan {
            across: PlanAxis { name: "y", first_m: 6.0, step_m: -0.1 },
            up: PlanAxis { name: "x", first_m: -2.0, step_m: 0.1 },
            track_m: vec![[0.0, 0.0], [0.0, 2.0]],
            sensors: vec![("left".into(), [0.5, 0.0])],
        };
        let (view, svg) = plan.around([120, 80], "");
        let px_per_m = 560.0 / 12.0;
        let [left, _, top] = MARGINS_PX;
        assert_eq!(
            view,
            format!("0 0 {:.0} {:.0}", left + 560.0 + top, top + 8.0 * px_per_m + MARGINS_PX[1])
        );
        // y = 4 m lies 2 m right of the left edge, x = 0 lies 2 m above the lower one
        let x = left + 2.0 * px_per_m;
        assert!(
            svg.contains(&format!(
                "<text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">4<",
                top + 8.0 * px_per_m + 17.0
            )),
            "{svg}"
        );
        let y = top + 6.0 * px_per_m;
        assert!(svg.contains(&format!("y=\"{:.1}\" text-anchor=\"end\">0<", y + 4.0)), "{svg}");
        assert!(svg.contains(&format!("h{:.1}m0 -4v8", 2.0 * px_per_m)) && svg.contains(">2 m<"), "{svg}");
        let start = left + 6.0 * px_per_m;
        assert!(svg.contains(&format!("class=\"track\" d=\"M{start:.1} {y:.1}L")), "{svg}");
        assert!(svg.contains("<title>left</title>"));
    }

    #[test]
    fn a_coarse_plan_keeps_its_metres() {
        let axis = PlanAxis { name: "x", first_m: 1.0, step_m: 0.5 };
        let plan = Plan { across: axis, up: axis, track_m: Vec::new(), sensors: Vec::new() };
        assert_eq!(plan.coarse(4).across, PlanAxis { name: "x", first_m: 1.0, step_m: 2.0 });
    }
}
