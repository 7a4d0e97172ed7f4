//! Scenes that are maps of cells: made of recorded sessions and of point clouds.

use std::collections::BTreeSet;
use std::io::Write as _;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::{Command, Output};

use glam::{DQuat, DVec3};
use outrigger::base::geometry::Pose;
use outrigger::recording::{SensorInfo, SessionWriter};
use outrigger::rig::{Mount, MountFile, MountedSensor, Rig, SensorEntry};
use outrigger::simulate::scan::{Scanner, Spin};
use outrigger::world::scene::{BoxScene, Scene};
use outrigger::world::trajectory::Trajectory;
use sensors::catalogue;
use sensors::ouster::{Metadata, Profile, Synthetic};
use serde_json::Value;

use crate::support::walk::Walk;
use crate::support::{Case, case};

pub const CASES: &[Case] = &[
    case("a_cloud_predicts_what_its_room_does", a_cloud_predicts_what_its_room_does),
    case("clouds_say_in_three_ways_where_they_were_seen_from", clouds_say_where_they_were_seen_from),
    case("scans_were_seen_from_where_they_are_placed", scans_were_seen_from_where_they_are_placed),
    case("clouds_in_a_national_grid_are_as_at_the_origin", clouds_in_a_national_grid),
    case("what_nobody_looked_into_is_unknown", what_nobody_looked_into_is_unknown),
    case("a_session_is_a_scene", a_session_is_a_scene),
    case("what_makes_no_map_is_refused", what_makes_no_map_is_refused),
];

/// Walls run through the middles of cells of 0.1 m, of the map as of the prediction in the room.
const LOW_M: DVec3 = DVec3::new(-3.05, -2.05, -0.05);
const HIGH_M: DVec3 = DVec3::new(3.05, 2.05, 2.45);
const START_NS: u64 = 1_763_722_223_000_000_000;

fn room() -> Scene {
    Scene::Box(BoxScene::closed(LOW_M, HIGH_M))
}

fn walk() -> Trajectory {
    Trajectory::straight(DVec3::new(-0.8, 0.1, 1.2), DVec3::new(0.8, 0.0, 1.2), 1.0, START_NS)
}

fn mount(side: f64) -> Mount {
    Mount { x_m: 0.08 * side, z_m: 0.1, pitch_rad: side * 30_f64.to_radians(), ..Mount::default() }
}

/// A point with where and when it was seen.
struct Seen {
    at_m: DVec3,
    from_m: DVec3,
    time_ns: u64,
}

/// What two sensors recorded, by a range that the walls set; `keep` says which points.
fn recorded(keep: impl Fn(DVec3) -> bool) -> Vec<Seen> {
    let (scene, walk) = (room(), walk());
    let model = catalogue::nominal("os1-64").unwrap();
    let sensor =
        |name: &str, side| MountedSensor { name: name.into(), model: model.clone(), mount: mount(side) };
    let rig = Rig { sensors: vec![sensor("right", 1.0), sensor("left", -1.0)] };
    let mut scanner = Scanner::new(&scene, &walk, &rig, Spin { columns: 256, ..Spin::default() });
    scanner.occluders = vec![Vec::new(); 2];
    let mut seen = Vec::new();
    scanner.for_each_column(|_, column| {
        for back in column.returns.iter().filter(|back| keep(back.point_m)) {
            let from_m = back.point_m - back.range_m * back.direction;
            seen.push(Seen { at_m: back.point_m, from_m, time_ns: column.time_ns });
        }
    });
    seen
}

struct Folder(tempfile::TempDir);

impl Folder {
    /// With a walk and a rig of two VLP-16.
    fn new() -> Self {
        let folder = Self(tempfile::tempdir().unwrap());
        std::fs::write(folder.path("walk.tum"), walk().to_tum()).unwrap();
        folder.put_mount("mount.json", "vlp-16");
        folder
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn text(&self, name: &str) -> String {
        self.path(name).display().to_string()
    }

    fn put_mount(&self, name: &str, model: &str) -> MountFile {
        let entry = |name: &str, side: f64| SensorEntry {
            name: name.into(),
            model: model.into(),
            x_m: 0.08 * side,
            y_m: 0.0,
            z_m: 0.1,
            pitch_deg: 30.0 * side,
            ..SensorEntry::default()
        };
        let file = MountFile::new(vec![entry("right", 1.0), entry("left", -1.0)]);
        file.write(&self.path(name)).unwrap();
        file
    }

    /// A cloud with viewpoints, as binary PLY.
    fn put_ply(&self, name: &str, points: &[Seen]) {
        let properties: String =
            ["x", "y", "z", "vp_x", "vp_y", "vp_z"].map(|name| format!("property double {name}\n")).concat();
        let mut bytes = format!(
            "ply\nformat binary_little_endian 1.0\nelement vertex {}\n{properties}end_header\n",
            points.len()
        )
        .into_bytes();
        for value in points.iter().flat_map(|seen| [seen.at_m.to_array(), seen.from_m.to_array()].concat()) {
            bytes.extend(value.to_le_bytes());
        }
        std::fs::write(self.path(name), bytes).unwrap();
    }

    /// A cloud with times, as PCD in text.
    fn put_pcd(&self, name: &str, points: &[Seen]) {
        let mut file = std::io::BufWriter::new(std::fs::File::create(self.path(name)).unwrap());
        let header = "VERSION 0.7\nFIELDS x y z timestamp\nSIZE 4 4 4 8\nTYPE F F F F\nCOUNT 1 1 1 1\n";
        writeln!(file, "{header}WIDTH {}\nHEIGHT 1\nDATA ascii", points.len()).unwrap();
        for Seen { at_m, time_ns, .. } in points {
            let time_s = *time_ns as f64 * 1e-9;
            writeln!(file, "{} {} {} {time_s:.6}", at_m.x, at_m.y, at_m.z).unwrap();
        }
    }

    /// A cloud with times, as compressed LAS.
    fn put_laz(&self, name: &str, points: &[Seen]) {
        let mut builder = las::Builder::default();
        builder.version = las::Version::new(1, 4);
        builder.point_format = las::point::Format::new(6).unwrap();
        builder.point_format.is_compressed = true;
        let axis = las::Transform { scale: 1e-4, offset: 0.0 };
        builder.transforms = las::Vector { x: axis, y: axis, z: axis };
        let mut writer = las::Writer::from_path(self.path(name), builder.into_header().unwrap()).unwrap();
        for Seen { at_m, time_ns, .. } in points {
            let gps_time = Some(*time_ns as f64 * 1e-9);
            let point = las::Point { x: at_m.x, y: at_m.y, z: at_m.z, gps_time, ..las::Point::default() };
            writer.write_point(point).unwrap();
        }
        writer.close().unwrap();
    }

    /// A cloud with viewpoints as text, moved.
    fn put_xyz(&self, name: &str, points: &[Seen], by_m: DVec3) {
        let mut file = std::io::BufWriter::new(std::fs::File::create(self.path(name)).unwrap());
        writeln!(file, "// x,y,z,intensity,vp_x,vp_y,vp_z\r").unwrap();
        for seen in points {
            let (at, from) = (seen.at_m + by_m, seen.from_m + by_m);
            writeln!(file, "{},{},{},7,{},{},{}\r", at.x, at.y, at.z, from.x, from.y, from.z).unwrap();
        }
    }

    /// Scans of a tenth of a second, each in the frame of its scanner, which is turned.
    fn put_e57(&self, name: &str, points: &[Seen], is_placed: bool) {
        use e57::{
            CartesianBounds, Quaternion, Record, RecordDataType, RecordName, RecordValue, Transform,
            Translation,
        };
        let mut writer = e57::E57Writer::from_file(self.path(name), "file").unwrap();
        let double = RecordDataType::Double { min: None, max: None };
        let axes = [RecordName::CartesianX, RecordName::CartesianY, RecordName::CartesianZ];
        let turn = DQuat::from_rotation_z(2.0) * DQuat::from_rotation_x(0.3);
        let scan_of = |seen: &Seen| (seen.time_ns - START_NS) / 100_000_000;
        let last = points.iter().map(scan_of).max().unwrap();
        for number in 0..=last {
            let of_scan: Vec<&Seen> = points.iter().filter(|seen| scan_of(seen) == number).collect();
            let from_m = of_scan.iter().map(|seen| seen.from_m).sum::<DVec3>() / of_scan.len() as f64;
            let prototype = axes.iter().map(|name| Record { name: name.clone(), data_type: double.clone() });
            let mut scan = writer.add_pointcloud(&format!("scan {number}"), prototype.collect()).unwrap();
            if is_placed {
                scan.set_transform(Some(Transform {
                    rotation: Quaternion { w: turn.w, x: turn.x, y: turn.y, z: turn.z },
                    translation: Translation { x: from_m.x, y: from_m.y, z: from_m.z },
                }));
                // pye57 states the box in the frame of the file
                scan.set_cartesian_bounds(Some(CartesianBounds {
                    x_min: Some(412_345.0),
                    x_max: Some(412_400.0),
                    y_min: Some(5_567_890.0),
                    y_max: Some(5_567_900.0),
                    z_min: Some(312.0),
                    z_max: Some(315.0),
                }));
            }
            for seen in of_scan {
                let at = if is_placed { turn.inverse() * (seen.at_m - from_m) } else { seen.at_m };
                scan.add_point(at.to_array().map(RecordValue::Double).to_vec()).unwrap();
            }
            scan.finalize().unwrap();
        }
        writer.finalize().unwrap();
    }

    fn predict(&self, place: &[&str]) -> Output {
        let mut command = Command::new(env!("CARGO_BIN_EXE_outrigger"));
        command.args(["predict", "--json", "--azimuths", "360", "--no-housings"]);
        command.args(["--mount", &self.text("mount.json"), "--trajectory", &self.text("walk.tum")]);
        command.args(place).env_remove("OUTRIGGER_JSON").output().unwrap()
    }

    fn document(&self, place: &[&str]) -> Value {
        let output = self.predict(place);
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{place:?}: {errors}");
        crate::support::document(&output.stdout).unwrap()
    }

    /// Cells of a coverage file, in tenths of a metre.
    fn cells(&self, name: &str) -> BTreeSet<[i64; 3]> {
        let bytes = std::fs::read(self.path(name)).unwrap();
        let body = bytes.windows(11).position(|window| window == b"end_header\n").unwrap() + 11;
        let number = |vertex: &[u8], axis: usize| {
            let value = f64::from_le_bytes(vertex[8 * axis..8 * axis + 8].try_into().unwrap());
            (10.0 * value - 0.5).round() as i64
        };
        bytes[body..].chunks_exact(28).map(|vertex| [0, 1, 2].map(|axis| number(vertex, axis))).collect()
    }
}

/// The same rig on the same way, in the room and in the map that denser sensors made of it.
fn a_cloud_predicts_what_its_room_does() {
    let folder = Folder::new();
    folder.put_ply("cloud.ply", &recorded(|_| true));
    let [scene, out] = [folder.text("cloud.ply"), folder.text("seen.ply")];
    let map = folder.document(&["--scene", &scene, "--out", &out]);
    let in_map = folder.cells("seen.ply");
    let corners = [LOW_M.to_array(), HIGH_M.to_array()].concat();
    let corners = corners.iter().map(f64::to_string).collect::<Vec<_>>().join(",");
    let room = folder.document(&[&format!("--room={corners}"), "--out", &out]);
    let in_room = folder.cells("seen.ply");
    assert_eq!(map["grid"]["cells"], room["grid"]["cells"], "the map's cells are the room's");
    for axis in 0..3 {
        let [mapped, drawn] = [&map, &room].map(|it| it["grid"]["origin_m"][axis].as_f64().unwrap());
        assert!((mapped - drawn).abs() < 1e-9, "{mapped} {drawn}");
    }
    let both = in_map.intersection(&in_room).count() as f64;
    let iou = both / (in_map.len() as f64 + in_room.len() as f64 - both);
    // a ray along a wall enters the wall's cells half a cell before the wall, so that it ends early: cells seen at a
    // grazing angle only are swapped for nearer ones
    assert!(iou > 0.87, "{iou}: {} in the map, {} in the room", in_map.len(), in_room.len());
    let share = in_map.len() as f64 / in_room.len() as f64;
    assert!((share - 1.0).abs() < 0.05, "{share}");
    assert!(map["returns"].as_f64().unwrap() > 0.999 * room["returns"].as_f64().unwrap());
    assert_eq!(map["map"]["made_of"], "cloud");
    assert!(map["map"]["unknown_share"].as_f64().unwrap() < 0.01, "{}", map["map"]);
    assert!(map["reachable_voxels"].as_u64().unwrap() >= in_map.len() as u64);
    let warnings = map["warnings"].as_array().unwrap();
    assert!(warnings.iter().all(|line| !line.as_str().unwrap().contains("cloud.ply")), "{warnings:?}");
    let page = folder.text("page.html");
    folder.document(&["--scene", &scene, "--report", &page]);
    assert!(std::fs::read_to_string(page).unwrap().contains("occupied and"));
}

fn clouds_say_where_they_were_seen_from() {
    let folder = Folder::new();
    let points = recorded(|_| true);
    folder.put_ply("cloud.ply", &points);
    folder.put_pcd("cloud.pcd", &points);
    folder.put_laz("cloud.laz", &points);
    let way = folder.text("walk.tum");
    let map = |name: &str, more: &[&str]| {
        let document = folder.document(&[&["--scene", &folder.text(name)], more].concat());
        let count = |what: &str| document["map"][what].as_f64().unwrap();
        let counts = [count("occupied_cells"), count("free_cells"), count("points_from_nowhere")];
        (counts, document)
    };
    let ([occupied, free, nowhere], _) = map("cloud.ply", &[]);
    assert_eq!(nowhere, 0.0);
    for name in ["cloud.pcd", "cloud.laz"] {
        let ([cells, air, nowhere], _) = map(name, &["--map-path", &way]);
        // the body's way is a hand's breadth from where the sensors were
        assert!(
            (cells / occupied - 1.0).abs() < 0.01 && (air / free - 1.0).abs() < 0.02,
            "{name}: {cells} {air}"
        );
        assert_eq!(nowhere, 0.0, "{name}");
        let ([_, air, nowhere], document) = map(name, &[]);
        assert_eq!((air, nowhere), (0.0, points.len() as f64), "{name}");
        assert!(document["map"]["unknown_share"].is_null());
        assert!(document["warnings"][0].as_str().unwrap().contains("do not say where they were seen from"));
    }
    // cells of 0.4 m that few points fall into are left empty
    let ([coarse, ..], _) = map("cloud.ply", &["--map-voxel", "0.4", "--map-hits", "255", "--voxel", "0.4"]);
    let ([all, ..], _) = map("cloud.ply", &["--map-voxel", "0.4", "--voxel", "0.4"]);
    assert!(coarse < 0.9 * all && coarse > 0.1 * all, "{coarse} of {all}");
}

fn scans_were_seen_from_where_they_are_placed() {
    let folder = Folder::new();
    let points = recorded(|_| true);
    folder.put_ply("cloud.ply", &points);
    folder.put_e57("placed.e57", &points, true);
    folder.put_e57("merged.e57", &points, false);
    let counts = |name: &str| {
        let document = folder.document(&["--scene", &folder.text(name)]);
        ["occupied_cells", "free_cells", "points_from_nowhere"]
            .map(|what| document["map"][what].as_f64().unwrap())
    };
    let [occupied, free, _] = counts("cloud.ply");
    let [cells, air, nowhere] = counts("placed.e57");
    // the scanners move by a decimetre during a scan
    assert!((cells / occupied - 1.0).abs() < 0.01 && (air / free - 1.0).abs() < 0.05, "{cells} {air}");
    assert_eq!(nowhere, 0.0);
    let [cells, air, nowhere] = counts("merged.e57");
    assert!((cells / occupied - 1.0).abs() < 0.01, "{cells} {occupied}");
    assert_eq!((air, nowhere), (0.0, points.len() as f64), "where nobody says who saw them");
}

fn clouds_in_a_national_grid() {
    let folder = Folder::new();
    let points = recorded(|_| true);
    let by_m = DVec3::new(412_345.0, -5_567_890.0, 12_312.0);
    folder.put_xyz("near.xyz", &points, DVec3::ZERO);
    folder.put_xyz("far.csv", &points, by_m);
    let far: Vec<_> =
        walk().stamped().map(|(t, pose)| (t, Pose::new(pose.rotation, pose.translation_m + by_m))).collect();
    let near = folder.document(&["--scene", &folder.text("near.xyz"), "--out", &folder.text("near.ply")]);
    std::fs::write(folder.path("walk.tum"), Trajectory::new(far).unwrap().to_tum()).unwrap();
    let far = folder.document(&["--scene", &folder.text("far.csv"), "--out", &folder.text("far.ply")]);
    for figure in ["unique_voxels", "reachable_voxels", "returns", "coverage_sha256"] {
        assert_eq!(near[figure], far[figure], "{figure}");
    }
    for count in ["occupied_cells", "free_cells", "points_from_nowhere"] {
        assert_eq!(near["map"][count], far["map"][count], "{count}");
    }
    let moved = by_m.to_array().map(|metres| (10.0 * metres) as i64);
    let expected: BTreeSet<[i64; 3]> = folder
        .cells("near.ply")
        .into_iter()
        .map(|cell| [0, 1, 2].map(|axis| cell[axis] + moved[axis]))
        .collect();
    assert_eq!(folder.cells("far.ply"), expected);
}

/// A recording that never looked into half of the room.
fn what_nobody_looked_into_is_unknown() {
    let folder = Folder::new();
    folder.put_ply("half.ply", &recorded(|at| at.x < 0.5));
    let map = folder.document(&["--scene", &folder.text("half.ply")]);
    let share = map["map"]["unknown_share"].as_f64().unwrap();
    assert!(share > 0.1 && share < 0.9, "{share}");
    let share_of_returns = map["returns"].as_f64().unwrap() / map["rays"].as_f64().unwrap();
    assert!(share_of_returns < 0.9, "{share_of_returns}");
}

/// Packets, metadata, mounts and way in a session: it is a scene for a prediction and for another recording.
fn a_session_is_a_scene() {
    let folder = Folder::new();
    let (scene, walk) = (room(), walk());
    let metadata = |sensor: u64| {
        let wanted = Synthetic::new("os1-64", 122_000_000_001 + sensor, Profile::Rng19Rfl8Sig16Nir16);
        Metadata::synthetic(&wanted.columns(512, 16)).unwrap()
    };
    let names = ["right", "left"];
    let infos: Vec<SensorInfo> = (0..2)
        .map(|sensor| SensorInfo {
            name: names[sensor].into(),
            metadata: Some(metadata(sensor as u64).to_json()),
            ..SensorInfo::default()
        })
        .collect();
    let session = folder.path("session");
    let writer = SessionWriter::create(&session, &infos).unwrap();
    let destination: SocketAddr = "10.0.0.100:7502".parse().unwrap();
    let sides = [1.0, -1.0].into_iter().zip(0..);
    let sent = sides.map(|(side, sensor)| (metadata(sensor), mount(side), destination));
    Walk { scene: &scene, trajectory: &walk, noise_m: 0.0, seed: 1 }.write(&writer, sent);
    let file = folder.put_mount("recorder.json", "os1-64");
    writer.put_mount(&file, &[]).unwrap();
    let closed = |name: &str| folder.document(&["--scene", &folder.text(name)]);
    writer.flush().unwrap();
    writer.put_trajectory(&walk).unwrap();
    writer.close(None).unwrap();
    let document = closed("session");
    assert_eq!(document["map"]["made_of"], "recording");
    assert!(document["map"]["unknown_share"].as_f64().unwrap() < 0.01, "{}", document["map"]);
    let share = document["returns"].as_f64().unwrap() / document["rays"].as_f64().unwrap();
    assert!(share > 0.999, "{share}");
    let mut compare = Command::new(env!("CARGO_BIN_EXE_outrigger"));
    compare.arg("compare").arg(&session).args(["--json", "--nulls", "0", "--scene"]).arg(&session);
    let output = compare.env_remove("OUTRIGGER_JSON").output().unwrap();
    let document: Value = crate::support::document(&output.stdout)
        .unwrap_or_else(|_| panic!("{}", String::from_utf8_lossy(&output.stderr)));
    for name in names {
        let share = document["rays"][name]["agree_share"].as_f64().unwrap();
        // where a beam grazes a wall, half a cell across is more than a decimetre along
        assert!(share > 0.93, "{name}: {share}");
    }
    std::fs::remove_file(session.join("trajectory.tum")).unwrap();
    let lacking = folder.predict(&["--scene", &folder.text("session")]);
    let errors = String::from_utf8_lossy(&lacking.stderr);
    assert_eq!(lacking.status.code(), Some(1), "{errors}");
    assert!(errors.contains("holds no trajectory"), "{errors}");
}

fn what_makes_no_map_is_refused() {
    let folder = Folder::new();
    let points = recorded(|at| at.z < 0.0);
    folder.put_ply("cloud.ply", &points);
    folder.put_pcd("cloud.pcd", &points);
    std::fs::write(folder.path("room.obj"), "v 0 0 0\nv 5 0 0\nv 0 5 3\nf 1 2 3\n").unwrap();
    std::fs::write(folder.path("other.tum"), "100 0 0 1 0 0 0 1\n200 1 0 1 0 0 0 1\n").unwrap();
    let header = "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nHEIGHT 1\n";
    std::fs::write(folder.path("empty.pcd"), format!("{header}WIDTH 0\nDATA ascii\n")).unwrap();
    std::fs::write(folder.path("nan.pcd"), format!("{header}WIDTH 1\nDATA ascii\nnan nan nan\n")).unwrap();
    std::fs::write(folder.path("timeless.pcd"), format!("{header}WIDTH 1\nDATA ascii\n1 2 1\n")).unwrap();
    std::fs::write(folder.path("cut.pcd"), format!("{header}WIDTH 2\nDATA binary\n1234")).unwrap();
    std::fs::create_dir(folder.path("folder")).unwrap();
    let way = folder.text("walk.tum");
    let other = folder.text("other.tum");
    for (scene, more, code, words) in [
        ("folder", &[][..], 1, "no session"),
        ("missing.pcd", &[], 1, "missing.pcd: cannot be read"),
        ("empty.pcd", &[], 1, "empty.pcd: the cloud holds no point"),
        ("nan.pcd", &[], 1, "no cell of 0.1 m holds 1 points"),
        ("cut.pcd", &[], 1, "20 bytes of points are missing"),
        ("cloud.ply", &["--mesh-unit", "mm"], 2, "--mesh-unit is about a mesh"),
        ("cloud.ply", &["--samples", "a.npy"], 2, "--samples is about the surface of a mesh"),
        ("cloud.ply", &["--map-voxel", "0"], 2, "--map-voxel"),
        ("cloud.ply", &["--map-hits", "0"], 2, "--map-hits"),
        ("room.obj", &["--map-path", &way], 2, "--map-path is about a map"),
        ("room.obj", &["--map-voxel", "0.2"], 2, "--map-voxel is about a map"),
        ("room.obj", &["--map-hits", "2"], 2, "--map-hits is about a map"),
        ("timeless.pcd", &["--map-path", &way], 1, "have no time"),
        ("cloud.pcd", &["--map-path", &other], 1, "no point falls into the trajectory's time"),
        ("cloud.pcd", &["--map-path", "none.tum"], 1, "none.tum"),
    ] {
        let output = folder.predict(&[&["--scene", &folder.text(scene)], more].concat());
        let errors = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{scene} {more:?}: {errors}");
        assert!(errors.contains(words), "{scene} {more:?}: {errors}");
        assert!(output.stdout.is_empty(), "{scene} {more:?}");
    }
}
