//! One registered cloud out of a recording: `decode --frame world` and `--frame rig`, `odometry --map`.

mod captures;

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use glam::{DQuat, DVec3};
use outrigger::base::geometry::Pose;
use outrigger::recording::{SensorInfo, SessionWriter};
use outrigger::rig::{Mount, MountFile, MountedSensor, SensorEntry};
use outrigger::world::scene::{BoxScene, Scene};
use outrigger::world::trajectory::Trajectory;
use sensors::ouster::{Metadata, Profile, Synthetic};
use serde_json::Value;

use crate::support::walk::Walk;
use crate::support::{Case, case, with_shared};

pub const CASES: &[Case] = &[
    case("both_sensors_lie_on_the_walls", both_sensors_lie_on_the_walls),
    case("points_are_selected_in_any_order_of_options", points_are_selected_in_any_order_of_options),
    case("far_grids_keep_their_coordinates", far_grids_keep_their_coordinates),
    case("odometry_saves_its_map", odometry_saves_its_map),
    case("the_world_of_a_still_rig_is_its_frame", the_world_of_a_still_rig_is_its_frame),
    case("a_bag_brings_mount_and_trajectory", a_bag_brings_mount_and_trajectory),
    case("what_does_not_fit_is_refused", what_does_not_fit_is_refused),
    with_shared("planes_are_thinner_when_every_return_has_its_own_time", captures::planes_are_thinner),
    with_shared("revolutions_are_cut_whole", captures::revolutions_are_cut_whole),
    with_shared("topics_of_poses_are_trajectories", captures::topics_of_poses_are_trajectories),
];

const START_NS: u64 = 1_763_722_223_000_000_000;
const LOW_M: DVec3 = DVec3::new(-5.0, -4.0, 0.0);
const HIGH_M: DVec3 = DVec3::new(5.0, 4.0, 3.0);

fn run(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_outrigger"))
        .args(arguments)
        .env_remove("OUTRIGGER_JSON")
        .output()
        .unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Runs to the end, with this exit code; the document and what was said.
fn ran(code: i32, arguments: &[&str]) -> (Value, String) {
    let output = run(&[arguments, &["--json"]].concat());
    let words = stderr(&output);
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {words}");
    (crate::support::document(&output.stdout).unwrap_or(Value::Null), words)
}

/// A walk of a second with turns up to 40 degrees a second.
fn walk() -> Trajectory {
    let pose = |step: u64| {
        let s = step as f64 * 0.02;
        let turn =
            DQuat::from_rotation_z(0.7 * (2.0 * s).sin()) * DQuat::from_rotation_x(0.1 * (9.0 * s).sin());
        Pose::new(turn, DVec3::new(-1.0 + 1.4 * s, 0.5 * s, 1.4 + 0.03 * (12.0 * s).sin()))
    };
    Trajectory::new((0..=60).map(|step| (START_NS + step * 20_000_000, pose(step))).collect()).unwrap()
}

fn mount(side: f64) -> Mount {
    Mount { x_m: 0.1 * side, z_m: 0.2, pitch_rad: 0.5 * side, yaw_rad: 0.8 * side, ..Mount::default() }
}

fn metadata(sensor: u64) -> Metadata {
    let wanted = Synthetic::new("os1-16", 122_000_000_001 + sensor, Profile::Rng19Rfl8Sig16Nir16);
    Metadata::synthetic(&wanted.columns(512, 16)).unwrap()
}

/// A session of two sensors that walk through a room.
struct Room {
    folder: tempfile::TempDir,
}

impl Room {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let (scene, walk) = (Scene::Box(BoxScene::closed(LOW_M, HIGH_M)), walk());
        let info = |at: u64| SensorInfo {
            name: ["right", "left"][at as usize].into(),
            metadata: Some(metadata(at).to_json()),
            ..SensorInfo::default()
        };
        let session = folder.path().join("walk");
        let writer = SessionWriter::create(&session, &[info(0), info(1)]).unwrap();
        let destination: SocketAddr = "10.0.0.100:7502".parse().unwrap();
        let sides = [1.0, -1.0].into_iter().zip(0..);
        let sent = sides.map(|(side, sensor)| (metadata(sensor), mount(side), destination));
        Walk { scene: &scene, trajectory: &walk, noise_m: 0.0, seed: 1 }.write(&writer, sent);
        let mounted = [("right", 1.0), ("left", -1.0)].map(|(name, side)| MountedSensor {
            name: name.to_owned(),
            model: sensors::catalogue::nominal("os1-16").unwrap(),
            mount: mount(side),
        });
        let entries = mounted.iter().map(|sensor| SensorEntry {
            name: sensor.name.clone(),
            model: "os1-16".into(),
            x_m: sensor.mount.x_m,
            y_m: sensor.mount.y_m,
            z_m: sensor.mount.z_m,
            pitch_deg: sensor.mount.pitch_rad.to_degrees(),
            yaw_deg: sensor.mount.yaw_rad.to_degrees(),
            ..SensorEntry::default()
        });
        writer.put_mount(&MountFile::new(entries.collect()), &[]).unwrap();
        writer.put_trajectory(&walk).unwrap();
        writer.close(None).unwrap();
        Self { folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn text(&self, name: &str) -> String {
        self.path(name).to_str().unwrap().to_owned()
    }
}

/// One row of an `.npy` file.
#[derive(Clone, Copy)]
struct Row {
    sensor: u16,
    return_number: u8,
    time_ns: u64,
    at_m: DVec3,
    range_m: f64,
}

fn rows(path: &Path) -> Vec<Row> {
    let bytes = std::fs::read(path).unwrap();
    let row = |row: &[u8]| {
        let f64_at = |at: usize| f64::from_le_bytes(row[at..at + 8].try_into().unwrap());
        Row {
            sensor: u16::from_le_bytes([row[0], row[1]]),
            return_number: row[12],
            time_ns: u64::from_le_bytes(row[13..21].try_into().unwrap()),
            at_m: DVec3::new(f64_at(25), f64_at(33), f64_at(41)),
            range_m: f64::from(u32::from_le_bytes(row[49..53].try_into().unwrap())) * 1e-3,
        }
    };
    bytes[512..].chunks_exact(60).map(row).collect()
}

fn off_walls_m(at_m: DVec3) -> f64 {
    (at_m - LOW_M).abs().min((at_m - HIGH_M).abs()).min_element()
}

fn both_sensors_lie_on_the_walls() {
    let room = Room::new();
    let (session, out) = (room.text("walk"), room.path("world.npy"));
    let (document, words) = ran(0, &["decode", &session, "--frame", "world", "-o", out.to_str().unwrap()]);
    let points = rows(&out);
    let decoded: u64 =
        document["sensors"].as_array().unwrap().iter().map(|s| s["totals"]["points"].as_u64().unwrap()).sum();
    assert_eq!(points.len() as u64, decoded, "{words}");
    assert!(points.len() > 100_000 && [0, 1].iter().all(|sensor| points.iter().any(|p| p.sensor == *sensor)));
    // ranges have steps of a millimetre
    let worst_m = points.iter().map(|point| off_walls_m(point.at_m)).fold(0.0, f64::max);
    assert!(worst_m < 2e-3, "{worst_m}");
    // with one pose per revolution walls are decimetres thick
    let walk = walk();
    let mut frozen_m: f64 = 0.0;
    for point in &points {
        let pose = walk.at(point.time_ns).unwrap();
        let began_ns = START_NS + (point.time_ns - START_NS) / 100_000_000 * 100_000_000;
        let at_m = walk.at(began_ns).unwrap().transform_point(pose.inverse().transform_point(point.at_m));
        frozen_m = frozen_m.max(off_walls_m(at_m));
    }
    assert!(frozen_m > 0.1, "{frozen_m}");
    // in the frame of the rig each lies where the rig saw it
    let rig = room.path("rig.npy");
    ran(0, &["decode", "--frame", "rig", "-o", rig.to_str().unwrap(), &session]);
    for (world, rig) in points.iter().zip(rows(&rig)) {
        let at_m = walk.at(world.time_ns).unwrap().transform_point(rig.at_m);
        assert!(at_m.abs_diff_eq(world.at_m, 1e-9));
    }
    // one file for all, also where the format cannot tell sensors apart
    let ply = room.path("world.ply");
    ran(0, &["decode", &session, "--frame", "world", "--out", ply.to_str().unwrap()]);
    let header = String::from_utf8_lossy(&std::fs::read(&ply).unwrap()[..400]).into_owned();
    assert!(header.contains(&format!("element vertex {}\n", points.len())), "{header}");
    // the summary has no line for each frame, -v has
    let [brief, verbose] = [&[][..], &["-v"]].map(|more| {
        let output = run(&[&["decode", session.as_str()][..], more].concat());
        String::from_utf8(output.stdout).unwrap()
    });
    assert!(brief.lines().count() < 12 && verbose.lines().count() > 20, "{brief}");
}

fn points_are_selected_in_any_order_of_options() {
    let room = Room::new();
    let (session, out) = (room.text("walk"), room.path("part.npy"));
    let all = room.path("all.npy");
    ran(0, &["decode", &session, "--frame", "world", "-o", all.to_str().unwrap()]);
    let all = rows(&all);
    let part = |options: &[&str]| {
        let base = ["--frame", "world", "--force", "-o", out.to_str().unwrap()];
        ran(0, &[&["decode"], options, &base, &[session.as_str()]].concat());
        let first = std::fs::read(&out).unwrap();
        ran(0, &[&["decode", session.as_str()], &base[..], options].concat());
        assert!(std::fs::read(&out).unwrap() == first, "{options:?}");
        rows(&out)
    };
    let expect = |options: &[&str], is_meant: &dyn Fn(&Row) -> bool| {
        let (found, expected) = (part(options).len(), all.iter().filter(|row| is_meant(row)).count());
        assert!(found == expected && found > 0 && found < all.len(), "{options:?}: {found}, {expected}");
    };
    let ns = |ms: u64| START_NS + ms * 1_000_000;
    expect(&["--sensor", "left"], &|row| row.sensor == 1);
    expect(&["--sensor", "122000000001"], &|row| row.sensor == 0);
    expect(&["--range", "1.5..4"], &|row| (1.5..=4.0).contains(&row.range_m));
    expect(&["--clip=-5.5,-1,-0.5,0,2,2"], &|row| {
        (row.at_m.cmpge(DVec3::new(-5.5, -1.0, -0.5)) & row.at_m.cmple(DVec3::new(0.0, 2.0, 2.0))).all()
    });
    expect(&["--frames", "2..4", "--returns", "first"], &|row| {
        row.return_number == 1 && (ns(200)..ns(400)).contains(&row.time_ns)
    });
    expect(&["--from", "3f", "--to", "5f"], &|row| (ns(300)..ns(500)).contains(&row.time_ns));
    // the window is on the host's clock, which the mock sensors' packets reach with what they hold: 16 columns of 0.195 ms
    let about = part(&["--from", "0.25", "--to", "0.55"]);
    let span = |pick: fn(u64, u64) -> u64| about.iter().map(|row| row.time_ns).reduce(pick).unwrap();
    let (first_ns, last_ns) = (span(u64::min), span(u64::max));
    assert!(
        first_ns.abs_diff(ns(250)) < 5_000_000 && last_ns.abs_diff(ns(550)) < 5_000_000,
        "{first_ns} {last_ns}"
    );
    // one point per voxel, and no voxel lost
    let voxel = |row: &Row| (row.at_m / 0.2).floor().to_array().map(|value| value as i32);
    let thinned = part(&["--voxel", "0.2"]);
    let cells: std::collections::BTreeSet<_> = all.iter().map(voxel).collect();
    assert_eq!((thinned.len(), thinned.iter().map(voxel).collect()), (cells.len(), cells));
    // the operator: nothing is left near the vertical below the rig
    let masked = part(&["--mask", "0,0,-3,0,0,0,2.5"]);
    let walk = walk();
    let is_near = |row: &Row| {
        let at_m = walk.at(row.time_ns).unwrap().inverse().transform_point(row.at_m);
        at_m.z < 0.0 && at_m.truncate().length() < 2.5
    };
    assert!(all.iter().any(is_near) && !masked.iter().any(is_near));
    let said = stderr(&run(&["decode", &session, "--sensor", "middle"]));
    assert!(
        said.contains("--sensor middle: no packet of it; there are ") && said.contains("right"),
        "{said}"
    );
    let far = [
        "decode",
        &session,
        "--frame",
        "world",
        "--clip",
        "100,100,100,101,101,101",
        "-o",
        &room.text("none.laz"),
    ];
    let output = run(&far);
    assert!(output.status.code() == Some(1) && !room.path("none.laz").exists(), "{}", stderr(&output));
    assert!(stderr(&output).contains("no point is left"), "{}", stderr(&output));
}

fn far_grids_keep_their_coordinates() {
    let room = Room::new();
    let shift_m = DVec3::new(412_341.0, 5_567_887.0, 312.0);
    let far: Vec<_> = walk()
        .stamped()
        .map(|(at, pose)| (at, Pose::new(pose.rotation, pose.translation_m + shift_m)))
        .collect();
    std::fs::write(room.path("far.tum"), Trajectory::new(far).unwrap().to_tum()).unwrap();
    let (session, far, out) = (room.text("walk"), room.text("far.tum"), room.text("far.laz"));
    let world = ["decode", &session, "--frame", "world", "--trajectory", &far];
    ran(0, &[&world[..], &["--crs", "EPSG:25832", "-o", &out]].concat());
    let mut reader = las::Reader::from_path(&out).unwrap();
    let data = reader.read_all().unwrap();
    let header = reader.header().clone();
    let offsets = [header.transforms().x.offset, header.transforms().y.offset, header.transforms().z.offset];
    assert_eq!(offsets.map(f64::fract), [0.0; 3]);
    assert!((offsets[1] - 5_567_887.0).abs() < 10.0, "{offsets:?}");
    let wkt = String::from_utf8_lossy(header.get_wkt_crs_bytes().unwrap()).into_owned();
    assert!(header.has_wkt_crs() && wkt.starts_with("PROJCS[\"ETRS89 / UTM zone 32N\""), "{wkt}");
    let mut count = 0;
    for point in data.points() {
        let point = point.unwrap();
        let off_m = off_walls_m(DVec3::new(point.x, point.y, point.z) - shift_m);
        assert!(off_m < 2.2e-3, "{off_m}");
        let gps_s = point.gps_time.unwrap() + 1e9;
        let utc_s = gps_s + 315_964_800.0 - 18.0;
        assert!((0.0..1.3).contains(&(utc_s - START_NS as f64 * 1e-9)), "{utc_s}");
        count += 1;
    }
    assert!(count > 100_000);
    for name in ["far.ply", "far.e57", "far.csv"] {
        ran(0, &[&world[..], &["--voxel", "0.5", "-o", &room.text(name)]].concat());
    }
    let ply = std::fs::read(room.path("far.ply")).unwrap();
    assert!(String::from_utf8_lossy(&ply[..400]).contains("property double x\n"));
    let csv = std::fs::read_to_string(room.path("far.csv")).unwrap();
    assert!(csv.lines().nth(1).unwrap().contains(",556788"), "{:?}", csv.lines().nth(1));
    let e57 = e57::E57Reader::from_file(room.path("far.e57")).unwrap();
    assert!(!e57.pointclouds().is_empty());
    for name in ["far.pcd", "far.mcap"] {
        let output = run(&[&world[..], &["-o", &room.text(name)]].concat());
        assert!(stderr(&output).contains("which its 32 bits hold to half a metre"), "{}", stderr(&output));
        assert!(output.status.code() == Some(1) && !room.path(name).exists());
    }
}

fn odometry_saves_its_map() {
    let room = Room::new();
    let (session, tum, map) = (room.text("walk"), room.text("found.tum"), room.path("map.npy"));
    let (document, words) = ran(0, &["odometry", &session, "-o", &tum, "--map", map.to_str().unwrap()]);
    assert!(!words.contains("outside of the trajectory"), "{words}");
    let found = Trajectory::read(&std::fs::read(&tum).unwrap(), None).unwrap().trajectory;
    let points = rows(&map);
    let [first_ns, last_ns] = found.time_span_ns();
    assert!(points.iter().all(|point| (first_ns..=last_ns).contains(&point.time_ns)));
    // every return of the recording, in the frame of the body at its start, which is moved to the truth's
    let all = room.path("all.npy");
    ran(0, &["decode", &session, "--frame", "world", "-o", all.to_str().unwrap()]);
    let truth = rows(&all);
    assert_eq!(points.len(), truth.len(), "{document:#}");
    let world_from_start = walk().at(first_ns).unwrap() * found.at(first_ns).unwrap().inverse();
    let mut off_m: Vec<f64> = points
        .iter()
        .zip(&truth)
        .map(|(point, truth)| world_from_start.transform_point(point.at_m).distance(truth.at_m))
        .collect();
    off_m.sort_by(f64::total_cmp);
    let median_m = off_m[off_m.len() / 2];
    assert!(median_m < 0.05, "{median_m}");
    // `decode` finds the same
    let own = room.path("own.npy");
    ran(
        0,
        &["decode", &session, "--frame", "world", "--trajectory", "odometry", "-o", own.to_str().unwrap()],
    );
    assert!(std::fs::read(&own).unwrap() == std::fs::read(&map).unwrap());
    // a part of a revolution at the end is in it
    let part = room.text("part.pcap");
    ran(0, &["cut", &session, "--sensor", "left", "--to", "0.53", "-o", &part]);
    let metadata = room.text("walk/metadata/left.json");
    let out = room.text("part.npy");
    let (_, words) = ran(0, &["odometry", &part, "--meta", &metadata, "--map", &out]);
    assert!(!words.contains("outside of the trajectory"), "{words}");
    let last_ns = rows(Path::new(&out)).iter().map(|point| point.time_ns).max().unwrap();
    assert!(last_ns > START_NS + 520_000_000, "{last_ns}");
}

fn a_bag_brings_mount_and_trajectory() {
    let room = Room::new();
    let (session, out) = (room.text("walk"), room.path("direct.npy"));
    ran(0, &["decode", &session, "--frame", "world", "-o", out.to_str().unwrap()]);
    let direct = rows(&out);
    for name in ["walk.mcap", "walk.bag"] {
        let bag = room.text(name);
        ran(0, &["cut", &session, "-o", &bag]);
        let from_bag = room.path("from_bag.npy");
        let (_, words) = ran(
            0,
            &[
                "decode",
                &bag,
                "--frame",
                "world",
                "--trajectory",
                &room.text("walk/trajectory.tum"),
                "--force",
                "-o",
                from_bag.to_str().unwrap(),
            ],
        );
        assert!(words.contains("left: mounted as the static transforms say"), "{words}");
        let found = rows(&from_bag);
        assert_eq!(found.len(), direct.len(), "{name}");
        let sorted = |mut rows: Vec<Row>| {
            rows.sort_by_key(|row| {
                (row.time_ns, row.at_m.to_array().map(|value| (value * 1e5).round() as i64))
            });
            rows
        };
        for (a, b) in sorted(found).iter().zip(sorted(direct.clone())) {
            assert!(
                a.time_ns == b.time_ns && a.at_m.abs_diff_eq(b.at_m, 1e-4),
                "{name}: {} {}",
                a.at_m,
                b.at_m
            );
        }
        if name == "walk.bag" {
            // its poses place a map of its own frames; where they lie in a scene is not known
            let corners: Vec<String> =
                [LOW_M, HIGH_M].iter().flat_map(|at| at.to_array()).map(|value| value.to_string()).collect();
            let room = format!("--room={}", corners.join(","));
            for (place, words) in [
                (&["--map-frames", "0..4"][..], "trajectory of /tf"),
                (&[room.as_str()], "--align takes the bag's own poses"),
            ] {
                let output = run(&[&["compare", &bag, "--nulls", "0"], place].concat());
                assert!(stderr(&output).contains(words), "{place:?}: {}", stderr(&output));
            }
            continue;
        }
        // every verb that needs mounts has them
        let (document, _) = ran(0, &["odometry", &bag]);
        let names: std::collections::BTreeSet<_> = document["sensors"]
            .as_array()
            .unwrap()
            .iter()
            .map(|sensor| sensor.as_str().unwrap().to_owned())
            .collect();
        assert_eq!(names, ["left", "right"].map(str::to_owned).into(), "{name}");
    }
}

fn the_world_of_a_still_rig_is_its_frame() {
    let room = Room::new();
    let session = room.text("walk");
    let of = |arguments: &[&str], out: &str| {
        ran(0, &[&["decode", &session, "-o", &room.text(out)], arguments].concat());
        rows(&room.path(out))
    };
    let rig = of(&["--frame", "rig"], "rig.npy");
    let world = of(&["--frame", "world", "--trajectory", "still"], "world.npy");
    assert!(rig.len() > 1000 && rig.len() == world.len());
    assert!(rig.iter().zip(&world).all(|(a, b)| a.at_m == b.at_m && a.time_ns == b.time_ns));
}

fn what_does_not_fit_is_refused() {
    let room = Room::new();
    let session = room.text("walk");
    std::fs::write(room.path("early.tum"), "1 0 0 0 0 0 0 1\n2 1 0 0 0 0 0 1\n").unwrap();
    std::fs::write(room.path("two.txt"), "1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 1 0 1 0 0 0 0 1 0\n").unwrap();
    let (early, two, out) = (room.text("early.tum"), room.text("two.txt"), room.text("out.laz"));
    for (arguments, code, words) in [
        (&["--trajectory", &early][..], 2, "--trajectory needs --frame world or --frame rig"),
        (&["--mask", "operator"], 2, "--mask needs --frame world or --frame rig"),
        (&["--frame", "rig", "--crs", "EPSG:25832"], 2, "--crs needs --frame world"),
        (&["--frame", "world", "--crs", "EPSG:2056"], 2, "projinfo EPSG:2056"),
        (
            &["--frame", "world", "--format", "csv", "--crs", "EPSG:25832", "--out", "a.csv"],
            2,
            "csv file has no place",
        ),
        (
            &["--frame", "world", "--trajectory", &early, "--out", &out],
            1,
            "outside of the trajectory's time, 1.000 to 2.000 s",
        ),
        (&["--frame", "world", "--trajectory", &two, "--out", &out], 1, "2 poses without times, and"),
        (&["--out", "no/such/folder/a.laz"], 1, "there is no folder no/such/folder; make it first"),
        (&["--format", "ply", "--out", "no/such/"], 1, "there is no folder no;"),
    ] {
        let output = run(&[&["decode", &session], arguments].concat());
        assert!(stderr(&output).contains(words), "{arguments:?}: {}", stderr(&output));
        assert_eq!(output.status.code(), Some(code), "{arguments:?}: {}", stderr(&output));
        assert!(!room.path("out.laz").exists());
    }
    // a trajectory that covers half of it: what has no pose is counted
    let half: Vec<_> = walk().stamped().take(30).collect();
    std::fs::write(room.path("half.tum"), Trajectory::new(half).unwrap().to_tum()).unwrap();
    let (document, _) = ran(
        3,
        &["decode", &session, "--frame", "world", "--trajectory", &room.text("half.tum"), "--out", &out],
    );
    assert!(
        document["losses"].to_string().contains("points lie outside of the trajectory's time"),
        "{document:#}"
    );
}
