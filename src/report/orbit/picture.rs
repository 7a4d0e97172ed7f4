//! The still picture of a 3-D view: seen from behind and above, far away, in cells of one colour each.

use glam::{DVec2, DVec3};

use super::{Layer, Orbit, Shape};
use crate::report::chart::{CellClass, CellMap, cell_map_svg};

/// Cells across.
const WIDTH: usize = 300;
/// Cells down at most.
const MAX_HEIGHT: usize = 220;
/// From where: heading and elevation, rad; the same as the view's first.
const YAW: f64 = 3.7;
const ELEVATION: f64 = 0.85;

struct Paper {
    right: DVec3,
    up: DVec3,
    back: DVec3,
    low: DVec2,
    cells_per_m: f64,
    size: [usize; 2],
    /// Depth and layer of what is nearest.
    nearest: Vec<Option<(f64, usize)>>,
}

impl Paper {
    fn around(orbit: &Orbit) -> Self {
        let (sin_yaw, cos_yaw) = YAW.sin_cos();
        let (sin_up, cos_up) = ELEVATION.sin_cos();
        let back = DVec3::new(cos_yaw * cos_up, sin_yaw * cos_up, sin_up);
        let right = DVec3::new(-sin_yaw, cos_yaw, 0.0);
        let up = DVec3::new(-cos_yaw * sin_up, -sin_yaw * sin_up, cos_up);
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for n in 0..8 {
            let [least, most] = orbit.bounds_m;
            let side = |axis: usize| if n >> axis & 1 == 0 { least[axis] } else { most[axis] };
            let corner = DVec3::new(side(0), side(1), side(2).min(orbit.cut_m()));
            let at = DVec2::new(right.dot(corner), up.dot(corner));
            (low, high) = (low.min(at), high.max(at));
        }
        let extent = (high - low).max(DVec2::splat(1e-3));
        let cells_per_m = (WIDTH as f64 / extent.x).min(MAX_HEIGHT as f64 / extent.y);
        let size = [extent.x, extent.y].map(|side| ((side * cells_per_m).ceil() as usize).clamp(1, WIDTH));
        let nearest = vec![None; size[0] * size[1]];
        Self { right, up, back, low, cells_per_m, size, nearest }
    }

    /// Cells from the lower left, and how near.
    fn at(&self, place_m: DVec3) -> DVec3 {
        let on_paper = DVec2::new(self.right.dot(place_m), self.up.dot(place_m)) - self.low;
        (on_paper * self.cells_per_m).extend(self.back.dot(place_m))
    }

    /// Paints a square around a place.
    fn dot(&mut self, at: DVec3, half: f64, layer: usize) {
        let span = |middle: f64, most: usize| {
            let from = (middle - half).floor().max(0.0) as usize;
            from.min(most)..((middle + half).floor() + 1.0).clamp(0.0, most as f64) as usize
        };
        for row in span(at.y, self.size[1]) {
            for column in span(at.x, self.size[0]) {
                let cell = &mut self.nearest[row * self.size[0] + column];
                if cell.is_none_or(|(depth, _)| depth <= at.z) {
                    *cell = Some((at.z, layer));
                }
            }
        }
    }

    fn line(&mut self, from: DVec3, to: DVec3, layer: usize) {
        let steps = (to - from).truncate().length().ceil().clamp(1.0, 2000.0);
        for step in 0..=steps as usize {
            self.dot(from.lerp(to, step as f64 / steps), 0.0, layer);
        }
    }

    fn triangle(&mut self, [a, b, c]: [DVec3; 3], layer: usize, cut_m: f64, heights_m: [f64; 3]) {
        let longest = (b - a).length().max((c - a).length()).max((c - b).length());
        let steps = (1.5 * longest).ceil().clamp(1.0, 600.0) as usize;
        for i in 0..=steps {
            for j in 0..=steps - i {
                let (u, v) = (i as f64 / steps as f64, j as f64 / steps as f64);
                let height_m =
                    heights_m[0] + u * (heights_m[1] - heights_m[0]) + v * (heights_m[2] - heights_m[0]);
                if height_m <= cut_m {
                    self.dot(a + u * (b - a) + v * (c - a), 0.0, layer);
                }
            }
        }
    }

    fn draw(&mut self, layer: &Layer, number: usize, cut_m: f64) {
        let is_in = |place_m: &DVec3| !layer.is_cut || place_m.z <= cut_m;
        match layer.shape {
            Shape::Points => {
                let half = 0.5 * layer.size_m * self.cells_per_m;
                for place_m in layer.places_m.iter().filter(|place_m| is_in(place_m)) {
                    self.dot(self.at(*place_m), half.min(6.0), number);
                }
            }
            Shape::Lines => {
                for pair in layer.places_m.chunks_exact(2) {
                    // lines are what one looks for: nothing hides them
                    let lifted = |place_m: DVec3| self.at(place_m) + 1e6 * DVec3::Z;
                    let (from, to) = (lifted(pair[0]), lifted(pair[1]));
                    self.line(from, to, number);
                }
            }
            Shape::Surface => {
                let cut_m = if layer.is_cut { cut_m } else { f64::INFINITY };
                for corners in layer.places_m.chunks_exact(3) {
                    let corners = [corners[0], corners[1], corners[2]];
                    self.triangle(
                        corners.map(|corner| self.at(corner)),
                        number,
                        cut_m,
                        corners.map(|corner| corner.z),
                    );
                }
            }
        }
    }
}

/// The picture with its legend.
pub(super) fn svg(orbit: &Orbit) -> String {
    let mut paper = Paper::around(orbit);
    for (number, layer) in orbit.layers.iter().enumerate().filter(|(_, layer)| layer.is_shown) {
        paper.draw(layer, number, orbit.cut_m());
    }
    let map = CellMap {
        title: "seen from behind and above".into(),
        width: paper.size[0],
        cells: paper.nearest.iter().map(|cell| cell.map(|(_, layer)| layer)).collect(),
        plan: None,
    };
    let classes: Vec<_> =
        orbit.layers.iter().map(|layer| CellClass::new(layer.css, layer.name.clone())).collect();
    cell_map_svg(&orbit.label, &map, &classes)
}
