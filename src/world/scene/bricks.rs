//! Sparse space: bricks of 8 x 8 x 8 cells, found through a hash of regions of 8 x 8 x 8 bricks. Neighbouring bricks
//! stand in one region's table, so that a walk along a surface stays in the cache.

use glam::DVec3;

/// Cells along an edge of a brick, and bricks along an edge of a region.
pub(crate) const EDGE: i32 = 8;
/// Cells of a brick, and bricks of a region.
pub(crate) const CELLS: usize = 512;
/// Region coordinates are stored in 21 bits each.
const REACH: i32 = 1 << 20;
const FREE: u64 = u64::MAX;
const NONE: u32 = u32::MAX;
/// Regions that have a table from their first brick on: 16 MiB of tables.
const TABLES: usize = 8192;
/// Bricks that any later region lists before it gets one: points that lie far apart have a region each, and tables of 2 KiB
/// for one brick would fill gigabytes. A list takes longer to search.
const LISTED: usize = 8;

/// Cell around a point, for cells of edge `1 / per_m`. Saturates far outside, where no brick is.
#[inline]
pub(crate) fn cell_of(point_m: DVec3, per_m: f64) -> [i32; 3] {
    let cell = |value: f64| {
        let scaled = value * per_m;
        let towards_zero = scaled as i32;
        // floor, without the function call that it is on processors before SSE 4.1
        towards_zero.saturating_sub(i32::from(scaled < f64::from(towards_zero)))
    };
    [cell(point_m.x), cell(point_m.y), cell(point_m.z)]
}

/// Brick of a cell, and the cell's number in it, x fastest. The same from bricks to regions.
#[inline]
pub(crate) fn split([x, y, z]: [i32; 3]) -> ([i32; 3], usize) {
    // arithmetic shift and mask: floor division by 8 and its rest
    let inside = |value: i32| (value & (EDGE - 1)) as usize;
    ([x >> 3, y >> 3, z >> 3], inside(x) + 8 * (inside(y) + 8 * inside(z)))
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
    numbers: Numbers,
}

/// Numbers of a region's bricks by their place in it.
#[derive(Clone, Debug)]
enum Numbers {
    /// Place and number of the first ones; free entries have no number.
    Listed([(u16, u32); LISTED]),
    All(Box<[u32; CELLS]>),
}

impl Numbers {
    /// Of a region that comes after so many others.
    fn after(regions: usize) -> Self {
        if regions < TABLES { Self::All(Box::new([NONE; CELLS])) } else { Self::Listed([(0, NONE); LISTED]) }
    }

    #[inline]
    fn get(&self, place: usize) -> u32 {
        match self {
            Self::All(table) => table[place],
            Self::Listed(list) => listed(list, place),
        }
    }

    fn set(&mut self, place: usize, number: u32) {
        match self {
            Self::All(table) => table[place] = number,
            Self::Listed(list) => match list.iter_mut().find(|(_, listed)| *listed == NONE) {
                Some(free) => *free = (place as u16, number),
                None => {
                    let mut table = Box::new([NONE; CELLS]);
                    list.iter().for_each(|(place, number)| table[usize::from(*place)] = *number);
                    table[place] = number;
                    *self = Self::All(table);
                }
            },
        }
    }
}

/// A function of its own, so that walks along a surface, where regions have tables, stay short.
#[inline(never)]
fn listed(list: &[(u16, u32); LISTED], place: usize) -> u32 {
    list.iter().find(|(listed, _)| usize::from(*listed) == place).map_or(NONE, |(_, number)| *number)
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
    pub(crate) fn bricks(&self) -> &[[i32; 3]] {
        &self.bricks
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        let tables = std::mem::size_of_val(&self.keys[..]) + std::mem::size_of_val(&self.slots[..]);
        let has_table = |region: &&Region| matches!(region.numbers, Numbers::All(_));
        let regions = size_of_val(&self.regions[..])
            + self.regions.iter().filter(has_table).count() * size_of::<[u32; CELLS]>();
        tables + regions + std::mem::size_of_val(&self.bricks[..])
    }

    /// Number of a brick, if it exists.
    pub(crate) fn find(&self, brick: [i32; 3]) -> Option<u32> {
        self.find_near(brick, &mut LastRegion::default())
    }

    /// Number of a brick, new if it is. None beyond the reach of the coordinates.
    pub(crate) fn find_or_add(&mut self, brick: [i32; 3]) -> Option<u32> {
        self.find_or_add_near(brick, &mut LastRegion::default())
    }

    /// As [`BrickIndex::find`], faster when asked about neighbours one after the other.
    #[inline]
    pub(crate) fn find_near(&self, brick: [i32; 3], last: &mut LastRegion) -> Option<u32> {
        let (region, inside) = split(brick);
        if region != last.region {
            *last = LastRegion { region, number: self.region(region) };
        }
        let found = self.regions.get(last.number as usize)?.numbers.get(inside);
        (found != NONE).then_some(found)
    }

    /// As [`BrickIndex::find_or_add`], faster when asked about neighbours one after the other.
    pub(crate) fn find_or_add_near(&mut self, brick: [i32; 3], last: &mut LastRegion) -> Option<u32> {
        let (region, inside) = split(brick);
        if region != last.region || last.number == NONE {
            let mut number = self.region(region);
            if number == NONE {
                number = self.add_region(key(region)?);
            }
            *last = LastRegion { region, number };
        }
        let numbers = &mut self.regions[last.number as usize].numbers;
        let mut number = numbers.get(inside);
        if number == NONE {
            number = self.bricks.len() as u32;
            numbers.set(inside, number);
            self.bricks.push(brick);
        }
        Some(number)
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
        self.regions.push(Region { key, numbers: Numbers::after(self.regions.len()) });
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
    fn a_late_region_lists_a_few_bricks_and_has_a_table_of_many() {
        let mut index = BrickIndex::default();
        let apart = |n: i32| [8 * (n % 256), 8 * (n / 256), 0];
        let tables = TABLES as i32;
        for n in 0..2 * tables {
            assert_eq!(index.find_or_add(apart(n)), Some(n as u32));
        }
        assert!((0..2 * tables).all(|n| index.find(apart(n)) == Some(n as u32)));
        let bytes = index.bytes();
        assert!(bytes < TABLES * 2500, "{bytes} bytes, half of the regions with tables");
        // all of the last region, from its last place to the first: no place is where its number would be
        let near = |n: i32| {
            let corner = apart(2 * tables - 1);
            let [x, y, z] = [n % 8, n / 8 % 8, n / 64];
            [corner[0] + x, corner[1] + y, corner[2] + z]
        };
        for n in (1..512).rev() {
            assert_eq!(index.find(near(n)), None);
            assert_eq!(index.find_or_add(near(n)), Some((2 * tables + 511 - n) as u32));
            assert!((n..512).all(|n| index.find(near(n)) == Some((2 * tables + 511 - n) as u32)), "{n}");
            assert_eq!(index.find(near(0)), Some((2 * tables - 1) as u32));
        }
        assert_eq!(index.bytes() - bytes, size_of::<[u32; CELLS]>() + 511 * size_of::<[i32; 3]>());
    }

    #[test]
    fn cells_below_zero_stand_in_order() {
        assert_eq!(cell_of(DVec3::new(-0.01, 0.0, 0.99), 2.0), [-1, 0, 1]);
        assert_eq!(cell_of(DVec3::new(-1.0, -0.5, -1.01), 2.0), [-2, -1, -3]);
        assert_eq!(split([-1, 0, 9]), ([-1, 0, 1], 7 + 64));
        assert_eq!(split(cell_of(DVec3::splat(f64::INFINITY), 1.0)).0, [i32::MAX / 8; 3]);
    }
}
