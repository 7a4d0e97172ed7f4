//! One pose as the elements need it, and how far their f32 may be off.
//!
//! With the tangent t of a beam's elevation, the directions of a column are `level + t * slope` in each axis: a
//! direction divided by the cosine of its elevation. Lengths are in voxels. A face lies across axis a at the signed
//! distance D; `reach = D / (level_a + t * slope_a)`, and the ray crosses the plane of the face at
//! `origin_b + reach * (level_b + t * slope_b)`.
//!
//! Bound of the error, with u = 2^-24, the relative error of a rounding, and n the most voxels along an edge. A
//! component of a direction is a sum of two terms, made of numbers that were rounded once, rounded at most twice more:
//! off by at most `e = 4 u (|level| + |t * slope|)`. The divisor is that of axis a with D divided out of its numbers
//! before they are rounded: off by `e_a / |D|`. A ray that stays in the box moves along b by no more than there is room
//! on the longer side, m, so to first order the place is off by at most `reach * (e_b + m * e_a / |D|) + 4 u n`: the
//! component, the relative error of `reach`, and the rounding of division, product, origin and sum. A quarter is added,
//! which covers the terms of second order where the relative error of `reach` is below a tenth (above it the bound
//! exceeds half a voxel, with n >= 8 and m >= n / 2, and nothing is decided) and the rounding of the definition itself,
//! 1e-11 voxel.
//!
//! The bound grows linearly with the reach, and so does the reach along a straight line on a face: if the ends of a block
//! are within their bounds of a face, so is every beam between them, and a beam that is further from every voxel's face
//! than its bound is inside.

use super::{BoxPose, Faces, PublishedBox, brute};
use crate::simulate::published::elements::fused_f32;

/// One pose seen from the voxel grid.
pub(super) struct View<'a> {
    pub simulator: &'a PublishedBox,
    pub pose: &'a BoxPose,
    /// What is added to every azimuth, as an angle's sine and cosine.
    pub turn_sin_cos: (f64, f64),
    /// Growth of a direction with the tangent of the elevation, by axis.
    pub slopes: [f32; 3],
    /// One over the signed distance to the faces of an axis.
    pub per_distance: [[f32; 2]; 3],
    /// Components of a direction below this may be zero, by axis.
    pub tiny: [f32; 3],
    /// Whether rays with a zero component are lost.
    pub loses: bool,
    pub faces: [FaceView; 6],
}

/// One face of the box from one pose. Axis a of the notes above is `axes[0]`; b is either of the others.
#[derive(Clone, Copy, Default)]
pub(super) struct FaceView {
    pub axes: [usize; 3],
    /// One over the signed distance, by which `level_a` is multiplied.
    pub per_distance: f32,
    /// Growth of the divisor and of both components.
    slopes: [f32; 3],
    /// Origin along the rows of the face and from row to row, less half a voxel.
    starts: [f32; 2],
    /// Half a voxel less the part of the bound that does not grow with the reach.
    room: f32,
    /// Growth of the bound with the reach.
    growth: f32,
    /// Voxels along a row, and rows.
    pub cells: [u32; 2],
    /// Voxels along a row.
    pub per_row: f32,
    /// Number of the first voxel.
    pub base: u32,
}

impl<'a> View<'a> {
    /// None where numbers might leave the range of an f32: rows that are far from those of a rotation.
    pub(crate) fn new(simulator: &'a PublishedBox, faces: &Faces, pose: &'a BoxPose) -> Option<Self> {
        let lengths = pose.rows.map(|[x, y, z]| x.hypot(y).hypot(z));
        if !lengths.iter().all(|length| (0.5..=2.0).contains(length)) {
            return None;
        }
        let (preset, voxel_m) = (&simulator.experiment.preset, simulator.experiment.voxel_m);
        let origin = [0, 1, 2].map(|axis| (pose.origin_m[axis] - preset.box_min_m[axis]) / voxel_m);
        let distances = [0, 1, 2].map(|axis| [-origin[axis], faces.cells[axis] as f64 - origin[axis]]);
        let slopes = pose.rows.map(|row| row[2]);
        let rounding = f64::from(f32::EPSILON) / 2.0;
        let errors =
            pose.rows.map(|row| 4.0 * rounding * (row[0].hypot(row[1]) + faces.steepest * row[2].abs()));
        let most = faces.cells.into_iter().max().unwrap_or_default().max(8) as f64;
        let view_face = |face: usize| {
            let axes = faces.faces[face].axes;
            let [axis, first, second] = axes;
            let per_distance = 1.0 / distances[axis][face % 2];
            let error = |along: usize| {
                let [low, high] = distances[along];
                errors[along] + high.max(-low) * errors[axis] * per_distance.abs()
            };
            FaceView {
                axes,
                per_distance: per_distance as f32,
                slopes: [slopes[axis] * per_distance, slopes[first], slopes[second]]
                    .map(|slope| slope as f32),
                starts: [first, second].map(|axis| (origin[axis] - 0.5) as f32),
                room: (0.5 - 1.25 * 4.0 * rounding * most) as f32,
                growth: (1.25 * error(first).max(error(second))) as f32,
                cells: [first, second].map(|axis| faces.cells[axis] as u32),
                per_row: faces.cells[first] as f32,
                base: faces.faces[face].base as u32,
            }
        };
        Some(Self {
            simulator,
            pose,
            turn_sin_cos: brute::azimuth_rad(simulator, pose.turn, 0).sin_cos(),
            slopes: slopes.map(|slope| slope as f32),
            per_distance: distances.map(|sides| sides.map(|distance| (1.0 / distance) as f32)),
            tiny: errors.map(|error| (2.0 * error) as f32),
            loses: simulator.loses(),
            faces: std::array::from_fn(view_face),
        })
    }
}

impl FaceView {
    /// The reach of the face's plane and where it is crossed, less half a voxel. `levels` are those of the face's axes,
    /// the first divided by the distance.
    #[inline(always)]
    pub(crate) fn crossing<const FUSED: bool>(&self, levels: [f32; 3], tangent: f32) -> (f32, [f32; 2]) {
        let reach = 1.0 / fused_f32::<FUSED>(tangent, self.slopes[0], levels[0]);
        let along = |axis: usize| {
            let direction = fused_f32::<FUSED>(tangent, self.slopes[axis + 1], levels[axis + 1]);
            fused_f32::<FUSED>(direction, reach, self.starts[axis])
        };
        (reach, [along(0), along(1)])
    }

    /// How far from a voxel's middle a crossing may lie to be surely in that voxel.
    #[inline(always)]
    pub(crate) fn room<const FUSED: bool>(&self, reach: f32) -> f32 {
        fused_f32::<FUSED>(-self.growth, reach, self.room)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::Rng;
    use crate::simulate::published::{Experiment, Preset};

    /// Infinite bounds for what is not decided.
    fn error_and_bound<const FUSED: bool>(
        face: &FaceView,
        levels: [f32; 3],
        tangent: f64,
        exact: [f64; 2],
    ) -> (f64, f64) {
        let (reach, places) = face.crossing::<FUSED>(levels, tangent as f32);
        let bound = 0.5 - f64::from(face.room::<FUSED>(reach));
        let error = (0..2).map(|b| (f64::from(places[b]) - exact[b]).abs()).fold(0.0, f64::max);
        (error, if reach > 0.0 && bound < 0.5 { bound } else { f64::INFINITY })
    }

    /// Crossings of random poses against the same in f64: never further off than the bound, and not so much nearer that
    /// the bound could be a tenth of what it is.
    #[test]
    fn crossings_are_within_their_bound() {
        let mut rng = Rng::new(11, 0);
        let mut worst = 0.0_f64;
        for voxel_m in [5.0, 0.5, 0.1] {
            let experiment =
                Experiment { voxel_m, ..Experiment::published(Preset::named("paper-os1-64").unwrap()) };
            let simulator = PublishedBox::new(&experiment).unwrap();
            let faces = Faces::new(&simulator).unwrap();
            for _ in 0..600 {
                let axis = glam::DVec3::new(rng.normal(), rng.normal(), rng.normal()).normalize();
                let rotation = glam::DMat3::from_axis_angle(axis, rng.between(-4.0, 4.0));
                let pose = BoxPose {
                    rows: rotation.transpose().to_cols_array_2d(),
                    origin_m: [rng.between(-24.9, 24.9), rng.between(-24.9, 24.9), rng.between(0.1, 19.9)],
                    turn: 0.0,
                };
                let view = View::new(&simulator, &faces, &pose).unwrap();
                let origin = [25.0, 25.0, 0.0].map(|low| low / voxel_m);
                let origin = [0, 1, 2].map(|axis| pose.origin_m[axis] / voxel_m + origin[axis]);
                for _ in 0..100 {
                    let (sin, cos) = rng.between(0.0, std::f64::consts::TAU).sin_cos();
                    let tangent = rng.between(-faces.steepest, faces.steepest);
                    let levels = pose.rows.map(|row| row[0] * cos + row[1] * sin);
                    for face in &view.faces {
                        let [axis, first, second] = face.axes;
                        let direction = |axis: usize| levels[axis] + tangent * pose.rows[axis][2];
                        let is_far = face.per_distance > 0.0;
                        let wall = if is_far { faces.cells[axis] as f64 } else { 0.0 };
                        let reach = (wall - origin[axis]) / direction(axis);
                        let exact = [first, second].map(|axis| origin[axis] + reach * direction(axis) - 0.5);
                        let inside = |along: usize, place: f64| {
                            (-0.5..=faces.cells[along] as f64 - 0.5).contains(&place)
                        };
                        if reach < 0.0 || !inside(first, exact[0]) || !inside(second, exact[1]) {
                            continue;
                        }
                        let levels = [
                            levels[axis] as f32 * face.per_distance,
                            levels[first] as f32,
                            levels[second] as f32,
                        ];
                        for (error, bound) in [
                            error_and_bound::<true>(face, levels, tangent, exact),
                            error_and_bound::<false>(face, levels, tangent, exact),
                        ] {
                            assert!(error <= bound, "{error} for {bound}: {pose:?}");
                            worst = worst.max(error / bound);
                        }
                    }
                }
            }
        }
        assert!(worst > 0.1, "{worst}");
    }
}
