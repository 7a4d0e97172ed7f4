//! Two sensors walk through a room; something may be wrong with them.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use glam::{DQuat, DVec3};
use outrigger::base::geometry::Pose;
use outrigger::mock::sensor::{MockSensor, Surroundings};
use outrigger::rig::{Mount, MountFile, SensorEntry};
use outrigger::world::scene::{BoxScene, Scene};
use outrigger::world::trajectory::{PoseError, Trajectory};
use sensors::Packet;
use sensors::capture::PcapWriter;
use sensors::ouster::{Metadata, Profile, Synthetic};
use serde_json::Value;

const START_NS: u64 = 1_763_722_223_000_000_000;
const MODEL: &str = "os1-16";

/// What is really there, beside what is said.
struct Walk {
    /// x_m and pitch of each sensor, degrees.
    truth: [(f64, f64); 2],
    turned: bool,
    noise_m: f64,
    /// Whether the trajectory is off by what trajectories are off by.
    pose_error: Option<PoseError>,
    dead: bool,
    /// After which the second sensor sends nothing more, s.
    dies_after_s: f64,
    seconds: f64,
}

impl Default for Walk {
    fn default() -> Self {
        let truth = [(0.12, 25.0), (-0.12, -25.0)];
        let (dies_after_s, seconds) = (f64::INFINITY, 1.2);
        Self { truth, turned: false, noise_m: 0.0, pose_error: None, dead: false, dies_after_s, seconds }
    }
}

/// A recording and all that is said about it.
struct Recorded {
    folder: tempfile::TempDir,
}

fn said() -> Trajectory {
    let [from, to] = [DVec3::new(-1.5, 0.6, 1.3), DVec3::new(1.4, 0.2, 1.35)];
    Trajectory::straight(from, to, 1.2, START_NS)
}

fn metadata(sensor: u64) -> Metadata {
    let wanted = Synthetic::new(MODEL, 122_000_000_001 + sensor, Profile::Rng19Rfl8Sig16Nir16);
    Metadata::synthetic(&wanted.columns(512, 16)).unwrap()
}

impl Recorded {
    fn of(walk: &Walk) -> Self {
        let recorded = Self { folder: tempfile::tempdir().unwrap() };
        let scene = Scene::Box(BoxScene::closed(DVec3::new(-4.0, -3.0, 0.0), DVec3::new(5.0, 3.5, 3.0)));
        let said = said();
        let end_ns = START_NS + (walk.seconds * 1e9) as u64;
        let stamped = said.stamped().map(|(_, pose)| pose);
        let [from, _]: [Pose; 2] = stamped.collect::<Vec<_>>().try_into().unwrap();
        let said = Trajectory::new(vec![(START_NS, from), (end_ns, said.at(end_ns).unwrap())]).unwrap();
        std::fs::write(recorded.path("walk.tum"), said.to_tum()).unwrap();
        let way = walk.pose_error.map_or_else(|| said.clone(), |error| error.disturb(&said, 5));
        let mut capture = PcapWriter::new(Vec::new()).unwrap();
        for sensor in 0..2 {
            let metadata = metadata(sensor as u64);
            std::fs::write(recorded.path(&format!("{sensor}.json")), metadata.to_json()).unwrap();
            if walk.dead && sensor == 1 {
                continue;
            }
            let (x_m, pitch_deg) = walk.truth[sensor];
            let mount = Mount { x_m, z_m: 0.1, pitch_rad: pitch_deg.to_radians(), ..Mount::default() };
            let mut pose = mount.body_from_sensor();
            if walk.turned && sensor == 0 {
                pose = pose * Pose::new(DQuat::from_rotation_z(std::f64::consts::PI), DVec3::ZERO);
            }
            let surroundings = Surroundings {
                scene: &scene,
                trajectory: &way,
                body_from_sensor: &|_| pose,
                noise_m: walk.noise_m,
                seed: 3 + sensor as u64,
            };
            let source: SocketAddr = format!("10.0.0.{}:50000", sensor + 1).parse().unwrap();
            let destination: SocketAddr = "10.0.0.100:7502".parse().unwrap();
            MockSensor::ouster(metadata)
                .run(&surroundings, |host_time_ns, payload| {
                    let is_dead = sensor == 1 && (host_time_ns - START_NS) as f64 * 1e-9 > walk.dies_after_s;
                    if is_dead {
                        return Ok(());
                    }
                    capture.write(&Packet {
                        host_time_ns,
                        source,
                        destination,
                        link: Default::default(),
                        payload,
                    })
                })
                .unwrap();
        }
        std::fs::write(recorded.path("walk.pcap"), capture.close().unwrap()).unwrap();
        recorded.say(MODEL, [25.0, -25.0]);
        recorded
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Writes the mount file.
    fn say(&self, model: &str, pitch_deg: [f64; 2]) {
        let entry = |name: &str, x_m: f64, pitch_deg: f64| SensorEntry {
            name: name.into(),
            model: model.into(),
            x_m,
            y_m: 0.0,
            z_m: 0.1,
            pitch_deg,
            ..SensorEntry::default()
        };
        let sensors = vec![entry("right", 0.12, pitch_deg[0]), entry("left", -0.12, pitch_deg[1])];
        MountFile::new(sensors).write(&self.path("mount.json")).unwrap();
    }

    fn compare(&self, mount: &str, place: &[&str], more: &[&str]) -> Output {
        let mut command = Command::new(env!("CARGO_BIN_EXE_outrigger"));
        command.arg("compare").arg(self.path("walk.pcap")).arg("--json").args(place).args(more);
        command.arg("--mount").arg(self.path(mount)).arg("--trajectory").arg(self.path("walk.tum"));
        for meta in ["0.json", "1.json"] {
            command.arg("--meta").arg(self.path(meta));
        }
        command.output().unwrap()
    }

    fn judged(&self, mount: &str, more: &[&str]) -> (Option<i32>, Value) {
        let mut more = more.to_vec();
        if !more.contains(&"--nulls") {
            more.extend(["--nulls", "0"]);
        }
        let output = self.compare(mount, &["--room=-4,-3,0,5,3.5,3"], &more);
        let said = String::from_utf8_lossy(&output.stderr);
        let document = crate::support::document(&output.stdout).unwrap_or_else(|_| panic!("{said}"));
        (output.status.code(), document)
    }
}

pub fn a_faithful_recording_matches() {
    let recorded = Recorded::of(&Walk::default());
    let out = recorded.path("report");
    let (code, document) = recorded.judged("mount.json", &["--nulls", "19", "--out", out.to_str().unwrap()]);
    assert_eq!((code, &document["verdict"]), (Some(0), &Value::from("matches")), "{document:#}");
    for sensor in ["right", "left"] {
        let rays = &document["rays"][sensor];
        assert!(rays["agree"].as_u64().unwrap() > 90_000, "{rays}");
        assert!(rays["agree_share"].as_f64().unwrap() > 0.9999, "{rays}");
    }
    assert!(document["agreement"]["iou"].as_f64().unwrap() > 0.9999);
    assert_eq!(document["agreement"]["p_value"], 1.0);
    let coverage = &document["coverage"];
    assert_eq!(coverage["as_driven"], coverage["recorded"]);
    assert!(document["relative_tilt"]["error_deg"].as_f64().unwrap().abs() < 0.002, "{document:#}");
    let page = std::fs::read_to_string(out.join("report.html")).unwrap();
    assert!(page.contains("PASS: the recording covers what was predicted") && page.contains("wall ahead"));
    let again: Value = serde_json::from_slice(&std::fs::read(out.join("report.json")).unwrap()).unwrap();
    assert_eq!(again["rays"], document["rays"]);
}

pub fn a_tilted_sensor_is_found_and_corrected() {
    for tilt_deg in [0.1, 1.0, 5.0] {
        let truth = [(0.12, 25.0 + tilt_deg), (-0.12, -25.0)];
        let pose_error = Some(PoseError::default());
        let recorded = Recorded::of(&Walk { truth, noise_m: 0.01, pose_error, ..Walk::default() });
        let corrected = recorded.path("corrected.json");
        let (code, document) =
            recorded.judged("mount.json", &["--corrected-mount", corrected.to_str().unwrap()]);
        let found = document["relative_tilt"]["error_deg"].as_f64().unwrap();
        // a walk of a second: the house below is the place for hundredths of a degree
        let slack_deg = f64::max(0.1 * tilt_deg, 0.02);
        assert!((found - tilt_deg).abs() < slack_deg, "{tilt_deg}: {:#}", document["relative_tilt"]);
        if tilt_deg > 0.5 {
            assert_eq!((code, &document["verdict"]), (Some(3), &Value::from("differs")), "{tilt_deg}");
            let words = document["words"].to_string();
            assert!(words.contains("right is tilted +") && words.contains("right against left"), "{words}");
            let (_, after) = recorded.judged("corrected.json", &[]);
            let left_deg = after["relative_tilt"]["error_deg"].as_f64().unwrap();
            assert!(left_deg.abs() < 0.02, "{left_deg}");
        }
    }
}

/// What is not on the servo's axis is named too, is not blamed on wearers and glass, and can be put right.
pub fn a_rolled_or_shifted_sensor_is_named() {
    let recorded = Recorded::of(&Walk::default());
    let faulty = |name: &str, change: &dyn Fn(&mut SensorEntry)| {
        let mut mount = MountFile::read(&recorded.path("mount.json")).unwrap();
        change(&mut mount.sensors[0]);
        mount.write(&recorded.path(name)).unwrap();
    };
    faulty("rolled.json", &|right| right.roll_deg = 2.0);
    faulty("shifted.json", &|right| right.y_m = -0.08);
    let corrected = recorded.path("corrected.json");
    for (mount, words) in [("rolled.json", "right is rolled -2.0"), ("shifted.json", "right sits +80 ± ")] {
        let (code, document) = recorded.judged(mount, &["--corrected-mount", corrected.to_str().unwrap()]);
        assert_eq!((code, &document["verdict"]), (Some(3), &Value::from("differs")), "{mount}");
        let said = document["words"].to_string();
        assert!(said.contains(words), "{said}");
        for cause in ["left is", "left sits", "operator", "people", "glass", "door"] {
            assert!(!said.contains(cause), "{cause}: {said}");
        }
        let (code, document) = recorded.judged("corrected.json", &[]);
        assert_eq!((code, &document["verdict"]), (Some(0), &Value::from("matches")), "{document:#}");
    }
}

/// The coverage figure moves under 0.1 points for noise of the ranges and falls for an error of the poses.
pub fn errors_only_lower_coverage() {
    let recorded = |walk: &Walk| {
        let (_, document) = Recorded::of(walk).judged("mount.json", &[]);
        let share = |name: &str| 100.0 * document["surface"][name]["of_all"].as_f64().unwrap();
        [share("as_driven"), share("recorded"), share("placed")]
    };
    let [driven, clean, _] = recorded(&Walk::default());
    assert_eq!(driven, clean);
    let [_, noisy, placed] = recorded(&Walk { noise_m: 0.03, ..Walk::default() });
    assert!(noisy <= clean && clean - noisy < 0.1, "{noisy} after {clean}");
    assert!(placed > noisy + 0.5, "measured points alone would praise the noise: {placed}");
    let far = PoseError { position_sd_m: 0.10, rotation_sd_rad: 0.02, correlation_s: 2.0 };
    let [_, off, _] = recorded(&Walk { pose_error: Some(far), ..Walk::default() });
    assert!(off < clean - 0.5, "{off} after {clean}");
    let [_, tilted, _] = recorded(&Walk { truth: [(0.12, 30.0), (-0.12, -25.0)], ..Walk::default() });
    assert!(tilted < clean - 0.3, "{tilted} after {clean}");
}

/// How the sensors sit to each other, without a scene; and without a trajectory either.
pub fn sensors_are_held_against_each_other() {
    let boresight = |recorded: &Recorded, more: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_outrigger"));
        command.arg("boresight").arg(recorded.path("walk.pcap")).arg("--json").args(more);
        command.arg("--mount").arg(recorded.path("mount.json"));
        for meta in ["0.json", "1.json"] {
            command.arg("--meta").arg(recorded.path(meta));
        }
        let output = command.output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        let document: Value = crate::support::document(&output.stdout).unwrap_or_else(|_| panic!("{said}"));
        (output.status.code(), document)
    };
    for (tilt_deg, way, verdict, code) in [(5.0, "walk.tum", "differs", 3), (0.0, "odometry", "matches", 0)] {
        let truth = [(0.12, 25.0 + tilt_deg), (-0.12, -25.0)];
        let pose_error = Some(PoseError::default());
        let recorded = Recorded::of(&Walk { truth, noise_m: 0.01, pose_error, ..Walk::default() });
        let way = if way == "odometry" { way.into() } else { recorded.path(way).display().to_string() };
        let (exit, document) = boresight(&recorded, &["--trajectory", &way]);
        assert_eq!((exit, &document["verdict"]), (Some(code), &Value::from(verdict)), "{document:#}");
        let relative = &document["relative"][0];
        let [found_deg, u95_deg] =
            ["error_deg", "u95_deg"].map(|name| relative["tilt"][name].as_f64().unwrap());
        assert!((found_deg - tilt_deg).abs() < f64::max(0.1 * tilt_deg, 2.0 * u95_deg), "{relative:#}");
        assert!(u95_deg < 0.3, "{relative:#}");
    }
    let dead = Recorded::of(&Walk { dead: true, ..Walk::default() });
    let (exit, document) = boresight(&dead, &["--trajectory", &dead.path("walk.tum").display().to_string()]);
    assert_eq!((exit, &document["verdict"]), (Some(3), &Value::from("cannot_tell")));
    assert!(document["words"][0].as_str().unwrap().contains("hardly any surface"), "{document:#}");
}

fn names(document: &Value) -> Vec<(&str, String)> {
    let faults = document["faults"].as_array().unwrap();
    faults.iter().map(|fault| (fault["name"].as_str().unwrap(), fault["sensors"].to_string())).collect()
}

pub fn each_fault_has_its_name() {
    let expect = |what: &str, (code, document): (Option<i32>, Value), name: &str, sensors: &str| {
        assert_eq!(code, Some(3), "{what}: {document:#}");
        assert_eq!(document["verdict"], "differs", "{what}");
        assert_eq!(names(&document), [(name, sensors.to_owned())], "{what}: {:#}", document["words"]);
    };
    let dead = Recorded::of(&Walk { dead: true, ..Walk::default() });
    expect("dead", dead.judged("mount.json", &[]), "dead_sensor", r#"["left"]"#);
    // all that it recorded agrees
    let dying = Recorded::of(&Walk { dies_after_s: 0.4, ..Walk::default() }).judged("mount.json", &[]);
    assert!(dying.1["words"][0].as_str().unwrap().starts_with("left sends nothing from 0.4 s on, of 1.2 s"));
    expect("dying", dying, "silent_sensor", r#"["left"]"#);
    let both = r#"["right","left"]"#;
    let swapped = Recorded::of(&Walk { truth: [(-0.12, -25.0), (0.12, 25.0)], ..Walk::default() });
    expect("swapped", swapped.judged("mount.json", &[]), "swapped_sensors", both);
    let turned = Recorded::of(&Walk { turned: true, ..Walk::default() });
    expect("turned", turned.judged("mount.json", &[]), "yaw_180", r#"["right"]"#);
    let plain = Recorded::of(&Walk::default());
    plain.say(MODEL, [-25.0, 25.0]);
    expect("mirrored", plain.judged("mount.json", &[]), "mirrored_sign", both);
    plain.say(MODEL, [25.0, 25.0]);
    expect("one mirrored", plain.judged("mount.json", &[]), "mirrored_sign", r#"["left"]"#);
    plain.say("os0-32", [25.0, -25.0]);
    let (code, document) = plain.judged("mount.json", &[]);
    assert_eq!(code, Some(3));
    let found: Vec<&str> = names(&document).iter().map(|(name, _)| *name).collect();
    assert_eq!(found, ["wrong_model", "wrong_model"]);
    plain.say(MODEL, [25.0, -25.0]);
    std::fs::write(plain.path("1.json"), metadata(77).to_json()).unwrap();
    expect("other unit", plain.judged("mount.json", &[]), "metadata_of_another_unit", r#"["left"]"#);
}

fn write_box(path: &Path, unit_per_m: f64) {
    let mut text = String::new();
    for corner in 0..8 {
        let pick = |bit: u32, low: f64, high: f64| if corner >> bit & 1 == 1 { high } else { low };
        let at = [pick(0, -4.0, 5.0), pick(1, -3.0, 3.5), pick(2, 0.0, 3.0)].map(|v| v * unit_per_m);
        text += &format!("v {} {} {}\n", at[0], at[1], at[2]);
    }
    for quad in [[1, 2, 4, 3], [5, 6, 8, 7], [1, 2, 6, 5], [3, 4, 8, 7], [1, 3, 7, 5], [2, 4, 8, 6]] {
        text += &format!("f {} {} {} {}\n", quad[0], quad[1], quad[2], quad[3]);
    }
    std::fs::write(path, text).unwrap();
}

pub fn a_mesh_in_millimetres_is_named() {
    let recorded = Recorded::of(&Walk { seconds: 0.4, ..Walk::default() });
    let mesh = recorded.path("room.obj");
    write_box(&mesh, 1000.0);
    let scene = ["--scene", mesh.to_str().unwrap(), "--nulls", "0"];
    let refused = recorded.compare("mount.json", &scene, &[]);
    let said = String::from_utf8_lossy(&refused.stderr);
    assert!(refused.status.code() == Some(1) && said.contains("mm"), "{said}");
    let forced = recorded.compare("mount.json", &scene, &["--mesh-unit", "m", "--voxel", "50"]);
    let document: Value = crate::support::document(&forced.stdout).unwrap();
    assert_eq!(names(&document), [("mesh_unit", "[]".to_owned())], "{document:#}");
    assert!(document["words"][0].as_str().unwrap().contains("millimetres"));
    let right = recorded.compare("mount.json", &scene, &["--mesh-unit", "mm"]);
    let document: Value = crate::support::document(&right.stdout).unwrap();
    assert_eq!(document["verdict"], "matches", "{document:#}");
}

pub fn what_is_wrong_with_the_input_is_said() {
    let recorded = Recorded::of(&Walk { seconds: 0.2, ..Walk::default() });
    let fails = |place: &[&str], more: &[&str], words: &str| {
        let output = recorded.compare("mount.json", place, more);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code() != Some(0) && output.stdout.is_empty(), "{said}");
        assert!(said.contains(words), "{said}");
    };
    fails(&["--room=-4,-3,0,5,3.5,3"], &["--gate", "0"], "--gate <M>");
    fails(&["--room=5,3,3,-4,-3,0"], &[], "first corner must lie below");
    let out = recorded.path("out");
    fails(&["--scene", "none.ply"], &["--out", out.to_str().unwrap()], "none.ply");
    assert!(!out.exists(), "no folder is made for nothing");
    let under_a_file = recorded.path("mount.json").join("out");
    fails(&["--scene", "none.ply"], &["--out", under_a_file.to_str().unwrap()], "cannot use the folder");
    fails(&[], &[], "--scene");
    // another place: whatever else cannot be told or written, the verdict is given; few healthy runs excuse nothing
    let corrected = recorded.path("corrected.json");
    let elsewhere = ["--nulls", "5", "--corrected-mount", corrected.to_str().unwrap()];
    let output = recorded.compare("mount.json", &["--room=-20,-20,0,20,20,10"], &elsewhere);
    let document: Value = crate::support::document(&output.stdout).unwrap();
    assert_eq!((output.status.code(), &document["verdict"]), (Some(3), &Value::from("differs")));
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(said.contains("no corrected mount is written") && !corrected.exists(), "{said}");
    fails(
        &["--map-frames", "0..9"],
        &[],
        "leaves nothing to compare, right recorded 2 revolutions: expected fewer in the map",
    );
    let (code, document) = recorded.judged("mount.json", &["--time-offset", "100"]);
    assert_eq!((code, &document["verdict"]), (Some(3), &Value::from("cannot_tell")));
    assert!(document["words"].to_string().contains("--time-offset"), "{:#}", document["words"]);
}

/// No mount and no cause within the right scene is offered where the scene is a metre too large.
pub fn a_room_of_another_size_is_told_as_such() {
    let recorded = Recorded::of(&Walk { noise_m: 0.01, ..Walk::default() });
    let corrected = recorded.path("corrected.json");
    let more = ["--nulls", "0", "--corrected-mount", corrected.to_str().unwrap()];
    let output = recorded.compare("mount.json", &["--room=-5,-4,-1,6,4.5,4"], &more);
    let document: Value = crate::support::document(&output.stdout).unwrap();
    assert_eq!((output.status.code(), &document["verdict"]), (Some(3), &Value::from("differs")));
    assert!(!corrected.exists());
    let words = document["words"].to_string();
    assert!(words.contains("another size"), "{words}");
    for cause in ["operator", "people", "glass", "--corrected-mount", "is tilted", "dark, wet"] {
        assert!(!words.contains(cause), "{cause}: {words}");
    }
}

/// A map tells no tilt: that the coverage is as promised is said, and that too.
pub fn a_match_says_what_it_cannot_tell() {
    let recorded = Recorded::of(&Walk::default());
    let out = recorded.path("report");
    let more = ["--nulls", "0", "--out", out.to_str().unwrap()];
    let output = recorded.compare("mount.json", &["--map-frames", "0..9"], &more);
    let document: Value = crate::support::document(&output.stdout).unwrap();
    assert_eq!((output.status.code(), &document["verdict"]), (Some(0), &Value::from("matches")));
    let page = std::fs::read_to_string(out.join("report.html")).unwrap();
    let headline = "covers what was predicted; the pitch of right and left is not observable";
    assert!(page.contains(headline), "{page:.2000}");
}

/// Greatest distance between two ways laid together at their start, m, at the times of the first.
fn apart_m(found: &Trajectory, truth: &Trajectory) -> f64 {
    let start = truth.at(found.time_span_ns()[0]).unwrap();
    let off_m = found.stamped().filter_map(|(time_ns, pose)| {
        let expected = start.inverse() * truth.at(time_ns)?;
        Some(pose.translation_m.distance(expected.translation_m))
    });
    off_m.fold(0.0, f64::max)
}

pub fn a_walk_is_found_by_odometry() {
    let recorded = Recorded::of(&Walk { noise_m: 0.01, ..Walk::default() });
    let [tum, kitti] = [recorded.path("found.tum"), recorded.path("found.txt")];
    let run = |more: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_outrigger"));
        command.arg("odometry").arg(recorded.path("walk.pcap")).arg("--json").args(more);
        for meta in ["0.json", "1.json"] {
            command.arg("--meta").arg(recorded.path(meta));
        }
        command.output().unwrap()
    };
    let mount = recorded.path("mount.json");
    let files = ["--out", tum.to_str().unwrap(), "--kitti", kitti.to_str().unwrap()];
    let output = run(&[&["--mount", mount.to_str().unwrap()], &files[..]].concat());
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let document: Value = crate::support::document(&output.stdout).unwrap();
    assert_eq!((&document["format"], &document["sweeps"]), (&"outrigger-odometry/1".into(), &12.into()));
    assert_eq!(document["loose_sweeps"], 0, "{:#}", document["steps"]);
    let found = Trajectory::read(&std::fs::read(&tum).unwrap(), None).unwrap().trajectory;
    let off_m = apart_m(&found, &said());
    assert!(off_m < 0.03, "{off_m:.4} m apart after {} m", found.length_m());
    let begun = Trajectory::read(&std::fs::read(&kitti).unwrap(), Some(10.0)).unwrap().trajectory;
    // the last column of the walk begins a thirteenth revolution
    assert_eq!(begun.stamped().count(), 13, "one pose per revolution");
    let second = begun.stamped().nth(5).unwrap().1;
    let same = found.at(START_NS + 550_000_000).unwrap();
    assert!(second.translation_m.distance(same.translation_m) < 0.005);
    std::fs::remove_file(&tum).unwrap();
    for (more, words) in [
        (vec![], "holds 2 sensors: --mount says where they sit"),
        (vec!["--odometry-voxel", "0"], "'0' for '--odometry-voxel <M>': expected a number from 0.01 to 100"),
        (vec!["--odometry-min-range", "200"], "--odometry-min-range 200"),
    ] {
        let output = run(&[&more[..], &files[..]].concat());
        let said = String::from_utf8_lossy(&output.stderr);
        let code = if more.is_empty() { 1 } else { 2 };
        assert!(output.status.code() == Some(code) && said.contains(words), "{said}");
        assert!(output.stdout.is_empty() && !tum.exists());
    }
}

pub fn clocks_apart_are_put_together() {
    let recorded = Recorded::of(&Walk { noise_m: 0.01, ..Walk::default() });
    let early = said().stamped().map(|(time_ns, pose)| (time_ns - 250_000_000, pose)).collect();
    std::fs::write(recorded.path("walk.tum"), Trajectory::new(early).unwrap().to_tum()).unwrap();
    let (_, document) = recorded.judged("mount.json", &["--time-offset", "search"]);
    let told = &document["time_offset"];
    let [seconds, u95_s] = ["seconds", "u95_s"].map(|name| told[name].as_f64().unwrap());
    assert!((seconds + 0.25).abs() < 0.004 && u95_s < 0.01, "{told:#}");
    assert_eq!(document["time_offset_s"].as_f64().map(|s| (s - seconds).abs() < 1e-8), Some(true));
    for (place, code, words) in [
        (["--map-frames", "0..2"], 2, "--time-offset search needs a scene"),
        (["--room=-40,-30,-20,50,35,30", "--seed=1"], 1, "cannot tell the time offset"),
    ] {
        let output = recorded.compare("mount.json", &place, &["--nulls", "0", "--time-offset", "search"]);
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(code) && said.contains(words), "{said}");
    }
}
