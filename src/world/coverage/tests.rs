use super::*;
use crate::base::rng::Rng;

fn grid() -> VoxelGrid {
    VoxelGrid { origin_m: DVec3::new(-1.0, 2.0, 0.0), voxel_m: 0.1, cells: [37, 21, 13] }
}

fn filled(whole: bool, seed: u64) -> Coverage {
    let mut coverage = Coverage::with_storage(grid(), 3, whole);
    let mut rng = Rng::new(seed, 0);
    for _ in 0..4000 {
        let point_m = DVec3::new(rng.between(-1.1, 2.8), rng.between(1.9, 4.2), rng.between(-0.1, 1.4));
        coverage.add(rng.below(3) as usize, point_m);
    }
    coverage
}

#[test]
fn the_index_is_the_floor_of_every_coordinate() {
    let grid = grid();
    let by_definition = |point_m: DVec3| {
        let cell = ((point_m - grid.origin_m) / grid.voxel_m).floor();
        let is_inside = (0..3).all(|axis| cell[axis] >= 0.0 && cell[axis] <= grid.cells[axis] as f64 - 1.0);
        is_inside
            .then(|| cell.x as usize + grid.cells[0] * (cell.y as usize + grid.cells[1] * cell.z as usize))
    };
    let mut rng = Rng::new(5, 0);
    let faces = [-1e-300, -0.0, 0.0, 0.1, 3.7, 2.1, 1.3, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300];
    let mut along = || match rng.below(3) {
        0 => faces[rng.below(faces.len() as u64) as usize],
        1 => 0.1 * rng.below(40) as f64,
        _ => rng.between(-0.3, 4.0),
    };
    let mut inside = 0;
    for _ in 0..20_000 {
        let point_m = grid.origin_m + DVec3::new(along(), along(), along());
        assert_eq!(grid.index(point_m), by_definition(point_m), "{point_m}");
        inside += u32::from(grid.index(point_m).is_some());
    }
    assert!(inside > 1000, "{inside}");
}

#[test]
fn bricks_and_whole_bitmaps_say_the_same() {
    let (mut whole, mut bricks) = (filled(true, 1), filled(false, 1));
    assert!(whole.outside() > 0);
    assert_eq!(whole, bricks);
    assert_eq!(whole.counts(), bricks.counts());
    assert_eq!(whole.union_sha256(), bricks.union_sha256());
    assert_eq!(whole.union_cells(), bricks.union_cells());
    assert_eq!(whole.union_cells().len() as u64, whole.union_count());
    for cell in 0..grid().len() {
        assert_eq!(whole.contains(1, cell), bricks.contains(1, cell));
    }
    let mut both = [whole.union_cells(), filled(true, 2).union_cells()].concat();
    both.sort_unstable();
    both.dedup();
    whole.join(&filled(true, 2));
    assert_eq!(whole.union_cells(), both);
    assert_ne!(whole, bricks);
    bricks.join(&filled(false, 2));
    assert_eq!(whole, bricks);
}

#[test]
fn counts_add_up() {
    let counts = filled(true, 3).counts();
    assert!(counts.union <= counts.per_sensor.iter().sum());
    assert_eq!(counts.union, counts.overlap + counts.unique_per_sensor.iter().sum::<u64>());
}

#[test]
fn a_large_grid_costs_what_was_hit() {
    let grid = VoxelGrid { origin_m: DVec3::ZERO, voxel_m: 0.01, cells: [100_000, 100_000, 1_000] };
    let mut coverage = Coverage::new(grid, 1);
    for step in 0..1000 {
        coverage.add(0, DVec3::new(f64::from(step) + 0.005, 500.0, 5.0));
    }
    assert_eq!(coverage.union_count(), 1000);
    let Cells::Bricks { words, .. } = &coverage.sensors[0] else { panic!("too large to keep whole") };
    assert_eq!(words.len(), 1000);
    assert!(
        matches!(Coverage::new(self::grid(), 1).sensors[0], Cells::Whole(_)),
        "a small one is stored whole"
    );
}

#[test]
fn walls_run_through_cell_centres() {
    let grid = VoxelGrid::centred_on([DVec3::new(-1.0, 0.0, 2.0), DVec3::new(1.0, 3.0, 2.5)], 0.5);
    assert_eq!((grid.cells, grid.origin_m), ([5, 7, 2], DVec3::new(-1.25, -0.25, 1.75)));
    assert_eq!((grid.len(), grid.is_empty()), (70, false));
    assert_eq!(grid.centre_m(0), DVec3::new(-1.0, 0.0, 2.0));
    assert_eq!(grid.centre_m(69), DVec3::new(1.0, 3.0, 2.5));
    // the least faces belong to the grid, the greatest do not
    assert_eq!(grid.index(grid.origin_m), Some(0));
    for beyond in [DVec3::new(1.25, 1.0, 2.0), DVec3::new(0.0, 3.25, 2.0), DVec3::new(0.0, 1.0, 2.75)] {
        assert_eq!(grid.index(beyond), None, "{beyond}");
    }
    assert!(VoxelGrid { cells: [5, 0, 2], ..grid }.is_empty());
}

#[test]
fn a_cell_is_around_its_centre() {
    let grid = grid();
    assert_eq!(grid.place(5 + 37 * (4 + 21 * 3)), [5, 4, 3]);
    for cell in 0..grid.len() {
        assert_eq!(grid.index(grid.centre_m(cell)), Some(cell));
    }
}

#[test]
fn outer_cells_are_those_without_a_neighbour_on_some_side() {
    let grid = VoxelGrid { cells: [5, 4, 3], ..grid() };
    let inner = (1..4).flat_map(|i| (1..3).map(move |j| i + 5 * (j + 4)));
    let mut all: Vec<_> = grid.outer_cells().chain(inner).collect();
    all.sort_unstable();
    assert_eq!(all, (0..60).collect::<Vec<_>>());
    assert!(grid.outer_cells().is_sorted());
}

/// Bit by bit, as the fields of [`Counts`] say.
#[test]
fn counts_are_those_of_cell_by_cell() {
    for whole in [true, false] {
        let coverage = filled(whole, 4);
        let sees = |cell| (0..3).filter(|sensor| coverage.contains(*sensor, cell)).collect::<Vec<_>>();
        let seen: Vec<_> = (0..grid().len()).map(sees).filter(|sensors| !sensors.is_empty()).collect();
        let number = |is: &dyn Fn(&[usize]) -> bool| seen.iter().filter(|sensors| is(sensors)).count() as u64;
        let counts = coverage.counts();
        assert_eq!((counts.union, counts.overlap), (number(&|_| true), number(&|sensors| sensors.len() > 1)));
        assert_eq!(coverage.sensors(), 3);
        for sensor in 0..3 {
            assert_eq!(counts.per_sensor[sensor], number(&|sensors| sensors.contains(&sensor)));
            assert_eq!(counts.unique_per_sensor[sensor], number(&|sensors| sensors == [sensor]));
        }
        assert_eq!(counts.overlap_ratio(), counts.overlap as f64 / counts.union as f64);
    }
    assert_eq!(Coverage::new(grid(), 2).counts().overlap_ratio(), 0.0);
}

#[test]
fn a_marked_cell_is_its_bit_and_no_other() {
    for whole in [true, false] {
        let mut coverage = Coverage::with_storage(grid(), 2, whole);
        let cell = grid().len() - 37;
        coverage.add(1, grid().centre_m(cell));
        for far in [-9.0, 9.0] {
            coverage.add(0, DVec3::splat(far));
        }
        assert_eq!((coverage.outside(), coverage.union_cells(), coverage.grid()), (2, vec![cell], &grid()));
        assert!(coverage.contains(1, cell) && !coverage.contains(0, cell) && !coverage.contains(1, cell - 1));
        let mut bitmap = vec![0; 158];
        bitmap[cell / 64] = 1 << (cell % 64);
        assert_eq!((coverage.union(), &*coverage.sensor_bitmap(1)), (bitmap.clone(), &bitmap[..]));
        assert_eq!(&*coverage.sensor_bitmap(0), &[0; 158]);
        let again = Coverage { outside: 2, ..Coverage::from_bitmaps(grid(), vec![vec![0; 158], bitmap]) };
        assert_eq!(coverage, again);
    }
}

#[test]
fn coverages_are_equal_when_grid_cells_and_points_outside_are() {
    let one = filled(true, 6);
    assert_ne!(one, Coverage { grid: VoxelGrid { voxel_m: 0.2, ..grid() }, ..one.clone() });
    assert_ne!(one, Coverage { outside: one.outside + 1, ..one.clone() });
    assert_ne!(one, Coverage { sensors: one.sensors[..2].to_vec(), ..one.clone() });
    let mut joined = one.clone();
    joined.join(&one);
    assert_eq!(joined, Coverage { outside: 2 * one.outside, ..one });
}

#[test]
#[should_panic(expected = "the same grid and sensors")]
fn coverage_of_fewer_sensors_is_not_joined() {
    filled(true, 1).join(&Coverage::new(grid(), 2));
}

#[test]
fn bitmaps_must_fit_the_grid() {
    let refused = |bitmap| std::panic::catch_unwind(|| Coverage::from_bitmaps(grid(), vec![bitmap])).is_err();
    let mut bitmap = vec![0; 158];
    bitmap[157] = 1 << (grid().len() % 64 - 1);
    assert!(!refused(bitmap.clone()));
    bitmap[157] <<= 1;
    assert!(refused(bitmap) && refused(vec![0; 157]));
    // a last word without room to spare
    let full = Coverage::from_bitmaps(VoxelGrid { cells: [8, 8, 2], ..grid() }, vec![vec![u64::MAX; 2]]);
    assert_eq!(full.union_count(), 128);
}

#[test]
fn bytes_are_those_of_bitmaps_or_of_the_bricks_hit() {
    assert_eq!(Coverage::with_storage(grid(), 2, true).bytes(), 2 * 158 * 8);
    let mut bricks = Coverage::with_storage(grid(), 1, false);
    bricks.add(0, grid().centre_m(0));
    let Cells::Bricks { index, .. } = &bricks.sensors[0] else { panic!("asked for bricks") };
    assert_eq!(bricks.bytes(), index.bytes() + 64);
}

/// The digest that another program finds for the same bytes: `printf '\x01\x80\x03' | sha256sum`.
#[test]
fn the_digest_is_that_of_the_bits_in_bytes() {
    let mut coverage = Coverage::new(VoxelGrid { cells: [6, 3, 1], ..grid() }, 2);
    for (sensor, cell) in [(0, 0), (1, 15), (0, 16), (1, 17)] {
        coverage.add(sensor, coverage.grid().centre_m(cell));
    }
    assert_eq!(coverage.union_sha256(), "e190a2c6abd8a92b5e2338dc15370b72a9a8234cb5d2051e44243838d40e3f99");
}
