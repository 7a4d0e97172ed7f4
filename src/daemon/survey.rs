//! A map of the place, made while recording from a share of what the sensors return, within a bound.

use std::sync::{Mutex, MutexGuard, PoisonError};

use glam::DVec3;

use crate::base::geometry::Pose;
use crate::world::scene::{VoxelMap, VoxelMapError};

/// Returns that are mapped of one revolution.
pub(super) const RAYS: usize = 2000;
/// Longer returns are not mapped, m: their rays cross more cells than they tell about.
const LONGEST_RAY_M: f64 = 80.0;
/// What the map may take, bytes; then it only stays as it is.
const MAX_BYTES: usize = 64 << 20;
/// Poses stored of the trajectory; when there are more, every second one goes.
const MAX_POSES: usize = 256;
/// A pose is stored when the platform has moved so far since the last one, m.
const APART_M: f64 = 0.25;

/// What live threads map.
#[derive(Debug)]
pub(super) struct Survey {
    inner: Mutex<Inner>,
}

#[derive(Debug)]
struct Inner {
    map: VoxelMap,
    poses: Vec<Pose>,
    apart_m: f64,
    is_full: bool,
    /// Recording goes on: only then is there anything to map.
    is_open: bool,
}

impl Survey {
    /// Of cells with this edge, m.
    pub(crate) fn new(voxel_m: f64) -> Result<Self, VoxelMapError> {
        let map = empty(voxel_m)?;
        let inner = Inner { map, poses: Vec::new(), apart_m: APART_M, is_full: false, is_open: false };
        Ok(Self { inner: Mutex::new(inner) })
    }

    /// Recording began: the map starts again.
    pub(crate) fn begin(&self) {
        let mut inner = self.lock();
        if let Ok(map) = empty(inner.map.voxel_m()) {
            inner.map = map; // the edge was good before
        }
        inner.poses.clear();
        (inner.apart_m, inner.is_full, inner.is_open) = (APART_M, false, true);
    }

    /// Recording ended: the map stays as it is.
    pub(crate) fn end(&self) {
        self.lock().is_open = false;
    }

    /// Whether returns are wanted now.
    pub(crate) fn is_open(&self) -> bool {
        self.lock().is_open
    }

    /// Returns of a revolution, each as the sensor's place and the point, world, m, with the last pose of the body.
    pub(crate) fn add(&self, rays_m: &[[DVec3; 2]], world_from_body: &Pose) {
        let mut inner = self.lock();
        if !inner.is_open || rays_m.is_empty() {
            return;
        }
        let last = inner.poses.last();
        let is_far = last
            .is_none_or(|last| last.translation_m.distance(world_from_body.translation_m) > inner.apart_m);
        if is_far {
            inner.poses.push(*world_from_body);
            if inner.poses.len() > MAX_POSES {
                let mut keep = false;
                inner.poses.retain(|_| {
                    keep = !keep;
                    keep
                });
                inner.apart_m *= 2.0;
            }
        }
        inner.is_full = inner.map.bytes() > MAX_BYTES;
        if !inner.is_full {
            rays_m.iter().for_each(|[origin_m, point_m]| inner.map.add_return(*origin_m, *point_m));
        }
    }

    /// The map and the poses as they are now, and whether the map is full.
    pub(crate) fn now(&self) -> (VoxelMap, Vec<Pose>, bool) {
        let inner = self.lock();
        (inner.map.clone(), inner.poses.clone(), inner.is_full)
    }

    /// Memory of the map, bytes.
    pub(crate) fn bytes(&self) -> usize {
        self.lock().map.bytes()
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn empty(voxel_m: f64) -> Result<VoxelMap, VoxelMapError> {
    VoxelMap::new(voxel_m, 1, LONGEST_RAY_M)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_recording_is_mapped_and_the_poses_stay_few() {
        let survey = Survey::new(0.5).unwrap();
        let ray = [[DVec3::ZERO, DVec3::new(5.0, 0.1, 0.1)]];
        survey.add(&ray, &Pose::IDENTITY);
        assert_eq!(survey.now().0.counts(), [0, 0]);
        survey.begin();
        for step in 0..2000 {
            survey.add(&ray, &Pose::from_translation(DVec3::new(f64::from(step) * 0.3, 0.0, 0.0)));
        }
        let (map, poses, is_full) = survey.now();
        assert!(map.counts()[1] == 1 && !is_full && poses.len() <= MAX_POSES && poses.len() > MAX_POSES / 3);
        assert!(poses.last().unwrap().translation_m.x > 500.0, "the newest stay: {}", poses.len());
        survey.end();
        survey.add(&[[DVec3::ZERO, DVec3::Y * 3.0]], &Pose::IDENTITY);
        assert_eq!(survey.now().0.counts(), map.counts(), "what came after the end is left out");
        survey.begin();
        assert_eq!(survey.now().0.counts(), [0, 0]);
        assert!(Survey::new(0.0).is_err());
    }

    #[test]
    fn a_full_map_stays_as_it_is() {
        let survey = Survey::new(0.01).unwrap();
        survey.begin();
        let mut before = 0;
        for turn in 0..4000 {
            let angle_rad = f64::from(turn) * 0.01;
            let rays: Vec<[DVec3; 2]> = (0..200)
                .map(|at| {
                    [
                        DVec3::ZERO,
                        DVec3::new(70.0 * angle_rad.cos(), 70.0 * angle_rad.sin(), f64::from(at) * 0.3),
                    ]
                })
                .collect();
            survey.add(&rays, &Pose::IDENTITY);
            if survey.now_full() {
                before = survey.bytes();
                break;
            }
        }
        assert!(before > MAX_BYTES && before < 2 * MAX_BYTES, "{before}");
        survey.add(&[[DVec3::ZERO, DVec3::Z * -50.0]], &Pose::IDENTITY);
        assert_eq!(survey.bytes(), before);
    }

    impl Survey {
        fn now_full(&self) -> bool {
            self.lock().is_full
        }
    }
}
