//! The rig: the mock device behind a pty and behind a damaged line, driven as the program drives it.

use std::time::{Duration, Instant};

use outrigger::mock::rig::{Damage, MockConfig, MockFault, MockRig, SimulatedLink};
use outrigger::servo::{Options, Rig, RigController, RigError};

use crate::support::{Case, case};

pub const CASES: &[Case] = &[
    case(
        "a_pair_of_pitches_is_applied_over_a_pty_and_read_back",
        a_pair_of_pitches_is_applied_over_a_pty_and_read_back,
    ),
    case("a_whole_conversation_in_simulated_time", a_whole_conversation_in_simulated_time),
];

const NO_DAMAGE: Damage = Damage { share: 0.0, longest_delay_us: 0 };

fn a_pair_of_pitches_is_applied_over_a_pty_and_read_back() {
    let mock = MockRig::start(MockConfig::default(), 1).unwrap();
    let rig = Rig::connect(mock.path()).unwrap();
    let reports = rig.reports();
    let refused = rig.apply(&[0.1, -0.1]);
    assert!(matches!(refused, Err(RigError::Refused { .. })), "{refused:?}");
    rig.arm().unwrap();
    rig.home().unwrap();
    let pitches = [0.2f64, -0.2];
    let applied = rig.apply(&pitches).unwrap();
    for (axis, wanted) in applied.axes.iter().zip(pitches) {
        assert!((axis.measured_rad - wanted).abs() < 0.3f64.to_radians(), "{axis:?}");
        assert_eq!(axis.source, "measured");
    }
    let status = rig.status().unwrap();
    assert!(status.axes.iter().all(|axis| axis.state == "holding" && axis.faults.is_empty()), "{status:?}");
    let heard: Vec<_> = reports.try_iter().collect();
    assert!(
        heard.iter().any(|report| report.state == "moving") && heard.len() > 20,
        "{} reports",
        heard.len()
    );
    mock.close();
    let start = Instant::now();
    let error = loop {
        match rig.status() {
            Err(error) => break error,
            Ok(_) => assert!(start.elapsed() < Duration::from_secs(5), "the cut cable goes unnoticed"),
        }
        std::thread::sleep(Duration::from_millis(5));
    };
    assert!(error.to_string().starts_with("rig cable: "), "{error}");
    assert!(reports.into_iter().count() < 1000, "the channel closes");
}

fn a_whole_conversation_in_simulated_time() {
    let link = SimulatedLink::new(MockConfig::default(), 1, NO_DAMAGE);
    let mut rig = RigController::connect(link, Options::default()).unwrap();
    rig.arm().unwrap();
    rig.home().unwrap();
    let applied = rig.apply(&[0.4, -0.4], |_| {}).unwrap();
    eprintln!("{applied:?}");
    let _ = MockFault::Reboot;
}
