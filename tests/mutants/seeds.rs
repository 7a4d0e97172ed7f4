//! Small whole files of every format that comes from outside, and the commands that read them.

use std::path::{Path, PathBuf};

use glam::DVec3;
use outrigger::recording::{SensorInfo, SessionWriter};
use outrigger::rig::{MountFile, SensorEntry};
use outrigger::world::trajectory::Trajectory;
use sensors::capture::{PcapWriter, PcapngWriter};
use sensors::ouster::{Metadata, OusterEncoder, Profile, Synthetic};
use sensors::velodyne::{Column, Product, ReturnMode, VelodyneEncoder};

use super::bag_seeds::{bag, bag_folder, db3_files, lists, mcap_files, packed_files, ros1_bags};
use super::scene_seeds::{
    OBJ, PLY_CLOUD, glb, gltf, gzip, las, npy, pcds, ply_cloud_binary, ply_mesh, stl_binary, stl_text,
};
use crate::support::datagram::Datagram;

/// One format and how the program reads it.
pub struct Format {
    pub name: &'static str,
    pub group: &'static str,
    /// The name under which it is read.
    pub file: &'static str,
    pub seeds: fn(&Kit) -> Vec<Vec<u8>>,
    /// Number of commands that take turns.
    pub commands: usize,
    pub command: fn(&Kit, &Path, usize) -> Vec<String>,
}

const fn format(
    group: &'static str,
    name: &'static str,
    file: &'static str,
    seeds: fn(&Kit) -> Vec<Vec<u8>>,
    commands: usize,
    command: fn(&Kit, &Path, usize) -> Vec<String>,
) -> Format {
    Format { name, group, file, seeds, commands, command }
}

pub const FORMATS: &[Format] = &[
    format("mesh", "obj", "a.obj", |_| vec![OBJ.into()], 1, scene),
    format(
        "mesh",
        "ply-mesh",
        "a.ply",
        |_| vec![ply_mesh("ascii"), ply_mesh("binary_little_endian")],
        1,
        scene,
    ),
    format("mesh", "stl", "a.stl", |_| vec![stl_text(), stl_binary()], 1, scene),
    format("mesh", "gltf", "a.gltf", |_| vec![gltf().into_bytes()], 1, scene),
    format("mesh", "glb", "a.glb", |_| vec![glb()], 1, scene),
    format("mesh", "npy", "a.npy", |_| vec![npy()], 1, samples),
    format("cloud", "ply-cloud", "b.ply", |_| vec![PLY_CLOUD.into(), ply_cloud_binary()], 1, scene),
    format("cloud", "pcd", "a.pcd", |_| pcds(), 1, scene),
    format(
        "cloud",
        "las",
        "a.las",
        |kit| vec![las(&kit.path("a.las"), 1), las(&kit.path("a.las"), 6)],
        1,
        scene,
    ),
    format(
        "cloud",
        "laz",
        "a.laz",
        |kit| [1, 3, 6, 7, 8].map(|kind| las(&kit.path("a.laz"), kind)).into(),
        1,
        scene,
    ),
    format("capture", "pcap", "a.pcap", |kit| vec![kit.file("good.pcap")], 3, capture),
    format("capture", "pcapng", "a.pcapng", |kit| vec![kit.file("good.pcapng")], 3, capture),
    format("capture", "pcap.gz", "a.pcap.gz", |kit| vec![gzip(&kit.file("good.pcap"))], 3, capture),
    format("bag", "ros1-bag", "a.bag", ros1_bags, 3, bag),
    format("bag", "mcap", "a.mcap", mcap_files, 3, bag),
    format("bag", "db3", "a.db3", db3_files, 3, bag),
    format("bag", "zstd", "a.zstd", packed_files, 3, capture),
    format("bag", "bag-list", "folder/metadata.yaml", lists, 3, bag_folder),
    format("document", "tum", "a.tum", |kit| vec![kit.file("walk.tum")], 2, trajectory),
    format("document", "kitti", "a.kitti", |_| vec![KITTI.into()], 1, kitti),
    format("document", "mount", "a-mount.json", |kit| vec![kit.file("mount.json")], 1, mount),
    format("document", "urdf", "a.urdf", |kit| vec![kit.file("rig.urdf")], 1, extrinsics),
    format("document", "tf", "a-tf.yaml", |kit| vec![kit.file("rig.yaml")], 1, extrinsics),
    format("document", "matrices", "a.txt", |_| vec![MATRICES.into()], 1, extrinsics),
    format("document", "extrinsics-json", "a-matrix.json", |_| vec![MATRICES_JSON.into()], 1, extrinsics),
    format("document", "published", "a-found.json", |kit| vec![kit.file("found.json")], 2, published),
    format("document", "rig.toml", "rig.toml", |kit| vec![rig_toml(kit).into()], 1, config),
    format(
        "document",
        "metadata",
        "a-meta.json",
        |kit| vec![kit.file("meta.json"), OLD_METADATA.into()],
        3,
        metadata,
    ),
    format("document", "calibration-yaml", "a.yaml", |_| vec![yaml()], 2, calibration),
    format("document", "calibration-xml", "a.xml", |_| vec![xml()], 2, calibration),
    format("document", "search-state", "a-state.json", |kit| vec![kit.file("state.json")], 1, resume),
    format("document", "plan", "study/plan.json", |kit| vec![kit.file("study/plan.json")], 1, merge),
    format(
        "session",
        "session-manifest",
        "session/manifest.json",
        |kit| kit.of_session("manifest.json"),
        3,
        session,
    ),
    format(
        "session",
        "session-packets",
        "session/packets.pcapng",
        |kit| kit.of_session("packets.pcapng"),
        3,
        session,
    ),
    format(
        "session",
        "session-servo",
        "session/servo.jsonl",
        |kit| kit.of_session("servo.jsonl"),
        3,
        session,
    ),
    format(
        "session",
        "session-events",
        "session/events.jsonl",
        |kit| kit.of_session("events.jsonl"),
        3,
        session,
    ),
    format(
        "session",
        "session-path",
        "session/trajectory.tum",
        |kit| kit.of_session("trajectory.tum"),
        3,
        session,
    ),
    format("session", "session-mount", "session/mount.json", |kit| kit.of_session("mount.json"), 3, session),
];

/// A folder with whole files of every kind.
pub struct Kit(tempfile::TempDir);

impl Kit {
    pub fn new() -> Self {
        let kit = Self(tempfile::tempdir().unwrap());
        let write = |name: &str, bytes: &[u8]| std::fs::write(kit.path(name), bytes).unwrap();
        let walk =
            Trajectory::straight(DVec3::new(-1.5, 0.0, 1.2), DVec3::new(1.5, 0.0, 1.2), 10.0, START_NS);
        write("walk.tum", walk.to_tum().as_bytes());
        write("room.obj", OBJ.as_bytes());
        kit.mount().write(&kit.path("mount.json")).unwrap();
        let metadata = metadata_of_os1();
        write("meta.json", metadata.to_json().as_bytes());
        let packets = packets(metadata);
        let mut pcap = PcapWriter::new(Vec::new()).unwrap();
        let mut pcapng = PcapngWriter::new(Vec::new()).unwrap();
        let interface = pcapng.add_interface("eth0").unwrap();
        for packet in packets.iter().flatten() {
            pcap.write(&packet.packet()).unwrap();
            pcapng.write(interface, &packet.packet()).unwrap();
        }
        write("good.pcap", &pcap.close().unwrap());
        write("good.pcapng", &pcapng.close(&[]).unwrap());
        kit.write_session(&packets, &walk);
        let (state, found) = (kit.name("state.json"), kit.name("found.json"));
        let whole = |arguments: &[&str]| {
            let arguments: Vec<String> = arguments.iter().map(|argument| (*argument).to_owned()).collect();
            let output = super::run(&arguments, 60);
            assert!(output.status.success(), "{arguments:?}: {output:?}");
        };
        let mut search = SEARCH.to_vec();
        search.extend(["--resume", &state, "--export-published", &found]);
        whole(&search);
        whole(&[
            "mount",
            &kit.name("mount.json"),
            "--urdf",
            &kit.name("rig.urdf"),
            "--tf",
            &kit.name("rig.yaml"),
        ]);
        let study = kit.name("study");
        whole(&["study", "plan", "pareto", "--quick", "--seeds", "1", "--out", &study]);
        let mut plan: serde_json::Value = serde_json::from_slice(&kit.file("study/plan.json")).unwrap();
        plan["tasks"].as_array_mut().unwrap().truncate(1);
        write("study/plan.json", &serde_json::to_vec_pretty(&plan).unwrap());
        whole(&["study", "run", "pareto", "--out", &study, "--shard", "1/1"]);
        kit
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Where commands write; it is empty before each.
    pub fn out(&self) -> PathBuf {
        self.path("out")
    }

    pub fn empty_out(&self) {
        let _ = std::fs::remove_dir_all(self.out());
        std::fs::create_dir(self.out()).unwrap();
    }

    pub fn name(&self, name: &str) -> String {
        self.path(name).display().to_string()
    }

    pub fn file(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap()
    }

    fn of_session(&self, name: &str) -> Vec<Vec<u8>> {
        vec![self.file(&format!("session/{name}"))]
    }

    fn mount(&self) -> MountFile {
        let sensors = [("left", "os1-16", -1.0), ("right", "vlp-16", 1.0)];
        MountFile::new(
            sensors
                .map(|(name, model, side)| SensorEntry {
                    name: name.into(),
                    model: model.into(),
                    x_m: 0.15 * side,
                    y_m: 0.0,
                    z_m: 0.1,
                    pitch_deg: 20.0 * side,
                    ..SensorEntry::default()
                })
                .to_vec(),
        )
    }

    fn write_session(&self, packets: &[Vec<Datagram>; 2], walk: &Trajectory) {
        let info = |name: &str, port, metadata| SensorInfo {
            name: name.into(),
            address: Some(([0, 0, 0, 0], port).into()),
            source: None,
            metadata,
        };
        let text = String::from_utf8(self.file("meta.json")).unwrap();
        let infos = [info("left", 7502, Some(text)), info("right", 2368, None)];
        let writer = SessionWriter::create(&self.path("session"), &infos).unwrap();
        for (sensor, packets) in packets.iter().enumerate() {
            packets.iter().for_each(|packet| writer.write_packet(sensor, &packet.packet()).unwrap());
        }
        writer.put_trajectory(walk).unwrap();
        writer.put_mount(&self.mount(), &[]).unwrap();
        for at in 0..4_u64 {
            let report = serde_json::json!({"time_ns": START_NS + at * 100_000_000, "axis": 0, "position_urad": -349_066,
                "uncertainty_urad": 1745, "target_urad": -349_066, "source": "measured", "state": "holding", "faults": []});
            writer.write_servo(&report).unwrap();
        }
        writer.write_event(&serde_json::json!({"time_ns": START_NS, "event": "begun"})).unwrap();
        writer.close(None).unwrap();
    }
}

/// When the recording begins.
const START_NS: u64 = 1_700_000_000_000_000_000;

const SEARCH: [&str; 9] =
    ["optimize", "--preset", "paper-vlp-16", "--evals", "6", "--method", "random", "--fidelity", "given"];

pub fn words(words: &[&str]) -> Vec<String> {
    words.iter().map(|word| (*word).to_owned()).collect()
}

fn predict(kit: &Kit, more: &[&str]) -> Vec<String> {
    let (walk, mount, out) = (kit.name("walk.tum"), kit.name("mount.json"), kit.name("out/seen.json"));
    let mut arguments = words(&["predict", "--azimuths", "8", "--voxel", "0.5", "--fidelity", "given"]);
    for (flag, value) in [("--trajectory", &walk), ("--mount", &mount), ("--out", &out)] {
        if !more.contains(&flag) {
            arguments.extend(words(&[flag, value]));
        }
    }
    if !more.contains(&"--scene") {
        arguments.push("--room=-4,-3,0,4,3,3".into());
    }
    arguments.extend(words(more));
    arguments
}

fn scene(kit: &Kit, path: &Path, _: usize) -> Vec<String> {
    let is_mesh = !outrigger::world::scene::is_cloud(path);
    let more: &[&str] = if is_mesh { &["--sample-count", "100"] } else { &[] };
    predict(kit, &[&["--scene", &path.display().to_string()], more].concat())
}

fn samples(kit: &Kit, path: &Path, _: usize) -> Vec<String> {
    predict(kit, &["--scene", &kit.name("room.obj"), "--samples", &path.display().to_string()])
}

fn trajectory(kit: &Kit, path: &Path, which: usize) -> Vec<String> {
    let path = path.display().to_string();
    match which {
        0 => predict(kit, &["--trajectory", &path]),
        _ => predict(
            kit,
            &["--trajectory", &path, "--operator=0,0,-1,0,0,0.5,0.3", "--report", &kit.name("out/a.html")],
        ),
    }
}

fn kitti(kit: &Kit, path: &Path, _: usize) -> Vec<String> {
    predict(kit, &["--trajectory", &path.display().to_string(), "--rate", "10"])
}

fn mount(kit: &Kit, path: &Path, _: usize) -> Vec<String> {
    predict(kit, &["--mount", &path.display().to_string()])
}

const MATRICES: &str =
    "left:\n1 0 0 0.1\n0 1 0 0.2\n0 0 1 0.3\n0 0 0 1\n\nright:\n0 -1 0 0.1\n1 0 0 0.2\n0 0 1 0.3\n0 0 0 1\n";
const MATRICES_JSON: &str = "{\"left\": [[1, 0, 0, 0.1], [0, 1, 0, 0.2], [0, 0, 1, 0.3], [0, 0, 0, 1]], \"right\": [0, -1, 0, 0.1, 1, 0, 0, 0.2, 0, 0, 1, 0.3, 0, 0, 0, 1]}";

fn extrinsics(kit: &Kit, path: &Path, _: usize) -> Vec<String> {
    let [out, drawing] = ["out/mount.json", "out/mount.dxf"].map(|name| kit.name(name));
    words(&["mount", &path.display().to_string(), "--sensor", "os1-16", "--out", &out, "--drawing", &drawing])
}

fn published(kit: &Kit, path: &Path, which: usize) -> Vec<String> {
    match which {
        0 => words(&["predict", "--preset", "paper-vlp-16", "--mount", &path.display().to_string()]),
        _ => predict(kit, &["--mount", &path.display().to_string()]),
    }
}

fn config(kit: &Kit, path: &Path, _: usize) -> Vec<String> {
    let flags =
        ["--mount", &kit.name("mount.json"), "--trajectory", &kit.name("walk.tum"), "--room=-4,-3,0,4,3,3"];
    [words(&["--config", &path.display().to_string(), "predict"]), words(&flags)].concat()
}

fn metadata(kit: &Kit, path: &Path, which: usize) -> Vec<String> {
    let path = path.display().to_string();
    match which {
        0 => words(&["inspect", &kit.name("good.pcap"), "--meta", &path]),
        1 => words(&["decode", &kit.name("good.pcap"), "--meta", &path, "--out", &kit.name("out/a.csv")]),
        _ => predict(kit, &["--sensor", &format!("left={path}")]),
    }
}

fn calibration(kit: &Kit, path: &Path, which: usize) -> Vec<String> {
    let path = path.display().to_string();
    match which {
        0 => words(&[
            "decode",
            &kit.name("good.pcap"),
            "--calibration",
            &path,
            "--format",
            "ply",
            "--out",
            &kit.name("out/a/"),
        ]),
        _ => predict(kit, &["--sensor", &format!("right={path}")]),
    }
}

fn resume(_: &Kit, path: &Path, _: usize) -> Vec<String> {
    [words(&SEARCH), words(&["--resume", &path.display().to_string()])].concat()
}

fn merge(kit: &Kit, _: &Path, _: usize) -> Vec<String> {
    words(&["study", "merge", "pareto", "--out", &kit.name("study")])
}

fn capture(kit: &Kit, path: &Path, which: usize) -> Vec<String> {
    let (path, meta) = (path.display().to_string(), kit.name("meta.json"));
    match which {
        0 => words(&["inspect", &path, "--meta", &meta]),
        1 => words(&["decode", &path, "--meta", &meta, "--out", &kit.name("out/a.pcd")]),
        _ => words(&["decode", &path, "--meta", &meta, "--out", &kit.name("out/a.laz")]),
    }
}

fn session(kit: &Kit, _: &Path, which: usize) -> Vec<String> {
    let path = kit.name("session");
    match which {
        0 => words(&["inspect", &path]),
        1 => words(&["decode", &path, "--out", &kit.name("out/a.npy")]),
        _ => predict(kit, &["--scene", &path, "--map-voxel", "0.4"]),
    }
}

const KITTI: &str = "1 0 0 -1 0 1 0 0 0 0 1 1\n1 0 0 0 0 1 0 0 0 0 1 1\n1 0 0 1 0 1 0 0 0 0 1 1\n";

/// As the firmware before 2.0 gave them.
const OLD_METADATA: &str = r#"{"beam_altitude_angles": [15, 13, 11, 9, 7, 5, 3, 1, -1, -3, -5, -7, -9, -11, -13, -15],
"beam_azimuth_angles": [3, 1, -1, -3, 3, 1, -1, -3, 3, 1, -1, -3, 3, 1, -1, -3], "build_rev": "v1.13.0",
"hostname": "os1-991937000062.local", "lidar_mode": "512x10", "prod_line": "OS-1-16", "prod_sn": "991937000062",
"imu_to_sensor_transform": [1, 0, 0, 6.253, 0, 1, 0, -11.775, 0, 0, 1, 7.645, 0, 0, 0, 1],
"lidar_to_sensor_transform": [-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 36.18, 0, 0, 0, 1]}"#;

pub fn metadata_of_os1() -> Metadata {
    let wanted = Synthetic::new("os1-16", 122_201_000_998, Profile::Rng19Rfl8Sig16Nir16).columns(512, 16);
    Metadata::synthetic(&wanted).unwrap()
}

/// What an OS1-16 and a VLP-16 send in three revolutions or so.
pub fn packets(metadata: Metadata) -> [Vec<Datagram>; 2] {
    let datagram = |host: u8, port: u16, at: usize, payload: &[u8]| Datagram {
        host_time_ns: START_NS + at as u64 * 1_000_000,
        source: ([10, 0, 0, host], port).into(),
        destination: ([10, 0, 0, 1], port).into(),
        payload: payload.to_vec(),
    };
    let (mut left, mut right) = (Vec::new(), Vec::new());
    let mut encoder = OusterEncoder::new(metadata);
    for frame_id in 5..8 {
        let mut frame = crate::fuzz::frame(frame_id, 512, 16);
        frame.column_time_ns.iter_mut().for_each(|time_ns| *time_ns += START_NS - 500_000_000);
        encoder.frame(&frame, &mut |packet| left.push(datagram(2, 7502, left.len(), packet)));
    }
    let mut encoder = VelodyneEncoder::new(Product::Vlp16, ReturnMode::Strongest);
    let (ranges, levels) = (vec![1500; 16], vec![9; 16]);
    for column in 0..2000_u64 {
        let column = Column {
            time_ns: START_NS + column * Product::Vlp16.cycle_ns() as u64,
            azimuth_rad: column as f64 * 0.007 % std::f64::consts::TAU,
            range_mm: &ranges,
            reflectivity: &levels,
            second: None,
        };
        encoder.push_column(column, &mut |_, packet| right.push(datagram(3, 2368, right.len(), packet)));
    }
    [left, right]
}

fn yaml() -> Vec<u8> {
    let mut text = String::from("distance_resolution: 0.002\nnum_lasers: 16\nlasers:\n");
    for laser in 0..16 {
        let elevation_rad =
            f64::to_radians([-15, 1, -13, 3, -11, 5, -9, 7, -7, 9, -5, 11, -3, 13, -1, 15][laser].into());
        text += &format!(
            "- {{laser_id: {laser}, vert_correction: {elevation_rad}, rot_correction: 0.0, dist_correction: 0.0, \
             vert_offset_correction: 0.01, focal_distance: 0.0}}\n"
        );
    }
    text.into_bytes()
}

fn xml() -> Vec<u8> {
    let mut text = String::from(
        "<?xml version=\"1.0\"?>\n<boost_serialization><DB>\n<distLSB_>0.2</distLSB_>\n<enabled_>\n",
    );
    (0..16).for_each(|_| text += "<item>1</item>\n");
    text += "</enabled_>\n<points_>\n";
    for laser in 0..16 {
        let elevation_deg = [-15, 1, -13, 3, -11, 5, -9, 7, -7, 9, -5, 11, -3, 13, -1, 15][laser];
        text += &format!(
            "<item><px><id_>{laser}</id_><rotCorrection_>0</rotCorrection_><vertCorrection_>{elevation_deg}</vertCorrection_>\
             <distCorrection_>0</distCorrection_><vertOffsetCorrection_>1</vertOffsetCorrection_></px></item>\n"
        );
    }
    (text + "</points_>\n</DB></boost_serialization>\n").into_bytes()
}

fn rig_toml(kit: &Kit) -> String {
    format!(
        "format = \"outrigger-rig/1\"\n\n[[sensor]]\nname = \"left\"\nmodel = \"os1-16\"\nlisten = \"127.0.0.1:7502\"\n\
         metadata = \"{}\"\n\n[[sensor]]\nname = \"right\"\nmodel = \"vlp-16\"\nlisten = 2368\nlisten_aside = 8308\n\
         source = \"10.0.0.3\"\n\n[predict]\nazimuths = 8\nvoxel = 0.5\nfidelity = \"given\"\n\
         spin_rate = 10\nmin_range = 0.5\nmax_range = 50\nsub_rays = 0\n\n[rig]\nlimits_deg = [[-50, 50], [-50, 50]]\n",
        kit.name("meta.json")
    )
}
