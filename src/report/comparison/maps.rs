//! Where prediction and recording differ: the room unfolded, and from above.

use crate::report::chart::{CellClass, CellMap};
use crate::report::figures::where_different;
use crate::report::{Report, unfold_box};
use crate::verify::compare::{CellKinds, Replayed, cell_kinds};
use crate::world::coverage::Coverage;
use crate::world::scene::Scene;
use crate::world::trajectory::Trajectory;

/// A top view is drawn with at most so many cells along an edge.
const TOP_CELLS: usize = 240;

pub(super) fn difference_maps(
    report: &mut Report,
    replayed: &Replayed,
    scene: &Scene,
    trajectory: &Trajectory,
) {
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
    let mut with_path = classes.to_vec();
    with_path.push(CellClass::new("c-path", "trajectory"));
    let above = from_above(&replayed.as_driven, &replayed.recorded, &replayed.placed, trajectory);
    report.maps(
        "Seen from above",
        &[above],
        &with_path,
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

fn from_above(
    as_driven: &Coverage,
    recorded: &Coverage,
    placed: &Coverage,
    trajectory: &Trajectory,
) -> CellMap {
    let grid = recorded.grid();
    let [nx, ny, _] = grid.cells;
    let step = nx.max(ny).div_ceil(TOP_CELLS).max(1);
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
    let mut cells: Vec<Option<usize>> = counts
        .iter()
        .map(|[both, missed, unexpected]| match both + missed {
            0 if *unexpected == 0 => None,
            0 => Some(2),
            all if missed * 20 >= all => Some(1),
            _ => Some(0),
        })
        .collect();
    for (_, pose) in trajectory.stamped() {
        let mut at = pose.translation_m;
        at.z = grid.origin_m.z + 0.5 * grid.voxel_m;
        if let Some(cell) = grid.index(at) {
            cells[pixel(cell)] = Some(4);
        }
    }
    CellMap { title: "from above".into(), width, cells }
}
