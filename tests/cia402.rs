//! CiA 402 drives behind a CAN adapter: what a position unit is, where they may stand, what the adapter refuses, and where a
//! shaft stands whose host is gone.

use std::io::{BufRead as _, BufReader};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use outrigger::drive::{LinkError, Options, Rig, RigError};

use crate::rig::patient;
use crate::support::{Case, case, shared, with_shared};

mod drives;

use drives::{Drive, Drives};

pub const CASES: &[Case] = &[
    case("twelve_degrees_are_twelve_in_any_unit", twelve_degrees_are_twelve_in_any_unit),
    with_shared("drives_of_another_hand_go_to_1200", drives_of_another_hand_go_to_1200),
    case("a_unit_that_contradicts_itself_is_refused", a_unit_that_contradicts_itself_is_refused),
    case("a_shaft_that_goes_too_far_stops_early", a_shaft_that_goes_too_far_stops_early),
    case("a_drive_that_cannot_go_there_is_refused", a_drive_that_cannot_go_there_is_refused),
    case("an_adapter_is_set_to_its_bit_rate", an_adapter_is_set_to_its_bit_rate),
    case("what_an_adapter_refuses_is_named", what_an_adapter_refuses_is_named),
    case("goals_stay_close_to_a_shaft_that_lags", goals_stay_close_to_a_shaft_that_lags),
    case("a_rig_that_was_left_with_torque_is_taken_over", a_rig_that_was_left_with_torque_is_taken_over),
    case("a_shaft_stands_when_its_host_is_killed", a_shaft_stands_when_its_host_is_killed),
];

fn connect(drives: &Drives) -> Result<Rig, RigError> {
    Rig::connect_with(drives.address(), patient())
}

/// What is message instead of connecting.
fn refusal(drives: &Drives) -> String {
    connect(drives).err().expect("refused").to_string()
}

fn ready(drives: &Drives) -> Rig {
    let rig = connect(drives).unwrap();
    rig.arm().unwrap();
    rig.home().unwrap();
    rig
}

fn twelve_degrees_are_twelve_in_any_unit() {
    let feed = |feed, shaft| (0x6092, feed, shaft);
    let turned = Drive::new(&[feed(36_000, 1)], &[(0x607E, 0x80)]);
    let mut witnessed = Drive::new(&[feed(36_000, 1), (0x607D, 0, 0)], &[]);
    witnessed.increments_per_unit = Some(409_600.0 / 36_000.0);
    let mut counts_down = witnessed.clone();
    counts_down.increments_per_unit = Some(-409_600.0 / 36_000.0);
    let cases = [
        ([Drive::usual(), Drive::new(&[], &[])], [1200, -13_653]),
        ([Drive::new(&[feed(409_600, 1)], &[]), Drive::new(&[feed(72_000, 5)], &[])], [13_653, -480]),
        // 0.001 degrees; the older factor
        (
            [Drive::new(&[], &[(0x60A8, 0xFD41_0000)]), Drive::new(&[(0x6093, 409_600, 36_000)], &[])],
            [12_000, -1200],
        ),
        ([turned, witnessed.clone()], [1200, -1200]),
        ([witnessed, counts_down], [1200, -1200]),
    ];
    for (made, wanted) in cases {
        let drives = Drives::start(made);
        let rig = ready(&drives);
        let applied = rig.apply(&[12f64.to_radians(), -12f64.to_radians()]).unwrap();
        let line = drives.line();
        let targets = line.drives.each_ref().map(|drive| drive.target);
        assert!(targets.iter().zip(wanted).all(|(found, wanted)| (found - wanted).abs() <= 1), "{targets:?}");
        assert!((applied.axes[0].measured_rad - 12f64.to_radians()).abs() < 0.001, "{applied:?}");
    }
}

/// The drives of another hand: a script on a pseudo terminal, whose path it prints, and which logs what comes.
fn drives_of_another_hand_go_to_1200() {
    let script = shared("field/scenes/cia402_drive.py");
    let mut drives = Command::new("python3")
        .arg(script)
        .arg(r#"{"nodes":{"1":{"feed":36000,"step":200},"2":{"feed":36000,"step":200}}}"#)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let log = drives.stderr.take().unwrap();
    let log = std::thread::spawn(move || std::io::read_to_string(log).unwrap());
    let mut path = String::new();
    BufReader::new(drives.stdout.take().unwrap()).read_line(&mut path).unwrap();
    let result = Rig::connect_with(format!("cia402:slcan:{}@1,2", path.trim()), patient()).and_then(|rig| {
        rig.arm()?;
        rig.home()?;
        rig.apply(&[12f64.to_radians(), -12f64.to_radians()])
    });
    drives.kill().unwrap();
    drives.wait().unwrap();
    let log = log.join().unwrap();
    result.unwrap_or_else(|error| panic!("{error}\n{log}"));
    for (node, target) in [(1, 1200), (2, -1200)] {
        let last = log.lines().rfind(|line| line.contains(&format!("node {node} target"))).unwrap();
        assert!(last.contains(&format!("target {target} ")), "{last}");
    }
}

/// Drives that count from the last heartbeat of an earlier run.
fn a_rig_that_was_left_with_torque_is_taken_over() {
    let drives = Drives::start([Drive::usual(), Drive::usual()]);
    drop(ready(&drives));
    assert_eq!(drives.line().drives.each_ref().map(|drive| drive.status), [0x0637; 2], "left with torque");
    std::thread::sleep(Duration::from_millis(1200));
    ready(&drives).apply(&[12f64.to_radians(), -12f64.to_radians()]).unwrap();
    assert_eq!(drives.line().drives.each_ref().map(|drive| drive.target), [1200, -1200]);
}

fn a_unit_that_contradicts_itself_is_refused() {
    let feed = |feed, shaft| (0x6092, feed, shaft);
    let refused: [(Drive, &[&str]); 5] = [
        (Drive::new(&[feed(1, 1)], &[]), &["0x6092 = 1/1", "360.000 deg"]),
        (Drive::new(&[feed(360, 1)], &[]), &["0x6092 = 360/1", "1.000 deg"]),
        (Drive::new(&[feed(0, 1)], &[]), &["0x6092 has a 0"]),
        (
            Drive::new(&[feed(36_000, 1)], &[(0x60A8, 0xFD41_0000)]),
            &["36000 units by 0x6092 and 360000 by 0x60a8", "0xfd410000"],
        ),
        (Drive::new(&[feed(36_000, 1)], &[(0x60B0, 500)]), &["0x60b0", "500"]),
    ];
    for (drive, words) in refused {
        let message = refusal(&Drives::start([Drive::usual(), drive]));
        assert!(message.contains("node 2") && words.iter().all(|word| message.contains(word)), "{message}");
    }
}

fn a_shaft_that_goes_too_far_stops_early() {
    let goes = |factor| Drive { factor, ..Drive::usual() };
    // what it calls a unit is an increment, of which a turn has 409600; the other way round
    let increments = Drive { increments_per_unit: Some(1.0), ..Drive::usual() };
    let coarse = Drive { increments_per_unit: Some(11.4), ..Drive::new(&[], &[]) };
    for (drive, by, factor) in [
        (goes(11.0), "by its readings", 11.0),
        (goes(-1.0), "by its readings", -1.0),
        (goes(0.1), "by its readings", 0.1),
        (increments, "0x6063", 36_000.0 / 409_600.0),
        (coarse, "0x6063", 11.4),
    ] {
        let drives = Drives::start([Drive::usual(), drive]);
        let rig = ready(&drives);
        let error = rig.apply(&[12f64.to_radians(), -12f64.to_radians()]).unwrap_err();
        let RigError::Link(LinkError::WrongScale { axis: 1, ordered_deg, moved_deg, .. }) = &error else {
            panic!("{error}")
        };
        let found = moved_deg / ordered_deg;
        assert!((found / factor - 1.0).abs() < 0.3, "{error}");
        assert!(error.to_string().contains(by) && error.to_string().contains("0x6091 = 100/1"), "{error}");
        std::thread::sleep(Duration::from_millis(100));
        let line = drives.line();
        for drive in &line.drives {
            let turns = match drive.increments_per_unit {
                Some(increments) => drive.position * increments / 409_600.0,
                None => drive.position / 36_000.0,
            };
            let went_deg = 360.0 * turns;
            assert!(went_deg.abs() < 2.0, "{went_deg} deg: {error}");
        }
    }
}

fn a_drive_that_cannot_go_there_is_refused() {
    let at = |position: i32| Drive { position: position.into(), ..Drive::usual() };
    let limited = |object, low, high| Drive::new(&[(0x6092, 36_000, 1), (object, low, high)], &[]);
    let refused: [(Drive, &[&str]); 6] = [
        (at(i32::MAX), &["2147483647 units", "0x6064", "18000"]),
        (at(i32::MIN), &["-2147483648 units"]),
        (at(37_200), &["37200 units", "372.000 deg"]),
        (Drive { position: 35_500.0, ..limited(0x607B, 0, 35_999) }, &["35500 units", "0x607b, 0 to 35999"]),
        (limited(0x607D, 500, -500), &["0x607d", "500 to -500", "0 and 0 for none"]),
        (limited(0x607D, 700, 700), &["0x607d", "700 to 700"]),
    ];
    for (drive, words) in refused {
        let message = refusal(&Drives::start([Drive::usual(), drive]));
        assert!(message.contains("node 2") && words.iter().all(|word| message.contains(word)), "{message}");
    }
    // a modulo axis has nothing below its zero, and limits of 0 and 0 are none
    let drives = Drives::start([limited(0x607D, 0, 0), limited(0x607B, 0, 35_999)]);
    let rig = ready(&drives);
    let refused = rig.apply(&[0.0, -0.1]).unwrap_err().to_string();
    assert!(refused.contains("axis 1") && refused.contains("0.000"), "{refused}");
    rig.apply(&[-0.1, 0.1]).unwrap();
}

fn an_adapter_is_set_to_its_bit_rate() {
    let drives = Drives::start([Drive::usual(), Drive::usual()]);
    for (suffix, command) in
        [("", "S8"), ("@1,2", "S8"), ("@500000", "S6"), ("@125000:2,1", "S4"), ("@10000:1,2", "S0")]
    {
        drop(Rig::connect_with(format!("cia402:slcan:{}{suffix}", drives.path), patient()).unwrap());
        let commands = std::mem::take(&mut drives.line().commands);
        assert_eq!(commands, ["C", command, "O"], "{suffix}");
    }
    // a rig's own messages: nobody answers here
    let hasty = Options { answer_within: Duration::from_millis(50), ..Options::new_session() };
    Rig::connect_with(format!("slcan:{}@250000", drives.path), hasty).err().expect("no rig");
    assert_eq!(drives.line().commands[..3], ["C", "S5", "O"]);
    for (address, words) in [
        (format!("slcan:{}@300000", drives.path), ["`300000`", "250000, 500000"]),
        (format!("cia402:slcan:{}@12:1,2", drives.path), ["`12`", "1000000"]),
        ("cia402:can0@500000:1,2".to_owned(), ["bit rate 500000", "ip link set can0"]),
        (format!("cia402:slcan:{}@500000:1,1", drives.path), ["two different nodes", "BITRATE"]),
    ] {
        let message = Rig::connect(&address).err().expect("refused").to_string();
        assert!(words.iter().all(|word| message.contains(word)), "{address}: {message}");
    }
}

fn what_an_adapter_refuses_is_named() {
    for (letter, words) in [
        ("S", ["`S8`", "1000000 bit/s"]),
        ("O", ["`O`", "open the channel"]),
        ("t", ["in a row", "bit rate"]),
    ] {
        let drives = Drives::behind([Drive::usual(), Drive::usual()], letter);
        let message = refusal(&drives);
        assert!(message.contains("BEL") && words.iter().all(|word| message.contains(word)), "{message}");
    }
    // a channel that was closed cannot be closed
    drop(connect(&Drives::behind([Drive::usual(), Drive::usual()], "C")).unwrap());
    let drives = Drives::start([Drive::usual(), Drive::usual()]);
    let rig = connect(&drives).unwrap();
    drives.line().refuses = "t";
    let end = Instant::now() + Duration::from_secs(10);
    let error = loop {
        match rig.status() {
            Err(error) => break error,
            Ok(_) => assert!(Instant::now() < end, "refused messages go unnoticed"),
        }
        std::thread::sleep(Duration::from_millis(5));
    };
    assert!(matches!(error, RigError::Link(LinkError::AdapterRefused { .. })), "{error}");
}

fn goals_stay_close_to_a_shaft_that_lags() {
    let drives = Drives::start([Drive { speed: 1000.0, ..Drive::usual() }, Drive::usual()]);
    let error = ready(&drives).apply(&[50f64.to_radians(), -50f64.to_radians()]).unwrap_err();
    assert!(error.to_string().contains("following_error"), "{error}");
    let widest_deg = drives.line().drives[0].widest / 100.0;
    assert!((3.0..6.0).contains(&widest_deg), "{widest_deg} deg");
}

fn a_shaft_stands_when_its_host_is_killed() {
    // a busy machine may end the host by a fault before it is killed: then again
    assert!((0..5).any(|_| kills_a_host_on_its_way()), "no host was on its way");
}

/// Whether the host was on its way when it was killed.
fn kills_a_host_on_its_way() -> bool {
    // a little slower than its set points
    let slow = Drive { speed: 2800.0, ..Drive::usual() };
    let drives = Drives::start([slow.clone(), slow]);
    let mut host = Command::new(env!("CARGO_BIN_EXE_outrigger"))
        .args(["rig", "set", "50", "-50", "--home", "--arm", "--port", &drives.address()])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let end = Instant::now() + Duration::from_secs(60);
    while drives.line().drives[0].position < 2500.0 && Instant::now() < end {
        if host.try_wait().unwrap().is_some() {
            return false;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    if host.try_wait().unwrap().is_some() {
        return false;
    }
    host.kill().unwrap();
    host.wait().unwrap();
    let killed = drives.line().drives.clone();
    std::thread::sleep(Duration::from_secs(2));
    let later = drives.line().drives.clone();
    for (killed, later) in killed.iter().zip(&later) {
        let is_on_the_way = (2000.0..4900.0).contains(&killed.position.abs());
        assert!(is_on_the_way, "killed at {} units", killed.position);
        let went_deg = (later.position - killed.position).abs() / 100.0;
        assert!(went_deg <= 10.0, "{went_deg} deg after the host was gone");
        assert_eq!(later.position, f64::from(later.target), "stands");
        // a drive that watches its host brakes before that, and holds
        let told = [(0x6007, 0), (0x605A, 0), (0x1016, 1)].map(|(index, sub)| later.object(index, sub));
        assert_eq!(told, [Some(3), Some(6), Some(127 << 16 | 1000)]);
    }
    true
}
