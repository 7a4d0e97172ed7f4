//! The ideal spinning sensor: every beam leaves the sensor's origin, at its nominal elevation, in evenly spaced columns.
//! It answers how much of a surface a mount can see, without the calibration of one unit.
//!
//! Convention: at zero angles the sensor has the axes of the mount frame (x right, y forward, z up). Column c of W fires
//! `c / (W rate)` after the revolution began, at azimuth 2 pi c / W counter-clockwise from the sensor's x axis.

use std::f64::consts::TAU;

use glam::{DMat3, DVec3};
use rayon::prelude::*;
use sensors::SensorModel;

use super::rounds::{is_worth_settling, rounds};
use crate::base::geometry::BODY_FROM_MOUNT_FRAME;
use crate::rig::{Mount, Phase};
use crate::world::coverage::{Coverage, VoxelGrid};
use crate::world::scene::Scene;
use crate::world::surface::Completeness;
use crate::world::trajectory::Trajectory;

/// Beams and columns that are cast together: neighbours on the sphere.
const TILE: usize = 4;

/// Beams of an ideal sensor and how it spins.
#[derive(Clone, Debug, PartialEq)]
pub struct BeamFan {
    /// Least range that counts, m.
    pub min_range_m: f64,
    /// Maximum range that counts, m.
    pub max_range_m: f64,
    /// Least cosine between a beam and the normal against it; 0 where any counts.
    pub min_cosine: f64,
    /// Revolutions per second.
    pub rate_hz: f64,
    /// Where the columns of each revolution lie.
    pub phase: Phase,
    /// Where a free phase starts, in steps from column to column.
    pub phase_shift: f64,
    /// Sine and cosine of the azimuth, by column.
    columns: Vec<(f64, f64)>,
    /// Sine and cosine of the elevation, by beam, ascending.
    beams: Vec<(f64, f64)>,
}

impl BeamFan {
    /// The nominal elevations of a model, without its beam offsets and firing times. `columns` per revolution (at least
    /// one) at `rate_hz`.
    pub fn nominal(model: &SensorModel, columns: usize, rate_hz: f64) -> Self {
        let mut elevations_rad: Vec<f64> = model.beams().iter().map(|beam| beam.elevation_rad).collect();
        elevations_rad.sort_by(f64::total_cmp);
        let columns = columns.max(1);
        let azimuths_rad = (0..columns).map(|column| TAU * column as f64 / columns as f64);
        Self {
            min_range_m: model.min_range_m,
            max_range_m: model.max_range_m,
            min_cosine: 0.0,
            rate_hz,
            phase: Phase::Locked,
            phase_shift: 0.0,
            columns: azimuths_rad.map(f64::sin_cos).collect(),
            beams: elevations_rad.into_iter().map(f64::sin_cos).collect(),
        }
    }

    /// Columns per revolution.
    pub(crate) fn columns(&self) -> usize {
        self.columns.len()
    }

    /// Beams.
    pub(crate) fn beams(&self) -> usize {
        self.beams.len()
    }

    /// Rays of one revolution.
    pub(crate) fn rays_per_scan(&self) -> u64 {
        (self.columns.len() * self.beams.len()) as u64
    }

    /// Whole revolutions that fit the trajectory's span.
    pub fn scans(&self, trajectory: &Trajectory) -> u64 {
        let [start_ns, end_ns] = trajectory.time_span_ns();
        // a span measured in nanoseconds may be half of one short of its whole revolutions
        ((end_ns - start_ns) as f64 * 1e-9 * self.rate_hz + 1e-6).floor() as u64
    }

    /// The voxels that each of these mounts sees along the whole trajectory, and the rays cast.
    pub(crate) fn coverage(
        &self,
        scene: &Scene,
        trajectory: &Trajectory,
        mounts: &[Mount],
        grid: &VoxelGrid,
    ) -> (Coverage, u64) {
        let jobs: Vec<(u64, usize)> = (0..self.scans(trajectory))
            .flat_map(|scan| (0..mounts.len()).map(move |sensor| (scan, sensor)))
            .collect();
        let nothing = || Coverage::new(grid.clone(), mounts.len());
        let parts: Vec<Coverage> = jobs
            .par_chunks(jobs.len().div_ceil(rayon::current_num_threads()).max(1))
            .map(|jobs| {
                let mut coverage = nothing();
                for (scan, sensor) in jobs {
                    let add = |hit_m| coverage.add(*sensor, hit_m);
                    self.cast_scan(scene, trajectory, &mounts[*sensor], *scan, add);
                }
                coverage
            })
            .collect();
        let mut coverage = nothing();
        parts.iter().for_each(|part| coverage.join(part));
        (coverage, jobs.len() as u64 * self.rays_per_scan())
    }

    /// Casts one revolution of a sensor; `hit` gets every point within the range limits, world, m.
    pub fn cast_scan(
        &self,
        scene: &Scene,
        trajectory: &Trajectory,
        mount: &Mount,
        scan: u64,
        hit: impl FnMut(DVec3),
    ) {
        let columns: Vec<usize> = (0..self.columns.len()).collect();
        self.cast_columns(scene, trajectory, mount, scan, &columns, hit);
    }

    /// Casts some columns of one revolution, by number.
    pub(crate) fn cast_columns(
        &self,
        scene: &Scene,
        trajectory: &Trajectory,
        mount: &Mount,
        scan: u64,
        columns: &[usize],
        mut hit: impl FnMut(DVec3),
    ) {
        let body_from_sensor_m = BODY_FROM_MOUNT_FRAME * mount.position_m();
        let body_from_sensor_axes = BODY_FROM_MOUNT_FRAME * mount.rotation();
        let [start_ns, end_ns] = trajectory.time_span_ns();
        let first = self.phase.turn(scan, self.phase_shift) / self.columns.len() as f64;
        let (first_sin, first_cos) = (TAU * first).sin_cos();
        let (mut origins_m, mut directions) = (Vec::new(), Vec::new());
        for tile in columns.chunks(TILE) {
            let placed = tile.iter().filter_map(|column| {
                let turn = first + *column as f64 / self.columns.len() as f64;
                let time_ns = start_ns + ((scan as f64 + turn) / self.rate_hz * 1e9).round() as u64;
                let world_from_body = trajectory.at(time_ns.min(end_ns))?;
                let origin_m = world_from_body.transform_point(body_from_sensor_m);
                let axes = DMat3::from_quat(world_from_body.rotation) * body_from_sensor_axes;
                let (sin, cos) = self.columns[*column];
                let azimuth = (sin * first_cos + cos * first_sin, cos * first_cos - sin * first_sin);
                Some((origin_m, axes, azimuth))
            });
            let placed: Vec<(DVec3, DMat3, (f64, f64))> = placed.collect();
            for beams in self.beams.chunks(TILE) {
                origins_m.clear();
                directions.clear();
                for (origin_m, axes, (sin_azimuth, cos_azimuth)) in &placed {
                    for (sin, cos) in beams {
                        origins_m.push(*origin_m);
                        directions.push(*axes * DVec3::new(cos_azimuth * cos, sin_azimuth * cos, *sin));
                    }
                }
                scene.cast_many(&origins_m, &directions, |ray, met| {
                    let Some(met) = met else { return };
                    let is_square =
                        self.min_cosine == 0.0 || -met.normal.dot(directions[ray]) >= self.min_cosine;
                    if is_square && (self.min_range_m..=self.max_range_m).contains(&met.distance_m) {
                        hit(origins_m[ray] + met.distance_m * directions[ray]);
                    }
                });
            }
        }
    }

    /// Casts every `step`-th revolution of every sensor and counts the hits. Returns the number of rays.
    pub fn cover(
        &self,
        scene: &Scene,
        trajectory: &Trajectory,
        mounts: &[Mount],
        step: u64,
        completeness: &mut Completeness,
    ) -> u64 {
        let scans: Vec<u64> = (0..self.scans(trajectory)).step_by(step.max(1) as usize).collect();
        for (round, chosen) in rounds(scans.len() as u64).iter().enumerate() {
            let scans = chosen.iter().map(|index| scans[*index as usize]);
            let jobs: Vec<(u64, &Mount)> =
                scans.flat_map(|scan| mounts.iter().map(move |mount| (scan, mount))).collect();
            let shared = &*completeness;
            jobs.par_iter().for_each(|(scan, mount)| {
                let mut adder = shared.adder();
                self.cast_scan(scene, trajectory, mount, *scan, |hit_m| shared.add(&mut adder, hit_m));
            });
            if is_worth_settling(round) {
                completeness.settle();
            }
        }
        scans.len() as u64 * mounts.len() as u64 * self.rays_per_scan()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::geometry::Pose;
    use crate::world::scene::BoxScene;

    fn room() -> Scene {
        Scene::Box(BoxScene::closed(DVec3::new(-5.0, -4.0, 0.0), DVec3::new(5.0, 4.0, 3.0)))
    }

    fn fan() -> BeamFan {
        BeamFan::nominal(&sensors::catalogue::nominal("vlp-16").unwrap(), 8, 10.0)
    }

    fn standing(seconds: u64) -> Trajectory {
        let pose = Pose::from_translation(DVec3::new(0.0, 0.0, 1.5));
        Trajectory::new(vec![(7, pose), (7 + seconds * 1_000_000_000, pose)]).unwrap()
    }

    #[test]
    fn column_zero_looks_right_and_the_next_quarter_ahead() {
        let mut hits = Vec::new();
        let mount = Mount { z_m: 0.1, ..Mount::default() };
        fan().cast_scan(&room(), &standing(1), &mount, 0, |hit| hits.push(hit));
        assert_eq!(hits.len(), 8 * 16);
        // right of the body is -y; elevations of +-1 deg are nearest to the horizon
        let right = hits.iter().find(|hit| hit.x.abs() < 1e-9 && (hit.z - 1.6).abs() < 0.1).unwrap();
        assert!((right.y + 4.0).abs() < 1e-9, "{right}");
        let ahead = hits.iter().filter(|hit| (hit.x - 5.0).abs() < 1e-9 && hit.y.abs() < 1e-9).count();
        assert_eq!(ahead, 16);
    }

    #[test]
    fn pitch_tips_the_sensor_to_the_right() {
        let mount = Mount { pitch_rad: std::f64::consts::FRAC_PI_2, ..Mount::default() };
        let mut hits = Vec::new();
        fan().cast_scan(&room(), &standing(1), &mount, 0, |hit| hits.push(hit));
        // the spin axis lies along the mount's x (right), column 0 looks down, column 2 ahead
        assert!(hits.iter().any(|hit| hit.z.abs() < 1e-9 && hit.x.abs() < 1e-9));
        assert!(hits.iter().all(|hit| hit.y.abs() < 4.0), "no beam reaches the side walls");
    }

    #[test]
    fn a_free_phase_turns_every_revolution_by_another_share_of_a_column() {
        let azimuths_of = |phase: Phase, scan: u64| {
            let mut azimuths_rad = Vec::new();
            BeamFan { phase, ..fan() }.cast_scan(&room(), &standing(1), &Mount::default(), scan, |hit| {
                // the mount's x axis points right, to the body's -y
                azimuths_rad.push((hit.x).atan2(-hit.y).rem_euclid(TAU));
            });
            azimuths_rad.sort_by(f64::total_cmp);
            azimuths_rad
        };
        let locked = azimuths_of(Phase::Locked, 3);
        assert!(
            locked
                .iter()
                .all(|azimuth| (azimuth / TAU * 8.0).fract().min(1.0 - (azimuth / TAU * 8.0).fract()) < 1e-9)
        );
        for scan in 0..3 {
            let turn = Phase::Free.turn(scan, 0.0);
            let free = azimuths_of(Phase::Free, scan);
            assert_eq!(free.len(), locked.len());
            assert!(free.iter().all(|azimuth| ((azimuth / TAU * 8.0).fract() - turn).abs() < 1e-9), "{scan}");
        }
    }

    #[test]
    fn only_whole_revolutions_count() {
        assert_eq!(fan().scans(&standing(2)), 20);
        let walk = Trajectory::straight(DVec3::ZERO, DVec3::X, 1.0 / 0.95, 0);
        assert_eq!(fan().scans(&walk), 9);
        assert_eq!(fan().scans(&Trajectory::new(vec![(0, Pose::IDENTITY)]).unwrap()), 0);
    }
}
