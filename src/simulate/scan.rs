//! What spinning sensors on a moving body return: for each sensor, column (at its own time) and channel
//! `world_from_body(t) * body_from_sensor * SensorModel::ray`, cast into the scene.
//!
//! A column is a pure function of the scanner's settings and its own number: columns can be made in any order, on any
//! number of threads, with the same bytes.

use std::f64::consts::TAU;

use glam::DVec3;

use super::detection::Detection;
use super::occluder::Occluder;
use crate::rig::Rig;
use crate::world::scene::Scene;
use crate::world::trajectory::Trajectory;

/// How a sensor spins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spin {
    /// Revolutions per second.
    pub rate_hz: f64,
    /// Columns per revolution.
    pub columns: u32,
    /// Encoder azimuth at the start of the trajectory, rad.
    pub phase_rad: f64,
    /// Seen from above, as Ouster and Velodyne sensors turn; else the reverse.
    pub clockwise: bool,
}

impl Default for Spin {
    /// 10 revolutions per second of 1024 columns, clockwise.
    fn default() -> Self {
        Self { rate_hz: 10.0, columns: 1024, phase_rad: 0.0, clockwise: true }
    }
}

impl Spin {
    /// Angular rate of the encoder azimuth, rad/s.
    pub(crate) fn rad_s(&self) -> f64 {
        if self.clockwise { TAU * self.rate_hz } else { -TAU * self.rate_hz }
    }

    /// Encoder azimuth of a column, rad in [0, 2 pi).
    pub(crate) fn azimuth_rad(&self, column: u64) -> f64 {
        let share = (column % u64::from(self.columns)) as f64 / f64::from(self.columns);
        let turn = if self.clockwise { share } else { -share };
        (self.phase_rad + TAU * turn).rem_euclid(TAU)
    }

    /// Time from the start to a column, ns.
    pub(crate) fn offset_ns(&self, column: u64) -> u64 {
        (column as f64 / (self.rate_hz * f64::from(self.columns)) * 1e9).round() as u64
    }
}

/// What is less than perfect about a return. The default is perfect.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct SensorErrors {
    /// Replaces the model's least range, m.
    pub min_range_m: Option<f64>,
    /// Replaces the model's maximum range, m.
    pub max_range_m: Option<f64>,
    /// Standard deviation of a range, m.
    pub range_noise_m: f64,
    /// Surfaces seen more obliquely than this angle from their normal return nothing, rad.
    pub max_incidence_rad: Option<f64>,
    /// Share of returns lost at random.
    pub drop_out: f64,
    /// Returns lost because too little light comes back.
    pub detection: Option<Detection>,
    /// Rays spread over the model's divergence around the central one; the median range is reported.
    pub sub_rays: u32,
}

/// One simulated return.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SimulatedReturn {
    /// Channel.
    pub channel: usize,
    /// Encoder azimuth at which the channel fired, rad.
    pub azimuth_rad: f64,
    /// As the sensor reports it, m.
    pub range_m: f64,
    /// When the channel fired, ns.
    pub time_ns: u64,
    /// World, m.
    pub point_m: DVec3,
    /// Direction of the ray, world, unit.
    pub direction: DVec3,
    /// Unit normal of the surface, turned against the ray.
    pub normal: DVec3,
}

/// One simulated column.
#[derive(Clone, Debug, PartialEq)]
pub struct SimulatedColumn {
    /// Number since the start of the trajectory.
    pub column: u64,
    /// Its time stamp, ns.
    pub time_ns: u64,
    /// Encoder azimuth at the time stamp, rad.
    pub azimuth_rad: f64,
    /// By channel, in order; channels without a return are absent.
    pub returns: Vec<SimulatedReturn>,
}

/// A rig that scans a scene along a trajectory.
#[derive(Clone, Debug)]
pub struct Scanner<'a> {
    /// What is scanned.
    pub scene: &'a Scene,
    /// Trajectory of the body.
    pub trajectory: &'a Trajectory,
    /// Sensors.
    pub rig: &'a Rig,
    /// By sensor of the rig.
    pub spins: Vec<Spin>,
    /// Solids in the body frame that stop beams, by sensor of the rig. A beam that meets one returns nothing.
    pub occluders: Vec<Vec<Occluder>>,
    /// What is less than perfect.
    pub sensor_errors: SensorErrors,
    /// Of noise and drop-out.
    pub seed: u64,
    /// Returns of all sensors together that make a voxel count in a prediction.
    pub min_hits: u16,
}

impl<'a> Scanner<'a> {
    /// Perfect sensors that all spin in one direction; the other sensors' housings stop beams.
    pub fn new(scene: &'a Scene, trajectory: &'a Trajectory, rig: &'a Rig, spin: Spin) -> Self {
        let sensors = rig.sensors.len();
        Self {
            scene,
            trajectory,
            rig,
            spins: vec![spin; sensors],
            occluders: (0..sensors).map(|sensor| Occluder::other_housings(rig, sensor)).collect(),
            sensor_errors: SensorErrors::default(),
            seed: 0,
            min_hits: 1,
        }
    }

    /// Solids of the body that are no housing: the person who carries the rig.
    pub(crate) fn operator(&self) -> Vec<Occluder> {
        let of_first = self.occluders.first().into_iter().flatten();
        of_first.filter(|solid| matches!(solid, Occluder::Capsule { .. })).copied().collect()
    }

    /// Columns of a sensor within the trajectory's span.
    pub(crate) fn columns(&self, sensor: usize) -> u64 {
        let [start_ns, end_ns] = self.trajectory.time_span_ns();
        let spin = &self.spins[sensor];
        let last = (end_ns - start_ns) as f64 * 1e-9 * spin.rate_hz * f64::from(spin.columns);
        let mut columns = last.floor() as u64 + 1;
        while columns > 1 && spin.offset_ns(columns - 1) > end_ns - start_ns {
            columns -= 1;
        }
        columns
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::column::{ColumnCaster, beam_at};
    use super::*;
    use crate::base::rng::Rng;
    use crate::rig::{Mount, MountedSensor};
    use crate::world::coverage::{Coverage, VoxelGrid};
    use crate::world::scene::{BoxScene, Mesh};

    fn room() -> Scene {
        Scene::Box(BoxScene::closed(DVec3::new(-5.0, -4.0, 0.0), DVec3::new(5.0, 4.0, 3.0)))
    }

    fn pair() -> Rig {
        let model = sensors::catalogue::nominal("vlp-16").unwrap();
        let mount = Mount { x_m: 0.1, pitch_rad: 0.3, ..Mount::default() };
        Rig::mirrored(vec![MountedSensor { name: "right".into(), model, mount }])
    }

    fn walk() -> Trajectory {
        Trajectory::straight(DVec3::new(-2.0, 0.0, 1.6), DVec3::new(2.0, 0.0, 1.6), 10.0, 1_000)
    }

    fn spin() -> Spin {
        Spin { columns: 90, ..Spin::default() }
    }

    #[test]
    fn every_return_lies_on_the_room_and_under_its_own_range() {
        let (scene, rig, trajectory) = (room(), pair(), walk());
        let scanner = Scanner::new(&scene, &trajectory, &rig, spin());
        let mut seen = 0;
        scanner.for_each_column(|sensor, column| {
            let world_from_body = trajectory.at(column.time_ns).unwrap();
            let world_from_sensor = world_from_body * rig.sensors[sensor].mount.body_from_sensor();
            for back in &column.returns {
                let ray = rig.sensors[sensor].model.ray(back.channel, back.azimuth_rad);
                let again = world_from_sensor.transform_point(ray.at_range(back.range_m));
                assert!(again.distance(back.point_m) < 1e-9);
                let p = back.point_m;
                let off_m = [5.0 - p.x.abs(), 4.0 - p.y.abs(), p.z, 3.0 - p.z];
                assert!(off_m.iter().any(|off| off.abs() < 1e-9) && off_m.iter().all(|off| *off > -1e-9));
                seen += 1;
            }
        });
        assert_eq!(scanner.columns(0), 361);
        assert!(seen > 2 * 361 * 14, "{seen}");
    }

    #[test]
    fn the_plain_column_equals_the_perfect_scanner() {
        let (scene, rig, trajectory) = (room(), pair(), walk());
        let mut scanner = Scanner::new(&scene, &trajectory, &rig, spin());
        scanner.occluders = vec![Vec::new(); 2];
        let column = scanner.column(1, 200).unwrap();
        let world_from_sensor =
            trajectory.at(column.time_ns).unwrap() * rig.sensors[1].mount.body_from_sensor();
        let caster = ColumnCaster::new(&rig.sensors[1].model);
        let ranges_m = caster.cast(&scene, world_from_sensor, column.azimuth_rad, scanner.spins[1].rad_s());
        assert_eq!(column.returns.len(), 16);
        for back in &column.returns {
            assert!((ranges_m[back.channel].unwrap() - back.range_m).abs() < 1e-9);
        }
    }

    /// Triangles everywhere, so that neighbouring rays meet different ones.
    fn scatter() -> Scene {
        let mut rng = Rng::new(3, 0);
        let mut point = |spread: f64| spread * DVec3::new(rng.normal(), rng.normal(), rng.normal());
        let corners: Vec<DVec3> = (0..3000)
            .flat_map(|_| {
                let at = point(5.0);
                [at, at + point(0.7), at + point(0.7)]
            })
            .collect();
        let triangles = (0..3000).map(|n| [3 * n, 3 * n + 1, 3 * n + 2]).collect();
        Scene::Mesh(Arc::new(Mesh::new(corners, triangles).unwrap()))
    }

    #[test]
    fn beams_return_the_same_alone_in_a_column_and_in_company() {
        let (scene, rig, trajectory) = (scatter(), pair(), walk());
        let mut scanner = Scanner::new(&scene, &trajectory, &rig, spin());
        scanner.occluders = vec![Vec::new(); 2];
        let mut seen = 0;
        scanner.for_each_column(|sensor, column| {
            assert_eq!(scanner.column(sensor, column.column).as_ref(), Some(column));
            let world_from_body = trajectory.at(column.time_ns).unwrap();
            let (model, mount) = (&rig.sensors[sensor].model, rig.sensors[sensor].mount.body_from_sensor());
            let spin_rad_s = scanner.spins[sensor].rad_s();
            let alone: Vec<_> = (0..model.channels())
                .filter_map(|channel| {
                    let beam = beam_at(model, channel, column.azimuth_rad, spin_rad_s, &mount);
                    let direction = world_from_body.rotate(beam.direction);
                    let hit = scene.cast(world_from_body.transform_point(beam.origin_m), direction)?;
                    let range_m = hit.distance_m + beam.range_offset_m;
                    let in_limits = (model.min_range_m..=model.max_range_m).contains(&range_m);
                    in_limits.then_some((channel, range_m, hit.normal, direction))
                })
                .collect();
            let back = |back: &SimulatedReturn| (back.channel, back.range_m, back.normal, back.direction);
            assert_eq!(column.returns.iter().map(back).collect::<Vec<_>>(), alone);
            let ranges_m = ColumnCaster::new(model).cast(
                &scene,
                world_from_body * mount,
                column.azimuth_rad,
                spin_rad_s,
            );
            assert_eq!(ranges_m.iter().flatten().count(), alone.len());
            seen += alone.len();
        });
        assert!(seen > 361 * 16, "{seen}");
    }

    #[test]
    fn threads_do_not_change_a_byte_and_seeds_do() {
        let (scene, rig, trajectory) = (room(), pair(), walk());
        let mut scanner = Scanner::new(&scene, &trajectory, &rig, spin());
        scanner.sensor_errors =
            SensorErrors { range_noise_m: 0.02, drop_out: 0.1, ..SensorErrors::default() };
        let all = |scanner: &Scanner, threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let mut columns = Vec::new();
                scanner.for_each_column(|_, column| columns.push(column.clone()));
                columns
            })
        };
        let one = all(&scanner, 1);
        assert_eq!(one, all(&scanner, 3));
        scanner.seed = 1;
        assert_ne!(one, all(&scanner, 1));
    }

    #[test]
    fn sensor_errors_remove_returns() {
        let (scene, rig, trajectory) = (room(), pair(), walk());
        let count = |change: &dyn Fn(&mut Scanner)| {
            let mut scanner = Scanner::new(&scene, &trajectory, &rig, spin());
            change(&mut scanner);
            let mut returns = 0;
            scanner.for_each_column(|_, column| returns += column.returns.len());
            returns
        };
        let all = count(&|scanner| scanner.occluders = vec![Vec::new(); 2]);
        assert_eq!(all, 2 * 361 * 16);
        assert!(count(&|_| ()) < all, "the other housing blocks rays");
        assert!(count(&|scanner| scanner.sensor_errors.max_range_m = Some(3.0)) < all / 2);
        assert!(count(&|scanner| scanner.sensor_errors.max_incidence_rad = Some(1.0)) < all * 9 / 10);
        let dropped = count(&|scanner| {
            scanner.occluders = vec![Vec::new(); 2];
            scanner.sensor_errors.drop_out = 0.25;
        });
        assert!((dropped as f64 / all as f64 - 0.75).abs() < 0.02, "{dropped} of {all}");
        let spread = count(&|scanner| {
            scanner.occluders = vec![Vec::new(); 2];
            scanner.sensor_errors.sub_rays = 6;
        });
        assert_eq!(spread, all);
    }

    #[test]
    fn of_two_sensors_in_one_place_neither_sees_anything() {
        let (scene, trajectory) = (room(), walk());
        let mut rig = pair();
        rig.sensors[1].mount = rig.sensors[0].mount;
        let mut scanner = Scanner::new(&scene, &trajectory, &rig, spin());
        let count = |scanner: &Scanner| {
            let mut returns = [0, 0];
            scanner.for_each_column(|sensor, column| returns[sensor] += column.returns.len());
            returns
        };
        assert_eq!(count(&scanner), [0, 0], "each stands inside the other's housing");
        scanner.occluders = vec![Vec::new(); 2];
        assert_eq!(count(&scanner), [361 * 16; 2], "without housings both see the same");
    }

    #[test]
    fn coverage_is_marked_for_each_sensor() {
        let (scene, rig, trajectory) = (room(), pair(), walk());
        let grid = VoxelGrid::centred_on(scene.bounds_m(), 0.25);
        let mut coverage = Coverage::new(grid, 2);
        Scanner::new(&scene, &trajectory, &rig, spin()).cover(&mut coverage);
        let counts = coverage.counts();
        assert_eq!(coverage.outside(), 0);
        assert!(counts.union > 2000 && counts.overlap > 0 && counts.unique_per_sensor.iter().all(|n| *n > 0));
    }
}
