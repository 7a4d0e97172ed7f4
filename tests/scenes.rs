//! Meshes, trajectories and surface completeness against stored references and second readers.

use std::path::Path;
use std::process::Command;

use glam::{DQuat, DVec3};
use outrigger::base::geometry::Pose;
use outrigger::rig::Mount;
use outrigger::simulate::fan::BeamFan;
use outrigger::world::scene::{BoxScene, Mesh, Scene, load_mesh};
use outrigger::world::surface::{Completeness, SurfaceSamples, THRESHOLDS_M, read_points};
use outrigger::world::trajectory::Trajectory;

use crate::support::{Case, case, shared, with_shared};

pub const CASES: &[Case] = &[
    case("rays_along_faces_and_edges_of_a_box", rays_along_faces_and_edges_of_a_box),
    case("rays_from_outside_a_box_and_from_its_walls", rays_from_outside_a_box_and_from_its_walls),
    case("sensors_on_their_side_and_in_walls", sensors_on_their_side_and_in_walls),
    case("ideal_sensors_refuse_what_they_cannot_use", ideal_sensors_refuse_what_they_cannot_use),
    case("ideal_sensors_report_and_repeat_themselves", ideal_sensors_report_and_repeat_themselves),
    with_shared("check_rays_of_the_house", check_rays_of_the_house),
    with_shared("rays_in_the_house_hit_the_same_in_company", rays_in_the_house_hit_the_same_in_company),
    with_shared("second_readers_agree_on_the_house", second_readers_agree_on_the_house),
    with_shared("the_trajectory_of_the_house_reads", the_trajectory_of_the_house_reads),
    with_shared("completeness_of_the_house_as_computed_with_embree", completeness_of_the_house),
];

fn house() -> Mesh {
    load_mesh(&shared("scenes/house.ply"), None, None).unwrap().mesh
}

fn house_walk() -> Trajectory {
    let walk = std::fs::read(shared("reference/validation/house_trajectory.tum")).unwrap();
    Trajectory::read(&walk, None).unwrap().trajectory
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

/// To the bit, from places along the walk: the beams of an OS1-64, column by column.
fn rays_in_the_house_hit_the_same_in_company() {
    let (mesh, walk) = (house(), house_walk());
    let model = sensors::catalogue::nominal("os1-64").unwrap();
    let (mut origins, mut directions) = (Vec::new(), Vec::new());
    for second in (0..39).step_by(4) {
        let world_from_body = walk.at(second * 1_000_000_000).unwrap();
        for azimuth in 0..128 {
            for channel in 0..model.channels() {
                let ray = model.ray(channel, f64::from(azimuth) * std::f64::consts::TAU / 128.0);
                origins.push(world_from_body.transform_point(ray.origin_m));
                directions.push(world_from_body.rotate(ray.direction));
            }
        }
    }
    let mut hits = 0;
    mesh.cast_many(&origins, &directions, |index, hit| {
        assert_eq!(hit, mesh.cast(origins[index], directions[index]), "ray {index}");
        hits += usize::from(hit.is_some());
    });
    assert!(hits > origins.len() * 9 / 10, "{hits}");
}

/// The house written as OBJ and STL, read by this program and by others.
fn second_readers_agree_on_the_house() {
    let ply = std::fs::read(shared("scenes/house.ply")).unwrap();
    let body = ply.windows(11).position(|window| window == b"end_header\n").unwrap() + 11;
    let number = |at: usize| f32::from_le_bytes(ply[at..at + 4].try_into().unwrap());
    let vertices: Vec<[f32; 3]> =
        (0..79_158).map(|v| [0, 4, 8].map(|byte| number(body + 12 * v + byte))).collect();
    let faces_at = body + 12 * 79_158;
    let index = |at: usize| u32::from_le_bytes(ply[at..at + 4].try_into().unwrap());
    let faces: Vec<[u32; 3]> =
        (0..146_484).map(|f| [1, 5, 9].map(|byte| index(faces_at + 13 * f + byte))).collect();

    let folder = tempfile::tempdir().unwrap();
    let (obj, stl) = (folder.path().join("house.obj"), folder.path().join("house.stl"));
    let mut text = String::new();
    vertices.iter().for_each(|v| text += &format!("v {} {} {}\n", v[0], v[1], v[2]));
    faces.iter().for_each(|f| text += &format!("f {} {} {}\n", f[0] + 1, f[1] + 1, f[2] + 1));
    std::fs::write(&obj, text).unwrap();
    let facets = faces.iter().map(|f| stl_io::Triangle {
        normal: stl_io::Normal::new([0.0; 3]),
        vertices: f.map(|v| stl_io::Vertex::new(vertices[v as usize])),
    });
    let facets: Vec<_> = facets.collect();
    stl_io::write_stl(&mut std::fs::File::create(&stl).unwrap(), facets.iter()).unwrap();

    let ours =
        [&shared("scenes/house.ply"), &obj, &stl].map(|path| load_mesh(path, None, None).unwrap().mesh);
    let (models, _) = tobj::load_obj(&obj, &tobj::LoadOptions::default()).unwrap();
    assert_eq!(models[0].mesh.indices.len() / 3, ours[1].triangles() + ours[1].degenerate());
    let peer_stl = stl_io::read_stl(&mut std::fs::File::open(&stl).unwrap()).unwrap();
    assert_eq!(peer_stl.faces.len(), ours[2].triangles() + ours[2].degenerate());
    for mesh in &ours {
        assert_eq!(mesh.triangles(), ours[0].triangles());
        let off = |side: usize| (mesh.bounds_m()[side] - ours[0].bounds_m()[side]).abs().max_element();
        assert!(off(0).max(off(1)) < 1e-6);
        assert!((mesh.area_m2() - ours[0].area_m2()).abs() < 1e-6 * ours[0].area_m2());
    }
}

fn the_trajectory_of_the_house_reads() {
    let walk = house_walk();
    assert!((walk.length_m() - 46.98).abs() < 0.01, "{} m", walk.length_m());
    assert_eq!(walk.time_span_ns()[0], 0);
    assert!((walk.time_span_ns()[1] as f64 * 1e-9 - 39.15).abs() < 0.011);
    assert_eq!(walk.suspicions(&Default::default()), []);
    let again = Trajectory::read(walk.to_tum().as_bytes(), None).unwrap().trajectory;
    assert_eq!(again.length_m(), walk.length_m());
}

/// Flags and shares that Embree and a nearest-neighbour tree gave for the same convention.
fn completeness_of_the_house() {
    let folder = shared("reference/validation");
    let text = std::fs::read_to_string(folder.join("house.json")).unwrap();
    let reference: serde_json::Value = serde_json::from_str(&text).unwrap();
    let bytes = std::fs::read(folder.join("house_surface_samples.npy")).unwrap();
    let samples = SurfaceSamples::new(read_points(&bytes).unwrap()).unwrap();
    let (scene, walk) = (Scene::Mesh(house().into()), house_walk());
    let mut fan = BeamFan::nominal(&sensors::catalogue::nominal("vlp-16").unwrap(), 180, 10.0);
    fan.min_range_m = 0.3;

    for name in ["VLP/single_level", "VLP/single_BO"] {
        let expected = &reference["results"][name];
        let mounts: Vec<Mount> = expected["mounts_x_y_z_m_pitch_deg"]
            .as_array()
            .unwrap()
            .iter()
            .map(|mount| {
                let n: Vec<f64> = mount.as_array().unwrap().iter().map(|n| n.as_f64().unwrap()).collect();
                Mount { x_m: n[0], y_m: n[1], z_m: n[2], pitch_rad: n[3].to_radians(), ..Mount::default() }
            })
            .collect();
        let mut completeness = Completeness::new(&samples, &THRESHOLDS_M);
        let rays = fan.cover(&scene, &walk, &mounts, 1, &mut completeness);
        assert_eq!(rays, expected["rays"].as_u64().unwrap(), "{name}");
        let share = completeness.shares()[1];
        let subset = expected["completeness_subset_5cm"].as_f64().unwrap();
        assert!((share - subset).abs() < 0.0005, "{name}: {share}, expected {subset}");
        // of a million other samples of the same surface: within 4 standard deviations
        for (rank, key) in ["0.02", "0.05", "0.1"].iter().enumerate() {
            let million = expected["completeness_1M"][key].as_f64().unwrap();
            assert!((completeness.shares()[rank] - million).abs() < 0.004, "{name} at {key} m");
        }
        let flags = format!("house_{}_covered.npy", name.replace('/', "_"));
        let flags = std::fs::read(folder.join(flags)).unwrap();
        let packed = &flags[flags.len() - samples.len().div_ceil(8)..];
        let covered = completeness.covered(1);
        let differ =
            covered.iter().enumerate().filter(|(n, flag)| (packed[n / 8] >> (7 - n % 8) & 1 == 1) != **flag);
        let differ = differ.count() as f64 / samples.len() as f64;
        assert!(differ < 0.001, "{name}: {differ} of the flags differ");
        if name == "VLP/single_level" {
            let stations_m: Vec<DVec3> =
                walk.stations_m(0.5).into_iter().map(|at| at + 0.1 * DVec3::Z).collect();
            let some = SurfaceSamples::new(samples.points_m().iter().copied().step_by(10).collect()).unwrap();
            let seen = scene.observable(&some, &stations_m);
            let share = seen.iter().filter(|seen| **seen).count() as f64 / seen.len() as f64;
            let expected = expected["observable_share"].as_f64().unwrap();
            // 25 000 samples: 4 standard deviations
            assert!((share - expected).abs() < 0.012, "{share} observable, expected {expected}");
        }
    }
}

fn rays_along_faces_and_edges_of_a_box() {
    let room = BoxScene::closed(DVec3::new(-2.0, -1.0, 0.0), DVec3::new(2.0, 1.0, 3.0));
    // in the floor's plane, along x: the wall is met where floor and wall meet
    let hit = room.cast(DVec3::new(0.0, 0.0, 0.0), DVec3::X).unwrap();
    assert_eq!((hit.distance_m, hit.normal), (2.0, -DVec3::X));
    // along the edge of floor and side wall
    let hit = room.cast(DVec3::new(-1.0, 1.0, 0.0), DVec3::X).unwrap();
    assert_eq!(hit.distance_m, 3.0);
    // into a corner: every face of the corner is as far
    let towards = DVec3::new(2.0, 1.0, 1.5);
    let hit = room.cast(DVec3::new(0.0, 0.0, 1.5), towards.normalize()).unwrap();
    assert!((hit.distance_m - towards.length()).abs() < 1e-12);
    assert!(hit.normal.dot(towards) < 0.0);
    // on a face, looking away from it and into it
    assert_eq!(room.cast(DVec3::new(0.0, 0.0, 0.0), DVec3::Z).unwrap().distance_m, 3.0);
    assert_eq!(room.cast(DVec3::new(0.0, 0.0, 0.0), -DVec3::Z).unwrap().distance_m, 0.0);
    // every subset of the faces: what is left is met, what is missing lets the ray out
    for mask in 0..64_usize {
        let mut part = room.clone();
        part.faces = [0, 1, 2].map(|axis| [mask >> (2 * axis) & 1 == 1, mask >> (2 * axis + 1) & 1 == 1]);
        for (face, direction) in
            [-DVec3::X, DVec3::X, -DVec3::Y, DVec3::Y, -DVec3::Z, DVec3::Z].into_iter().enumerate()
        {
            let hit = part.cast(DVec3::new(0.3, 0.2, 1.1), direction);
            assert_eq!(hit.is_some(), mask >> face & 1 == 1, "faces {mask:06b}, face {face}");
        }
    }
}

fn rays_from_outside_a_box_and_from_its_walls() {
    let room = BoxScene::closed(DVec3::new(-2.0, -1.0, 0.0), DVec3::new(2.0, 1.0, 3.0));
    // the box is seen from inside: from outside a ray passes the near face and meets the far one
    let hit = room.cast(DVec3::new(-5.0, 0.0, 1.0), DVec3::X).unwrap();
    assert_eq!((hit.distance_m, hit.normal), (7.0, -DVec3::X));
    assert_eq!(room.cast(DVec3::new(-5.0, 0.0, 1.0), -DVec3::X), None);
    assert_eq!(room.cast(DVec3::new(-5.0, 4.0, 1.0), DVec3::X), None);
    assert_eq!(room.cast(DVec3::new(0.0, 0.0, 3.5), DVec3::Z), None);
    // the same walls as a mesh are solid from both sides
    let mesh = box_mesh(room.min_m, room.max_m);
    assert_eq!(mesh.cast(DVec3::new(-5.0, 0.0, 1.0), DVec3::X).unwrap().distance_m, 3.0);
    // inside, both answer the same
    let mut worst_m: f64 = 0.0;
    for n in 0..5000_u32 {
        let angle = f64::from(n) * 2.399_963;
        let z = 1.0 - 2.0 * (f64::from(n) + 0.5) / 5000.0;
        let direction = DVec3::new(angle.cos(), angle.sin(), 0.0) * (1.0 - z * z).sqrt() + z * DVec3::Z;
        let from = DVec3::new(0.4, -0.3, 1.2);
        let (a, b) = (room.cast(from, direction).unwrap(), mesh.cast(from, direction).unwrap());
        worst_m = worst_m.max((a.distance_m - b.distance_m).abs());
    }
    assert!(worst_m < 1e-5, "{worst_m}");
}

/// Level, on the side, upside down, in a wall and outside: no panic, and the counts that geometry asks for.
fn sensors_on_their_side_and_in_walls() {
    let (low, high) = (DVec3::new(-3.0, -2.0, 0.0), DVec3::new(3.0, 2.0, 3.0));
    let mesh = std::sync::Arc::new(box_mesh(low, high));
    let scenes = [Scene::Mesh(mesh.clone()), Scene::Box(BoxScene::closed(low, high))];
    let standing = |at_m: DVec3| {
        let pose = Pose::new(DQuat::IDENTITY, at_m);
        Trajectory::new(vec![(0, pose), (100_000_000, pose)]).unwrap()
    };
    let mut fan = BeamFan::nominal(&sensors::catalogue::nominal("vlp-16").unwrap(), 360, 10.0);
    fan.min_range_m = 0.3;
    let returns = |scene: &Scene, walk: &Trajectory, pitch_deg: f64, roll_deg: f64| {
        let mount = Mount {
            pitch_rad: f64::to_radians(pitch_deg),
            roll_rad: f64::to_radians(roll_deg),
            ..Mount::default()
        };
        let mut hits = Vec::new();
        fan.cast_scan(scene, walk, &mount, 0, |hit_m| hits.push(hit_m));
        assert!(hits.iter().all(|hit| {
            let inside = hit.cmpge(low - 1e-5).all() && hit.cmple(high + 1e-5).all();
            inside
                && (0..3).any(|axis| (hit[axis] - low[axis]).abs().min((hit[axis] - high[axis]).abs()) < 1e-5)
        }));
        hits.len()
    };
    let inside = standing(DVec3::new(0.0, 0.0, 1.5));
    for scene in &scenes {
        for (pitch_deg, roll_deg) in
            [(0.0, 0.0), (90.0, 0.0), (-90.0, 0.0), (0.0, 90.0), (0.0, -90.0), (90.0, 90.0), (180.0, 0.0)]
        {
            assert_eq!(returns(scene, &inside, pitch_deg, roll_deg), 16 * 360, "{pitch_deg} {roll_deg}");
        }
    }
    // In the plane of a wall. A surface has no thickness, so that a ray in its very plane passes it by and meets what
    // crosses the plane: the next wall, on the edge that both walls own. Anything else would let a ray's answer hang on
    // whether a wall's two triangles, or two rooms' walls in one plane, are told apart. A ray that leaves the plane by
    // however little starts on the wall: a mesh has two sides and is met at once; of the box a ray may go inside.
    let at_wall = DVec3::new(3.0, 0.0, 1.5);
    for (scene, inward_m) in [(&scenes[0], 0.0), (&scenes[1], 2.0)] {
        for side in [-DVec3::Y, DVec3::Y] {
            let along = |x: f64| scene.cast(at_wall, (side + x * DVec3::X).normalize()).unwrap();
            assert_eq!((along(0.0).distance_m, along(0.0).normal), (2.0, -side));
            assert_eq!(along(1e-9).distance_m, 0.0, "outward");
            assert!((along(-1e-9).distance_m - inward_m).abs() < 1e-6, "inward: {}", along(-1e-9).distance_m);
        }
    }
    // So of a sensor there only column 0 returns anything from the mesh: the hits of all others are nearer than its
    // least range. Column 180 is off the plane by the rounding of its sine, 1.2e-16.
    let in_wall = standing(at_wall);
    assert_eq!(returns(&scenes[0], &in_wall, 0.0, 0.0), 16);
    let seen = returns(&scenes[1], &in_wall, 0.0, 0.0);
    assert!((16 * 170..=16 * 181).contains(&seen), "{seen}");
    // outside, the mesh is a block ahead
    let outside = standing(DVec3::new(-30.0, 0.0, 1.5));
    assert!((1..16 * 20).contains(&returns(&scenes[0], &outside, 0.0, 0.0)));
    // one pose, or poses that stand still, make a trajectory; no revolution fits the first
    let one = Trajectory::new(vec![(5, Pose::IDENTITY)]).unwrap();
    assert_eq!((fan.scans(&one), fan.scans(&inside), one.stations_m(0.5).len()), (0, 1, 1));
}

fn box_mesh(low: DVec3, high: DVec3) -> Mesh {
    let corner = |n: usize| {
        let pick = |axis: usize| if n >> axis & 1 == 1 { high[axis] } else { low[axis] };
        DVec3::new(pick(0), pick(1), pick(2))
    };
    let quads = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
    let halves = quads.iter().flat_map(|q: &[u32; 4]| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]);
    Mesh::new((0..8).map(corner).collect(), halves.collect()).unwrap()
}

/// A room and a short walk in it, as files.
fn write_room(folder: &Path, scale: f64) {
    let mut text = String::new();
    for n in 0..8_u8 {
        let side = |axis: u8, size: f64| scale * size * f64::from(n >> axis & 1);
        text += &format!("v {} {} {}\n", side(0, 6.0), side(1, 4.0), side(2, 3.0));
    }
    for q in [[1, 2, 4, 3], [5, 6, 8, 7], [1, 2, 6, 5], [3, 4, 8, 7], [1, 3, 7, 5], [2, 4, 8, 6]] {
        text += &format!("f {} {} {} {}\n", q[0], q[1], q[2], q[3]);
    }
    std::fs::write(folder.join("room.obj"), text).unwrap();
    std::fs::write(folder.join("walk.tum"), "0 1 2 1.5 0 0 0 1\n1 2 2 1.5 0 0 0 1\n2 3 2 1.5 0 0 0 1\n")
        .unwrap();
}

/// What an ideal VLP-16 sees of that room.
const IDEAL: [&str; 9] =
    ["predict", "--ideal", "--scene", "room.obj", "--trajectory", "walk.tum", "--sensor", "vlp-16", "--json"];

fn validate(folder: &Path, more: &[&str]) -> std::process::Output {
    let sized = ["--azimuths", "90", "--sample-count", "20000"];
    let exe = env!("CARGO_BIN_EXE_outrigger");
    Command::new(exe).current_dir(folder).args(IDEAL).args(sized).args(more).output().unwrap()
}

fn ideal_sensors_report_and_repeat_themselves() {
    let folder = tempfile::tempdir().unwrap();
    write_room(folder.path(), 1.0);
    let mounts = "0.05,0,0.1,30,0;-0.05,0,0.1,-30,0";
    let run = |threads: &str| {
        let exe = env!("CARGO_BIN_EXE_outrigger");
        let output = Command::new(exe)
            .current_dir(folder.path())
            .env("RAYON_NUM_THREADS", threads)
            .args(IDEAL)
            .args([
                "--azimuths",
                "90",
                "--sample-count",
                "20000",
                "--seed",
                "4",
                "--baselines",
                "--mounts",
                mounts,
            ])
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice::<serde_json::Value>(&output.stdout).unwrap()
    };
    let mut one = run("1");
    let mut three = run("3");
    for document in [&mut one, &mut three] {
        for time in ["prepare_s", "wall_s", "observable_s", "baselines_s"] {
            assert!(document[time].as_f64().unwrap() >= 0.0);
            document[time] = 0.into();
        }
    }
    assert_eq!(one, three);
    assert_eq!(one["rays"], 2 * 20 * 16 * 90);
    assert_eq!(one["observable_share"], 1.0);
    let at = |key: &str| one["completeness"][key].as_f64().unwrap();
    assert!(at("0.02") < at("0.05") && at("0.05") < at("0.10") && at("0.10") <= 1.0 && at("0.02") > 0.1);
    assert_eq!(one["completeness_of_observable"], one["completeness"]["0.05"]);
    for name in ["level_single", "best_single", "first_single"] {
        let alone = one["baselines"][name]["completeness"]["0.05"].as_f64().unwrap();
        let gain = one["baselines"][name]["gain_points"]["0.05"].as_f64().unwrap();
        assert!((gain - 100.0 * (at("0.05") - alone)).abs() < 1e-9, "{name}");
        assert!(gain > 0.0, "{name}: two sensors see more of a bare room");
    }
}

fn ideal_sensors_refuse_what_they_cannot_use() {
    let folder = tempfile::tempdir().unwrap();
    write_room(folder.path(), 1000.0);
    let mounts = ["--mounts", "0,0,0,0,0"];
    let refused = |more: &[&str], words: &[&str]| {
        let output = validate(folder.path(), &[&mounts[..], more].concat());
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(matches!(output.status.code(), Some(1 | 2)), "{text}");
        assert!(output.stdout.is_empty());
        assert!(words.iter().all(|word| text.contains(word)), "{text:?} lacks one of {words:?}");
    };
    refused(&[], &["room.obj", "6000", "unit"]);
    let fine = validate(folder.path(), &[&mounts[..], &["--mesh-unit", "mm"]].concat());
    assert!(fine.status.success(), "{}", String::from_utf8_lossy(&fine.stderr));

    write_room(folder.path(), 1.0);
    let write = |name: &str, text: &[u8]| std::fs::write(folder.path().join(name), text).unwrap();
    write("walk.tum", b"0 1 2 1.5 0 0 0 1\n1 2 2 1.5 0 0 0 3\n");
    refused(&[], &["walk.tum", "line 2", "norm 3"]);
    write("walk.tum", b"0 1 2 1.5 0 0 0 1\n");
    refused(&[], &["walk.tum", "one revolution"]);
    write("walk.tum", b"0 1 2 1.5 0 0 0 1\n2 1 2 1.5 0 0 0 1\n");
    let zero_length = validate(folder.path(), &mounts);
    assert!(zero_length.status.success(), "a rig that stands still is no error");
    write("walk.tum", b"0 100 2 1.5 0 0 0 1\n2 101 2 1.5 0 0 0 1\n");
    let outside = validate(folder.path(), &mounts);
    let document: serde_json::Value = crate::support::document(&outside.stdout).unwrap();
    assert!(document["warnings"].to_string().contains("outside the mesh"), "{document}");
    assert_eq!(document["completeness_of_observable"].as_f64(), Some(0.0));

    write("walk.tum", b"0 1 2 1.5 0 0 0 1\n2 2 2 1.5 0 0 0 1\n");
    write("bad.npy", b"\x93NUMPY\x01\x00v\x00{'descr': '<i4'");
    let samples = validate_with_samples(folder.path());
    assert!(samples.contains("bad.npy") && samples.contains("header"), "{samples}");
    refused(&["--max-range", "0.1"], &["0.1"]);
    write("room.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n");
    refused(&[], &["room.obj", "vertex 3"]);
    write("room.obj", b"v 0 0 0\nv 1 0 0\nv 0 nan 0\nf 1 2 3\n");
    refused(&[], &["room.obj", "no triangle is left", "not finite"]);
    write("room.obj", b"");
    refused(&[], &["room.obj", "no triangle"]);
}

fn validate_with_samples(folder: &Path) -> String {
    let exe = env!("CARGO_BIN_EXE_outrigger");
    let output = Command::new(exe)
        .current_dir(folder)
        .args(["predict", "--ideal", "--scene", "room.obj", "--trajectory", "walk.tum", "--sensor", "vlp-16"])
        .args(["--mounts", "0,0,0,0,0", "--samples", "bad.npy"])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(1));
    String::from_utf8_lossy(&output.stderr).into_owned()
}
