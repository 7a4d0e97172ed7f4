//! A session of a Velodyne: whose beams it is compared with.

use std::net::SocketAddr;
use std::path::Path;
use std::process::Command;

use glam::DVec3;
use outrigger::base::geometry::Pose;
use outrigger::mock::sensor::{MockSensor, Surroundings};
use outrigger::recording::{SensorInfo, Session, SessionWriter};
use outrigger::rig::{MountFile, SensorEntry};
use outrigger::world::scene::{BoxScene, Scene};
use outrigger::world::trajectory::Trajectory;
use sensors::capture::CaptureReader;
use sensors::velodyne::{Product, ReturnMode};
use sensors::{Packet, catalogue};
use serde_json::Value;

use crate::support::shared;

const BEGIN_NS: u64 = 1_763_722_223_000_000_000;
const SOURCE: &str = "10.0.0.7:2368";
/// A second unit, whose packets came to the same port.
const OTHER: &str = "10.0.0.9:2368";
/// The calibration of a unit that is not the one that recorded: every beam is raised by so much.
const RAISED_DEG: f64 = 8.0;

fn calibration(model: &str) -> String {
    let mut yaml = "lasers:\n".to_owned();
    for (id, beam) in catalogue::nominal(model).unwrap().beams().iter().enumerate() {
        let vertical_rad = beam.elevation_rad + RAISED_DEG.to_radians();
        yaml += &format!("- {{laser_id: {id}, vert_correction: {vertical_rad}, rot_correction: 0}}\n");
    }
    yaml
}

/// A mount file and the calibration that it names.
fn write_mount(path: &Path, model: &str, calibration: Option<&str>) -> MountFile {
    let [x_m, y_m, z_m, pitch_deg, roll_deg] = [0.0; 5];
    let entry = SensorEntry {
        name: "front".into(),
        model: model.into(),
        x_m,
        y_m,
        z_m,
        pitch_deg,
        roll_deg,
        ..SensorEntry::default()
    };
    let mut file = MountFile::new(vec![entry]);
    file.calibrations =
        calibration.map(|name| [("front".to_owned(), path.parent().unwrap().join(name))].into());
    file.write(path).unwrap();
    MountFile::read(path).unwrap()
}

/// Half a second of a VLP-16 of nominal beams that stands in a room.
fn record(session: &Path, mount: &MountFile) {
    record_from(session, mount, &[SOURCE]);
}

/// The same, each packet from every one of these.
fn record_from(session: &Path, mount: &MountFile, sources: &[&str]) {
    let sources: Vec<SocketAddr> = sources.iter().map(|source| source.parse().unwrap()).collect();
    let source = sources[0];
    let info = SensorInfo { name: "front".into(), source: Some(source.ip()), ..SensorInfo::default() };
    let writer = SessionWriter::create(session, &[info]).unwrap();
    let destination = "10.0.0.100:2368".parse().unwrap();
    spin(BEGIN_NS, |host_time_ns, payload| {
        for source in &sources {
            writer
                .write_packet(
                    0,
                    &Packet { host_time_ns, source: *source, destination, link: Default::default(), payload },
                )
                .unwrap();
        }
    });
    writer.put_mount(mount, &mount.calibration_files().unwrap()).unwrap();
    writer.flush().unwrap();
    writer.close(None).unwrap();
}

/// What the unit sends in half a second.
fn spin(begin_ns: u64, mut take: impl FnMut(u64, &[u8])) {
    let scene = Scene::Box(BoxScene::closed(DVec3::new(-4.0, -3.0, -1.3), DVec3::new(5.0, 3.5, 1.7)));
    let length_ns = 500_000_000;
    let still =
        Trajectory::new(vec![(begin_ns, Pose::IDENTITY), (begin_ns + length_ns, Pose::IDENTITY)]).unwrap();
    let surroundings = Surroundings {
        scene: &scene,
        trajectory: &still,
        body_from_sensor: &|_| Pose::IDENTITY,
        noise_m: 0.0,
        seed: 1,
    };
    MockSensor::velodyne(Product::Vlp16, ReturnMode::Strongest, 10.0)
        .unwrap()
        .run(&surroundings, |host_time_ns, payload| {
            take(host_time_ns, payload);
            Ok::<_, std::io::Error>(())
        })
        .unwrap();
}

fn compare(recording: &Path, more: &[&str]) -> (Value, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_outrigger"));
    command.arg("compare").arg(recording).args(["--json", "--nulls", "0", "--trajectory", "still"]);
    let output = command.args(["--room=-4,-3,-1.3,5,3.5,1.7"]).args(more).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    (crate::support::document(&output.stdout).unwrap_or_default(), said)
}

fn agreeing(document: &Value) -> f64 {
    let rays = &document["rays"]["front"];
    let count = |name: &str| rays[name].as_f64().unwrap_or_else(|| panic!("{document:#}"));
    count("agree") / ["agree", "short", "long", "extra", "drop"].iter().map(|name| count(name)).sum::<f64>()
}

/// Wherever a calibration is named, in the mount file or on the line, of a session or of a capture, it decides.
pub fn a_calibration_counts_wherever_it_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let text = |name: &str| path(name).display().to_string();
    std::fs::create_dir(path("units")).unwrap();
    std::fs::write(path("units/front.yaml"), calibration("vlp-16")).unwrap();
    record(&path("plain"), &write_mount(&path("plain.json"), "vlp-16", None));
    record(&path("named"), &write_mount(&path("named.json"), "vlp-16", Some("units/front.yaml")));

    let kept = Session::open(&path("named")).unwrap();
    assert!(kept.problems().is_empty(), "{:?}", kept.problems());
    let written = std::fs::read_to_string(path("named/mount.json")).unwrap();
    assert!(written.contains("\"calibrations/front.yaml\""), "{written}");
    assert_eq!(
        std::fs::read_to_string(path("named/calibrations/front.yaml")).unwrap(),
        calibration("vlp-16")
    );
    std::fs::rename(path("named"), path("taken-away")).unwrap();

    let nominal = agreeing(&compare(&path("plain"), &[]).0);
    assert!(nominal > 0.99, "{nominal}");
    let (yaml, named) = (text("units/front.yaml"), text("named.json"));
    let by_address = format!("10.0.0.7={yaml}");
    let packets = path("plain/packets.pcapng");
    let raised = agreeing(&compare(&path("taken-away"), &[]).0);
    assert!(raised < 0.95, "{raised}");
    for (recording, more) in [
        (&path("plain"), &["--mount", &named][..]),
        (&path("plain"), &["--calibration", &yaml]),
        (&path("plain"), &["--calibration", &by_address]),
        (&packets, &["--mount", &named]),
        (&packets, &["--mount", &text("plain.json"), "--calibration", &yaml]),
    ] {
        let (document, said) = compare(recording, more);
        let found = agreeing(&document);
        assert!((found - raised).abs() < 1e-9, "{more:?}: {found}, not {raised}: {said}");
    }
    let (_, said) = compare(&path("plain"), &["--calibration", &format!("10.0.0.8={yaml}")]);
    assert!(said.contains("10.0.0.8") && said.contains("calibrations"), "{said}");
    // one of another product is no reason to take the nominal beams without a word
    std::fs::write(path("units/other.yaml"), calibration("hdl-32e")).unwrap();
    for recording in [&path("plain"), &packets] {
        let more = ["--mount", &named, "--calibration", &text("units/other.yaml")];
        let (document, said) = compare(recording, &more);
        assert!(document.is_null() && said.contains("front") && said.contains("32"), "{said}");
    }

    // the corrected mount names the file from where it lies itself
    std::fs::create_dir(path("found")).unwrap();
    let corrected = text("found/mount.json");
    compare(&path("plain"), &["--mount", &named, "--corrected-mount", &corrected]);
    let corrected = MountFile::read(Path::new(&corrected)).unwrap();
    assert_eq!(corrected.calibration_files().unwrap()[0].content, calibration("vlp-16").into_bytes());
}

/// What a session keeps under a sensor's name and another sent is told of, and not taken for the sensor's.
pub fn a_second_unit_under_one_name_is_told_of() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let mount = write_mount(&path("mount.json"), "vlp-16", None);
    record(&path("one"), &mount);
    record_from(&path("two"), &mount, &[SOURCE, OTHER]);
    let (alone, _) = compare(&path("one"), &[]);
    let (document, said) = compare(&path("two"), &[]);
    assert_eq!(document["rays"], alone["rays"], "{said}");
    let said = document["problems"].to_string();
    assert!(said.contains("packets of a second sensor, from 10.0.0.9:2368"), "{document:#}");
}

/// What an HDL-64E says of its beams takes over a second; a session's first revolutions are of these beams too, as a
/// capture's are.
pub fn a_session_of_an_hdl_64e_has_its_beams_from_the_first_frame_on() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let mount = write_mount(&path("mount.json"), "hdl-64e-s2", None);
    let capture = shared("captures/velodyne/synthetic/syn_hdl64e_S2_single_with_calib.pcap");
    let info = SensorInfo { name: "front".into(), ..SensorInfo::default() };
    let writer = SessionWriter::create(&path("session"), &[info]).unwrap();
    let mut reader = CaptureReader::open(&capture).unwrap();
    while let Some(packet) = reader.next().unwrap() {
        writer.write_packet(0, &packet).unwrap();
    }
    writer.put_mount(&mount, &[]).unwrap();
    writer.flush().unwrap();
    writer.close(None).unwrap();
    let mount = path("mount.json").display().to_string();
    let (of_capture, said) = compare(&capture, &["--mount", &mount]);
    assert!(agreeing(&of_capture) >= 0.0, "{said}");
    let (of_session, said) = compare(&path("session"), &[]);
    assert_eq!(of_session["rays"], of_capture["rays"], "{said}");
}

/// A session says so when the mount file names another sensor than that which sent.
pub fn another_sensor_than_the_mount_says_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    record(&path("session"), &write_mount(&path("mount.json"), "vlp-32c", None));
    let (document, said) = compare(&path("session"), &[]);
    assert_eq!(document["faults"][0]["name"], "wrong_model", "{document:#} {said}");
    assert!(agreeing(&document) > 0.99, "compared with the beams of the packets");
    // the same packets as a VLP-16's
    record(&path("lite"), &write_mount(&path("lite.json"), "puck-lite", None));
    let (document, _) = compare(&path("lite"), &[]);
    assert_eq!(document["faults"].as_array().map(Vec::len), Some(0), "{document:#}");
}

/// Two sensors whose clocks are minutes apart were never there at once: no way is made up of them.
pub fn one_way_needs_one_clock() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let named = |name: &str, x_m| SensorEntry {
        name: name.into(),
        model: "vlp-16".into(),
        x_m,
        y_m: 0.0,
        z_m: 0.0,
        pitch_deg: 0.0,
        ..SensorEntry::default()
    };
    let mount = MountFile::new(vec![named("front", 0.0), named("rear", 0.4)]);
    let found = |name: &str, ahead_ns: u64| {
        let info = |name: &str| SensorInfo { name: name.into(), ..SensorInfo::default() };
        let writer = SessionWriter::create(&path(name), &[info("front"), info("rear")]).unwrap();
        let (source, destination) = (SOURCE.parse().unwrap(), "10.0.0.100:2368".parse().unwrap());
        for (sensor, ahead_ns) in [(0, 0), (1, ahead_ns)] {
            spin(BEGIN_NS + ahead_ns, |host_time_ns, payload| {
                writer
                    .write_packet(
                        sensor,
                        &Packet { host_time_ns, source, destination, link: Default::default(), payload },
                    )
                    .unwrap();
            });
        }
        writer.put_mount(&mount, &[]).unwrap();
        writer.close(None).unwrap();
        let mut command = Command::new(env!("CARGO_BIN_EXE_outrigger"));
        let output = command.arg("odometry").arg(path(name)).arg("--json").output().unwrap();
        (output.status.code(), output.stdout.len(), String::from_utf8(output.stderr).unwrap())
    };
    let (code, bytes, said) = found("apart", 471_000_000_000);
    assert_eq!((code, bytes), (Some(1), 0), "{said}");
    assert!(said.contains("rear begins 470.5") && said.contains("after front has ended"), "{said}");
    let (code, bytes, said) = found("together", 0);
    assert!(code == Some(0) && bytes > 0, "{said}");
}
