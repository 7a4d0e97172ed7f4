//! Every beam cast; only the bit of its voxel is stored.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicU16, Ordering};

use glam::{DMat3, DVec3};
use rayon::prelude::*;
use sensors::SensorModel;

use super::cells::reachable_voxels;
use super::tiles::{self, Marks, Tiles};
use super::{Fan, Sampling, Scans, Seen, Shades, View, ViewError, ViewSite};
use crate::base::instructions::Instructions;
use crate::rig::{Mount, Rig, Unit};
use crate::simulate::occluder::Occluder;
use crate::world::coverage::{Counts, Coverage};

/// Beams and columns that are cast together in double precision: neighbours on the sphere.
const TILE: usize = 4;
/// Bitmaps of all rigs, sensors and threads of a pass, bytes.
const BITMAP_BYTES: usize = 256 << 20;

/// Distances at which beams are stopped, column by column, m.
type Shade = Vec<f32>;

/// By sensor; none where nothing blocks its beams.
type ShadesOfRig = Vec<Option<Shade>>;

/// Returns of a rig by voxel.
type Hits = Vec<AtomicU16>;

/// With how many digits beams are cast.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// Single precision where the scene is a mesh: some voxels of a hundred thousand may differ.
    Single,
    /// Double precision: what hashes are compared with.
    Double,
}

/// The exact view.
pub struct CastView {
    site: ViewSite,
    units: Vec<(Fan, Scans)>,
    precision: Precision,
    /// Returns that make a voxel count.
    min_hits: u16,
    instructions: Instructions,
    observable: OnceLock<u64>,
}

impl CastView {
    /// A view of a site by sensors of these units; every sensor of a rig must be one of them.
    ///
    /// # Errors
    /// A trajectory shorter than a revolution, a grid of too many voxels, ranges out of order.
    pub fn new(
        site: ViewSite,
        units: &[Unit],
        sampling: &Sampling,
        precision: Precision,
    ) -> Result<Self, ViewError> {
        site.check()?;
        let fan = |unit: &Unit| {
            let fan = Fan::new(unit, sampling)?;
            let scans = Scans::of(&fan, &site.trajectory)?;
            Ok((fan, scans))
        };
        let units = units.iter().map(fan).collect::<Result<_, ViewError>>()?;
        Ok(Self {
            site,
            units,
            precision,
            min_hits: sampling.quality.min_hits,
            instructions: Instructions::best(),
            observable: OnceLock::new(),
        })
    }

    /// The same with given instructions.
    pub fn with_instructions(self, instructions: Instructions) -> Self {
        Self { instructions, ..self }
    }

    /// The same with the first column of every revolution turned on by so many columns.
    pub(crate) fn at_phase(&self, phase: f64) -> Self {
        self.changed(|(fan, scans)| (fan.at_phase(phase), *scans))
    }

    /// The same with one revolution in so many.
    pub(crate) fn every(&self, times: u64) -> Self {
        self.changed(|(fan, scans)| (fan.clone(), scans.every(times)))
    }

    fn changed(&self, unit: impl Fn(&(Fan, Scans)) -> (Fan, Scans)) -> Self {
        Self {
            site: self.site.clone(),
            units: self.units.iter().map(unit).collect(),
            precision: self.precision,
            min_hits: self.min_hits,
            instructions: self.instructions,
            observable: self.observable.clone(),
        }
    }

    /// Where it looks.
    pub fn site(&self) -> &ViewSite {
        &self.site
    }

    /// The beams of a model and the revolutions that are cast.
    pub(crate) fn fan_of(&self, model: &SensorModel) -> &(Fan, Scans) {
        &self.units[self.unit(model)]
    }

    /// The revolutions of the first unit that are cast.
    pub(super) fn scans(&self) -> &Scans {
        &self.units[0].1
    }

    /// Beams of a rig.
    pub fn rays(&self, rig: &Rig) -> u64 {
        let of = |model: &SensorModel| {
            let (fan, scans) = self.fan_of(model);
            fan.rays_per_scan() * scans.count
        };
        rig.sensors.iter().map(|sensor| of(&sensor.model)).sum()
    }

    /// The voxels that each sensor of a rig sees.
    pub fn cover(&self, rig: &Rig) -> Coverage {
        let bitmaps = self.bitmaps(std::slice::from_ref(rig)).swap_remove(0);
        Coverage::from_bitmaps(self.site.grid.clone(), bitmaps)
    }

    /// The unit of a model, which is one of those that the view was made for.
    fn unit(&self, model: &SensorModel) -> usize {
        self.units.iter().position(|(fan, _)| fan.model == *model).unwrap_or(0)
    }

    /// By rig and sensor.
    fn bitmaps(&self, rigs: &[Rig]) -> Vec<Vec<Vec<u64>>> {
        let words = self.site.grid.len().div_ceil(64);
        let nothing = || -> Vec<Vec<Vec<u64>>> {
            rigs.iter().map(|rig| vec![vec![0; words]; rig.sensors.len()]).collect()
        };
        let is_counting = self.min_hits > 1;
        let voxels = if is_counting { self.site.grid.len() } else { 0 };
        let no_hits = |_: &Rig| -> Hits { (0..voxels).map(|_| AtomicU16::new(0)).collect() };
        let hits: Vec<Hits> = rigs.iter().map(no_hits).collect();
        let shades: Vec<ShadesOfRig> = rigs
            .par_iter()
            .map(|rig| (0..rig.sensors.len()).map(|at| self.shade(rig, at)).collect())
            .collect();
        let jobs: Vec<(usize, u64)> = (0..self.units.len())
            .filter(|unit| {
                let mut sensors = rigs.iter().flat_map(|rig| &rig.sensors);
                sensors.any(|sensor| self.unit(&sensor.model) == *unit)
            })
            .flat_map(|unit| (0..self.units[unit].1.count).map(move |scan| (unit, scan)))
            .collect();
        // neighbouring scans cost alike: every thread takes every n-th of them
        let threads = rayon::current_num_threads().min(jobs.len()).max(1);
        let parts: Vec<_> = (0..threads)
            .into_par_iter()
            .map(|thread| {
                let mut bitmaps = nothing();
                for (unit, scan) in jobs.iter().skip(thread).step_by(threads) {
                    self.cast_scan(*unit, *scan, (rigs, &shades, &hits), &mut bitmaps);
                }
                bitmaps
            })
            .collect();
        let mut bitmaps = parts
            .into_iter()
            .reduce(|mut all, part| {
                let sensors = all.iter_mut().flatten().zip(part.iter().flatten());
                for (bitmap, more) in sensors {
                    bitmap.iter_mut().zip(more).for_each(|(word, more)| *word |= more);
                }
                all
            })
            .unwrap_or_else(nothing);
        for (bitmaps, hits) in bitmaps.iter_mut().zip(&hits).filter(|_| is_counting) {
            for (at, hits) in hits.chunks(64).enumerate() {
                let bit = |(bit, hits): (usize, &AtomicU16)| {
                    u64::from(hits.load(Ordering::Relaxed) >= self.min_hits) << bit
                };
                let enough = hits.iter().enumerate().map(bit).fold(0, |word, bit| word | bit);
                bitmaps.iter_mut().for_each(|bitmap| bitmap[at] &= enough);
            }
        }
        bitmaps
    }

    /// One revolution of every sensor of a unit.
    fn cast_scan(
        &self,
        unit: usize,
        scan: u64,
        (rigs, shades, hits): (&[Rig], &[ShadesOfRig], &[Hits]),
        bitmaps: &mut [Vec<Vec<u64>>],
    ) {
        let (fan, scans) = &self.units[unit];
        let poses = scans.poses(&self.site.trajectory, scan);
        for (((rig, shades), hits), bitmaps) in rigs.iter().zip(shades).zip(hits).zip(bitmaps) {
            for ((sensor, shade), bitmap) in rig.sensors.iter().zip(shades).zip(bitmaps) {
                let shade = shade.as_deref();
                if self.unit(&sensor.model) != unit {
                    continue;
                }
                let columns = columns(fan, &sensor.mount, &poses);
                let marks = Marks { bitmap, hits };
                match self.site.scene.mesh() {
                    Some(mesh) if self.precision == Precision::Single => {
                        let tiles = Tiles { site: &self.site, mesh, fan, instructions: self.instructions };
                        tiles.mark(&columns, shade, marks);
                    }
                    _ => self.mark_precise(fan, (&columns, shade), marks),
                }
            }
        }
    }

    /// How far each beam of a sensor gets before the rig or its operator blocks it, column by column.
    fn shade(&self, rig: &Rig, sensor: usize) -> Option<Shade> {
        let Shades { has_housings, operator } = &self.site.shades;
        let mut occluders: Vec<Occluder> = operator.iter().copied().collect();
        if *has_housings {
            occluders.extend(Occluder::other_housings(rig, sensor));
        }
        if occluders.is_empty() {
            return None;
        }
        let (fan, _) = self.fan_of(&rig.sensors[sensor].model);
        let in_body = vec![(DMat3::IDENTITY, DVec3::ZERO); fan.columns];
        let columns = columns(fan, &rig.sensors[sensor].mount, &in_body);
        let distance_m = |column: usize, number: usize| {
            let beam = fan.beam(column, number);
            let (axes, origin_m) = &columns[tiles::shifted(column, beam.shift, columns.len())];
            let (from_m, along) = (*origin_m + *axes * beam.origin_m, *axes * beam.direction);
            let met = occluders.iter().filter_map(|occluder| occluder.distance_m(from_m, along));
            met.fold(f64::INFINITY, f64::min) as f32
        };
        let of_column = |column: usize| (0..fan.beams.len()).map(move |number| (column, number));
        Some(
            (0..fan.columns).flat_map(of_column).map(|(column, number)| distance_m(column, number)).collect(),
        )
    }

    fn mark_precise(
        &self,
        fan: &Fan,
        (columns, shade): (&[(DMat3, DVec3)], Option<&[f32]>),
        mut marks: Marks<'_>,
    ) {
        let (mut origins_m, mut directions) = (Vec::new(), Vec::new());
        // of each beam what its range counts before its origin, and how far it gets, m
        let mut limits_m: Vec<(f64, f64)> = Vec::new();
        for first in (0..columns.len()).step_by(TILE) {
            for numbers in (0..fan.beams.len()).collect::<Vec<_>>().chunks(TILE) {
                origins_m.clear();
                directions.clear();
                limits_m.clear();
                for column in first..columns.len().min(first + TILE) {
                    for number in numbers {
                        let beam = fan.beam(column, *number);
                        let (axes, origin_m) = &columns[tiles::shifted(column, beam.shift, columns.len())];
                        origins_m.push(*origin_m + *axes * beam.origin_m);
                        directions.push(*axes * beam.direction);
                        let free_m =
                            shade.map_or(f32::INFINITY, |free_m| free_m[column * fan.beams.len() + number]);
                        limits_m.push((beam.range_offset_m, f64::from(free_m)));
                    }
                }
                let is_square =
                    |cosine: &dyn Fn() -> f64| fan.min_cosine == 0.0 || cosine() >= fan.min_cosine;
                let mut met = |ray: usize, distance_m: f64, cosine: &dyn Fn() -> f64| {
                    let (offset_m, free_m) = limits_m[ray];
                    let is_in_range = (fan.min_range_m..=fan.max_range_m).contains(&(distance_m + offset_m));
                    if !(is_in_range && distance_m < free_m && is_square(cosine)) {
                        return;
                    }
                    let point_m = origins_m[ray] + distance_m * directions[ray];
                    if let Some(cell) = self.site.grid.index(point_m) {
                        marks.mark(cell);
                    }
                };
                match self.site.scene.mesh() {
                    Some(mesh) => mesh.cast_precise(&origins_m, &directions, |ray, hit| {
                        if let Some((distance_m, triangle)) = hit {
                            met(ray, distance_m, &|| mesh.cosine(triangle, directions[ray]));
                        }
                    }),
                    None => self.site.scene.cast_many(&origins_m, &directions, |ray, hit| {
                        if let Some(hit) = hit {
                            met(ray, hit.distance_m, &|| -hit.normal.dot(directions[ray]));
                        }
                    }),
                }
            }
        }
    }
}

impl View for CastView {
    fn observable(&self) -> u64 {
        let units: Vec<&Fan> = self.units.iter().map(|(fan, _)| fan).collect();
        *self.observable.get_or_init(|| reachable_voxels(&self.site, &units, &self.units[0].1))
    }

    fn see(&self, rigs: &[Rig]) -> Vec<Seen> {
        let sensors = rigs.iter().map(|rig| rig.sensors.len()).max().unwrap_or(1).max(1);
        let bytes_of_rig = self.site.grid.len().div_ceil(8) * sensors * (rayon::current_num_threads() + 1);
        let bytes_of_hits = if self.min_hits > 1 { 2 * self.site.grid.len() } else { 0 };
        let bytes_of_rig = bytes_of_rig + bytes_of_hits;
        let together = (BITMAP_BYTES / bytes_of_rig.max(1)).max(1);
        let seen = |rigs: &[Rig]| {
            let bitmaps = self.bitmaps(rigs);
            let of = |(rig, bitmaps): (&Rig, &Vec<Vec<u64>>)| {
                let bitmaps: Vec<&[u64]> = bitmaps.iter().map(Vec::as_slice).collect();
                Seen::exact(&Counts::of_bitmaps(&bitmaps), self.rays(rig))
            };
            rigs.iter().zip(&bitmaps).map(of).collect::<Vec<_>>()
        };
        rigs.chunks(together).flat_map(seen).collect()
    }
}

/// World from the frame of each column of a sensor: axes, and origin, m.
fn columns(fan: &Fan, mount: &Mount, poses: &[(DMat3, DVec3)]) -> Vec<(DMat3, DVec3)> {
    let (body_from_lidar, origin_m) = fan.body_from_lidar(mount);
    let column = |(column, (axes, body_m)): (usize, &(DMat3, DVec3))| {
        (fan.axes_of_column(&(*axes * body_from_lidar), column), *body_m + *axes * origin_m)
    };
    poses.iter().enumerate().map(column).collect()
}
