//! A model of coverage from the voxels' side.
//!
//! From each of some places along the trajectory everything around is cast once, by voxel: its place in the frame
//! of the body, and how large it looks. What a sensor sees of a voxel then takes no ray: for each record of it, is there a beam
//! near enough to its direction? The search through a voxel's records ends when it is seen for certain. Directions are exact;
//! only visibility is borrowed from the place between the sensors, so heights are in layers: tables and shelves hide by
//! height.

mod build;
mod kernel;
mod numbering;
mod records;

use glam::{DMat3, DVec3};
use rayon::prelude::*;

pub(crate) use build::CellHasher;
pub(super) use build::reachable_voxels;

use super::{Fan, Sampling, Scans, Seen, View, ViewError, ViewSite};
use crate::base::instructions::Instructions;
use crate::rig::{Rig, Unit};
use kernel::{Counting, CountingReturns, CountingUnion, Eye, Looking, Rows, Sums, Uncertain};
use records::Layer;

/// Voxels that a thread takes at once; sums are added in their order.
const CHUNK: usize = 1024;
/// Candidates of a pass over the voxels, which costs memory traffic: more of them, more is shared.
const BATCH: usize = 16;
/// A search counts what each sensor sees by every so many voxels: J hardly depends on it.
const OVERLAP_STRIDE: usize = 32;
/// Never fewer voxels than this, where there are so many.
const ENOUGH: usize = 1024;

/// Resolution at which a site is stored.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Fineness {
    /// Places along the trajectory: fewer where it has fewer revolutions or memory binds, more along a long walk.
    pub views: u64,
    /// Heights above the body's origin at which visibility is stored, m: minimum, maximum.
    pub heights_m: (f64, f64),
    /// Layers between them, at least 1.
    pub layers: usize,
    /// Neighbouring rays of a view are apart by this share of a voxel where 95 % of the surface is nearer.
    pub step_share: f64,
    /// Bound of the memory, bytes: fewer views are stored where it binds.
    pub most_bytes: usize,
}

impl Fineness {
    /// Views of a search between these heights: a layer every 10 cm, one where the height is fixed.
    pub fn between(heights_m: (f64, f64)) -> Self {
        let all = Self { views: 100, heights_m, layers: 1, step_share: 0.6, most_bytes: 256 << 20 };
        all.with_gaps(0.1)
    }

    /// The same with layers so far apart, m, or nearer.
    pub(crate) fn with_gaps(self, gap_m: f64) -> Self {
        let (low_m, high_m) = self.heights_m;
        let gaps = ((high_m - low_m) / gap_m - 1e-9).ceil().max(0.0) as usize;
        Self { layers: (gaps + 1).min(8), ..self }
    }
}

/// The model of a site.
pub struct CellView {
    units: Vec<CellUnit>,
    heights_m: Vec<f64>,
    layers: Vec<Layer>,
    /// Of the grid, ascending: what can be seen from the trajectory.
    voxels: Vec<u32>,
    /// Voxels that some good rig of the search may miss.
    open: Vec<u32>,
    /// Returns that make a voxel count.
    min_hits: u16,
    cost: BuildCost,
}

/// What the model took.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct BuildCost {
    /// Places along the trajectory.
    pub views: u64,
    /// Heights.
    pub layers: usize,
    /// Angle between neighbouring rays, rad.
    pub step_rad: f64,
    /// Rays cast.
    pub rays: u64,
    /// Bytes held.
    pub bytes: usize,
    /// Fewer views than asked for: memory.
    pub is_bound_by_memory: bool,
    /// Coarser rays than the voxels ask for: time.
    pub is_bound_by_rays: bool,
}

/// A unit's beams as the model takes them.
struct CellUnit {
    fan: Fan,
    rows: Rows,
    /// Revolutions that each view stands for.
    scans_per_view: u32,
}

impl CellView {
    /// The model of a site for sensors of these units.
    ///
    /// # Errors
    /// As those of [`super::CastView::new`], and a scene of which nothing can be seen.
    pub fn new(
        site: &ViewSite,
        units: &[Unit],
        sampling: &Sampling,
        fineness: &Fineness,
    ) -> Result<Self, ViewError> {
        site.check()?;
        let fans: Vec<Fan> =
            units.iter().map(|unit| Fan::new(unit, sampling)).collect::<Result<_, ViewError>>()?;
        let scans: Vec<Scans> =
            fans.iter().map(|fan| Scans::of(fan, &site.trajectory)).collect::<Result<_, ViewError>>()?;
        let built = build::build(site, &fans, &scans[0], fineness)?;
        let unit = |(fan, scans): (Fan, &Scans)| CellUnit {
            rows: Rows::new(&fan),
            scans_per_view: ((scans.count as f64 / built.cost.views as f64).round() as u32).max(1),
            fan,
        };
        Ok(Self {
            units: fans.into_iter().zip(&scans).map(unit).collect(),
            heights_m: built.heights_m,
            open: (0..built.voxels.len() as u32).collect(),
            voxels: built.voxels,
            min_hits: sampling.quality.min_hits,
            layers: built.layers,
            cost: built.cost,
        })
    }

    /// What it took.
    pub fn cost(&self) -> BuildCost {
        self.cost
    }

    /// Voxels of the grid that can be seen from the trajectory, ascending.
    pub(crate) fn observable_cells(&self) -> impl Iterator<Item = usize> + '_ {
        self.voxels.iter().map(|cell| *cell as usize)
    }

    /// Voxels that `see_roughly` takes to be seen.
    pub(crate) fn certain_voxels(&self) -> usize {
        self.voxels.len() - self.open.len()
    }

    /// What each of these rigs of a search sees, by every `stride`-th of the voxels that one of its rigs may miss, and by few
    /// voxels what each sensor does: expectations of the same counts, in a share of the time.
    pub(crate) fn see_roughly(&self, rigs: &[Rig], stride: usize) -> Vec<Seen> {
        let at_most = |stride: usize, voxels: usize| stride.min(voxels / ENOUGH).max(1);
        if self.min_hits > 1 {
            return self.see_sparsely(rigs, at_most(stride, self.voxels.len()));
        }
        let overlap_stride = at_most(OVERLAP_STRIDE, self.voxels.len());
        let stride = at_most(stride, self.open.len());
        let open: Vec<u32> = self.open.iter().step_by(stride).copied().collect();
        let scale = self.open.len() as f64 / open.len().max(1) as f64;
        let certain = self.certain_voxels() as f64;
        rigs.chunks(BATCH)
            .flat_map(|rigs| {
                let eyes: Vec<Vec<Eye<'_>>> = rigs.iter().map(|rig| self.eyes(rig)).collect();
                let chunks: Vec<Vec<f64>> =
                    self.by_chunk(&open, &eyes, |looking| Instructions::best().run(CountingUnion(looking)));
                let mut rough = self.see_sparsely(rigs, overlap_stride);
                for (rig, seen) in rough.iter_mut().enumerate() {
                    let union = certain + scale * chunks.iter().map(|chunk| chunk[rig]).sum::<f64>();
                    seen.overlap *= union / seen.union.max(1.0);
                    seen.union = union;
                }
                rough
            })
            .collect()
    }

    /// What each of these rigs sees, by every `stride`-th voxel.
    pub(crate) fn see_sparsely(&self, rigs: &[Rig], stride: usize) -> Vec<Seen> {
        let chosen: Vec<u32> = (0..self.voxels.len() as u32).step_by(stride).collect();
        let scale = self.voxels.len() as f64 / chosen.len().max(1) as f64;
        rigs.chunks(BATCH).flat_map(|rigs| self.see_batch(rigs, &chosen, scale)).collect()
    }

    /// From now on `see_roughly` takes to be seen what each of these rigs sees for certain: give it the best ones of a search.
    /// Not where a voxel needs several returns.
    pub(crate) fn focus(&mut self, rigs: &[Rig]) {
        if self.min_hits > 1 {
            return;
        }
        let eyes: Vec<Vec<Eye<'_>>> = rigs.iter().map(|rig| self.eyes(rig)).collect();
        let all: Vec<u32> = (0..self.voxels.len() as u32).collect();
        let open = self.by_chunk(&all, &eyes, |looking| Instructions::best().run(Uncertain(looking)));
        self.open = open.concat();
    }

    /// Looks at every voxel again: for another search.
    pub(crate) fn unfocus(&mut self) {
        self.open = (0..self.voxels.len() as u32).collect();
    }

    fn by_chunk<T: Send>(
        &self,
        voxels: &[u32],
        rigs: &[Vec<Eye<'_>>],
        run: impl Fn(Looking<'_>) -> T + Sync,
    ) -> Vec<T> {
        let layers = &self.layers[..];
        voxels.par_chunks(CHUNK).map(|voxels| run(Looking { layers, voxels, rigs })).collect()
    }

    fn eyes(&self, rig: &Rig) -> Vec<Eye<'_>> {
        let eye = |sensor: &crate::rig::MountedSensor| {
            let unit = self.units.iter().find(|unit| unit.fan.model == sensor.model);
            let unit = unit.unwrap_or(&self.units[0]);
            let (axes, origin_m) = unit.fan.body_from_lidar(&sensor.mount);
            self.eye(unit, &axes, origin_m)
        };
        rig.sensors.iter().map(eye).collect()
    }

    fn eye<'a>(&self, unit: &'a CellUnit, axes: &DMat3, origin_m: DVec3) -> Eye<'a> {
        let above = self.heights_m.partition_point(|height_m| *height_m < origin_m.z);
        let last = self.heights_m.len() - 1;
        let (low, high) = (above.saturating_sub(1).min(last), above.min(last));
        let gap_m = self.heights_m[high] - self.heights_m[low];
        let share = if gap_m > 0.0 { (origin_m.z - self.heights_m[low]) / gap_m } else { 0.0 };
        Eye {
            origin_m: origin_m.as_vec3().to_array(),
            axis: (*axes * unit.fan.axis()).as_vec3().to_array(),
            rows: &unit.rows,
            min_range_m: unit.fan.min_range_m as f32,
            max_range_m: unit.fan.max_range_m as f32,
            scans_per_view: unit.scans_per_view,
            layers: [low, high],
            share: share.clamp(0.0, 1.0) as f32,
        }
    }
}

impl View for CellView {
    fn observable(&self) -> u64 {
        self.voxels.len() as u64
    }

    fn see(&self, rigs: &[Rig]) -> Vec<Seen> {
        self.see_sparsely(rigs, 1)
    }
}

impl CellView {
    /// `scale` is by how much more voxels there are than these.
    fn see_batch(&self, rigs: &[Rig], voxels: &[u32], scale: f64) -> Vec<Seen> {
        let eyes: Vec<Vec<Eye<'_>>> = rigs.iter().map(|rig| self.eyes(rig)).collect();
        let chunks: Vec<Vec<Sums>> = self.by_chunk(voxels, &eyes, |looking| match self.min_hits {
            1 => Instructions::best().run(Counting(looking)),
            needed => Instructions::best().run(CountingReturns(looking, needed)),
        });
        let seen = |(rig, eyes): (usize, &Vec<Eye<'_>>)| {
            let mut all = Sums::nothing(eyes.len());
            for chunk in &chunks {
                all.add(&chunk[rig]);
            }
            Seen {
                per_sensor: all.per_sensor.iter().map(|count| scale * count).collect(),
                union: scale * all.union,
                overlap: scale * all.overlap,
                sd_voxels: None,
                rays: 0,
                by_site: Vec::new(),
            }
        };
        eyes.iter().enumerate().map(seen).collect()
    }
}
