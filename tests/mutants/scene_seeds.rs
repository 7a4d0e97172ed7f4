//! Small whole scenes: a room as a mesh of every format, and a few points of its wall as clouds.

use std::io::Write as _;
use std::path::Path;

pub const OBJ: &str = "# room\nv -4 -3 0\nv 4 -3 0\nv 4 3 0\nv -4 3 0\nv -4 -3 3\nv 4 -3 3\nv 4 3 3\nv -4 3 3\n\
    f 1 2 3 4\nf 5/1 6/2 7/3 8/4\nf 1//1 2//1 6//1 5//1\nf 2 3 7 6\nf 3 4 8 7\nf -8 -5 -1 -4\n";

/// The corners of the room, and its faces of four.
fn room() -> (Vec<[f32; 3]>, Vec<[u32; 4]>) {
    let numbers = |line: &str| -> Vec<f32> {
        let first = |word: &str| word.split('/').next().unwrap().parse().unwrap();
        line.split_whitespace().skip(1).map(first).collect()
    };
    let corners =
        OBJ.lines().filter(|line| line.starts_with('v')).map(|line| numbers(line).try_into().unwrap());
    let corners: Vec<[f32; 3]> = corners.collect();
    let face = |line: &str| -> [u32; 4] {
        let index = |number: f32| if number < 0.0 { (8.0 + number) as u32 } else { number as u32 - 1 };
        numbers(line).into_iter().map(index).collect::<Vec<_>>().try_into().unwrap()
    };
    (corners, OBJ.lines().filter(|line| line.starts_with('f')).map(face).collect())
}

fn triangles() -> Vec<[[f32; 3]; 3]> {
    let (corners, faces) = room();
    let halves = faces.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]);
    halves.map(|triangle| triangle.map(|corner| corners[corner as usize])).collect()
}

pub fn ply_mesh(encoding: &str) -> Vec<u8> {
    let (corners, faces) = room();
    let mut bytes = format!(
        "ply\nformat {encoding} 1.0\ncomment a room\nelement vertex {}\nproperty float x\nproperty float y\n\
         property float z\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
        corners.len(),
        faces.len()
    )
    .into_bytes();
    for [x, y, z] in corners {
        match encoding {
            "ascii" => writeln!(bytes, "{x} {y} {z}").unwrap(),
            _ => [x, y, z].iter().for_each(|value| bytes.extend(value.to_le_bytes())),
        }
    }
    for face in faces {
        match encoding {
            "ascii" => writeln!(bytes, "4 {} {} {} {}", face[0], face[1], face[2], face[3]).unwrap(),
            _ => {
                bytes.push(4);
                face.iter().for_each(|corner| bytes.extend(corner.to_le_bytes()));
            }
        }
    }
    bytes
}

pub fn stl_text() -> Vec<u8> {
    let mut text = String::from("solid room\n");
    for triangle in triangles() {
        text += "facet normal 0 0 1\nouter loop\n";
        triangle.iter().for_each(|[x, y, z]| text += &format!("vertex {x} {y} {z}\n"));
        text += "endloop\nendfacet\n";
    }
    (text + "endsolid room\n").into_bytes()
}

pub fn stl_binary() -> Vec<u8> {
    let mut bytes = vec![0; 80];
    bytes.extend((triangles().len() as u32).to_le_bytes());
    for triangle in triangles() {
        bytes.extend([0; 12]);
        triangle.iter().flatten().for_each(|value| bytes.extend(value.to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

/// Positions, then indices.
fn gltf_buffer() -> Vec<u8> {
    let (corners, faces) = room();
    let mut bytes: Vec<u8> = corners.iter().flatten().flat_map(|value| value.to_le_bytes()).collect();
    let order = faces.iter().flat_map(|[a, b, c, d]| [a, b, c, a, c, d]);
    order.for_each(|corner| bytes.extend((*corner as u16).to_le_bytes()));
    bytes
}

fn gltf_document(buffer: &str) -> String {
    let length = gltf_buffer().len();
    format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0,3]}}],
"nodes":[{{"children":[1,2],"rotation":[-0.70710678,0,0,0.70710678]}},{{"mesh":0}},{{"translation":[0.5,0,0]}},{{"name":"lamp"}}],
"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1}}]}}],
"buffers":[{{{buffer}"byteLength":{length}}}],
"bufferViews":[{{"buffer":0,"byteLength":96,"byteStride":12}},{{"buffer":0,"byteOffset":96,"byteLength":72}}],
"accessors":[{{"bufferView":0,"byteOffset":0,"componentType":5126,"count":8,"type":"VEC3","min":[-4,-3,0],"max":[4,3,3]}},
{{"bufferView":1,"componentType":5123,"count":36,"type":"SCALAR"}}]}}"#
    )
}

pub fn gltf() -> String {
    const LETTERS: &[u8] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::new();
    for three in gltf_buffer().chunks_exact(3) {
        let bits = three.iter().fold(0_usize, |bits, byte| bits << 8 | usize::from(*byte));
        (0..4).for_each(|at| text.push(char::from(LETTERS[bits >> (18 - 6 * at) & 63])));
    }
    gltf_document(&format!(r#""uri":"data:application/octet-stream;base64,{text}","#))
}

pub fn glb() -> Vec<u8> {
    let (json, buffer) = (gltf_document(""), gltf_buffer());
    let padded = json.len().next_multiple_of(4);
    let mut bytes = b"glTF".to_vec();
    let words = [2, (12 + 8 + padded + 8 + buffer.len()) as u32, padded as u32];
    words.iter().for_each(|word| bytes.extend(word.to_le_bytes()));
    bytes.extend(format!("JSON{json:padded$}").into_bytes());
    bytes.extend((buffer.len() as u32).to_le_bytes());
    bytes.extend(b"BIN\0");
    bytes.extend(buffer);
    bytes
}

pub fn npy() -> Vec<u8> {
    let body: Vec<u8> =
        triangles().iter().flatten().flatten().flat_map(|value| value.to_le_bytes()).collect();
    let header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({}, 3), }}\n", body.len() / 12);
    [b"\x93NUMPY\x01\0", &(header.len() as u16).to_le_bytes()[..], header.as_bytes(), &body].concat()
}

pub const PLY_CLOUD: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
    property float vp_x\nproperty float vp_y\nproperty float vp_z\nproperty double time\nend_header\n\
    2 0 1 0 0 1 0.1\n2 0.5 1 0 0 1 0.2\n2 1 1 0 0 1 0.3\n";

pub fn ply_cloud_binary() -> Vec<u8> {
    let header = "ply\nformat binary_big_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
        property float z\nproperty list uchar float extra\nend_header\n";
    let mut bytes = header.as_bytes().to_vec();
    for y in [0.0_f32, 0.5, 1.0] {
        [2.0, y, 1.0].iter().for_each(|value: &f32| bytes.extend(value.to_be_bytes()));
        bytes.push(1);
        bytes.extend(7.0_f32.to_be_bytes());
    }
    bytes
}

pub fn pcds() -> Vec<Vec<u8>> {
    let header = |kind: &str| {
        format!(
            "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z timestamp\nSIZE 4 4 4 8\nTYPE F F F F\nCOUNT 1 1 1 1\nWIDTH 3\n\
             HEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 3\nDATA {kind}\n"
        )
        .into_bytes()
    };
    let rows = [[2.0_f32, 0.0, 1.0], [2.0, 0.5, 1.0], [2.0, 1.0, 1.0]];
    let text: String = rows.iter().map(|[x, y, z]| format!("{x} {y} {z} 0.5\n")).collect();
    let row =
        |[x, y, z]: [f32; 3]| [&x.to_le_bytes()[..], &y.to_le_bytes(), &z.to_le_bytes(), &[0; 8]].concat();
    let binary = rows.map(row).concat();
    // field by field; of the times most is a run
    let fields: Vec<u8> = (0..3).flat_map(|axis| rows.map(|row| row[axis].to_le_bytes())).flatten().collect();
    let packed = [&[31], &fields[..32], &[4], &fields[32..], &[0], &[7 << 5, 14, 0]].concat();
    let sizes = [(packed.len() as u32).to_le_bytes(), 60_u32.to_le_bytes()].concat();
    vec![
        [header("ascii"), text.into_bytes()].concat(),
        [header("binary"), binary].concat(),
        [header("binary_compressed"), sizes, packed].concat(),
    ]
}

pub fn las(path: &Path, kind: u8) -> Vec<u8> {
    let mut builder = las::Builder::from((1, 4));
    builder.point_format = las::point::Format::new(kind).unwrap();
    builder.point_format.extra_bytes = 3;
    let mut writer = las::Writer::from_path(path, builder.into_header().unwrap()).unwrap();
    for at in 0..60_u16 {
        let format = writer.header().point_format();
        let point = las::Point {
            x: 2.0,
            y: 0.02 * f64::from(at),
            z: 1.0,
            gps_time: format.has_gps_time.then_some(0.1),
            color: format.has_color.then(|| las::Color::new(at, 2, 3)),
            nir: format.has_nir.then_some(at),
            extra_bytes: vec![at as u8; 3],
            ..las::Point::default()
        };
        writer.write_point(point).unwrap();
    }
    writer.close().unwrap();
    std::fs::read(path).unwrap()
}

pub fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    packed.write_all(bytes).unwrap();
    packed.finish().unwrap()
}
