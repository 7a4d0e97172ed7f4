//! Trouble with the rig, which is homed and moved in between.

use std::os::unix::fs::symlink;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use firmware_protocol::simulated::AxisFault;
use outrigger::base::rng::Rng;
use outrigger::mock::rig::{MockConfig, MockFault, MockRig};
use serde_json::Value;

use super::sensors_lane::pause;
use super::watch::{PATIENCE, Watch, has, problems, said};

/// A mock rig under a name that stays when it is plugged in anew.
pub struct Bench {
    name: PathBuf,
    rig: Option<MockRig>,
}

impl Bench {
    pub fn plug(name: PathBuf) -> Self {
        let mut bench = Self { name, rig: None };
        bench.plug_again();
        bench
    }

    fn plug_again(&mut self) {
        self.rig = None;
        let rig = MockRig::start(MockConfig::default(), 3).unwrap();
        let _ = std::fs::remove_file(&self.name); // the first time there is none
        symlink(rig.path(), &self.name).unwrap();
        self.rig = Some(rig);
    }

    fn inject(&self, fault: MockFault) {
        self.rig.as_ref().unwrap().inject(fault);
    }
}

/// Armed, homed, at two angles, and nothing wrong with it. A fault may still strike while that is done (a motor that is
/// hot, a host too busy for its heartbeat): then it is begun again.
fn make_ready(watch: &Watch, after: &str, rng: &mut Rng) {
    let order = |path: &str, body: &str| {
        let (code, answer) = watch.daemon().post(path, body);
        (code == 200).then_some(()).ok_or(format!("{path}: {code} {answer}"))
    };
    let attempt = |rng: &mut Rng| {
        order("/api/v1/rig/clear", "")?;
        order("/api/v1/rig/arm", "")?;
        order("/api/v1/rig/home", "")?;
        order("/api/v1/rig/apply", &angles(rng))?;
        let status = watch.fresh();
        // these angles are not the mount's, and a recording may be under way
        if problems(&status).any(|(about, kind)| about == "rig" && kind != "off_mount") {
            Err(said(&status))
        } else {
            Ok(())
        }
    };
    let (begun, mut refusals) = (Instant::now(), Vec::new());
    while let Err(words) = attempt(rng) {
        refusals.push(format!("{:.1} s: {words}", begun.elapsed().as_secs_f64()));
        if begun.elapsed() > PATIENCE {
            return watch.log.fail(format!("the rig does not come back after {after:?}: {refusals:#?}"));
        }
        std::thread::sleep(Duration::from_millis(500));
    }
}

fn angles(rng: &mut Rng) -> String {
    let [first, second] = [(); 2].map(|()| rng.between(-40.0, 40.0));
    format!("{{\"pitches_deg\": [{first:.2}, {second:.2}]}}")
}

/// Whether the state names one of these problems of the rig.
fn is_named(status: &Value, kinds: &[&str]) -> bool {
    kinds.iter().any(|kind| has(status, "rig", kind))
}

pub fn lane(watch: &Watch, bench: &mut Bench, seed: u64) {
    let mut rng = Rng::new(seed, 13);
    make_ready(watch, "start", &mut rng);
    while watch.goes_on() {
        pause(&mut rng, [1.0, 8.0]);
        let axis = rng.below(2) as usize;
        let single: [(&str, AxisFault, &[&str]); 6] = [
            ("encoder invalid", AxisFault::EncoderInvalid, &["rig_fault"]),
            ("supply sags", AxisFault::UnderVoltage(8000), &["rig_fault"]),
            // by 10 °C a second: what it heats up beyond its limit until it is repaired cools again by 1 °C a second
            ("overheated", AxisFault::Overheat(10), &["rig_fault"]),
            ("torque lost", AxisFault::TorqueLost, &["rig_fault", "off_target"]),
            ("stuck", AxisFault::Stuck, &["rig_fault", "off_target"]),
            ("encoder frozen", AxisFault::EncoderFreeze, &["rig_fault", "off_target", "stale"]),
        ];
        let after = match rng.below(10) {
            number @ 0..6 => {
                let (name, fault, kinds) = single[number as usize];
                bench.inject(MockFault::Axis(axis, fault));
                if matches!(fault, AxisFault::Stuck | AxisFault::EncoderFreeze | AxisFault::TorqueLost) {
                    // these show when it moves: an axis that does not obey is an answer too
                    let _ = watch.daemon().post("/api/v1/rig/apply", "{\"pitches_deg\": [41.5, 41.5]}");
                }
                watch.explained(name, "rig", |status| is_named(status, kinds));
                bench.inject(MockFault::Repair(axis));
                name
            }
            6 => {
                bench.inject(MockFault::HangUp);
                watch.explained("unplugged", "rig", |status| is_named(status, &["rig_lost"]));
                bench.plug_again();
                watch.wait("the rig is plugged in again", |status| status["rig"]["connected"] == true);
                "unplugged"
            }
            7 => {
                bench.inject(MockFault::Reboot);
                watch.explained("reboot", "rig", |status| is_named(status, &["not_homed", "rig_lost"]));
                watch.wait("it is found again", |status| status["rig"]["connected"] == true);
                "reboot"
            }
            8 => {
                bench.inject(MockFault::WrongId(true));
                watch.explained("another node", "rig", |status| is_named(status, &["rig_lost", "stale"]));
                bench.inject(MockFault::WrongId(false));
                watch.wait("its own node again", |status| status["rig"]["connected"] == true);
                "another node"
            }
            _ => {
                bench.inject(MockFault::Switch { closed: false });
                watch.explained("e-stop", "rig", |status| is_named(status, &["e_stop"]));
                bench.inject(MockFault::Switch { closed: true });
                "e-stop"
            }
        };
        make_ready(watch, after, &mut rng);
    }
}
