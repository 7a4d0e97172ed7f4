//! One sweep against the map: iterated closest points with a robust kernel.

use glam::{DQuat, DVec3};
use nalgebra::{Cholesky, Matrix6, Vector6};
use rayon::prelude::*;

use super::map::{Nearest, PlaneFit, PointMap};
use crate::base::geometry::Pose;
use crate::design::registration::Information;

/// Iterations at most; a step of less than this, m and rad, ends them.
const ITERATIONS: usize = 60;
const SMALL_STEP: f64 = 1e-5;
/// Points of one piece of parallel work: pieces are added in order, so that the outcome does not hang on threads.
const PIECE: usize = 256;
/// Weight of a point that meets no plane, of each of its three directions: the nearest point of a map of scan lines lies
/// where the sensor sampled, not where the surface is.
const OFF_PLANE: f64 = 0.05;
/// The kernel narrows to so many times what the points are off by, but no farther than the last, m: at first outliers cannot
/// be recognised, at last they must not count.
const NARROWED: f64 = 3.0;
const NARROWEST_M: f64 = 0.03;
/// Iterations after which it does.
const NARROWS_AFTER: usize = 3;
/// Fewer points that meet the map say nothing.
const LEAST_MATCHED: usize = 30;
/// Information of a prediction, per matched point: holds directions that nothing ties down where they were expected.
const OF_PREDICTION: f64 = 1e-6;

/// How far and how firmly points are drawn to the map.
#[derive(Clone, Copy, Debug)]
pub struct Kernel {
    /// Residuals beyond this count little at first (Geman-McClure), m; points of the map beyond three times it are not met.
    pub width_m: f64,
    /// Cells that are searched to each side.
    pub reach_cells: i32,
}

/// Where a sweep lies.
#[derive(Clone, Debug)]
pub struct Aligned {
    /// World from body.
    pub pose: Pose,
    /// Of the points on planes, about the body's place in axes of the world.
    pub information: Information,
    /// Share of the points that met the map.
    pub matched_share: f64,
    /// Distance of the points from their planes, weighted root of the mean square, m.
    pub residual_m: f64,
}

/// What of the map was last near each point of a sweep: as a sweep settles, most of it stays what it was. One memory serves
/// one sweep, one state of the map and one kernel.
pub struct Memory(Vec<Known>);

#[derive(Clone, Copy, Default)]
struct Known {
    nearest: Option<Nearest>,
    cell: Option<u64>,
    /// The plane that was fitted around the cell.
    plane: Option<PlaneFit>,
}

impl Known {
    /// Takes what is nearest now, and the plane around it.
    fn look(&mut self, map: &PointMap, nearest: Nearest) {
        self.nearest = Some(nearest);
        let Some(near_m) = nearest.point_m else { return };
        let cell = map.cell_of(near_m);
        if self.cell != Some(cell) {
            (self.cell, self.plane) = (Some(cell), map.plane(near_m));
        }
    }
}

#[derive(Clone, Default)]
struct Sums {
    own: Matrix6<f64>,
    right: Vector6<f64>,
    matched: usize,
    squares: f64,
    weights: f64,
    information: Information,
}

impl Memory {
    /// Nothing known yet of so many points.
    pub(crate) fn of(points: usize) -> Self {
        Self(vec![Known::default(); points])
    }
}

/// Lays points of the body onto the map; none where too few meet it.
pub(crate) fn align(
    map: &PointMap,
    body_m: &[DVec3],
    memory: &mut Memory,
    guess: &Pose,
    kernel: Kernel,
) -> Option<Aligned> {
    let mut pose = *guess;
    let mut kernel = kernel;
    let within_m = 3.0 * kernel.width_m;
    let mut last = None;
    for iteration in 0..ITERATIONS {
        let sums = sums(map, body_m, &mut memory.0, &pose, kernel, within_m);
        if sums.matched < LEAST_MATCHED {
            return None;
        }
        let held = Matrix6::identity() * (OF_PREDICTION * sums.matched as f64);
        let step = Cholesky::new(sums.own + held)?.solve(&sums.right);
        let turn = DQuat::from_scaled_axis(DVec3::new(step[3], step[4], step[5]));
        let shift = DVec3::new(step[0], step[1], step[2]);
        pose = Pose::new((turn * pose.rotation).normalize(), pose.translation_m + shift);
        let narrower_m =
            (NARROWED * sums.residual_m()).clamp(NARROWEST_M.min(kernel.width_m), kernel.width_m);
        last = Some(sums);
        let is_narrow = narrower_m > 0.9 * kernel.width_m;
        if step.norm() < SMALL_STEP && is_narrow {
            break;
        }
        if iteration >= NARROWS_AFTER {
            kernel.width_m = narrower_m;
        }
    }
    let sums = last?;
    Some(Aligned {
        pose,
        matched_share: sums.matched as f64 / body_m.len() as f64,
        residual_m: sums.residual_m(),
        information: sums.information,
    })
}

fn sums(
    map: &PointMap,
    body_m: &[DVec3],
    known: &mut [Known],
    pose: &Pose,
    kernel: Kernel,
    within_m: f64,
) -> Sums {
    let pieces: Vec<Sums> = body_m
        .par_chunks(PIECE)
        .zip(known.par_chunks_mut(PIECE))
        .map(|(points_m, known)| {
            let mut sums = Sums::default();
            for (point_m, known) in points_m.iter().zip(known) {
                sums.meet(map, *point_m, known, pose, kernel, within_m);
            }
            sums
        })
        .collect();
    let mut all = Sums::default();
    for piece in pieces {
        all.own += piece.own;
        all.right += piece.right;
        all.matched += piece.matched;
        all.squares += piece.squares;
        all.weights += piece.weights;
        all.information.join(&piece.information);
    }
    all
}

impl Sums {
    /// Weighted root of the mean square of the distances from planes, m.
    fn residual_m(&self) -> f64 {
        if self.weights > 0.0 { (self.squares / self.weights).sqrt() } else { 0.0 }
    }

    fn meet(
        &mut self,
        map: &PointMap,
        body_m: DVec3,
        known: &mut Known,
        pose: &Pose,
        kernel: Kernel,
        within_m: f64,
    ) {
        let from_body_m = pose.rotate(body_m);
        let point_m = pose.translation_m + from_body_m;
        if !known.nearest.is_some_and(|nearest| map.is_nearest(&nearest, point_m)) {
            known.look(map, map.nearest(point_m, kernel.reach_cells, within_m));
        }
        let Some(near_m) = known.nearest.and_then(|nearest| nearest.point_m) else { return };
        self.matched += 1;
        let width_m2 = kernel.width_m * kernel.width_m;
        let weight = |residual_m2: f64| (width_m2 / (width_m2 + residual_m2)).powi(2);
        if let Some(plane) = known.plane {
            let residual_m = plane.normal.dot(point_m - plane.centre_m);
            let weight = weight(residual_m * residual_m);
            self.add(from_body_m, plane.normal, residual_m, weight);
            self.squares += weight * residual_m * residual_m;
            self.weights += weight;
            self.information.add(from_body_m, plane.normal);
        } else {
            let off_m = point_m - near_m;
            // points of the map are some distance apart themselves
            let wide_m2 = width_m2.max(0.25 * map.voxel_m() * map.voxel_m());
            let weight = OFF_PLANE * (wide_m2 / (wide_m2 + off_m.length_squared())).powi(2);
            for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
                self.add(from_body_m, axis, off_m.dot(axis), weight);
            }
        }
    }

    fn add(&mut self, from_body_m: DVec3, direction: DVec3, residual_m: f64, weight: f64) {
        let turn = from_body_m.cross(direction);
        let row = Vector6::new(direction.x, direction.y, direction.z, turn.x, turn.y, turn.z);
        self.own.ger(weight, &row, &row, 1.0);
        self.right -= row * (weight * residual_m);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points on the walls, floor and ceiling of a room of 6 x 5 x 3 m, some millimetres apart from any grid.
    fn room() -> Vec<DVec3> {
        let mut points = Vec::new();
        for a in 0..60 {
            for b in 0..50 {
                let [x, y] = [f64::from(a) * 0.1 - 2.97, f64::from(b) * 0.1 - 2.46];
                points.extend([DVec3::new(x, y, -1.2), DVec3::new(x, y, 1.8)]);
                let z = f64::from(b) * 0.06 - 1.18;
                points.extend([DVec3::new(x, 2.5, z), DVec3::new(x, -2.5, z)]);
                let y = f64::from(a) * 0.083 - 2.46;
                points.extend([DVec3::new(3.0, y, z), DVec3::new(-3.0, y, z)]);
            }
        }
        points
    }

    #[test]
    fn a_moved_room_is_moved_back() {
        let points = room();
        let mut map = PointMap::new(0.25);
        map.add(&points, &Pose::IDENTITY);
        let truth =
            Pose::new(DQuat::from_scaled_axis(DVec3::new(0.01, -0.02, 0.04)), DVec3::new(0.1, -0.06, 0.03));
        let body_m: Vec<DVec3> =
            points.iter().step_by(5).map(|p| truth.inverse().transform_point(*p)).collect();
        let kernel = Kernel { width_m: 0.3, reach_cells: 1 };
        let found = align(&map, &body_m, &mut Memory::of(body_m.len()), &Pose::IDENTITY, kernel).unwrap();
        let off = truth.inverse() * found.pose;
        assert!(off.translation_m.length() < 1e-3, "{off:?}");
        assert!(off.rotation.to_scaled_axis().length() < 1e-3, "{off:?}");
        assert!(found.matched_share > 0.95 && found.residual_m < 0.02, "{found:?}");
        assert!(found.information.conditioning().unwrap().translation.least() > 0.1);
    }

    #[test]
    fn along_a_corridor_the_prediction_holds() {
        let points: Vec<DVec3> = room().into_iter().filter(|p| p.x.abs() < 2.99).collect();
        let mut map = PointMap::new(0.25);
        map.add(&points, &Pose::IDENTITY);
        // the corridor goes on to both sides of what was seen
        let body_m: Vec<DVec3> =
            points.iter().filter(|p| p.x.abs() < 2.0).map(|p| *p - DVec3::new(0.0, 0.05, 0.0)).collect();
        let guess = Pose::from_translation(DVec3::new(0.3, 0.0, 0.0));
        let kernel = Kernel { width_m: 0.3, reach_cells: 1 };
        let found = align(&map, &body_m, &mut Memory::of(body_m.len()), &guess, kernel).unwrap();
        assert!((found.pose.translation_m.y - 0.05).abs() < 2e-3, "{found:?}");
        let translation = found.information.conditioning().unwrap().translation;
        assert!(translation.least() < crate::design::registration::DEGENERATE, "{translation:?}");
        assert!(translation.weakest.x.abs() > 0.99, "{translation:?}");
    }

    #[test]
    fn nothing_near_is_none() {
        let mut map = PointMap::new(0.25);
        map.add(&room(), &Pose::IDENTITY);
        let far: Vec<DVec3> = room().iter().map(|p| *p + 50.0).collect();
        let kernel = Kernel { width_m: 0.3, reach_cells: 1 };
        assert!(align(&map, &far, &mut Memory::of(far.len()), &Pose::IDENTITY, kernel).is_none());
    }
}
