//! The sheet on paper, as SVG: A3, one user unit is a millimetre.

use std::fmt::Write as _;

use glam::DVec2;

use super::{Anchor, Layer, PAPER_MM, Shape, Sheet};

/// Of a layer its class, its stroke in mm, its colour and its dashes.
fn style(layer: Layer) -> (&'static str, f64, &'static str, &'static str) {
    match layer {
        Layer::Outline => ("outline", 0.25, "#1a1a1a", ""),
        Layer::Bottom => ("bottom", 0.5, "#1a1a1a", ""),
        Layer::Phantom => ("phantom", 0.13, "#1a1a1a", "3 0.8 0.8 0.8 0.8 0.8"),
        Layer::Centre => ("centre", 0.13, "#5a5a5a", "4 0.8 0.8 0.8"),
        Layer::View => ("view", 0.13, "#0072b2", "1.2 0.8"),
        Layer::Optical => ("optical", 0.18, "#d55e00", ""),
        Layer::Dimension => ("dimension", 0.13, "#1a1a1a", ""),
        Layer::Text => ("text", 0.0, "#1a1a1a", ""),
        Layer::Frame => ("frame", 0.25, "#1a1a1a", ""),
    }
}

pub(super) fn render(sheet: &Sheet) -> String {
    let [width, height] = PAPER_MM.to_array();
    let title = escaped(&sheet.title);
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}mm\" height=\"{height}mm\" viewBox=\"0 0 {width} {height}\" \
         role=\"img\">\n<title>{title}: mount of sensors, 1 : {}</title>\n<style>\n\
         path, circle {{ fill: none; stroke-linejoin: round }}\n\
         text {{ font-family: Arial, Helvetica, sans-serif; fill: #1a1a1a; paint-order: stroke; stroke: #fff; stroke-width: 0.7px; \
         stroke-linejoin: round }}\n",
        sheet.scale
    );
    for layer in Layer::ALL {
        let (class, stroke, colour, dashes) = style(layer);
        let dashes = if dashes.is_empty() { String::new() } else { format!("; stroke-dasharray: {dashes}") };
        let _ = writeln!(text, ".{class} {{ stroke: {colour}; stroke-width: {stroke}px{dashes} }}");
        let _ = writeln!(text, ".{class} .head {{ fill: {colour}; stroke: none }}");
    }
    let _ = writeln!(text, "</style>\n<rect width=\"{width}\" height=\"{height}\" fill=\"#fff\"/>");
    for layer in Layer::ALL {
        let _ = writeln!(text, "<g class=\"{}\">", style(layer).0);
        for (_, shape) in sheet.shapes.iter().filter(|(of, shape)| *of == layer && !is_text(shape)) {
            put(&mut text, shape, sheet.scale);
        }
        text += "</g>\n";
    }
    // words lie above every line
    text += "<g>\n";
    for (_, shape) in sheet.shapes.iter().filter(|(_, shape)| is_text(shape)) {
        put(&mut text, shape, sheet.scale);
    }
    for (_, shape) in &sheet.shapes {
        if let Shape::Dimension(measure) = shape {
            measure
                .parts
                .iter()
                .filter(|part| is_text(part))
                .for_each(|part| put(&mut text, part, sheet.scale));
        }
    }
    text += "</g>\n</svg>\n";
    text
}

fn is_text(shape: &Shape) -> bool {
    matches!(shape, Shape::Text { .. })
}

fn put(text: &mut String, shape: &Shape, scale: f64) {
    let at = |point: DVec2| {
        let paper = point / scale;
        format!("{:.3} {:.3}", paper.x + 0.0, PAPER_MM.y - paper.y)
    };
    let path = |points: &[DVec2]| points.iter().map(|point| at(*point)).collect::<Vec<_>>().join(" L");
    let _ = match shape {
        Shape::Line(from, to) => writeln!(text, "<path d=\"M{}\"/>", path(&[*from, *to])),
        Shape::Polyline { points, is_closed } => {
            writeln!(text, "<path d=\"M{}{}\"/>", path(points), if *is_closed { " Z" } else { "" })
        }
        Shape::Triangle(points) => writeln!(text, "<path class=\"head\" d=\"M{} Z\"/>", path(points)),
        Shape::Circle { centre, radius } => {
            let centre = centre / scale;
            let y = PAPER_MM.y - centre.y;
            writeln!(text, "<circle cx=\"{:.3}\" cy=\"{y:.3}\" r=\"{:.3}\"/>", centre.x, radius / scale)
        }
        Shape::Arc { centre, radius, from_deg, to_deg } => {
            let end = |angle_deg: f64| at(*centre + *radius * DVec2::from_angle(angle_deg.to_radians()));
            let is_large = u8::from((to_deg - from_deg).rem_euclid(360.0) > 180.0);
            let radius = radius / scale;
            let (from, to) = (end(*from_deg), end(*to_deg));
            writeln!(text, "<path d=\"M{from} A{radius:.3} {radius:.3} 0 {is_large} 0 {to}\"/>")
        }
        Shape::Text { at: place, height, anchor, is_upright, text: words } => {
            let anchor = match anchor {
                Anchor::Start => "start",
                Anchor::Middle => "middle",
                Anchor::End => "end",
            };
            let place = place / scale;
            let (x, y) = (place.x, PAPER_MM.y - place.y);
            let turned =
                if *is_upright { format!(" transform=\"rotate(-90 {x:.3} {y:.3})\"") } else { String::new() };
            // the height is that of capitals, 0.716 of a font's size
            let size = height / scale / 0.716;
            writeln!(
                text,
                "<text x=\"{x:.3}\" y=\"{y:.3}\" font-size=\"{size:.2}\" text-anchor=\"{anchor}\"{turned}>{}</text>",
                escaped(words)
            )
        }
        Shape::Dimension(measure) => {
            measure.parts.iter().filter(|part| !is_text(part)).for_each(|part| put(text, part, scale));
            Ok(())
        }
    };
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
