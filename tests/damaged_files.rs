//! Files of others, whole, cut and damaged: every reader answers or names what is wrong, and none of them panics.

use std::path::Path;

use e57::Record;
use outrigger::rig::{MountFile, SensorEntry};
use outrigger::world::scene::{load_mesh, read_cloud};
use outrigger::world::trajectory::Trajectory;
use proptest::prelude::*;
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};

use crate::support::{Case, case};

pub const CASES: &[Case] = &[
    case("meshes", meshes),
    case("clouds", clouds),
    case("tables_of_poses", tables_of_poses),
    case("mounts_and_configs", mounts_and_configs),
];

/// A reader; it says whether the bytes were what it reads.
type Reader = fn(&Path) -> Result<(), String>;

/// Feeds a reader its own whole file, random bytes, and the file with bytes changed, left out and cut off. The same
/// inputs on every run.
fn feed(name: &str, whole: &[u8], read: Reader) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    let answer = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        read(&path)
    };
    answer(whole).unwrap_or_else(|error| panic!("{name} as it should be: {error}"));
    let config = Config { cases: 150, failure_persistence: None, ..Config::default() };
    let mut runner = TestRunner::new_with_rng(config, TestRng::deterministic_rng(RngAlgorithm::ChaCha));
    let bytes = prop_oneof![
        1 => prop::collection::vec(any::<u8>(), 0..500),
        5 => (prop::collection::vec((0.0..1.0, any::<u8>()), 0..6), 0.0..1.5, 0.0..1.0, 0..9_usize)
            .prop_map(|(changes, end, hole_at, hole)| {
                let mut bytes = whole.to_vec();
                for (share, value) in changes {
                    let at = (share * bytes.len() as f64) as usize;
                    bytes[at] = value;
                }
                let from = (hole_at * bytes.len() as f64) as usize;
                bytes.drain(from..(from + hole).min(bytes.len()));
                bytes.truncate((f64::min(end, 1.0) * bytes.len() as f64) as usize);
                bytes
            }),
    ];
    let outcome = runner.run(&bytes, |bytes| {
        if let Err(error) = answer(&bytes) {
            prop_assert!(error.contains(name), "the file is named: {error}");
        }
        Ok(())
    });
    assert!(outcome.is_ok(), "{name}: {}", outcome.unwrap_err());
}

fn meshes() {
    let read: Reader = |path| load_mesh(path, None, None).map(drop).map_err(|error| error.to_string());
    feed("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 2\nf 1 2 3\nf 1/1 2/2 4/3\nf -1 -2 -3\n", read);
    let ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
               element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 2\n3 0 1 2\n";
    feed("a.ply", ply.as_bytes(), read);
    let mut binary = ply.replace("ascii", "binary_little_endian").into_bytes();
    binary.truncate(binary.len() - "0 0 0\n1 0 0\n0 1 2\n3 0 1 2\n".len());
    let corners = [0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 2.0];
    corners.iter().for_each(|value| binary.extend(value.to_le_bytes()));
    binary.push(3);
    [0_i32, 1, 2].iter().for_each(|corner| binary.extend(corner.to_le_bytes()));
    feed("b.ply", &binary, read);
    let mut stl = vec![0; 80];
    stl.extend(1_u32.to_le_bytes());
    [0.0_f32, 0.0, 1.0].iter().chain(&corners).for_each(|value| stl.extend(value.to_le_bytes()));
    stl.extend([0; 2]);
    feed("a.stl", &stl, read);
    let text = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 2\nendloop\nendfacet\nendsolid a\n";
    feed("b.stl", text.as_bytes(), read);
    let buffer: Vec<u8> = corners.iter().flat_map(|value| value.to_le_bytes()).collect();
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0}}],
            "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}}}}]}}],"buffers":[{{"byteLength":{0}}}],
            "bufferViews":[{{"buffer":0,"byteLength":{0}}}],
            "accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,2]}}]}}"#,
        buffer.len()
    );
    let padded = json.len().next_multiple_of(4);
    let mut glb = b"glTF".to_vec();
    glb.extend(2_u32.to_le_bytes());
    glb.extend(((12 + 8 + padded + 8 + buffer.len()) as u32).to_le_bytes());
    glb.extend((padded as u32).to_le_bytes());
    glb.extend(b"JSON");
    glb.extend(format!("{json:padded$}").into_bytes());
    glb.extend((buffer.len() as u32).to_le_bytes());
    glb.extend(b"BIN\0");
    glb.extend(buffer);
    feed("a.glb", &glb, read);
    let off = "OFF\n4 2 0\n0 0 0\n4 0 0\n4 4 0\n0 4 0\n3 0 1 2\n4 0 1 2 3 0.5 0.5 0.5\n";
    feed("a.off", off.as_bytes(), read);
}

fn clouds() {
    let read: Reader = |path| read_cloud(path, |_| ()).map(drop).map_err(|error| error.to_string());
    let ply = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n\
               property double time\nend_header\n0 0 0 1\n1 0 0 2\n";
    feed("a.ply", ply.as_bytes(), read);
    let header = |kind: &str| {
        format!(
            "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA {kind}\n"
        )
    };
    feed("a.pcd", (header("ascii") + "1 2 3\n4 5 6\n").as_bytes(), read);
    let points: Vec<u8> = [1.0_f32, 4.0, 2.0, 5.0, 3.0, 6.0].iter().flat_map(|v| v.to_le_bytes()).collect();
    feed("b.pcd", &[header("binary").as_bytes(), &points].concat(), read);
    // LZF: the first 8 bytes as they are, the other 16 likewise
    let packed = [&[7], &points[..8], &[15], &points[8..]].concat();
    let sizes = [(packed.len() as u32).to_le_bytes(), (points.len() as u32).to_le_bytes()].concat();
    feed("c.pcd", &[header("binary_compressed").as_bytes(), &sizes, &packed].concat(), read);
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.las", "a.laz"] {
        let path = folder.path().join(name);
        let mut writer = las::Writer::from_path(&path, las::Header::default()).unwrap();
        for x in 0..40 {
            writer.write_point(las::Point { x: f64::from(x), y: 1.0, z: 2.0, ..Default::default() }).unwrap();
        }
        writer.close().unwrap();
        feed(name, &std::fs::read(&path).unwrap(), read);
    }
    feed("a.xyz", b"// x y z timestamp\n1 2 3 4\n5,6;7 8\n", read);
    let path = folder.path().join("a.e57");
    let mut writer = e57::E57Writer::from_file(&path, "file").unwrap();
    let prototype = vec![Record::CARTESIAN_X_F64, Record::CARTESIAN_Y_F64, Record::CARTESIAN_Z_F64];
    let mut scan = writer.add_pointcloud("scan", prototype).unwrap();
    for x in 0..40 {
        scan.add_point([f64::from(x), 1.0, 2.0].map(e57::RecordValue::Double).to_vec()).unwrap();
    }
    scan.finalize().unwrap();
    writer.finalize().unwrap();
    feed("a.e57", &std::fs::read(&path).unwrap(), read);
}

fn tables_of_poses() {
    let read: Reader = |path| {
        let bytes = std::fs::read(path).map_err(|error| error.to_string())?;
        let rate_hz = path.extension().is_some_and(|ending| ending == "kitti").then_some(10.0);
        named(path, Trajectory::read(&bytes, rate_hz))
    };
    feed("a.tum", b"# t x y z qx qy qz qw\n1.5 0 0 1 0 0 0 1\n2.5 1 0 1 0 0 0.1 0.99\n", read);
    feed("a.csv", b"time [ns],x,y,z,qw,qx,qy,qz\n1500,0,0,1,1,0,0,0\n2500,1,0,1,1,0,0,0\n", read);
    feed("a.kitti", b"1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\n1 0 0 1 0 1 0 0 0 0 1 0 0 0 0 1\n", read);
}

fn mounts_and_configs() {
    let sensors = [("left", -1.0), ("right", 1.0)].map(|(name, side)| SensorEntry {
        name: name.into(),
        model: "vlp-16".into(),
        x_m: 0.08 * side,
        y_m: 0.0,
        z_m: 0.1,
        pitch_deg: 30.0 * side,
        ..SensorEntry::default()
    });
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mount.json");
    MountFile::new(sensors.to_vec()).write(&path).unwrap();
    feed("mount.json", &std::fs::read(path).unwrap(), |path| {
        let file = MountFile::read(path).map_err(|error| error.to_string())?;
        named(path, file.rig())
    });
    let config = include_bytes!("../src/commands/init/rig.toml");
    feed("rig.toml", config, |path| {
        outrigger::live::config::Config::read(path).map(drop).map_err(|error| error.to_string())
    });
}

/// What was read from text alone does not know the file's name.
fn named<T>(path: &Path, outcome: Result<T, impl std::fmt::Display>) -> Result<(), String> {
    outcome.map(drop).map_err(|error| format!("{}: {error}", path.display()))
}
