//! The picture of signs: the direction in which a positive pitch, roll and yaw turn a sensor.

use glam::DVec2;

use super::{Anchor, Layer, Shape, Sheet};

/// From one picture to the next, mm on paper.
const STEP_MM: f64 = 48.0;

/// Draws it with its upper left at a place of the sheet.
pub(super) fn draw(sheet: &mut Sheet, at: DVec2) {
    let paper = |x: f64, y: f64| at + DVec2::new(sheet.paper(x), sheet.paper(y));
    let heading = paper(4.0, -7.0);
    let pictures = [
        (paper(24.0, -34.0), "+ pitch", "seen from behind:", "the top goes right", false),
        (paper(24.0 + STEP_MM, -34.0), "+ roll", "seen from the right:", "the top goes back", true),
        (paper(24.0 + 2.0 * STEP_MM, -34.0), "+ yaw", "seen from above:", "the front goes left", true),
    ];
    sheet.text(Layer::Text, heading, 3.0, Anchor::Start, "SIGNS OF ANGLES");
    for (index, (foot, name, from, what, is_left)) in pictures.into_iter().enumerate() {
        picture(sheet, foot, is_left, index == 2);
        for (line, (height, words)) in [(2.8, name), (2.0, from), (2.0, what)].into_iter().enumerate() {
            let below = foot - DVec2::new(0.0, sheet.paper(9.0 + 3.6 * line as f64));
            sheet.text(Layer::Text, below, height, Anchor::Middle, words);
        }
    }
    let notes = [
        "Order: roll, then pitch about the plate's forward axis (the servo), then yaw about the spin axis.",
        "Red cross: optical centre. Thick: bottom plane. Blue: lowest and highest beam.",
        "Thin circle: housing at pitch and roll 0. Box: connector side. Arrow: front of the sensor.",
    ];
    for (line, words) in notes.into_iter().enumerate() {
        let note = at + DVec2::new(sheet.paper(4.0), -sheet.paper(55.0 + 3.4 * line as f64));
        sheet.text(Layer::Text, note, 1.8, Anchor::Start, words);
    }
}

fn picture(sheet: &mut Sheet, foot: DVec2, is_left: bool, is_from_above: bool) {
    let side = if is_left { 1.0 } else { -1.0 };
    let angle_deg = 30.0;
    let radius = sheet.paper(17.0);
    let to = DVec2::from_angle(side * f64::to_radians(angle_deg)).rotate(DVec2::Y);
    if is_from_above {
        let centre = foot;
        sheet.put(Layer::Outline, Shape::Circle { centre, radius: sheet.paper(5.0) });
        sheet.line(Layer::Outline, centre, centre + to * sheet.paper(5.0));
    } else {
        let (across, height) = (to.perp() * sheet.paper(5.0), to * sheet.paper(9.0));
        let points = vec![foot + across, foot + across + height, foot - across + height, foot - across];
        sheet.put(Layer::Outline, Shape::Polyline { points, is_closed: true });
        sheet.line(Layer::Bottom, foot + across, foot - across);
    }
    sheet.line(Layer::Centre, foot, foot + (radius + sheet.paper(2.0)) * DVec2::Y);
    sheet.line(Layer::Centre, foot, foot + (radius + sheet.paper(2.0)) * to);
    let [from_deg, to_deg] = if is_left { [90.0, 90.0 + angle_deg] } else { [90.0 - angle_deg, 90.0] };
    sheet.put(Layer::Dimension, Shape::Arc { centre: foot, radius, from_deg, to_deg });
    sheet.arrow(Layer::Dimension, foot + radius * to, side * to.perp());
    let words = foot + (radius + sheet.paper(4.0)) * DVec2::from_angle(side * 0.26).rotate(DVec2::Y);
    sheet.text(Layer::Text, words, 3.0, Anchor::Middle, "+");
}
