//! Meshes, trajectories and surface completeness against stored references.

use glam::DVec3;
use outrigger::scene::{Mesh, Scene, load_mesh};
use outrigger::trajectory::Trajectory;

use crate::support::{Case, shared, with_shared};

pub const CASES: &[Case] = &[
    with_shared("check_rays_of_the_house", check_rays_of_the_house),
    with_shared("the_trajectory_of_the_house_reads", the_trajectory_of_the_house_reads),
];

fn house() -> Mesh {
    load_mesh(&shared("scenes/house.ply"), None, None).unwrap().mesh
}

struct CheckRay {
    origin_m: DVec3,
    direction: DVec3,
    range_m: f64,
}

fn check_rays() -> Vec<CheckRay> {
    let text = std::fs::read_to_string(shared("reference/validation/house_rays.csv")).unwrap();
    let rows = text.lines().filter(|line| !line.starts_with('#')).map(|line| {
        let n: Vec<f64> = line.split(',').map(|field| field.trim().parse().unwrap()).collect();
        let direction = DVec3::new(n[3], n[4], n[5]).normalize();
        CheckRay { origin_m: DVec3::new(n[0], n[1], n[2]), direction, range_m: n[6] }
    });
    rows.collect()
}

fn check_rays_of_the_house() {
    let mesh = house();
    assert_eq!(mesh.triangles() + mesh.degenerate(), 146_484);
    let rays = check_rays();
    assert_eq!(rays.len(), 2000);
    let agrees =
        |range_m: f64, expected_m: f64| range_m == expected_m || (range_m - expected_m).abs() <= 1e-3;
    let mut single = 0;
    for ray in &rays {
        let hit = mesh.cast(ray.origin_m, ray.direction);
        single += usize::from(agrees(hit.map_or(f64::INFINITY, |hit| hit.distance_m), ray.range_m));
        assert!(hit.is_none_or(|hit| hit.normal.dot(ray.direction) <= 0.0 && hit.normal.is_normalized()));
    }
    assert!(single >= 1998, "{single} of 2000 rays within 1 mm");

    let scene = Scene::Mesh(std::sync::Arc::new(mesh));
    let origins: Vec<DVec3> = rays.iter().map(|ray| ray.origin_m).collect();
    let directions: Vec<DVec3> = rays.iter().map(|ray| ray.direction).collect();
    let mut packets = 0;
    scene.cast_many(&origins, &directions, |index, hit| {
        packets += usize::from(agrees(hit.map_or(f64::INFINITY, |hit| hit.distance_m), rays[index].range_m));
        let single = scene.cast(origins[index], directions[index]);
        match (hit, single) {
            (Some(a), Some(b)) => assert!((a.distance_m - b.distance_m).abs() < 1e-6, "ray {index}"),
            (a, b) => assert_eq!(a, b, "ray {index}"),
        }
    });
    assert!(packets >= 1998, "{packets} of 2000 rays within 1 mm");
}

fn the_trajectory_of_the_house_reads() {
    let text = std::fs::read_to_string(shared("reference/validation/house_trajectory.tum")).unwrap();
    let walk = Trajectory::from_tum(&text).unwrap();
    assert!((walk.length_m() - 46.98).abs() < 0.01, "{} m", walk.length_m());
    assert_eq!(walk.time_span_ns()[0], 0);
    assert!((walk.time_span_ns()[1] as f64 * 1e-9 - 39.15).abs() < 0.011);
    assert_eq!(walk.suspicions(&Default::default()), []);
}
