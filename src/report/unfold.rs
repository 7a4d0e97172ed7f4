//! A grid of cells as flat pictures: the six faces of a box laid out, or the whole grid seen from above.

use crate::report::chart::{CellMap, Plan, PlanAxis};
use crate::world::coverage::VoxelGrid;

/// The same for a grid in the axes of the mount frame (x right, y ahead).
pub(crate) fn unfold_mount_box(grid: &VoxelGrid, class_of: &dyn Fn(usize) -> Option<usize>) -> Vec<CellMap> {
    let [right, ahead, up] = grid.cells;
    let in_body = VoxelGrid { cells: [ahead, right, up], ..grid.clone() };
    let sides = [
        [(0, 1), (1, 1)],
        [(0, 1), (1, 1)],
        [(0, 1), (2, 1)],
        [(0, -1), (2, 1)],
        [(1, 1), (2, 1)],
        [(1, -1), (2, 1)],
    ];
    let titles =
        ["floor", "ceiling", "wall ahead (+y)", "wall behind (-y)", "wall left (-x)", "wall right (+x)"];
    unfold_box(&in_body, &|cell| {
        let [x, y, z] = in_body.place(cell);
        class_of((right - 1 - y) + right * (x + ahead * z))
    })
    .into_iter()
    .zip(titles.into_iter().zip(sides))
    .map(|(map, (title, sides))| CellMap { title: title.into(), plan: Some(plan(grid, sides)), ..map })
    .collect()
}

/// The outermost cell layers of a grid around a closed room, unfolded: floor and ceiling as seen from above (world x up
/// the page, y to the left), walls as seen from inside with z up.
pub(crate) fn unfold_box(grid: &VoxelGrid, class_of: &dyn Fn(usize) -> Option<usize>) -> Vec<CellMap> {
    let [nx, ny, nz] = grid.cells;
    let index = |i: usize, j: usize, k: usize| i + nx * (j + ny * k);
    let map = |title: &str, sides: [Side; 2], cell: &dyn Fn(usize, usize) -> usize| {
        let [width, height] = sides.map(|(axis, _)| grid.cells[axis]);
        CellMap {
            title: title.to_owned(),
            width,
            cells: (0..height)
                .flat_map(|row| (0..width).map(move |column| (row, column)))
                .map(|(row, column)| class_of(cell(row, column)))
                .collect(),
            plan: Some(plan(grid, sides)),
        }
    };
    let (above, across) = ([(1, -1), (0, 1)], |side: Side| [side, (2, 1)]);
    vec![
        map("floor", above, &|row, column| index(row, ny - 1 - column, 0)),
        map("ceiling", above, &|row, column| index(row, ny - 1 - column, nz - 1)),
        map("wall ahead (+x)", across((1, -1)), &|row, column| index(nx - 1, ny - 1 - column, row)),
        map("wall behind (-x)", across((1, 1)), &|row, column| index(0, column, row)),
        map("wall left (+y)", across((0, 1)), &|row, column| index(column, ny - 1, row)),
        map("wall right (-y)", across((0, -1)), &|row, column| index(nx - 1 - column, 0, row)),
    ]
}

/// An axis of the grid, and whether it runs with the page or against it.
type Side = (usize, i32);

/// Where a picture of a grid lies: what runs across the page, and up.
fn plan(grid: &VoxelGrid, [across, up]: [Side; 2]) -> Plan {
    let axis = |(axis, sign): Side| {
        let from = if sign > 0 { 0 } else { grid.cells[axis] };
        PlanAxis {
            name: ["x", "y", "z"][axis],
            first_m: grid.origin_m[axis] + from as f64 * grid.voxel_m,
            step_m: f64::from(sign) * grid.voxel_m,
        }
    };
    Plan { across: axis(across), up: axis(up), track_m: Vec::new(), sensors: Vec::new() }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    #[test]
    fn the_cell_left_of_the_path_lies_left_on_the_floor() {
        let bounds = [DVec3::new(-2.0, -1.0, 0.0), DVec3::new(2.0, 1.0, 1.0)];
        let grid = VoxelGrid::centred_on(bounds, 1.0);
        let marked = grid.index(DVec3::new(2.0, 1.0, 0.0));
        let maps = unfold_box(&grid, &|index| (Some(index) == marked).then_some(0));
        let floor = &maps[0];
        // ahead is the top row, left is the first column
        assert_eq!(floor.cells.iter().position(Option::is_some), Some(4 * floor.width));
        assert_eq!(maps[2].cells.iter().position(Option::is_some), Some(0));
        assert_eq!(maps[4].cells.iter().position(Option::is_some), Some(4));
    }

    #[test]
    fn the_mount_frame_has_its_right_at_the_right() {
        let bounds = [DVec3::new(-1.0, -2.0, 0.0), DVec3::new(1.0, 2.0, 1.0)];
        let grid = VoxelGrid::centred_on(bounds, 1.0);
        let marked = grid.index(DVec3::new(1.0, 2.0, 0.0));
        let maps = unfold_mount_box(&grid, &|index| (Some(index) == marked).then_some(0));
        let first = |map: &CellMap| map.cells.iter().position(Option::is_some);
        // right and ahead: the last column of the floor's top row, and of the wall ahead
        assert_eq!((maps[0].width, first(&maps[0])), (3, Some(4 * 3 + 2)));
        assert_eq!((maps[2].title.as_str(), first(&maps[2])), ("wall ahead (+y)", Some(2)));
        assert_eq!((maps[5].title.as_str(), first(&maps[5])), ("wall right (+x)", Some(0)));
    }
}
