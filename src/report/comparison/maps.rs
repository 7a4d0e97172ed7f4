//! Where prediction and recording differ: the room unfolded, and from above.

use glam::DVec3;

use super::Pictures;
use crate::report::above::on_plans;
use crate::report::chart::{CellMap, Plan, PlanAxis};
use crate::report::figures::where_different;
use crate::report::{Report, unfold_box};
use crate::rig::Rig;
use crate::verify::compare::{CellKinds, cell_kinds};
use crate::world::coverage::{Coverage, VoxelGrid};
use crate::world::local_origin::LocalOrigin;
use crate::world::scene::Scene;

/// A top view is drawn with at most so many cells along an edge.
const TOP_CELLS: usize = 240;

pub(super) fn difference_maps(report: &mut Report, pictures: &Pictures<'_>) {
    let Pictures { replayed, scene, trajectory, origin, .. } = pictures;
    report.fold("Where they differ", "plans");
    let classes = where_different();
    if matches!(scene, Scene::Box(_)) {
        let kinds = cell_kinds(&replayed.as_driven, &replayed.recorded);
        let faces = unfold_box(replayed.recorded.grid(), &|index| Some(kind_place(kinds[index])));
        report.maps(
            "Cells predicted against cells recorded",
            &faces,
            &classes,
            "The room unfolded: floor and ceiling seen from above with x up the page, walls from inside.",
        );
    }
    let rig = Rig { sensors: replayed.sensors.clone() };
    let above = from_above(&replayed.as_driven, &replayed.recorded, &replayed.placed);
    let above = CellMap {
        plan: Some(plan(replayed.recorded.grid(), &above, on_plans(trajectory, &rig), *origin)),
        ..above
    };
    report.maps(
        "Seen from above",
        &[above],
        &classes,
        "From above, x up the page and y to the left: a column is missed where a twentieth of its predicted cells is.",
    );
}

fn kind_place(kind: CellKinds) -> usize {
    match kind {
        CellKinds::Both => 0,
        CellKinds::Missed => 1,
        CellKinds::Unexpected => 2,
        CellKinds::Neither => 3,
    }
}

/// Columns of several cells begin at the far end of both axes, in which the last may reach beyond the grid.
fn plan(
    grid: &VoxelGrid,
    map: &CellMap,
    (track_m, sensors): (Vec<DVec3>, Vec<(String, DVec3)>),
    origin: LocalOrigin,
) -> Plan {
    let column_m = step(grid) as f64 * grid.voxel_m;
    let corner_m = origin.world_m() + grid.origin_m;
    let on_page = |place_m: DVec3| [origin.world_m().y + place_m.y, origin.world_m().x + place_m.x];
    Plan {
        across: PlanAxis { name: "y", first_m: corner_m.y + map.width as f64 * column_m, step_m: -column_m },
        up: PlanAxis { name: "x", first_m: corner_m.x, step_m: column_m },
        track_m: track_m.into_iter().map(on_page).collect(),
        sensors: sensors.into_iter().map(|(name, place_m)| (name, on_page(place_m))).collect(),
    }
}

/// Cells along an edge of a column.
fn step(grid: &VoxelGrid) -> usize {
    grid.cells[0].max(grid.cells[1]).div_ceil(TOP_CELLS).max(1)
}

fn from_above(as_driven: &Coverage, recorded: &Coverage, placed: &Coverage) -> CellMap {
    let grid = recorded.grid();
    let [nx, ny, _] = grid.cells;
    let step = step(grid);
    let (width, height) = (ny.div_ceil(step), nx.div_ceil(step));
    // left of the page is +y
    let pixel = |cell: usize| {
        let (i, j) = (cell % nx, cell / nx % ny);
        (i / step) * width + (width - 1 - j / step)
    };
    let mut counts = vec![[0u32; 3]; width * height];
    let has = |coverage: &Coverage, cell: usize| (0..coverage.sensors()).any(|s| coverage.contains(s, cell));
    for cell in as_driven.union_cells() {
        counts[pixel(cell)][usize::from(!has(recorded, cell))] += 1;
    }
    for cell in placed.union_cells() {
        counts[pixel(cell)][2] += u32::from(!has(as_driven, cell));
    }
    let cells = counts
        .iter()
        .map(|[both, missed, unexpected]| match both + missed {
            0 if *unexpected == 0 => None,
            0 => Some(2),
            all if missed * 20 >= all => Some(1),
            _ => Some(0),
        })
        .collect();
    CellMap { title: "from above".into(), width, cells, plan: None }
}
