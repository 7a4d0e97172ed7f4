//! Where a rig went, from what its sensors measured and nothing else.
//!
//! Returns of all sensors are cut into sweeps of one revolution. Each sweep is undone of the motion within it (constant
//! velocity, every return at its own time), laid against the map of those before by iterated closest points with a kernel
//! as wide as the motion has lately been mispredicted, and added to the map. The plan is that of KISS-ICP (Vizzo et al.
//! 2023, doi:10.1109/LRA.2023.3236571); what differs: residuals are measured across the surface where the map has one, the
//! velocity within a sweep is that found by its own registration and not that of the sweep before, and the
//! first two sweeps are registered together, as the first has no velocity yet.
//!
//! The registration strength of each pose is reported with it ([`crate::design::registration`]): in a straight corridor the
//! distance travelled is a guess, and that is reported.

mod align;
mod map;
mod pass;
mod sweeps;

use glam::{DQuat, DVec3};

use crate::base::geometry::Pose;
use crate::base::numbers::counted;
use crate::base::statistics::median;
use crate::design::registration::{DEGENERATE, Information, RegistrationQuality};
use crate::world::trajectory::{Trajectory, TrajectoryError};

use align::Aligned;
pub(crate) use align::{Kernel, Memory, align as align_points};
pub(crate) use map::thin;
pub use map::{Cells, Moments, PlaneFit, PointMap};
pub(crate) use pass::OdometryPass;
pub use sweeps::{Limits, Sweep, SweepPoint, Sweeps};

/// Sweeps of fewer returns say nothing.
const LEAST_POINTS: usize = 100;
/// Rounds that find a sweep's own velocity; at most so far apart it counts as converged, m/s and rad/s.
const VELOCITY_ROUNDS: usize = 4;
const SETTLED: f64 = 2e-3;
/// Edge of the cells that a sweep is thinned by before it is laid against the map, in cells of the map; halved so often, or
/// until it keeps so many points: what is found scatters with one over their root, and in a small room few would be left.
const THINNED: f64 = 1.5;
const MOST_HALVED: usize = 3;
const LEAST_LAID: usize = 4000;
/// The same before it is added to the map.
const MAPPED: f64 = 0.5;
/// Before the first sweep and after the last the body is assumed to go on as it did for so long, ns: two revolutions.
const LONGEST_REST_NS: u64 = 200_000_000;
/// Cells of the map, to each side, in which the surface of a return is looked for at most.
const FARTHEST_CELLS: i32 = 3;
/// Sweeps after which the map forgets what is out of reach.
const FORGET_EVERY: usize = 16;

/// What is chosen, not measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Edge of a cell of the map, m; none takes a share of the ranges of the first sweep.
    pub voxel_m: Option<f64>,
    /// Returns farther from the body are not mapped, m.
    pub reach_m: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self { voxel_m: None, reach_m: 150.0 }
    }
}

/// How one sweep was laid against the map.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Step {
    /// Middle of the sweep on the recording's clock, ns.
    pub time_ns: u64,
    /// Returns in it.
    pub returns: usize,
    /// Of the thinned returns, the share that met a surface of the map; null for the first.
    pub matched_share: Option<f64>,
    /// Of those across their surface, root of the mean square, m.
    pub residual_m: Option<f64>,
    /// Least eigenvalue per return of the information about the position: degenerate below 0.003.
    pub least_translation: Option<f64>,
    /// Along which that is, world.
    pub weakest_direction: Option<[f64; 3]>,
    /// Standard deviation of the step along it from the noise of the residuals alone, m.
    pub weakest_sd_m: Option<f64>,
    /// How far the prediction was off, m.
    pub deviation_m: f64,
}

impl Step {
    /// The surfaces leave the position open in some direction.
    pub(crate) fn is_degenerate(&self) -> bool {
        self.least_translation.is_some_and(|least| least < DEGENERATE)
    }
}

/// Constant velocity in the axes of the body.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Motion {
    pub velocity_m_s: DVec3,
    pub turn_rad_s: DVec3,
}

impl Motion {
    /// From one pose to another, as seen from the latter.
    pub(crate) fn between(from: &Pose, to: &Pose, seconds: f64) -> Self {
        let back = to.inverse() * *from;
        Self {
            velocity_m_s: -back.translation_m / seconds,
            turn_rad_s: -back.rotation.to_scaled_axis() / seconds,
        }
    }

    /// Where the body is then, from where it is now.
    pub(crate) fn over(&self, seconds: f64) -> Pose {
        Pose::new(DQuat::from_scaled_axis(self.turn_rad_s * seconds), self.velocity_m_s * seconds)
    }

    /// How far from another, m/s and rad/s mixed.
    fn distance(&self, other: &Self) -> f64 {
        (self.velocity_m_s - other.velocity_m_s).length() + (self.turn_rad_s - other.turn_rad_s).length()
    }
}

/// Sweeps go in, a trajectory comes out. The world is the body at the middle of the first sweep until `Odometry::finish_over`
/// moves it to the body at its start.
pub struct Odometry {
    settings: Settings,
    map: Option<PointMap>,
    first: Option<Sweep>,
    poses: Vec<(u64, Pose)>,
    span_ns: Option<[u64; 2]>,
    motion: Motion,
    deviation: Deviation,
    information: Vec<Information>,
    steps: Vec<Step>,
    problems: Vec<String>,
}

/// How far predictions were off lately: decides how wide the kernel is.
#[derive(Clone, Copy, Debug)]
struct Deviation {
    squares: f64,
    count: f64,
}

/// What became of a recording.
#[derive(Clone, Debug)]
pub struct Walked {
    /// Pose of the body at the middle of every sweep, and at both ends; the world is the body at the start.
    pub trajectory: Trajectory,
    /// By sweep.
    pub steps: Vec<Step>,
    /// Registration strength of the sweeps but the first.
    pub quality: Option<RegistrationQuality>,
    /// Edge of a cell of the map, m.
    pub voxel_m: f64,
    /// Sweeps that could not be used, in words.
    pub problems: Vec<String>,
}

/// Why there is no trajectory.
#[derive(Debug, thiserror::Error)]
pub enum OdometryError {
    /// One sweep has nothing to be laid against.
    #[error(
        "{} with at least {LEAST_POINTS} returns, odometry needs two: record longer; a rig at rest needs no trajectory",
        counted(*.sweeps as u64, "revolution")
    )]
    TooFew {
        /// Usable sweeps.
        sweeps: usize,
    },
    /// The second sweep did not fit the first.
    #[error("no trajectory was found: {reason}")]
    Lost {
        /// In words.
        reason: String,
    },
    /// The poses make no trajectory.
    #[error(transparent)]
    Trajectory(#[from] TrajectoryError),
}

impl Odometry {
    /// Nothing walked yet.
    pub(crate) fn new(settings: Settings) -> Self {
        Self {
            settings,
            map: None,
            first: None,
            poses: Vec::new(),
            span_ns: None,
            motion: Motion::default(),
            deviation: Deviation { squares: 0.0, count: 0.0 },
            information: Vec::new(),
            steps: Vec::new(),
            problems: Vec::new(),
        }
    }

    /// The next sweep, later than those before.
    pub(crate) fn add(&mut self, sweep: Sweep) {
        let seconds_in = |from_ns: u64| sweep.middle_ns().saturating_sub(from_ns) as f64 * 1e-9;
        let start_ns = self.span_ns.map_or(sweep.start_ns, |span| span[0]);
        if sweep.points.len() < LEAST_POINTS {
            self.problems.push(format!(
                "the revolution at {:.3} s holds {} returns: no pose for it",
                seconds_in(start_ns),
                sweep.points.len()
            ));
            return;
        }
        self.span_ns = Some([start_ns, sweep.end_ns]);
        let Some((last_ns, last)) = self.poses.last().copied() else {
            let voxel_m = self.settings.voxel_m.unwrap_or_else(|| suited_voxel_m(&sweep));
            self.deviation = Deviation { squares: (2.0 * voxel_m).powi(2), count: 1.0 };
            self.map = Some(PointMap::new(voxel_m));
            self.steps.push(Step::unmatched(&sweep));
            self.poses.push((sweep.middle_ns(), Pose::IDENTITY));
            self.first = Some(sweep);
            return;
        };
        let seconds = seconds_in(last_ns);
        let aligned = if self.first.is_some() {
            self.begin(&sweep, seconds)
        } else {
            self.follow(&sweep, &last, seconds)
        };
        let Some((aligned, guess)) = aligned else {
            self.problems.push(format!(
                "the revolution at {:.3} s fits nowhere in the map: no pose for it",
                seconds_in(start_ns)
            ));
            return;
        };
        self.take(&sweep, &aligned, &guess);
    }

    /// The trajectory. Where the recording begins before the first sweep and ends after the last, as with parts of a
    /// revolution, the body is assumed to have moved on as it did; `recorded_ns`: from the first firing to the end of the last.
    ///
    /// # Errors
    /// Fewer than two sweeps with returns, or a second one that does not fit the first.
    pub(crate) fn finish_over(self, recorded_ns: Option<[u64; 2]>) -> Result<Walked, OdometryError> {
        let (Some(map), Some([start_ns, end_ns])) = (self.map, self.span_ns) else {
            return Err(OdometryError::TooFew { sweeps: 0 });
        };
        let [begun_ns, ended_ns] = recorded_ns.unwrap_or([start_ns, end_ns]);
        let start_ns = begun_ns.clamp(start_ns.saturating_sub(LONGEST_REST_NS), start_ns);
        let end_ns = ended_ns.clamp(end_ns, end_ns + LONGEST_REST_NS);
        let [(first_ns, first), (second_ns, second), ..] = self.poses[..] else {
            return Err(match self.problems.into_iter().next() {
                Some(reason) => OdometryError::Lost { reason },
                None => OdometryError::TooFew { sweeps: self.poses.len() },
            });
        };
        let begun = Motion::between(&second, &first, (second_ns - first_ns) as f64 * -1e-9);
        let start = first * begun.over((first_ns - start_ns) as f64 * -1e-9);
        let start_from_world = start.inverse();
        let mut stamped = self.poses;
        let (last_ns, last) = stamped[stamped.len() - 1];
        stamped.insert(0, (start_ns, start));
        stamped.push((end_ns, last * self.motion.over((end_ns - last_ns) as f64 * 1e-9)));
        stamped.iter_mut().for_each(|(_, pose)| *pose = start_from_world * *pose);
        let mut steps = self.steps;
        for direction in steps.iter_mut().filter_map(|step| step.weakest_direction.as_mut()) {
            *direction = start_from_world.rotate(DVec3::from(*direction)).to_array();
        }
        let mut quality = RegistrationQuality::of_scans(&self.information);
        if let Some(direction) = quality.as_mut().and_then(|quality| quality.weakest_direction.as_mut()) {
            *direction = start_from_world.rotate(DVec3::from(*direction)).to_array();
        }
        stamped.dedup_by_key(|(time_ns, _)| *time_ns);
        Ok(Walked {
            trajectory: Trajectory::new(stamped)?,
            steps,
            quality,
            voxel_m: map.voxel_m(),
            problems: self.problems,
        })
    }

    /// The first two sweeps together: the first is laid out again with every velocity found.
    fn begin(&mut self, sweep: &Sweep, seconds: f64) -> Option<(Aligned, Pose)> {
        let first = self.first.take()?;
        let mut motion = Motion::default();
        let mut found = None;
        let map = self.map.as_mut()?;
        let mapped = thin(&first.points, MAPPED * map.voxel_m());
        let laid = laid_by(sweep, map.voxel_m());
        for round in 0..2 * VELOCITY_ROUNDS {
            map.clear();
            map.add(&straightened(&mapped, first.middle_ns(), &motion), &Pose::IDENTITY);
            let kernel =
                Kernel { width_m: self.deviation.width_m(), reach_cells: if round < 2 { 3 } else { 1 } };
            let points_m = straightened(&laid, sweep.middle_ns(), &motion);
            let mut memory = Memory::of(points_m.len());
            let guess = motion.over(seconds);
            let Some(aligned) = align::align(map, &points_m, &mut memory, &guess, kernel) else {
                // a later sweep may fit
                self.first = Some(first);
                return None;
            };
            let next = Motion::between(&Pose::IDENTITY, &aligned.pose, seconds);
            let moved = next.distance(&motion);
            motion = next;
            found = Some(aligned);
            if moved < SETTLED && round >= 2 {
                break;
            }
        }
        self.motion = motion;
        found.map(|aligned| (aligned, Pose::IDENTITY))
    }

    fn follow(&mut self, sweep: &Sweep, last: &Pose, seconds: f64) -> Option<(Aligned, Pose)> {
        let map = self.map.as_ref()?;
        let predicted = *last * self.motion.over(seconds);
        let kernel = self.deviation.kernel(map.voxel_m());
        let (mut guess, mut motion) = (predicted, self.motion);
        let mut found = None;
        let laid = laid_by(sweep, map.voxel_m());
        let mut memory = Memory::of(laid.len());
        for _ in 0..VELOCITY_ROUNDS {
            let points_m = straightened(&laid, sweep.middle_ns(), &motion);
            let aligned = align::align(map, &points_m, &mut memory, &guess, kernel)?;
            let next = Motion::between(last, &aligned.pose, seconds);
            let moved = next.distance(&motion);
            (guess, motion) = (aligned.pose, next);
            found = Some(aligned);
            if moved < SETTLED {
                break;
            }
        }
        self.motion = motion;
        found.map(|aligned| (aligned, predicted))
    }

    fn take(&mut self, sweep: &Sweep, aligned: &Aligned, guess: &Pose) {
        let Some(map) = self.map.as_mut() else { return };
        let off = guess.inverse() * aligned.pose;
        let turn_m = 2.0 * sweep.farthest_m().min(self.settings.reach_m) * (0.5 * angle(&off)).sin();
        let deviation_m = off.translation_m.length() + turn_m;
        // the first guess was none
        if self.poses.len() > 1 {
            self.deviation.note(deviation_m, map.voxel_m());
        }
        let mapped = thin(&sweep.points, MAPPED * map.voxel_m());
        map.add(&straightened(&mapped, sweep.middle_ns(), &self.motion), &aligned.pose);
        self.steps.push(Step::of(sweep, aligned, deviation_m));
        self.information.push(aligned.information.clone());
        self.poses.push((sweep.middle_ns(), aligned.pose));
        if self.poses.len().is_multiple_of(FORGET_EVERY) {
            map.forget(aligned.pose.translation_m, self.settings.reach_m);
        }
    }
}

impl Deviation {
    /// Standard deviation of what predictions were off by, m.
    fn width_m(&self) -> f64 {
        (self.squares / self.count).sqrt()
    }

    /// As wide as that; somebody who turns on the heel is looked for farther around than a vehicle.
    fn kernel(&self, voxel_m: f64) -> Kernel {
        let reach_cells = ((self.width_m() / voxel_m).ceil() as i32).clamp(1, FARTHEST_CELLS);
        Kernel { width_m: self.width_m(), reach_cells }
    }

    /// Small ones say that the rig stood, not how far it may be off when it moves.
    fn note(&mut self, deviation_m: f64, voxel_m: f64) {
        if deviation_m > 0.1 * voxel_m {
            self.squares += deviation_m * deviation_m;
            self.count += 1.0;
        }
    }
}

impl Step {
    fn unmatched(sweep: &Sweep) -> Self {
        Self {
            time_ns: sweep.middle_ns(),
            returns: sweep.points.len(),
            matched_share: None,
            residual_m: None,
            least_translation: None,
            weakest_direction: None,
            weakest_sd_m: None,
            deviation_m: 0.0,
        }
    }

    fn of(sweep: &Sweep, aligned: &Aligned, deviation_m: f64) -> Self {
        let translation = aligned.information.conditioning().map(|seen| seen.translation);
        let hits = aligned.information.hits() as f64;
        Self {
            matched_share: Some(aligned.matched_share),
            residual_m: Some(aligned.residual_m),
            least_translation: Some(translation.map_or(0.0, |axes| axes.least())),
            weakest_direction: translation.map(|axes| axes.weakest.to_array()),
            weakest_sd_m: translation
                .filter(|axes| axes.least() >= DEGENERATE)
                .map(|axes| aligned.residual_m / (axes.least() * hits).sqrt()),
            deviation_m,
            ..Self::unmatched(sweep)
        }
    }
}

/// The returns that a sweep is laid against the map by.
fn laid_by(sweep: &Sweep, voxel_m: f64) -> Vec<SweepPoint> {
    let mut laid = Vec::new();
    for halved in 0..=MOST_HALVED as i32 {
        laid = thin(&sweep.points, THINNED * voxel_m * 0.5_f64.powi(halved));
        if laid.len() >= LEAST_LAID {
            break;
        }
    }
    laid
}

/// Returns in the body at the middle of their sweep, m.
fn straightened(points: &[SweepPoint], middle_ns: u64, motion: &Motion) -> Vec<DVec3> {
    let after_s = |time_ns: u64| (time_ns as f64 - middle_ns as f64) * 1e-9;
    points.iter().map(|point| motion.over(after_s(point.time_ns)).transform_point(point.body_m)).collect()
}

/// A fifteenth of the median range, between 0.1 and 1 m: rooms of a few metres want cells of a few decimetres.
fn suited_voxel_m(sweep: &Sweep) -> f64 {
    let mut ranges_m: Vec<f64> = sweep.points.iter().map(|point| point.body_m.length()).collect();
    (median(&mut ranges_m).unwrap_or(0.0) / 15.0).clamp(0.1, 1.0)
}

fn angle(pose: &Pose) -> f64 {
    pose.rotation.to_scaled_axis().length()
}

#[cfg(test)]
mod tests;
