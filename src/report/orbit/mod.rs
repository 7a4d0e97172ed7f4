//! The 3-D picture of a page: points, lines and surfaces in layers, drawn by the program's one viewer (`report/viewer/cloud.js`).
//! A page that holds one stays a file that opens anywhere: its data are in it, thinned, and where there is no WebGL 2, no
//! script or a printer, a picture from above stands in its place.

mod compared;
mod encode;
mod picture;
mod published;
mod rig;
mod seen;

use glam::DVec3;

pub(crate) use compared::compared;
pub(crate) use published::published;
pub(crate) use seen::seen;

use super::BlindSpot;
use crate::report::chart::{CellClass, count, escape};
use crate::world::local_origin::LocalOrigin;
use crate::world::scene::{BoxScene, Scene};
use crate::world::trajectory::Trajectory;

/// Points of all layers together: 2.5 MB of a page.
const MAX_POINTS: usize = 300_000;
/// Triangles of a scene: 1.5 MB of a page. Of a finer mesh the largest are drawn.
const MAX_TRIANGLES: usize = 60_000;
/// Positions of the trajectory.
const MAX_POSES: usize = 2000;
/// What lies above this share of the height is left out at first: the ceiling of a place seen from above.
const CUT_SHARE: f64 = 0.8;

/// What the places of a layer are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Shape {
    /// Points, drawn as large as they are.
    Points,
    /// Ends of lines, two of each.
    Lines,
    /// Corners of triangles, three of each.
    Surface,
}

/// Places of one colour that are shown or hidden together.
#[derive(Clone, Debug)]
struct Layer {
    name: String,
    /// Class of colour, as in charts.
    css: &'static str,
    shape: Shape,
    places_m: Vec<DVec3>,
    /// Edge of a point, m.
    size_m: f64,
    /// Whether it is one of the scene's: cut at a height.
    is_cut: bool,
    is_shown: bool,
}

/// A 3-D picture, in the local frame.
#[derive(Clone, Debug)]
pub(crate) struct Orbit {
    label: String,
    origin: LocalOrigin,
    bounds_m: [DVec3; 2],
    layers: Vec<Layer>,
    spots: Vec<BlindSpot>,
    /// Where the rig was, and its heading, rad.
    poses: Vec<(DVec3, f64)>,
}

impl Orbit {
    /// The surface of a scene, nothing on it yet. `label` says what is to be seen.
    pub(crate) fn new(label: &str, scene: &Scene, origin: LocalOrigin) -> Self {
        let mut orbit = Self {
            label: label.to_owned(),
            origin,
            bounds_m: scene.bounds_m(),
            layers: Vec::new(),
            spots: Vec::new(),
            poses: Vec::new(),
        };
        match scene {
            Scene::Mesh(mesh) => {
                let corners_m = mesh.largest_triangles(MAX_TRIANGLES).flatten().collect();
                let name = match mesh.triangles() > MAX_TRIANGLES {
                    true => format!("scene (largest {} triangles)", count(MAX_TRIANGLES as u64)),
                    false => "scene".to_owned(),
                };
                orbit.add(&name, "c-none", Shape::Surface, corners_m, true);
            }
            Scene::Box(walls) => {
                orbit.add("edges of the room", "c-none", Shape::Lines, edges_m(walls), false)
            }
            Scene::Voxels(map) => orbit.points("scene (map)", "c-none", map.voxel_m(), map.occupied_m()),
        }
        orbit
    }

    /// Points of an edge, in a colour; points of nothing add no layer.
    pub(crate) fn points(
        &mut self,
        name: &str,
        css: &'static str,
        size_m: f64,
        points_m: impl IntoIterator<Item = DVec3>,
    ) {
        self.add(name, css, Shape::Points, points_m.into_iter().collect(), true);
        if let Some(layer) = self.layers.last_mut().filter(|layer| layer.name == name) {
            layer.size_m = size_m;
        }
    }

    /// Points in classes, each a layer of its own.
    pub(crate) fn classes(
        &mut self,
        classes: &[CellClass],
        size_m: f64,
        points: impl Iterator<Item = (DVec3, usize)>,
    ) {
        let mut by_class = vec![Vec::new(); classes.len()];
        points.for_each(|(point_m, class)| by_class[class].push(point_m));
        for (class, points_m) in classes.iter().zip(by_class) {
            self.points(&class.name, class.css, size_m, points_m);
        }
    }

    /// Blind spots to go to, in the frame of the files.
    pub(crate) fn spots(&mut self, spots: &[BlindSpot]) {
        self.spots = spots.to_vec();
    }

    /// The path of the rig.
    pub(crate) fn trajectory(&mut self, trajectory: &Trajectory) {
        let step = trajectory.stamped().count().div_ceil(MAX_POSES).max(1);
        self.poses = trajectory
            .stamped()
            .step_by(step)
            .map(|(_, pose)| {
                let ahead = pose.rotate(DVec3::X);
                (pose.translation_m, ahead.y.atan2(ahead.x))
            })
            .collect();
        let lines = self.poses.windows(2).flat_map(|pair| [pair[0].0, pair[1].0]).collect();
        self.add("trajectory", "c-path", Shape::Lines, lines, false);
    }

    fn add(&mut self, name: &str, css: &'static str, shape: Shape, places_m: Vec<DVec3>, is_cut: bool) {
        if !places_m.is_empty() {
            let name = name.to_owned();
            self.layers.push(Layer { name, css, shape, places_m, size_m: 0.0, is_cut, is_shown: true });
        }
    }

    /// Height above which the scene is left out at first, m.
    fn cut_m(&self) -> f64 {
        self.bounds_m[0].z + CUT_SHARE * (self.bounds_m[1].z - self.bounds_m[0].z)
    }

    /// The figure: a picture for everybody, and the data of the view that takes its place.
    pub(super) fn html(mut self) -> String {
        self.thin();
        let picture = picture::svg(&self);
        let spots: String = self
            .spots
            .iter()
            .map(|spot| {
                let [x, y, z] = self.origin.local(spot.centre_m.into()).to_array();
                let size = spot.extent_m.iter().copied().fold(0.0, f64::max);
                format!(
                    "<li><button type=\"button\" data-look=\"{x:.2},{y:.2},{z:.2},{size:.2}\">{}</button></li>",
                    escape(&spot.words())
                )
            })
            .collect();
        let list = match spots.is_empty() {
            true => String::new(),
            false => format!(
                "<div class=\"spots\"><p>Blind spots, largest first: choose one to look at it</p><ol>{spots}</ol></div>"
            ),
        };
        format!(
            "<figure class=\"orbit\"><div class=\"stage\">{picture}</div>{list}<script type=\"application/json\">{}</script>",
            encode::json(&self)
        )
    }

    /// An even share of the points of each layer.
    fn thin(&mut self) {
        let is_points = |layer: &&mut Layer| layer.shape == Shape::Points;
        let all: usize = self.layers.iter_mut().filter(is_points).map(|layer| layer.places_m.len()).sum();
        if all <= MAX_POINTS {
            return;
        }
        let share = MAX_POINTS as f64 / all as f64;
        for layer in self.layers.iter_mut().filter(is_points) {
            let mut number = 0_u64;
            layer.places_m.retain(|_| {
                number += 1;
                // golden ratio: even, and in step with no grid
                (number as f64 * 0.618_033_988_749_894_9).fract() < share
            });
            // as much of the surface is covered as before
            layer.size_m *= (1.0 / share).sqrt().min(2.0);
        }
    }
}

/// The twelve edges, two ends each.
fn edges_m(walls: &BoxScene) -> Vec<DVec3> {
    let corner = |n: usize| {
        let side = |axis: usize| if n >> axis & 1 == 0 { walls.min_m[axis] } else { walls.max_m[axis] };
        DVec3::new(side(0), side(1), side(2))
    };
    let from_corner =
        |n: usize| (0..3).filter(move |axis| n >> axis & 1 == 0).map(move |axis| [n, n | 1 << axis]);
    (0..8).flat_map(from_corner).flatten().map(corner).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn room() -> Scene {
        Scene::Box(BoxScene::closed(DVec3::ZERO, DVec3::new(6.0, 4.0, 3.0)))
    }

    #[test]
    fn a_page_of_millions_of_points_stays_small() {
        let mut orbit = Orbit::new("a room", &room(), LocalOrigin::default());
        let grid = (0..1_500_000).map(|n| DVec3::new(f64::from(n % 1000), f64::from(n / 1000), 0.0) * 4e-3);
        orbit.points("seen", "c-both", 0.05, grid);
        let html = orbit.html();
        assert!(html.len() < 4_000_000, "{}", html.len());
        assert!(html.contains("\"name\":\"seen\"") && html.contains("<svg"));
    }

    #[test]
    fn names_end_no_script_and_no_attribute() {
        let mut orbit = Orbit::new("a \"room\" </script>", &room(), LocalOrigin::default());
        orbit.points("</script><b>", "c-both", 0.1, [DVec3::ONE]);
        let html = orbit.html();
        assert_eq!(html.matches("</script>").count(), 1, "{html}");
        assert!(!html.contains("<b>"));
    }

    #[test]
    fn a_room_has_twelve_edges() {
        let Scene::Box(walls) = room() else { unreachable!() };
        let ends = edges_m(&walls);
        let length_m: f64 = ends.chunks(2).map(|pair| pair[0].distance(pair[1])).sum();
        assert_eq!((ends.len(), length_m), (24, 4.0 * 13.0));
    }
}
