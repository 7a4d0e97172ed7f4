//! The surface that could be covered: points spread over it, gathered into patches, and which of them can be seen from
//! the path at all.
//!
//! A patch is a cell (of 0.25 m, larger in large places) of a grid that no wall of a plan in whole centimetres lies on, times the axis that its
//! surface faces most. It counts by the number of its points that are observable, which is its area.

use std::collections::{BTreeMap, HashMap};

use glam::DVec3;

use crate::base::rng::Rng;
use crate::world::scene::{BoxScene, Scene};
use crate::world::surface::{Adder, Completeness, SurfaceSamples};

/// Least edge of a patch, m. In a large place patches are larger, so that each has points enough.
pub const PATCH_M: f64 = 0.25;
/// Points that a patch has on average.
const POINTS_PER_PATCH: f64 = 16.0;
/// A sample is covered by a point within this, m.
pub const COVERED_WITHIN_M: f64 = 0.05;
/// Corner of the patches' grid from that of the scene, m: off every whole centimetre.
const CORNER_M: f64 = 0.0707;
/// Patches of fewer observable points say nothing.
const LEAST_POINTS: u32 = 5;

/// Edge of a block with coverage that varies by itself, m: as in [`super::intervals`].
const BLOCK_M: f64 = 2.0;

type Key = ([i32; 3], u8);

/// Points of a surface, in patches.
pub struct Patches {
    samples: SurfaceSamples,
    observable: Vec<bool>,
    patch_of: Vec<u32>,
    centres_m: Vec<DVec3>,
    /// Means of the observable points.
    middles_m: Vec<DVec3>,
    /// Observable points.
    weights: Vec<u32>,
    index: HashMap<Key, u32>,
    patch_m: f64,
    /// Where the grid of patches begins: it goes with the scene, wherever that lies.
    corner_m: DVec3,
}

impl Patches {
    /// `count` points of a scene, seen from these stations. None for a scene without surface.
    pub fn of_scene(scene: &Scene, count: usize, seed: u64, stations_m: &[DVec3]) -> Option<Self> {
        let points = match scene {
            Scene::Mesh(mesh) => mesh.sample_with_normals(count, seed),
            Scene::Box(walls) => box_points(walls, count, seed),
            // cells of a map have no normal: every patch is one of the x axis
            Scene::Voxels(map) => map.occupied_m().map(|point_m| (point_m, DVec3::X)).collect(),
        };
        let samples = SurfaceSamples::new(points.iter().map(|(point_m, _)| *point_m).collect()).ok()?;
        let observable = scene.observable(&samples, stations_m);
        let area_m2 = match scene {
            Scene::Mesh(mesh) => mesh.area_m2(),
            Scene::Box(walls) => faces(walls).iter().map(|(axis, _)| face_area_m2(walls, *axis)).sum(),
            Scene::Voxels(map) => points.len() as f64 * map.voxel_m() * map.voxel_m(),
        };
        let patch_m = (POINTS_PER_PATCH * area_m2 / points.len() as f64).sqrt().max(PATCH_M);
        let corner_m = scene.bounds_m()[0] + CORNER_M;
        Some(Self::gathered(samples, observable, &points, patch_m, corner_m))
    }

    fn gathered(
        samples: SurfaceSamples,
        observable: Vec<bool>,
        points: &[(DVec3, DVec3)],
        patch_m: f64,
        corner_m: DVec3,
    ) -> Self {
        let mut index = HashMap::new();
        let (mut centres_m, mut weights) = (Vec::new(), Vec::new());
        let mut middles_m: Vec<DVec3> = Vec::new();
        let patch_of = points
            .iter()
            .zip(&observable)
            .map(|((point_m, normal), seen)| {
                let key = key(*point_m - corner_m, *normal, patch_m);
                let patch = *index.entry(key).or_insert_with(|| {
                    let corner = DVec3::from(key.0.map(f64::from));
                    centres_m.push((corner + 0.5) * patch_m + corner_m);
                    middles_m.push(DVec3::ZERO);
                    weights.push(0);
                    centres_m.len() as u32 - 1
                });
                if *seen {
                    weights[patch as usize] += 1;
                    middles_m[patch as usize] += *point_m;
                }
                patch
            })
            .collect();
        for (middle_m, weight) in middles_m.iter_mut().zip(&weights) {
            *middle_m /= f64::from((*weight).max(1));
        }
        Self { samples, observable, patch_of, centres_m, middles_m, weights, index, patch_m, corner_m }
    }

    /// Number of patches, observable or not.
    pub(crate) fn len(&self) -> usize {
        self.centres_m.len()
    }

    /// Middle of a patch's cell, m.
    pub(crate) fn centre_m(&self, patch: usize) -> DVec3 {
        self.centres_m[patch]
    }

    /// Middle of a patch's observable points, m: unlike that of its cell it lies on the surface, where this is flat.
    pub(crate) fn middle_m(&self, patch: usize) -> DVec3 {
        self.middles_m[patch]
    }

    /// Block of an edge around a point, counted from the corner of the scene.
    pub(crate) fn block_of(&self, point_m: DVec3, edge_m: f64) -> [i64; 3] {
        ((point_m - self.corner_m) / edge_m).floor().to_array().map(|place| place as i64)
    }

    /// Observable points of a patch; 0 where they are too few to say anything.
    pub(crate) fn weight(&self, patch: usize) -> u32 {
        if self.weights[patch] >= LEAST_POINTS { self.weights[patch] } else { 0 }
    }

    /// Share of the points that can be seen from the path.
    pub(crate) fn observable_share(&self) -> f64 {
        self.observable.iter().filter(|seen| **seen).count() as f64 / self.observable.len() as f64
    }

    /// The patch of a hit.
    pub(crate) fn patch_at(&self, point_m: DVec3, normal: DVec3, scene: &Scene) -> Option<usize> {
        let normal = if matches!(scene, Scene::Voxels(_)) { DVec3::X } else { normal };
        self.index.get(&key(point_m - self.corner_m, normal, self.patch_m)).map(|patch| *patch as usize)
    }

    /// Half of the 95 % interval of the share of observable points that are covered: that of a ratio over blocks (Cochran,
    /// Sampling Techniques, 3rd edition, section 6.4). None without two blocks.
    fn u95_of_share(&self, points: &[bool]) -> Option<f64> {
        let mut blocks: BTreeMap<[i64; 3], [f64; 2]> = BTreeMap::new();
        for ((patch, seen), covered) in self.patch_of.iter().zip(&self.observable).zip(points) {
            if *seen {
                let block = self.block_of(self.centres_m[*patch as usize], BLOCK_M);
                let [found, all] = blocks.entry(block).or_default();
                *found += f64::from(u8::from(*covered));
                *all += 1.0;
            }
        }
        let n = blocks.len() as f64;
        let [found, all] = blocks.values().fold([0.0; 2], |sum, [found, all]| [sum[0] + found, sum[1] + all]);
        let share = found / all;
        let squares: f64 = blocks.values().map(|[found, all]| (found - share * all).powi(2)).sum();
        (n > 1.0).then(|| 1.96 * (n / (n - 1.0) * squares).sqrt() / all)
    }

    /// Patches of which at least half of the observable points are covered.
    pub(crate) fn covered(&self, points: &[bool]) -> Vec<bool> {
        let mut found = vec![0u32; self.len()];
        for ((patch, seen), covered) in self.patch_of.iter().zip(&self.observable).zip(points) {
            found[*patch as usize] += u32::from(*seen && *covered);
        }
        found.iter().zip(&self.weights).map(|(found, all)| *found > 0 && 2 * found >= *all).collect()
    }
}

fn key(from_corner_m: DVec3, normal: DVec3, patch_m: f64) -> Key {
    let cell = (from_corner_m / patch_m).floor();
    ([cell.x as i32, cell.y as i32, cell.z as i32], normal.abs().max_position() as u8)
}

/// Faces that exist: axis, and 0 for the lesser side.
fn faces(walls: &BoxScene) -> Vec<(usize, usize)> {
    let all = (0..3).flat_map(|axis| [(axis, 0), (axis, 1)]);
    all.filter(|(axis, side)| walls.faces[*axis][*side]).collect()
}

fn face_area_m2(walls: &BoxScene, axis: usize) -> f64 {
    let size = walls.max_m - walls.min_m;
    size[(axis + 1) % 3] * size[(axis + 2) % 3]
}

/// Points spread evenly over the faces, each with its normal.
pub(crate) fn box_points(walls: &BoxScene, count: usize, seed: u64) -> Vec<(DVec3, DVec3)> {
    let size = walls.max_m - walls.min_m;
    let faces = faces(walls);
    let whole_m2: f64 = faces.iter().map(|(axis, _)| face_area_m2(walls, *axis)).sum();
    let mut rng = Rng::new(seed, 0);
    let mut points = Vec::with_capacity(count);
    for (axis, side) in faces {
        let of_face = (count as f64 * face_area_m2(walls, axis) / whole_m2).round() as usize;
        let mut normal = DVec3::ZERO;
        normal[axis] = if side == 0 { 1.0 } else { -1.0 };
        for _ in 0..of_face {
            let mut point_m = walls.min_m;
            for other in [(axis + 1) % 3, (axis + 2) % 3] {
                point_m[other] += size[other] * rng.uniform();
            }
            point_m[axis] = if side == 0 { walls.min_m[axis] } else { walls.max_m[axis] };
            points.push((point_m, normal));
        }
    }
    points
}

/// Points found while a recording is replayed.
pub struct SurfaceTally<'a> {
    patches: &'a Patches,
    predicted: Completeness,
    snapped: Completeness,
    placed: Completeness,
}

/// What one thread remembers between points.
pub struct SurfaceAdder([Adder; 3]);

impl<'a> SurfaceTally<'a> {
    /// Nothing found yet.
    pub(crate) fn new(patches: &'a Patches) -> Self {
        let none = || Completeness::new(&patches.samples, &[COVERED_WITHIN_M]);
        Self { patches, predicted: none(), snapped: none(), placed: none() }
    }

    /// A memory for one thread.
    pub(crate) fn adder(&self) -> SurfaceAdder {
        SurfaceAdder([self.predicted.adder(), self.snapped.adder(), self.placed.adder()])
    }

    /// One ray: where it was predicted to end, whether it agreed, where its return was placed.
    #[inline]
    pub(crate) fn add(
        &self,
        adder: &mut SurfaceAdder,
        predicted_m: Option<DVec3>,
        agrees: bool,
        placed_m: Option<DVec3>,
    ) {
        let SurfaceAdder([of_predicted, of_snapped, of_placed]) = adder;
        if let Some(point_m) = predicted_m {
            self.predicted.add(of_predicted, point_m);
            if agrees {
                self.snapped.add(of_snapped, point_m);
            }
        }
        if let Some(point_m) = placed_m {
            self.placed.add(of_placed, point_m);
        }
    }

    /// Makes later points faster; changes no outcome.
    pub(crate) fn settle(&mut self) {
        for completeness in [&mut self.predicted, &mut self.snapped, &mut self.placed] {
            completeness.settle();
        }
    }

    /// What was found.
    pub(crate) fn finish(self) -> SurfaceCovered {
        let both = |completeness: &Completeness| SurfaceShare {
            of_all: completeness.shares()[0],
            of_observable: completeness.share_of(&self.patches.observable, 0),
            u95: self.patches.u95_of_share(&completeness.covered(0)),
        };
        let patches = |completeness: &Completeness| self.patches.covered(&completeness.covered(0));
        SurfaceCovered {
            as_driven: both(&self.predicted),
            recorded: both(&self.snapped),
            placed: both(&self.placed),
            as_driven_patches: patches(&self.predicted),
            recorded_patches: patches(&self.snapped),
            placed_patches: patches(&self.placed),
        }
    }
}

/// Share of a surface's points within 5 cm of a return.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct SurfaceShare {
    /// Of all points.
    pub of_all: f64,
    /// Of those that can be seen from the path; none where nothing can.
    pub of_observable: Option<f64>,
    /// Half of the 95 % interval of that: what other blocks of 2 m of the same place would give.
    pub u95: Option<f64>,
}

/// What a recording covers of a surface.
pub struct SurfaceCovered {
    /// By the predicted points of all recorded rays.
    pub as_driven: SurfaceShare,
    /// By the predicted points of the rays that agree: errors can only lower it.
    pub recorded: SurfaceShare,
    /// By the points as measured: noise and blur raise it.
    pub placed: SurfaceShare,
    /// The same, by patch.
    pub as_driven_patches: Vec<bool>,
    /// The same, by patch.
    pub recorded_patches: Vec<bool>,
    /// The same, by patch.
    pub placed_patches: Vec<bool>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_middle_of_a_patch_lies_on_the_surface() {
        let (low_m, high_m) = (DVec3::new(-2.0, -1.5, -1.5), DVec3::new(3.0, 2.0, 1.2));
        let room = Scene::Box(BoxScene::closed(low_m, high_m));
        let patches = Patches::of_scene(&room, 40_000, 1, &[DVec3::new(0.1, 0.2, 0.5)]).unwrap();
        let mut decided = 0;
        for patch in (0..patches.len()).filter(|patch| patches.weight(*patch) > 0) {
            let at_m = patches.middle_m(patch);
            let off_m = (at_m - low_m).abs().min((at_m - high_m).abs()).min_element();
            assert!(off_m < 1e-9, "{at_m}: {off_m} m off every wall");
            decided += 1;
        }
        assert!(decided > 500, "{decided}");
    }

    #[test]
    fn the_interval_of_a_share_covers_the_truth_as_often_as_it_says() {
        let room = Scene::Box(BoxScene::closed(DVec3::new(-8.0, -8.0, 0.0), DVec3::new(8.0, 8.0, 3.0)));
        let patches = Patches::of_scene(&room, 40_000, 1, &[DVec3::new(0.1, 0.2, 1.5)]).unwrap();
        let mut inside = 0;
        for seed in 0..200 {
            let mut rng = Rng::new(seed, 5);
            // whole patches are covered or not
            let covered: Vec<bool> = (0..patches.len()).map(|_| rng.uniform() < 0.8).collect();
            let points: Vec<bool> = patches.patch_of.iter().map(|patch| covered[*patch as usize]).collect();
            let share = points.iter().filter(|point| **point).count() as f64 / points.len() as f64;
            inside += u32::from((share - 0.8).abs() <= patches.u95_of_share(&points).unwrap());
        }
        // binomial: 190 of 200, 4 standard deviations
        assert!((178..=200).contains(&inside), "{inside}");
    }
}
