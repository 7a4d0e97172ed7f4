use super::*;

fn wall() -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let corners = [[0.0, -1.0, -1.0], [0.0, 1.0, -1.0], [0.0, 1.0, 1.0], [0.0, -1.0, 1.0]];
    (corners.map(DVec3::from).to_vec(), vec![[0, 1, 2], [0, 2, 3]])
}

#[test]
fn both_sides_are_seen_and_normals_look_back() {
    let (vertices, triangles) = wall();
    let mesh = Mesh::new(vertices, triangles).unwrap();
    for side in [-1.0, 1.0] {
        let hit = mesh.cast(DVec3::new(3.0 * side, 0.2, 0.3), DVec3::new(-side, 0.0, 0.0)).unwrap();
        assert!((hit.distance_m - 3.0).abs() < 1e-12);
        assert_eq!(hit.normal, DVec3::new(side, 0.0, 0.0));
    }
    assert_eq!(mesh.cast(DVec3::new(3.0, 0.0, 0.0), DVec3::X), None);
    assert_eq!(mesh.cast(DVec3::new(3.0, 1.5, 0.0), -DVec3::X), None);
    // along the plane and next to it
    assert_eq!(mesh.cast(DVec3::new(0.1, -3.0, 0.0), DVec3::Y), None);
}

#[test]
fn no_ray_slips_through_a_closed_shape() {
    // a bumpy ball of small and large triangles, far from the origin
    let centre = DVec3::new(4.0e5, -5.0e6, 120.0);
    let (rings, slices) = (60_u32, 120_u32);
    let mut vertices = Vec::new();
    let mut triangles = Vec::new();
    for ring in 0..=rings {
        for slice in 0..slices {
            let polar = std::f64::consts::PI * f64::from(ring) / f64::from(rings);
            let around = std::f64::consts::TAU * f64::from(slice) / f64::from(slices);
            let radius = 5.0 + 0.2 * (7.0 * around).sin() * (5.0 * polar).sin();
            let unit = DVec3::new(polar.sin() * around.cos(), polar.sin() * around.sin(), polar.cos());
            vertices.push(centre + radius * unit);
            let next = (slice + 1) % slices;
            if ring < rings {
                let (a, b) = (ring * slices + slice, ring * slices + next);
                triangles.push([a, b, a + slices]);
                triangles.push([b, b + slices, a + slices]);
            }
        }
    }
    let mesh = Mesh::new(vertices.clone(), triangles).unwrap();
    assert_eq!(mesh.degenerate() as u32, 2 * slices, "the poles");
    let mut rng = Rng::new(9, 0);
    for n in 0..30_000 {
        // every third ray aims at a vertex, every third at an edge
        let aim = match n % 3 {
            0 => vertices[rng.below(vertices.len() as u64) as usize],
            1 => {
                let at = rng.below((vertices.len() - 1) as u64) as usize;
                vertices[at].lerp(vertices[at + 1], rng.uniform())
            }
            _ => centre + DVec3::new(rng.normal(), rng.normal(), rng.normal()),
        };
        let from =
            centre + DVec3::new(rng.between(-2.0, 2.0), rng.between(-2.0, 2.0), rng.between(-2.0, 2.0));
        let direction = (aim - from).normalize();
        let hit = mesh.cast(from, direction);
        assert!(
            hit.is_some_and(|hit| hit.distance_m < 10.6),
            "ray {n} from {from} along {direction}: {hit:?}"
        );
    }
}

#[test]
fn packets_answer_as_single_rays_do() {
    let mut rng = Rng::new(11, 0);
    let vertices: Vec<DVec3> =
        (0..900).map(|_| DVec3::new(rng.normal(), rng.normal(), rng.normal())).collect();
    let near = |n: u32, rng: &mut Rng| [n, rng.below(900) as u32, rng.below(900) as u32];
    let triangles = (0..300).map(|n| near(3 * n, &mut rng)).collect();
    let mesh = Mesh::new(vertices, triangles).unwrap();
    let count = 16 * 20 + 5;
    let point = |rng: &mut Rng| DVec3::new(rng.normal(), rng.normal(), rng.normal());
    let origins: Vec<DVec3> = (0..count).map(|_| 2.0 * point(&mut rng)).collect();
    let directions: Vec<DVec3> = (0..count).map(|_| point(&mut rng).normalize()).collect();
    let (mut reported, mut all) = (Vec::new(), Vec::new());
    let mut hits = 0;
    mesh.cast_many(&origins, &directions, |index, hit| {
        reported.push(index);
        all.push(hit);
        let single = mesh.cast(origins[index], directions[index]);
        hits += usize::from(hit.is_some());
        match (hit, single) {
            (Some(a), Some(b)) => assert!((a.distance_m - b.distance_m).abs() < 1e-5, "ray {index}"),
            (a, b) => assert_eq!(a, b, "ray {index}"),
        }
    });
    for instructions in Instructions::available() {
        let mut again = Vec::new();
        mesh.cast_many_with(instructions, &origins, &directions, |_, hit| again.push(hit));
        assert_eq!(again, all, "{instructions:?}");
    }
    assert_eq!(reported, (0..count).collect::<Vec<_>>());
    assert!(hits > count / 4, "{hits} of {count}");
}

#[test]
fn what_is_no_mesh_is_refused() {
    let (mut vertices, triangles) = wall();
    assert!(matches!(
        Mesh::new(vertices.clone(), vec![[0, 1, 4]]),
        Err(MeshError::IndexOutOfRange { triangle: 0, index: 4, vertices: 4 })
    ));
    assert!(matches!(Mesh::new(Vec::new(), Vec::new()), Err(MeshError::Empty { .. })));
    let flat = Mesh::new(vertices.clone(), vec![[0, 1, 1], [2, 2, 2]]).unwrap_err();
    assert_eq!(flat, MeshError::Empty { vertices: 4, degenerate: 2 });
    vertices[2].y = f64::NAN;
    let error = Mesh::new(vertices, triangles).unwrap_err().to_string();
    assert!(error.contains("vertex 2") && error.contains("NaN"), "{error}");
}

#[test]
fn degenerate_and_repeated_triangles_do_no_harm() {
    let (vertices, mut triangles) = wall();
    // three triangles on one edge, one of them upside down, one repeated, two without area
    triangles.extend([[0, 2, 1], [0, 1, 2], [0, 0, 1], [1, 1, 1]]);
    let mesh = Mesh::new(vertices, triangles).unwrap();
    assert_eq!((mesh.triangles(), mesh.degenerate()), (4, 2));
    assert!(mesh.cast(DVec3::new(1.0, 0.0, 0.0), -DVec3::X).is_some());
}

#[test]
fn rays_in_a_face_and_along_an_edge_have_an_answer() {
    let (vertices, triangles) = wall();
    let mesh = Mesh::new(vertices, triangles).unwrap();
    // in the wall's plane: no surface is met, whatever the direction
    for direction in [DVec3::Y, DVec3::Z, DVec3::new(0.0, 0.6, 0.8)] {
        let hits = [DVec3::new(0.0, -3.0, -0.5), DVec3::ZERO, DVec3::new(0.0, 1.0, -1.0)]
            .map(|origin| mesh.cast(origin, direction));
        assert_eq!(hits, [None; 3], "{direction}");
    }
    // onto the edges, the diagonal between both triangles and the corners, from both sides
    for (y, z) in [(0.0, 0.0), (0.5, 0.5), (1.0, 0.0), (0.0, -1.0), (1.0, 1.0), (-1.0, -1.0)] {
        for side in [-2.0, 2.0] {
            let hit = mesh.cast(DVec3::new(side, y, z), DVec3::new(-side.signum(), 0.0, 0.0));
            assert_eq!(hit.map(|hit| hit.distance_m), Some(2.0), "{y} {z}");
        }
    }
}

#[test]
fn many_copies_of_one_triangle_still_make_a_tree() {
    let (vertices, _) = wall();
    let mesh = Mesh::new(vertices, vec![[0, 1, 2]; 20_000]).unwrap();
    let hit = mesh.cast(DVec3::new(1.0, 0.5, -0.5), -DVec3::X).unwrap();
    assert!((hit.distance_m - 1.0).abs() < 1e-12);
}

#[test]
fn samples_lie_on_the_surface_evenly_and_follow_the_seed() {
    let (mut vertices, mut triangles) = wall();
    // a second wall of a quarter of the area
    vertices.extend([[5.0, 0.0, 0.0], [5.0, 1.0, 0.0], [5.0, 1.0, 1.0], [5.0, 0.0, 1.0]].map(DVec3::from));
    triangles.extend([[4, 5, 6], [4, 6, 7]]);
    let mesh = Mesh::new(vertices, triangles).unwrap();
    assert!((mesh.area_m2() - 5.0).abs() < 1e-12);
    let points = mesh.sample(20_000, 3);
    assert_eq!(points, mesh.sample(20_000, 3));
    assert_ne!(points, mesh.sample(20_000, 4));
    let small = points.iter().filter(|p| p.x > 4.0).count() as f64 / 20_000.0;
    // binomial, 4 standard deviations
    assert!((small - 0.2).abs() < 0.0114, "{small}");
    let quarter = points.iter().filter(|p| p.x < 1.0 && p.y < 0.0 && p.z < 0.0).count() as f64 / 20_000.0;
    assert!((quarter - 0.2).abs() < 0.0114, "{quarter}");
    assert!(
        points
            .iter()
            .all(|p| (p.x - 5.0).abs() < 1e-12 || p.x.abs() < 1e-12 && p.y.abs() <= 1.0 && p.z.abs() <= 1.0)
    );
}
