//! The fast exact way: on a straight walk a ray that hits floor, ceiling or a side hits the same row at every pose,
//! shifted by the same number of voxels, so that all poses are one comb; only end-wall hits need work per pose.
//!
//! Exact: whatever comes so close to a voxel's face that rounding could decide is handed to the definition
//! (`brute.rs`). Rays are set up in f64 (their error is below 1e-11 voxel, the guard 1e-9); end-wall hits run in
//! 32-bit fixed point, with a guard that covers its rounding.
#![allow(unsafe_code)] // functions compiled for wider instructions are called after the processor was asked for them

mod sweep;

use std::ops::Range;

use super::shell::{Shell, ShellSize};
use super::{Path, Phase, Placement, Simulator, brute};
use sweep::View;
pub(super) use sweep::counts;

/// What the fast way prepares once per experiment.
#[derive(Clone, Debug)]
pub(super) struct Plan {
    size: ShellSize,
    /// Voxels from pose to pose of a class.
    comb_step: usize,
    /// Every how many poses the walk has moved on by whole voxels: poses fall into so many classes.
    classes: usize,
    /// Sine and cosine of every azimuth of the first pose.
    azimuths: Vec<[f64; 2]>,
    /// Sine and cosine of what each class adds to them.
    turns: Vec<[f64; 2]>,
    /// Sines and cosines of the elevations, filled up to whole blocks with the last beam.
    elevations: [Vec<f64>; 2],
    beams: usize,
    /// Bits of a fixed-point number before the point.
    whole_bits: u32,
}

impl Plan {
    /// None where the numbers of the fast way would not fit: extremely many voxels.
    pub fn new(simulator: &Simulator) -> Option<Self> {
        let experiment = &simulator.experiment;
        let poses_per_m = experiment.sub_poses as f64;
        let step = |poses: usize| poses as f64 / (poses_per_m * experiment.voxel_m);
        let is_whole = |value: f64| (value - value.round()).abs() < 1e-9;
        let whole_steps = (1..experiment.poses()).find(|poses| is_whole(step(*poses)));
        let (classes, comb_step) = match (experiment.phase, whole_steps) {
            (Phase::Locked, Some(classes)) => (classes, step(classes).round() as usize),
            // every pose is a class of its own
            _ => (experiment.poses(), 1),
        };
        let (u, w) = axes(experiment.path);
        let size = ShellSize {
            cells_u: simulator.cells[u],
            cells_w: simulator.cells[w],
            cells_z: simulator.cells[2],
        };
        // one more row than the end walls have, for lanes with nothing to mark; one more bit for which end it is
        let bits = |count: usize| usize::BITS - count.leading_zeros();
        let whole_bits = bits(size.cells_w - 1).max(bits(size.cells_z) + 1);
        if whole_bits > 11 {
            return None;
        }
        let sin_cos = |angle_rad: f64| [angle_rad.sin(), angle_rad.cos()];
        let first_rad = brute::azimuth_rad(simulator, 0, 0);
        let azimuths = (0..experiment.azimuths)
            .map(|azimuth| sin_cos(brute::azimuth_rad(simulator, 0, azimuth)))
            .collect();
        let turns =
            (0..classes).map(|class| sin_cos(brute::azimuth_rad(simulator, class, 0) - first_rad)).collect();
        let beams = simulator.elevations.len();
        let padded = beams.next_multiple_of(sweep::LANES);
        let column =
            |part: usize| (0..padded).map(|at| simulator.elevations[at.min(beams - 1)][part]).collect();
        Some(Self {
            size,
            comb_step,
            classes,
            azimuths,
            turns,
            elevations: [column(0), column(1)],
            beams,
            whole_bits,
        })
    }

    /// Beam of a lane; the last block repeats the last beam where beams do not fill it.
    fn beam(&self, block: usize, lane: usize) -> usize {
        (block * sweep::LANES + lane).min(self.beams - 1)
    }
}

fn axes(path: Path) -> (usize, usize) {
    match path {
        Path::Lateral => (0, 1),
        Path::Forward => (1, 0),
    }
}

/// What each sensor sees, settled. One of a mirrored pair is derived from the other where that is exact.
pub(super) fn see(simulator: &Simulator, plan: &Plan, sensors: &[Placement]) -> Vec<Shell> {
    let mut shells = Vec::with_capacity(sensors.len());
    let mut next = 0;
    while next < sensors.len() {
        let master = &sensors[next];
        let is_pair = sensors.get(next + 1).is_some_and(|other| *other == master.mirrored());
        let mirrors = simulator.experiment.phase == Phase::Locked && plan.azimuths.len().is_multiple_of(2);
        if is_pair && mirrors {
            shells.extend(see_pair(simulator, plan, master));
            next += 2;
        } else {
            shells.push(see_alone(simulator, plan, master, std::slice::from_ref(&(0..plan.azimuths.len()))));
            next += 1;
        }
    }
    shells
}

/// What a sensor sees in ranges of azimuths.
fn see_alone(simulator: &Simulator, plan: &Plan, sensor: &Placement, columns: &[Range<usize>]) -> Shell {
    let mut shell = Shell::new(plan.size);
    for ray in look(simulator, plan, sensor, columns, false, &mut shell) {
        decide(simulator, sensor, &ray, &mut shell);
    }
    shell.settle();
    shell
}

/// A sensor and its mirror image. The ray at azimuth a of one is the mirror image of the ray at 180 degrees - a of the
/// other, up to rounding; azimuths 0 and 180, where a rounding of the published sine makes all the difference, are
/// looked at for each sensor on its own, and so is what the definition must decide.
fn see_pair(simulator: &Simulator, plan: &Plan, master: &Placement) -> [Shell; 2] {
    let azimuths = plan.azimuths.len();
    let poses = simulator.stations_m.len();
    let along = simulator.experiment.path == Path::Lateral;
    let image = master.mirrored();
    let mut common = Shell::new(plan.size);
    let columns = [1..azimuths / 2, azimuths / 2 + 1..azimuths];
    let undecided = look(simulator, plan, master, &columns, true, &mut common);
    common.settle();
    let mirrored = common.mirrored(along);
    let mut shells = [common, mirrored];
    for ray in undecided {
        decide(simulator, master, &ray, &mut shells[0]);
        let mirrored = Ray {
            azimuth: (azimuths + azimuths / 2 - ray.azimuth) % azimuths,
            pose: if along { poses - 1 - ray.pose } else { ray.pose },
            ..ray
        };
        decide(simulator, &image, &mirrored, &mut shells[1]);
    }
    for (sensor, shell) in [master, &image].into_iter().zip(&mut shells) {
        shell.join(&see_alone(simulator, plan, sensor, &[0..1, azimuths / 2..azimuths / 2 + 1]));
    }
    shells
}

/// One ray at one pose.
struct Ray {
    azimuth: usize,
    beam: usize,
    pose: usize,
}

/// Marks what a sensor sees in ranges of azimuths, and returns what only the definition can decide.
fn look(
    simulator: &Simulator,
    plan: &Plan,
    sensor: &Placement,
    columns: &[Range<usize>],
    is_mirrored: bool,
    shell: &mut Shell,
) -> Vec<Ray> {
    let poses = simulator.stations_m.len();
    let views: Vec<_> = (0..plan.classes.min(poses))
        .map(|class| {
            let own_poses = (poses - class).div_ceil(plan.classes);
            View::new(simulator, plan, sensor, class, own_poses, is_mirrored)
        })
        .collect();
    let mut rays = Vec::new();
    for views in views.chunk_by(|a, b| a.poses == b.poses) {
        for undecided in sweep::run(plan, views, columns, shell) {
            let chosen = undecided.pose.map_or(0..views[0].poses, |pose| pose..pose + 1);
            rays.extend(chosen.map(|pose| Ray {
                azimuth: undecided.azimuth,
                beam: undecided.beam,
                pose: undecided.class + pose * plan.classes,
            }));
        }
    }
    rays
}

/// Marks what one ray hits, by the definition.
fn decide(simulator: &Simulator, sensor: &Placement, ray: &Ray, shell: &mut Shell) {
    let azimuth_rad = brute::azimuth_rad(simulator, ray.pose, ray.azimuth);
    let direction = brute::direction(simulator, sensor, azimuth_rad, ray.beam);
    let origin_m = brute::origin_m(simulator, sensor, simulator.stations_m[ray.pose]);
    if let Some(index) = brute::voxel(simulator, origin_m, direction) {
        let [nx, ny, _] = simulator.cells;
        let cell = [index % nx, index / nx % ny, index / (nx * ny)];
        let (u, w) = axes(simulator.experiment.path);
        shell.mark([cell[u], cell[w], cell[2]]);
    }
}
