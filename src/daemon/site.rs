//! Where the sensors sit and the platform is, as far as the configuration says.

use std::sync::atomic::{AtomicI64, AtomicU64, Ordering};

use glam::DVec3;

use crate::base::geometry::Pose;
use crate::rig::{CalibrationFile, Mount, MountFile, MountedSensor, NoSlot, Rig};
use crate::simulate::scan::{Scanner, Spin};
use crate::world::coverage::{Coverage, VoxelGrid};
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
    /// The trajectory begins when recording does, whatever its times.
    pub starts_with_recording: bool,
    /// Edge of a cell of the coverage, m.
    pub voxel_m: f64,
}

impl Site {
    /// The cells that coverage is counted in.
    pub(crate) fn grid(&self) -> VoxelGrid {
        let bounds_m = self.scene.as_ref().map_or([-HALF_SIZE_M, HALF_SIZE_M], Scene::bounds_m);
        VoxelGrid::centred_on(bounds_m, self.voxel_m)
    }

    /// Predicted coverage of the mounts; none without mounts and scene.
    pub(crate) fn predict(&self) -> Option<Coverage> {
        let scene = self.scene.as_ref().filter(|_| !self.rig.sensors.is_empty())?;
        let standing = Trajectory::new(vec![(0, Pose::IDENTITY), (STANDING_NS, Pose::IDENTITY)]).ok()?;
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
