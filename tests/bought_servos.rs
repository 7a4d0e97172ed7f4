//! Servos without firmware of ours, behind a pty: this program drives them itself.

use std::time::{Duration, Instant};

use firmware_protocol::AckCode;
use firmware_protocol::simulated::AxisFault;
use outrigger::drive::{Rig, RigError};
use outrigger::mock::dynamixel::MockDynamixel;

use crate::rig::patient;
use crate::support::{Case, case};

pub const CASES: &[Case] = &[
    case("they_are_a_rig_too", they_are_a_rig_too),
    case("what_shuts_down_is_a_fault", what_shuts_down_is_a_fault),
];

fn they_are_a_rig_too() {
    let mock = MockDynamixel::start(14).unwrap();
    // which of them is axis 0 is a matter of wiring
    let other = MockDynamixel::start(14).unwrap();
    let crossed =
        Rig::connect_with(format!("dynamixel:{}@57600:2,1", other.path().display()), patient()).unwrap();
    let begins = crossed.status().unwrap();
    for (axis, wanted_rad) in begins.axes.iter().zip([0.1f64, 0.05]) {
        let (source, position_deg) = (axis.source.as_str(), axis.position_deg);
        assert!(source == "measured" && (position_deg - wanted_rad.to_degrees()).abs() < 0.3, "{begins:?}");
    }
    crossed.arm().unwrap();
    drop((crossed, other));
    let address = format!("dynamixel:{}@1000000:1,2", mock.path().display());
    let rig = Rig::connect_with(&address, patient()).unwrap();
    let start = rig.status().unwrap();
    assert!((start.axes[1].position_deg - 0.1f64.to_degrees()).abs() < 0.3, "{start:?}");
    let refused = rig.apply(&[0.2, 0.2]);
    assert!(matches!(refused, Err(RigError::Refused { code: AckCode::NotArmed, .. })), "{refused:?}");
    rig.arm().unwrap();
    rig.home().unwrap();
    for pitches in [[0.2, -0.15], [-0.1, 0.1]] {
        let applied = rig.apply(&pitches).unwrap();
        for (axis, wanted) in applied.axes.iter().zip(pitches) {
            assert!((axis.measured_rad - wanted).abs() < 0.3f64.to_radians(), "{axis:?}");
        }
    }
    let status = rig.status().unwrap();
    assert_eq!((status.axes[0].state.as_str(), status.damaged), ("holding", 0));
    // the other end goes away
    drop(mock);
    let end = Instant::now() + Duration::from_secs(5);
    let error = loop {
        match rig.status() {
            Err(error) => break error,
            Ok(_) => assert!(Instant::now() < end, "servos that are gone go unnoticed"),
        }
        std::thread::sleep(Duration::from_millis(5));
    };
    assert!(error.to_string().starts_with("rig cable: "), "{error}");
    let absent = MockDynamixel::start(14).unwrap();
    let nobody = Rig::connect(format!("dynamixel:{}@57600:1,9", absent.path().display())).err().unwrap();
    assert!(nobody.to_string().contains("servo 9") && nobody.to_string().contains("no answer"), "{nobody}");
    let typo = Rig::connect("dynamixel:/dev/null@fast").err().unwrap();
    assert!(typo.to_string().contains("dynamixel:PATH@BAUD:ID,ID"), "{typo}");
}

fn what_shuts_down_is_a_fault() {
    // a stuck shaft draws current at once: whichever rule finds it first
    let cases: [(AxisFault, &[&str]); 3] = [
        (AxisFault::TorqueLost, &["torque_lost"]),
        (AxisFault::EncoderInvalid, &["encoder_invalid"]),
        (AxisFault::Stuck, &["stall", "over_current"]),
    ];
    for (broken, names) in cases {
        let mock = MockDynamixel::start(15).unwrap();
        let rig = Rig::connect_with(format!("dynamixel:{}", mock.path().display()), patient()).unwrap();
        rig.arm().unwrap();
        rig.home().unwrap();
        let mut broke = false;
        let result = rig.apply_with(&[0.9, -0.9], |progress| {
            if !broke && progress.measured_rad[1] < 0.0 {
                broke = true;
                mock.inject(1, broken);
            }
        });
        let Err(RigError::Fault { faults, axis: Some(1) }) = &result else {
            panic!("{broken:?}: {result:?}")
        };
        assert!(faults.iter().any(|fault| names.contains(&fault.as_str())), "{broken:?}: {faults:?}");
    }
}
