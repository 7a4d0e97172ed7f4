//! Hits that lie far from all the rest: one wrong point a hundred kilometres off is no part of a place.

use std::collections::HashMap;

use glam::DVec3;

use super::VoxelMap;
use crate::world::scene::bricks::EDGE;

/// A group of cells is left out where it holds less than one in so many of those of the largest group; a few cells alone
/// sooner.
const ONE_IN: u64 = 100;
const FEW: u64 = 3;
const ONE_IN_OF_FEW: u64 = 10;

/// What was left out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Strays {
    /// Cells that were hit.
    pub cells: u64,
    /// One of them, m.
    pub at_m: DVec3,
}

impl VoxelMap {
    /// Forgets the hits of small groups of cells that lie further than `gap_m` from all others.
    pub(crate) fn drop_strays(&mut self, gap_m: f64) -> Option<Strays> {
        let block = |brick: [i32; 3]| {
            let edge = (gap_m / (f64::from(EDGE) * self.voxel_m)).ceil().clamp(1.0, 1e9) as i32;
            brick.map(|at| at.div_euclid(edge))
        };
        let hit = |number: usize| {
            let ends = self.bricks[number].ends.as_ref();
            ends.map_or(0, |ends| ends.hits.iter().filter(|hits| **hits > 0).count() as u64)
        };
        let mut blocks: HashMap<[i32; 3], u64> = HashMap::new();
        for (number, brick) in self.index.bricks().iter().enumerate() {
            let cells = hit(number);
            if cells > 0 {
                *blocks.entry(block(*brick)).or_default() += cells;
            }
        }
        let groups = groups(&blocks);
        let largest = groups.values().copied().max()?;
        let is_stray = |brick: [i32; 3]| {
            let one_in = |cells: u64| if cells <= FEW { ONE_IN_OF_FEW } else { ONE_IN };
            groups.get(&block(brick)).is_some_and(|cells| cells * one_in(*cells) < largest)
        };
        let places: Vec<[i32; 3]> = self.index.bricks().to_vec();
        let stray: Vec<usize> =
            (0..places.len()).filter(|number| hit(*number) > 0 && is_stray(places[*number])).collect();
        let first = places[*stray.first()?];
        let cells = stray.iter().map(|number| hit(*number)).sum();
        let corner = |brick: [i32; 3]| f64::from(EDGE) * self.voxel_m * DVec3::from(brick.map(f64::from));
        let at_m = corner(first);
        for number in &stray {
            self.bricks[*number].ends = None;
        }
        self.bricks_with_ends -= stray.len();
        self.hit_cells = self.bounds_of_hits();
        Some(Strays { cells, at_m })
    }

    fn bounds_of_hits(&self) -> Option<[[i32; 3]; 2]> {
        let mut bounds: Option<[[i32; 3]; 2]> = None;
        for (brick, place) in self.bricks.iter().zip(self.index.bricks()) {
            let Some(ends) = &brick.ends else { continue };
            for inside in (0..ends.hits.len()).filter(|inside| ends.hits[*inside] > 0) {
                let edge = [inside % 8, inside / 8 % 8, inside / 64].map(|at| at as i32);
                let cell = [0, 1, 2].map(|axis| place[axis] * EDGE + edge[axis]);
                let [low, high] = bounds.unwrap_or([cell, cell]);
                let low = [0, 1, 2].map(|axis| low[axis].min(cell[axis]));
                bounds = Some([low, [0, 1, 2].map(|axis| high[axis].max(cell[axis]))]);
            }
        }
        bounds
    }
}

/// For each block the cells of its group, of blocks that touch.
fn groups(blocks: &HashMap<[i32; 3], u64>) -> HashMap<[i32; 3], u64> {
    let mut of: HashMap<[i32; 3], usize> = HashMap::new();
    let mut cells = Vec::new();
    for start in blocks.keys() {
        if of.contains_key(start) {
            continue;
        }
        let group = cells.len();
        cells.push(0);
        of.insert(*start, group);
        let mut open = vec![*start];
        while let Some(block) = open.pop() {
            cells[group] += blocks[&block];
            for neighbour in 0..27 {
                let step = [neighbour % 3 - 1, neighbour / 3 % 3 - 1, neighbour / 9 - 1];
                let next = [0, 1, 2].map(|axis| block[axis].saturating_add(step[axis]));
                if blocks.contains_key(&next) && !of.contains_key(&next) {
                    of.insert(next, group);
                    open.push(next);
                }
            }
        }
    }
    of.into_iter().map(|(block, group)| (block, cells[group])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_far_off_is_left_out_and_a_second_building_is_not() {
        let mut map = VoxelMap::new(0.1, 1, 300.0).unwrap();
        let wall = |map: &mut VoxelMap, x_m: f64| {
            (0..400).for_each(|at| map.add_point(DVec3::new(x_m, 0.15 * f64::from(at), 1.0)));
        };
        wall(&mut map, 2.0);
        wall(&mut map, 2000.0);
        assert_eq!(map.drop_strays(300.0), None);
        let bounds_m = map.bounds_m();
        map.add_point(DVec3::new(1e5, 3.0, -4.0));
        let strays = map.drop_strays(300.0).unwrap();
        assert_eq!(strays.cells, 1);
        assert!(strays.at_m.distance(DVec3::new(1e5, 3.0, -4.0)) < 2.0, "{strays:?}");
        assert_eq!(map.bounds_m(), bounds_m);
        assert_eq!(map.counts()[1], 800);
        assert_eq!(map.drop_strays(300.0), None);
    }
}
