//! Mesh files as people write them, each property alone.

use outrigger::world::scene::{MeshUnit, load_mesh};

use crate::support::{Case, case};

pub const CASES: &[Case] = &[
    case("obj_as_people_write_it", obj_as_people_write_it),
    case("stl_as_people_write_it", stl_as_people_write_it),
    case("gltf_as_people_write_it", gltf_as_people_write_it),
    case("single_precision_far_away_is_named", single_precision),
    case("facets_that_are_not_finite_are_counted", not_finite),
];

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
