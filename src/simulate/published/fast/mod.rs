//! The fast exact method: on a straight walk a ray that hits floor, ceiling or a side hits the same row at every pose,
//! shifted by the same number of voxels, so that all poses are one comb; only end-wall hits need work per pose.
//!
//! Exact: whatever comes so close to a voxel's face that rounding could decide is handed to the definition
//! (`brute.rs`). Rays are set up in f64 (their error is below 1e-11 voxel, the guard 1e-9); end-wall hits run in
//! 32-bit fixed point, with a guard that covers its rounding.

mod hits;
mod sweep;

use std::ops::Range;

use super::elements::WIDTH;
use super::shell::{Shell, ShellSize};
use super::{PublishedBox, brute};
use crate::base::instructions::Instructions;
use crate::rig::{MountDeg, Path, Phase};
use sweep::View;

/// What the fast method prepares once per experiment.
#[derive(Clone, Debug)]
pub(super) struct Plan {
    size: ShellSize,
    /// Voxels from pose to pose of a class.
    comb_step: usize,
    /// Every how many poses the walk has moved on by whole voxels: poses fall into so many classes.
    classes: usize,
    /// Sine and cosine of every azimuth.
    azimuths: Vec<[f64; 2]>,
    /// Sines and cosines of the elevations, filled up to whole blocks with the last beam.
    elevations: [Vec<f64>; 2],
    beams: usize,
    /// Bits of a fixed-point number before the point.
    whole_bits: u32,
}

impl Plan {
    /// None where the pattern turns from pose to pose, and where the numbers of the fast method would not fit: extremely
    /// many voxels.
    pub(crate) fn new(simulator: &PublishedBox) -> Option<Self> {
        let experiment = &simulator.experiment;
        if experiment.phase == Phase::Free {
            return None;
        }
        let poses_per_m = experiment.sub_poses as f64;
        let step = |poses: usize| poses as f64 / (poses_per_m * experiment.voxel_m);
        let is_whole = |value: f64| (value - value.round()).abs() < 1e-9;
        let whole_steps = (1..experiment.poses()).find(|poses| is_whole(step(*poses)));
        let (classes, comb_step) = match whole_steps {
            Some(classes) => (classes, step(classes).round() as usize),
            // every pose is a class of its own
            None => (experiment.poses(), 1),
        };
        let (u, w) = axes(experiment.path);
        let size = ShellSize {
            cells_u: simulator.cells[u],
            cells_w: simulator.cells[w],
            cells_z: simulator.cells[2],
        };
        // one more row than the end walls have, for elements with nothing to mark; one more bit for which end it is
        let bits = |count: usize| usize::BITS - count.leading_zeros();
        let whole_bits = bits(size.cells_w - 1).max(bits(size.cells_z) + 1);
        if whole_bits > 11 {
            return None;
        }
        let sin_cos = |angle_rad: f64| [angle_rad.sin(), angle_rad.cos()];
        let azimuths = (0..experiment.azimuths)
            .map(|azimuth| sin_cos(brute::azimuth_rad(simulator, 0.0, azimuth)))
            .collect();
        let beams = simulator.elevations.len();
        let padded = beams.next_multiple_of(WIDTH);
        let column =
            |part: usize| (0..padded).map(|at| simulator.elevations[at.min(beams - 1)][part]).collect();
        Some(Self {
            size,
            comb_step,
            classes,
            azimuths,
            elevations: [column(0), column(1)],
            beams,
            whole_bits,
        })
    }

    /// Beam of a element; the last block repeats the last beam where beams do not fill it.
    fn beam(&self, block: usize, element: usize) -> usize {
        (block * WIDTH + element).min(self.beams - 1)
    }
}

fn axes(path: Path) -> (usize, usize) {
    match path {
        Path::Lateral => (0, 1),
        Path::Forward => (1, 0),
    }
}

/// Rays of one sensor's first pose for which a second thread is worth its waking.
const WORTH_A_THREAD: usize = 8192;

/// What each sensor sees, settled. One of a mirrored pair is derived from the other where that is exact.
pub(super) fn see(
    simulator: &PublishedBox,
    plan: &Plan,
    sensors: &[MountDeg],
    instructions: Instructions,
) -> Vec<Shell> {
    let looker = Looker { simulator, plan, instructions };
    let mut shells = Vec::with_capacity(sensors.len());
    let mut next = 0;
    while next < sensors.len() {
        let master = &sensors[next];
        let is_pair = sensors.get(next + 1).is_some_and(|other| *other == master.mirrored());
        let mirrors = plan.azimuths.len().is_multiple_of(2);
        if is_pair && mirrors {
            shells.extend(looker.see_pair(master));
            next += 2;
        } else {
            shells.push(looker.see_alone(master, std::slice::from_ref(&(0..plan.azimuths.len()))));
            next += 1;
        }
    }
    shells
}

/// One ray at one pose.
struct Ray {
    azimuth: usize,
    beam: usize,
    pose: usize,
}

#[derive(Clone, Copy)]
struct Looker<'a> {
    simulator: &'a PublishedBox,
    plan: &'a Plan,
    instructions: Instructions,
}

impl Looker<'_> {
    /// What a sensor sees in ranges of azimuths.
    fn see_alone(&self, sensor: &MountDeg, columns: &[Range<usize>]) -> Shell {
        let (mut shell, undecided) = self.look(sensor, columns, false);
        for ray in undecided {
            self.decide(sensor, &ray, &mut shell);
        }
        shell.settle();
        shell
    }

    /// A sensor and its mirror image. The ray at azimuth a of one is the mirror image of the ray at 180 degrees - a of
    /// the other, up to rounding; azimuths 0 and 180, where a rounding of the published sine makes all the difference,
    /// are looked at for each sensor on its own, and so is what the definition must decide.
    fn see_pair(&self, master: &MountDeg) -> [Shell; 2] {
        let azimuths = self.plan.azimuths.len();
        let poses = self.simulator.stations_m.len();
        let along = self.simulator.experiment.path == Path::Lateral;
        let image = master.mirrored();
        let columns = [1..azimuths / 2, azimuths / 2 + 1..azimuths];
        let (mut common, undecided) = self.look(master, &columns, true);
        common.settle();
        let mirrored = common.mirrored(along);
        let mut shells = [common, mirrored];
        for ray in undecided {
            self.decide(master, &ray, &mut shells[0]);
            let mirrored = Ray {
                azimuth: (azimuths + azimuths / 2 - ray.azimuth) % azimuths,
                pose: if along { poses - 1 - ray.pose } else { ray.pose },
                ..ray
            };
            self.decide(&image, &mirrored, &mut shells[1]);
        }
        for (sensor, shell) in [master, &image].into_iter().zip(&mut shells) {
            shell.join(&self.see_alone(sensor, &[0..1, azimuths / 2..azimuths / 2 + 1]));
        }
        shells
    }

    /// What a sensor hits in ranges of azimuths, and what only the definition can decide. A second thread takes half of
    /// the columns, where there is one: marks of both are joined, so that neither can tell.
    fn look(&self, sensor: &MountDeg, columns: &[Range<usize>], is_mirrored: bool) -> (Shell, Vec<Ray>) {
        let count: usize = columns.iter().map(Range::len).sum();
        let is_long = count * self.plan.beams >= WORTH_A_THREAD;
        if !is_long || rayon::current_num_threads() == 1 {
            return self.sweep(sensor, columns, is_mirrored);
        }
        let [first, second] = halves(columns, count / 2);
        let ((mut shell, mut rays), (other, others)) = rayon::join(
            || self.sweep(sensor, &first, is_mirrored),
            || self.sweep(sensor, &second, is_mirrored),
        );
        shell.join(&other);
        rays.extend(others);
        (shell, rays)
    }

    fn sweep(&self, sensor: &MountDeg, columns: &[Range<usize>], is_mirrored: bool) -> (Shell, Vec<Ray>) {
        let (simulator, plan) = (self.simulator, self.plan);
        let poses = simulator.stations_m.len();
        let views: Vec<_> = (0..plan.classes.min(poses))
            .map(|class| {
                let own_poses = (poses - class).div_ceil(plan.classes);
                View::new(simulator, plan, sensor, class, own_poses, is_mirrored)
            })
            .collect();
        let mut shell = Shell::new(plan.size);
        let mut rays = Vec::new();
        for views in views.chunk_by(|a, b| a.poses == b.poses) {
            for undecided in sweep::run(plan, views, columns, &mut shell, self.instructions) {
                let chosen = undecided.pose.map_or(0..views[0].poses, |pose| pose..pose + 1);
                rays.extend(chosen.map(|pose| Ray {
                    azimuth: undecided.azimuth,
                    beam: undecided.beam,
                    pose: undecided.class + pose * plan.classes,
                }));
            }
        }
        (shell, rays)
    }

    /// Marks what one ray hits, by the definition.
    fn decide(&self, sensor: &MountDeg, ray: &Ray, shell: &mut Shell) {
        let simulator = self.simulator;
        let pose = simulator.pose(sensor, ray.pose);
        let direction = brute::direction(simulator, &pose, ray.azimuth, ray.beam);
        if let Some(index) = brute::voxel(simulator, pose.origin_m, direction) {
            let [nx, ny, _] = simulator.cells;
            let cell = [index % nx, index / nx % ny, index / (nx * ny)];
            let (u, w) = axes(simulator.experiment.path);
            shell.mark([cell[u], cell[w], cell[2]]);
        }
    }
}

/// The first `count` columns, and the others.
fn halves(columns: &[Range<usize>], count: usize) -> [Vec<Range<usize>>; 2] {
    let mut left = count;
    let mut parts = [Vec::new(), Vec::new()];
    for range in columns {
        let middle = range.start + left.min(range.len());
        left -= middle - range.start;
        parts[0].push(range.start..middle);
        parts[1].push(middle..range.end);
    }
    parts
}
