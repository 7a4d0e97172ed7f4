//! Walks placed in scenes: by the library over the public scenes, where the statistics are asked for, and by the program.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::{Command, Output};
use std::sync::Arc;
use std::time::Instant;

use glam::{DMat4, DQuat, DVec3};
use nalgebra::{Matrix3, Rotation3, Vector3};
use outrigger::base::geometry::Pose;
use outrigger::base::rng::Rng;
use outrigger::mock::sensor::{MockSensor, Surroundings};
use outrigger::rig::{Mount, MountFile, MountedSensor, SensorEntry};
use outrigger::verify::align::{Alignment, Answer, Target, place, track, walk_returns};
use outrigger::verify::compare::RecordedRay;
use outrigger::world::scene::{Scene, load_mesh};
use outrigger::world::trajectory::Trajectory;
use sensors::capture::PcapWriter;
use sensors::ouster::{Metadata, Profile, Synthetic};
use sensors::{Packet, catalogue};
use serde_json::{Value, json};

use crate::support::shared;

const START_NS: u64 = 1_763_722_223_000_000_000;

pub fn scene(name: &str) -> Scene {
    Scene::Mesh(Arc::new(load_mesh(&shared(&format!("scenes/{name}.ply")), None, None).unwrap().mesh))
}

/// Least distance to a surface on the level, at the heights of knees, belt and head above a floor, m.
fn clear_m(scene: &Scene, floor_m: DVec3, heading_rad: f64) -> f64 {
    let ahead = DQuat::from_rotation_z(heading_rad) * DVec3::X;
    let heights = [0.3, 1.0, 1.7].into_iter();
    let ranges =
        heights.map(|z_m| scene.cast(floor_m + z_m * DVec3::Z, ahead).map_or(30.0, |hit| hit.distance_m));
    ranges.fold(30.0, f64::min)
}

/// The floor below a place at belt height.
fn floor_m(scene: &Scene, at_m: DVec3) -> Option<DVec3> {
    let hit = scene.cast(at_m, DVec3::NEG_Z)?;
    ((0.7..2.2).contains(&hit.distance_m) && hit.normal.z > 0.95).then(|| at_m - hit.distance_m * DVec3::Z)
}

/// Somebody walks about at 1 m/s, sensors at 1.2 m, turning where something is in the way.
pub fn wander(scene: &Scene, rng: &mut Rng, seconds: u64) -> Trajectory {
    let [low, high] = scene.bounds_m();
    let degrees = |n: i32| f64::from(n).to_radians();
    let mut at_m = loop {
        let at_m = DVec3::new(rng.between(low.x, high.x), rng.between(low.y, high.y), low.z + 1.2);
        let Some(floor_m) = floor_m(scene, at_m) else { continue };
        let around = (0..24).map(|n| clear_m(scene, floor_m, degrees(15 * n)));
        let (is_clear, walls) = around.fold((true, 0), |(is_clear, walls), clear_m| {
            (is_clear && clear_m > 0.6, walls + usize::from(clear_m < 20.0))
        });
        if is_clear && walls > 18 {
            break floor_m;
        }
    };
    let mut heading_rad = rng.between(0.0, std::f64::consts::TAU);
    let mut stamped = Vec::new();
    for step in 0..=10 * seconds {
        let pose = Pose::new(DQuat::from_rotation_z(heading_rad), at_m + 1.2 * DVec3::Z);
        stamped.push((START_NS + step * 100_000_000, pose));
        let is_clear = |turn: i32| {
            [-25, -12, 0, 12, 25]
                .iter()
                .all(|side| clear_m(scene, at_m, heading_rad + degrees(turn + side)) > 0.8)
        };
        let turns = (0..=18).flat_map(|n| [10 * n, -10 * n]);
        let turn = turns.into_iter().find(|turn| is_clear(*turn)).unwrap_or(180);
        heading_rad += degrees(turn.clamp(-9, 9)) + 0.02 * rng.normal();
        if turn.abs() < 30 {
            at_m += 0.1 * (DQuat::from_rotation_z(heading_rad) * DVec3::X);
        }
    }
    Trajectory::new(stamped).unwrap()
}

pub fn pair() -> Vec<MountedSensor> {
    let model = catalogue::nominal("vlp-16").unwrap();
    let mounted = |name: &str, side: f64| MountedSensor {
        name: name.into(),
        model: model.clone(),
        mount: Mount { x_m: 0.05 * side, z_m: 0.1, pitch_rad: 0.66 * side, ..Mount::default() },
    };
    vec![mounted("right", 1.0), mounted("left", -1.0)]
}

fn recorded(scene: &Scene, truth: &Trajectory, sensors: &[MountedSensor], rng: &mut Rng) -> Vec<RecordedRay> {
    let [start_ns, end_ns] = truth.time_span_ns();
    let mut rays = Vec::new();
    for (number, time_ns) in (start_ns..end_ns).step_by(100_000).enumerate() {
        let sensor = number % 2;
        let (channel, azimuth_rad) = (rng.below(16) as usize, rng.between(0.0, std::f64::consts::TAU));
        let pitch_rad = sensors[sensor].mount.pitch_rad;
        let mut ray = RecordedRay { sensor, channel, time_ns, azimuth_rad, pitch_rad, range_m: None };
        let scene_from_sensor = truth.at(time_ns).unwrap() * sensors[sensor].mount.body_from_sensor();
        let met = ray.place(sensors, &scene_from_sensor).cast(scene, &sensors[sensor]);
        ray.range_m = met.map(|(range_m, _)| range_m + 0.02 * rng.normal());
        rays.push(ray);
    }
    rays
}

/// A trajectory's own frame, anywhere and off level; and how it drifts: in a random direction by 1 % of the distance, and half
/// a degree in 10 m.
fn in_own_frame(truth: &Trajectory, rng: &mut Rng, drift: f64) -> Trajectory {
    let mut any = |half: f64| rng.between(-half, half);
    let lean = DVec3::new(any(1.0), any(1.0), 0.0).normalize() * any(5f64.to_radians());
    let rotation = DQuat::from_rotation_z(any(std::f64::consts::PI)) * DQuat::from_scaled_axis(lean);
    let own_from_scene = Pose::new(rotation, DVec3::new(any(50.0), any(50.0), any(50.0)));
    let [direction, axis] = [0, 1].map(|_| DVec3::new(any(1.0), any(1.0), any(0.3)).normalize());
    let (_, start) = truth.stamped().next().unwrap();
    let about = Pose::new(DQuat::IDENTITY, start.translation_m);
    let mut walked_m = 0.0;
    let mut last_m = start.translation_m;
    let bent = truth.stamped().map(|(time_ns, pose)| {
        walked_m += pose.translation_m.distance(last_m);
        last_m = pose.translation_m;
        let turn = DQuat::from_scaled_axis(axis * (drift * 0.05 * walked_m).to_radians());
        let off = about * Pose::new(turn, drift * 0.01 * walked_m * direction) * about.inverse();
        (time_ns, own_from_scene * off * pose)
    });
    Trajectory::new(bent.collect()).unwrap()
}

/// The rigid transform that lays one trajectory's poses best onto another's (Kabsch), by points 2 m around each.
fn best_fit(own: &Trajectory, truth: &Trajectory) -> Pose {
    let around = [DVec3::X, DVec3::Y, DVec3::Z].into_iter().flat_map(|axis| [2.0 * axis, -2.0 * axis]);
    let around: Vec<DVec3> = around.collect();
    let points = |walk: &Trajectory| -> Vec<DVec3> {
        walk.stamped().flat_map(|(_, pose)| around.iter().map(move |at| pose.transform_point(*at))).collect()
    };
    let (from, to) = (points(own), points(truth));
    let mean = |points: &[DVec3]| points.iter().sum::<DVec3>() / points.len() as f64;
    let (from_m, to_m) = (mean(&from), mean(&to));
    let mut spread = Matrix3::zeros();
    for (from, to) in from.iter().zip(&to) {
        let [a, b] = [*from - from_m, *to - to_m].map(|at| Vector3::new(at.x, at.y, at.z));
        spread += a * b.transpose();
    }
    let svd = spread.svd(true, true);
    let (u, v) = (svd.u.unwrap(), svd.v_t.unwrap().transpose());
    let sign = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (v * u.transpose()).determinant().signum()));
    let turn = Rotation3::from_matrix_unchecked(v * sign * u.transpose());
    let turn = nalgebra::UnitQuaternion::from_rotation_matrix(&turn);
    let rotation = DQuat::from_xyzw(turn.i, turn.j, turn.k, turn.w).normalize();
    Pose::new(rotation, to_m - rotation * from_m)
}

fn middle_m(walk: &Trajectory) -> DVec3 {
    walk.stamped().map(|(_, pose)| pose.translation_m).sum::<DVec3>() / walk.stamped().count() as f64
}

/// Distance in the middle of the walk, m, and angle, degrees.
fn off(found: &Pose, best: &Pose, own: &Trajectory) -> [f64; 2] {
    let middle_m = middle_m(own);
    [
        found.transform_point(middle_m).distance(best.transform_point(middle_m)),
        found.rotation.angle_between(best.rotation).to_degrees(),
    ]
}

fn aligned(scene: &Scene, rays: &[RecordedRay], sensors: &[MountedSensor], own: &Trajectory) -> Alignment {
    let (_, start) = own.stamped().next().unwrap();
    place(&walk_returns(rays, sensors, own), &start, &Target::of(scene), None).unwrap()
}

pub fn walks() -> u64 {
    std::env::var("OUTRIGGER_WALKS").ok().and_then(|count| count.parse().ok()).unwrap_or(20)
}

/// For `tests/peers/placement.py`, where `OUTRIGGER_CLOUDS` names a folder: the returns of a walk, and what was found.
fn keep(
    name: &str,
    (rays, sensors, own): (&[RecordedRay], &[MountedSensor], &Trajectory),
    truth: &Trajectory,
    [off_m, turned_deg, seconds]: [f64; 3],
) {
    let Some(folder) = std::env::var_os("OUTRIGGER_CLOUDS").map(PathBuf::from) else { return };
    let points =
        walk_returns(rays, sensors, own).into_iter().flat_map(|found| found.point_m.as_vec3().to_array());
    std::fs::write(
        folder.join(format!("{name}.f32")),
        points.flat_map(f32::to_le_bytes).collect::<Vec<u8>>(),
    )
    .unwrap();
    let best = best_fit(own, truth);
    let rows = DMat4::from_rotation_translation(best.rotation, best.translation_m).transpose();
    let found = json!({
        "scene_from_walk": rows.to_cols_array_2d(),
        "middle_m": middle_m(own).to_array(),
        "off_m": off_m.min(1e9),
        "turned_deg": turned_deg.min(1e9),
        "seconds": seconds,
    });
    std::fs::write(folder.join(format!("{name}.json")), found.to_string()).unwrap();
}

/// Twenty random walks in a public scene, with drift and without, each in a frame of its own.
fn walks_are_placed(name: &str, most_s: f64) {
    let mut wrong = Vec::new();
    let scene = scene(name);
    let sensors = pair();
    for (drift, most_m, most_deg) in [(0.0, 0.005, 0.05), (1.0, 0.05, 0.2)] {
        let (mut right, mut farthest, mut longest_s, mut least) = (0, [0.0_f64; 2], 0.0_f64, 1.0_f64);
        for seed in 0..walks() {
            let mut rng = Rng::new(seed, 0);
            let truth = wander(&scene, &mut rng, 15);
            let rays = recorded(&scene, &truth, &sensors, &mut rng);
            let own = in_own_frame(&truth, &mut rng, drift);
            let begin = Instant::now();
            let found = aligned(&scene, &rays, &sensors, &own);
            let seconds = begin.elapsed().as_secs_f64();
            longest_s = longest_s.max(seconds);
            let [off_m, turned_deg] = found
                .best
                .as_ref()
                .map_or([f64::INFINITY; 2], |best| off(&best.scene_from_walk, &best_fit(&own, &truth), &own));
            keep(
                &format!("{name}-{drift}-{seed}"),
                (&rays, &sensors, &own),
                &truth,
                [off_m, turned_deg, seconds],
            );
            let is_right = found.answer == Answer::Placed && off_m < most_m && turned_deg < most_deg;
            right += usize::from(is_right);
            if is_right {
                farthest = [farthest[0].max(off_m), farthest[1].max(turned_deg)];
                least = least.min(found.best.as_ref().unwrap().inlier_share);
            } else {
                let second = found.second_best.as_ref().map(|s| (s.only_best, s.only_second, s.z));
                println!(
                    "  {name} {seed} drift {drift}: {:?} {off_m:.4} m {turned_deg:.3} deg, share {:?}, second {second:?}",
                    found.answer,
                    found.best.as_ref().map(|best| best.inlier_share)
                );
            }
        }
        println!(
            "{name}, drift {drift} %: {right} of {}, at most {:.1} mm, {:.3} deg, least share {least:.3}, longest {longest_s:.2} s (at most {most_s} s)",
            walks(),
            1e3 * farthest[0],
            farthest[1]
        );
        if right < walks() as usize {
            wrong.push(format!("{name}, drift {drift}: {right}"));
        }
    }
    assert!(wrong.is_empty(), "{wrong:?}");
}

pub fn walks_are_placed_in_the_house() {
    walks_are_placed("house", 2.0);
}

pub fn walks_are_placed_in_the_bookstore() {
    walks_are_placed("bookstore", 2.0);
}

pub fn walks_are_placed_in_the_warehouse() {
    walks_are_placed("warehouse", 4.0);
}

pub fn walks_are_placed_in_the_office_floor() {
    walks_are_placed("office_floor", 4.0);
}

/// No walk is placed in, or tracked through, a building in which it was not recorded.
pub fn walks_in_another_building_are_refused() {
    let names = ["house", "bookstore", "warehouse", "office_floor", "corridors"];
    let (mut refused, mut pairs, mut highest) = (0, 0, 0.0_f64);
    let scenes: Vec<Scene> = names.iter().map(|name| scene(name)).collect();
    let sensors = pair();
    for seed in 0..walks().div_ceil(10) {
        for (walked, walked_scene) in scenes.iter().enumerate() {
            let mut rng = Rng::new(seed, 1);
            let truth = wander(walked_scene, &mut rng, 15);
            let rays = recorded(walked_scene, &truth, &sensors, &mut rng);
            let own = in_own_frame(&truth, &mut rng, 0.0);
            for (other, scene) in scenes.iter().enumerate().filter(|(other, _)| *other != walked) {
                let found = aligned(scene, &rays, &sensors, &own);
                let best = found.best.as_ref().map_or(0.0, |best| best.inlier_share);
                let second = found.second_best.as_ref().map(|s| (s.only_best, s.only_second, s.z));
                let tracked = track(&walk_returns(&rays, &sensors, &own), &own, &Target::of(scene), None);
                let tracked = tracked.map(|tracked| tracked.inlier_share);
                println!(
                    "{} in {}: {:?} {best:.3} {second:?}, tracked {tracked:?}",
                    names[walked], names[other], found.answer
                );
                pairs += 1;
                refused += usize::from(found.answer != Answer::Placed && tracked.is_none());
                highest = highest.max(best);
            }
        }
    }
    println!("{refused} of {pairs} pairs refused, highest share {highest:.3}");
    assert_eq!(refused, pairs);
}

/// A recording of two sensors walking through a room with two cupboards, as files.
struct Files {
    folder: tempfile::TempDir,
    truth: Trajectory,
}

fn metadata(sensor: u64) -> Metadata {
    let wanted = Synthetic::new("os1-16", 122_000_000_001 + sensor, Profile::Rng19Rfl8Sig16Nir16);
    Metadata::synthetic(&wanted.columns(512, 16)).unwrap()
}

const BOXES: [[[f64; 3]; 2]; 3] = [
    [[-4.0, -2.5, 0.0], [4.0, 2.5, 2.8]],
    [[3.0, 1.0, 0.0], [3.9, 2.2, 2.0]],
    [[-1.0, -2.4, 0.0], [0.6, -1.9, 0.9]],
];

fn write_boxes(path: &std::path::Path, boxes: &[[[f64; 3]; 2]]) {
    let mut text = String::new();
    for [low, high] in boxes {
        for corner in 0..8 {
            let at = [0, 1, 2].map(|axis| if corner >> axis & 1 == 1 { high[axis] } else { low[axis] });
            text += &format!("v {} {} {}\n", at[0], at[1], at[2]);
        }
    }
    for first in (0..boxes.len()).map(|number| 8 * number) {
        for quad in [[1, 2, 4, 3], [5, 6, 8, 7], [1, 2, 6, 5], [3, 4, 8, 7], [1, 3, 7, 5], [2, 4, 8, 6]] {
            let [a, b, c, d] = quad.map(|corner| first + corner);
            text += &format!("f {a} {b} {c} {d}\n");
        }
    }
    std::fs::write(path, text).unwrap();
}

impl Files {
    fn of() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let pose = |n: u64| {
            let angle = 0.4 + 1.4 * n as f64 / 30.0;
            let at = DVec3::new(0.4 + 1.1 * angle.cos(), -0.1 + 1.1 * angle.sin(), 1.3);
            (START_NS + n * 100_000_000, Pose::new(DQuat::from_rotation_z(angle + 1.6), at))
        };
        let truth = Trajectory::new((0..=30).map(pose).collect()).unwrap();
        let files = Self { folder, truth };
        let obj = files.path("room.obj");
        write_boxes(&obj, &BOXES);
        write_boxes(&files.path("empty.obj"), &BOXES[..1]);
        write_boxes(
            &files.path("other.obj"),
            &[[[0.0, 0.0, 0.0], [11.0, 6.5, 3.2]], [[4.0, 0.0, 0.0], [4.2, 4.5, 3.2]]],
        );
        let scene = Scene::Mesh(Arc::new(load_mesh(&obj, None, None).unwrap().mesh));
        let mut capture = PcapWriter::new(Vec::new()).unwrap();
        let mut entries = Vec::new();
        for (sensor, side) in [1.0, -1.0].into_iter().enumerate() {
            let metadata = metadata(sensor as u64);
            std::fs::write(files.path(&format!("{sensor}.json")), metadata.to_json()).unwrap();
            let mount = Mount {
                x_m: 0.12 * side,
                z_m: 0.1,
                pitch_rad: (25.0 * side).to_radians(),
                ..Mount::default()
            };
            entries.push(SensorEntry {
                name: ["right", "left"][sensor].into(),
                model: "os1-16".into(),
                x_m: 0.12 * side,
                z_m: 0.1,
                pitch_deg: 25.0 * side,
                ..SensorEntry::default()
            });
            let pose = mount.body_from_sensor();
            let surroundings = Surroundings {
                scene: &scene,
                trajectory: &files.truth,
                body_from_sensor: &|_| pose,
                noise_m: 0.01,
                seed: 3 + sensor as u64,
            };
            let source: SocketAddr = format!("10.0.0.{}:50000", sensor + 1).parse().unwrap();
            let destination: SocketAddr = "10.0.0.100:7502".parse().unwrap();
            MockSensor::ouster(metadata)
                .run(&surroundings, |host_time_ns, payload| {
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
        std::fs::write(files.path("walk.pcap"), capture.close().unwrap()).unwrap();
        MountFile::new(entries).write(&files.path("mount.json")).unwrap();
        files
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn run(&self, verb: &str, more: &[&str]) -> Output {
        let mut command = Command::new(env!("CARGO_BIN_EXE_outrigger"));
        command.current_dir(self.folder.path()).args([verb, "walk.pcap", "--json", "--mount", "mount.json"]);
        command.args(["--meta", "0.json", "--meta", "1.json"]).args(more).output().unwrap()
    }

    fn judged(&self, more: &[&str]) -> (Option<i32>, Value, String) {
        let output = self.run("compare", &[&["--nulls", "0"], more].concat());
        let messages = String::from_utf8_lossy(&output.stderr).into_owned();
        let document = crate::support::document(&output.stdout).unwrap_or_else(|_| panic!("{messages}"));
        (output.status.code(), document, messages)
    }
}

/// A trajectory of a frame of its own, or none at all, is placed; where that is not sure it is said why, and what to do.
pub fn a_walk_is_compared_without_a_trajectory_in_the_scene_s_frame() {
    let files = Files::of();
    let own = in_own_frame(&files.truth, &mut Rng::new(4, 0), 0.0);
    std::fs::write(files.path("slam.tum"), own.to_tum()).unwrap();
    let slam = ["--trajectory", "slam.tum"];
    let (code, document, messages) = files.judged(&[&slam[..], &["--scene", "room.obj", "--align"]].concat());
    assert_eq!(
        (code, &document["verdict"]),
        (Some(0), &Value::from("matches")),
        "{messages} {:#}",
        document["words"]
    );
    assert_eq!(document["reason"]["code"], "as_predicted");
    let alignment = &document["alignment"];
    let best = best_fit(&own, &files.truth).translation_m;
    for axis in 0..3 {
        let found_m = alignment["translation_m"][axis].as_f64().unwrap();
        let sd_m = alignment["sd"]["translation_m"][axis].as_f64().unwrap();
        // the frame begins up to 85 m away: a hundredth of a degree is 15 mm there
        assert!((found_m - best[axis]).abs() < 0.03 + 4.0 * sd_m, "{found_m} {}", best[axis]);
    }
    assert!(alignment["inlier_share"].as_f64().unwrap() > 0.95, "{alignment:#}");
    assert!(alignment["second_best"]["only_best"].as_f64().unwrap() > 0.01, "{alignment:#}");
    // without --align the frames are named, and what to do
    let (code, document, _) = files.judged(&[&slam[..], &["--scene", "room.obj"]].concat());
    assert_eq!((code, &document["verdict"]), (Some(3), &Value::from("differs")));
    assert_eq!(document["reason"]["code"], "another_frame", "{:#}", document["reason"]);
    assert!(document["words"][0].as_str().unwrap().contains("try --align"), "{:#}", document["words"]);
    // no trajectory at all: odometry, placed
    let (code, document, messages) = files.judged(&["--scene", "room.obj"]);
    assert_eq!(
        (code, &document["verdict"]),
        (Some(0), &Value::from("matches")),
        "{messages} {:#}",
        document["words"]
    );
    assert_eq!(document["alignment"]["answer"], "placed");
    // an empty room has two placements, another building none
    let (code, document, _) = files.judged(&[&slam[..], &["--scene", "empty.obj", "--align"]].concat());
    assert_eq!((code, &document["verdict"]), (Some(3), &Value::from("cannot_tell")));
    let code = document["reason"]["code"].as_str().unwrap();
    assert!(["placement_ambiguous", "placement_not_found"].contains(&code), "{document:#}");
    let (code, document, _) = files.judged(&[&slam[..], &["--scene", "other.obj", "--align"]].concat());
    assert_eq!((code, &document["verdict"]), (Some(3), &Value::from("cannot_tell")));
    assert_eq!(document["reason"]["code"], "placement_not_found", "{document:#}");
}

/// `odometry --scene` writes the trajectory in the scene's frame, without its drift; where no place is sure it writes none.
pub fn odometry_is_written_in_the_scene_s_frame() {
    let files = Files::of();
    let output = files.run("odometry", &["--scene", "room.obj", "-o", "found.tum"]);
    let messages = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{messages}");
    let found = Trajectory::read(&std::fs::read(files.path("found.tum")).unwrap(), None).unwrap().trajectory;
    for (time_ns, pose) in found.stamped() {
        let Some(truth) = files.truth.at(time_ns) else { continue };
        let (off_m, turn_rad) =
            (pose.translation_m.distance(truth.translation_m), pose.rotation.angle_between(truth.rotation));
        assert!(off_m < 0.02 && turn_rad.to_degrees() < 0.3, "{off_m:.4} m {:.3} deg", turn_rad.to_degrees());
    }
    let output = files.run("odometry", &["--scene", "other.obj", "-o", "none.tum"]);
    assert_eq!(output.status.code(), Some(3));
    assert!(!files.path("none.tum").exists());
    assert!(String::from_utf8_lossy(&output.stderr).contains("no trajectory is written"));
}
