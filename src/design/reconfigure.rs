//! Better pitches for the place seen so far: a search over the angles of the axes alone, by what the sensors would see
//! of a map made from their own recording.
//!
//! A cell counts once, however often it is seen, from any pose so far: cells of known surface that a ray
//! meets, and unseen cells next to known surface where a ray meets none, for surface goes on where it was
//! not seen to end (Border, Gammell, Newman 2018, "Surface Edge Explorer", doi:10.1109/ICRA.2018.8461098).

use std::collections::HashSet;
use std::convert::Infallible;
use std::f64::consts::TAU;
use std::sync::atomic::AtomicBool;

use glam::DVec3;
use sensors::SensorModel;

use crate::base::geometry::Pose;
use crate::design::optimize::{Kind, Measured, Search, SearchError, Settings, Space, SpaceError, Variable};
use crate::rig::{Mount, Rig};
use crate::world::scene::{Sight, VoxelMap};

/// Columns of a revolution that are looked along.
const COLUMNS: usize = 180;
/// Beams of a sensor that are looked along, at most; evenly chosen.
const BEAMS: usize = 32;
/// Most poses of the trajectory to look from; evenly chosen.
const POSES: usize = 12;
/// Pitches are proposed in steps of this, degrees: finer than any servo's play, coarse enough to be read out.
const STEP_DEG: f64 = 0.1;

/// What is known: the map, the trajectory, the rig.
#[derive(Clone)]
pub struct Question<'a> {
    /// Made of what was recorded.
    pub map: &'a VoxelMap,
    /// World from body, along the trajectory so far.
    pub poses: &'a [Pose],
    /// Sensors in the order of the axes, at their present pitches.
    pub rig: &'a Rig,
    /// Minimum and maximum pitch of each axis, rad.
    pub limits_rad: &'a [[f64; 2]],
    /// Pairs of pitches that the rig refuses, rad.
    pub is_excluded: &'a (dyn Fn(&[f64]) -> bool + Sync),
}

/// What a set of pitches sees of a map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct PredictedCoverage {
    /// Cells of known surface.
    pub surface: u64,
    /// Unseen cells next to known surface.
    pub frontier: u64,
}

impl PredictedCoverage {
    /// What is counted.
    pub(crate) fn score(&self) -> u64 {
        self.surface + self.frontier
    }
}

/// An answer.
#[derive(Clone, Debug, PartialEq)]
pub struct Answer {
    /// The best pitches found, rad; the present ones where none are better.
    pub pitches_rad: Vec<f64>,
    /// What they see.
    pub best: PredictedCoverage,
    /// What the present ones see.
    pub now: PredictedCoverage,
    /// Sets of pitches that were looked at.
    pub evaluations: usize,
}

/// Why there is no answer.
#[derive(Debug, thiserror::Error)]
pub enum ReconfigureError {
    /// The map has no surface, or the trajectory no pose.
    #[error("no surface has been mapped yet: let the sensors look around first")]
    NothingSeen,
    /// No sensors, or not one pair of limits for each.
    #[error("{sensors} sensors on axes with {limits} pairs of limits")]
    Axes {
        /// Sensors of the rig.
        sensors: usize,
        /// Pairs of limits.
        limits: usize,
    },
    /// Limits that leave nothing.
    #[error(transparent)]
    Space(#[from] SpaceError),
    /// The search failed.
    #[error(transparent)]
    Search(#[from] SearchError),
}

/// What a rig at these pitches, rad, sees of the map along the trajectory.
pub(crate) fn predicted_coverage(question: &Question<'_>, pitches_rad: &[f64]) -> PredictedCoverage {
    let mut seen: [HashSet<[i32; 3]>; 2] = Default::default();
    let poses = evenly(question.poses, POSES);
    for (sensor, pitch_rad) in question.rig.sensors.iter().zip(pitches_rad) {
        let body_from_sensor = Mount { pitch_rad: *pitch_rad, ..sensor.mount }.body_from_sensor();
        let sights_m = sights_m(&sensor.model);
        for world_from_body in &poses {
            let world_from_sensor = **world_from_body * body_from_sensor;
            for ends_m in &sights_m {
                let [origin_m, end_m] = ends_m.map(|at_m| world_from_sensor.transform_point(at_m));
                let ray_m = end_m - origin_m;
                let length_m = ray_m.length();
                match question.map.look(origin_m, ray_m / length_m, length_m) {
                    Some(Sight::Surface(cell)) => seen[0].insert(cell),
                    Some(Sight::Frontier(cell)) => seen[1].insert(cell),
                    None => false,
                };
            }
        }
    }
    PredictedCoverage { surface: seen[0].len() as u64, frontier: seen[1].len() as u64 }
}

/// Both ends of what a sensor looks along, in its own frame, m.
fn sights_m(model: &SensorModel) -> Vec<[DVec3; 2]> {
    let channels: Vec<usize> = (0..model.channels()).collect();
    let sights = evenly(&channels, BEAMS).into_iter().flat_map(|channel| {
        (0..COLUMNS).map(|column| {
            let azimuth_rad = TAU * column as f64 / COLUMNS as f64;
            [model.min_range_m, model.max_range_m].map(|range_m| model.point(*channel, azimuth_rad, range_m))
        })
    });
    sights.collect()
}

/// The best pitches that so many evaluations find. The same question and seed give the same answer.
///
/// # Errors
/// There is nothing to look at, or nothing to choose from.
pub(crate) fn propose(
    question: &Question<'_>,
    seed: u64,
    evaluations: usize,
) -> Result<Answer, ReconfigureError> {
    let (sensors, limits) = (question.rig.sensors.len(), question.limits_rad.len());
    if sensors == 0 || sensors != limits {
        return Err(ReconfigureError::Axes { sensors, limits });
    }
    if question.poses.is_empty() || question.map.counts()[1] == 0 {
        return Err(ReconfigureError::NothingSeen);
    }
    let variable = |(axis, [low_rad, high_rad]): (usize, &[f64; 2])| Variable {
        name: format!("pitch of axis {axis}, deg"),
        low: low_rad.to_degrees(),
        high: high_rad.to_degrees(),
        integer: false,
        active_from: None,
        role: 0,
    };
    let space = Space::new(question.limits_rad.iter().enumerate().map(variable).collect())?;
    let mut search = Search::new(space, Kind::Staged, Settings::new(seed, evaluations));
    let measure = |pitches_deg: &[f64]| {
        let pitches_rad = stepped_rad(pitches_deg, question.limits_rad);
        let violation = violation(question, &pitches_rad);
        let score = predicted_coverage(question, &pitches_rad).score() as f64;
        let poses = question.poses.len().min(POSES);
        let rays = (poses * COLUMNS * BEAMS * sensors) as u64;
        Ok::<_, Infallible>(Measured { score, violation, rays })
    };
    search.run(evaluations, measure, |_| (), &AtomicBool::new(false))?;
    let present_rad: Vec<f64> = question.rig.sensors.iter().map(|sensor| sensor.mount.pitch_rad).collect();
    let now = predicted_coverage(question, &present_rad);
    let found = search.best().map(|trial| stepped_rad(&trial.candidate.values, question.limits_rad));
    let found = found.filter(|pitches_rad| violation(question, pitches_rad) == 0.0);
    let found = found.map(|pitches_rad| (predicted_coverage(question, &pitches_rad), pitches_rad));
    let better = found.filter(|(best, _)| best.score() > now.score());
    let (best, pitches_rad) = better.unwrap_or((now, present_rad));
    Ok(Answer { pitches_rad, best, now, evaluations: search.evaluations() })
}

/// How far from allowed, 0 where housings and rig agree.
fn violation(question: &Question<'_>, pitches_rad: &[f64]) -> f64 {
    let mut rig = question.rig.clone();
    for (sensor, pitch_rad) in rig.sensors.iter_mut().zip(pitches_rad) {
        sensor.mount.pitch_rad = *pitch_rad;
    }
    rig.housing_shortfall_m() + f64::from(u8::from((question.is_excluded)(pitches_rad)))
}

/// Rounded, and within limits all the same.
fn stepped_rad(pitches_deg: &[f64], limits_rad: &[[f64; 2]]) -> Vec<f64> {
    let stepped = pitches_deg.iter().zip(limits_rad).map(|(pitch_deg, [low_rad, high_rad])| {
        let pitch_rad = ((pitch_deg / STEP_DEG).round() * STEP_DEG).to_radians();
        pitch_rad.clamp(*low_rad, *high_rad)
    });
    stepped.collect()
}

fn evenly<T>(of: &[T], most: usize) -> Vec<&T> {
    let count = of.len().min(most);
    (0..count).map(|at| &of[at * of.len() / count]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::MountedSensor;
    use crate::world::scene::BoxScene;

    /// A hall of which a sensor that hangs aslant has seen one half only, mapped by its own rays.
    fn half_seen(pitch_rad: f64) -> (VoxelMap, Rig) {
        let hall = BoxScene::closed(DVec3::new(-6.0, -4.0, -1.0), DVec3::new(6.0, 4.0, 5.0));
        let model = sensors::catalogue::nominal("vlp-16").unwrap();
        let mount = Mount { pitch_rad, ..Mount::default() };
        let rig = Rig { sensors: vec![MountedSensor { name: "a".into(), model, mount }] };
        let mut map = VoxelMap::new(0.25, 1, 100.0).unwrap();
        let (sensor, body_from_sensor) = (&rig.sensors[0], mount.body_from_sensor());
        for channel in 0..sensor.model.channels() {
            for column in 0..900 {
                let azimuth_rad = TAU * f64::from(column) / 900.0;
                let at = |range_m| {
                    body_from_sensor.transform_point(sensor.model.point(channel, azimuth_rad, range_m))
                };
                let (origin_m, direction) = (at(0.5), (at(1.5) - at(0.5)).normalize());
                if let Some(hit) = hall.cast(origin_m, direction) {
                    map.add_return(origin_m, origin_m + hit.distance_m * direction);
                }
            }
        }
        (map, rig)
    }

    #[test]
    fn the_best_of_a_grid_is_found_and_nothing_forbidden_is_proposed() {
        let (map, rig) = half_seen(0.6);
        let limits_rad = [[-0.7, 0.7]];
        let poses = [Pose::IDENTITY];
        let free = |_: &[f64]| false;
        let mut question =
            Question { map: &map, poses: &poses, rig: &rig, limits_rad: &limits_rad, is_excluded: &free };
        let answer = propose(&question, 1, 60).unwrap();
        assert_eq!(answer, propose(&question, 1, 60).unwrap(), "the same again");
        assert_eq!(answer.now, predicted_coverage(&question, &[0.6]));
        assert_eq!(answer.best, predicted_coverage(&question, &answer.pitches_rad));
        let grid = (-70..=70).map(|at| predicted_coverage(&question, &[f64::from(at) * 0.01]).score());
        let most = grid.max().unwrap();
        assert!(answer.best.score() as f64 >= 0.98 * most as f64, "{answer:?}, a grid has {most}");
        assert!(answer.best.score() >= answer.now.score());

        let keep_out = |pitches_rad: &[f64]| (pitches_rad[0] - answer.pitches_rad[0]).abs() < 0.1;
        question.is_excluded = &keep_out;
        let elsewhere = propose(&question, 1, 60).unwrap();
        let at_rest = elsewhere.pitches_rad == [0.6];
        assert!(at_rest || !keep_out(&elsewhere.pitches_rad), "{elsewhere:?}");
    }

    #[test]
    fn two_that_see_the_same_are_spread() {
        let (map, mut rig) = half_seen(0.5);
        rig.sensors.push(MountedSensor { name: "b".into(), ..rig.sensors[0].clone() });
        rig.sensors[1].mount.x_m = 0.4;
        let (free, poses, limits_rad) = (|_: &[f64]| false, [Pose::IDENTITY], [[-0.7, 0.7]; 2]);
        let question =
            Question { map: &map, poses: &poses, rig: &rig, limits_rad: &limits_rad, is_excluded: &free };
        let answer = propose(&question, 1, 60).unwrap();
        assert!(answer.best.score() as f64 > 1.05 * answer.now.score() as f64, "{answer:?}");
        assert!((answer.pitches_rad[0] - answer.pitches_rad[1]).abs() > 0.02, "{answer:?}");
    }

    #[test]
    fn questions_without_an_answer_are_refused() {
        let (_, rig) = half_seen(0.0);
        let empty = VoxelMap::new(0.25, 1, 100.0).unwrap();
        let free = |_: &[f64]| false;
        let (poses, limits_rad) = ([Pose::IDENTITY], [[-0.5, 0.5]]);
        let mut question =
            Question { map: &empty, poses: &poses, rig: &rig, limits_rad: &limits_rad, is_excluded: &free };
        assert!(matches!(propose(&question, 1, 5), Err(ReconfigureError::NothingSeen)));
        question.limits_rad = &[];
        assert!(matches!(propose(&question, 1, 5), Err(ReconfigureError::Axes { sensors: 1, limits: 0 })));
    }
}
