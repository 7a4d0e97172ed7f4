//! A 3-D picture as JSON for `report/viewer/orbit.js`: places in whole counts from the middle, 16 bits each, in base 64.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use glam::DVec3;
use serde::Serialize;

use super::{Layer, Orbit, Shape};

#[derive(Serialize)]
struct Document<'a> {
    label: &'a str,
    /// Of the local frame in that of the files, m.
    origin_m: [f64; 3],
    /// Zero of the counts in the local frame, m.
    middle_m: [f64; 3],
    /// Metres in one count.
    count_m: f64,
    bounds_m: [[f64; 3]; 2],
    cut_m: f64,
    layers: Vec<LayerDocument<'a>>,
    /// x, y, z, m, and heading, rad.
    poses: Vec<[f32; 4]>,
}

#[derive(Serialize)]
struct LayerDocument<'a> {
    name: &'a str,
    colour: &'a str,
    shape: &'static str,
    size_m: f64,
    is_cut: bool,
    is_shown: bool,
    places: String,
}

/// The document; safe inside a script element.
pub(super) fn json(orbit: &Orbit) -> String {
    let all = || orbit.layers.iter().flat_map(|layer| &layer.places_m);
    let (mut low_m, mut high_m) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for place_m in all() {
        (low_m, high_m) = (low_m.min(*place_m), high_m.max(*place_m));
    }
    if !low_m.is_finite() {
        (low_m, high_m) = (DVec3::ZERO, DVec3::ZERO);
    }
    let middle_m = 0.5 * (low_m + high_m);
    let count_m = ((high_m - low_m).max_element() / f64::from(u16::MAX - 1)).max(1e-4);
    let counts = |layer: &Layer| {
        let bytes: Vec<u8> = layer
            .places_m
            .iter()
            .flat_map(|place_m| ((place_m - middle_m) / count_m).round().to_array())
            .flat_map(|count| (count as i16).to_le_bytes())
            .collect();
        STANDARD.encode(bytes)
    };
    let document = Document {
        label: &orbit.label,
        origin_m: orbit.origin.world_m().to_array(),
        middle_m: middle_m.to_array(),
        count_m,
        bounds_m: orbit.bounds_m.map(|corner_m| corner_m.to_array()),
        cut_m: orbit.cut_m(),
        layers: orbit
            .layers
            .iter()
            .map(|layer| LayerDocument {
                name: &layer.name,
                colour: layer.css.trim_start_matches("c-"),
                shape: match layer.shape {
                    Shape::Points => "points",
                    Shape::Lines => "lines",
                    Shape::Surface => "surface",
                },
                size_m: layer.size_m,
                is_cut: layer.is_cut,
                is_shown: layer.is_shown,
                places: counts(layer),
            })
            .collect(),
        poses: orbit
            .poses
            .iter()
            .map(|(at_m, heading_rad)| {
                let [x, y, z] = at_m.as_vec3().to_array();
                [x, y, z, *heading_rad as f32]
            })
            .collect(),
    };
    // numbers and text always serialise
    serde_json::to_string(&document).unwrap_or_default().replace('<', "\\u003c")
}
