//! Positions of the mounts from the platform's origin, as dimension lines: each once, the nearest one inside.

use glam::{DVec2, DVec3};

use super::project::{Plane, Solid};
use super::{Anchor, Layer, Measure, Shape, Sheet, arrow_head, text_width};

/// From one dimension line to the next, mm on paper.
pub(super) const STEP_MM: f64 = 7.0;
/// Height of a dimension's number, mm on paper.
const NUMBER_MM: f64 = 2.5;
/// Shorter ones are none, mm: a hole is not drilled to that.
const LEAST_MM: f64 = 0.005;
/// More lines than these make no drawing: the table has every position.
const MOST_LINES: usize = 6;
/// Where the first line stands, beyond the rig, mm on paper.
const FIRST_MM: f64 = 9.0;

/// The positions of a view along one direction, those on one side of the origin: nearest first, each value once.
fn values(solids: &[Solid<'_>], plane: Plane, is_upright: bool, is_positive: bool) -> Vec<(f64, DVec2)> {
    if !is_shown(plane, is_upright) {
        return Vec::new();
    }
    let mut values: Vec<(f64, DVec2)> = Vec::new();
    for solid in solids {
        let point = plane.flat(solid.origin);
        let value = if is_upright { point.y } else { point.x };
        let is_new = values.iter().all(|(other, _)| (other - value).abs() > LEAST_MM);
        if value.abs() > LEAST_MM && (value > 0.0) == is_positive && is_new {
            values.push((value, point));
        }
    }
    values.sort_by(|(a, _), (b, _)| a.abs().total_cmp(&b.abs()));
    values.truncate(MOST_LINES);
    values
}

/// x stands below the front view, y left of the top view and below the side view, z left of the front view.
fn is_shown(plane: Plane, is_upright: bool) -> bool {
    match plane {
        Plane::Top => is_upright,
        Plane::Front => true,
        Plane::Side => !is_upright,
    }
}

/// How many lines stand next to each other.
pub(super) fn levels(solids: &[Solid<'_>], plane: Plane, is_upright: bool) -> usize {
    let lines = |is_positive| values(solids, plane, is_upright, is_positive).len();
    lines(true).max(lines(false))
}

/// Draws them; the rooms that their numbers take.
pub(super) fn draw(
    sheet: &mut Sheet,
    plane: Plane,
    at: DVec2,
    solids: &[Solid<'_>],
    (low, _): (DVec3, DVec3),
) -> Vec<(DVec2, DVec2)> {
    let edge = plane.flat(low) + at;
    let mut rooms = Vec::new();
    for is_upright in [false, true] {
        for is_positive in [true, false] {
            for (level, (value, point)) in
                values(solids, plane, is_upright, is_positive).into_iter().enumerate()
            {
                let line_at = edge - sheet.paper(FIRST_MM + STEP_MM * level as f64);
                let measure = measure(sheet, at, point + at, line_at, is_upright, value);
                let half = 0.5 * text_width(&measure.text, sheet.paper(NUMBER_MM));
                let high = sheet.paper(NUMBER_MM);
                let (below, above) = if is_upright {
                    (DVec2::new(-high, -half), DVec2::new(0.0, half))
                } else {
                    (DVec2::new(-half, 0.0), DVec2::new(half, high))
                };
                rooms.push((measure.text_at + below, measure.text_at + above));
                sheet.put(Layer::Dimension, Shape::Dimension(measure));
            }
        }
    }
    rooms
}

/// A dimension from the origin to a point; its line leads through `line_at`.
fn measure(sheet: &Sheet, from: DVec2, to: DVec2, line_at: DVec2, is_upright: bool, value: f64) -> Measure {
    let text = number(value.abs());
    let height = sheet.paper(NUMBER_MM);
    let along = if is_upright { DVec2::Y } else { DVec2::X } * value.signum();
    let on_line = |point: DVec2| {
        if is_upright { DVec2::new(line_at.x, point.y) } else { DVec2::new(point.x, line_at.y) }
    };
    let (start, end) = (on_line(from), on_line(to));
    let width = text_width(&text, height);
    let is_wide = value.abs() > width + sheet.paper(6.0);
    let gap = sheet.paper(0.8);
    let mut parts = Vec::new();
    // witness lines begin next to what they measure and end beyond the line
    for (point, foot) in [(from, start), (to, end)] {
        let down = (foot - point).normalize_or_zero();
        parts.push(Shape::Line(point + down * sheet.paper(1.5), foot + down * sheet.paper(1.2)));
    }
    let middle = if is_wide {
        parts.push(Shape::Line(start, end));
        parts.push(arrow_head(start, -along, sheet.scale));
        parts.push(arrow_head(end, along, sheet.scale));
        0.5 * (start + end)
    } else {
        // arrows from outside, the number beyond
        let tail = end + along * (sheet.paper(5.0) + width);
        parts.push(Shape::Line(start - along * sheet.paper(5.0), tail));
        parts.push(arrow_head(start, along, sheet.scale));
        parts.push(arrow_head(end, -along, sheet.scale));
        end + along * (sheet.paper(4.0) + 0.5 * width)
    };
    let text_at = middle + if is_upright { DVec2::new(-gap, 0.0) } else { DVec2::new(0.0, gap) };
    parts.push(Shape::Text { at: text_at, height, anchor: Anchor::Middle, is_upright, text: text.clone() });
    Measure { from, to, line_at: end, is_upright, text, text_at, parts }
}

/// Millimetres to a hundredth, without zeros behind it.
pub(super) fn number(value_mm: f64) -> String {
    let text = format!("{value_mm:.2}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".into() } else { text.into() }
}
