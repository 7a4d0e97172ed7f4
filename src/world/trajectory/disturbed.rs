//! How far an estimated trajectory may be off: slowly, as drift and not as noise.

use glam::{DQuat, DVec3};

use super::Trajectory;
use crate::base::geometry::Pose;
use crate::base::rng::Rng;

/// Time between the poses of a disturbed trajectory, ns.
const STEP_NS: u64 = 50_000_000;

/// Error of an estimated pose, in axes of the body, each axis an autoregressive process of the first order.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct PoseError {
    /// Standard deviation along each axis, m.
    pub position_sd_m: f64,
    /// Standard deviation about each axis, rad.
    pub rotation_sd_rad: f64,
    /// Time in which an error is forgotten to 1/e, s.
    pub correlation_s: f64,
}

impl Default for PoseError {
    /// What indoor SLAM is assumed to reach: 2 cm, 0.1 deg, over 2 s.
    fn default() -> Self {
        Self { position_sd_m: 0.02, rotation_sd_rad: 0.1_f64.to_radians(), correlation_s: 2.0 }
    }
}

impl PoseError {
    /// What is left of an error after a time, 0 to 1.
    pub(crate) fn correlation(&self, seconds: f64) -> f64 {
        (-seconds / self.correlation_s).exp()
    }

    /// One trajectory that the body may really have had when a trajectory was estimated.
    pub fn disturb(&self, trajectory: &Trajectory, seed: u64) -> Trajectory {
        let [start_ns, end_ns] = trajectory.time_span_ns();
        self.disturb_at_steps(trajectory, seed, (start_ns..end_ns).step_by(STEP_NS as usize).collect())
    }

    /// The same for a trajectory that is used at some times only, in ascending order: what it takes grows with their number
    /// and not with the time between them, which a clock that was set makes months.
    pub(crate) fn disturb_near(
        &self,
        trajectory: &Trajectory,
        seed: u64,
        used_ns: impl IntoIterator<Item = u64>,
    ) -> Trajectory {
        let [start_ns, end_ns] = trajectory.time_span_ns();
        let mut steps: Vec<u64> = Vec::new();
        for used_ns in used_ns.into_iter().filter(|used_ns| (start_ns..=end_ns).contains(used_ns)) {
            // one more to each side: a pose lies on the line between two steps
            let step = (used_ns - start_ns) / STEP_NS;
            let first = step.saturating_sub(1).max(steps.last().map_or(0, |last| last + 1));
            steps.extend(first..=step + 2);
        }
        let times_ns = steps.into_iter().map(|step| start_ns + step * STEP_NS);
        let times_ns = times_ns.filter(|time_ns| *time_ns < end_ns).collect();
        self.disturb_at_steps(trajectory, seed, times_ns)
    }

    fn disturb_at_steps(&self, trajectory: &Trajectory, seed: u64, mut times_ns: Vec<u64>) -> Trajectory {
        let mut rng = Rng::new(seed, 0x706f_7365);
        let [start_ns, end_ns] = trajectory.time_span_ns();
        times_ns.push(end_ns);
        // where it turns between the steps it must go on turning
        times_ns.extend(trajectory.stamped().map(|(time_ns, _)| time_ns));
        times_ns.sort_unstable();
        times_ns.dedup();
        let mut error = [0.0; 6].map(|_| rng.normal());
        let mut last_ns = start_ns;
        let stamped = times_ns.into_iter().filter_map(|time_ns| {
            let correlation = self.correlation((time_ns - last_ns) as f64 * 1e-9);
            let fresh = (1.0 - correlation * correlation).sqrt();
            if time_ns > last_ns {
                error = error.map(|value| correlation * value + fresh * rng.normal());
            }
            last_ns = time_ns;
            let off_m = self.position_sd_m * DVec3::new(error[0], error[1], error[2]);
            let turn = self.rotation_sd_rad * DVec3::new(error[3], error[4], error[5]);
            Some((time_ns, trajectory.at(time_ns)? * Pose::new(DQuat::from_scaled_axis(turn), off_m)))
        });
        let stamped: Vec<_> = stamped.collect();
        Trajectory::new(stamped).unwrap_or_else(|_| trajectory.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_error_has_the_size_and_the_memory_it_says() {
        let walk = Trajectory::straight(DVec3::ZERO, DVec3::new(2000.0, 0.0, 0.0), 1.0, 5);
        let error = PoseError::default();
        let other = error.disturb(&walk, 3);
        assert_eq!(other.time_span_ns(), walk.time_span_ns());
        let off = |time_ns: u64| {
            let off = walk.at(time_ns).unwrap().inverse() * other.at(time_ns).unwrap();
            (off.translation_m.y, off.rotation.to_scaled_axis().x)
        };
        let times: Vec<u64> = (0..19_000).map(|n| 5 + n * 100_000_000).collect();
        let mean =
            |value: &dyn Fn(u64) -> f64| times.iter().map(|t| value(*t)).sum::<f64>() / times.len() as f64;
        let sd_m = mean(&|t| off(t).0.powi(2)).sqrt();
        let sd_rad = mean(&|t| off(t).1.powi(2)).sqrt();
        // 500 independent stretches: 4 standard deviations are 13 %
        assert!((sd_m / 0.02 - 1.0).abs() < 0.13, "{sd_m}");
        assert!((sd_rad.to_degrees() / 0.1 - 1.0).abs() < 0.13, "{sd_rad}");
        let after_2_s = mean(&|t| off(t).0 * off(t + 2_000_000_000).0) / sd_m.powi(2);
        assert!((after_2_s - (-1.0_f64).exp()).abs() < 0.13, "{after_2_s}");
        assert_eq!(error.disturb(&walk, 3), other);
        assert_ne!(error.disturb(&walk, 4), other);
        assert_eq!(
            error.disturb_near(&walk, 3, (0..20_000).map(|n| 5 + n * 100_000_000)),
            other,
            "used all along"
        );
    }

    /// 100 days at 50 ms would be 173 million poses.
    #[test]
    fn time_that_is_not_used_costs_nothing() {
        let day_ns = 86_400_000_000_000;
        let still = Trajectory::new(vec![(7, Pose::IDENTITY), (100 * day_ns, Pose::IDENTITY)]).unwrap();
        let used_ns =
            || [0, 99 * day_ns].into_iter().flat_map(|at| (1..40).map(move |n| at + n * 100_000_000));
        let other = PoseError::default().disturb_near(&still, 3, used_ns());
        assert!(other.stamped().count() < 200, "{}", other.stamped().count());
        let off_m = |time_ns| other.at(time_ns).unwrap().translation_m.length();
        assert!(used_ns().all(|at| (1e-4..0.2).contains(&off_m(at))));
    }
}
