//! The sheet as DXF of release 12, in millimetres of the real thing. Source: AutoCAD release 12, customization manual,
//! chapter 11 (drawing interchange files). Dimensions are entities of their own, each with the block that draws it.

use std::fmt::Write as _;

use glam::DVec2;

use super::{Anchor, Layer, Measure, PAPER_MM, Shape, Sheet};

/// Of a layer its name, colour and line type.
fn style(layer: Layer) -> (&'static str, u8, &'static str) {
    match layer {
        Layer::Outline => ("OUTLINE", 7, "CONTINUOUS"),
        Layer::Bottom => ("BOTTOM", 5, "CONTINUOUS"),
        Layer::Phantom => ("PHANTOM", 8, "PHANTOM"),
        Layer::Centre => ("CENTER", 8, "CENTER"),
        Layer::View => ("VIEW", 4, "DASHED"),
        Layer::Optical => ("OPTICAL", 1, "CONTINUOUS"),
        Layer::Dimension => ("DIMENSION", 3, "CONTINUOUS"),
        Layer::Text => ("TEXT", 7, "CONTINUOUS"),
        Layer::Frame => ("FRAME", 7, "CONTINUOUS"),
    }
}

/// Line types: name, what it looks like, dashes (gaps below 0), mm on paper.
const LINE_TYPES: [(&str, &str, &[f64]); 4] = [
    ("CONTINUOUS", "Solid line", &[]),
    ("CENTER", "____ _ ____ _", &[6.0, -1.2, 1.2, -1.2]),
    ("PHANTOM", "____ _ _ ____", &[6.0, -1.2, 1.2, -1.2, 1.2, -1.2]),
    ("DASHED", "__ __ __ __", &[2.4, -1.2]),
];

/// Group codes and values, line by line.
struct Groups(String);

impl Groups {
    fn put(&mut self, code: u16, value: impl std::fmt::Display) {
        let _ = write!(self.0, "{code:>3}\r\n{value}\r\n");
    }

    fn number(&mut self, code: u16, value: f64) {
        // a whole number of tenths of nanometres
        let text = format!("{:.7}", value + 0.0);
        let text = text.trim_end_matches('0');
        let text = if text.ends_with('.') { format!("{text}0") } else { text.to_owned() };
        self.put(code, if text == "-0.0" { "0.0" } else { &text });
    }

    fn point(&mut self, code: u16, point: DVec2) {
        self.number(code, point.x);
        self.number(code + 10, point.y);
        self.number(code + 20, 0.0);
    }

    fn begin(&mut self, entity: &str, layer: &str) {
        self.put(0, entity);
        self.put(8, layer);
    }

    fn section(&mut self, name: &str, content: impl FnOnce(&mut Self)) {
        self.put(0, "SECTION");
        self.put(2, name);
        content(self);
        self.put(0, "ENDSEC");
    }

    fn table(&mut self, name: &str, entries: usize, content: impl FnOnce(&mut Self)) {
        self.put(0, "TABLE");
        self.put(2, name);
        self.put(70, entries);
        content(self);
        self.put(0, "ENDTAB");
    }
}

pub(super) fn render(sheet: &Sheet) -> String {
    let mut groups = Groups(String::new());
    groups.section("HEADER", |groups| header(groups, sheet));
    groups.section("TABLES", |groups| tables(groups, sheet));
    groups.section("BLOCKS", |groups| blocks(groups, sheet));
    groups.section("ENTITIES", |groups| {
        let mut dimensions = 0;
        for (layer, shape) in &sheet.shapes {
            let layer = style(*layer).0;
            if let Shape::Dimension(measure) = shape {
                dimensions += 1;
                dimension(groups, layer, measure, dimensions);
            } else {
                entity(groups, layer, shape);
            }
        }
    });
    groups.put(0, "EOF");
    groups.0
}

fn header(groups: &mut Groups, sheet: &Sheet) {
    let end = PAPER_MM * sheet.scale;
    groups.put(9, "$ACADVER");
    groups.put(1, "AC1009");
    for (name, point) in
        [("$EXTMIN", DVec2::ZERO), ("$EXTMAX", end), ("$LIMMIN", DVec2::ZERO), ("$LIMMAX", end)]
    {
        groups.put(9, name);
        groups.number(10, point.x);
        groups.number(20, point.y);
        if name.starts_with("$EXT") {
            groups.number(30, 0.0);
        }
    }
    for (name, value) in
        [("$LTSCALE", sheet.scale), ("$DIMSCALE", sheet.scale), ("$DIMTXT", 2.5), ("$DIMASZ", 2.5)]
    {
        groups.put(9, name);
        groups.number(40, value);
    }
}

fn tables(groups: &mut Groups, sheet: &Sheet) {
    groups.table("LTYPE", LINE_TYPES.len(), |groups| {
        for (name, what, dashes) in LINE_TYPES {
            groups.put(0, "LTYPE");
            groups.put(2, name);
            groups.put(70, 0);
            groups.put(3, what);
            groups.put(72, 65);
            groups.put(73, dashes.len());
            groups.number(40, dashes.iter().map(|dash| dash.abs()).sum());
            dashes.iter().for_each(|dash| groups.number(49, *dash));
        }
    });
    groups.table("LAYER", Layer::ALL.len() + 1, |groups| {
        let layers = [("0", 7, "CONTINUOUS")].into_iter().chain(Layer::ALL.map(style));
        for (name, colour, line_type) in layers {
            groups.put(0, "LAYER");
            groups.put(2, name);
            groups.put(70, 0);
            groups.put(62, colour);
            groups.put(6, line_type);
        }
    });
    groups.table("STYLE", 1, |groups| {
        groups.put(0, "STYLE");
        groups.put(2, "STANDARD");
        groups.put(70, 0);
        groups.number(40, 0.0);
        groups.number(41, 1.0);
        groups.number(50, 0.0);
        groups.put(71, 0);
        groups.number(42, 2.5 * sheet.scale);
        groups.put(3, "txt");
        groups.put(4, "");
    });
    groups.table("DIMSTYLE", 1, |groups| {
        groups.put(0, "DIMSTYLE");
        groups.put(2, "STANDARD");
        groups.put(70, 0);
        groups.number(40, sheet.scale);
        groups.number(41, 2.5);
        groups.number(140, 2.5);
    });
}

fn blocks(groups: &mut Groups, sheet: &Sheet) {
    let measures = sheet.shapes.iter().filter_map(|(layer, shape)| match shape {
        Shape::Dimension(measure) => Some((*layer, measure)),
        _ => None,
    });
    for (index, (layer, measure)) in measures.enumerate() {
        let layer = style(layer).0;
        let name = format!("*D{}", index + 1);
        groups.begin("BLOCK", layer);
        groups.put(2, &name);
        groups.put(70, 1);
        groups.point(10, DVec2::ZERO);
        groups.put(3, &name);
        groups.put(1, "");
        measure.parts.iter().for_each(|part| entity(groups, layer, part));
        groups.begin("ENDBLK", layer);
    }
}

fn dimension(groups: &mut Groups, layer: &str, measure: &Measure, number: usize) {
    groups.begin("DIMENSION", layer);
    groups.put(2, format!("*D{number}"));
    groups.put(3, "STANDARD");
    groups.point(10, measure.line_at);
    groups.point(11, measure.text_at);
    groups.put(1, ascii(&measure.text));
    groups.put(70, 128); // linear, the place of the text is given
    groups.point(13, measure.from);
    groups.point(14, measure.to);
    groups.number(50, if measure.is_upright { 90.0 } else { 0.0 });
}

fn entity(groups: &mut Groups, layer: &str, shape: &Shape) {
    match shape {
        Shape::Line(from, to) => {
            groups.begin("LINE", layer);
            groups.point(10, *from);
            groups.point(11, *to);
        }
        Shape::Polyline { points, is_closed } => {
            groups.begin("POLYLINE", layer);
            groups.put(66, 1);
            groups.point(10, DVec2::ZERO);
            groups.put(70, u8::from(*is_closed));
            for point in points {
                groups.begin("VERTEX", layer);
                groups.point(10, *point);
            }
            groups.begin("SEQEND", layer);
        }
        Shape::Circle { centre, radius } => {
            groups.begin("CIRCLE", layer);
            groups.point(10, *centre);
            groups.number(40, *radius);
        }
        Shape::Arc { centre, radius, from_deg, to_deg } => {
            groups.begin("ARC", layer);
            groups.point(10, *centre);
            groups.number(40, *radius);
            groups.number(50, from_deg.rem_euclid(360.0));
            groups.number(51, to_deg.rem_euclid(360.0));
        }
        Shape::Triangle([first, second, third]) => {
            groups.begin("SOLID", layer);
            for (code, point) in [(10, first), (11, second), (12, third), (13, third)] {
                groups.point(code, *point);
            }
        }
        Shape::Text { at, height, anchor, is_upright, text } if !text.is_empty() => {
            groups.begin("TEXT", layer);
            groups.point(10, *at);
            groups.number(40, *height);
            groups.put(1, ascii(text));
            groups.number(50, if *is_upright { 90.0 } else { 0.0 });
            groups.put(7, "STANDARD");
            let justified = match anchor {
                Anchor::Start => 0,
                Anchor::Middle => 1,
                Anchor::End => 2,
            };
            groups.put(72, justified);
            if justified != 0 {
                groups.point(11, *at);
            }
        }
        Shape::Text { .. } => {}
        Shape::Dimension(measure) => measure.parts.iter().for_each(|part| entity(groups, layer, part)),
    }
}

/// Release 12 has its own signs for degrees and tolerances; what is no ASCII is written as its code.
fn ascii(text: &str) -> String {
    let mut written = String::new();
    for c in text.chars() {
        match c {
            '°' => written += "%%d",
            '±' => written += "%%p",
            '–' => written.push('-'),
            '…' => written += "..",
            ' '..='~' => written.push(c),
            c if c.is_control() => written.push(' '),
            c => {
                let _ = write!(written, "\\U+{:04X}", u32::from(c));
            }
        }
    }
    written
}
