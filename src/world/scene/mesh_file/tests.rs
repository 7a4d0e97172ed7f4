//! One house of cards in every format; what each format can get wrong.

use std::path::Path;

use glam::DVec3;

use super::finish::Stated;
use super::{Fault, LoadedMesh, MeshFileError, MeshUnit, Soup, UpAxis, gltf, load_mesh, obj, off, ply, stl};
use crate::base::rng::Rng;

/// A box of 4 x 3 x 2.5 m (12 triangles).
fn cuboid() -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let corner =
        |n: usize| DVec3::new(4.0 * (n & 1) as f64, 3.0 * (n >> 1 & 1) as f64, 2.5 * (n >> 2) as f64);
    let quads = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
    let halves = quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]);
    ((0..8).map(corner).collect(), halves.collect())
}

const AREA_M2: f64 = 2.0 * (12.0 + 10.0 + 7.5);

fn as_obj() -> Vec<u8> {
    let (points, faces) = cuboid();
    let mut text = String::from("# a box\nmtllib none.mtl\no box\n");
    points.iter().for_each(|p| text += &format!("v {} {} {}\n", p.x, p.y, p.z));
    text += "vn 0 0 1\n";
    faces.iter().for_each(|f| text += &format!("f {}//1 {}//1 {}//1\n", f[0] + 1, f[1] + 1, f[2] + 1));
    text.into_bytes()
}

fn as_off() -> Vec<u8> {
    let (points, faces) = cuboid();
    let mut text = String::from("OFF # a box\n8 12 0\n\n");
    points.iter().for_each(|p| text += &format!("{} {} {} # corner\n", p.x, p.y, p.z));
    faces.iter().for_each(|f| text += &format!("3 {} {} {} 0.5 0.5 0.5\n", f[0], f[1], f[2]));
    text.into_bytes()
}

fn as_stl_text() -> Vec<u8> {
    let (points, faces) = cuboid();
    let mut text = String::from("solid box\n");
    for face in faces {
        text += "facet normal 0 0 0\n outer loop\n";
        face.iter()
            .map(|i| points[*i as usize])
            .for_each(|p| text += &format!("  vertex {} {} {}\n", p.x, p.y, p.z));
        text += " endloop\nendfacet\n";
    }
    (text + "endsolid box\n").into_bytes()
}

fn as_stl_binary(header: &[u8]) -> Vec<u8> {
    let (points, faces) = cuboid();
    let mut bytes = header.to_vec();
    bytes.resize(80, 0);
    bytes.extend((faces.len() as u32).to_le_bytes());
    for face in faces {
        bytes.extend([0; 12]);
        for point in face.map(|i| points[i as usize].as_vec3()) {
            point.to_array().iter().for_each(|n| bytes.extend(n.to_le_bytes()));
        }
        bytes.extend([0; 2]);
    }
    bytes
}

fn as_ply(format: &str, double: bool) -> Vec<u8> {
    let (points, faces) = cuboid();
    let number = if double { "double" } else { "float" };
    let mut bytes = format!(
        "ply\nformat {format} 1.0\ncomment a box\nelement vertex 8\nproperty {number} x\nproperty {number} y\n\
         property {number} z\nproperty uchar red\nelement face 12\nproperty list uchar int vertex_indices\nend_header\n"
    )
    .into_bytes();
    let big = format.contains("big");
    let put = |bytes: &mut Vec<u8>, little: &[u8]| {
        if big { bytes.extend(little.iter().rev()) } else { bytes.extend(little) }
    };
    for p in points {
        match (format, double) {
            ("ascii", _) => bytes.extend(format!("{} {} {} 7\n", p.x, p.y, p.z).bytes()),
            (_, true) => p.to_array().iter().for_each(|n| put(&mut bytes, &n.to_le_bytes())),
            (_, false) => p.as_vec3().to_array().iter().for_each(|n| put(&mut bytes, &n.to_le_bytes())),
        }
        if format != "ascii" {
            bytes.push(7);
        }
    }
    for f in faces {
        if format == "ascii" {
            bytes.extend(format!("3 {} {} {}\n", f[0], f[1], f[2]).bytes());
        } else {
            bytes.push(3);
            f.iter().for_each(|i| put(&mut bytes, &(*i as i32).to_le_bytes()));
        }
    }
    bytes
}

fn as_glb() -> Vec<u8> {
    let (points, faces) = cuboid();
    let mut buffer = Vec::new();
    faces.iter().flatten().for_each(|i| buffer.extend((*i as u16).to_le_bytes()));
    let indices = buffer.len();
    // the file's own up is y: half size, a node scales it back
    for p in &points {
        [p.x / 2.0, p.z / 2.0, -p.y / 2.0].iter().for_each(|n| buffer.extend((*n as f32).to_le_bytes()));
    }
    let mut json = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],
        "nodes":[{{"children":[1],"scale":[2,2,2]}},{{"mesh":0}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":1}},"indices":0}}]}}],
        "buffers":[{{"byteLength":{}}}],
        "bufferViews":[{{"buffer":0,"byteLength":{indices}}},{{"buffer":0,"byteOffset":{indices},"byteLength":96}}],
        "accessors":[{{"bufferView":0,"componentType":5123,"count":36,"type":"SCALAR"}},
        {{"bufferView":1,"componentType":5126,"count":8,"type":"VEC3","min":[0,0,-1.5],"max":[2,1.25,0]}}]}}"#,
        buffer.len()
    );
    while json.len() % 4 != 0 {
        json.push(' ');
    }
    let mut bytes = b"glTF\x02\0\0\0".to_vec();
    bytes.extend((28 + json.len() as u32 + buffer.len() as u32).to_le_bytes());
    bytes.extend((json.len() as u32).to_le_bytes());
    bytes.extend(b"JSON");
    bytes.extend(json.bytes());
    bytes.extend((buffer.len() as u32).to_le_bytes());
    bytes.extend(b"BIN\0");
    bytes.extend(buffer);
    bytes
}

/// A binary file has no lines: where it ends is said in bytes, and within which elements.
#[test]
fn a_cut_binary_ply_is_named_by_its_byte() {
    let whole = as_ply("binary_little_endian", false);
    let cut = &whole[..whole.len() - 5];
    let stated = ply::read(cut).unwrap_err().to_string();
    assert!(stated.starts_with(&format!("byte {}: element face of 12: ", cut.len())), "{stated}");
    assert!(stated.contains("got 11") && !stated.to_lowercase().contains("line"), "{stated}");
}

fn finish(
    path: &Path,
    soup: Soup,
    unit: Option<MeshUnit>,
    up: Option<UpAxis>,
    native_up: UpAxis,
) -> Result<LoadedMesh, MeshFileError> {
    super::finish::finish(path, soup, Stated { unit, up, native_up })
}

type Read = fn(&[u8]) -> Result<Soup, Fault>;

fn every_format() -> Vec<(&'static str, Vec<u8>, Read)> {
    let read_gltf: Read = |bytes| gltf::read(bytes, Path::new(""));
    vec![
        ("obj", as_obj(), obj::read),
        ("off", as_off(), off::read),
        ("stl text", as_stl_text(), stl::read),
        ("stl binary", as_stl_binary(b"made by hand"), stl::read),
        ("stl binary that says solid", as_stl_binary(b"solid box"), stl::read),
        ("ply ascii", as_ply("ascii", false), ply::read),
        ("ply little", as_ply("binary_little_endian", false), ply::read),
        ("ply big", as_ply("binary_big_endian", true), ply::read),
        ("glb", as_glb(), read_gltf),
    ]
}

#[test]
fn every_format_gives_the_same_box() {
    for (name, bytes, read) in every_format() {
        let soup = read(&bytes).unwrap_or_else(|fault| panic!("{name}: {fault}"));
        let up = if name == "glb" { UpAxis::Y } else { UpAxis::Z };
        let loaded = finish(Path::new(name), soup, None, None, up).unwrap();
        assert_eq!((loaded.mesh.triangles(), loaded.warnings.len()), (12, 0), "{name}");
        assert!((loaded.mesh.area_m2() - AREA_M2).abs() < 1e-6, "{name}");
        let [low, high] = loaded.mesh.bounds_m();
        assert!(
            low.length() < 1e-6 && high.distance(DVec3::new(4.0, 3.0, 2.5)) < 1e-6,
            "{name}: {low} {high}"
        );
    }
}

#[test]
fn a_truncated_file_is_refused_with_its_place() {
    for (name, bytes, read) in every_format() {
        let whole = read(&bytes).unwrap().triangles.len();
        for end in 0..bytes.len() - 1 {
            match read(&bytes[..end]) {
                Err(fault) => assert!(!fault.place.is_empty() && !fault.reason.is_empty(), "{name}"),
                // text formats are whole at every line end; what is there must then be right
                Ok(soup) => assert!(
                    name == "obj" && soup.triangles.len() <= whole
                        || name == "ply ascii" && end + 2 > bytes.len()
                        || name == "off" && end + 14 > bytes.len()
                        || name == "stl text" && bytes[..end].windows(8).any(|word| word == b"endsolid"),
                    "{name} cut at {end} of {} gave {} triangles",
                    bytes.len(),
                    soup.triangles.len()
                ),
            }
        }
    }
}

#[test]
fn no_damage_makes_a_reader_panic_or_eat_memory() {
    let mut rng = Rng::new(5, 0);
    for (name, bytes, read) in every_format() {
        for _ in 0..400 {
            let mut damaged = bytes.clone();
            for _ in 0..=rng.below(4) {
                let at = rng.below(damaged.len() as u64) as usize;
                damaged[at] = rng.bits() as u8;
            }
            if let Ok(soup) = read(&damaged) {
                let _ = finish(Path::new(name), soup, Some(MeshUnit::Metre), None, UpAxis::Z);
            }
        }
    }
}

#[test]
fn faults_name_the_line() {
    let fault = |text: &str| obj::read(text.as_bytes()).unwrap_err().to_string();
    assert!(fault("v 1 2 3\nv 1 x 3\n").contains("line 2: \"x\""));
    assert!(fault("v 1 2\n").contains("line 1: a vertex of 2"));
    assert!(fault("v 1 2,5 3\n").contains("follow a point"));
    assert_eq!(obj::read(b"v 0 0 0\nf 1 2\n").unwrap().short_faces, 1, "counted, and reported in the end");
    assert!(fault("v 0 0 0\nf 0 1 1\n").contains("counts from 1"));
    assert!(fault("v 0 0 0\nf -2 1 1\n").contains("vertex number -2"));
    let fault = |text: &str| stl::read(text.as_bytes()).unwrap_err().to_string();
    assert!(fault("solid a\nfacet normal 0 0 0\nvertex 1 2 3\nendfacet\n").contains("line 4: a facet of 1"));
    assert!(fault("solid a\nfacet normal 0 0 0\nouter loop\nvertex 1 2\n").contains("line 4"));
    let text = String::from_utf8(as_ply("ascii", false)).unwrap();
    let fault = ply::read(text.replacen("4 0 0 7", "4 zero 0 7", 1).as_bytes()).unwrap_err().to_string();
    assert!(fault.contains("line 13") && fault.contains("vertex"), "{fault}");
    let cloud = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n0 0 0\n";
    assert!(ply::read(cloud.as_bytes()).unwrap_err().to_string().contains("point cloud"));
}

#[test]
fn a_short_binary_file_names_its_byte_and_facet() {
    let bytes = as_stl_binary(b"x");
    let fault = stl::read(&bytes[..84 + 50 * 3 + 7]).unwrap_err().to_string();
    assert!(fault.contains("byte 241") && fault.contains("facet 3"), "{fault}");
    let bytes = as_ply("binary_little_endian", false);
    let fault = ply::read(&bytes[..bytes.len() - 20]).unwrap_err().to_string();
    assert!(fault.contains("byte") && fault.contains("face"), "{fault}");
}

#[test]
fn obj_takes_polygons_back_references_and_joined_lines() {
    let soup = obj::read(b"v 0 0 0\r\nv 1 0 0\r\nv 1 1 \\\n0\nv 0 1 0\nf -4/1 -3/2 -2/3 -1/4\n").unwrap();
    assert_eq!(soup.triangles, [[0, 1, 2], [0, 2, 3]]);
    assert_eq!(soup.vertices[2], DVec3::new(1.0, 1.0, 0.0));
}

#[test]
fn millimetres_are_refused_until_stated() {
    let scaled = |scale: f64| {
        let (vertices, triangles) = cuboid();
        Soup { vertices: vertices.into_iter().map(|p| p * scale).collect(), triangles, ..Soup::default() }
    };
    let path = Path::new("box.stl");
    for scale in [1000.0, 0.001] {
        let error = finish(path, scaled(scale), None, None, UpAxis::Z).unwrap_err();
        assert!(matches!(error, MeshFileError::UnitUnclear { .. }), "{error}");
        assert!(error.to_string().contains("box.stl") && error.to_string().contains("unit"), "{error}");
    }
    for (scale, unit) in
        [(1000.0, MeshUnit::Millimetre), (100.0, MeshUnit::Centimetre), (1.0, MeshUnit::Metre)]
    {
        let loaded = finish(path, scaled(scale), Some(unit), None, UpAxis::Z).unwrap();
        assert!((loaded.mesh.area_m2() - AREA_M2).abs() < 1e-9);
    }
    // 4 m in centimetres is 400 units: no building in metres is surely too large for that, so it is taken as said
    assert!(finish(path, scaled(100.0), None, None, UpAxis::Z).is_ok());
}

#[test]
fn a_mesh_that_lies_on_its_side_is_doubted() {
    let (vertices, triangles) = cuboid();
    let lying = vertices.into_iter().map(|p| DVec3::new(p.x, 0.7 * p.z, p.y)).collect();
    let soup = Soup { vertices: lying, triangles, ..Soup::default() };
    let loaded = finish(Path::new("a.obj"), soup, None, None, UpAxis::Z).unwrap();
    assert!(loaded.warnings[0].contains("flattest along y"), "{:?}", loaded.warnings);
}

#[test]
fn files_that_are_not_there_or_unknown_are_named() {
    let error = load_mesh(Path::new("nowhere/none.ply"), None, None).unwrap_err().to_string();
    assert!(error.contains("nowhere/none.ply"), "{error}");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.fbx");
    std::fs::write(&path, b"x").unwrap();
    let error = load_mesh(&path, None, None).unwrap_err().to_string();
    assert!(error.contains("scene.fbx") && error.contains(".ply"), "{error}");
}

#[test]
fn gltf_buffers_lie_in_the_folder_or_inside_the_file() {
    let glb = as_glb();
    let json_length = u32::from_le_bytes([glb[12], glb[13], glb[14], glb[15]]) as usize;
    let json = std::str::from_utf8(&glb[20..20 + json_length]).unwrap();
    let buffer = &glb[28 + json_length..];
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("box.bin"), buffer).unwrap();
    let with =
        |uri: &str| json.replace(r#""byteLength":168}]"#, &format!(r#""byteLength":168,"uri":"{uri}"}}]"#));
    let read = |uri: &str| gltf::read(with(uri).as_bytes(), folder.path());
    assert_eq!(read("box.bin").unwrap().triangles.len(), 12);
    for (uri, reason) in
        [("../box.bin", "leads out"), ("gone.bin", "gone.bin"), ("http://a/b", "in the folder")]
    {
        assert!(read(uri).unwrap_err().to_string().contains(reason), "{uri}");
    }
    let letters = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let text: String = buffer
        .chunks(3)
        .flat_map(|three| {
            let bits =
                (0..3).fold(0_u32, |bits, n| bits << 8 | u32::from(three.get(n).copied().unwrap_or(0)));
            (0..=three.len()).map(move |n| letters[(bits >> (18 - 6 * n) & 63) as usize] as char)
        })
        .collect();
    let inside = read(&format!("data:application/octet-stream;base64,{text}")).unwrap();
    assert_eq!(inside.vertices, read("box.bin").unwrap().vertices);
    assert!(read("data:application/octet-stream;base64,AAAA").unwrap_err().to_string().contains("3 bytes"));
    assert!(read("data:application/octet-stream;base64,A?AA").unwrap_err().to_string().contains("base64"));
}

#[test]
fn gltf_nodes_are_trees_and_accessors_are_there() {
    let read = |nodes: &str, roots: &str, accessor: &str| {
        let document = format!(
            r#"{{"asset":{{"version":"2.0"}},"scenes":[{{"nodes":[{roots}]}}],"nodes":[{nodes}],
                "meshes":[{{"primitives":[{{"attributes":{{"POSITION":{accessor}}}}}]}}]}}"#
        );
        gltf::read(document.as_bytes(), Path::new("")).unwrap_err().to_string()
    };
    // each of 40 nodes names the next one twice: 2^40 of the last
    let chain: Vec<String> = (1..40).map(|next| format!(r#"{{"children":[{next},{next}]}}"#)).collect();
    let twice = read(&(chain.join(",") + r#",{"mesh":0}"#), "0", "0");
    assert!(twice.contains("node 1: child of node 0 and of node 0"), "{twice}");
    let tree = |nodes: &str, roots: &str| {
        let document =
            format!(r#"{{"asset":{{"version":"2.0"}},"scenes":[{{"nodes":[{roots}]}}],"nodes":[{nodes}]}}"#);
        gltf::read(document.as_bytes(), Path::new("")).map_err(|fault| fault.to_string())
    };
    let parent = |fault: Result<Soup, String>, words: &str| {
        let fault = fault.unwrap_err();
        assert!(fault.contains(words), "{fault}");
    };
    parent(tree(&(chain.join(",") + ",{}"), "0"), "node 1: child of node 0 and of node 0");
    parent(tree(r#"{"children":[2]},{"children":[2]},{}"#, "0,1"), "node 2: child of node 0 and of node 1");
    parent(
        tree(r#"{"children":[1]},{"children":[0]}"#, "0"),
        "node 0: a root of scene 0 and child of node 1",
    );
    parent(tree("{}", "0,0"), "node 0: named twice");
    parent(tree(r#"{"children":[7]}"#, "0"), "child 7");
    assert!(tree(r#"{"children":[1,2]},{},{}"#, "0").is_ok());
    let glb = as_glb();
    for (at, value) in [(8, 3_u32), (8, u32::MAX), (12, u32::MAX)] {
        let mut bytes = glb.clone();
        bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
        let fault = gltf::read(&bytes, Path::new("")).unwrap_err().to_string();
        assert!(fault.contains(&format!("byte {at}")), "{fault}");
    }
}
