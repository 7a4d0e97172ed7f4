//! A hash from bricks of 8 x 8 x 8 cells to numbers: space as far as it holds something.

use glam::DVec3;

/// Cells along an edge of a brick.
pub(crate) const EDGE: i32 = 8;
/// Cells of a brick.
pub(crate) const CELLS: usize = 512;
const FREE: u64 = u64::MAX;
/// Brick coordinates are kept in 21 bits each.
const REACH: i32 = 1 << 20;

/// Cell around a point, for cells of edge `1 / per_m`. Saturates far outside, where no brick is.
#[inline]
pub(crate) fn cell_of(point_m: DVec3, per_m: f64) -> [i32; 3] {
    [point_m.x, point_m.y, point_m.z].map(|value| {
        let scaled = value * per_m;
        let towards_zero = scaled as i32;
        // floor, without the function call that it is on processors before SSE 4.1
        towards_zero.saturating_sub(i32::from(scaled < f64::from(towards_zero)))
    })
}

/// Brick of a cell, and the cell's number in it, x fastest.
#[inline]
pub(crate) fn split(cell: [i32; 3]) -> ([i32; 3], usize) {
    // arithmetic shift and mask: floor division by 8 and its rest
    let inside = cell.map(|value| (value & (EDGE - 1)) as usize);
    (cell.map(|value| value >> 3), inside[0] + 8 * (inside[1] + 8 * inside[2]))
}

/// Open addressing with linear probing; bricks get the numbers 0, 1, 2, ... in order of arrival.
#[derive(Clone, Debug, Default)]
pub(crate) struct BrickIndex {
    keys: Vec<u64>,
    slots: Vec<u32>,
    bricks: Vec<[i32; 3]>,
}

impl BrickIndex {
    /// Bricks in order of arrival.
    pub fn bricks(&self) -> &[[i32; 3]] {
        &self.bricks
    }

    /// Number of bricks.
    pub fn len(&self) -> usize {
        self.bricks.len()
    }

    /// Number of a brick, if it exists.
    #[inline]
    pub fn find(&self, brick: [i32; 3]) -> Option<u32> {
        if self.keys.is_empty() {
            return None;
        }
        let key = key(brick)?;
        let mask = self.keys.len() - 1;
        let mut at = start(key, mask);
        loop {
            match self.keys[at] {
                found if found == key => return Some(self.slots[at]),
                FREE => return None,
                _ => at = (at + 1) & mask,
            }
        }
    }

    /// Number of a brick, new if it is. None beyond the reach of the coordinates.
    pub fn find_or_add(&mut self, brick: [i32; 3]) -> Option<u32> {
        if let Some(slot) = self.find(brick) {
            return Some(slot);
        }
        let key = key(brick)?;
        if 2 * (self.bricks.len() + 1) > self.keys.len() {
            self.grow();
        }
        let slot = self.bricks.len() as u32;
        self.bricks.push(brick);
        self.place(key, slot);
        Some(slot)
    }

    fn grow(&mut self) {
        let size = (2 * self.keys.len()).max(64);
        self.keys = vec![FREE; size];
        self.slots = vec![0; size];
        for slot in 0..self.bricks.len() {
            if let Some(key) = key(self.bricks[slot]) {
                self.place(key, slot as u32);
            }
        }
    }

    fn place(&mut self, key: u64, slot: u32) {
        let mask = self.keys.len() - 1;
        let mut at = start(key, mask);
        while self.keys[at] != FREE {
            at = (at + 1) & mask;
        }
        self.keys[at] = key;
        self.slots[at] = slot;
    }
}

#[inline]
fn key(brick: [i32; 3]) -> Option<u64> {
    let mut packed = 0;
    for value in brick {
        if !(-REACH..REACH).contains(&value) {
            return None;
        }
        packed = packed << 21 | (value + REACH) as u64;
    }
    Some(packed)
}

/// Fibonacci hashing (Knuth, The Art of Computer Programming 3, 6.4): the high bits of a product.
#[inline]
fn start(key: u64, mask: usize) -> usize {
    ((key ^ key >> 32).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 20) as usize & mask
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_brick_keeps_its_number() {
        let mut index = BrickIndex::default();
        let brick = |n: i32| [n % 17 - 8, n / 17 % 13 - 6, n / 221 - 20];
        for n in 0..5000 {
            assert_eq!(index.find(brick(n)), None);
            assert_eq!(index.find_or_add(brick(n)), Some(n as u32));
        }
        assert!((0..5000).all(|n| index.find(brick(n)) == Some(n as u32)));
        assert_eq!(index.find_or_add([REACH, 0, 0]), None);
    }

    #[test]
    fn cells_below_zero_stand_in_order() {
        assert_eq!(cell_of(DVec3::new(-0.01, 0.0, 0.99), 2.0), [-1, 0, 1]);
        assert_eq!(split([-1, 0, 9]), ([-1, 0, 1], 7 + 64));
        assert_eq!(split(cell_of(DVec3::splat(f64::INFINITY), 1.0)).0, [i32::MAX / 8; 3]);
    }
}
