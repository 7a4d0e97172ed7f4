//! Sparse space: bricks of 8 x 8 x 8 cells, found through a hash of regions of 8 x 8 x 8 bricks. Neighbouring bricks
//! stand in one region's table, so that a walk along a surface stays in the cache.

use glam::DVec3;

/// Cells along an edge of a brick, and bricks along an edge of a region.
pub(crate) const EDGE: i32 = 8;
/// Cells of a brick, and bricks of a region.
pub(crate) const CELLS: usize = 512;
/// Region coordinates are kept in 21 bits each.
const REACH: i32 = 1 << 20;
const FREE: u64 = u64::MAX;
const NONE: u32 = u32::MAX;

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

/// Brick of a cell, and the cell's number in it, x fastest. The same from bricks to regions.
#[inline]
pub(crate) fn split(cell: [i32; 3]) -> ([i32; 3], usize) {
    // arithmetic shift and mask: floor division by 8 and its rest
    let inside = cell.map(|value| (value & (EDGE - 1)) as usize);
    (cell.map(|value| value >> 3), inside[0] + 8 * (inside[1] + 8 * inside[2]))
}

/// Numbers of bricks: 0, 1, 2, ... in order of arrival. Open addressing with linear probing over regions.
#[derive(Clone, Debug, Default)]
pub(crate) struct BrickIndex {
    keys: Vec<u64>,
    slots: Vec<u32>,
    regions: Vec<Region>,
    bricks: Vec<[i32; 3]>,
}

#[derive(Clone, Debug)]
struct Region {
    key: u64,
    bricks: Box<[u32; CELLS]>,
}

/// The region that was asked for last: the next question is likely about the same one.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LastRegion {
    region: [i32; 3],
    number: u32,
}

impl Default for LastRegion {
    fn default() -> Self {
        // outside the reach of region coordinates, so nothing is there
        Self { region: [i32::MAX; 3], number: NONE }
    }
}

impl BrickIndex {
    /// Bricks in order of arrival.
    pub fn bricks(&self) -> &[[i32; 3]] {
        &self.bricks
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        let tables = std::mem::size_of_val(&self.keys[..]) + std::mem::size_of_val(&self.slots[..]);
        let regions = self.regions.len() * (size_of::<Region>() + size_of::<[u32; CELLS]>());
        tables + regions + std::mem::size_of_val(&self.bricks[..])
    }

    /// Number of a brick, if it exists.
    pub fn find(&self, brick: [i32; 3]) -> Option<u32> {
        self.find_near(brick, &mut LastRegion::default())
    }

    /// Number of a brick, new if it is. None beyond the reach of the coordinates.
    pub fn find_or_add(&mut self, brick: [i32; 3]) -> Option<u32> {
        self.find_or_add_near(brick, &mut LastRegion::default())
    }

    /// As [`BrickIndex::find`], faster when asked about neighbours one after the other.
    #[inline]
    pub fn find_near(&self, brick: [i32; 3], last: &mut LastRegion) -> Option<u32> {
        let (region, inside) = split(brick);
        if region != last.region {
            *last = LastRegion { region, number: self.region(region) };
        }
        let found = self.regions.get(last.number as usize)?.bricks[inside];
        (found != NONE).then_some(found)
    }

    /// As [`BrickIndex::find_or_add`], faster when asked about neighbours one after the other.
    pub fn find_or_add_near(&mut self, brick: [i32; 3], last: &mut LastRegion) -> Option<u32> {
        let (region, inside) = split(brick);
        if region != last.region || last.number == NONE {
            let mut number = self.region(region);
            if number == NONE {
                number = self.add_region(key(region)?);
            }
            *last = LastRegion { region, number };
        }
        let place = &mut self.regions[last.number as usize].bricks[inside];
        if *place == NONE {
            *place = self.bricks.len() as u32;
            self.bricks.push(brick);
        }
        Some(*place)
    }

    fn region(&self, region: [i32; 3]) -> u32 {
        let Some(key) = key(region) else { return NONE };
        if self.keys.is_empty() {
            return NONE;
        }
        let mask = self.keys.len() - 1;
        let mut at = start(key, mask);
        while self.keys[at] != key {
            if self.keys[at] == FREE {
                return NONE;
            }
            at = (at + 1) & mask;
        }
        self.slots[at]
    }

    fn add_region(&mut self, key: u64) -> u32 {
        self.regions.push(Region { key, bricks: Box::new([NONE; CELLS]) });
        if 2 * self.regions.len() > self.keys.len() {
            let size = (2 * self.keys.len()).max(64);
            self.keys = vec![FREE; size];
            self.slots = vec![0; size];
            for number in 0..self.regions.len() {
                self.place(self.regions[number].key, number as u32);
            }
        } else {
            self.place(key, self.regions.len() as u32 - 1);
        }
        self.regions.len() as u32 - 1
    }

    fn place(&mut self, key: u64, number: u32) {
        let mask = self.keys.len() - 1;
        let mut at = start(key, mask);
        while self.keys[at] != FREE {
            at = (at + 1) & mask;
        }
        self.keys[at] = key;
        self.slots[at] = number;
    }
}

fn key(region: [i32; 3]) -> Option<u64> {
    let mut packed = 0;
    for value in region {
        if !(-REACH..REACH).contains(&value) {
            return None;
        }
        packed = packed << 21 | (value + REACH) as u64;
    }
    Some(packed)
}

/// Fibonacci hashing (Knuth, The Art of Computer Programming 3, 6.4): the high bits of a product.
fn start(key: u64, mask: usize) -> usize {
    ((key ^ key >> 32).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 20) as usize & mask
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_brick_keeps_its_number() {
        let mut index = BrickIndex::default();
        let brick = |n: i32| [31 * (n % 17 - 8), 7 * (n / 17 % 13 - 6), n / 221 - 20];
        let mut last = LastRegion::default();
        for n in 0..5000 {
            assert_eq!(index.find_near(brick(n), &mut last), None);
            assert_eq!(index.find_or_add_near(brick(n), &mut last), Some(n as u32));
        }
        assert!((0..5000).all(|n| index.find(brick(n)) == Some(n as u32)));
        assert!((0..5000).all(|n| index.find_or_add_near(brick(n), &mut last) == Some(n as u32)));
        assert_eq!(index.find_or_add([8 * REACH, 0, 0]), None);
        assert_eq!(index.find([i32::MAX; 3]), None);
        assert_eq!((index.bricks().len(), index.bricks()[77]), (5000, brick(77)));
    }

    #[test]
    fn cells_below_zero_stand_in_order() {
        assert_eq!(cell_of(DVec3::new(-0.01, 0.0, 0.99), 2.0), [-1, 0, 1]);
        assert_eq!(cell_of(DVec3::new(-1.0, -0.5, -1.01), 2.0), [-2, -1, -3]);
        assert_eq!(split([-1, 0, 9]), ([-1, 0, 1], 7 + 64));
        assert_eq!(split(cell_of(DVec3::splat(f64::INFINITY), 1.0)).0, [i32::MAX / 8; 3]);
    }
}
