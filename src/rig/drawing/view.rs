//! One view: housings, bottom planes, optical centres, spin axes, fields of view, angles.

use glam::{DVec2, DVec3};

use super::project::{Plane, Solid};
use super::{Anchor, Layer, Shape, Sheet, text_width};

/// Height of words in a view, mm on paper.
const WORDS_MM: f64 = 2.5;
/// How far a field of view is drawn beyond the housing, mm on paper.
const BEYOND_MM: f64 = 9.0;
/// A view across the spin axis by less than this shows no field of view.
const LEAST_ACROSS: f64 = 0.5;

/// Rooms that words take, as lower left and upper right.
type Rooms = Vec<(DVec2, DVec2)>;

pub(super) fn draw(
    sheet: &mut Sheet,
    plane: Plane,
    at: DVec2,
    solids: &[Solid<'_>],
    (low, high): (DVec3, DVec3),
    mut rooms: Rooms,
) {
    heading(sheet, plane, at, (plane.flat(low), plane.flat(high)));
    axes(sheet, plane, at, &mut rooms);
    for solid in solids {
        housing(sheet, plane, at, solid);
        field_of_view(sheet, plane, at, solid);
    }
    for solid in solids {
        let rims = [solid.bottom, solid.top].map(|middle| solid.rim(plane, middle)).concat();
        let corner =
            |pick: fn(DVec2, DVec2) -> DVec2| rims.iter().copied().reduce(pick).unwrap_or_default() + at;
        rooms.push((corner(DVec2::min), corner(DVec2::max)));
    }
    for solid in solids {
        angle(sheet, plane, at, solid, &mut rooms);
    }
    for solid in solids {
        name(sheet, plane, at, solid, &mut rooms);
    }
}

fn heading(sheet: &mut Sheet, plane: Plane, at: DVec2, (low, high): (DVec2, DVec2)) {
    let (title, what) = match plane {
        Plane::Top => ("TOP", "seen from above"),
        Plane::Front => ("FRONT", "seen from behind, looking forward"),
        Plane::Side => ("SIDE", "seen from the right"),
    };
    let middle = at.x + 0.5 * (low.x + high.x);
    let above = at.y + high.y + sheet.paper(17.5);
    sheet.text(Layer::Text, DVec2::new(middle, above), 3.5, Anchor::Middle, title);
    let below = above - sheet.paper(4.0);
    sheet.text(Layer::Text, DVec2::new(middle, below), 2.0, Anchor::Middle, what);
}

/// The platform's origin with its axes.
fn axes(sheet: &mut Sheet, plane: Plane, at: DVec2, rooms: &mut Rooms) {
    let length = sheet.paper(9.0);
    let radius = sheet.paper(0.8);
    let (right, up) = match plane {
        Plane::Top => ("x", "y"),
        Plane::Front => ("x", "z"),
        Plane::Side => ("y", "z"),
    };
    sheet.put(Layer::Centre, Shape::Circle { centre: at, radius });
    for (direction, name) in [(DVec2::X, right), (DVec2::Y, up)] {
        let tip = at + length * direction;
        sheet.line(Layer::Centre, at, tip);
        sheet.arrow(Layer::Centre, tip, direction);
        let words = tip + direction * sheet.paper(1.6) - DVec2::new(0.0, sheet.paper(0.8));
        sheet.text(Layer::Text, words, 2.0, Anchor::Middle, name);
        rooms.push((words - sheet.paper(1.0), words + sheet.paper(2.2)));
    }
}

fn housing(sheet: &mut Sheet, plane: Plane, at: DVec2, solid: &Solid<'_>) {
    let moved = |points: Vec<DVec2>| points.into_iter().map(|point| point + at).collect::<Vec<_>>();
    let rim = |points| Shape::Polyline { points: moved(points), is_closed: true };
    if plane == Plane::Top {
        // at pitch and roll 0: the circle of the housing and of the holes below it
        let circle = Shape::Circle { centre: plane.flat(solid.origin) + at, radius: solid.radius_mm };
        let is_upright = solid.axis.abs_diff_eq(DVec3::Z, 1e-9);
        sheet.put(if is_upright { Layer::Outline } else { Layer::Phantom }, circle);
    }
    if !(plane == Plane::Top && solid.axis.abs_diff_eq(DVec3::Z, 1e-9)) {
        sheet.put(Layer::Outline, rim(solid.rim(plane, solid.top)));
        sheet.put(Layer::Bottom, rim(solid.rim(plane, solid.bottom)));
    }
    for [from, to] in solid.sides(plane).into_iter().flatten() {
        sheet.line(Layer::Outline, from + at, to + at);
    }
    let reach = sheet.paper(6.0);
    let [from, to] = [solid.bottom - reach * solid.axis, solid.top + reach * solid.axis];
    sheet.line(Layer::Centre, plane.flat(from) + at, plane.flat(to) + at);
    let optical = plane.flat(solid.optical) + at;
    let arm = sheet.paper(1.8);
    sheet.line(Layer::Optical, optical - DVec2::X * arm, optical + DVec2::X * arm);
    sheet.line(Layer::Optical, optical - DVec2::Y * arm, optical + DVec2::Y * arm);
    sheet.put(Layer::Optical, Shape::Circle { centre: optical, radius: 0.5 * arm });
    if plane == Plane::Top {
        forward(sheet, at, solid);
    }
}

/// The sensor's +x, seen from above, and the side of an Ouster's cable, which is the opposite one. Source: Ouster sensor
/// documentation, "lidar coordinate frame": its +x, the sensor's -x, points to the connector.
fn forward(sheet: &mut Sheet, at: DVec2, solid: &Solid<'_>) {
    let from = Plane::Top.flat(solid.top) + at;
    let along = Plane::Top.flat(solid.forward);
    let tip = from + along * solid.radius_mm * 0.8;
    sheet.line(Layer::Dimension, from, tip);
    sheet.arrow(Layer::Dimension, tip, along);
    if !crate::rig::frames::is_velodyne(&solid.sensor.mounted.model) {
        let back = Plane::Top.flat(solid.bottom - solid.radius_mm * solid.forward) + at;
        let (side, out) = (along.perp() * sheet.paper(2.0), -along * sheet.paper(2.5));
        let points = vec![back + side, back + side + out, back - side + out, back - side];
        sheet.put(Layer::Outline, Shape::Polyline { points, is_closed: true });
    }
}

/// Lowest and highest beam on both sides, where one looks across the spin axis.
fn field_of_view(sheet: &mut Sheet, plane: Plane, at: DVec2, solid: &Solid<'_>) {
    if plane == Plane::Top {
        return;
    }
    let across = solid.axis.cross(plane.toward_viewer());
    if across.length() < LEAST_ACROSS {
        return;
    }
    let across = across.normalize();
    let length = solid.radius_mm.hypot(0.5 * solid.height_mm) + sheet.paper(BEYOND_MM);
    for elevation_rad in solid.elevations_rad() {
        for side in [1.0, -1.0] {
            let direction = side * elevation_rad.cos() * across + elevation_rad.sin() * solid.axis;
            let to = plane.flat(solid.optical + length * direction) + at;
            sheet.line(Layer::View, plane.flat(solid.optical) + at, to);
        }
    }
}

/// The tilt that a view shows: the pitch from behind, the roll from the right, the yaw from above.
fn angle(sheet: &mut Sheet, plane: Plane, at: DVec2, solid: &Solid<'_>, rooms: &mut Rooms) {
    let mount = solid.sensor.mounted.mount;
    let (angle_rad, from, name) = match plane {
        Plane::Front => (mount.pitch_rad, DVec2::Y, "pitch"),
        Plane::Side => (mount.roll_rad, DVec2::Y, "roll"),
        Plane::Top => (mount.yaw_rad, DVec2::Y, "yaw"),
    };
    if angle_rad.abs() < 1e-4 {
        return; // the table has it
    }
    let tolerance =
        solid.sensor.angle_tolerance_deg.map_or(String::new(), |angle_deg| format!(" ± {angle_deg:.1}°"));
    let words = format!("{name} {:+.1}°{tolerance}", angle_rad.to_degrees() + 0.0);
    let centre = plane.flat(solid.origin) + at;
    // on the sheet: a positive pitch turns clockwise (top to the right), a positive roll and yaw counterclockwise
    let turned = if plane == Plane::Front { -angle_rad } else { angle_rad };
    let to = DVec2::from_angle(turned).rotate(from);
    let side = if to.x == 0.0 { 1.0 } else { to.x.signum() };
    let width = text_width(&words, sheet.paper(WORDS_MM));
    let mut radius = solid.height_mm + solid.radius_mm.min(sheet.paper(4.0)) + sheet.paper(5.0);
    for _ in 0..8 {
        let corner = corner_of(centre, radius, to, side, width, sheet);
        if is_free(rooms, corner, width, sheet) {
            break;
        }
        radius += sheet.paper(4.5);
    }
    let corner = corner_of(centre, radius, to, side, width, sheet);
    rooms.push((corner, corner + DVec2::new(width, sheet.paper(WORDS_MM))));
    let overrun = radius + sheet.paper(1.5);
    sheet.line(Layer::Dimension, centre, centre + overrun * from);
    sheet.line(Layer::Dimension, centre, centre + overrun * to);
    let [from_deg, to_deg] =
        if turned > 0.0 { [from.to_angle(), to.to_angle()] } else { [to.to_angle(), from.to_angle()] }
            .map(f64::to_degrees);
    sheet.put(Layer::Dimension, Shape::Arc { centre, radius, from_deg, to_deg });
    let tip = centre + radius * to;
    sheet.arrow(Layer::Dimension, tip, to.perp() * turned.signum());
    sheet.text(Layer::Text, corner, WORDS_MM, Anchor::Start, words);
}

/// Lower left of an angle's words: beyond the arc, on the side to which the sensor is tilted.
fn corner_of(centre: DVec2, radius: f64, to: DVec2, side: f64, width: f64, sheet: &Sheet) -> DVec2 {
    let end = centre + (radius + sheet.paper(2.5)) * to;
    DVec2::new(if side > 0.0 { end.x } else { end.x - width }, end.y)
}

fn name(sheet: &mut Sheet, plane: Plane, at: DVec2, solid: &Solid<'_>, rooms: &mut Rooms) {
    let words = &solid.sensor.mounted.name;
    let width = text_width(words, sheet.paper(WORDS_MM));
    let middle = plane.flat(0.5 * (solid.bottom + solid.top)) + at;
    let reach = solid.radius_mm.max(0.5 * solid.height_mm) + sheet.paper(2.5);
    let side = if plane.flat(solid.origin).x < 0.0 { -1.0 } else { 1.0 };
    let places = [0.0, -6.0, 6.0, -12.0, 12.0, -18.0].into_iter().flat_map(|up| [(side, up), (-side, up)]);
    let corner = |(side, up): (f64, f64)| {
        let x = if side > 0.0 { middle.x + reach } else { middle.x - reach - width };
        DVec2::new(x, middle.y + sheet.paper(up))
    };
    let free = places.map(corner).find(|corner| is_free(rooms, *corner, width, sheet));
    let corner = free.unwrap_or_else(|| corner((side, 0.0)));
    rooms.push((corner, corner + DVec2::new(width, sheet.paper(WORDS_MM))));
    sheet.text(Layer::Text, corner, WORDS_MM, Anchor::Start, words.as_str());
}

fn is_free(rooms: &Rooms, corner: DVec2, width: f64, sheet: &Sheet) -> bool {
    let air = sheet.paper(0.8);
    let (low, high) = (corner - air, corner + DVec2::new(width, sheet.paper(WORDS_MM)) + air);
    rooms.iter().all(|(from, to)| high.x < from.x || to.x < low.x || high.y < from.y || to.y < low.y)
}
