//! Servos without firmware of ours, behind a pty: this program drives them itself.

use std::time::{Duration, Instant};

use firmware_protocol::AckCode;
use firmware_protocol::simulated::AxisFault;
use outrigger::drive::{Rig, RigError};
use outrigger::mock::bus_servos::{Lateness, Make, MockServos};

use crate::rig::patient;
use crate::support::{Case, case};

pub const CASES: &[Case] = &[
    case("they_are_a_rig_too", they_are_a_rig_too),
    case("what_shuts_down_is_a_fault", what_shuts_down_is_a_fault),
    case(
        "a_servo_that_no_goal_reaches_is_refused_when_opened",
        a_servo_that_no_goal_reaches_is_refused_when_opened,
    ),
    case("a_late_answer_is_not_mistaken_for_another", a_late_answer_is_not_mistaken_for_another),
    case("a_rig_with_some_late_answers_arrives", a_rig_with_some_late_answers_arrives),
    case("no_goal_is_far_from_the_shaft", no_goal_is_far_from_the_shaft),
    case("the_shaft_stops_soon_when_the_host_is_killed", the_shaft_stops_soon_when_the_host_is_killed),
    case("torque_that_is_on_already_is_watched_too", torque_that_is_on_already_is_watched_too),
    case(
        "a_servo_that_answers_no_writes_is_driven_or_named",
        a_servo_that_answers_no_writes_is_driven_or_named,
    ),
    case("a_servo_for_five_volts_is_no_fault_at_five", a_servo_for_five_volts_is_no_fault_at_five),
    case(
        "a_position_beyond_the_turn_is_a_fault_that_says_so",
        a_position_beyond_the_turn_is_a_fault_that_says_so,
    ),
];

const MAKES: [(Make, &str, u16); 2] = [(Make::Dynamixel, "dynamixel", 132), (Make::Feetech, "feetech", 56)];

/// A busy machine may keep a mock from its work for longer than a rig waits for an encoder: such a run says nothing, and is
/// repeated. What is wrong each time fails.
fn unless_starved(run: impl Fn() -> Result<(), RigError>) {
    for attempt in 1.. {
        let Err(error) = run() else { return };
        let text = error.to_string();
        let signs = ["encoder_invalid", "torque_lost", "no answer"];
        assert!(attempt < 5 && signs.iter().any(|sign| text.contains(sign)), "{text}");
        println!("attempt {attempt}: {text}");
    }
}

fn address(name: &str, mock: &MockServos) -> String {
    format!("{name}:{}@1000000:1,2", mock.path().display())
}

fn they_are_a_rig_too() {
    let mock = MockServos::start(Make::Dynamixel, 14).unwrap();
    // which of them is axis 0 is a matter of wiring
    let other = MockServos::start(Make::Dynamixel, 14).unwrap();
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
    let absent = MockServos::start(Make::Dynamixel, 14).unwrap();
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
        let mock = MockServos::start(Make::Dynamixel, 15).unwrap();
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

/// Nothing was written before, so nothing turned.
fn a_servo_that_no_goal_reaches_is_refused_when_opened() {
    let middle = [2048, 2100];
    /// Make, positions, register, its value, words of the refusal.
    type Refused = (Make, [i32; 2], u16, &'static [u8], &'static [&'static str]);
    let cases: [Refused; 19] = [
        (
            Make::Feetech,
            [2048, 5000],
            18,
            &[124],
            &["register 18 (phase) is 124", "expected 108", "set it to 108"],
        ),
        (Make::Feetech, middle, 18, &[28], &["register 18 (phase) is 28", "expected 12"]),
        (Make::Feetech, [2048, 5000], 18, &[108], &["register 56 (present position) is 5000", "0 to 4095"]),
        (Make::Feetech, [2048, -100], 18, &[108], &["register 56 (present position) is -100", "register 31"]),
        (Make::Feetech, middle, 9, &[0, 0, 0, 0], &["registers 9 and 11", "are 0 and 0", "count turns"]),
        (Make::Feetech, middle, 9, &[0, 9, 0, 12], &["register 56", "is 2100, expected 2304 to 3072"]),
        (Make::Feetech, middle, 33, &[1], &["register 33 (operating mode) is 1", "expected 0 (position)"]),
        (Make::Feetech, middle, 30, &[3], &["register 30 (angular resolution) is 3", "expected 1"]),
        (Make::Feetech, middle, 3, &[4, 5], &["register 3 (model) is 1284", "777 STS3215", "SCS0009"]),
        (
            Make::Dynamixel,
            middle,
            11,
            &[4],
            &["register 11 (operating mode) is 4", "expected 3", "set it to 3"],
        ),
        (Make::Dynamixel, middle, 11, &[1], &["register 11 (operating mode) is 1", "expected 3"]),
        (Make::Dynamixel, middle, 10, &[2], &["register 10 (drive mode) is 2", "bit 1 (slave"]),
        (
            Make::Dynamixel,
            [2048, 5000],
            11,
            &[3],
            &["register 132 (present position) is 5000", "register 20"],
        ),
        (Make::Dynamixel, [2048, -1], 11, &[5], &["register 132 (present position) is -1", "0 to 4095"]),
        (Make::Dynamixel, middle, 48, &[0, 8, 0, 0], &["register 132", "is 2100, expected 0 to 2048"]),
        (Make::Dynamixel, middle, 48, &[0, 32, 0, 0], &["registers 52 and 48", "are 0 and 8192"]),
        (Make::Dynamixel, middle, 0, &[94, 1], &["register 0 (model number) is 350", "1060 XL430-W250"]),
        (
            Make::Dynamixel,
            middle,
            68,
            &[1],
            &["register 68 (status return level)", "is 1, expected 2", "set it to 2"],
        ),
        (
            Make::Dynamixel,
            middle,
            68,
            &[0],
            &["register 68 (status return level)", "is 0, expected 2", "XM430-W350"],
        ),
    ];
    for (make, positions, register, values, words) in cases {
        let mock = MockServos::start_at(make, 3, positions).unwrap();
        mock.set(1, register, values);
        let name = if make == Make::Feetech { "feetech" } else { "dynamixel" };
        let error = Rig::connect(address(name, &mock)).err().expect("refused").to_string();
        for word in ["servo 2"].iter().chain(words) {
            assert!(error.contains(word), "{make:?} register {register} {values:?}: no `{word}` in: {error}");
        }
        assert!((0..2).all(|servo| mock.goals(servo).is_empty()), "a goal before it was refused: {error}");
    }
}

/// Answers of 44 to 58 ms: limits of 60 degrees were read as -60 and -180.
fn a_late_answer_is_not_mistaken_for_another() {
    let registers = [&[0, 10, 32, 48, 64, 68, 126][..], &[3, 40, 56]];
    std::thread::scope(|scope| {
        for ((make, name, _), registers) in MAKES.into_iter().zip(registers) {
            scope.spawn(move || {
                for late in registers.iter().map(|register| Some(*register)).chain([None]) {
                    for in_order in [true, false] {
                        let lateness = Lateness { address: late, delay_ms: (44, 58), in_order, every: 1 };
                        unless_starved(|| limits_are_read_right(make, name, lateness));
                    }
                }
            });
        }
    });
}

fn limits_are_read_right(make: Make, name: &str, lateness: Lateness) -> Result<(), RigError> {
    let mock = MockServos::start_at(make, 5, [1700, 2400]).unwrap();
    for (servo, low, high) in [(0, 1600u16, 2500u16), (1, 1650, 2600)] {
        let [low, high] = [low, high].map(u16::to_le_bytes);
        match make {
            Make::Feetech => mock.set(servo, 9, &[low, high].concat()),
            Make::Dynamixel => mock.set(servo, 48, &[high[0], high[1], 0, 0, low[0], low[1], 0, 0]),
        }
    }
    mock.delay(lateness);
    let status = Rig::connect_with(address(name, &mock), patient())?.status()?;
    let deg = |counts: f64| (counts - 2048.0) * 360.0 / 4096.0;
    let wanted = [(1700.0, [1600.0, 2500.0]), (2400.0, [1650.0, 2600.0])];
    for (axis, (position, limits)) in status.axes.iter().zip(wanted) {
        assert!((axis.position_deg - deg(position)).abs() < 0.5, "{make:?} {lateness:?}: {axis:?}");
        for (found, wanted) in axis.limits_deg.iter().zip(limits.map(deg)) {
            assert!((found - wanted).abs() < 0.01, "{make:?} {lateness:?}: {axis:?}");
        }
    }
    Ok(())
}

/// Connects, arms and homes.
fn ready(name: &str, mock: &MockServos) -> Result<Rig, RigError> {
    let rig = Rig::connect_with(address(name, mock), patient())?;
    rig.arm()?;
    rig.home()?;
    Ok(rig)
}

fn arrives(rig: &Rig, pitches: [f64; 2]) -> Result<(), RigError> {
    let applied = rig.apply(&pitches)?;
    for (axis, wanted) in applied.axes.iter().zip(pitches) {
        assert!((axis.measured_rad - wanted).abs() < 0.3f64.to_radians(), "{axis:?}");
    }
    Ok(())
}

fn a_rig_with_some_late_answers_arrives() {
    for (make, name, measured) in [(Make::Dynamixel, "dynamixel", 126), (Make::Feetech, "feetech", 56)] {
        unless_starved(|| {
            let mock = MockServos::start(make, 6).unwrap();
            let rig = ready(name, &mock)?;
            mock.delay(Lateness { address: Some(measured), delay_ms: (44, 58), in_order: true, every: 23 });
            arrives(&rig, [0.3, -0.3])?;
            goals_are_near(&mock, name);
            Ok(())
        });
    }
}

/// The first goal is where the shaft stands, and none is more than 7 degrees (80 counts) beyond it: what it moves between a
/// reading and a goal brings it nearer.
fn goals_are_near(mock: &MockServos, what: &str) {
    for servo in 0..2 {
        let goals = mock.goals(servo);
        assert!(!goals.is_empty(), "{what}: no goal");
        for goal in goals {
            let allowed = if goal.torque { 80 + 4 } else { 2 };
            assert!((goal.goal - goal.position).abs() <= allowed, "{what}, servo {servo}: {goal:?}");
        }
    }
}

fn no_goal_is_far_from_the_shaft() {
    for (make, name, _) in MAKES {
        for broken in [AxisFault::Stuck, AxisFault::Slow(5)] {
            unless_starved(|| {
                let mock = MockServos::start(make, 7).unwrap();
                let rig = ready(name, &mock)?;
                let mut broke = false;
                let result = rig.apply_with(&[0.9, -0.9], |progress| {
                    if !broke && progress.measured_rad[1] < -0.1 {
                        broke = true;
                        mock.inject(1, broken);
                    }
                });
                assert!(matches!(result, Err(RigError::Fault { .. })), "{name} {broken:?}: {result:?}");
                goals_are_near(&mock, name);
                Ok(())
            });
        }
    }
}

fn the_shaft_stops_soon_when_the_host_is_killed() {
    for (make, name, register) in MAKES {
        unless_starved(|| {
            let mock = MockServos::start(make, 8).unwrap();
            let position = || {
                let bytes = mock.get(0, (register, 2));
                i32::from(u16::from_le_bytes([bytes[0], bytes[1]]))
            };
            kill_on_the_way(&address(name, &mock), || position() > 2048 + 228)?;
            let killed_at = position();
            std::thread::sleep(Duration::from_millis(1500));
            let stands_at = position();
            println!("{name}: killed at {killed_at}, stands at {stands_at} counts");
            assert!((stands_at - killed_at).abs() <= 114, "{name}: from {killed_at} to {stands_at} counts");
            assert!(stands_at < 2048 + 500, "{name}: it was not on its way when the host died");
            goals_are_near(&mock, name);
            if make == Make::Dynamixel {
                assert_eq!(mock.get(0, (98, 1)), [255], "the bus watchdog has bitten");
            }
            Ok(())
        });
    }
}

/// Moves to 50 degrees with the program itself, which is killed once a shaft is on its way.
fn kill_on_the_way(port: &str, is_on_its_way: impl Fn() -> bool) -> Result<(), RigError> {
    let mut host = std::process::Command::new(env!("CARGO_BIN_EXE_outrigger"))
        .args(["rig", "set", "50", "-50", "--home", "--arm", "--port", port])
        .stdout(std::process::Stdio::null())
        .spawn()
        .unwrap();
    while !is_on_its_way() {
        if host.try_wait().unwrap().is_some() {
            return Err(RigError::Fault { faults: vec!["encoder_invalid, or another".into()], axis: None });
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    host.kill().unwrap();
    host.wait().unwrap();
    Ok(())
}

/// Torque stays on when a program ends. The next one says anew where the shaft stands, and sets the watchdog again.
fn torque_that_is_on_already_is_watched_too() {
    for (make, name, _) in MAKES {
        unless_starved(|| {
            let mock = MockServos::start(make, 9).unwrap();
            for pitches in [[0.2, -0.2], [-0.1, 0.1]] {
                let rig = ready(name, &mock)?;
                arrives(&rig, pitches)?;
                if make == Make::Dynamixel {
                    assert_eq!([mock.get(0, (98, 1)), mock.get(1, (98, 1))], [[25], [25]], "{pitches:?}");
                }
            }
            if make == Make::Dynamixel {
                assert_eq!(mock.get(0, (98, 1)), [0], "a program that ends in peace leaves no watchdog");
            }
            goals_are_near(&mock, name);
            Ok(())
        });
    }
}

fn a_servo_that_answers_no_writes_is_driven_or_named() {
    unless_starved(|| {
        let mock = MockServos::start(Make::Feetech, 10).unwrap();
        mock.set(0, 8, &[0]);
        arrives(&ready("feetech", &mock)?, [0.2, -0.2])
    });
    unless_starved(|| {
        let mock = MockServos::start(Make::Dynamixel, 10).unwrap();
        let rig = Rig::connect_with(address("dynamixel", &mock), patient())?;
        mock.set(1, 68, &[1]);
        let said = wait_for_error(&rig, 1)?;
        assert!(said.contains("register 68 (status return level) was set to 1, expected 2"), "{said}");
        Ok(())
    });
}

/// What a servo says of its own errors, once it says something.
fn wait_for_error(rig: &Rig, axis: usize) -> Result<String, RigError> {
    let end = Instant::now() + Duration::from_secs(10);
    loop {
        let status = rig.status()?;
        if !status.axes[axis].device_errors.is_empty() {
            return Ok(status.axes[axis].device_errors.join("; "));
        }
        assert!(Instant::now() < end, "no error: {status:?}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

fn a_servo_for_five_volts_is_no_fault_at_five() {
    for (make, name, register, [five, twelve]) in [
        (Make::Dynamixel, "dynamixel", 32, [&[70u8, 0, 35, 0][..], &[160, 0, 95, 0]]),
        (Make::Feetech, "feetech", 14, [&[70, 35], &[140, 40]]),
    ] {
        unless_starved(|| {
            let mock = MockServos::start(make, 11).unwrap();
            for servo in 0..2 {
                mock.set(servo, register, five);
                mock.inject(servo, AxisFault::UnderVoltage(5000));
            }
            let rig = Rig::connect_with(address(name, &mock), patient())?;
            rig.arm()?;
            let status = rig.status()?;
            let axis = &status.axes[0];
            assert_eq!((axis.supply_mv, axis.faults.len()), (Some(5000), 0), "{name}: {status:?}");
            drop(rig);
            mock.set(0, register, twelve);
            let rig = Rig::connect_with(address(name, &mock), patient())?;
            let end = Instant::now() + Duration::from_secs(10);
            while !rig.status()?.axes[0].faults.contains(&"under_voltage".to_owned()) {
                assert!(Instant::now() < end, "{name}: a 12 V servo at 5 V");
                std::thread::sleep(Duration::from_millis(20));
            }
            Ok(())
        });
    }
}

fn a_position_beyond_the_turn_is_a_fault_that_says_so() {
    for (make, name, register) in MAKES {
        unless_starved(|| {
            let mock = MockServos::start(make, 12).unwrap();
            let rig = Rig::connect_with(address(name, &mock), patient())?;
            mock.inject(0, AxisFault::EncoderJump(4_000_000));
            let said = wait_for_error(&rig, 0)?;
            assert!(said.contains(&format!("register {register} (present position) is 46")), "{said}");
            assert!(said.contains("outside its turn (0 to 4095)"), "{said}");
            let refused = rig.arm();
            assert!(refused.is_err() && mock.goals(0).is_empty(), "{refused:?}");
            Ok(())
        });
    }
}
