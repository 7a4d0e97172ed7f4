//! How far the clock of a recording stands from that of its trajectory: at the right offset the recorded rays end where
//! the scene is.
//!
//! Every ray is cast from where the body was at its time and some offset; what it is off by counts
//! `r^2 / (r^2 + c^2)`, so that a few rays on something that moved say little. The least of it is looked for on a grid,
//! and then between its points by a parabola. Its standard deviation is that of the jackknife over parts of the recording
//! (Efron and Tibshirani 1993, chapter 11): residuals of one part hang together, those of distant parts hardly.

use rayon::prelude::*;

use super::nulls::Field;

/// Rays that are cast at every offset.
const RAYS: usize = 6000;
/// Fewer say nothing.
const LEAST_RAYS: usize = 300;
/// Residual that counts half, m.
const HALF_M: f64 = 0.1;
/// Step of the grid, and half the width of the parabola, ns.
const STEP_NS: i64 = 20_000_000;
const NEAR_NS: i64 = 8_000_000;
/// Points of the parabola to each side.
const NEAR_POINTS: i64 = 4;
/// Parts of the recording.
const PARTS: usize = 10;
/// The least cost must lie this far below the usual one on the grid, as a share of it: a rig that stands fits everywhere.
const LEAST_DIP: f64 = 0.1;
/// Offsets at which fewer of the rays lie within the trajectory's time are not compared.
const LEAST_PLACED: f64 = 0.5;

/// What is added to the recording's times to get those of the trajectory.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct TimeOffset {
    /// Best value, s.
    pub seconds: f64,
    /// Its standard deviation, s.
    pub sd_s: f64,
    /// Half of its 95 % interval, s.
    pub u95_s: f64,
    /// Rays that were cast.
    pub rays: usize,
}

/// Why there is none.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NoTimeOffset {
    /// Too few returns.
    #[error(
        "cannot tell the time offset: {rays} returns lie within reach of the trajectory, at least {LEAST_RAYS} are needed"
    )]
    TooFew {
        /// Usable returns.
        rays: usize,
    },
    /// One offset is as good as another.
    #[error(
        "cannot tell the time offset: the recording fits the scene no better at one than at others (does the rig move?)"
    )]
    Flat,
    /// The best is the last that was tried.
    #[error(
        "cannot tell the time offset: the best one tried, {seconds:.2} s, is at the end of the search (--time-offset takes seconds, or start)"
    )]
    AtTheEnd {
        /// That one, s.
        seconds: f64,
    },
}

/// Looks for it within `reach_ns` to each side of `around_ns`. The rays bear the recording's own times.
///
/// # Errors
/// Nothing that stands out.
pub fn time_offset(field: &Field<'_>, around_ns: i64, reach_ns: i64) -> Result<TimeOffset, NoTimeOffset> {
    let returned: Vec<_> = field.rays.iter().filter(|ray| ray.range_m.is_some()).copied().collect();
    let every = returned.len().div_ceil(RAYS).max(1);
    let rays: Vec<_> = returned.into_iter().step_by(every).collect();
    let field = Field { rays: &rays, ..*field };
    let steps = (reach_ns / STEP_NS).max(1);
    let grid: Vec<(i64, Cost)> = (-steps..=steps)
        .map(|step| around_ns + step * STEP_NS)
        .map(|offset_ns| (offset_ns, Cost::sum(&costs(&field, offset_ns))))
        .filter(|(_, cost)| cost.rays >= LEAST_PLACED * rays.len() as f64)
        .collect();
    let best = grid.iter().enumerate().min_by(|a, b| a.1.1.mean().total_cmp(&b.1.1.mean()));
    let Some((place, (best_ns, least))) = best.filter(|_| rays.len() >= LEAST_RAYS) else {
        return Err(NoTimeOffset::TooFew { rays: if grid.is_empty() { 0 } else { rays.len() } });
    };
    let usual = crate::base::statistics::quantile(
        &crate::base::statistics::sorted(grid.iter().map(|at| at.1.mean())),
        0.5,
    );
    if least.mean() > (1.0 - LEAST_DIP) * usual {
        return Err(NoTimeOffset::Flat);
    }
    if place == 0 || place + 1 == grid.len() {
        return Err(NoTimeOffset::AtTheEnd { seconds: *best_ns as f64 * 1e-9 });
    }
    near(&field, *best_ns)
}

/// Finer and finer around the best point of the grid.
fn near(field: &Field<'_>, best_ns: i64) -> Result<TimeOffset, NoTimeOffset> {
    let mut middle_ns = best_ns;
    for step_ns in [STEP_NS / 4, NEAR_NS / NEAR_POINTS] {
        let around = (-NEAR_POINTS..=NEAR_POINTS).map(|step| middle_ns + step * step_ns);
        let cost = |offset_ns: i64| Cost::sum(&costs(field, offset_ns)).mean();
        let tried: Vec<(i64, f64)> = around.map(|offset_ns| (offset_ns, cost(offset_ns))).collect();
        middle_ns = tried.iter().min_by(|a, b| a.1.total_cmp(&b.1)).map_or(middle_ns, |least| least.0);
    }
    let at_ns: Vec<i64> = (-NEAR_POINTS..=NEAR_POINTS).map(|step| step * NEAR_NS / NEAR_POINTS).collect();
    let by_part: Vec<Vec<Cost>> = at_ns.iter().map(|at| costs(field, middle_ns + at)).collect();
    let least_without = |left_out: Option<usize>| {
        let cost = |parts: &Vec<Cost>| {
            let used = parts.iter().enumerate().filter(|(part, _)| Some(*part) != left_out);
            Cost::sum(&used.map(|(_, cost)| *cost).collect::<Vec<_>>()).mean()
        };
        lowest(&by_part.iter().map(cost).collect::<Vec<_>>())
    };
    let width_s = NEAR_NS as f64 * 1e-9;
    let whole = least_without(None).ok_or(NoTimeOffset::Flat)?;
    let left_out: Option<Vec<f64>> = (0..PARTS).map(|part| least_without(Some(part))).collect();
    let left_out = left_out.ok_or(NoTimeOffset::Flat)?;
    let mean = left_out.iter().sum::<f64>() / PARTS as f64;
    let squares: f64 = left_out.iter().map(|value| (value - mean).powi(2)).sum();
    let sd_s = width_s * (squares * (PARTS as f64 - 1.0) / PARTS as f64).sqrt();
    Ok(TimeOffset {
        seconds: middle_ns as f64 * 1e-9 + width_s * whole,
        sd_s,
        u95_s: 2.262 * sd_s, // Student's t of nine degrees of freedom
        rays: field.rays.len(),
    })
}

/// Place of the lowest point of the parabola through values at even places from -1 to 1; none where it opens downward or
/// lies outside.
fn lowest(values: &[f64]) -> Option<f64> {
    let last = values.len() as f64 - 1.0;
    let places = (0..values.len()).map(|n| 2.0 * n as f64 / last - 1.0);
    // places are symmetric: slope and curvature separate
    let (mut s2, mut s4, mut y0, mut y1, mut y2) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for (x, y) in places.zip(values) {
        s2 += x * x;
        s4 += x * x * x * x;
        y0 += y;
        y1 += x * y;
        y2 += x * x * y;
    }
    let count = values.len() as f64;
    let slope = y1 / s2;
    let curvature = (count * y2 - s2 * y0) / (count * s4 - s2 * s2);
    let at = -slope / (2.0 * curvature);
    (curvature > 0.0 && at.abs() <= 1.5).then_some(at)
}

/// Sum over rays.
#[derive(Clone, Copy, Debug, Default)]
struct Cost {
    sum: f64,
    rays: f64,
}

impl Cost {
    fn sum(parts: &[Self]) -> Self {
        parts
            .iter()
            .fold(Self::default(), |all, part| Self { sum: all.sum + part.sum, rays: all.rays + part.rays })
    }

    fn mean(&self) -> f64 {
        if self.rays > 0.0 { self.sum / self.rays } else { f64::INFINITY }
    }
}

/// By part of the recording.
fn costs(field: &Field<'_>, offset_ns: i64) -> Vec<Cost> {
    let part = field.rays.len().div_ceil(PARTS).max(1);
    let mut costs: Vec<Cost> = field
        .rays
        .par_chunks(part)
        .map(|rays| {
            let each = rays.iter().filter_map(|ray| {
                let time_ns = ray.time_ns.checked_add_signed(offset_ns)?;
                let placed = ray.place_on(field.sensors, field.trajectory, time_ns)?;
                let met = placed.cast(field.scene, &field.sensors[ray.sensor]);
                let Some((predicted_m, _)) = met else { return Some(1.0) };
                let off_m2 = (ray.range_m? - predicted_m).powi(2);
                Some(off_m2 / (off_m2 + HALF_M * HALF_M))
            });
            each.fold(Cost::default(), |all, cost| Cost { sum: all.sum + cost, rays: all.rays + 1.0 })
        })
        .collect();
    costs.resize(PARTS, Cost::default());
    costs
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3};

    use super::super::RecordedRay;
    use super::*;
    use crate::base::geometry::Pose;
    use crate::base::rng::Rng;
    use crate::rig::{Mount, MountedSensor};
    use crate::world::scene::{BoxScene, Scene};
    use crate::world::trajectory::Trajectory;

    /// What is found when the clock of the recording is `late_s` behind that of a walk with this speed and turning.
    fn found(speed_m_s: f64, swing_rad: f64, late_s: f64) -> Result<TimeOffset, NoTimeOffset> {
        let scene = Scene::Box(BoxScene::closed(DVec3::new(-4.0, -3.0, 0.0), DVec3::new(5.0, 3.5, 3.0)));
        let pose = |n: u64| {
            let seconds = n as f64 * 0.01;
            let at = DVec3::new(speed_m_s * seconds - 2.0, 0.2, 1.4);
            (
                10_000_000_000 + n * 10_000_000,
                Pose::new(DQuat::from_rotation_z(swing_rad * (2.0 * seconds).sin()), at),
            )
        };
        let trajectory = Trajectory::new((0..400).map(pose).collect()).unwrap();
        let model = sensors::catalogue::nominal("vlp-16").unwrap();
        let mount = Mount { pitch_rad: 0.5, ..Mount::default() };
        let sensors = [MountedSensor { name: "only".into(), model, mount }];
        let mut rng = Rng::new(11, 0);
        let rays: Vec<RecordedRay> = (0..4000_u64)
            .map(|n| {
                let true_ns = 10_500_000_000 + n * 700_000;
                let mut ray = RecordedRay {
                    sensor: 0,
                    channel: rng.below(16) as usize,
                    time_ns: true_ns,
                    azimuth_rad: rng.between(0.0, std::f64::consts::TAU),
                    pitch_rad: 0.5,
                    range_m: None,
                };
                let world_from_sensor = trajectory.at(true_ns).unwrap() * mount.body_from_sensor();
                let met = ray.place(&sensors, &world_from_sensor).cast(&scene, &sensors[0]);
                ray.range_m = met.map(|(range_m, _)| range_m + 0.01 * rng.normal());
                ray.time_ns = (true_ns as i64 - (late_s * 1e9) as i64) as u64;
                ray
            })
            .collect();
        let field = Field {
            scene: &scene,
            trajectory: &trajectory,
            sensors: &sensors,
            rays: &rays,
            agree_within_m: 0.1,
        };
        time_offset(&field, 0, 1_000_000_000)
    }

    #[test]
    fn an_offset_is_found_as_well_as_is_stated() {
        for late_s in [0.0, 0.037, -0.412] {
            let found_offset = found(0.8, 0.6, late_s).unwrap();
            let off_s = (found_offset.seconds - late_s).abs();
            assert!(
                off_s < 0.002 && off_s < 4.0 * found_offset.sd_s + 1e-4 && found_offset.sd_s < 0.002,
                "{late_s}: {found_offset:?}"
            );
        }
    }

    #[test]
    fn a_rig_that_stands_tells_no_offset() {
        assert_eq!(found(0.0, 0.0, 0.1), Err(NoTimeOffset::Flat));
        assert!(matches!(found(0.8, 0.6, 0.995), Err(NoTimeOffset::AtTheEnd { .. })));
    }

    #[test]
    fn the_lowest_point_of_a_parabola() {
        let values: Vec<f64> = (-4..=4).map(|n| (f64::from(n) / 4.0 - 0.3).powi(2) * 2.0 + 5.0).collect();
        assert!((lowest(&values).unwrap() - 0.3).abs() < 1e-12);
        assert_eq!(lowest(&values.iter().map(|value| -value).collect::<Vec<_>>()), None);
    }
}
