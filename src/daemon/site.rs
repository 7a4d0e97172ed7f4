//! Where the sensors sit and the platform is, as far as the configuration says.

use std::sync::atomic::{AtomicI64, AtomicU64, Ordering};

use glam::DVec3;

use crate::base::geometry::Pose;
use crate::rig::{CalibrationFile, Mount, MountFile, MountedSensor, NoSlot, Rig};
use crate::simulate::scan::{Scanner, Spin};
use crate::world::coverage::{Coverage, VoxelGrid};
use crate::world::local_origin::LocalOrigin;
use crate::world::placement::Placement;
use crate::world::scene::Scene;
use crate::world::trajectory::Trajectory;

/// Around a platform of which nothing is known, m.
const HALF_SIZE_M: DVec3 = DVec3::new(40.0, 40.0, 10.0);
/// How long a platform that stands is scanned for its prediction: every phase of the spin is met.
const STANDING_NS: u64 = 300_000_000;

/// What is known of mounts, scene and trajectory.
#[derive(Clone, Debug, Default)]
pub struct Site {
    /// Mounts, in the order of the rig's axes.
    pub mount: Option<MountFile>,
    /// What the mounts name of them.
    pub calibrations: Vec<CalibrationFile>,
    /// The rig of these mounts; empty without them.
    pub rig: Rig,
    /// What stands around, for a prediction.
    pub scene: Option<Scene>,
    /// Where the platform is; none for one that stands at the origin.
    pub trajectory: Option<Trajectory>,
    /// Where the frame of scene and trajectory begins in that of their files.
    pub origin: LocalOrigin,
    /// The trajectory begins when recording does, whatever its times.
    pub starts_with_recording: bool,
    /// Edge of a cell of the coverage, m.
    pub voxel_m: f64,
}

impl Site {
    /// The cells that coverage is counted in.
    pub(crate) fn grid(&self) -> VoxelGrid {
        let around = |[low_m, high_m]: [DVec3; 2]| 0.5 * (low_m + high_m);
        let middle_m =
            self.trajectory.as_ref().map_or(DVec3::ZERO, |trajectory| around(trajectory.bounds_m()));
        let unknown = || [middle_m - HALF_SIZE_M, middle_m + HALF_SIZE_M];
        VoxelGrid::centred_on(self.scene.as_ref().map_or_else(unknown, Scene::bounds_m), self.voxel_m)
    }

    /// What a session stores of the trajectory, in the frame of its file; none of one whose times are those of no recording.
    pub(super) fn recorded_trajectory(&self) -> Option<Trajectory> {
        let trajectory = self.trajectory.as_ref().filter(|_| !self.starts_with_recording)?;
        Some(trajectory.moved(self.origin.world_m()))
    }

    /// What is odd about where the platform is in the scene.
    pub(crate) fn doubts(&self) -> Vec<String> {
        let (Some(scene), Some(standing)) = (&self.scene, standing()) else { return Vec::new() };
        let mut doubts = Vec::new();
        if self.trajectory.is_none() && self.origin != LocalOrigin::default() {
            let [x, y, z] = self.origin.world_m().to_array();
            doubts.push(format!(
                "no trajectory: the platform is assumed to stand at ({x:.0}, {y:.0}, {z:.0}) m of the scene's frame; --trajectory says \
                 where it is"
            ));
        }
        let trajectory = self.trajectory.as_ref().unwrap_or(&standing);
        let height_m = if self.rig.sensors.is_empty() { 0.0 } else { self.rig.mean_height_m() };
        doubts.extend(Placement::new(scene, trajectory, height_m, self.origin).doubts);
        doubts
    }

    /// Predicted coverage of the mounts; none without mounts and scene.
    pub(crate) fn predict(&self) -> Option<Coverage> {
        let scene = self.scene.as_ref().filter(|_| !self.rig.sensors.is_empty())?;
        let standing = standing()?;
        let trajectory = self.trajectory.as_ref().unwrap_or(&standing);
        let scanner = Scanner::new(scene, trajectory, &self.rig, Spin::default());
        let mut coverage = Coverage::new(self.grid(), self.rig.sensors.len());
        scanner.cover(&mut coverage);
        Some(coverage)
    }

    /// A sensor of the rig, by name, with its site.
    pub(super) fn mounted(&self, name: &str) -> Option<(usize, &MountedSensor)> {
        self.rig.slot(name).ok().map(|slot| (slot, &self.rig.sensors[slot]))
    }

    /// Why nothing is known of where a sensor sits, though there are mounts.
    pub(super) fn unseated(&self, name: &str) -> Option<NoSlot> {
        self.mount.as_ref().and_then(|_| self.rig.slot(name).err())
    }
}

/// A platform at the origin for as long as it is scanned.
fn standing() -> Option<Trajectory> {
    Trajectory::new(vec![(0, Pose::IDENTITY), (STANDING_NS, Pose::IDENTITY)]).ok()
}

/// What changes while the daemon runs: angles of the axes, and the time at which the trajectory began.
#[derive(Debug)]
pub(super) struct Motion {
    /// Measured, rad, as bits; NaN while not known.
    pitches_rad: Vec<AtomicU64>,
    /// Added to the host's time for that of the trajectory, ns.
    offset_ns: AtomicI64,
}

impl Motion {
    pub(crate) fn new(axes: usize) -> Self {
        let unknown = || AtomicU64::new(f64::NAN.to_bits());
        Self { pitches_rad: (0..axes).map(|_| unknown()).collect(), offset_ns: AtomicI64::new(0) }
    }

    /// An axis was measured.
    pub(crate) fn set_pitch_rad(&self, axis: usize, pitch_rad: f64) {
        if let Some(site) = self.pitches_rad.get(axis) {
            site.store(pitch_rad.to_bits(), Ordering::Relaxed);
        }
    }

    /// Body from sensor now: as mounted, at the angle that its axis measures.
    pub(crate) fn body_from_sensor(&self, axis: usize, mount: &Mount) -> Pose {
        let measured = self.pitches_rad.get(axis).map(|site| f64::from_bits(site.load(Ordering::Relaxed)));
        let pitch_rad = measured.filter(|pitch_rad| pitch_rad.is_finite()).unwrap_or(mount.pitch_rad);
        Mount { pitch_rad, ..*mount }.body_from_sensor()
    }

    /// The trajectory begins at this moment of the host's clock.
    pub(crate) fn begin(&self, trajectory: &Trajectory, host_ns: u64) {
        let offset_ns = trajectory.time_span_ns()[0] as i64 - host_ns as i64;
        self.offset_ns.store(offset_ns, Ordering::Relaxed);
    }

    /// Where the platform is at a moment of the host's clock.
    pub(crate) fn world_from_body(&self, trajectory: Option<&Trajectory>, host_ns: u64) -> Option<Pose> {
        let Some(trajectory) = trajectory else { return Some(Pose::IDENTITY) };
        trajectory.at(host_ns.checked_add_signed(self.offset_ns.load(Ordering::Relaxed))?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::scene::BoxScene;

    /// Of a room around a walk, as read from files that lie `at_m` further from their origin.
    fn moved(at_m: DVec3, has_scene: bool) -> (Site, Trajectory) {
        let walk = Trajectory::straight(DVec3::new(-2.0, 0.5, 1.0), DVec3::new(2.0, 0.5, 1.0), 1.0, 0);
        let walk = walk.moved(at_m);
        let [low_m, high_m] = [DVec3::new(-4.0, -3.0, 0.0), DVec3::new(4.0, 3.0, 3.0)];
        let origin = LocalOrigin::of_box([low_m + at_m, high_m + at_m]);
        let room = BoxScene::closed(low_m + at_m, high_m + at_m).moved(-origin.world_m());
        let model = sensors::catalogue::nominal("vlp-16").unwrap();
        let sensor = MountedSensor { name: "a".into(), model, mount: Mount::default() };
        let mut site = Site { voxel_m: 0.25, origin, ..Site::default() };
        site.rig.sensors.push(sensor);
        site.trajectory = Some(origin.local_trajectory(walk.clone()));
        site.scene = has_scene.then_some(Scene::Box(room));
        (site, walk)
    }

    #[test]
    fn what_lies_in_a_national_grid_is_counted_as_at_the_origin() {
        let utm_m = DVec3::new(412_345.37, 5_567_890.63, 312.2);
        let [(here, _), (there, walk)] = [DVec3::ZERO, utm_m].map(|at_m| moved(at_m, true));
        let [predicted, predicted_there] = [&here, &there].map(|site| site.predict().unwrap());
        assert_eq!(predicted.union_cells(), predicted_there.union_cells());
        assert!(predicted.union_count() > 1000, "{}", predicted.union_count());
        assert_eq!(there.recorded_trajectory().unwrap(), walk, "sessions are in the frame of the files");
        assert!(here.doubts().is_empty() && there.doubts().is_empty(), "{:?}", there.doubts());
        // without a scene the cells lie around the walk
        for at_m in [DVec3::ZERO, DVec3::new(5000.0, 0.0, 0.0), utm_m] {
            let (site, _) = moved(at_m, false);
            let middle_m = site.trajectory.as_ref().unwrap().at(2_000_000_000).unwrap().translation_m;
            let grid = site.grid();
            assert!((grid.centre_m(grid.len() / 2) - middle_m).abs().max_element() < 41.0, "{at_m}");
            assert!(grid.index(middle_m).is_some(), "{at_m}");
        }
    }

    #[test]
    fn a_platform_that_is_nowhere_in_the_scene_is_doubted() {
        let (mut site, walk) = moved(DVec3::new(412_345.0, 5_567_890.0, 0.0), true);
        site.trajectory = Some(walk);
        assert!(site.doubts()[0].contains("the path lies outside the room"), "{:?}", site.doubts());
        site.trajectory = None;
        assert!(site.doubts()[0].contains("stand at (412345, 5567890, 0) m"), "{:?}", site.doubts());
    }

    #[test]
    fn the_trajectory_begins_on_command() {
        let motion = Motion::new(1);
        let trajectory = Trajectory::straight(DVec3::ZERO, DVec3::X, 1.0, 5_000_000_000);
        assert_eq!(motion.world_from_body(None, 7), Some(Pose::IDENTITY));
        assert_eq!(motion.world_from_body(Some(&trajectory), 100_500_000_000), None);
        motion.begin(&trajectory, 100_000_000_000);
        let middle = motion.world_from_body(Some(&trajectory), 100_500_000_000).unwrap();
        assert!((middle.translation_m - DVec3::new(0.5, 0.0, 0.0)).length() < 1e-9);
        assert_eq!(motion.world_from_body(Some(&trajectory), 4), None, "before time began");
    }

    #[test]
    fn what_an_axis_measures_wins() {
        let motion = Motion::new(1);
        let mount = Mount { pitch_rad: 0.1, x_m: 0.2, ..Mount::default() };
        assert_eq!(motion.body_from_sensor(0, &mount), mount.body_from_sensor());
        motion.set_pitch_rad(0, 0.4);
        assert_eq!(motion.body_from_sensor(0, &mount), Mount { pitch_rad: 0.4, ..mount }.body_from_sensor());
        assert_eq!(motion.body_from_sensor(5, &mount), mount.body_from_sensor(), "no such axis");
    }

    #[test]
    fn a_prediction_needs_mounts_and_a_scene() {
        let scene = Scene::Box(BoxScene::closed(DVec3::splat(-3.0), DVec3::splat(3.0)));
        let model = sensors::catalogue::nominal("vlp-16").unwrap();
        let sensor = MountedSensor { name: "a".into(), model, mount: Mount::default() };
        let mut site = Site { scene: Some(scene), voxel_m: 0.5, ..Site::default() };
        assert!(site.predict().is_none());
        site.rig.sensors.push(sensor);
        let seen = site.predict().unwrap().union_count();
        assert!(seen > 20 && (seen as usize) < site.grid().outer_cells().count(), "{seen}");
    }
}
