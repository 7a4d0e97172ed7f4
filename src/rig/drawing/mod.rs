//! The mount as a drawing for a workshop: top, front and side at one scale, with positions, angles and a table.
//!
//! Everything on the sheet is in millimetres of the real thing; the sheet is as large as A3 times the scale. SVG shrinks it
//! to paper, DXF keeps it, so that a program measures what the mount file says.

mod dimensions;
mod dxf;
mod layout;
mod project;
mod signs;
mod svg;
mod table;
mod view;

use glam::DVec2;

use super::FramedSensor;

/// A3 across, mm.
pub(super) const PAPER_MM: DVec2 = DVec2::new(420.0, 297.0);

/// What a stroke or a text is about: its weight and its layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Layer {
    /// Housings.
    Outline,
    /// Bottom planes, where the sensor is screwed down.
    Bottom,
    /// The housing at pitch and roll 0.
    Phantom,
    /// Spin axes and the platform's axes.
    Centre,
    /// Fields of view.
    View,
    /// Optical centres.
    Optical,
    /// Dimension lines and angles.
    Dimension,
    /// Words.
    Text,
    /// Border, table and title block.
    Frame,
}

impl Layer {
    pub(super) const ALL: [Self; 9] = [
        Self::Outline,
        Self::Bottom,
        Self::Phantom,
        Self::Centre,
        Self::View,
        Self::Optical,
        Self::Dimension,
        Self::Text,
        Self::Frame,
    ];
}

/// Where a text's given point lies on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

/// What stands on the sheet; lengths in millimetres of the real thing, y up.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Shape {
    Line(DVec2, DVec2),
    Polyline {
        points: Vec<DVec2>,
        is_closed: bool,
    },
    Circle {
        centre: DVec2,
        radius: f64,
    },
    /// Counterclockwise.
    Arc {
        centre: DVec2,
        radius: f64,
        from_deg: f64,
        to_deg: f64,
    },
    Triangle([DVec2; 3]),
    Text {
        at: DVec2,
        height: f64,
        anchor: Anchor,
        is_upright: bool,
        text: String,
    },
    /// A distance, measured along x or, where it is upright, along y.
    Dimension(Measure),
}

/// A dimension with everything that is drawn of it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Measure {
    pub from: DVec2,
    pub to: DVec2,
    /// A point of the dimension line.
    pub line_at: DVec2,
    pub is_upright: bool,
    pub text: String,
    pub text_at: DVec2,
    /// Lines, arrows and the text.
    pub parts: Vec<Shape>,
}

/// A drawing.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Sheet {
    /// What is 1 mm on paper, mm.
    scale: f64,
    title: String,
    shapes: Vec<(Layer, Shape)>,
}

impl Sheet {
    /// Nothing yet.
    fn new(scale: f64, title: &str) -> Self {
        Self { scale, title: title.to_owned(), shapes: Vec::new() }
    }

    /// So many millimetres on paper.
    fn paper(&self, paper_mm: f64) -> f64 {
        paper_mm * self.scale
    }

    fn put(&mut self, layer: Layer, shape: Shape) {
        self.shapes.push((layer, shape));
    }

    fn line(&mut self, layer: Layer, from: DVec2, to: DVec2) {
        self.put(layer, Shape::Line(from, to));
    }

    /// A text of a height on paper, mm.
    fn text(&mut self, layer: Layer, at: DVec2, height_mm: f64, anchor: Anchor, text: impl Into<String>) {
        let height = self.paper(height_mm);
        self.put(layer, Shape::Text { at, height, anchor, is_upright: false, text: text.into() });
    }

    /// A filled arrow head that points along a direction.
    fn arrow(&mut self, layer: Layer, tip: DVec2, direction: DVec2) {
        self.put(layer, arrow_head(tip, direction, self.scale));
    }

    /// As SVG, on paper.
    pub(crate) fn svg(&self) -> String {
        svg::render(self)
    }

    /// As DXF of release 12, in millimetres of the real thing.
    pub(crate) fn dxf(&self) -> String {
        dxf::render(self)
    }
}

/// An arrow head of 2.5 mm on paper.
fn arrow_head(tip: DVec2, direction: DVec2, scale: f64) -> Shape {
    let back = -direction.normalize_or_zero() * 2.5 * scale;
    let side = back.perp() * 0.16;
    Shape::Triangle([tip, tip + back + side, tip + back - side])
}

/// How wide a text is about, in heights: what keeps texts apart.
pub(super) fn text_width(text: &str, height: f64) -> f64 {
    0.78 * height * text.chars().count() as f64
}

/// The drawing of these sensors; the title is the name of their mount file.
pub(crate) fn draw(title: &str, sensors: &[FramedSensor]) -> Sheet {
    layout::sheet(title, sensors)
}
