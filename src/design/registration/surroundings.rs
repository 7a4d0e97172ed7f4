//! Registration strength of rigs along a trajectory: by casting some of their beams, and by a map of what surrounds the body, which
//! takes no ray for a rig.

use glam::{DMat3, DVec3, Vec3};
use rayon::prelude::*;

use super::{Information, RegistrationQuality};
use crate::rig::Rig;
use crate::simulate::view::{BeamAtRest, CastView};

/// Places along the trajectory at which a scan is judged.
const PLACES: usize = 60;
/// Columns and rows of each sensor that are cast, and that are looked up in the map.
const CAST: [usize; 2] = [128, 32];
const LOOKED_UP: [usize; 2] = [48, 12];
/// Directions of a map: so many squared, about 1.6 degrees apart.
const SIDE: usize = 128;

/// By scan what the beams of a rig tell, each beam cast.
pub(crate) fn cast(view: &CastView, rig: &Rig) -> Option<RegistrationQuality> {
    let beams = view.beams_at_rest(rig, CAST);
    let of_place = |(axes, body_m): &(DMat3, DVec3)| {
        let rays = beams.iter().map(|beam| (*body_m + *axes * beam.origin_m, *axes * beam.direction));
        let (origins_m, directions): (Vec<DVec3>, Vec<DVec3>) = rays.unzip();
        let mut scan = Information::default();
        view.site().scene.cast_many(&origins_m, &directions, |ray, hit| {
            let (least_m, most_m) = beams[ray].returns_m;
            if let Some(hit) = hit.filter(|hit| (least_m..=most_m).contains(&hit.distance_m)) {
                scan.add(origins_m[ray] + hit.distance_m * directions[ray] - *body_m, hit.normal);
            }
        });
        scan
    };
    let scans: Vec<Information> = view.places(PLACES).par_iter().map(of_place).collect();
    RegistrationQuality::of_scans(&scans)
}

/// The planes that are seen from the body at places along a trajectory.
pub(crate) struct Surroundings {
    places: Vec<Vec<Option<Plane>>>,
}

/// A piece of surface, in the frame of the body.
#[derive(Clone, Copy)]
struct Plane {
    normal: Vec3,
    /// From the body along the ray that met it, and as that of the plane against its normal, m.
    range_m: f32,
    height_m: f32,
}

impl Surroundings {
    /// Casts the maps.
    pub(crate) fn new(view: &CastView) -> Self {
        let directions: Vec<DVec3> = (0..SIDE * SIDE).map(direction).collect();
        let of_place = |(axes, body_m): &(DMat3, DVec3)| {
            let along: Vec<DVec3> = directions.iter().map(|direction| *axes * *direction).collect();
            let mut planes = vec![None; along.len()];
            view.site().scene.cast_many(&vec![*body_m; along.len()], &along, |ray, hit| {
                planes[ray] = hit.map(|hit| Plane {
                    normal: (axes.transpose() * hit.normal).as_vec3(),
                    range_m: hit.distance_m as f32,
                    height_m: (-hit.distance_m * hit.normal.dot(along[ray])) as f32,
                });
            });
            planes
        };
        Self { places: view.places(PLACES).par_iter().map(of_place).collect() }
    }

    /// What some beams of a rig tell of these surroundings.
    pub(crate) fn quality(&self, view: &CastView, rig: &Rig) -> Option<RegistrationQuality> {
        let beams: Vec<(usize, BeamAtRest)> =
            view.beams_at_rest(rig, LOOKED_UP).into_iter().map(|beam| (cell(beam.direction), beam)).collect();
        let of_place = |planes: &Vec<Option<Plane>>| {
            let mut scan = Information::default();
            for (cell, beam) in &beams {
                let Some(plane) = planes[*cell] else { continue };
                let distance_m = plane.distance_m(beam);
                let (least_m, most_m) = beam.returns_m;
                if (least_m..=most_m).contains(&distance_m) {
                    scan.add(beam.origin_m + distance_m * beam.direction, plane.normal.as_dvec3());
                }
            }
            scan
        };
        RegistrationQuality::of_scans(&self.places.iter().map(of_place).collect::<Vec<_>>())
    }
}

impl Plane {
    /// Where a beam through its piece meets it; where that is far from what was met there, as far as that.
    fn distance_m(&self, beam: &BeamAtRest) -> f64 {
        let normal = self.normal.as_dvec3();
        let range_m = f64::from(self.range_m);
        let distance_m = (f64::from(self.height_m) + normal.dot(beam.origin_m)) / -normal.dot(beam.direction);
        if (0.5 * range_m..2.0 * range_m).contains(&distance_m) { distance_m } else { range_m }
    }
}

/// The middle of a cell of the octahedral map (Cigolle et al. 2014, JCGT 3(2), "A Survey of Efficient Representations for Independent
/// Unit Vectors").
fn direction(cell: usize) -> DVec3 {
    let middle = |at: usize| (2 * at + 1) as f64 / SIDE as f64 - 1.0;
    let (u, v) = (middle(cell % SIDE), middle(cell / SIDE));
    let z = 1.0 - u.abs() - v.abs();
    let (x, y) = if z >= 0.0 { (u, v) } else { folded(u, v) };
    DVec3::new(x, y, z).normalize()
}

/// The cell in which a direction lies.
fn cell(direction: DVec3) -> usize {
    let DVec3 { x, y, z } = direction / direction.abs().element_sum();
    let (u, v) = if z >= 0.0 { (x, y) } else { folded(x, y) };
    let at = |value: f64| ((0.5 * (value + 1.0) * SIDE as f64) as usize).min(SIDE - 1);
    at(u) + SIDE * at(v)
}

/// The lower half of the octahedron, folded outward; its own inverse.
fn folded(u: f64, v: f64) -> (f64, f64) {
    ((1.0 - v.abs()) * u.signum(), (1.0 - u.abs()) * v.signum())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::Rng;
    use crate::rig::{Mount, MountedSensor, Unit};
    use crate::simulate::view::{Precision, Sampling, Shades, ViewSite};
    use crate::world::coverage::VoxelGrid;
    use crate::world::scene::{BoxScene, Scene};
    use crate::world::trajectory::Trajectory;

    #[test]
    fn the_map_tells_what_the_beams_do() {
        let mut rng = Rng::new(4, 0);
        for name in ["os1-64", "vlp-16"] {
            let unit = Unit::nominal(name).unwrap();
            let (low_m, high_m) = (DVec3::new(-6.0, -4.0, 0.0), DVec3::new(6.0, 4.0, 3.0));
            let site = ViewSite {
                scene: Scene::Box(BoxScene::closed(low_m, high_m)),
                trajectory: Trajectory::straight(
                    DVec3::new(-3.0, 1.0, 1.6),
                    DVec3::new(3.0, 1.0, 1.6),
                    1.0,
                    0,
                ),
                grid: VoxelGrid { origin_m: low_m - 0.25, voxel_m: 0.5, cells: [25, 17, 7] },
                shades: Shades::default(),
            };
            let units = std::slice::from_ref(&unit);
            let view = CastView::new(site, units, &Sampling::default(), Precision::Double).unwrap();
            let surroundings = Surroundings::new(&view);
            for _ in 0..20 {
                let mount = Mount {
                    x_m: rng.between(0.0, 0.15),
                    y_m: rng.between(-0.25, 0.25),
                    z_m: rng.between(-0.15, 0.15),
                    pitch_rad: rng.between(-0.9, 0.9),
                    ..Mount::default()
                };
                let sensor = |mount| MountedSensor { name: String::new(), model: unit.model.clone(), mount };
                let rig = Rig { sensors: vec![sensor(mount), sensor(mount.mirrored())] };
                let [by_map, by_beams] = [surroundings.quality(&view, &rig), cast(&view, &rig)];
                let [by_map, by_beams] = [by_map, by_beams].map(|found| found.unwrap().translation_p5);
                let off = (by_map - by_beams).abs();
                assert!(off < 0.01 + 0.1 * by_beams, "{name} {mount:?}: {by_map} {by_beams}");
            }
        }
    }

    #[test]
    fn every_direction_lies_near_the_middle_of_its_cell() {
        let mut rng = Rng::new(1, 0);
        for _ in 0..10_000 {
            let along = DVec3::new(rng.normal(), rng.normal(), rng.normal()).normalize();
            let off_rad = direction(cell(along)).angle_between(along);
            // half the diagonal of a cell, where the octahedron is nearest to the middle
            assert!(off_rad < 0.035, "{along}: {off_rad}");
        }
        assert!((0..SIDE * SIDE).all(|at| cell(direction(at)) == at));
    }
}
