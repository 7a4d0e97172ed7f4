//! One point per voxel, in memory that does not grow with the recording.

use std::collections::HashMap;

use glam::DVec3;

/// Bricks of 8 x 8 x 8 voxels that are remembered, twice: 19 MB each. Of a surface that is some ten million voxels.
const BRICKS: usize = 220_000;

/// The voxels of a brick that have a point.
type Occupied = [u64; 8];

/// Lets the first point of every voxel through. Of a larger world the bricks that were met last are remembered.
#[derive(Clone, Debug)]
pub(crate) struct VoxelThinning {
    per_m: f64,
    most: usize,
    recent: HashMap<[i32; 3], Occupied>,
    older: HashMap<[i32; 3], Occupied>,
    forgotten: u64,
}

impl VoxelThinning {
    /// Of voxels with this edge, m.
    pub(crate) fn new(edge_m: f64) -> Self {
        Self {
            per_m: 1.0 / edge_m,
            most: BRICKS,
            recent: HashMap::new(),
            older: HashMap::new(),
            forgotten: 0,
        }
    }

    /// Whether this is the first point of its voxel.
    pub(crate) fn is_first(&mut self, point_m: DVec3) -> bool {
        let voxel = (point_m * self.per_m).floor().to_array().map(|value| value as i64);
        let brick = voxel.map(|value| (value >> 3) as i32);
        let [x, y, z] = voxel.map(|value| (value & 7) as u32);
        if self.recent.len() >= self.most && !self.recent.contains_key(&brick) {
            self.forgotten += self.older.len() as u64;
            self.older = std::mem::take(&mut self.recent);
        }
        let older = &mut self.older;
        let occupied = self.recent.entry(brick).or_insert_with(|| older.remove(&brick).unwrap_or_default());
        let (layer, bit) = (&mut occupied[z as usize], 1 << (8 * y + x));
        let is_first = *layer & bit == 0;
        *layer |= bit;
        is_first
    }

    /// What it could not hold, in words.
    pub(crate) fn notice(&self) -> Option<String> {
        (self.forgotten > 0).then(|| {
            format!(
                "--voxel: the cloud has more voxels than fit in memory: where the rig came back to a place after long, a voxel \
                 may hold two points ({} blocks of 512 voxels were forgotten); a longer edge needs fewer",
                self.forgotten
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_point_of_a_voxel_stays() {
        let mut thinning = VoxelThinning::new(0.1);
        let mut passed = 0;
        for at in 0..1000 {
            let x_m = f64::from(at) * 0.01 - 5.0;
            passed += usize::from(thinning.is_first(DVec3::new(x_m, 0.05, -0.05)));
        }
        assert!((100..=101).contains(&passed), "{passed}");
        assert!(!thinning.is_first(DVec3::new(-4.95, 0.09, -0.01)));
        assert!(thinning.is_first(DVec3::new(-4.95, 0.09, 0.01)));
        assert_eq!(thinning.notice(), None);
    }

    #[test]
    fn memory_stays_bounded_and_that_is_reported() {
        let mut thinning = VoxelThinning { most: 10, ..VoxelThinning::new(1.0) };
        for at in 0..1000 {
            assert!(thinning.is_first(DVec3::new(f64::from(at) * 8.0, 0.0, 0.0)));
            assert!(!thinning.is_first(DVec3::new(f64::from(at) * 8.0 + 0.5, 0.0, 0.0)));
            assert!(thinning.recent.len() + thinning.older.len() <= 20);
        }
        assert!(thinning.notice().is_some());
    }
}
