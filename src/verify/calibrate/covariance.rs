//! How far the estimates would scatter if the walk were repeated.
//!
//! The estimate moves by `inverse * sum of scores`. A revolution's score varies as the scores of the others show
//! (sandwich estimator with one cluster per revolution, doi:10.1016/S0304-4076(02)00222-2 among others). The pose errors
//! of different revolutions hang together over seconds, which a walk of seconds cannot show: their part follows from
//! the model of the pose error, as a score moves by `B (C + prior)^-1 prior` times the pose error.

use nalgebra::{DMatrix, DVector, SMatrix};

use super::gather::Scan;
use super::solve::{Solution, Sums, prior};
use crate::world::trajectory::PoseError;

/// Revolutions from which on their own scatter is believed.
const LEAST_SCANS: usize = 12;

/// Of all unknowns, seven per sensor.
pub(crate) fn covariance(scans: &[Scan], solution: &Solution, pose: &PoseError) -> DMatrix<f64> {
    let unknowns = solution.step.len();
    let prior = prior(pose);
    let pose_covariance = prior.map(|value| if value > 0.0 { 1.0 / value } else { 0.0 });
    // what one revolution's score gains per unit of pose error
    let leaks: Vec<DMatrix<f64>> = solution.sums.iter().map(|sums| leak(sums, &prior, unknowns)).collect();
    let leaked = |from: &DMatrix<f64>, to: &DMatrix<f64>| from * pose_covariance * to.transpose();

    let mut alone = DMatrix::zeros(unknowns, unknowns);
    if solution.sums.len() >= LEAST_SCANS {
        for sums in &solution.sums {
            let score: DVector<f64> = sums.score(&solution.step);
            alone.ger(1.0, &score, &score, 1.0);
        }
        let count = solution.sums.len() as f64;
        let own = solution.from_observable.ncols() as f64 / solution.observed.len().max(1) as f64;
        alone *= count / (count - own).max(1.0);
    } else {
        alone += information(solution, unknowns);
        for leak in &leaks {
            alone += leaked(leak, leak);
        }
    }
    // what is remembered from all revolutions before, fading
    let mut memory = DMatrix::zeros(unknowns, 6);
    let mut together = DMatrix::zeros(unknowns, unknowns);
    for (place, leak) in leaks.iter().enumerate() {
        if place > 0 {
            let passed_s = scans[place].time_s - scans[place - 1].time_s;
            memory = (memory + &leaks[place - 1]) * pose.correlation(passed_s);
            let cross = leaked(leak, &memory);
            together += &cross + cross.transpose();
        }
    }
    let observable_part = |matrix: DMatrix<f64>| {
        let inside = solution.from_observable.transpose() * matrix * &solution.from_observable;
        let spread = &solution.inverse * inside * &solution.inverse;
        &solution.from_observable * spread * solution.from_observable.transpose()
    };
    observable_part(alone + together)
}

fn leak(sums: &Sums, prior: &SMatrix<f64, 6, 6>, unknowns: usize) -> DMatrix<f64> {
    let mut leak = DMatrix::zeros(unknowns, 6);
    for sensor in 0..sums.of_sensor.len() {
        let part = sums.gain(sensor) * prior;
        leak.fixed_view_mut::<7, 6>(7 * sensor, 0).copy_from(&part);
    }
    leak
}

/// Formal information about the unknowns, poses eliminated: the scatter of scores by independent noise.
fn information(solution: &Solution, unknowns: usize) -> DMatrix<f64> {
    let mut sum = DMatrix::zeros(unknowns, unknowns);
    for sums in &solution.sums {
        for (sensor, (own, _, _)) in sums.of_sensor.iter().enumerate() {
            let mut block = sum.fixed_view_mut::<7, 7>(7 * sensor, 7 * sensor);
            block += own;
        }
    }
    sum
}
