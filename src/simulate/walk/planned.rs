//! A walk through all of the free floor of a scene, for whoever has none: places everywhere on the floor that somebody can
//! stand on, visited one after the other by the shortest path.

use std::collections::VecDeque;

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::{BODY_HEIGHT_M, Walk, WalkError, floors_m, polyline};
use crate::world::scene::Scene;

/// Edge of a square of floor, m; larger where a scene has more than so many of them along an edge.
const SQUARE_M: f64 = 0.3;
const MOST_SQUARES: f64 = 384.0;
/// What somebody with a rig needs to every side, m, and the heights at which that is looked at.
const SHOULDERS_M: f64 = 0.35;
const HEIGHTS_M: [f64; 3] = [0.6, 1.2, 1.7];
/// Floors this far apart are two, m.
const STEP_M: f64 = 0.25;
/// Every square lies within this walked distance of a place that is visited, m.
const REACH_M: f64 = 3.0;

/// Free squares of the most common floor that hang together.
struct Floor {
    low_m: DVec2,
    square_m: f64,
    size: [usize; 2],
    free: Vec<bool>,
    height_m: f64,
}

/// A walk through the free floor.
pub(crate) fn planned(scene: &Scene) -> Result<Walk, WalkError> {
    let floor = Floor::of(scene).ok_or(WalkError::NoFreeFloor)?;
    let mut left = floor.places();
    let mut at = left.swap_remove(0);
    let mut path = vec![at];
    while !left.is_empty() {
        let (came_from, steps) = floor.ways_from(at);
        let nearest = (0..left.len()).min_by_key(|place| steps[left[*place]]).unwrap_or(0);
        let next = left.swap_remove(nearest);
        let mut leg = vec![next];
        while leg[leg.len() - 1] != at {
            leg.push(came_from[leg[leg.len() - 1]]);
        }
        path.extend(leg.into_iter().rev().skip(1));
        at = next;
    }
    let corners_m: Vec<DVec3> = floor
        .straightened(&path)
        .into_iter()
        .map(|square| floor.centre_m(square).extend(floor.height_m + BODY_HEIGHT_M))
        .collect();
    Ok(Walk { trajectory: polyline(&corners_m)?, corners_m, doubts: Vec::new() })
}

impl Floor {
    fn of(scene: &Scene) -> Option<Self> {
        let [low_m, high_m] = scene.bounds_m().map(DVec3::truncate);
        let square_m = SQUARE_M.max((high_m - low_m).max_element() / MOST_SQUARES);
        let size =
            ((high_m - low_m) / square_m).ceil().max(DVec2::ONE).to_array().map(|count| count as usize);
        let mut floor = Self { low_m, square_m, size, free: vec![false; size[0] * size[1]], height_m: 0.0 };
        let heights_m: Vec<Vec<f64>> = (0..floor.free.len())
            .into_par_iter()
            .map(|square| floors_m(scene, floor.centre_m(square)))
            .collect();
        floor.height_m = most_common(heights_m.iter().flatten().copied().collect())?;
        let is_free = |square: usize| {
            let at_m = floor.centre_m(square);
            heights_m[square].iter().any(|height_m| (height_m - floor.height_m).abs() < STEP_M)
                && has_room(scene, at_m.extend(floor.height_m))
        };
        let free: Vec<bool> = (0..floor.free.len()).into_par_iter().map(is_free).collect();
        floor.free = free;
        floor.keep_largest_part().then_some(floor)
    }

    fn centre_m(&self, square: usize) -> DVec2 {
        let [column, row] = [square % self.size[0], square / self.size[0]];
        self.low_m + self.square_m * DVec2::new(column as f64 + 0.5, row as f64 + 0.5)
    }

    fn neighbours(&self, square: usize) -> impl Iterator<Item = usize> + '_ {
        let [width, height] = self.size;
        let (column, row) = (square % width, square / width);
        let sides = [
            (column > 0).then(|| square - 1),
            (column + 1 < width).then_some(square + 1),
            (row > 0).then(|| square.wrapping_sub(width)),
            (row + 1 < height).then_some(square + width),
        ];
        sides.into_iter().flatten().filter(|next| self.free[*next])
    }

    /// For each square that can be reached the one before it, and the number of steps.
    fn ways_from(&self, start: usize) -> (Vec<usize>, Vec<usize>) {
        let mut before = vec![usize::MAX; self.free.len()];
        let mut steps = vec![usize::MAX; self.free.len()];
        let mut open = VecDeque::from([start]);
        (before[start], steps[start]) = (start, 0);
        while let Some(square) = open.pop_front() {
            for next in self.neighbours(square) {
                if steps[next] == usize::MAX {
                    (before[next], steps[next]) = (square, steps[square] + 1);
                    open.push_back(next);
                }
            }
        }
        (before, steps)
    }

    /// Whether anything is left.
    fn keep_largest_part(&mut self) -> bool {
        let mut part_of = vec![0_usize; self.free.len()];
        let mut sizes = vec![0_usize];
        for start in 0..self.free.len() {
            if !self.free[start] || part_of[start] > 0 {
                continue;
            }
            let (_, steps) = self.ways_from(start);
            let own = steps.iter().enumerate().filter(|(_, steps)| **steps != usize::MAX);
            own.clone().for_each(|(square, _)| part_of[square] = sizes.len());
            sizes.push(own.count());
        }
        let largest = (1..sizes.len()).max_by_key(|part| (sizes[*part], usize::MAX - part));
        self.free = part_of.iter().map(|part| Some(*part) == largest).collect();
        largest.is_some_and(|part| sizes[part] > 1)
    }

    /// Places from which every square is near: each the farthest from those before it, the first in a corner.
    fn places(&self) -> Vec<usize> {
        let mut nearest = vec![usize::MAX; self.free.len()];
        let mut places = Vec::new();
        let mut next = self.free.iter().position(|free| *free);
        while let Some(place) = next {
            places.push(place);
            let (_, steps) = self.ways_from(place);
            nearest.iter_mut().zip(&steps).for_each(|(nearest, steps)| *nearest = (*nearest).min(*steps));
            let free = (0..nearest.len()).filter(|square| self.free[*square]);
            let farthest = free.max_by_key(|square| (nearest[*square], usize::MAX - square));
            let is_far =
                |square: &usize| places.len() < 2 || nearest[*square] as f64 * self.square_m > REACH_M;
            next = farthest.filter(|square| nearest[*square] > 0 && is_far(square));
        }
        places
    }

    /// The corners of a path that cuts across free squares.
    fn straightened(&self, path: &[usize]) -> Vec<usize> {
        let mut corners = vec![path[0]];
        let mut from = 0;
        while from + 1 < path.len() {
            // forty squares ahead at most: places that were to be visited lie on the leg
            let mut to = from + 1;
            for ahead in from + 2..path.len().min(from + 40) {
                if self.is_straight(path[from], path[ahead]) && !path[from + 1..ahead].contains(&path[ahead])
                {
                    to = ahead;
                } else {
                    break;
                }
            }
            corners.push(path[to]);
            from = to;
        }
        corners
    }

    fn is_straight(&self, from: usize, to: usize) -> bool {
        let (from_m, to_m) = (self.centre_m(from), self.centre_m(to));
        let steps = ((to_m - from_m).length() / (0.25 * self.square_m)).ceil().max(1.0) as usize;
        (0..=steps).all(|step| {
            let at = (from_m.lerp(to_m, step as f64 / steps as f64) - self.low_m) / self.square_m;
            let (column, row) = (at.x as usize, at.y as usize);
            column < self.size[0] && row < self.size[1] && self.free[column + row * self.size[0]]
        })
    }
}

/// The floor at which most squares lie; of equals the lowest.
fn most_common(heights_m: Vec<f64>) -> Option<f64> {
    let mut sorted = heights_m;
    sorted.sort_by(f64::total_cmp);
    let within = |first: usize| sorted.partition_point(|height_m| *height_m < sorted[first] + STEP_M) - first;
    let first = (0..sorted.len()).max_by_key(|first| (within(*first), usize::MAX - first))?;
    Some(sorted[first + within(first) / 2])
}

/// Whether somebody can stand there.
fn has_room(scene: &Scene, foot_m: DVec3) -> bool {
    HEIGHTS_M.iter().all(|height_m| {
        (0..8).all(|side| {
            let (sin, cos) = (f64::from(side) * std::f64::consts::FRAC_PI_4).sin_cos();
            let hit = scene.cast(foot_m + DVec3::Z * *height_m, DVec3::new(cos, sin, 0.0));
            hit.is_none_or(|hit| hit.distance_m > SHOULDERS_M)
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::scene::{BoxScene, Mesh};
    use std::sync::Arc;

    #[test]
    fn a_room_is_walked_from_end_to_end() {
        let room = Scene::Box(BoxScene::closed(DVec3::new(-6.0, -2.0, 1.0), DVec3::new(6.0, 2.0, 4.0)));
        let walk = planned(&room).unwrap();
        let xs: Vec<f64> = walk.corners_m.iter().map(|corner| corner.x).collect();
        let (low, high) = xs.iter().fold((0.0_f64, 0.0_f64), |(low, high), x| (low.min(*x), high.max(*x)));
        assert!(low < -4.5 && high > 4.5, "{xs:?}");
        assert!(walk.corners_m.iter().all(|corner| (corner.z - 2.6).abs() < 1e-9 && corner.y.abs() <= 1.65));
        assert!(walk.trajectory.length_m() < 60.0, "{}", walk.trajectory.length_m());
    }

    #[test]
    fn a_walk_stays_below_the_roof() {
        // the roof has no cupboards on it, so more of it is free than of the floor
        let boxes_m = [
            [DVec3::ZERO, DVec3::new(10.0, 6.0, 3.0)],
            [DVec3::new(1.0, 4.0, 0.0), DVec3::new(9.0, 6.0, 2.0)],
            [DVec3::new(4.0, 0.0, 0.0), DVec3::new(9.5, 1.5, 2.5)],
        ];
        let scene = Scene::Mesh(Arc::new(Mesh::of_boxes(&boxes_m).unwrap()));
        let walk = planned(&scene).unwrap();
        assert!(walk.corners_m.iter().all(|corner| (corner.z - BODY_HEIGHT_M).abs() < 1e-6));
    }

    #[test]
    fn a_wall_with_a_door_is_gone_through_at_the_door() {
        // two adjacent floors of 6 x 6 m, a wall between them with a gap of 1.2 m at one end
        let mut vertices = Vec::new();
        let mut triangles: Vec<[u32; 3]> = Vec::new();
        let mut quad = |corners: [[f64; 3]; 4]| {
            let first = vertices.len() as u32;
            vertices.extend(corners.map(DVec3::from));
            triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        };
        quad([[0.0, 0.0, 0.0], [12.0, 0.0, 0.0], [12.0, 6.0, 0.0], [0.0, 6.0, 0.0]]);
        quad([[6.0, 0.0, 0.0], [6.0, 4.8, 0.0], [6.0, 4.8, 2.5], [6.0, 0.0, 2.5]]);
        let scene = Scene::Mesh(Arc::new(Mesh::new(vertices, triangles).unwrap()));
        let walk = planned(&scene).unwrap();
        for pair in walk.corners_m.windows(2) {
            assert!(scene.sees(pair[0], pair[1], 0.0), "{pair:?}");
        }
        let sides = [walk.corners_m.iter().any(|at| at.x < 3.0), walk.corners_m.iter().any(|at| at.x > 9.0)];
        assert_eq!(sides, [true, true]);
    }

    #[test]
    fn a_scene_without_a_floor_has_no_walk() {
        let wall = Mesh::new(
            vec![DVec3::ZERO, DVec3::new(0.0, 3.0, 0.0), DVec3::new(0.0, 3.0, 3.0)],
            vec![[0, 1, 2]],
        );
        let error = planned(&Scene::Mesh(Arc::new(wall.unwrap()))).unwrap_err();
        assert!(error.to_string().contains("--trajectory"), "{error}");
    }
}
