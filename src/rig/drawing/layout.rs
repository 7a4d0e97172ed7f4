//! Where views, table and title block stand on the sheet, and at which scale.

use glam::{DVec2, DVec3};

use super::project::{Plane, Solid};
use super::{Anchor, Layer, PAPER_MM, Shape, Sheet, dimensions, signs, table, view};
use crate::rig::FramedSensor;

/// Scales of ISO 5455, as what 1 mm on paper is, mm.
const SCALES: [f64; 11] = [0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0];
/// Between border and edge, mm on paper.
const MARGIN_MM: f64 = 10.0;
/// Around a view, for its title, angles and fields of view, mm on paper.
const AROUND_MM: f64 = 22.0;
/// The upper right has the pictures of signs at least, mm on paper.
const SIGNS_MM: DVec2 = DVec2::new(150.0, 66.0);

/// What the views need around the sensors.
struct Needs {
    /// Extent of the rig with the platform's origin in it, mm.
    low: DVec3,
    high: DVec3,
    /// Dimension lines left of the left views, below the front view, and below the side view.
    left_lines: usize,
    below_front: usize,
    below_side: usize,
}

/// Where the platform's origin lies in each view, on the sheet, mm.
struct Places {
    scale: f64,
    top: DVec2,
    front: DVec2,
    side: DVec2,
    signs: DVec2,
}

/// The whole drawing.
pub(super) fn sheet(title: &str, sensors: &[FramedSensor]) -> Sheet {
    let solids: Vec<Solid<'_>> = sensors.iter().map(Solid::of).collect();
    let strip_mm = table::height_mm(solids.len());
    let needs = Needs::of(&solids);
    let places = places(&needs, strip_mm);
    let mut sheet = Sheet::new(places.scale, title);
    border(&mut sheet);
    for (plane, at) in [(Plane::Top, places.top), (Plane::Front, places.front), (Plane::Side, places.side)] {
        let rooms = dimensions::draw(&mut sheet, plane, at, &solids, (needs.low, needs.high));
        view::draw(&mut sheet, plane, at, &solids, (needs.low, needs.high), rooms);
    }
    signs::draw(&mut sheet, places.signs);
    table::draw(&mut sheet, &solids, DVec2::splat(MARGIN_MM));
    sheet
}

impl Needs {
    fn of(solids: &[Solid<'_>]) -> Self {
        let mut needs =
            Self { low: DVec3::ZERO, high: DVec3::ZERO, left_lines: 0, below_front: 0, below_side: 0 };
        for solid in solids {
            let [low, high] = solid.reach();
            (needs.low, needs.high) = (needs.low.min(low), needs.high.max(high));
        }
        let lines = |plane, is_upright| dimensions::levels(solids, plane, is_upright);
        needs.left_lines = lines(Plane::Top, true).max(lines(Plane::Front, true));
        needs.below_front = lines(Plane::Front, false);
        needs.below_side = lines(Plane::Side, false);
        needs
    }
}

/// The largest scale at which all views fit next to each other, third angle: top above front, side to the right of it.
fn places(needs: &Needs, strip_mm: f64) -> Places {
    let size = needs.high - needs.low;
    let room = PAPER_MM - 2.0 * MARGIN_MM - DVec2::new(0.0, strip_mm);
    let left_mm = AROUND_MM + dimensions::STEP_MM * needs.left_lines as f64;
    let below_mm = 14.0 + dimensions::STEP_MM * needs.below_front.max(needs.below_side) as f64;
    let fits = |scale: f64| {
        let columns =
            [left_mm + size.x / scale + AROUND_MM, (2.0 * AROUND_MM + size.y / scale).max(SIGNS_MM.x)];
        let rows =
            [(2.0 * AROUND_MM + size.y / scale).max(SIGNS_MM.y), AROUND_MM + size.z / scale + below_mm];
        (columns.iter().sum::<f64>() <= room.x && rows.iter().sum::<f64>() <= room.y, columns, rows)
    };
    let scale = SCALES.into_iter().find(|scale| fits(*scale).0);
    // positions are a few metres: the last scale holds them
    let scale = scale.unwrap_or(SCALES[SCALES.len() - 1]);
    let (_, columns, rows) = fits(scale);
    // what is left over goes around the views
    let spare = DVec2::new(room.x - columns[0] - columns[1], room.y - rows[0] - rows[1]).max(DVec2::ZERO);
    let left = MARGIN_MM + 0.25 * spare.x + left_mm - needs.low.x / scale;
    let right = MARGIN_MM + 0.75 * spare.x + columns[0] + AROUND_MM - needs.low.y / scale;
    let bottom = MARGIN_MM + strip_mm + 0.25 * spare.y + below_mm - needs.low.z / scale;
    let top = MARGIN_MM + strip_mm + 0.75 * spare.y + rows[1] + AROUND_MM - needs.low.y / scale;
    Places {
        scale,
        top: DVec2::new(left, top) * scale,
        front: DVec2::new(left, bottom) * scale,
        side: DVec2::new(right, bottom) * scale,
        signs: DVec2::new(PAPER_MM.x - MARGIN_MM - SIGNS_MM.x, PAPER_MM.y - MARGIN_MM) * scale,
    }
}

fn border(sheet: &mut Sheet) {
    let (low, high) = (DVec2::splat(MARGIN_MM), PAPER_MM - MARGIN_MM);
    let points = [low, DVec2::new(high.x, low.y), high, DVec2::new(low.x, high.y)];
    let points = points.map(|point| point * sheet.scale).into();
    sheet.put(Layer::Frame, Shape::Polyline { points, is_closed: true });
    let at = DVec2::new(low.x, high.y + 1.5) * sheet.scale;
    sheet.text(Layer::Text, at, 2.0, Anchor::Start, "A3, third-angle projection, millimetres and degrees");
}
