//! How one sensor sits to another, from the recording alone: the points of each among the planes of the other.
//!
//! No model of the scene is needed. In each window of a few revolutions every sensor's points make a map of its own, with
//! planes through the points of neighbouring cells. A point of one sensor lies in the other's plane when both mounts are
//! nominal; what is left over is regressed on the first sensor's seven unknowns (shift, turn, range offset; the second
//! stays). The body's pose is an unknown of every revolution with a prior that lets it drift (eliminated in its window);
//! a point's distance from its own sensor's planes says nothing about the mounts but holds these poses. Planes are made
//! again from the corrected mount and poses in each round, with cells and gates that shrink.
//!
//! Windows are short against the memory of a pose error, and all of it that two windows share cancels, as both sensors
//! ride the same body: what differs between windows is what the estimate scatters by. It is left out by turns
//! (jackknife, doi:10.1214/aos/1176345462), and the interval is Student's. What all windows get wrong alike is not in it:
//! in a simulated room of 9 by 6 m tilts came out 0.015 to 0.045 degrees low, up to twice the interval; in the furnished
//! house within 0.008 degrees (ten walks).

mod window;

use rayon::prelude::*;

use super::gather::Offset;
use super::observed::Observed;
use super::solve::LEAST_SCALE_M;
use super::{Estimate, RelativeTilt, tilt_axis};
use crate::base::statistics::{median, robust_deviation, student_quantile, student_two_sided};
use crate::rig::MountedSensor;
use crate::verify::compare::RecordedRay;
use crate::world::trajectory::{PoseError, Trajectory};
use window::{Block77, Column7, Look, MOST_TURNS, Window, WindowSums};

/// Windows that are wished for, and without which there is no result.
const WINDOWS: u64 = 10;
const LEAST_WINDOWS: usize = 4;
/// Points among the other sensor's planes, over all windows, at least.
const LEAST_PAIRS: usize = 400;
/// Rounds with large cells and gates, and all rounds.
const WIDE_ROUNDS: usize = 5;
const ROUNDS: usize = 24;
/// Edge of a cell as a share of the median range, between two bounds, m.
const EDGE_SHARE: f64 = 1.0 / 15.0;
const EDGES_M: [f64; 2] = [0.15, 1.0];
/// A step of no consequence, as a share of what the estimate scatters by.
const SMALL_STEP: f64 = 0.25;
/// Scatter of the points of an even plane, in standard deviations of a residual.
const EVEN: f64 = 1.5;
/// While cells are large, one in so many points is enough.
const FEW: usize = 4;

/// Two sensors and their recording.
#[derive(Clone, Copy)]
pub struct Pair<'a> {
    /// As recorded, or from odometry.
    pub trajectory: &'a Trajectory,
    /// Nominal, with the models of their packets.
    pub sensors: &'a [MountedSensor],
    /// The sensor that is looked at, and that which it is held against.
    pub first: usize,
    /// The latter.
    pub second: usize,
    /// Rays of these two sensors alone, in order of time.
    pub rays: &'a [RecordedRay],
    /// Duration of a revolution, ns.
    pub revolution_ns: u64,
}

/// How the first sensor sits to the second, against the nominal mounts.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct RelativeMount {
    /// The two.
    pub sensors: [String; 2],
    /// Tilt error of the first less that of the second; none where it is not observable.
    pub tilt: Option<RelativeTilt>,
    /// Turns of the first about the mount frame's axes (x right: roll, y forward: tilt, z up: yaw), degrees.
    pub rotation_deg: [Option<Estimate>; 3],
    /// Shifts along the mount frame's axes, mm.
    pub translation_mm: [Option<Estimate>; 3],
    /// Range offset of the first less that of the second, mm.
    pub range_offset_mm: Option<Estimate>,
    /// Unknowns that the scene tells.
    pub observable: Vec<&'static str>,
    /// Of the normalised unknowns; none where some direction is not observable at all.
    pub condition_number: Option<f64>,
    /// Points that met a plane of the other sensor.
    pub pairs: usize,
    /// Windows with such points.
    pub windows: usize,
    /// Rounds made.
    pub rounds: usize,
    /// Whether the last one moved nothing.
    pub converged: bool,
    /// Robust standard deviation of a residual between the sensors, mm.
    pub residual_sd_mm: f64,
    /// Why nothing is known of the tilt here.
    pub cannot_tell: Option<String>,
}

impl Pair<'_> {
    fn start_ns(&self) -> u64 {
        self.rays.first().map_or(0, |ray| ray.time_ns)
    }

    fn turn(&self, time_ns: u64) -> u64 {
        time_ns.saturating_sub(self.start_ns()) / self.revolution_ns.max(1)
    }

    fn windows(&self) -> Vec<Window> {
        let turns = self.rays.last().map_or(0, |ray| self.turn(ray.time_ns) + 1);
        let size = (turns / WINDOWS).clamp(1, MOST_TURNS as u64);
        let mut windows: Vec<Window> = Vec::new();
        for (place, ray) in self.rays.iter().enumerate() {
            let number = self.turn(ray.time_ns) / size;
            match windows.last_mut() {
                Some(last) if last.turns.start == number * size => last.rays.end = place + 1,
                _ => windows.push(Window {
                    rays: place..place + 1,
                    turns: number * size..(number + 1) * size,
                    poses: vec![[0.0; 6]; size as usize],
                }),
            }
        }
        windows
    }

    fn edge_m(&self) -> f64 {
        let mut ranges_m: Vec<f64> = self.rays.iter().filter_map(|ray| ray.range_m).collect();
        let median_m = median(&mut ranges_m).unwrap_or(0.0);
        (EDGE_SHARE * median_m).clamp(EDGES_M[0], EDGES_M[1])
    }
}

/// Regresses the first sensor's mount on the second's. `error` is what the trajectory may be off by.
pub fn relative_mount(pair: &Pair<'_>, error: &PoseError) -> RelativeMount {
    let mut windows = pair.windows();
    let edge_m = pair.edge_m();
    let mut offset = Offset::default();
    let (mut scale_m, mut rounds, mut converged) = (None, 0, false);
    let mut last: Option<(Vec<WindowSums>, Observed, f64)> = None;
    while rounds < ROUNDS && !converged {
        let is_wide = rounds < WIDE_ROUNDS;
        let look = Look {
            edge_m: if is_wide { 2.0 * edge_m } else { edge_m },
            gate_m: if is_wide {
                1.0
            } else {
                scale_m.map_or(0.1, |scale: f64| (6.0 * scale).clamp(0.03, 0.3))
            },
            most_across_m: scale_m.filter(|_| !is_wide).map_or(f64::INFINITY, |scale| EVEN * scale),
            least_alike: if is_wide { 0.9 } else { 0.966 },
            every: if is_wide { FEW } else { 1 },
            scale_m,
        };
        let window_sums: Vec<WindowSums> =
            windows.par_iter().map(|window| window.sums(pair, &offset, &look, error)).collect();
        rounds += 1;
        let Some(found_m) = spread_m(&window_sums) else { break };
        let weight_m = look.scale_m.unwrap_or(0.05);
        // gates that follow what they let through would shrink without end
        if rounds <= WIDE_ROUNDS + 1 {
            scale_m = Some(found_m);
        }
        let observed = observed(&window_sums, weight_m);
        let basis = &observed.basis;
        let (information, right) = sum(&window_sums);
        let Some(step) = solve(&(information, right), basis) else {
            last = Some((window_sums, observed, found_m));
            break;
        };
        for (window, window_sums) in windows.iter_mut().zip(&window_sums) {
            window.follow(window_sums, &step);
        }
        offset.add(step.as_slice());
        converged = !is_wide && rounds > WIDE_ROUNDS + 2 && is_small(&step, &window_sums, basis);
        last = Some((window_sums, observed, found_m));
    }
    let fate = Fate { rounds, converged };
    report(pair, &offset, last, fate)
}

struct Fate {
    rounds: usize,
    converged: bool,
}

fn sum<'a>(window_sums: impl IntoIterator<Item = &'a WindowSums>) -> (Block77, Column7) {
    window_sums.into_iter().fold((Block77::zeros(), Column7::zeros()), |(information, right), window_sums| {
        (information + window_sums.information, right + window_sums.right)
    })
}

fn spread_m(window_sums: &[WindowSums]) -> Option<f64> {
    let mut sizes: Vec<f64> =
        window_sums.iter().flat_map(|window| &window.across_m).map(|off| off.abs()).collect();
    if sizes.len() < LEAST_PAIRS {
        return None;
    }
    robust_deviation(&mut sizes).map(|deviation_m| deviation_m.max(LEAST_SCALE_M))
}

/// What is observable from the pairs, less the noise of the normals. `weight_m` made the weights.
fn observed(window_sums: &[WindowSums], weight_m: f64) -> Observed {
    let pairs = window_sums.iter().map(|window_sums| window_sums.across_m.len()).sum::<usize>() as f64;
    let pretended: Block77 = window_sums.iter().map(|window_sums| window_sums.pretended).sum();
    let lever_m =
        (window_sums.iter().map(|window_sums| window_sums.lever2_m2).sum::<f64>() / pairs.max(1.0)).sqrt();
    let seen = (sum(window_sums).0 - pretended) * (weight_m * weight_m);
    Observed::of(&seen, pairs, lever_m)
}

/// Step in the observable directions.
fn solve((information, right): &(Block77, Column7), basis: &[[f64; 7]]) -> Option<Column7> {
    if basis.is_empty() {
        return None;
    }
    let from_observable = nalgebra::DMatrix::from_fn(7, basis.len(), |row, column| basis[column][row]);
    let inside = from_observable.transpose() * information * &from_observable;
    let reduced = nalgebra::Cholesky::new(inside)?.solve(&(from_observable.transpose() * right));
    let step = from_observable * reduced;
    Some(Column7::from_fn(|place, _| step[place]))
}

/// Scatter of the estimate when each window is left out by turns, and how many windows that were.
fn jackknife(window_sums: &[WindowSums], basis: &[[f64; 7]]) -> Option<(Block77, usize)> {
    let used: Vec<&WindowSums> =
        window_sums.iter().filter(|window_sums| !window_sums.across_m.is_empty()).collect();
    let (information, right) = sum(used.iter().copied());
    let without = |left: &&WindowSums| solve(&(information - left.information, right - left.right), basis);
    let steps: Vec<Column7> = used.iter().map(without).collect::<Option<_>>()?;
    let count = steps.len() as f64;
    let mean = steps.iter().sum::<Column7>() / count;
    let mut spread = Block77::zeros();
    for step in &steps {
        let off = step - mean;
        spread.ger((count - 1.0) / count, &off, &off, 1.0);
    }
    Some((spread, steps.len()))
}

/// Whether no unknown moves by more than a small part of its own scatter.
fn is_small(step: &Column7, window_sums: &[WindowSums], basis: &[[f64; 7]]) -> bool {
    jackknife(window_sums, basis).is_some_and(|(spread, _)| {
        (0..7).all(|place| step[place].abs() <= SMALL_STEP * spread[(place, place)].max(0.0).sqrt())
    })
}

fn report(
    pair: &Pair<'_>,
    offset: &Offset,
    last: Option<(Vec<WindowSums>, Observed, f64)>,
    Fate { rounds, converged }: Fate,
) -> RelativeMount {
    let [first, second] = [pair.first, pair.second].map(|at| &pair.sensors[at]);
    let names = [first.name.clone(), second.name.clone()];
    let mut found = RelativeMount {
        sensors: names.clone(),
        tilt: None,
        rotation_deg: [None; 3],
        translation_mm: [None; 3],
        range_offset_mm: None,
        observable: Vec::new(),
        condition_number: None,
        pairs: 0,
        windows: 0,
        rounds,
        converged,
        residual_sd_mm: 0.0,
        cannot_tell: None,
    };
    let Some((window_sums, observed, scale_m)) = last else {
        found.cannot_tell = Some(format!(
            "cannot tell here: hardly any surface that one of {} and {} saw was seen by the other in the same second",
            first.name, second.name
        ));
        return found;
    };
    found.pairs = window_sums.iter().map(|window_sums| window_sums.across_m.len()).sum();
    found.windows = window_sums.iter().filter(|window_sums| !window_sums.across_m.is_empty()).count();
    found.residual_sd_mm = 1e3 * scale_m;
    found.condition_number = observed.condition_number;
    let Some((spread, count)) =
        jackknife(&window_sums, &observed.basis).filter(|(_, count)| *count >= LEAST_WINDOWS)
    else {
        found.cannot_tell = Some(format!(
            "cannot tell here: {} stretches of the recording show both sensors the same surfaces, {LEAST_WINDOWS} are needed",
            found.windows
        ));
        return found;
    };
    found.observable = observed.names();
    let estimate = |weights: [f64; 7], value: f64| {
        let weights = Column7::from(weights);
        let variance = (weights.transpose() * spread * weights)[(0, 0)];
        student(value, variance.max(1e-24).sqrt(), count - 1)
    };
    let unit = |place: usize| std::array::from_fn(|other| f64::from(u8::from(other == place)));
    let single = |place: usize, value: f64, by: f64| {
        observed.is_observable[place].then(|| estimate(unit(place), value).scaled(by))
    };
    let degrees = 1f64.to_degrees();
    let turn = offset.rotation.to_scaled_axis();
    found.rotation_deg = [0, 1, 2].map(|axis| single(3 + axis, turn[axis], degrees));
    found.translation_mm = [0, 1, 2].map(|axis| single(axis, offset.translation_m[axis], 1e3));
    found.range_offset_mm = single(6, offset.range_m, 1e3);
    let axis = tilt_axis(&first.mount);
    let along = [0.0, 0.0, 0.0, axis.x, axis.y, axis.z, 0.0];
    if !observed.tells(&along) || !observed.is_observable[4] {
        found.cannot_tell =
            Some("cannot tell here: the surfaces that both saw leave the pitch between them open".to_owned());
    } else if !converged {
        found.cannot_tell = Some(format!(
            "cannot tell here: after {rounds} rounds of laying the maps together they still move"
        ));
    } else {
        let tilt = estimate(along, turn.dot(axis)).scaled(degrees);
        found.tilt = Some(RelativeTilt {
            sensors: names,
            error_deg: tilt.value,
            sd_deg: tilt.sd,
            u95_deg: tilt.u95,
            p_value: tilt.p_value,
        });
    }
    found
}

/// An estimate of so many degrees of freedom.
pub(super) fn student(value: f64, sd: f64, freedom: usize) -> Estimate {
    let u95 = sd * student_quantile(0.05, freedom);
    Estimate { value, sd, u95, p_value: student_two_sided(value / sd, freedom) }
}

#[cfg(test)]
mod tests;
