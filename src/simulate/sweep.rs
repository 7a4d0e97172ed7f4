//! All columns of one sensor of a scanner: what every revolution has in common is worked out once, and neighbouring
//! columns are cast together. What a ray meets does not depend on its company.

use std::borrow::Cow;
use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use super::column::{FiredBeam, beam_at, by_elevation, median, ring};
use super::scan::{Scanner, SimulatedColumn, SimulatedReturn};
use crate::base::geometry::Pose;
use crate::base::rng::Rng;
use crate::world::coverage::Coverage;
use crate::world::scene::Hit;

/// Columns, and beams of each, that are cast together: neighbours on the sphere.
const TILE: usize = 4;

/// Beams of a revolution that are stored rather than made again: 40 MiB.
const MAX_SAVED: usize = 1 << 19;

/// One sensor of a scanner, made ready.
pub struct Sweep<'a> {
    scanner: &'a Scanner<'a>,
    sensor: usize,
    body_from_sensor: Pose,
    /// Channels from the lowest beam to the highest, and where each channel stands among them.
    order: Vec<usize>,
    ranks: Vec<usize>,
    /// Beams of one revolution, column by column; empty where they are too many or too few are asked for.
    turn: Vec<BodyBeam>,
}

/// A beam in the body frame.
#[derive(Clone, Copy)]
struct BodyBeam {
    fired: FiredBeam,
    /// Where the rig itself stops it, m; infinite where it does not.
    stop_m: f64,
}

/// Room for one thread's columns.
#[derive(Default)]
struct Scratch {
    origins_m: Vec<DVec3>,
    directions: Vec<DVec3>,
    met: Vec<Option<Hit>>,
}

impl Scanner<'_> {
    /// A sensor made ready for many columns.
    pub(crate) fn sweep(&self, sensor: usize) -> Sweep<'_> {
        Sweep::new(self, sensor, false)
    }

    /// One column of a sensor; nothing past the trajectory's end.
    pub(crate) fn column(&self, sensor: usize, column: u64) -> Option<SimulatedColumn> {
        let mut made = None;
        Sweep::new(self, sensor, true).columns(column..column + 1, |column| made = Some(column));
        made
    }

    /// Marks every return of the rig in a coverage with one place per sensor of the rig.
    pub fn cover(&self, coverage: &mut Coverage) {
        self.for_each_column(|sensor, column| {
            for simulated in &column.returns {
                coverage.add(sensor, simulated.point_m);
            }
        });
    }

    /// Hands every column of every sensor over, in order; columns are made in parallel.
    pub fn for_each_column(&self, mut take: impl FnMut(usize, &SimulatedColumn)) {
        const AT_ONCE: u64 = 4096;
        const A_THREAD: u64 = 64;
        for sensor in 0..self.rig.sensors.len() {
            let sweep = self.sweep(sensor);
            let columns = self.columns(sensor);
            for first in (0..columns).step_by(AT_ONCE as usize) {
                let parts: Vec<u64> =
                    (first..columns.min(first + AT_ONCE)).step_by(A_THREAD as usize).collect();
                let make = |part: &u64| {
                    let mut made = Vec::new();
                    sweep.columns(*part..columns.min(part + A_THREAD), |column| made.push(column));
                    made
                };
                let made: Vec<_> = parts.par_iter().flat_map_iter(make).collect();
                for column in &made {
                    take(sensor, column);
                }
            }
        }
    }
}

impl<'a> Sweep<'a> {
    /// For many columns, or for `one` only.
    pub(super) fn new(scanner: &'a Scanner<'a>, sensor: usize, one: bool) -> Self {
        let mounted = &scanner.rig.sensors[sensor];
        let order = by_elevation(&mounted.model);
        let mut ranks = vec![0; order.len()];
        order.iter().enumerate().for_each(|(rank, channel)| ranks[*channel] = rank);
        let body_from_sensor = mounted.mount.body_from_sensor();
        let mut sweep = Self { scanner, sensor, body_from_sensor, order, ranks, turn: Vec::new() };
        let per_turn = u64::from(scanner.spins[sensor].columns);
        let beams = per_turn as usize * mounted.model.channels();
        if !one && beams <= MAX_SAVED && scanner.columns(sensor) > per_turn {
            sweep.turn = (0..per_turn).flat_map(|column| sweep.beams_of(column)).collect();
        }
        sweep
    }

    /// Hands columns over, in order; those past the trajectory's end never come.
    pub(crate) fn columns(&self, columns: Range<u64>, mut take: impl FnMut(SimulatedColumn)) {
        let mut scratch = Scratch::default();
        let mut first = columns.start;
        while first < columns.end {
            let end = columns.end.min(first + TILE as u64);
            self.tile(first..end, &mut scratch, &mut take);
            first = end;
        }
    }

    /// Origin (m) and direction, world, of the beams of a column that leave the rig; none past the trajectory's end.
    pub(crate) fn rays(&self, column: u64) -> Vec<(DVec3, DVec3)> {
        let scanner = self.scanner;
        let start_ns = scanner.trajectory.time_span_ns()[0];
        let time_ns = start_ns + scanner.spins[self.sensor].offset_ns(column);
        let Some(world_from_body) = scanner.trajectory.at(time_ns) else { return Vec::new() };
        let beams = self.beams(column);
        let leaving = beams.iter().filter(|beam| beam.stop_m == f64::INFINITY);
        let placed = leaving.map(|BodyBeam { fired, .. }| {
            (world_from_body.transform_point(fired.origin_m), world_from_body.rotate(fired.direction))
        });
        placed.collect()
    }

    /// At most [`TILE`] columns.
    fn tile(&self, columns: Range<u64>, scratch: &mut Scratch, take: &mut impl FnMut(SimulatedColumn)) {
        let scanner = self.scanner;
        let model = &scanner.rig.sensors[self.sensor].model;
        let start_ns = scanner.trajectory.time_span_ns()[0];
        let placed: Vec<(u64, u64, Pose, Cow<'_, [BodyBeam]>)> = columns
            .filter_map(|column| {
                let time_ns = start_ns + scanner.spins[self.sensor].offset_ns(column);
                Some((column, time_ns, scanner.trajectory.at(time_ns)?, self.beams(column)))
            })
            .collect();
        let Scratch { origins_m, directions, met } = scratch;
        origins_m.clear();
        directions.clear();
        let rays = 1 + scanner.sensor_errors.sub_rays as usize;
        for channels in self.order.chunks(TILE) {
            for (_, _, world_from_body, beams) in &placed {
                for channel in channels {
                    let beam = &beams[*channel].fired;
                    let direction = world_from_body.rotate(beam.direction);
                    directions.push(direction);
                    directions.extend(ring(direction, model.divergence_rad, scanner.sensor_errors.sub_rays));
                    let origin_m = world_from_body.transform_point(beam.origin_m);
                    origins_m.extend(std::iter::repeat_n(origin_m, rays));
                }
            }
        }
        met.clear();
        met.resize(directions.len(), None);
        scanner.scene.cast_many(origins_m, directions, |ray, hit| met[ray] = hit);
        for (at, (column, time_ns, _, beams)) in placed.iter().enumerate() {
            let mut rng = Rng::new(scanner.seed, (self.sensor as u64) << 48 | column);
            let one = |(channel, beam): (usize, &BodyBeam)| {
                let (tile, inside) = (self.ranks[channel] / TILE, self.ranks[channel] % TILE);
                let width = TILE.min(self.order.len() - tile * TILE);
                let ray = rays * (tile * TILE * placed.len() + at * width + inside);
                let direction = directions[ray];
                let hit = median(&met[ray..ray + rays]);
                let range_m = scanner.range_m(self.sensor, beam, direction, hit, &mut rng)?;
                let fire_offset_ns = model.beams()[channel].fire_offset_ns;
                Some(SimulatedReturn {
                    channel,
                    azimuth_rad: beam.fired.azimuth_rad,
                    range_m,
                    time_ns: time_ns + fire_offset_ns.max(0.0).round() as u64,
                    point_m: origins_m[ray] + (range_m - beam.fired.range_offset_m) * direction,
                    direction,
                    normal: hit?.normal,
                })
            };
            let mut returns = Vec::with_capacity(beams.len());
            returns.extend(beams.iter().enumerate().filter_map(one));
            let azimuth_rad = scanner.spins[self.sensor].azimuth_rad(*column);
            take(SimulatedColumn { column: *column, time_ns: *time_ns, azimuth_rad, returns });
        }
    }

    fn beams(&self, column: u64) -> Cow<'_, [BodyBeam]> {
        let channels = self.order.len();
        let inside = (column % u64::from(self.scanner.spins[self.sensor].columns)) as usize;
        match self.turn.get(inside * channels..(inside + 1) * channels) {
            Some(beams) => Cow::Borrowed(beams),
            None => Cow::Owned(self.beams_of(column)),
        }
    }

    fn beams_of(&self, column: u64) -> Vec<BodyBeam> {
        let (spin, model) = (&self.scanner.spins[self.sensor], &self.scanner.rig.sensors[self.sensor].model);
        let (azimuth_rad, spin_rad_s) = (spin.azimuth_rad(column), spin.rad_s());
        let beam = |channel| {
            let fired = beam_at(model, channel, azimuth_rad, spin_rad_s, &self.body_from_sensor);
            let solids = self.scanner.occluders[self.sensor].iter();
            let stops_m = solids.filter_map(|solid| solid.distance_m(fired.origin_m, fired.direction));
            BodyBeam { fired, stop_m: stops_m.fold(f64::INFINITY, f64::min) }
        };
        (0..model.channels()).map(beam).collect()
    }
}

impl Scanner<'_> {
    /// The range that a beam reports, m: none where drop-out, obliqueness, an occluder or the limits take the return.
    fn range_m(
        &self,
        sensor: usize,
        beam: &BodyBeam,
        direction: DVec3,
        hit: Option<Hit>,
        rng: &mut Rng,
    ) -> Option<f64> {
        let model = &self.rig.sensors[sensor].model;
        let sensor_errors = &self.sensor_errors;
        // drawn for every beam, so that one beam's fate does not change another's
        let is_returned = sensor_errors.drop_out <= 0.0 || rng.uniform() >= sensor_errors.drop_out;
        let noise_m =
            if sensor_errors.range_noise_m > 0.0 { sensor_errors.range_noise_m * rng.normal() } else { 0.0 };
        let luck = if sensor_errors.detection.is_some() { rng.uniform() } else { 0.0 };
        let hit = hit.filter(|_| is_returned)?;
        if sensor_errors.max_incidence_rad.is_some_and(|limit| -direction.dot(hit.normal) < limit.cos()) {
            return None;
        }
        if beam.stop_m < hit.distance_m {
            return None;
        }
        let min_range_m = sensor_errors.min_range_m.unwrap_or(model.min_range_m);
        let max_range_m = sensor_errors.max_range_m.unwrap_or(model.max_range_m);
        let is_detected = sensor_errors.detection.is_none_or(|detection| {
            luck < detection.probability(hit.distance_m, -direction.dot(hit.normal), model.max_range_m)
        });
        let range_m = hit.distance_m + beam.fired.range_offset_m + noise_m;
        (is_detected && range_m >= min_range_m && range_m <= max_range_m).then_some(range_m)
    }
}
