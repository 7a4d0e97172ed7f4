//! One robust least-squares step for all mounts, the poses of the revolutions eliminated.

use nalgebra::{Cholesky, DMatrix, DVector, SMatrix, SVector};
use rayon::prelude::*;

use super::gather::{Row, Scan};
use super::observed::Observed;
use crate::base::statistics::robust_deviation;
use crate::world::trajectory::PoseError;

/// Residuals beyond so many standard deviations count less (Huber 1964, doi:10.1214/aoms/1177703732).
const HUBER: f64 = 2.5;
/// Times the weights are computed again in one step.
const REWEIGHTINGS: usize = 4;
/// Least standard deviation that weights are made with, m: ranges come in millimetres.
pub const LEAST_SCALE_M: f64 = 5e-4;

type Block77 = SMatrix<f64, 7, 7>;
type Block76 = SMatrix<f64, 7, 6>;
type Block66 = SMatrix<f64, 6, 6>;
type Column7 = SVector<f64, 7>;
type Column6 = SVector<f64, 6>;

/// Sums over one revolution.
#[derive(Clone)]
pub struct Sums {
    /// By sensor: mount with mount, mount with pose, mount with residual.
    pub of_sensor: Vec<(Block77, Block76, Column7)>,
    /// Pose with pose and its prior, inverted.
    pub pose_inverse: Block66,
    /// Pose with residual.
    pub of_pose: Column6,
}

/// A step and what it was made of.
pub struct Solution {
    /// Seven numbers per sensor.
    pub step: Vec<f64>,
    /// Length of the step in formal standard deviations.
    pub step_size: f64,
    /// By sensor.
    pub observed: Vec<Observed>,
    /// Robust standard deviation of a residual, m.
    pub scale_m: f64,
    /// Of the pose errors, by part of a revolution.
    pub poses: Vec<[f64; 6]>,
    /// Of every part of a revolution, with the last weights.
    pub sums: Vec<Sums>,
    /// Unknowns of all sensors from the observable directions.
    pub from_observable: DMatrix<f64>,
    /// Inverse of the information about those.
    pub inverse: DMatrix<f64>,
}

/// Solves; none when no direction of any sensor is observable. `known` are the pose errors from which the rays were cast.
pub(crate) fn solve(
    scans: &[Scan],
    sensors: usize,
    pose: &PoseError,
    known: &[[f64; 6]],
) -> Option<Solution> {
    let observed = observed(scans, sensors);
    let from_observable = basis(&observed);
    if from_observable.ncols() == 0 {
        return None;
    }
    let prior = prior(pose);
    let (mut scale_m, mut step_size) = (0.0, 0.0);
    let mut step = DVector::zeros(7 * sensors);
    let mut poses = vec![Column6::zeros(); scans.len()];
    let mut outcome = None;
    for reweighting in 0..REWEIGHTINGS {
        let residual = |scan: usize, row: &Row| left_over(row, step.as_slice(), &poses[scan]);
        scale_m = spread(scans, &residual).max(LEAST_SCALE_M);
        let weight = |scan: usize, row: &Row| {
            let off = residual(scan, row).abs() / scale_m;
            // nothing is known before the first step
            let huber = if reweighting == 0 || off <= HUBER { 1.0 } else { HUBER / off };
            huber / (scale_m * scale_m)
        };
        let sums: Vec<Sums> = scans
            .par_iter()
            .enumerate()
            .map(|(place, scan)| {
                let known = Column6::from(known[place]);
                sum(&scan.rows, sensors, &prior, &known, |row| weight(place, row))
            })
            .collect();
        let (information, right) = reduced(&sums, sensors);
        let information = from_observable.transpose() * information * &from_observable;
        let inverse = Cholesky::new(information)?.inverse();
        let right = from_observable.transpose() * right;
        let reduced = &inverse * &right;
        step_size = reduced.dot(&right).max(0.0).sqrt();
        step = &from_observable * reduced;
        poses = sums.iter().map(|sums| sums.pose(&step)).collect();
        outcome = Some((sums, inverse));
    }
    let (sums, inverse) = outcome?;
    let poses = poses.iter().map(|pose| std::array::from_fn(|place| pose[place])).collect();
    let step = step.as_slice().to_vec();
    Some(Solution { step, step_size, observed, scale_m, poses, sums, from_observable, inverse })
}

/// Information that the prior has about a pose error.
pub(crate) fn prior(pose: &PoseError) -> Block66 {
    let position = pose.position_sd_m.max(1e-6).powi(-2);
    let rotation = pose.rotation_sd_rad.max(1e-7).powi(-2);
    Block66::from_diagonal(&Column6::from([position, position, position, rotation, rotation, rotation]))
}

impl Sums {
    /// What the pose takes away: `B (C + prior)^-1` of a sensor.
    pub(crate) fn gain(&self, sensor: usize) -> Block76 {
        self.of_sensor[sensor].1 * self.pose_inverse
    }

    fn pose(&self, step: &DVector<f64>) -> Column6 {
        let mut right = self.of_pose;
        for (sensor, (_, cross, _)) in self.of_sensor.iter().enumerate() {
            right -= cross.transpose() * step.fixed_rows::<7>(7 * sensor);
        }
        self.pose_inverse * right
    }

    /// What one revolution says about the unknowns when its pose is free, at the given step: zero in the sum.
    pub(crate) fn score(&self, step: &[f64]) -> DVector<f64> {
        let sensors = self.of_sensor.len();
        let step = DVector::from_row_slice(step);
        let mut pose = self.of_pose;
        for (sensor, (_, cross, _)) in self.of_sensor.iter().enumerate() {
            pose -= cross.transpose() * step.fixed_rows::<7>(7 * sensor);
        }
        let mut score = DVector::zeros(7 * sensors);
        for (sensor, (own, _, right)) in self.of_sensor.iter().enumerate() {
            let part = right - own * step.fixed_rows::<7>(7 * sensor) - self.gain(sensor) * pose;
            score.fixed_rows_mut::<7>(7 * sensor).copy_from(&part);
        }
        score
    }
}

fn sum(rows: &[Row], sensors: usize, prior: &Block66, known: &Column6, weight: impl Fn(&Row) -> f64) -> Sums {
    let mut of_sensor = vec![(Block77::zeros(), Block76::zeros(), Column7::zeros()); sensors];
    // the prior pulls at the whole error, of which a part is known
    let (mut pose, mut of_pose) = (*prior, -(prior * known));
    for row in rows {
        let weight = weight(row);
        let (j, p) = (Column7::from(row.of_mount), Column6::from(row.of_pose));
        let (own, cross, right) = &mut of_sensor[row.sensor];
        own.ger(weight, &j, &j, 1.0);
        cross.ger(weight, &j, &p, 1.0);
        *right += j * (weight * row.residual_m);
        pose.ger(weight, &p, &p, 1.0);
        of_pose += p * (weight * row.residual_m);
    }
    // positive definite by its prior
    let pose_inverse = Cholesky::new(pose).map_or_else(Block66::zeros, |cholesky| cholesky.inverse());
    Sums { of_sensor, pose_inverse, of_pose }
}

fn reduced(sums: &[Sums], sensors: usize) -> (DMatrix<f64>, DVector<f64>) {
    let mut information = DMatrix::zeros(7 * sensors, 7 * sensors);
    let mut right = DVector::zeros(7 * sensors);
    for scan in sums {
        for (first, (own, _, own_right)) in scan.of_sensor.iter().enumerate() {
            let gain = scan.gain(first);
            let mut part = right.fixed_rows_mut::<7>(7 * first);
            part += own_right - gain * scan.of_pose;
            let mut block = information.fixed_view_mut::<7, 7>(7 * first, 7 * first);
            block += own;
            for (second, (_, cross, _)) in scan.of_sensor.iter().enumerate() {
                let mut block = information.fixed_view_mut::<7, 7>(7 * first, 7 * second);
                block -= gain * cross.transpose();
            }
        }
    }
    (information, right)
}

fn left_over(row: &Row, step: &[f64], pose: &Column6) -> f64 {
    let step = &step[7 * row.sensor..7 * row.sensor + 7];
    let of_mount: f64 = row.of_mount.iter().zip(step).map(|(a, b)| a * b).sum();
    let of_pose: f64 = row.of_pose.iter().zip(pose.iter()).map(|(a, b)| a * b).sum();
    row.residual_m - of_mount - of_pose
}

fn spread(scans: &[Scan], residual: &(impl Fn(usize, &Row) -> f64 + Sync)) -> f64 {
    let sizes = scans
        .par_iter()
        .enumerate()
        .flat_map_iter(|(place, scan)| scan.rows.iter().map(move |row| residual(place, row).abs()));
    robust_deviation(&mut sizes.collect::<Vec<f64>>()).unwrap_or(0.0)
}

fn observed(scans: &[Scan], sensors: usize) -> Vec<Observed> {
    let mut sums = vec![(Block77::zeros(), 0.0, 0.0); sensors];
    for row in scans.iter().flat_map(|scan| &scan.rows) {
        let j = Column7::from(row.of_mount);
        let (sum, rays, squares) = &mut sums[row.sensor];
        sum.ger(1.0, &j, &j, 1.0);
        *rays += 1.0;
        *squares += row.of_mount[3..6].iter().map(|part| part * part).sum::<f64>();
    }
    sums.iter()
        .map(|(sum, rays, squares)| Observed::of(sum, *rays, (squares / rays.max(1.0)).sqrt()))
        .collect()
}

fn basis(observed: &[Observed]) -> DMatrix<f64> {
    let columns: usize = observed.iter().map(|sensor| sensor.basis.len()).sum();
    let mut basis = DMatrix::zeros(7 * observed.len(), columns);
    let mut column = 0;
    for (sensor, observed) in observed.iter().enumerate() {
        for direction in &observed.basis {
            for (unknown, part) in direction.iter().enumerate() {
                basis[(7 * sensor + unknown, column)] = *part;
            }
            column += 1;
        }
    }
    basis
}
