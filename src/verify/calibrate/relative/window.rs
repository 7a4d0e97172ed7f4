//! A few revolutions in a row: both sensors' points among both sensors' planes.

use glam::{DMat3, DQuat, DVec3};
use nalgebra::{Cholesky, DMatrix, DVector, SMatrix, SVector};

use super::super::gather::{LEAST_COSINE, Offset};
use super::Pair;
use crate::base::geometry::{BODY_FROM_MOUNT_FRAME, Pose};
use crate::rig::MountedSensor;
use crate::verify::compare::RecordedRay;
use crate::verify::odometry::{Cells, Moments, PlaneFit};
use crate::world::trajectory::PoseError;

/// Revolutions that may share a window.
pub const MOST_TURNS: usize = 8;
/// Points of one sensor and window that are laid into planes, at most; all points make planes.
const QUERIES: usize = 40_000;
/// Of the distances from a sensor's own planes, which hold the poses and nothing else, one in so many is used.
const OWN_EVERY: usize = 8;
/// Points that a plane is made of, at least.
const LEAST_POINTS: f64 = 8.0;
/// Residuals beyond so many standard deviations count less (Huber 1964, doi:10.1214/aoms/1177703732).
const HUBER: f64 = 2.0;

/// Information about the seven unknowns.
pub type Block77 = SMatrix<f64, 7, 7>;
/// The seven unknowns.
pub type Column7 = SVector<f64, 7>;

/// How a round looks around.
#[derive(Clone, Copy, Debug)]
pub struct Look {
    /// Edge of a cell, m.
    pub edge_m: f64,
    /// Points farther from a plane are left out, m.
    pub gate_m: f64,
    /// Planes of which the points scatter more are left out: they bend around an edge, m.
    pub most_across_m: f64,
    /// Cosine of the angle that the planes of both sensors may be apart.
    pub least_alike: f64,
    /// One in so many points is laid into planes.
    pub every: usize,
    /// Robust standard deviation of a residual, m; none before the first round.
    pub scale_m: Option<f64>,
}

/// A window and what is known of the body's pose in each of its revolutions.
#[derive(Clone, Debug)]
pub struct Window {
    /// Its rays, by their range in the list.
    pub rays: std::ops::Range<usize>,
    /// First and last revolution, the latter not included, of those since the first ray.
    pub turns: std::ops::Range<u64>,
    /// Error of the body's pose by revolution, m and rad in the axes of the body.
    pub poses: Vec<[f64; 6]>,
}

/// What one window says about the unknowns, its poses free.
#[derive(Clone, Debug)]
pub struct WindowSums {
    /// Information, 1 per unit squared.
    pub information: Block77,
    /// Its pull.
    pub right: Column7,
    /// Information that noise of the normals only pretends.
    pub pretended: Block77,
    /// Residuals between the sensors, m.
    pub across_m: Vec<f64>,
    /// Sum of the squares of the levers of those, m^2.
    pub lever2_m2: f64,
    back: Option<Back>,
}

/// Poses from the unknowns: information about them, what they share with the unknowns, their pull.
type Back = (Cholesky<f64, nalgebra::Dyn>, DMatrix<f64>, DVector<f64>);

#[derive(Clone, Copy)]
struct Point {
    is_first: bool,
    turn: usize,
    world_m: DVec3,
    direction: DVec3,
}

/// Points of one sensor in a cell.
#[derive(Clone, Debug, Default)]
struct Cell {
    sums: Moments,
    of_turn: [f64; MOST_TURNS],
}

#[derive(Clone)]
struct Found {
    plane: PlaneFit,
    of_turn: [f64; MOST_TURNS],
}

/// Where body and both sensors stood in a revolution.
struct Stand {
    world_from_body: Pose,
    /// Of the first and of the second sensor, world, m.
    origins_m: [DVec3; 2],
}

impl Window {
    /// What this window says when the first sensor is off by that.
    pub(crate) fn sums(
        &self,
        pair: &Pair<'_>,
        offset: &Offset,
        look: &Look,
        error: &PoseError,
    ) -> WindowSums {
        let points = self.points(pair, offset);
        let stands = self.stands(pair, offset);
        let origin_m = stands.first().map_or(DVec3::ZERO, |stand| stand.world_from_body.translation_m);
        let mut maps = [Cells::<Cell>::new(look.edge_m), Cells::<Cell>::new(look.edge_m)];
        for point in &points {
            let cell = maps[usize::from(!point.is_first)].at_mut(point.world_m);
            // near zero the sums of squares keep their digits
            cell.sums.add(point.world_m - origin_m);
            cell.of_turn[point.turn] += 1.0;
        }
        let every = look.every * points.len().div_ceil(2 * QUERIES).max(1);
        // all points of a cell share its plane
        let mut known = [(); 2].map(|()| Cells::<Option<Option<Found>>>::new(look.edge_m));
        let turns = self.poses.len();
        let size = 7 + 6 * turns;
        let mut sums = DMatrix::<f64>::zeros(size, size);
        let mut right = DVector::<f64>::zeros(size);
        let mut window_sums = WindowSums::nothing();
        let mut row = vec![0.0; size];
        for (number, point) in points.iter().step_by(every).enumerate() {
            let planes: [Option<Found>; 2] = std::array::from_fn(|map| {
                let seek = || find(&maps[map], point.world_m, look.edge_m, origin_m);
                known[map].at_mut(point.world_m).get_or_insert_with(seek).clone()
            });
            let own_plane = &planes[usize::from(!point.is_first)];
            for (map, found) in planes.iter().enumerate() {
                let (Some(found), Some(own_plane)) = (found, own_plane) else { continue };
                let plane = &found.plane;
                let residual_m = plane.normal.dot(point.world_m - plane.centre_m);
                let is_across = point.is_first != (map == 0);
                if !is_across && !number.is_multiple_of(OWN_EVERY)
                    || residual_m.abs() > look.gate_m
                    || plane.across_m2 > look.most_across_m.powi(2)
                    || own_plane.plane.across_m2 > look.most_across_m.powi(2)
                    || point.direction.dot(plane.normal).abs() < LEAST_COSINE
                    || plane.normal.dot(own_plane.plane.normal).abs() < look.least_alike
                {
                    continue;
                }
                let huber = match look.scale_m {
                    Some(scale_m) if residual_m.abs() > HUBER * scale_m => HUBER * scale_m / residual_m.abs(),
                    _ => 1.0,
                };
                let weight = huber / look.scale_m.unwrap_or(0.05).powi(2);
                row.fill(0.0);
                fill(&mut row, &stands, point, map == 0, &found.of_turn, plane.normal);
                add(&mut sums, &mut right, &row, residual_m, weight);
                if is_across {
                    window_sums.across_m.push(residual_m);
                    let lever_m = point.world_m - stands[point.turn].origins_m[0];
                    window_sums.lever2_m2 += lever_m.cross(plane.normal).length_squared();
                    window_sums.pretend(&stands, point, map == 0, found, weight);
                }
            }
        }
        self.hold(&mut sums, &mut right, error, pair.revolution_ns as f64 * 1e-9);
        window_sums.reduce(&sums, &right);
        window_sums
    }

    /// Takes the poses that belong to a step of the unknowns.
    pub(crate) fn follow(&mut self, window_sums: &WindowSums, step: &Column7) {
        let Some((held, cross, right)) = &window_sums.back else { return };
        let poses = held.solve(&(right - cross * step));
        for (turn, pose) in self.poses.iter_mut().enumerate() {
            for (place, value) in pose.iter_mut().enumerate() {
                *value += poses[6 * turn + place];
            }
        }
    }

    fn turn(&self, pair: &Pair<'_>, time_ns: u64) -> usize {
        let number = pair.turn(time_ns) - self.turns.start;
        (number as usize).min(self.poses.len() - 1)
    }

    fn points(&self, pair: &Pair<'_>, offset: &Offset) -> Vec<Point> {
        let place = |ray: &RecordedRay| {
            let range_m = ray.range_m?;
            let turn = self.turn(pair, ray.time_ns);
            let world_from_body = pair.trajectory.at(ray.time_ns)? * pose(&self.poses[turn]);
            let is_first = ray.sensor == pair.first;
            let mount = ray.mount(pair.sensors);
            let (mounted, off_m) = if is_first {
                (offset.body_from_sensor(&mount), offset.range_m)
            } else {
                (mount.body_from_sensor(), 0.0)
            };
            let placed = ray.place(pair.sensors, &(world_from_body * mounted));
            let world_m = placed.at_range(range_m - off_m);
            Some(Point { is_first, turn, world_m, direction: placed.direction })
        };
        pair.rays[self.rays.clone()].iter().filter_map(place).collect()
    }

    fn stands(&self, pair: &Pair<'_>, offset: &Offset) -> Vec<Stand> {
        let [start_ns, end_ns] = pair.trajectory.time_span_ns();
        let mounted = |sensor: usize| -> &MountedSensor { &pair.sensors[sensor] };
        let first_m = offset.body_from_sensor(&mounted(pair.first).mount).translation_m;
        let second_m = mounted(pair.second).mount.body_from_sensor().translation_m;
        let stand = |(turn, off): (usize, &[f64; 6])| {
            let middle_ns =
                pair.start_ns() + (2 * (self.turns.start + turn as u64) + 1) * pair.revolution_ns / 2;
            let at = pair.trajectory.at(middle_ns.clamp(start_ns, end_ns)).unwrap_or(Pose::IDENTITY);
            let world_from_body = at * pose(off);
            let origins_m = [first_m, second_m].map(|at_m| world_from_body.transform_point(at_m));
            Stand { world_from_body, origins_m }
        };
        self.poses.iter().enumerate().map(stand).collect()
    }

    /// The prior of the poses: errors that fade over seconds pull neighbours together.
    fn hold(&self, sums: &mut DMatrix<f64>, right: &mut DVector<f64>, error: &PoseError, turn_s: f64) {
        let correlation = error.correlation(turn_s).min(1.0 - 1e-9);
        let fresh = 1.0 - correlation * correlation;
        let last = self.poses.len() - 1;
        for place in 0..6 {
            let sd = if place < 3 { error.position_sd_m.max(1e-6) } else { error.rotation_sd_rad.max(1e-7) };
            for turn in 0..=last {
                let inner = if turn == 0 || turn == last { 1.0 } else { 1.0 + correlation * correlation };
                let own = if last == 0 { 1.0 } else { inner / fresh } / (sd * sd);
                let at = 7 + 6 * turn + place;
                sums[(at, at)] += own;
                right[at] -= own * self.poses[turn][place];
                if turn > 0 {
                    let coupling = -correlation / fresh / (sd * sd);
                    sums[(at, at - 6)] += coupling;
                    sums[(at - 6, at)] += coupling;
                    right[at] -= coupling * self.poses[turn - 1][place];
                    right[at - 6] -= coupling * self.poses[turn][place];
                }
            }
        }
    }
}

impl WindowSums {
    fn nothing() -> Self {
        Self {
            information: Block77::zeros(),
            right: Column7::zeros(),
            pretended: Block77::zeros(),
            across_m: Vec::new(),
            lever2_m2: 0.0,
            back: None,
        }
    }

    /// Normals that waver by chance seem to see along the plane too.
    fn pretend(&mut self, stands: &[Stand], point: &Point, of_first: bool, found: &Found, weight: f64) {
        let plane = &found.plane;
        let waver2 = plane.across_m2 / (plane.narrow_m2 * plane.count);
        let (along, across) = plane.normal.any_orthonormal_pair();
        for direction in [along, across] {
            let mut row = [0.0; 7 + 6 * MOST_TURNS];
            fill(&mut row, stands, point, of_first, &found.of_turn, direction);
            let seen = Column7::from_column_slice(&row[..7]);
            self.pretended.ger(weight * waver2, &seen, &seen, 1.0);
        }
    }

    /// The poses eliminated (Schur complement).
    fn reduce(&mut self, sums: &DMatrix<f64>, right: &DVector<f64>) {
        let poses = sums.nrows() - 7;
        let own = sums.view((7, 7), (poses, poses)).into_owned();
        let cross = sums.view((7, 0), (poses, 7)).into_owned();
        let right_of_poses = right.rows(7, poses).into_owned();
        let Some(held) = Cholesky::new(own) else { return };
        let eliminated = cross.transpose() * held.solve(&cross);
        let pulled = cross.transpose() * held.solve(&right_of_poses);
        self.information = Block77::from_fn(|a, b| sums[(a, b)] - eliminated[(a, b)]);
        self.right = Column7::from_fn(|place, _| right[place] - pulled[place]);
        self.back = Some((held, cross, right_of_poses));
    }
}

fn pose(off: &[f64; 6]) -> Pose {
    let [x, y, z, a, b, c] = *off;
    Pose::new(DQuat::from_scaled_axis(DVec3::new(a, b, c)), DVec3::new(x, y, z))
}

fn find(map: &Cells<Cell>, point_m: DVec3, edge_m: f64, origin_m: DVec3) -> Option<Found> {
    let (mut sums, mut of_turn) = (Moments::default(), [0.0; MOST_TURNS]);
    map.around(point_m, 1, |cell| {
        sums.join(&cell.sums);
        of_turn.iter_mut().zip(&cell.of_turn).for_each(|(sum, more)| *sum += more);
    });
    let mut plane = sums.plane(edge_m).filter(|plane| plane.count >= LEAST_POINTS)?;
    plane.centre_m += origin_m;
    of_turn.iter_mut().for_each(|share| *share /= plane.count);
    Some(Found { plane, of_turn })
}

/// How the distance of a point from a plane of the first or second sensor changes with the unknowns and the poses, negative:
/// the residual is this times what is off.
fn fill(
    row: &mut [f64],
    stands: &[Stand],
    point: &Point,
    of_first: bool,
    of_turn: &[f64; MOST_TURNS],
    normal: DVec3,
) {
    let axes: DMat3 = BODY_FROM_MOUNT_FRAME.transpose();
    let mut one = |is_first: bool, turn: usize, share: f64| {
        let stand = &stands[turn];
        let back = stand.world_from_body.inverse();
        let in_body = back.rotate(normal);
        if is_first {
            let away_m = point.world_m - stand.origins_m[0];
            let seen = axes * in_body;
            let lever_m = axes * back.rotate(away_m);
            let turned = lever_m.cross(seen);
            for axis in 0..3 {
                row[axis] += share * seen[axis];
                row[3 + axis] += share * turned[axis];
            }
            row[6] -= share * away_m.normalize_or_zero().dot(normal);
        }
        let turned = back.transform_point(point.world_m).cross(in_body);
        for axis in 0..3 {
            row[7 + 6 * turn + axis] += share * in_body[axis];
            row[10 + 6 * turn + axis] += share * turned[axis];
        }
    };
    // moving the point by what is missing brings the residual to zero
    one(point.is_first, point.turn, -1.0);
    for (turn, share) in of_turn.iter().enumerate().take(stands.len()) {
        if *share > 0.0 {
            one(of_first, turn, *share);
        }
    }
}

fn add(sums: &mut DMatrix<f64>, right: &mut DVector<f64>, row: &[f64], residual_m: f64, weight: f64) {
    let size = row.len();
    for (a, value) in row.iter().enumerate().filter(|(_, value)| **value != 0.0) {
        let weighted = weight * value;
        right[a] += weighted * residual_m;
        let column = &mut sums.as_mut_slice()[a * size..(a + 1) * size];
        column.iter_mut().zip(row).for_each(|(sum, other)| *sum += weighted * other);
    }
}
