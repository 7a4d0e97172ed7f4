//! Ideal sensors along a trajectory through a mesh: what share of its surface they cover.

use std::collections::BTreeMap;

use serde::Serialize;

use super::baselines::{Baselines, Single, by_scans, search_step, strongest};
use super::fan::BeamFan;
use super::scan::{Scanner, Spin};
use crate::rig::{Mount, Rig};
use crate::world::scene::Scene;
use crate::world::surface::{
    Completeness, MAIN_RANK, ObservableSurface, SurfaceSamples, SurfaceShares, THRESHOLDS_M,
};
use crate::world::trajectory::Trajectory;

/// Ideal sensors on their mounts, in a scene along a trajectory.
pub(crate) struct IdealSensors {
    pub scene: Scene,
    pub trajectory: Trajectory,
    pub rig: Rig,
    /// By sensor.
    pub fans: Vec<BeamFan>,
    /// Every so many revolutions one is cast.
    pub scan_stride: u32,
}

/// What ideal sensors cover.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct IdealCoverage {
    #[serde(flatten)]
    pub shares: SurfaceShares,
    /// x_m, y_m, z_m, pitch_deg, roll_deg.
    pub mounts: Vec<[f64; 5]>,
    pub rays: u64,
}

/// What a single ideal sensor covers.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct SingleCoverage {
    #[serde(flatten)]
    pub coverage: IdealCoverage,
    /// Completeness of the mounts less that of the single sensor, percentage points, by threshold.
    pub gain_points: BTreeMap<String, f64>,
}

impl IdealSensors {
    /// Which of these samples have a line of sight from the trajectory.
    pub(crate) fn observable_surface(&self, samples: SurfaceSamples) -> ObservableSurface {
        let stations_m = self.trajectory.sight_stations_m(self.rig.mean_height_m());
        ObservableSurface::new(&self.scene, samples, &stations_m)
    }

    /// What the sensors cover.
    pub(crate) fn cover(&self, surface: &ObservableSurface) -> (IdealCoverage, Completeness) {
        self.cast(&self.mounted_fans().collect::<Vec<_>>(), surface)
    }

    /// Flags of the samples that each sensor covers at 5 cm.
    pub(crate) fn covered_by_sensor(&self, surface: &ObservableSurface) -> Vec<Vec<bool>> {
        self.mounted_fans().map(|fan| self.cast(&[fan], surface).1.covered(MAIN_RANK)).collect()
    }

    fn mounted_fans(&self) -> impl Iterator<Item = (&BeamFan, Mount)> {
        self.fans.iter().zip(self.rig.sensors.iter().map(|sensor| sensor.mount))
    }

    /// Mounts of equal fans are cast together, in their order.
    fn cast(&self, fans: &[(&BeamFan, Mount)], surface: &ObservableSurface) -> (IdealCoverage, Completeness) {
        let mut completeness = Completeness::new(&surface.samples, &THRESHOLDS_M);
        let mut groups: Vec<(&BeamFan, Vec<Mount>)> = Vec::new();
        for (fan, mount) in fans {
            match groups.iter_mut().find(|(other, _)| other == fan) {
                Some((_, mounts)) => mounts.push(*mount),
                None => groups.push((fan, vec![*mount])),
            }
        }
        let cast = |(fan, mounts): &(&BeamFan, Vec<Mount>)| {
            fan.cover(&self.scene, &self.trajectory, mounts, u64::from(self.scan_stride), &mut completeness)
        };
        let rays = groups.iter().map(cast).sum();
        let mounts = fans.iter().map(|(_, mount)| numbers(mount)).collect();
        (IdealCoverage { shares: surface.shares(&completeness), mounts, rays }, completeness)
    }

    /// One level sensor, the best single one, and the first of several without the others.
    pub(crate) fn baselines(
        &self,
        surface: &ObservableSurface,
        of_mounts: &IdealCoverage,
    ) -> Baselines<SingleCoverage> {
        let sensors = &self.rig.sensors;
        let strongest = strongest(&self.rig);
        let alone = |index: usize, mount: Mount| {
            let (coverage, _) = self.cast(&[(&self.fans[index], mount)], surface);
            let gain = |(key, share): (&String, &f64)| {
                (key.clone(), 100.0 * (of_mounts.shares.completeness[key] - share))
            };
            let gain_points = coverage.shares.completeness.iter().map(gain).collect();
            Single::new(&sensors[index].model.name, &mount, SingleCoverage { coverage, gain_points })
        };
        let mounts: Vec<_> = sensors.iter().map(|sensor| sensor.mount).collect();
        let baselines = by_scans(
            &mounts,
            |mount| self.share_of_some(&self.fans[strongest], mount, surface),
            |mount| alone(strongest, mount),
            |seen| seen.coverage.shares.main(),
            "completeness at 0.05 m on some revolutions",
        );
        let first_single = (sensors.len() > 1).then(|| alone(0, sensors[0].mount));
        Baselines { first_single, ..baselines }
    }

    /// The same sensors with their own beams and spins.
    pub(crate) fn scanner(&self) -> Scanner<'_> {
        let mut scanner = Scanner::new(&self.scene, &self.trajectory, &self.rig, Spin::default());
        for (spin, fan) in scanner.spins.iter_mut().zip(&self.fans) {
            (spin.rate_hz, spin.columns) = (fan.rate_hz, fan.columns() as u32);
        }
        scanner
    }

    /// Share of the samples within 5 cm of a hit on some revolutions.
    fn share_of_some(&self, fan: &BeamFan, mount: Mount, surface: &ObservableSurface) -> f64 {
        let mut completeness = Completeness::new(&surface.samples, &THRESHOLDS_M[MAIN_RANK..=MAIN_RANK]);
        let step = search_step(fan.scans(&self.trajectory));
        fan.cover(&self.scene, &self.trajectory, &[mount], step, &mut completeness);
        completeness.shares()[0]
    }
}

fn numbers(mount: &Mount) -> [f64; 5] {
    [mount.x_m, mount.y_m, mount.z_m, mount.pitch_rad.to_degrees(), mount.roll_rad.to_degrees()]
}
