//! Below the views: every number of the mount, clearances, and the title block.

use glam::DVec2;

use super::dimensions::number;
use super::project::Solid;
use super::{Anchor, Layer, PAPER_MM, Shape, Sheet};
use crate::rig::housing_gap_m;

/// Height of a row and of its words, mm on paper.
const ROW_MM: f64 = 4.6;
const WORDS_MM: f64 = 1.8;
/// The title block, mm on paper.
const BLOCK_MM: DVec2 = DVec2::new(104.0, 42.0);
/// Between lines of notes, mm on paper.
const NOTE_MM: f64 = 3.6;
/// Columns: heading, width in mm on paper.
const COLUMNS: [(&str, f64); 15] = [
    ("sensor", 34.0),
    ("model", 22.0),
    ("x", 17.0),
    ("y", 17.0),
    ("z", 17.0),
    ("pitch", 15.0),
    ("roll", 15.0),
    ("yaw", 15.0),
    ("±", 10.0),
    ("opt. x", 18.0),
    ("opt. y", 18.0),
    ("opt. z", 18.0),
    ("view", 24.0),
    ("dia.", 15.0),
    ("height", 15.0),
];
/// More pairs of housings than these are not listed one by one.
const MOST_PAIRS: usize = 4;

/// What the table's words mean.
const NOTES: [&str; 3] = [
    "Origin: the platform's. x right, y forward, z up. x, y, z: the sensor's own origin (Ouster: middle of the bottom plane;",
    "Velodyne: optical centre). opt.: optical centre, the lever arm from the platform's origin. view: lowest and highest beam",
    "above the plane of the sensor. ±: tolerance of each angle, where somebody decided it.",
];

/// What the strip below the views takes, mm on paper.
pub(super) fn height_mm(sensors: usize) -> f64 {
    BLOCK_MM.y.max(notes_mm(sensors) + ROW_MM * (sensors as f64 + 1.0))
}

/// What the notes below the table take, mm on paper.
fn notes_mm(sensors: usize) -> f64 {
    let pairs = sensors * sensors.saturating_sub(1) / 2;
    let lines = NOTES.len() + pairs.min(MOST_PAIRS) + usize::from(pairs > MOST_PAIRS);
    NOTE_MM * lines as f64 + 2.5
}

pub(super) fn draw(sheet: &mut Sheet, solids: &[Solid<'_>], corner_mm: DVec2) {
    let width_mm = PAPER_MM.x - 2.0 * corner_mm.x - BLOCK_MM.x;
    let strip_mm = height_mm(solids.len());
    let table_mm = corner_mm + DVec2::new(0.0, strip_mm - ROW_MM * (solids.len() as f64 + 1.0));
    let scale = sheet.scale;
    let line = |sheet: &mut Sheet, from: DVec2, to: DVec2| sheet.line(Layer::Frame, from * scale, to * scale);
    let rows = solids.len() + 1;
    for row in 0..=rows {
        let y = table_mm.y + ROW_MM * row as f64;
        line(sheet, DVec2::new(corner_mm.x, y), DVec2::new(corner_mm.x + width_mm, y));
    }
    // columns fill the sheet from edge to edge
    let stretch = width_mm / COLUMNS.iter().map(|(_, width)| width).sum::<f64>();
    let top = table_mm.y + ROW_MM * rows as f64;
    let mut x = corner_mm.x;
    for (column, (heading, width)) in COLUMNS.into_iter().enumerate() {
        let width = width * stretch;
        if column > 0 {
            line(sheet, DVec2::new(x, table_mm.y), DVec2::new(x, top));
        }
        let at = |row: usize, is_number: bool| {
            let inset = if is_number { width - 1.5 } else { 1.5 };
            DVec2::new(x + inset, top - ROW_MM * (row as f64 + 1.0) + 1.3) * scale
        };
        let is_number = column >= 2;
        let anchor = if is_number { Anchor::End } else { Anchor::Start };
        sheet.text(Layer::Text, at(0, is_number), WORDS_MM, anchor, heading);
        for (row, solid) in solids.iter().enumerate() {
            let words = cell(solid, column);
            sheet.text(Layer::Text, at(row + 1, is_number), WORDS_MM, anchor, fitted(&words, width));
        }
        x += width;
    }
    notes(sheet, solids, DVec2::new(corner_mm.x, table_mm.y));
    let edge_mm = corner_mm.x + width_mm;
    line(sheet, DVec2::new(edge_mm, corner_mm.y), DVec2::new(edge_mm, corner_mm.y + strip_mm));
    block(sheet, DVec2::new(PAPER_MM.x - corner_mm.x - BLOCK_MM.x, corner_mm.y), solids.len());
}

/// A word as much of it as a column holds.
fn fitted(words: &str, width_mm: f64) -> String {
    let most = ((width_mm - 3.0) / (0.75 * WORDS_MM)) as usize;
    if words.chars().count() <= most {
        return words.to_owned();
    }
    words.chars().take(most.saturating_sub(1)).chain(['…']).collect()
}

fn cell(solid: &Solid<'_>, column: usize) -> String {
    let sensor = solid.sensor;
    let mount = sensor.mounted.mount;
    let degrees = |angle_rad: f64| {
        let text = format!("{:+.1}°", angle_rad.to_degrees());
        if text[1..] == *"0.0°" { text[1..].to_owned() } else { text }
    };
    match column {
        0 => sensor.mounted.name.clone(),
        1 => sensor.model.clone(),
        2..=4 => number(solid.origin[column - 2]),
        5 => degrees(mount.pitch_rad),
        6 => degrees(mount.roll_rad),
        7 => degrees(mount.yaw_rad),
        8 => sensor.angle_tolerance_deg.map_or("–".into(), |angle_deg| format!("{angle_deg:.1}°")),
        9..=11 => number(solid.optical[column - 9]),
        12 => {
            let [low, high] = solid.elevations_rad().map(|angle_rad| angle_rad.to_degrees() + 0.0);
            format!("{low:+.1} to {high:+.1}°")
        }
        13 => number(2.0 * solid.radius_mm),
        _ => number(solid.height_mm),
    }
}

fn notes(sheet: &mut Sheet, solids: &[Solid<'_>], corner_mm: DVec2) {
    let mut lines: Vec<String> = NOTES.map(str::to_owned).into();
    let mut gaps: Vec<(f64, String)> = Vec::new();
    for (index, first) in solids.iter().enumerate() {
        for second in &solids[index + 1..] {
            let gap_mm = 1000.0 * housing_gap_m(&first.sensor.mounted, &second.sensor.mounted);
            let names = format!("{} to {}", first.sensor.mounted.name, second.sensor.mounted.name);
            gaps.push((gap_mm, names));
        }
    }
    gaps.sort_by(|(a, _), (b, _)| a.total_cmp(b));
    let pairs = gaps.len();
    lines.extend(gaps.into_iter().take(MOST_PAIRS).map(|(gap_mm, names)| {
        if gap_mm < 0.1 {
            format!("Clearance between housings, {names}: NONE, THEY TOUCH")
        } else {
            format!("Clearance between housings, {names}: {gap_mm:.1}")
        }
    }));
    if pairs > MOST_PAIRS {
        lines.push(format!("The other {} pairs of housings are farther apart.", pairs - MOST_PAIRS));
    }
    for (index, words) in lines.into_iter().enumerate() {
        let at = corner_mm + DVec2::new(1.5, -NOTE_MM * (index as f64 + 1.0) + 0.4);
        sheet.text(Layer::Text, at * sheet.scale, WORDS_MM, Anchor::Start, words);
    }
}

fn block(sheet: &mut Sheet, corner_mm: DVec2, sensors: usize) {
    let scale = sheet.scale;
    let at = |x: f64, y: f64| (corner_mm + DVec2::new(x, y)) * scale;
    let line = |sheet: &mut Sheet, from: DVec2, to: DVec2| sheet.line(Layer::Frame, from, to);
    for y in [10.0, 20.0, 30.0, height_mm(sensors)] {
        line(sheet, at(0.0, y), at(BLOCK_MM.x, y));
    }
    for y in [0.0, 10.0, 20.0] {
        line(sheet, at(36.0, y), at(36.0, y + 10.0));
        line(sheet, at(72.0, y), at(72.0, y + 10.0));
    }
    let title = fitted(&sheet.title.clone(), BLOCK_MM.x * 0.55);
    sheet.text(Layer::Text, at(1.5, 38.5), 1.6, Anchor::Start, "mount of sensors");
    sheet.text(Layer::Text, at(3.0, 32.5), 4.0, Anchor::Start, title);
    let ratio =
        if scale < 1.0 { format!("{} : 1", number(1.0 / scale)) } else { format!("1 : {}", number(scale)) };
    let plural = if sensors == 1 { "" } else { "s" };
    let fields = [
        (0.0, 20.0, "scale", ratio),
        (36.0, 20.0, "units", "mm, degrees".into()),
        (72.0, 20.0, "sheet", "A3".into()),
        (0.0, 10.0, "drawn by", concat!("outrigger ", env!("CARGO_PKG_VERSION")).into()),
        (36.0, 10.0, "parts", format!("{sensors} sensor{plural}")),
        (72.0, 10.0, "projection", String::new()),
        (0.0, 0.0, "checked", String::new()),
        (36.0, 0.0, "date", String::new()),
        (72.0, 0.0, "revision", String::new()),
    ];
    for (x, y, label, value) in fields {
        sheet.text(Layer::Text, at(x + 1.5, y + 7.0), 1.6, Anchor::Start, label);
        sheet.text(Layer::Text, at(x + 3.0, y + 2.5), 2.8, Anchor::Start, value);
    }
    third_angle(sheet, at(90.0, 14.0));
}

/// The symbol of third-angle projection: a truncated cone from its small end and from the side.
fn third_angle(sheet: &mut Sheet, at: DVec2) {
    let paper = |x: f64, y: f64| at + DVec2::new(sheet.paper(x), sheet.paper(y));
    let points = vec![paper(3.0, 1.5), paper(10.0, 3.0), paper(10.0, -3.0), paper(3.0, -1.5)];
    let [small, large] = [sheet.paper(1.5), sheet.paper(3.0)];
    let centre = paper(-3.0, 0.0);
    sheet.put(Layer::Frame, Shape::Polyline { points, is_closed: true });
    sheet.put(Layer::Frame, Shape::Circle { centre, radius: small });
    sheet.put(Layer::Frame, Shape::Circle { centre, radius: large });
}
