//! What a recording says without a trajectory: the verdict and the tilt that the true trajectory gives, over many walks through
//! the furnished house. Minutes, so it runs only when asked for.

use std::convert::Infallible;
use std::net::SocketAddr;
use std::path::Path;
use std::process::Command;

use outrigger::base::rng::Rng;
use outrigger::mock::sensor::{MockSensor, Surroundings};
use outrigger::rig::{MountFile, MountedSensor, SensorEntry};
use outrigger::world::scene::Scene;
use outrigger::world::trajectory::Trajectory;
use sensors::Packet;
use sensors::capture::PcapWriter;
use sensors::velodyne::{Product, ReturnMode};
use serde_json::Value;

use super::align::{pair, scene, walks, wander};
use crate::support::shared;

const SECONDS: u64 = 15;
const RANGE_SD_M: f64 = 0.02;

/// A capture of both sensors on a walk, the first tilted by this much more than the mount file says.
fn record(folder: &Path, scene: &Scene, truth: &Trajectory, seed: u64, tilt_deg: f64) {
    let mut packets: Vec<(u64, usize, Vec<u8>)> = Vec::new();
    for (number, sensor) in pair().iter().enumerate() {
        let mut mount = sensor.mount;
        mount.pitch_rad += if number == 0 { tilt_deg.to_radians() } else { 0.0 };
        let body_from_sensor = mount.body_from_sensor();
        let surroundings = Surroundings {
            scene,
            trajectory: truth,
            body_from_sensor: &|_| body_from_sensor,
            noise_m: RANGE_SD_M,
            seed: 2 * seed + number as u64,
        };
        let mut keep = |time_ns, payload: &[u8]| {
            packets.push((time_ns, number, payload.to_vec()));
            Ok::<(), Infallible>(())
        };
        let mut mock = MockSensor::velodyne(Product::Vlp16, ReturnMode::Strongest, 10.0).unwrap();
        mock.run(&surroundings, &mut keep).unwrap();
    }
    packets.sort_by_key(|(time_ns, number, _)| (*time_ns, *number));
    let mut capture = PcapWriter::new(Vec::new()).unwrap();
    for (host_time_ns, number, payload) in &packets {
        let source: SocketAddr = format!("192.168.1.{}:2368", 201 + number).parse().unwrap();
        let destination: SocketAddr = "192.168.1.100:2368".parse().unwrap();
        let (host_time_ns, link) = (*host_time_ns, Default::default());
        capture.write(&Packet { host_time_ns, source, destination, link, payload }).unwrap();
    }
    std::fs::write(folder.join("walk.pcap"), capture.close().unwrap()).unwrap();
}

fn compared(folder: &Path, more: &[&str]) -> Value {
    let output = Command::new(env!("CARGO_BIN_EXE_outrigger"))
        .current_dir(folder)
        .args(["compare", "walk.pcap", "--json", "--mount", "mount.json", "--scene"])
        .arg(shared("scenes/house.ply"))
        .args(more)
        .output()
        .unwrap();
    crate::support::document(&output.stdout)
        .unwrap_or_else(|_| panic!("{more:?}: {}", String::from_utf8_lossy(&output.stderr)))
}

/// Two degrees come out as two and none as none, and the verdict is that of the true trajectory.
pub fn a_recording_alone_says_what_its_true_trajectory_says() {
    let scene = scene("house");
    let (mut wrong, mut within) = (Vec::new(), 0);
    for seed in 0..walks() {
        let truth = wander(&scene, &mut Rng::new(seed, 8), SECONDS);
        for tilt_deg in [0.0, 2.0] {
            let folder = tempfile::tempdir().unwrap();
            let folder = folder.path();
            record(folder, &scene, &truth, seed, tilt_deg);
            std::fs::write(folder.join("truth.tum"), truth.to_tum()).unwrap();
            let entry = |sensor: MountedSensor| SensorEntry {
                name: sensor.name,
                model: sensor.model.name,
                x_m: sensor.mount.x_m,
                z_m: sensor.mount.z_m,
                pitch_deg: sensor.mount.pitch_rad.to_degrees(),
                ..SensorEntry::default()
            };
            let mounts = MountFile::new(pair().into_iter().map(entry).collect());
            mounts.write(&folder.join("mount.json")).unwrap();
            let [alone, by_truth] = [compared(folder, &[]), compared(folder, &["--trajectory", "truth.tum"])];
            let figure = |name: &str| alone["relative_tilt"][name].as_f64().unwrap_or(f64::NAN);
            let (found_deg, u95_deg) = (figure("error_deg"), figure("u95_deg"));
            let by_truth_deg = by_truth["relative_tilt"]["error_deg"].as_f64().unwrap_or(f64::NAN);
            let off_deg = (found_deg - tilt_deg).abs();
            println!(
                "{seed}, {tilt_deg}: {found_deg:.3} +- {u95_deg:.3} deg ({by_truth_deg:.3}), {} {} (with the trajectory {} {}), {}",
                alone["verdict"],
                alone["reason"]["code"],
                by_truth["verdict"],
                by_truth["reason"]["code"],
                alone["alignment"]["answer"]
            );
            within += usize::from(off_deg <= u95_deg);
            // an interval of 95 % leaves one in twenty outside
            let is_right = off_deg <= f64::max(2.0 * u95_deg, 0.02) && off_deg < 0.1;
            if !is_right || alone["verdict"] != by_truth["verdict"] {
                wrong.push(format!("{seed}, {tilt_deg}: {:#} {:#}", alone["reason"], alone["words"]));
            }
        }
    }
    println!("{within} of {} within the 95 % interval", 2 * walks());
    assert!(wrong.is_empty(), "{wrong:?}");
}
