//! A rig that stands while its axis goes through settings, through real packets: `outrigger rig calibrate` as a process.

use std::net::SocketAddr;
use std::path::Path;
use std::process::Command;

use glam::DVec3;
use outrigger::base::geometry::Pose;
use outrigger::mock::sensor::{MockSensor, Surroundings};
use outrigger::recording::ServoReport;
use outrigger::recording::{SensorInfo, SessionWriter};
use outrigger::rig::{Mount, MountFile, SensorEntry};
use outrigger::world::scene::{BoxScene, Scene};
use outrigger::world::trajectory::Trajectory;
use sensors::Packet;
use sensors::velodyne::{Product, ReturnMode};
use serde_json::Value;

const START_NS: u64 = 1_763_722_223_000_000_000;
const HELD_NS: u64 = 1_500_000_000;
const MOVING_NS: u64 = 100_000_000;
const SETTINGS_DEG: [f64; 7] = [-20.0, -8.0, 6.0, 20.0, 7.0, -6.0, -18.0];

/// Turned by `scale` times what is measured, and `zero_deg`; `play_deg` less when it comes from below.
#[derive(Clone, Copy)]
struct Servo {
    scale: f64,
    play_deg: f64,
    zero_deg: f64,
    /// In so many settings it counts from elsewhere: it is not homed yet.
    not_homed: usize,
}

const HONEST: Servo = Servo { scale: 1.0, play_deg: 0.0, zero_deg: 0.0, not_homed: 0 };

impl Servo {
    fn true_deg(&self, setting: usize) -> f64 {
        let from_below = setting > 0 && SETTINGS_DEG[setting - 1] < SETTINGS_DEG[setting];
        self.zero_deg + self.scale * SETTINGS_DEG[setting] - if from_below { self.play_deg } else { 0.0 }
    }

    /// At a time after the beginning, ns: the axis takes a tenth of a second from one setting to the next.
    fn on_the_way_deg(after_ns: u64, setting: usize, deg: impl Fn(usize) -> f64) -> f64 {
        let share = ((after_ns % HELD_NS) as f64 / MOVING_NS as f64).min(1.0);
        let before = deg(setting.saturating_sub(1));
        before + share * (deg(setting) - before)
    }

    fn record(&self, session: &Path, settings: usize) {
        let scene = Scene::Box(BoxScene::closed(DVec3::new(-4.0, -3.0, -1.4), DVec3::new(5.0, 3.5, 1.6)));
        let end_ns = START_NS + settings as u64 * HELD_NS;
        let stands = vec![(START_NS, Pose::IDENTITY), (end_ns, Pose::IDENTITY)];
        let stands = Trajectory::new(stands).unwrap();
        let info = SensorInfo { name: "left".into(), ..SensorInfo::default() };
        let writer = SessionWriter::create(session, &[info]).unwrap();
        let at = |time_ns: u64| ((time_ns - START_NS) / HELD_NS).min(settings as u64 - 1) as usize;
        let surroundings = Surroundings {
            scene: &scene,
            trajectory: &stands,
            body_from_sensor: &|time_ns| {
                let setting = at(time_ns);
                let true_deg = |setting| self.true_deg(setting);
                let pitch_rad = Self::on_the_way_deg(time_ns - START_NS, setting, true_deg).to_radians();
                Mount { z_m: 0.1, pitch_rad, ..Mount::default() }.body_from_sensor()
            },
            noise_m: 0.01,
            seed: 3,
        };
        let destination: SocketAddr = "10.0.0.100:2368".parse().unwrap();
        let source: SocketAddr = "10.0.0.1:2368".parse().unwrap();
        MockSensor::velodyne(Product::Vlp16, ReturnMode::Strongest, 10.0)
            .unwrap()
            .run(&surroundings, |host_time_ns, payload| {
                writer.write_packet(
                    0,
                    &Packet { host_time_ns, source, destination, link: Default::default(), payload },
                )
            })
            .unwrap();
        for time_ns in (START_NS..end_ns).step_by(20_000_000) {
            let urad = |deg: f64| (deg.to_radians() * 1e6).round() as i32;
            let setting = at(time_ns);
            let target_urad = urad(SETTINGS_DEG[setting]);
            let counted = Self::on_the_way_deg(time_ns - START_NS, setting, |setting| SETTINGS_DEG[setting]);
            let homed = setting >= self.not_homed;
            let is_new = (time_ns - START_NS) % HELD_NS < MOVING_NS;
            let report = ServoReport {
                time_ns,
                axis: 0,
                position_urad: if homed { urad(counted) + 40 } else { 500_000 },
                uncertainty_urad: homed.then_some(200),
                target_urad,
                source: if homed { "measured" } else { "not_homed" }.into(),
                homed: Some(homed),
                state: if is_new { "moving" } else { "holding" }.into(),
                faults: Vec::new(),
            };
            writer.write_servo(&report).unwrap();
        }
        let entry = SensorEntry {
            name: "left".into(),
            model: "vlp-16".into(),
            x_m: 0.0,
            y_m: 0.0,
            z_m: 0.1,
            pitch_deg: 0.0,
            ..SensorEntry::default()
        };
        writer.put_mount(&MountFile::new(vec![entry]), &[]).unwrap();
        writer.flush().unwrap();
        writer.close(None).unwrap();
    }
}

/// Exit code, the document or nothing, and what was said.
fn stand(session: &Path) -> (Option<i32>, Value, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_outrigger"));
    let output = command.args(["rig", "calibrate"]).arg(session).arg("--json").output().unwrap();
    let document = crate::support::document(&output.stdout).unwrap_or_default();
    (output.status.code(), document, String::from_utf8_lossy(&output.stderr).into_owned())
}

pub fn a_servo_s_scale_and_play_are_found() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("off");
    Servo { scale: 1.03, play_deg: 0.4, ..HONEST }.record(&path, SETTINGS_DEG.len());
    let (exit, document, said) = stand(&path);
    assert_eq!(exit, Some(3), "{document:#} {said}");
    assert_eq!(document["verdict"], "differs");
    let test = &document["sensors"][0];
    assert_eq!(test["settings"].as_array().unwrap().len(), SETTINGS_DEG.len());
    let value = |name: &str| test[name]["value"].as_f64().unwrap();
    assert!((value("scale_error") - 0.03).abs() < 0.003, "{test:#}");
    assert!((value("play_deg") - 0.4).abs() < 0.06, "{test:#}");
    let words = document["words"][0].as_str().unwrap();
    assert!(words.contains("wrong gear or scale") && words.contains("of play"), "{words}");
}

pub fn an_honest_servo_does_as_it_measures() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("honest");
    HONEST.record(&path, SETTINGS_DEG.len());
    let (exit, document, said) = stand(&path);
    assert_eq!((exit, &document["verdict"]), (Some(0), &"as_measured".into()), "{document:#} {said}");
    let few = folder.path().join("few");
    HONEST.record(&few, 2);
    let (exit, document, said) = stand(&few);
    assert_eq!((exit, &document["verdict"]), (Some(3), &"cannot_tell".into()), "{document:#} {said}");
    std::fs::remove_file(few.join("servo.jsonl")).unwrap();
    let (exit, _, said) = stand(&few);
    assert_eq!(exit, Some(1), "{said}");
    assert!(said.contains("no angle that an axis measured"), "{said}");
    let (exit, _, said) = stand(folder.path());
    assert!(exit == Some(1) && said.contains("is no session"), "{said}");
}

/// Exit code, the document or nothing, and what was said.
fn compare(session: &Path, more: &[&str]) -> (Option<i32>, Value, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_outrigger"));
    command.arg("compare").arg(session).args(["--json", "--nulls", "0", "--trajectory", "still"]);
    let output = command.arg("--room=-4,-3,-1.4,5,3.5,1.6").args(more).output().unwrap();
    let document: Value = crate::support::document(&output.stdout).unwrap_or_default();
    (output.status.code(), document, String::from_utf8_lossy(&output.stderr).into_owned())
}

fn share(document: &Value) -> f64 {
    document["rays"]["left"]["agree_share"].as_f64().unwrap()
}

/// The sensor sits at the mount file's 0 degrees, whatever the axis counts; from the second setting on it is homed.
pub fn an_axis_that_is_not_homed_measures_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let never = folder.path().join("never");
    Servo { zero_deg: 20.0, not_homed: 1, ..HONEST }.record(&never, 1);
    let (exit, document, said) = compare(&never, &[]);
    assert_eq!(exit, Some(0), "{document:#} {said}");
    assert!(share(&document) > 0.99, "{document:#}");
    assert!(document["servo_zero"].as_array().is_none_or(Vec::is_empty), "{document:#}");
    assert!(
        said.contains("left: its axis was never homed") && said.contains("mount file, +0.00 degrees"),
        "{said}"
    );
    let (exit, _, said) = compare(&never, &["--axis-zero", "left=1"]);
    assert!(exit == Some(1) && said.contains("holds no angle that an axis"), "{said}");
    let (exit, _, said) = stand(&never);
    assert!(
        exit == Some(1) && said.contains("no angle that an axis measured") && said.contains("never homed"),
        "{said}"
    );

    let later = folder.path().join("later");
    Servo { zero_deg: 20.0, not_homed: 1, ..HONEST }.record(&later, 2);
    let (exit, document, said) = compare(&later, &["--axis-zero", "left=20"]);
    assert_eq!(exit, Some(0), "{document:#} {said}");
    assert!(share(&document) > 0.97, "{document:#}");
    assert!(said.contains("left: its axis was not homed for 1.5 s of 3.0 s"), "{said}");
}

/// What `compare` offers as the zero of an axis is what makes the recording agree once it is typed.
pub fn the_zero_that_is_offered_is_the_one_that_fits() {
    let folder = tempfile::tempdir().unwrap();
    let session = folder.path().join("session");
    Servo { zero_deg: 2.0, ..HONEST }.record(&session, 2);
    let compare = |more: &[&str]| compare(&session, more);
    let (exit, document, said) = compare(&[]);
    assert_eq!(exit, Some(3), "{said}");
    assert!(share(&document) < 0.9, "{document:#}");
    assert!(
        said.contains("left: the mount file says +0.00 degrees") && said.contains("the axis counts"),
        "{said}"
    );
    let zero_deg = document["servo_zero"][0]["add_deg"].as_f64().unwrap();
    assert!((zero_deg - 2.0).abs() < 0.1, "{zero_deg}");

    let typed = format!("left={zero_deg}");
    let (exit, document, said) = compare(&["--axis-zero", &typed]);
    assert_eq!(exit, Some(0), "{document:#} {said}");
    assert!(!said.contains("the axis counts"), "{said}");
    assert!(share(&document) > 0.99, "{document:#}");
    let again_deg = document["servo_zero"][0]["add_deg"].as_f64().unwrap();
    assert!((again_deg - zero_deg).abs() < 0.05, "the whole zero is offered: {again_deg}");
    assert!(document["rig"][0]["measured_pitch_deg"].as_f64().unwrap() < -13.0, "as measured");

    let (exit, _, said) = compare(&["--axis-zero", "right=1"]);
    assert!(exit == Some(1) && said.contains("--axis-zero right"), "{said}");
    let (exit, _, said) = compare(&["--axis-zero", "left=far"]);
    assert!(exit == Some(2) && said.contains("far"), "{said}");
}
