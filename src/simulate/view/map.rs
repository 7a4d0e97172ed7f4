//! What rigs see of a map that is being recorded.

use std::collections::{HashMap, HashSet};
use std::f64::consts::TAU;

use glam::DVec3;
use sensors::SensorModel;

use super::{Seen, View};
use crate::base::geometry::Pose;
use crate::rig::{MountedSensor, Rig};
use crate::world::scene::{Sight, VoxelMap};

/// Columns of a revolution that are looked along.
const COLUMNS: usize = 180;
/// Beams of a sensor that are looked along, at most; evenly chosen.
const BEAMS: usize = 32;
/// Most poses to look from; evenly chosen.
const POSES: usize = 12;

/// A map made of what was recorded, seen again from the trajectory so far.
///
/// A cell counts once, however often it is seen, from any pose: cells of known surface that a ray meets, and unseen cells
/// next to known surface where a ray meets none, for surface goes on where it was not seen to end (Border, Gammell, Newman
/// 2018, "Surface Edge Explorer", doi:10.1109/ICRA.2018.8461098).
pub(crate) struct MapView<'a> {
    map: &'a VoxelMap,
    /// World from body.
    poses: Vec<&'a Pose>,
}

/// Cells of a map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct MapCells {
    /// Of known surface.
    pub surface: u64,
    /// Unseen, next to known surface.
    pub frontier: u64,
}

impl<'a> MapView<'a> {
    /// `poses` are world from body.
    pub(crate) fn new(map: &'a VoxelMap, poses: &'a [Pose]) -> Self {
        Self { map, poses: evenly(poses, POSES) }
    }

    /// What of the map a rig sees.
    pub(crate) fn cells(&self, rig: &Rig) -> MapCells {
        let by_sensor = rig.sensors.iter().map(|sensor| self.sights(sensor));
        MapCells::of(&by_sensor.flatten().collect())
    }

    fn sights(&self, sensor: &MountedSensor) -> HashSet<Sight> {
        let body_from_sensor = sensor.mount.body_from_sensor();
        let sights_m = sights_m(&sensor.model);
        let mut sights = HashSet::new();
        for world_from_body in &self.poses {
            let world_from_sensor = **world_from_body * body_from_sensor;
            for ends_m in &sights_m {
                let [origin_m, end_m] = ends_m.map(|at_m| world_from_sensor.transform_point(at_m));
                let ray_m = end_m - origin_m;
                let length_m = ray_m.length();
                sights.extend(self.map.look(origin_m, ray_m / length_m, length_m));
            }
        }
        sights
    }
}

impl MapCells {
    fn of(sights: &HashSet<Sight>) -> Self {
        let surface = sights.iter().filter(|sight| matches!(sight, Sight::Surface(_))).count() as u64;
        Self { surface, frontier: sights.len() as u64 - surface }
    }
}

impl View for MapView<'_> {
    /// Cells of known surface and the unseen ones next to it; none without a pose.
    fn observable(&self) -> u64 {
        if self.poses.is_empty() { 0 } else { self.map.sights() }
    }

    fn see(&self, rigs: &[Rig]) -> Vec<Seen> {
        let see = |rig: &Rig| {
            let by_sensor: Vec<_> = rig.sensors.iter().map(|sensor| self.sights(sensor)).collect();
            let mut times = HashMap::<Sight, u32>::new();
            by_sensor.iter().flatten().for_each(|sight| *times.entry(*sight).or_default() += 1);
            let beams = rig.sensors.iter().map(|sensor| sensor.model.channels().min(BEAMS)).sum::<usize>();
            Seen {
                per_sensor: by_sensor.iter().map(|sights| sights.len() as f64).collect(),
                union: times.len() as f64,
                overlap: times.values().filter(|times| **times > 1).count() as f64,
                sd_voxels: None,
                rays: (beams * COLUMNS * self.poses.len()) as u64,
                by_site: Vec::new(),
            }
        };
        rigs.iter().map(see).collect()
    }
}

/// Both ends of what a sensor looks along, in its own frame, m.
fn sights_m(model: &SensorModel) -> Vec<[DVec3; 2]> {
    let channels: Vec<usize> = (0..model.channels()).collect();
    let sights = evenly(&channels, BEAMS).into_iter().flat_map(|channel| {
        (0..COLUMNS).map(|column| {
            let azimuth_rad = TAU * column as f64 / COLUMNS as f64;
            [model.min_range_m, model.max_range_m].map(|range_m| model.point(*channel, azimuth_rad, range_m))
        })
    });
    sights.collect()
}

fn evenly<T>(of: &[T], most: usize) -> Vec<&T> {
    let count = of.len().min(most);
    (0..count).map(|at| &of[at * of.len() / count]).collect()
}
