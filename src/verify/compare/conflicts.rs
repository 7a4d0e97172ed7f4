//! Free here, occupied there: two maps of free, occupied and unknown cells, of the same rays as recorded and as predicted.
//!
//! Only what one map knows to be free and the other to be occupied is evidence; unknown is none. Noise and a grid that the
//! surface crosses put hits into the next cell: a cell is in conflict only if the other map has no hit around it either.

use std::collections::BTreeMap;

use glam::DVec3;

use super::Field;
use crate::world::local_origin::LocalOrigin;
use crate::world::scene::{Cell, VoxelMap};

/// Edge of a cell, m: wider than ranges and poses are off by.
const CELL_M: f64 = 0.2;
/// Rays longer than this are not laid into the maps, m.
const LONGEST_RAY_M: f64 = 300.0;
/// Edge of the block that is named as the place of most conflicts, m.
const BLOCK_M: f64 = 2.0;

/// Cells on which the recording and the scene contradict each other.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Conflicts {
    /// Edge of a cell, m.
    pub cell_m: f64,
    /// Occupied by the scene, and hit by the recording there or next to it.
    pub agree: u64,
    /// Occupied by the scene; the recording looked through.
    pub gone: Found,
    /// Hit by the recording; the scene is empty there.
    pub unforeseen: Found,
    /// Occupied in one of them, unknown to the other.
    pub unknown: u64,
}

/// Cells of one kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Found {
    /// How many.
    pub cells: u64,
    /// Middle of the block of 2 m with the most of them, world, m.
    pub around_m: Option<[f64; 3]>,
}

impl Conflicts {
    /// Of an even share of a recording's rays; none where the scene was not hit.
    pub(crate) fn between(field: &Field<'_>) -> Option<Self> {
        let map = || VoxelMap::new(CELL_M, 1, LONGEST_RAY_M).ok();
        let (mut recorded, mut predicted) = (map()?, map()?);
        // cells go with the scene, wherever it lies, and hold its outer walls in their middle
        let corner_m = field.scene.bounds_m()[0] - 0.5 * CELL_M;
        for ray in field.rays {
            let Some(placed) = field.place(ray) else { continue };
            if let Some(range_m) = ray.range_m {
                recorded.add_return(placed.origin_m - corner_m, placed.at_range(range_m) - corner_m);
            }
            if let Some((range_m, _)) = placed.cast(field.scene, &field.sensors[ray.sensor]) {
                predicted.add_return(placed.origin_m - corner_m, placed.at_range(range_m) - corner_m);
            }
        }
        let (mut gone, mut unforeseen) = (Vec::new(), Vec::new());
        let (mut agree, mut unknown) = (0, 0);
        for at_m in predicted.occupied_m() {
            match recorded.cell(at_m) {
                _ if is_hit_around(&recorded, at_m) => agree += 1,
                Cell::Free => gone.push(at_m),
                _ => unknown += 1,
            }
        }
        for at_m in recorded.occupied_m().filter(|at_m| !is_hit_around(&predicted, *at_m)) {
            match predicted.cell(at_m) {
                Cell::Free => unforeseen.push(at_m),
                _ => unknown += 1,
            }
        }
        let [gone, unforeseen] = [gone, unforeseen].map(|cells_m| Found::of(&cells_m, corner_m));
        (predicted.counts()[1] > 0).then_some(Self { cell_m: CELL_M, agree, gone, unforeseen, unknown })
    }

    /// The same, with places in the frame of the files.
    pub(crate) fn in_world(mut self, origin: LocalOrigin) -> Self {
        for found in [&mut self.gone, &mut self.unforeseen] {
            found.around_m = found.around_m.map(|at_m| origin.world(at_m.into()).to_array());
        }
        self
    }
}

#[cfg(test)]
impl Conflicts {
    /// Conflicts as a share of all cells that both know.
    pub(crate) fn share(&self) -> f64 {
        let against = self.gone.cells + self.unforeseen.cells;
        against as f64 / (against + self.agree).max(1) as f64
    }
}

impl Found {
    fn of(cells_m: &[DVec3], corner_m: DVec3) -> Self {
        let mut blocks: BTreeMap<[i64; 3], u64> = BTreeMap::new();
        for at_m in cells_m {
            let block = (*at_m / BLOCK_M).floor();
            *blocks.entry([block.x as i64, block.y as i64, block.z as i64]).or_default() += 1;
        }
        let most = blocks.iter().max_by_key(|(block, count)| (**count, std::cmp::Reverse(**block)));
        let middle_m = |block: &[i64; 3]| (DVec3::from(block.map(|at| at as f64)) + 0.5) * BLOCK_M + corner_m;
        let around_m = most.map(|(block, _)| middle_m(block).to_array());
        Self { cells: cells_m.len() as u64, around_m }
    }
}

fn is_hit_around(map: &VoxelMap, at_m: DVec3) -> bool {
    let steps = || [-1.0, 0.0, 1.0].into_iter();
    steps().any(|x| {
        steps().any(|y| steps().any(|z| map.cell(at_m + CELL_M * DVec3::new(x, y, z)) == Cell::Occupied))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::FramePitch;
    use crate::rig::{Mount, MountedSensor};
    use crate::simulate::frames::{Scan, Spin};
    use crate::verify::compare::Thinning;
    use crate::world::scene::{BoxScene, Scene};
    use crate::world::trajectory::Trajectory;

    fn room(far_m: f64) -> Scene {
        Scene::Box(BoxScene::closed(DVec3::new(-3.0, -2.5, 0.0), DVec3::new(far_m, 2.5, 2.6)))
    }

    /// Recorded in one room, compared with another.
    fn between(recorded: &Scene, nominal: &Scene) -> Conflicts {
        let model = sensors::catalogue::nominal("vlp-16").unwrap();
        let mount = Mount { pitch_rad: 0.5, ..Mount::default() };
        let sensors = [MountedSensor { name: "left".into(), model, mount }];
        let path = Trajectory::straight(DVec3::new(-1.0, 0.0, 1.2), DVec3::new(1.0, 0.0, 1.2), 2.0, 1);
        let pose = mount.body_from_sensor();
        let scan = Scan {
            scene: recorded,
            trajectory: &path,
            model: &sensors[0].model,
            body_from_sensor: &|_| pose,
            noise_m: 0.02,
            seed: 1,
            range_step_mm: 2,
        };
        let spin = Spin::Angles { columns: 360, rate_hz: 10.0 };
        let mut rays = Thinning::new(1 << 20);
        for turn in 0..10 {
            let frame = scan.frame(turn, &spin.columns(1, turn), spin.azimuth_rate_rad_per_ns());
            rays.add_frame(0, &sensors[0].model, &FramePitch::constant(mount.pitch_rad), 0, &frame);
        }
        let rays = Thinning::joined([rays]);
        let field =
            Field { scene: nominal, trajectory: &path, sensors: &sensors, rays: &rays, agree_within_m: 0.1 };
        Conflicts::between(&field).unwrap()
    }

    #[test]
    fn a_wall_that_moved_is_found_from_both_sides() {
        let same = between(&room(3.0), &room(3.0));
        assert!(same.share() < 0.002 && same.agree > 500, "{same:?}");
        // the room goes on where the scene has a wall
        let longer = between(&room(5.0), &room(3.0));
        assert!(longer.gone.cells > 50 && longer.share() > 0.05, "{longer:?}");
        let [x, ..] = longer.gone.around_m.unwrap();
        assert!((x - 3.0).abs() < 1.01, "{longer:?}");
        // a wall where the scene has room
        let shorter = between(&room(3.0), &room(5.0));
        assert!(
            shorter.unforeseen.cells > 50 && shorter.gone.cells < shorter.unforeseen.cells,
            "{shorter:?}"
        );
    }
}
