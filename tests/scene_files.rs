//! Scenes and trajectories as people bring them: each file of `field/scenes` by its right answer, and others of its kind.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use outrigger::mock::sensor::{MockSensor, Surroundings};
use outrigger::recording::{SensorInfo, SessionWriter};
use outrigger::rig::MountFile;
use outrigger::world::scene::{MeshUnit, Scene, load_mesh};
use outrigger::world::trajectory::Trajectory;
use sensors::Packet;
use sensors::velodyne::{Product, ReturnMode};
use serde_json::Value;

use crate::support::{Case, shared, with_shared};

pub const CASES: &[Case] = &[
    with_shared("rooms_of_every_kind_are_180_m2", rooms_of_every_kind),
    with_shared("a_doorway_drawn_as_one_polygon_stays_open", doorway),
    with_shared("millimetres_are_doubted_in_every_format", millimetres),
    with_shared("walks_of_every_kind_are_read", walks),
    with_shared("a_room_in_utm_is_as_at_the_origin", utm),
    with_shared("far_frames_are_as_at_the_origin", far_frames),
    with_shared("tristrips_are_predicted_as_the_room", tristrips),
    with_shared("a_path_in_another_frame_is_no_success", misplaced),
    with_shared("a_recording_in_utm_is_compared_as_at_the_origin", compared),
];

fn field(name: &str) -> PathBuf {
    shared(&format!("field/scenes/{name}"))
}

fn outrigger(arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_outrigger"));
    command.args(arguments).env_remove("OUTRIGGER_JSON").output().unwrap()
}

fn validate(mesh: &Path, walk: &Path, more: &[&str]) -> Output {
    let [mesh, walk, mount] =
        [mesh.to_owned(), walk.to_owned(), field("vlp16-pair.json")].map(|p| p.display().to_string());
    let base = ["predict", "--ideal", "--scene", &mesh, "--trajectory", &walk, "--mount", &mount, "--json"];
    outrigger(&[&base[..], &["--sample-count", "20000"], more].concat())
}

fn predict(scene: &Path, walk: &Path, more: &[&str]) -> Output {
    let [scene, walk, mount] =
        [scene.to_owned(), walk.to_owned(), field("vlp16-pair.json")].map(|p| p.display().to_string());
    let base = ["predict", "--scene", &scene, "--trajectory", &walk, "--mount", &mount, "--json"];
    outrigger(&[&base[..], &["--fidelity", "given"], more].concat())
}

fn ideal(scene: &Path, walk: &Path) -> Output {
    let [scene, walk, mount] =
        [scene.to_owned(), walk.to_owned(), field("vlp16-pair.json")].map(|p| p.display().to_string());
    let base = ["predict", "--ideal", "--scene", &scene, "--trajectory", &walk, "--mount", &mount, "--json"];
    let quick = ["--azimuths", "64", "--sample-count", "20000"];
    outrigger(&[&base[..], &quick].concat())
}

fn document(output: &Output) -> Value {
    crate::support::document(&output.stdout).unwrap_or_else(|_| panic!("{}", errors(output)))
}

fn errors(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Completeness in percent, as printed.
fn percent(document: &Value) -> [String; 3] {
    ["0.02", "0.05", "0.10"]
        .map(|key| format!("{:.3}", 100.0 * document["completeness"][key].as_f64().unwrap()))
}

fn rooms_of_every_kind() {
    for name in [
        "origin-room.obj",
        "utm-room.obj",
        "bom-room.obj",
        "latin1-names.obj",
        "comment-in-face.obj",
        "tristrips-room.ply",
        "percent-uri.gltf",
    ] {
        let loaded = load_mesh(&field(name), None, None).unwrap_or_else(|error| panic!("{error}"));
        let mesh = &loaded.mesh;
        let extent_m = mesh.bounds_m()[1] - mesh.bounds_m()[0];
        assert_eq!((mesh.triangles(), mesh.degenerate()), (12, 0), "{name}");
        assert!((mesh.area_m2() - 180.0).abs() < 1e-6, "{name}: {}", mesh.area_m2());
        assert!((extent_m - glam::DVec3::new(8.0, 6.0, 3.0)).length() < 1e-8, "{name}: {extent_m}");
        assert_eq!(loaded.warnings, Vec::<String>::new(), "{name}");
    }
}

fn doorway() {
    for name in ["doorway.obj", "doorway-quads.obj"] {
        let mesh = load_mesh(&field(name), None, None).unwrap().mesh;
        assert!((mesh.area_m2() - 195.9).abs() < 1e-9, "{name}: {}", mesh.area_m2());
        let output = validate(&field(name), &field("doorway-walk.tum"), &[]);
        assert!(output.status.success(), "{}", errors(&output));
        let document = document(&output);
        // samples are drawn triangle by triangle: of the polygon's others, within 4 standard deviations of both
        let within = if name == "doorway.obj" { 2.0 } else { 0.0051 };
        for (found, right) in percent(&document).iter().zip([42.96, 50.69, 55.45]) {
            let found: f64 = found.parse().unwrap();
            assert!((found - right).abs() < within, "{name}: {found} {right}");
        }
        assert!((document["area_m2"].as_f64().unwrap() - 195.9).abs() < 1e-9);
        let seen = self::document(&predict(&field(name), &field("doorway-walk.tum"), &[]));
        assert_eq!(seen["unique_voxels"], 10_153, "{name}");
    }
}

fn millimetres() {
    let folder = tempfile::tempdir().unwrap();
    let walk = field("origin-walk.tum");
    let scaled = |per_metre: f64| {
        let text = std::fs::read_to_string(field("origin-room.obj")).unwrap();
        let line = |line: &str| match line.strip_prefix("v ") {
            Some(point) => {
                let numbers = point.split(' ').map(|n| (n.parse::<f64>().unwrap() * per_metre).to_string());
                format!("v {}\n", numbers.collect::<Vec<_>>().join(" "))
            }
            None => format!("{line}\n"),
        };
        let path = folder.path().join("scaled.obj");
        std::fs::write(&path, text.lines().map(line).collect::<String>()).unwrap();
        path
    };
    let gltf = field("millimetres.gltf");
    for (path, unit, words) in [
        (gltf.clone(), "mm", "in mm it would be 8.00 x 6.00 x 3.00 m"),
        (scaled(1000.0), "mm", "in mm it would be 8.00 x 6.00 x 3.00 m"),
    ] {
        let refused = validate(&path, &walk, &[]);
        assert_eq!(refused.status.code(), Some(1));
        assert!(
            errors(&refused).contains(words) && errors(&refused).contains("--mesh-unit"),
            "{}",
            errors(&refused)
        );
        let read = document(&validate(&path, &walk, &["--mesh-unit", unit]));
        assert!((read["area_m2"].as_f64().unwrap() - 180.0).abs() < 1e-6, "{read}");
        assert_eq!(percent(&read), ["79.230", "89.335", "92.300"], "{}", path.display());
    }
    for (per_metre, name, unit) in [
        (1.0 / 0.3048, "ft", MeshUnit::Foot),
        (3937.0 / 1200.0, "us-ft", MeshUnit::SurveyFoot),
        (1.0 / 0.0254, "in", MeshUnit::Inch),
        (100.0, "cm", MeshUnit::Centimetre),
    ] {
        let path = scaled(per_metre);
        let mesh = load_mesh(&path, Some(unit), None).unwrap().mesh;
        assert!((mesh.area_m2() - 180.0).abs() < 1e-6, "{name}: {}", mesh.area_m2());
        let read = document(&validate(&path, &walk, &["--mesh-unit", name, "--azimuths", "30"]));
        assert_eq!(read["mesh"]["unit"], name);
    }
    let inches = scaled(1.0 / 0.0254);
    let coarse = ["--azimuths", "30", "--voxel", "2"];
    let doubted = document(&validate(&inches, &field("origin-walk.tum"), &coarse))["warnings"].to_string();
    assert!(doubted.contains("in inches it would be 8.00 x 6.00 x 3.00 m"), "{doubted}");
    // a comment of the file states its unit
    let text = std::fs::read_to_string(&inches).unwrap();
    std::fs::write(&inches, format!("# File units = inches\n{text}")).unwrap();
    let loaded = load_mesh(&inches, None, None).unwrap();
    assert!((loaded.mesh.area_m2() - 180.0).abs() < 1e-6 && loaded.unit == MeshUnit::Inch);
    assert!(loaded.warnings.iter().any(|words| words.contains("read in in")), "{:?}", loaded.warnings);
}

fn walks() {
    let read = |name: &str| {
        let bytes = std::fs::read(field(name)).unwrap();
        Trajectory::read(&bytes, None).unwrap_or_else(|error| panic!("{name}: {error}"))
    };
    let [marked, plain] = ["bom-walk.tum", "origin-walk.tum"].map(read);
    assert_eq!(marked.trajectory, plain.trajectory);
    assert_eq!((marked.trajectory.stamped().count(), marked.notes.len()), (2, 0));
    let repeated = read("repeated-stamp.tum");
    assert_eq!(repeated.trajectory.stamped().count(), 201);
    assert_eq!(repeated.notes.len(), 1, "{:?}", repeated.notes);
    assert!(
        repeated.notes[0].contains("1 pose") && repeated.notes[0].contains("line 51"),
        "{:?}",
        repeated.notes
    );
    let output = validate(&field("origin-room.obj"), &field("repeated-stamp.tum"), &["--azimuths", "30"]);
    assert!(output.status.success(), "{}", errors(&output));
    assert!(document(&output)["warnings"].to_string().contains("line 51"));
}

fn utm() {
    let near = validate(&field("origin-room.obj"), &field("origin-walk.tum"), &[]);
    let far = validate(&field("utm-room.obj"), &field("utm-walk.tum"), &[]);
    assert!(near.status.success() && far.status.success(), "{}", errors(&far));
    let (near, far) = (document(&near), document(&far));
    assert_eq!(percent(&near), ["79.230", "89.335", "92.300"]);
    same(&near, &far, "");
    let folder = tempfile::tempdir().unwrap();
    let out = |name: &str| folder.path().join(name).display().to_string();
    let near = predict(&field("origin-room.obj"), &field("origin-walk.tum"), &["--out", &out("near.ply")]);
    let far = predict(&field("utm-room.obj"), &field("utm-walk.tum"), &["--out", &out("far.ply")]);
    let (near, far) = (document(&near), document(&far));
    assert_eq!(near["unique_voxels"], 16_279);
    same(&near, &far, "");
    let origin =
        |document: &Value| [0, 1, 2].map(|axis| document["grid"]["origin_m"][axis].as_f64().unwrap());
    let moved: [f64; 3] = std::array::from_fn(|axis| origin(&far)[axis] - origin(&near)[axis]);
    for (found, shift) in moved.iter().zip([412_345.37, 5_567_890.63, 312.2]) {
        assert!((found - shift).abs() < 1e-8, "{moved:?}");
    }
    // the coverage file is in the frame of the scene
    let map = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    let points = |bytes: &[u8]| -> Vec<[f64; 3]> {
        let body = bytes.windows(11).position(|window| window == b"end_header\n").unwrap() + 11;
        let number = |row: &[u8], at: usize| f64::from_le_bytes(row[8 * at..8 * at + 8].try_into().unwrap());
        bytes[body..].chunks_exact(28).map(|row| [0, 1, 2].map(|axis| number(row, axis))).collect()
    };
    let (near, far) = (points(&map("near.ply")), points(&map("far.ply")));
    assert_eq!((near.len(), far.len()), (16_279, 16_279));
    for (near, far) in near.iter().zip(&far) {
        let off = (0..3).map(|axis| (far[axis] - near[axis] - [412_345.37, 5_567_890.63, 312.2][axis]).abs());
        assert!(off.fold(0.0, f64::max) < 1e-8, "{near:?} {far:?}");
    }
}

/// All figures but times, places and names of files, to 12 digits.
fn same(near: &Value, far: &Value, at: &str) {
    const OTHER: [&str; 6] = ["origin_m", "local_origin_m", "centre_m", "around_m", "warnings", "problems"];
    match (near, far) {
        (Value::Object(near), Value::Object(far)) => {
            assert_eq!(near.keys().collect::<Vec<_>>(), far.keys().collect::<Vec<_>>(), "{at}");
            for (key, value) in
                near.iter().filter(|(key, _)| !key.ends_with("_s") && !OTHER.contains(&key.as_str()))
            {
                same(value, &far[key], &format!("{at}/{key}"));
            }
        }
        (Value::Array(near), Value::Array(far)) => {
            assert_eq!(near.len(), far.len(), "{at}");
            near.iter()
                .zip(far)
                .enumerate()
                .for_each(|(n, (near, far))| same(near, far, &format!("{at}/{n}")));
        }
        (Value::Number(near), Value::Number(far)) => {
            let (near, far) = (near.as_f64().unwrap(), far.as_f64().unwrap());
            assert!((near - far).abs() <= 1e-6 * near.abs().max(1e-3), "{at}: {near} {far}");
        }
        _ => assert_eq!(near, far, "{at}"),
    }
}

fn far_frames() {
    let coarse = ["--azimuths", "180"];
    let near = document(&validate(&field("origin-room.obj"), &field("origin-walk.tum"), &coarse));
    let folder = tempfile::tempdir().unwrap();
    let moved = |text: &str, from: usize, shift: [f64; 3]| -> String {
        let line = |line: &str| {
            let mut words: Vec<String> = line.split(' ').map(str::to_owned).collect();
            if line.starts_with('v') || from == 1 && !line.starts_with('#') && words.len() == 8 {
                for axis in 0..3 {
                    let value: f64 = words[1 + axis].parse().unwrap();
                    words[1 + axis] = format!("{:.6}", value + shift[axis]);
                }
            }
            words.join(" ") + "\n"
        };
        text.lines().map(line).collect()
    };
    let room = std::fs::read_to_string(field("origin-room.obj")).unwrap();
    let walk = std::fs::read_to_string(field("origin-walk.tum")).unwrap();
    for shift in [
        [4_156_789.25, 854_321.5, 4_744_123.125],
        [-4_156_789.25, -5_000_000.4, -0.3],
        [2e7, -2e7, -2_684_354.0],
        [9_000.7, -9_000.2, 1_000.0],
    ] {
        let (mesh, path) = (folder.path().join("far.obj"), folder.path().join("far.tum"));
        std::fs::write(&mesh, moved(&room, 0, shift)).unwrap();
        std::fs::write(&path, moved(&walk, 1, shift)).unwrap();
        let far = validate(&mesh, &path, &coarse);
        assert!(far.status.success(), "{shift:?}: {}", errors(&far));
        same(&near, &document(&far), &format!("{shift:?}"));
    }
}

fn tristrips() {
    let output = predict(&field("tristrips-room.ply"), &field("origin-walk.tum"), &[]);
    assert!(output.status.success(), "{}", errors(&output));
    let document = document(&output);
    assert_eq!(document["returns"], 1_145_472);
    assert!((document["mesh"]["area_m2"].as_f64().unwrap() - 180.0).abs() < 1e-9);
}

fn misplaced() {
    let folder = tempfile::tempdir().unwrap();
    let walk = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path
    };
    let below = walk("below.tum", "100 -3 0 -2 0 0 0 1\n102 3 0 -2 0 0 0 1\n");
    let beside = walk("beside.tum", "100 103 0 1 0 0 0 1\n102 109 0 1 0 0 0 1\n");
    for (scene, path, words) in [
        (field("origin-room.obj"), below.clone(), "z -1.9 to -1.9 m"),
        (field("origin-room.obj"), beside, "the path at x 103.0 to 109.0"),
        (field("origin-room.obj"), field("utm-walk.tum"), "412342.4 to 412348.4"),
        (field("utm-room.obj"), field("origin-walk.tum"), "the mesh at x 412341.4 to 412349.4"),
    ] {
        for output in [
            validate(&scene, &path, &["--azimuths", "30"]),
            predict(&scene, &path, &["--azimuths", "512"]),
            ideal(&scene, &path),
        ] {
            assert_eq!(output.status.code(), Some(3), "{}", errors(&output));
            let warnings = document(&output)["warnings"].to_string();
            assert!(warnings.contains(words) && warnings.contains("--up"), "{warnings}");
        }
    }
    // the floor of a building on a hill: below it there is nothing, above it the floor
    let output = validate(&shared("scenes/house.ply"), &below, &["--azimuths", "30"]);
    assert_eq!(output.status.code(), Some(3), "{}", errors(&output));
}

/// One recording, compared in both frames: the text is the same to the last letter but for places and times.
fn compared() {
    let folder = tempfile::tempdir().unwrap();
    let session = folder.path().join("session");
    let mount = MountFile::read(&field("vlp16-pair.json")).unwrap();
    let scene = Scene::Mesh(load_mesh(&field("origin-room.obj"), None, None).unwrap().mesh.into());
    let walk = Trajectory::read(&std::fs::read(field("origin-walk.tum")).unwrap(), None).unwrap().trajectory;
    // the first four revolutions
    let times_ns = [0, 400_000_000].map(|after_ns| walk.time_span_ns()[0] + after_ns);
    let walk =
        Trajectory::new(times_ns.map(|time_ns| (time_ns, walk.at(time_ns).unwrap())).to_vec()).unwrap();
    let named = |name: &str| SensorInfo { name: name.into(), ..SensorInfo::default() };
    let infos: Vec<SensorInfo> = mount.sensors.iter().map(|entry| named(&entry.name)).collect();
    let writer = SessionWriter::create(&session, &infos).unwrap();
    for (sensor, entry) in mount.sensors.iter().enumerate() {
        let pose = entry.mount().body_from_sensor();
        let surroundings = Surroundings {
            scene: &scene,
            trajectory: &walk,
            body_from_sensor: &|_| pose,
            noise_m: 0.01,
            seed: 1 + sensor as u64,
        };
        let source = format!("10.0.0.{}:2368", sensor + 1).parse().unwrap();
        let destination = "10.0.0.100:2368".parse().unwrap();
        MockSensor::velodyne(Product::from_name("vlp-16").unwrap(), ReturnMode::Strongest, 10.0)
            .unwrap()
            .run(&surroundings, |host_time_ns, payload| {
                writer.write_packet(
                    sensor,
                    &Packet { host_time_ns, source, destination, link: Default::default(), payload },
                )
            })
            .unwrap();
    }
    writer.put_mount(&mount, &[]).unwrap();
    writer.close(None).unwrap();
    let compare = |scene: &str, walk: &str| {
        let [session, scene, walk] =
            [session.clone(), field(scene), field(walk)].map(|path| path.display().to_string());
        let output = outrigger(&[
            "compare",
            &session,
            "--json",
            "--nulls",
            "3",
            "--scene",
            &scene,
            "--trajectory",
            &walk,
            "--time-offset",
            "start",
        ]);
        document(&output)
    };
    let near = compare("origin-room.obj", "origin-walk.tum");
    let far = compare("utm-room.obj", "utm-walk.tum");
    for sensor in ["master", "mirrored"] {
        let share = near["rays"][sensor]["agree_share"].as_f64().unwrap();
        assert!(share > 0.95, "{sensor}: {share}");
    }
    same(&near, &far, "");
}
