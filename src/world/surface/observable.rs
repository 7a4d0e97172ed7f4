//! Which points of a surface can be seen from a path at all.

use glam::DVec3;
use rayon::prelude::*;

use super::SurfaceSamples;
use crate::world::scene::{Mesh, Scene};

/// Points handled by one thread at a time.
const CHUNK: usize = 4096;
/// A surface this near before a point does not hide it, m.
const SIGHT_TOLERANCE_M: f64 = 0.02;
/// The same in a map, in voxels: a point is the centre of a voxel, and its neighbours are occupied too.
const SIGHT_TOLERANCE_VOXELS: f64 = 2.0;

impl Scene {
    /// Whether each sample point has a free line of sight to one of the stations.
    pub fn observable(&self, samples: &SurfaceSamples, stations_m: &[DVec3]) -> Vec<bool> {
        let tolerance_m = match self {
            Scene::Mesh(mesh) => return observable_of_mesh(mesh, samples, stations_m, SIGHT_TOLERANCE_M),
            Scene::Box(_) => SIGHT_TOLERANCE_M,
            Scene::Voxels(map) => SIGHT_TOLERANCE_VOXELS * map.voxel_m(),
        };
        let is_seen =
            |point_m: &DVec3| stations_m.iter().any(|from_m| self.sees(*from_m, *point_m, tolerance_m));
        samples.points_m().par_iter().map(is_seen).collect()
    }
}

/// No surface lies more than `tolerance_m` before an observable point.
fn observable_of_mesh(
    mesh: &Mesh,
    samples: &SurfaceSamples,
    stations_m: &[DVec3],
    tolerance_m: f64,
) -> Vec<bool> {
    let order = samples.order();
    let seen_in_order: Vec<Vec<bool>> = order
        .par_chunks(CHUNK)
        .map(|chunk| {
            let mut seen = vec![false; chunk.len()];
            let mut open: Vec<u32> = (0..chunk.len() as u32).collect();
            let mut points_m = Vec::with_capacity(chunk.len());
            let centre_m = samples.points_m[chunk[chunk.len() / 2] as usize];
            for station_m in nearest_first(stations_m, centre_m) {
                points_m.clear();
                points_m.extend(open.iter().map(|place| samples.points_m[chunk[*place as usize] as usize]));
                mesh.occluded_many(station_m, &points_m, tolerance_m, |index, hidden| {
                    seen[open[index] as usize] = !hidden;
                });
                open.retain(|place| !seen[*place as usize]);
                if open.is_empty() {
                    break;
                }
            }
            seen
        })
        .collect();
    let mut seen = vec![false; samples.len()];
    for (index, visible) in order.iter().zip(seen_in_order.into_iter().flatten()) {
        seen[*index as usize] = visible;
    }
    seen
}

fn nearest_first(stations_m: &[DVec3], centre_m: DVec3) -> Vec<DVec3> {
    let mut sorted = stations_m.to_vec();
    sorted.sort_by(|a, b| a.distance_squared(centre_m).total_cmp(&b.distance_squared(centre_m)));
    sorted
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wall_hides_what_is_behind_it() {
        // a wall at x = 1 from y = -1 to 1, and points on both sides of it and past its edge
        let corners = vec![
            DVec3::new(1.0, -1.0, -1.0),
            DVec3::new(1.0, 1.0, -1.0),
            DVec3::new(1.0, 1.0, 1.0),
            DVec3::new(1.0, -1.0, 1.0),
        ];
        let mesh = Mesh::new(corners, vec![[0, 1, 2], [0, 2, 3]]).unwrap();
        let points = [
            DVec3::new(1.0, 0.2, 0.3),
            DVec3::new(2.0, 0.0, 0.1),
            DVec3::new(2.0, 3.0, 0.0),
            DVec3::new(1.015, 0.1, 0.2),
            DVec3::new(1.025, 0.1, 0.2),
        ];
        let samples = SurfaceSamples::new(points.to_vec()).unwrap();
        let scene = Scene::Mesh(mesh.into());
        let seen = scene.observable(&samples, &[DVec3::ZERO]);
        assert_eq!(seen, [true, false, true, true, false]);
        let both = scene.observable(&samples, &[DVec3::ZERO, DVec3::new(5.0, 0.0, 0.0)]);
        assert_eq!(both, [true; 5]);
    }
}
