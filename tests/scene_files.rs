//! Scenes and trajectories as people bring them: each file of `field/scenes` by its right answer, and others of its kind.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use outrigger::world::scene::{MeshUnit, load_mesh};
use outrigger::world::trajectory::Trajectory;
use serde_json::Value;

use crate::support::{Case, case, shared, with_shared};

pub const CASES: &[Case] = &[
    with_shared("rooms_of_every_kind_are_180_m2", rooms_of_every_kind),
    with_shared("a_doorway_drawn_as_one_polygon_stays_open", doorway),
    with_shared("millimetres_are_doubted_in_every_format", millimetres),
    with_shared("walks_of_every_kind_are_read", walks),
    with_shared("a_room_in_utm_is_as_at_the_origin", utm),
    with_shared("far_frames_are_as_at_the_origin", far_frames),
    with_shared("tristrips_are_predicted_as_the_room", tristrips),
    with_shared("a_path_in_another_frame_is_no_success", misplaced),
    case("obj_as_people_write_it", obj_as_people_write_it),
    case("stl_as_people_write_it", stl_as_people_write_it),
    case("gltf_as_people_write_it", gltf_as_people_write_it),
    case("single_precision_far_away_is_named", single_precision),
    case("facets_that_are_not_finite_are_counted", not_finite),
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
    let base = ["validate", "--mesh", &mesh, "--trajectory", &walk, "--mount", &mount, "--json"];
    outrigger(&[&base[..], &["--sample-count", "20000", "--no-baselines"], more].concat())
}

fn predict(scene: &Path, walk: &Path, more: &[&str]) -> Output {
    let [scene, walk, mount] =
        [scene.to_owned(), walk.to_owned(), field("vlp16-pair.json")].map(|p| p.display().to_string());
    let base = ["predict", "--scene", &scene, "--trajectory", &walk, "--mount", &mount, "--json"];
    outrigger(&[&base[..], &["--no-baselines", "--fidelity", "given"], more].concat())
}

fn document(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{}", errors(output)))
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
    let doubted = document(&validate(&inches, &field("origin-walk.tum"), &["--azimuths", "30"]))["warnings"]
        .to_string();
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
        for output in
            [validate(&scene, &path, &["--azimuths", "30"]), predict(&scene, &path, &["--azimuths", "512"])]
        {
            assert_eq!(output.status.code(), Some(3), "{}", errors(&output));
            let warnings = document(&output)["warnings"].to_string();
            assert!(warnings.contains(words) && warnings.contains("--up"), "{warnings}");
        }
    }
    // the floor of a building on a hill: below it there is nothing, above it the floor
    let output = validate(&shared("scenes/house.ply"), &below, &["--azimuths", "30"]);
    assert_eq!(output.status.code(), Some(3), "{}", errors(&output));
}

/// Area of a file of this name and content, and what is said of it.
fn area(name: &str, content: &[u8]) -> Result<(f64, Vec<String>), String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, content).unwrap();
    let loaded = load_mesh(&path, None, None).map_err(|error| error.to_string())?;
    Ok((loaded.mesh.area_m2(), loaded.warnings))
}

fn obj_as_people_write_it() {
    let plain = "v 0 0 0\nv 2 0 0\nv 2 1 0\nv 0 1 0\nf 1 2 3 4\n";
    for (what, text) in [
        ("plain", plain.to_owned()),
        ("CRLF", plain.replace('\n', "\r\n")),
        ("old Mac", plain.replace('\n', "\r")),
        ("upper case", plain.to_uppercase()),
        ("indented, tabs", plain.lines().map(|line| format!("\t  {}\n", line.replace(' ', "\t"))).collect()),
        ("comments", plain.lines().map(|line| format!("{line}#x\n# v 9 9 9\n")).collect()),
        ("joined lines", plain.replace("1 2 3 4", "1 2 \\\n 3 \\\n4").replace("v 2 0 0", "v 2 \\\r\n0 0")),
        ("colours", plain.replace(" 0\n", " 0 0.1 0.2 0.3\n")),
        ("face before its vertices", "f 1 2 3 4\n".to_owned() + &plain.replace("f 1 2 3 4\n", "")),
        ("negative numbers", plain.replace("1 2 3 4", "-4//-1 -3/1/1 -2/ -1")),
        (
            "names in other words",
            format!("g W\u{e4}nde\nusemtl \u{fc}\nmtllib a b.mtl\ns off\nl 1 2\n{plain}"),
        ),
    ] {
        let (area_m2, _) = area("a.obj", text.as_bytes()).unwrap_or_else(|error| panic!("{what}: {error}"));
        assert_eq!(area_m2, 2.0, "{what}");
    }
    let wide: Vec<u8> = plain.encode_utf16().flat_map(u16::to_le_bytes).collect();
    assert!(area("a.obj", &[b"\xff\xfe", &wide[..]].concat()).unwrap_err().contains("UTF-16"));
}

fn stl_as_people_write_it() {
    let facet = |a: &str, b: &str, c: &str| {
        format!("facet normal 0 0 1\nouter loop\nvertex {a}\nvertex {b}\nvertex {c}\nendloop\nendfacet\n")
    };
    let body = facet("0 0 0", "2 0 0", "2 1 0") + &facet("0 0 0", "2 1 0", "0 1 0");
    let plain = format!("solid a b c\n{body}endsolid a b c\n");
    let latin = [b"solid W\xe4nde\n", body.as_bytes(), b"endsolid W\xe4nde\n"].concat();
    for (what, text) in [
        ("plain", plain.clone().into_bytes()),
        ("mark", format!("\u{feff}{plain}").into_bytes()),
        ("Latin-1", latin),
        ("CRLF", plain.replace('\n', "\r\n").into_bytes()),
        ("old Mac", plain.replace('\n', "\r").into_bytes()),
        ("upper case", plain.to_uppercase().into_bytes()),
        ("indented", plain.lines().map(|line| format!(" \t{line} \n")).collect::<String>().into_bytes()),
        (
            "one line each facet",
            plain.replace("\nouter", " outer").replace("\nvertex", " vertex").into_bytes(),
        ),
        ("comments", plain.lines().map(|line| format!("{line} # here\n")).collect::<String>().into_bytes()),
        (
            "normals of Windows",
            plain.replace("normal 0 0 1", "normal -nan(ind) 1.#QNAN -1.#IND").into_bytes(),
        ),
        ("two solids", format!("{plain}\n\n{}", plain.replace(" 0\n", " 5\n")).into_bytes()),
    ] {
        let (area_m2, _) = area("a.stl", &text).unwrap_or_else(|error| panic!("{what}: {error}"));
        assert_eq!(area_m2, if what == "two solids" { 4.0 } else { 2.0 }, "{what}");
    }
}

/// A square of 1 m, y up, in a buffer beside the document.
fn gltf(nodes: &str, roots: &str, more: &str) -> String {
    let bytes: Vec<u8> = [[0.0_f32, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 1.0], [0.0, 0.0, 1.0]]
        .iter()
        .flatten()
        .chain(&[1e6, 0.0, 0.0, 1e6, 3.0, 0.0])
        .flat_map(|n| n.to_le_bytes())
        .collect();
    let letters = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let text: String = bytes
        .chunks(3)
        .flat_map(|three| {
            let bits = three.iter().fold(0_u32, |bits, byte| bits << 8 | u32::from(*byte));
            (0..4).map(move |n| letters[(bits >> (18 - 6 * n) & 63) as usize] as char)
        })
        .collect();
    format!(
        r#"{{"asset":{{"version":"2.0"}},{more}"scene":0,"scenes":[{{"nodes":[{roots}]}}],"nodes":[{nodes}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"mode":6}}]}}],
        "buffers":[{{"byteLength":72,"uri":"data:application/octet-stream;base64,{text}"}}],
        "bufferViews":[{{"buffer":0,"byteLength":48}},{{"buffer":0,"byteOffset":48,"byteLength":24}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3"}},
        {{"bufferView":1,"componentType":5126,"count":2,"type":"VEC3"}}]}}"#
    )
}

fn gltf_as_people_write_it() {
    let of = |nodes: &str, roots: &str, more: &str| area("a.gltf", gltf(nodes, roots, more).as_bytes());
    let plain = r#"{"mesh":0}"#;
    assert_eq!(of(plain, "0", "").unwrap().0, 1.0, "no bounds of positions");
    let used = r#""extensionsUsed":["KHR_materials_unlit","EXT_some_thing"],"extensionsRequired":["KHR_texture_transform"],"#;
    assert_eq!(of(plain, "0", used).unwrap().0, 1.0, "extensions about looks");
    let needed = of(plain, "0", r#""extensionsRequired":["KHR_draco_mesh_compression"],"#).unwrap_err();
    assert!(needed.contains("KHR_draco_mesh_compression is not supported"), "{needed}");
    assert_eq!(
        of(r#"{"mesh":0},{"mesh":0,"translation":[5,0,0]}"#, "0,1", "").unwrap().0,
        2.0,
        "one mesh, two nodes"
    );
    let scaled = r#"{"children":[1],"scale":[2,2,2]},{"mesh":0,"rotation":[0,0.7071067811865476,0,0.7071067811865476]}"#;
    assert!((of(scaled, "0", "").unwrap().0 - 4.0).abs() < 1e-9);
    let twice = of(r#"{"children":[2]},{"children":[2]},{"mesh":0}"#, "0,1", "").unwrap_err();
    assert!(twice.contains("node 2: child of node 0 and of node 1"), "{twice}");
    let instanced = r#"{"mesh":0,"extensions":{"EXT_mesh_gpu_instancing":{"attributes":{"TRANSLATION":1}}}}"#;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.gltf");
    std::fs::write(&path, gltf(instanced, "0", "")).unwrap();
    let mesh = load_mesh(&path, Some(MeshUnit::Metre), None).unwrap();
    assert_eq!((mesh.mesh.triangles(), mesh.mesh.area_m2()), (4, 2.0), "two instances");
    // a node places the mesh in a national grid, in numbers that 32 bits do not hold
    let placed = r#"{"mesh":0,"translation":[412345.37,312.2,-5567890.63]}"#;
    std::fs::write(&path, gltf(placed, "0", "")).unwrap();
    let loaded = load_mesh(&path, None, None).unwrap();
    let low_m = loaded.origin.world(loaded.mesh.bounds_m()[0]);
    assert!(low_m.abs_diff_eq(glam::DVec3::new(412_345.37, 5_567_889.63, 312.2), 1e-8), "{low_m}");
    assert_eq!(loaded.warnings, Vec::<String>::new());
    for (uri, name) in [
        ("./a.bin", "a.bin"),
        ("hall%201.bin", "hall 1.bin"),
        ("W%C3%A4nde.bin", "W\u{e4}nde.bin"),
        ("b%20.bin", "b%20.bin"),
    ] {
        std::fs::write(folder.path().join(name), [0; 72]).unwrap();
        let inside = gltf(plain, "0", "");
        let start = inside.find("data:").unwrap();
        let end = start + inside[start..].find('"').unwrap();
        std::fs::write(&path, format!("{}{uri}{}", &inside[..start], &inside[end..])).unwrap();
        let error = load_mesh(&path, None, None).unwrap_err().to_string();
        assert!(error.contains("without area"), "the bytes, all zeros, are found by {uri}: {error}");
    }
}

fn single_precision() {
    let utm = [412_341.37_f64, 5_567_887.63, 312.2];
    let corner = |n: usize, size: f64| -> [f64; 3] {
        std::array::from_fn(|axis| utm[axis] + if n >> axis & 1 == 1 { size } else { 0.0 })
    };
    let faces = [[0, 1, 3], [4, 5, 7], [0, 1, 5]];
    let obj = |number: &dyn Fn(f64) -> String| -> String {
        let vertices = (0..8).map(|n| format!("v {}\n", corner(n, 8.0).map(number).join(" ")));
        let faces = faces.iter().map(|f| format!("f {} {} {}\n", f[0] + 1, f[1] + 1, f[2] + 1));
        vertices.chain(faces).collect()
    };
    let (_, fine) = area("a.obj", obj(&|n| format!("{n:.3}")).as_bytes()).unwrap();
    assert_eq!(fine, Vec::<String>::new());
    let (_, whole) = area("a.obj", obj(&|n| format!("{n:.0}")).as_bytes()).unwrap();
    assert_eq!(whole, Vec::<String>::new(), "a drawing in whole metres");
    let (_, coarse) = area("a.obj", obj(&|n| format!("{:.6}", n as f32)).as_bytes()).unwrap();
    assert!(coarse.len() == 1 && coarse[0].contains("0.5 m at 5.6e6 m"), "{coarse:?}");
    let mut stl = vec![0; 80];
    stl.extend((faces.len() as u32).to_le_bytes());
    for face in faces {
        stl.extend([0; 12]);
        face.iter().flat_map(|n| corner(*n, 8.0)).for_each(|n| stl.extend((n as f32).to_le_bytes()));
        stl.extend([0; 2]);
    }
    let (_, coarse) = area("a.stl", &stl).unwrap();
    assert!(coarse.iter().any(|words| words.contains("0.5 m at 5.6e6 m")), "{coarse:?}");
}

fn not_finite() {
    let (area_m2, warnings) =
        area("a.obj", b"v 0 0 0\nv 2 0 0\nv 2 1 0\nv nan 0 0\nv inf 0 0\nf 1 2 3\nf 1 2 4\nf 1 5 3\n")
            .unwrap();
    assert_eq!(area_m2, 1.0);
    assert!(
        warnings.iter().any(|words| words.contains("2 triangles with a corner that is not finite")),
        "{warnings:?}"
    );
    let ply = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
               element face 2\nproperty list uchar int vertex_indices\nend_header\n\
               0 0 0\n2 0 0\n2 1 0\nnan nan nan\n3 0 1 2\n3 0 1 3\n";
    let (area_m2, warnings) = area("a.ply", ply.as_bytes()).unwrap();
    assert_eq!(area_m2, 1.0);
    assert!(warnings.iter().any(|words| words.contains("1 triangles")), "{warnings:?}");
    assert!(area("a.obj", b"v 0 0 0\nv 2 0 0\nv nan 1 0\nf 1 2 3\n").unwrap_err().contains("no triangle"));
}
