use super::*;
use crate::base::rng::Rng;
use crate::world::scene::BoxScene;

/// A room whose walls run through cell centres, mapped from one point.
fn mapped(voxel_m: f64) -> (BoxScene, VoxelMap) {
    let half = 0.5 * voxel_m;
    let walls = BoxScene::closed(DVec3::new(-3.0, -2.0, -1.0) - half, DVec3::new(3.0, 2.0, 1.5) + half);
    let mut map = VoxelMap::new(voxel_m, 1, 100.0).unwrap();
    let mut rng = Rng::new(3, 0);
    let from_m = DVec3::new(0.31, -0.17, 0.12);
    for _ in 0..120_000 {
        let direction = DVec3::new(rng.normal(), rng.normal(), rng.normal()).normalize();
        let hit = walls.cast(from_m, direction).unwrap();
        map.add_return(from_m, from_m + hit.distance_m * direction);
    }
    (walls, map)
}

#[test]
fn a_mapped_room_is_free_inside_occupied_at_its_walls_and_unknown_behind() {
    let (_, map) = mapped(0.1);
    assert_eq!(map.cell(DVec3::new(1.0, 1.0, 0.5)), Cell::Free);
    assert_eq!(map.cell(DVec3::new(3.05, 0.5, 0.5)), Cell::Occupied);
    assert_eq!(map.cell(DVec3::new(0.5, 0.5, -1.05)), Cell::Occupied);
    assert_eq!(map.cell(DVec3::new(3.2, 0.5, 0.5)), Cell::Unknown);
    let [free, occupied] = map.counts();
    let cells = 62 * 42 * 27;
    let walls = cells - 60 * 40 * 25;
    // a few cells of the wall were grazed and not hit
    assert!((free as f64 - 60_000.0).abs() < 300.0, "{free} free");
    assert!(free + occupied <= cells, "{free} free, {occupied} occupied of {cells}");
    assert!(occupied <= walls && occupied as f64 > 0.95 * walls as f64, "{occupied} of {walls}");
}

#[test]
fn rays_through_the_map_agree_with_the_room() {
    let (walls, map) = mapped(0.1);
    let mut rng = Rng::new(4, 0);
    let (mut within, mut met) = (0, 0);
    for _ in 0..2000 {
        let from_m = DVec3::new(rng.between(-2.5, 2.5), rng.between(-1.5, 1.5), rng.between(-0.5, 1.0));
        let direction = DVec3::new(rng.normal(), rng.normal(), rng.normal()).normalize();
        let truth = walls.cast(from_m, direction).unwrap();
        let Some(hit) = map.cast(from_m, direction) else { continue };
        met += 1;
        assert!(hit.normal.dot(direction) < 0.0);
        // perpendicular to the wall the map is no worse than half a voxel
        let off_m = (hit.distance_m - truth.distance_m).abs() * truth.normal.dot(direction).abs();
        within += usize::from(off_m <= 0.05 + 1e-6);
    }
    assert!(met >= 1990, "{met} of 2000 rays met the walls");
    assert!(within as f64 >= 0.99 * f64::from(met), "{within} of {met}");
}

#[test]
fn a_miss_is_free_and_says_nothing_about_its_end() {
    let mut map = VoxelMap::new(0.5, 2, 50.0).unwrap();
    map.add_miss(DVec3::ZERO, DVec3::X, 10.0);
    assert_eq!(map.cell(DVec3::new(5.2, 0.1, 0.1)), Cell::Free);
    assert_eq!(map.cell(DVec3::new(10.2, 0.1, 0.1)), Cell::Unknown);
    assert_eq!(map.cast(DVec3::ZERO, DVec3::X), None);
    let wall = DVec3::new(8.2, 0.2, 0.3);
    map.add_return(DVec3::new(0.2, 0.2, 0.3), wall);
    assert_eq!(map.cell(wall), Cell::Free, "one hit is less than two");
    map.add_return(DVec3::new(0.2, 0.2, 0.3), wall);
    assert_eq!(map.cell(wall), Cell::Occupied);
    let hit = map.cast(DVec3::new(1.0, 0.2, 0.3), DVec3::X).unwrap();
    assert!((hit.distance_m - 7.2).abs() < 1e-6, "{}", hit.distance_m);
    assert_eq!(map.cast(DVec3::new(8.1, 0.2, 0.3), DVec3::Y).map(|hit| hit.distance_m), Some(0.0));
}

#[test]
fn a_ray_sees_surface_the_edge_of_what_is_known_or_nothing() {
    let mut map = VoxelMap::new(1.0, 1, 50.0).unwrap();
    let from_m = DVec3::splat(0.5);
    let before = map.bytes();
    map.add_return(from_m, DVec3::new(5.5, 0.5, 0.5));
    assert!(map.bytes() > before);
    assert_eq!(map.look(from_m, DVec3::X, 50.0), Some(Sight::Surface([5, 0, 0])));
    assert_eq!(map.look(from_m, DVec3::X, 4.0), None, "too far");
    assert_eq!(map.look(from_m, -DVec3::X, 50.0), None);
    let offset_m = DVec3::new(0.5, 1.5, 0.5);
    assert_eq!(map.look(offset_m, DVec3::X, 50.0), Some(Sight::Frontier([5, 1, 0])));
    let two_off_m = DVec3::new(0.5, 2.5, 0.5);
    assert_eq!(map.look(two_off_m, DVec3::X, 50.0), None, "away from all surface");
}

#[test]
fn rays_beyond_belief_are_counted() {
    let mut map = VoxelMap::new(0.1, 1, 200.0).unwrap();
    for end in [DVec3::NAN, DVec3::INFINITY, DVec3::new(201.0, 0.0, 0.0), DVec3::splat(1e300)] {
        map.add_return(DVec3::ZERO, end);
    }
    map.add_return(DVec3::splat(1e9), DVec3::splat(1e9));
    assert_eq!((map.rejected(), map.counts()), (5, [0, 0]));
    assert!(VoxelMap::new(0.0, 1, 1.0).is_err());
    assert!(VoxelMap::new(0.1, 0, 1.0).is_err());
    map.add_return(DVec3::ONE, DVec3::ONE);
    assert_eq!(map.counts(), [0, 1], "a return at the sensor itself");
    assert_eq!(map.sights(), 1 + 6);
    map.add_return(DVec3::new(1.15, 1.05, 1.05), DVec3::new(1.15, 1.05, 1.05));
    assert_eq!((map.counts(), map.sights()), ([0, 2], 2 + 10), "two side by side");
}

#[test]
fn a_brick_is_left_as_by_one_step_after_the_other() {
    let mut rng = Rng::new(5, 0);
    for n in 0..20_000 {
        // every third ray goes through edges and corners of cells, or along an axis
        let even = |value: f64| if n % 3 == 0 { (4.0 * value).round() / 4.0 } else { value };
        let from_m = DVec3::from([(); 3].map(|()| even(rng.between(-3.0, 3.0))));
        let direction = DVec3::from([(); 3].map(|()| even(rng.between(-0.6, 0.6))));
        let Some(direction) = direction.try_normalize() else { continue };
        let [mut by_steps, mut at_once] = [(); 2].map(|()| CellWalk::new(from_m, direction, 0.25));
        for _ in 0..5 {
            let (brick, _) = split(by_steps.cell);
            let mut entered = by_steps.step();
            while split(by_steps.cell).0 == brick {
                entered = by_steps.step();
            }
            assert_eq!(at_once.leave_brick(), entered, "{from_m} {direction}");
            assert_eq!(at_once.cell, by_steps.cell, "{from_m} {direction}");
            assert_eq!(at_once.to_face_m, by_steps.to_face_m, "{from_m} {direction}");
        }
    }
}

#[test]
fn rays_that_skip_air_end_where_the_others_do() {
    let (_, map) = mapped(0.02);
    let mut rng = Rng::new(6, 0);
    for _ in 0..2000 {
        let from_m = DVec3::new(rng.between(-4.0, 4.0), rng.between(-3.0, 3.0), rng.between(-2.0, 2.0));
        let direction = DVec3::new(rng.normal(), rng.normal(), rng.normal()).normalize();
        let every_cell = map.first_occupied::<false>(from_m, direction, |_| true);
        assert_eq!(map.cast(from_m, direction), every_cell);
    }
}
