//! Returns against the first surface on their rays: how many fit, and the placement at which they fit best.

use glam::{DQuat, DVec3};
use nalgebra::{Cholesky, Matrix6, Vector6};
use rayon::prelude::*;

use super::returns::WalkReturn;
use super::surface::Target;
use crate::base::geometry::Pose;
use crate::base::statistics::robust_deviation;
use crate::design::registration::Information;
use crate::world::scene::Scene;

/// Returns of one piece of parallel work: pieces are added in order, so that the outcome does not hang on threads.
const PIECE: usize = 256;
/// A return fits where it ends so near the surface along its ray, or across the surface where that is not too far off along
/// the ray, m.
const FITS_ALONG_M: f64 = 0.12;
const FITS_ACROSS_M: f64 = 0.06;
const FITS_FAR_M: f64 = 0.5;
/// Before a guess is refined: as far as half a step of the turns moves a return, m and m per m.
const COARSE_M: f64 = 0.2;
const COARSE_SHARE: f64 = 0.03;
/// Rays that graze a surface more than this say little about it: cosine to its normal.
const GRAZING: f64 = 0.2;
/// Residuals beyond a multiple of their robust deviation count little (Geman-McClure), within bounds, m.
const KERNEL: f64 = 4.0;
const KERNEL_M: [f64; 2] = [0.04, 0.3];
/// Returns farther off than this along their ray are not used, m; shrinks by a share each round down to the last.
const GATE_M: [f64; 2] = [0.6, 0.4];
const GATE_SHRINKS: f64 = 0.75;
/// Returns farther than this from the middle of the walk turn it no more than those there: where a trajectory drifts, moments
/// with far walls in view would outweigh all others, m.
const LEVER_M: f64 = 5.0;
/// Step that ends the rounds, m and rad.
const SMALL_STEP: f64 = 2e-5;
/// Information per return of the guess: holds directions that nothing ties down.
const OF_GUESS: f64 = 1e-6;
/// Fewer returns that meet a surface say nothing.
const LEAST_MET: usize = 30;
/// Blocks of the walk; their scatter gives the uncertainty of the result.
const BLOCKS: usize = 20;

/// A return and the first surface on its ray.
#[derive(Clone, Copy, Debug)]
pub(super) struct Met {
    /// Measured less predicted, m.
    pub along_m: f64,
    /// Beyond the surface, across it, m.
    pub across_m: f64,
    /// None where the surface has no direction of its own.
    normal: Option<DVec3>,
    point_m: DVec3,
    slope: f64,
}

impl Met {
    pub(crate) fn fits(&self) -> bool {
        self.along_m.abs() <= FITS_ALONG_M
            || (self.normal.is_some()
                && self.across_m.abs() <= FITS_ACROSS_M
                && self.along_m.abs() <= FITS_FAR_M)
    }

    fn fits_coarsely(&self, range_m: f64) -> bool {
        self.along_m.abs() <= COARSE_M + COARSE_SHARE * range_m
    }
}

impl Target<'_> {
    /// Every return at a placement; none where its ray meets nothing.
    pub(super) fn meet(&self, placement: &Pose, returns: &[WalkReturn]) -> Vec<Option<Met>> {
        let pieces: Vec<Vec<Option<Met>>> =
            returns.par_chunks(PIECE).map(|piece| self.meet_piece(placement, piece)).collect();
        pieces.into_iter().flatten().collect()
    }

    fn meet_piece(&self, placement: &Pose, returns: &[WalkReturn]) -> Vec<Option<Met>> {
        let origins_m: Vec<DVec3> = returns.iter().map(|r| placement.transform_point(r.origin_m)).collect();
        let points_m: Vec<DVec3> = returns.iter().map(|r| placement.transform_point(r.point_m)).collect();
        let directions: Vec<DVec3> =
            origins_m.iter().zip(&points_m).map(|(from_m, to_m)| (to_m - from_m).normalize()).collect();
        let mut met = vec![None; returns.len()];
        let own_normals = !matches!(self.scene, Scene::Voxels(_));
        self.scene.cast_many(&origins_m, &directions, |at, hit| {
            let Some(hit) = hit else { return };
            let (direction, point_m) = (directions[at], points_m[at]);
            let hit_m = origins_m[at] + hit.distance_m * direction;
            let normal = match own_normals {
                true => Some(hit.normal),
                // faces of voxels face where no surface does
                false => self.map.plane(hit_m).map(|plane| plane.normal),
            };
            met[at] = Some(Met {
                along_m: returns[at].range_m() - hit.distance_m,
                across_m: normal.map_or(0.0, |normal| normal.dot(point_m - hit_m)),
                slope: normal.map_or(0.0, |normal| normal.dot(direction).abs()),
                normal,
                point_m,
            });
        });
        met
    }

    /// Which returns fit at a placement.
    pub(super) fn fits(&self, placement: &Pose, returns: &[WalkReturn]) -> Vec<bool> {
        let met = self.meet(placement, returns);
        met.iter().map(|met| met.as_ref().is_some_and(Met::fits)).collect()
    }

    /// Share of the returns that fit a placement that is not refined yet.
    pub(super) fn coarse_share(&self, placement: &Pose, returns: &[WalkReturn]) -> f64 {
        let met = self.meet(placement, returns);
        let fits = |(met, of): (&Option<Met>, &WalkReturn)| {
            met.as_ref().is_some_and(|met| met.fits_coarsely(of.range_m()))
        };
        met.iter().zip(returns).filter(|pair| fits(*pair)).count() as f64 / returns.len().max(1) as f64
    }

    /// The placement at which the returns lie best on the surfaces that they meet, from a guess near it; none where too few
    /// meet any.
    pub(super) fn refine(
        &self,
        guess: &Pose,
        returns: &[WalkReturn],
        settings: &Refining,
    ) -> Option<Refined> {
        let middle_m = middle_m(returns)?;
        let mut pose = *guess;
        let mut last = None;
        let mut gate_m = settings.gate_m;
        for round in 0..settings.rounds {
            let met = self.meet(&pose, returns);
            let used = used(&met, gate_m);
            if used.len() < LEAST_MET {
                return None;
            }
            let about_m = pose.transform_point(middle_m);
            let step = Step::of(&used, about_m, returns.len());
            let held = settings.held(used.len(), step.width_m);
            let off = off(guess, &pose, middle_m);
            let own = step.own + Matrix6::from_diagonal(&held);
            let right = step.right + held.component_mul(&off);
            let change = Cholesky::new(own)?.solve(&right);
            pose = moved(&pose, &change, about_m);
            let is_small = change.norm() < SMALL_STEP;
            last = Some((step, about_m, own));
            if is_small && gate_m <= GATE_M[1] && round > 2 {
                break;
            }
            gate_m = (gate_m * GATE_SHRINKS).max(GATE_M[1]);
        }
        let (step, about_m, own) = last?;
        let inverse = Cholesky::new(own)?.inverse();
        Some(Refined {
            pose,
            covariance: inverse * step.scatter * inverse,
            about_m,
            information: step.information,
        })
    }
}

/// How a placement is refined.
#[derive(Clone, Copy, Debug)]
pub(super) struct Refining {
    pub rounds: usize,
    /// At first, m.
    pub gate_m: f64,
    /// How well the guess is known, m and rad; none for a guess that is one.
    pub guess_sd: Option<[f64; 2]>,
}

impl Refining {
    pub const FROM_FAR: Self = Self { rounds: 12, gate_m: GATE_M[0], guess_sd: None };
    pub const FROM_NEAR: Self = Self { rounds: 15, gate_m: GATE_M[1], guess_sd: None };

    /// Information about the guess, in residuals of unit weight.
    fn held(&self, used: usize, width_m: f64) -> Vector6<f64> {
        let free = OF_GUESS * used as f64;
        let [shift, turn] = self.guess_sd.map_or([free; 2], |sd| sd.map(|sd| free + (width_m / sd).powi(2)));
        Vector6::new(shift, shift, shift, turn, turn, turn)
    }
}

/// A refined placement.
#[derive(Clone, Debug)]
pub(super) struct Refined {
    pub pose: Pose,
    /// Of a shift (m) and a turn (rad) about a point, in axes of the scene: by the scatter between blocks of the walk.
    pub covariance: Matrix6<f64>,
    pub about_m: DVec3,
    pub information: Information,
}

/// Mean of where the beams started, m.
pub(super) fn middle_m(returns: &[WalkReturn]) -> Option<DVec3> {
    let sum: DVec3 = returns.iter().map(|of| of.origin_m).sum();
    (!returns.is_empty()).then(|| sum / returns.len() as f64)
}

/// Those that the fit is about, with their numbers.
fn used(met: &[Option<Met>], gate_m: f64) -> Vec<(usize, Met)> {
    let near = |met: &Met| met.normal.is_some() && met.along_m.abs() <= gate_m && met.slope >= GRAZING;
    met.iter().enumerate().filter_map(|(at, met)| Some((at, met.filter(near)?))).collect()
}

struct Step {
    own: Matrix6<f64>,
    right: Vector6<f64>,
    /// Outer products of the blocks' parts of `right`.
    scatter: Matrix6<f64>,
    information: Information,
    width_m: f64,
}

impl Step {
    fn of(used: &[(usize, Met)], about_m: DVec3, returns: usize) -> Self {
        let mut sizes: Vec<f64> = used.iter().map(|(_, met)| met.across_m.abs()).collect();
        let deviation_m = robust_deviation(&mut sizes).unwrap_or(0.0);
        let kernel_m = (KERNEL * deviation_m).clamp(KERNEL_M[0], KERNEL_M[1]);
        let mut blocks = vec![Vector6::zeros(); BLOCKS];
        let mut own = Matrix6::zeros();
        let mut information = Information::default();
        for (at, met) in used {
            let Some(normal) = met.normal else { continue };
            let from_m = met.point_m - about_m;
            let turn = from_m.cross(normal);
            let row = Vector6::new(normal.x, normal.y, normal.z, turn.x, turn.y, turn.z);
            let robust = (kernel_m * kernel_m / (kernel_m * kernel_m + met.across_m * met.across_m)).powi(2);
            let weight = robust * LEVER_M * LEVER_M / (LEVER_M * LEVER_M + from_m.length_squared());
            own.ger(weight, &row, &row, 1.0);
            blocks[at * BLOCKS / returns] -= row * (weight * met.across_m);
            information.add(from_m, normal);
        }
        let right: Vector6<f64> = blocks.iter().sum();
        let scatter = blocks.iter().map(|block| block * block.transpose()).sum();
        Self { own, right, scatter, information, width_m: deviation_m.max(KERNEL_M[0] / KERNEL) }
    }
}

/// A pose shifted, and turned about a point.
fn moved(pose: &Pose, change: &Vector6<f64>, about_m: DVec3) -> Pose {
    let turn = DQuat::from_scaled_axis(DVec3::new(change[3], change[4], change[5]));
    let shift_m = DVec3::new(change[0], change[1], change[2]);
    let from_m = pose.translation_m - about_m;
    Pose::new((turn * pose.rotation).normalize(), about_m + turn * from_m + shift_m)
}

/// From a pose to a guess: the shift of a point of the walk, m, and the turn, rad.
fn off(guess: &Pose, pose: &Pose, middle_m: DVec3) -> Vector6<f64> {
    let shift_m = guess.transform_point(middle_m) - pose.transform_point(middle_m);
    let turn = (guess.rotation * pose.rotation.conjugate()).normalize();
    let turn = if turn.w < 0.0 { -turn } else { turn }.to_scaled_axis();
    Vector6::new(shift_m.x, shift_m.y, shift_m.z, turn.x, turn.y, turn.z)
}
