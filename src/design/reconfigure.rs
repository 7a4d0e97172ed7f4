//! Better pitches for the place seen so far: a search over the angles of the axes alone, by what a view of the map says.

use std::convert::Infallible;
use std::sync::atomic::AtomicBool;

use crate::design::optimize::{Kind, Measured, Search, SearchError, Settings, Space, SpaceError, Variable};
use crate::rig::Rig;
use crate::simulate::view::{Seen, View};

/// Pitches are proposed in steps of this, degrees: finer than any servo's play, coarse enough to be read out.
const STEP_DEG: f64 = 0.1;

/// What is known: the place and the rig.
pub(crate) struct Question<'a> {
    /// Of what was recorded.
    pub view: &'a dyn View,
    /// Sensors in the order of the axes, at their present pitches.
    pub rig: &'a Rig,
    /// Minimum and maximum pitch of each axis, rad.
    pub limits_rad: &'a [[f64; 2]],
    /// Pairs of pitches that the rig refuses, rad.
    pub is_excluded: &'a (dyn Fn(&[f64]) -> bool + Sync),
}

/// An answer.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Answer {
    /// At the best pitches found; the present ones where none are better.
    pub rig: Rig,
    /// What it sees.
    pub best: Seen,
    /// What it sees at the present pitches.
    pub now: Seen,
}

/// Why there is no answer.
#[derive(Debug, thiserror::Error)]
pub enum ReconfigureError {
    /// No pitches see anything: the map has no surface, or the trajectory no pose.
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

impl Question<'_> {
    /// The rig at these pitches, rad, and what it sees.
    fn look(&self, pitches_rad: &[f64]) -> (Rig, Seen) {
        let mut rig = self.rig.clone();
        for (sensor, pitch_rad) in rig.sensors.iter_mut().zip(pitches_rad) {
            sensor.mount.pitch_rad = *pitch_rad;
        }
        let seen = self.view.see(std::slice::from_ref(&rig)).swap_remove(0);
        (rig, seen)
    }

    /// How far from allowed, 0 where housings and rig agree.
    fn violation(&self, rig: &Rig) -> f64 {
        let pitches_rad: Vec<f64> = rig.sensors.iter().map(|sensor| sensor.mount.pitch_rad).collect();
        rig.housing_shortfall_m() + f64::from(u8::from((self.is_excluded)(&pitches_rad)))
    }
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
        let (rig, seen) = question.look(&stepped_rad(pitches_deg, question.limits_rad));
        let violation = question.violation(&rig);
        Ok::<_, Infallible>(Measured { score: seen.union, violation, rays: seen.rays })
    };
    search.run(evaluations, measure, |_| (), &AtomicBool::new(false))?;
    let now = question.view.see(std::slice::from_ref(question.rig)).swap_remove(0);
    let found = search.best().map(|trial| stepped_rad(&trial.candidate.values, question.limits_rad));
    let found = found.map(|pitches_rad| question.look(&pitches_rad));
    let better = found.filter(|(rig, best)| question.violation(rig) == 0.0 && best.union > now.union);
    let (rig, best) = better.unwrap_or_else(|| (question.rig.clone(), now.clone()));
    if best.union == 0.0 {
        return Err(ReconfigureError::NothingSeen);
    }
    Ok(Answer { rig, best, now })
}

/// Rounded, and within limits all the same.
fn stepped_rad(pitches_deg: &[f64], limits_rad: &[[f64; 2]]) -> Vec<f64> {
    let stepped = pitches_deg.iter().zip(limits_rad).map(|(pitch_deg, [low_rad, high_rad])| {
        let pitch_rad = ((pitch_deg / STEP_DEG).round() * STEP_DEG).to_radians();
        pitch_rad.clamp(*low_rad, *high_rad)
    });
    stepped.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    use glam::DVec3;

    use crate::base::geometry::Pose;
    use crate::rig::{Mount, MountedSensor};
    use crate::simulate::view::MapView;
    use crate::world::scene::{BoxScene, VoxelMap};

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
        let view = MapView::new(&map, &poses);
        let mut question = Question { view: &view, rig: &rig, limits_rad: &limits_rad, is_excluded: &free };
        let answer = propose(&question, 1, 60).unwrap();
        assert_eq!(answer, propose(&question, 1, 60).unwrap(), "the same again");
        let pitch_rad = |answer: &Answer| answer.rig.sensors[0].mount.pitch_rad;
        assert_eq!(answer.now, question.look(&[0.6]).1);
        assert_eq!(answer.best, question.look(&[pitch_rad(&answer)]).1);
        let grid = (-70..=70).map(|at| question.look(&[f64::from(at) * 0.01]).1.union);
        let most = grid.fold(0.0, f64::max);
        assert!(answer.best.union >= 0.98 * most, "{answer:?}, a grid has {most}");
        assert!(answer.best.union >= answer.now.union && most <= view.observable() as f64);

        let keep_out = |pitches_rad: &[f64]| (pitches_rad[0] - pitch_rad(&answer)).abs() < 0.1;
        question.is_excluded = &keep_out;
        let elsewhere = propose(&question, 1, 60).unwrap();
        let at_rest = pitch_rad(&elsewhere) == 0.6;
        assert!(at_rest || !keep_out(&[pitch_rad(&elsewhere)]), "{elsewhere:?}");
    }

    #[test]
    fn two_that_see_the_same_are_spread() {
        let (map, mut rig) = half_seen(0.5);
        rig.sensors.push(MountedSensor { name: "b".into(), ..rig.sensors[0].clone() });
        rig.sensors[1].mount.x_m = 0.4;
        let (free, poses, limits_rad) = (|_: &[f64]| false, [Pose::IDENTITY], [[-0.7, 0.7]; 2]);
        let view = MapView::new(&map, &poses);
        let question = Question { view: &view, rig: &rig, limits_rad: &limits_rad, is_excluded: &free };
        let answer = propose(&question, 1, 60).unwrap();
        assert!(answer.best.union > 1.05 * answer.now.union, "{answer:?}");
        let [first, second] = [0, 1].map(|sensor| answer.rig.sensors[sensor].mount.pitch_rad);
        assert!((first - second).abs() > 0.02, "{answer:?}");
        // at one pitch most of what either sees, both see
        assert!(answer.now.overlap > 0.5 * answer.now.union, "{:?}", answer.now);
        assert!(answer.best.overlap < answer.now.overlap, "{answer:?}");
        let cells = view.cells(&answer.rig);
        assert_eq!((cells.surface + cells.frontier) as f64, answer.best.union);
    }

    #[test]
    fn questions_without_an_answer_are_refused() {
        let (_, rig) = half_seen(0.0);
        let empty = VoxelMap::new(0.25, 1, 100.0).unwrap();
        let free = |_: &[f64]| false;
        let (poses, limits_rad) = ([Pose::IDENTITY], [[-0.5, 0.5]]);
        let view = MapView::new(&empty, &poses);
        let mut question = Question { view: &view, rig: &rig, limits_rad: &limits_rad, is_excluded: &free };
        assert!(matches!(propose(&question, 1, 5), Err(ReconfigureError::NothingSeen)));
        question.limits_rad = &[];
        assert!(matches!(propose(&question, 1, 5), Err(ReconfigureError::Axes { sensors: 1, limits: 0 })));
    }
}
