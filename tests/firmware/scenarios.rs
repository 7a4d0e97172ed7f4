//! What a board must do, one case each.

use std::time::{Duration, Instant};

use firmware_protocol::inject::Inject;
use firmware_protocol::simulated::AxisFault;
use firmware_protocol::{
    ALL_AXES, AckCode, Command, Direction, Fault, Frame, Order, Report, ResetCause, State,
};
use outrigger::base::rng::Rng;
use outrigger::drive::{Link, LinkError, Options, Rig, RigError, SerialLink};
use outrigger::recording::ServoReport;

use super::emulator::{Emulator, MISSING, is_there};
use crate::support::{Case, with_machine};

macro_rules! cases {
    ($($name:ident = $run:ident;)*) => {
        $(pub const $name: Case = with_machine(stringify!($run), MISSING, is_there, $run);)*
    };
}

cases! {
    HELLO = says_who_it_is_and_refuses_other_versions;
    ROUND_TRIPS = answers_two_hundred_questions;
    PAIR_MOVE = moves_the_pair_and_reads_it_back;
    SOFT_LIMIT = refuses_what_lies_outside_its_limits;
    TELEMETRY = tells_positions_fifty_times_a_second;
    JAM = a_jammed_shaft_is_a_stall;
    MOVE_WHILE_FAULTED = a_faulted_rig_refuses_to_move;
    CLEAR_WHILE_JAMMED = a_fault_stays_while_its_cause_does;
    CORRUPTED = two_thousand_damaged_orders_do_nothing;
    FROZEN = a_frozen_board_is_noticed;
    WATCHDOG = a_silent_host_stops_the_rig_on_its_way;
    BROWN_OUT = a_brown_out_loses_the_position;
    KILLED = a_board_that_is_gone_is_a_hang_up;
    SWITCHES = axes_home_on_their_switches;
}

/// Longer than the usual: on a busy machine this program is away from the processor at times.
fn patient() -> Options {
    Options {
        heartbeat_timeout: Duration::from_secs(3),
        link_timeout: Duration::from_secs(3), // the emulator looks for a reopened pty once a second
        answer_within: Duration::from_secs(30),
        settle_within: Duration::from_secs(120),
        ..Options::new_session()
    }
}

fn ready(board: &Emulator) -> Rig {
    let rig = Rig::connect_with(&board.port, patient()).unwrap();
    rig.arm().unwrap();
    rig.home().unwrap();
    rig
}

/// Messages by hand.
struct Talk {
    link: SerialLink,
    sequence: u8,
    heard: Vec<Report>,
}

impl Talk {
    fn to(board: &Emulator) -> Self {
        Self { link: SerialLink::open(&board.port).unwrap(), sequence: 0, heard: Vec::new() }
    }

    fn send(&mut self, command: &Command) {
        let frame = Frame::command(self.sequence, 1, command);
        self.sequence = self.sequence.wrapping_add(1);
        self.link.send(&frame).unwrap();
    }

    /// Hears until something fits; repeats the question.
    fn ask<T>(&mut self, question: &Command, fits: impl Fn(&Report) -> Option<T>) -> T {
        let end = Instant::now() + Duration::from_secs(120);
        while Instant::now() < end {
            self.send(question);
            let repeat = Instant::now() + Duration::from_millis(500);
            while Instant::now() < repeat {
                if let Some(found) = self.hear().and_then(|report| fits(&report)) {
                    return found;
                }
            }
        }
        panic!("no answer to {question:?}");
    }

    fn hear(&mut self) -> Option<Report> {
        let frame = self.link.receive(Duration::from_millis(20)).unwrap()?.frame;
        let report = Report::decode(frame.id.message, frame.data()).unwrap();
        self.heard.push(report);
        Some(report)
    }

    fn hear_for(&mut self, time: Duration) {
        let end = Instant::now() + time;
        while Instant::now() < end {
            self.hear();
        }
    }

    fn order(&mut self, id: u16, order: Order) -> AckCode {
        self.ask(&Command::Order { id, order }, |report| match report {
            Report::Ack { id: theirs, code, .. } if *theirs == id => Some(*code),
            _ => None,
        })
    }

    fn hello(&mut self, heartbeat_timeout_ms: u16) {
        let hello = Command::Hello { protocol_min: 1, protocol_max: 1, heartbeat_timeout_ms, nonce: 99 };
        self.ask(&hello, |report| matches!(report, Report::Info { session: 99, .. }).then_some(()));
    }

    fn position(&mut self, axis: u8) -> i32 {
        self.heard.clear();
        loop {
            self.hear();
            let found = self.heard.iter().rev().find_map(|report| match report {
                Report::Position { axis: theirs, position_urad, .. } if *theirs == axis => {
                    Some(*position_urad)
                }
                _ => None,
            });
            if let Some(found) = found {
                return found;
            }
        }
    }
}

fn says_who_it_is_and_refuses_other_versions() {
    let board = Emulator::start();
    let mut talk = Talk::to(&board);
    let other = Command::Hello { protocol_min: 2, protocol_max: 9, heartbeat_timeout_ms: 3000, nonce: 5 };
    let (protocol, session) = talk.ask(&other, |report| match report {
        Report::Info { protocol, session, .. } => Some((*protocol, *session)),
        _ => None,
    });
    assert_eq!((protocol, session), (1, 0), "a version that is not shared opens no session");
    assert_eq!(talk.order(1, Order::Arm { armed: true }), AckCode::NoSession);
    drop(talk);
    let status = Rig::connect_with(&board.port, patient()).unwrap().status().unwrap();
    assert_eq!((status.uid.as_str(), status.axes.len()), ("4f5554524d505332", 2), "{status:?}");
    assert_eq!(status.reset_cause, "power_on");
}

fn answers_two_hundred_questions() {
    let board = Emulator::start();
    let mut talk = Talk::to(&board);
    let mut times_us = Vec::new();
    for sequence in 0..200u16 {
        let asked = Instant::now();
        talk.ask(&Command::TimeSync { sequence }, |report| match report {
            Report::TimeSync { sequence: theirs, .. } if *theirs == sequence => Some(()),
            _ => None,
        });
        times_us.push(asked.elapsed().as_micros());
    }
    times_us.sort_unstable();
    println!("round trip over pty and emulator: p50 {} us, p99 {} us", times_us[100], times_us[198]);
}

fn moves_the_pair_and_reads_it_back() {
    let board = Emulator::start();
    let rig = ready(&board);
    for pitches in [[0.436, -0.436], [-0.436, 0.436]] {
        let applied = rig.apply(&pitches).unwrap();
        for (axis, wanted) in applied.axes.iter().zip(pitches) {
            assert!((axis.measured_rad - wanted).abs() < 0.3f64.to_radians(), "{axis:?}");
            assert_eq!(axis.source, "measured");
        }
    }
    let status = rig.status().unwrap();
    assert!(status.axes.iter().all(|axis| axis.state == "holding"), "{status:?}");
    assert_eq!(status.damaged, 0);
}

fn refuses_what_lies_outside_its_limits() {
    let board = Emulator::start();
    let rig = ready(&board);
    let outside = rig.apply(&[1.1, 0.0]);
    assert!(
        matches!(outside, Err(RigError::OutsideLimits { axis: 0, limits_of: "the firmware's", .. })),
        "{outside:?}"
    );
    drop(rig);
    // past the host's own check: the board refuses by itself
    let mut talk = Talk::to(&board);
    talk.hello(5000);
    assert_eq!(talk.order(1, Order::Arm { armed: true }), AckCode::Accepted);
    let pair = |a_urad, b_urad| Order::MovePair { a_urad, b_urad };
    assert_eq!(talk.order(2, pair(1_100_000, 0)), AckCode::Limit);
    assert_eq!(talk.order(3, pair(-750_000, 750_000)), AckCode::KeepOut);
    let before = talk.position(0);
    talk.hear_for(Duration::from_millis(300));
    assert!((talk.position(0) - before).abs() < 2000, "it stands where it stood");
}

fn tells_positions_fifty_times_a_second() {
    let board = Emulator::start();
    let mut talk = Talk::to(&board);
    let clock = |talk: &mut Talk, sequence| {
        talk.ask(&Command::TimeSync { sequence }, |report| match report {
            Report::TimeSync { sequence: theirs, device_us } if *theirs == sequence => Some(*device_us),
            _ => None,
        })
    };
    let start_us = clock(&mut talk, 1);
    talk.heard.clear();
    talk.hear_for(Duration::from_secs(2));
    let elapsed_us = clock(&mut talk, 2) - start_us;
    for axis in 0..2 {
        let told = talk
            .heard
            .iter()
            .filter(|report| matches!(report, Report::Position { axis: theirs, .. } if *theirs == axis));
        let wanted = elapsed_us as f64 / 20_000.0;
        let told = told.count() as f64;
        assert!((told - wanted).abs() < 0.05 * wanted + 2.0, "{told} positions in {elapsed_us} us");
    }
    assert_eq!(talk.link.counters().gaps, 0);
}

/// Armed, homed, on its way, and then axis 1 jams; the error that ends the move.
fn jam(board: &Emulator) -> (Talk, u16) {
    let mut talk = Talk::to(board);
    talk.hello(5000);
    assert_eq!(talk.order(1, Order::Arm { armed: true }), AckCode::Accepted);
    assert_eq!(talk.order(2, Order::Home { axis: ALL_AXES }), AckCode::Accepted);
    let heartbeat = Command::Heartbeat { session: 99, time_ms: 0 };
    let homed = |report: &Report| {
        matches!(report, Report::Target { homed: true, state: State::Holding, .. }).then_some(())
    };
    talk.ask(&heartbeat, homed);
    assert_eq!(talk.order(3, Order::MovePair { a_urad: 900_000, b_urad: -900_000 }), AckCode::Accepted);
    talk.hear_for(Duration::from_millis(300));
    let stuck = Inject { axis: 1, fault: Some(AxisFault::Stuck) };
    let frame = Frame::new(200, Direction::ToDevice, 1, &stuck.encode());
    talk.link.send(&frame).unwrap();
    talk.ask(&heartbeat, |report| {
        matches!(report, Report::Fault { fault: Fault::Stall, axis: 1, .. }).then_some(())
    });
    (talk, 3)
}

fn a_jammed_shaft_is_a_stall() {
    let board = Emulator::start();
    let (mut talk, _) = jam(&board);
    talk.hear_for(Duration::from_millis(500)); // the other shaft comes to rest
    let before = [talk.position(0), talk.position(1)];
    assert!(before[0] < 800_000, "it stopped on the way: {before:?}");
    talk.hear_for(Duration::from_millis(500));
    let after = [talk.position(0), talk.position(1)];
    assert!(before.iter().zip(after).all(|(a, b)| (a - b).abs() < 3000), "{before:?} {after:?}");
}

fn a_faulted_rig_refuses_to_move() {
    let board = Emulator::start();
    let (mut talk, id) = jam(&board);
    assert_eq!(talk.order(id + 1, Order::MovePair { a_urad: 0, b_urad: 0 }), AckCode::Fault);
    assert_eq!(talk.order(id + 2, Order::Arm { armed: true }), AckCode::Fault);
}

fn a_fault_stays_while_its_cause_does() {
    let board = Emulator::start();
    let mut talk = Talk::to(&board);
    talk.hello(5000);
    let hot = Inject { axis: 0, fault: Some(AxisFault::Overheat(100)) };
    talk.link.send(&Frame::new(0, Direction::ToDevice, 1, &hot.encode())).unwrap();
    let heartbeat = Command::Heartbeat { session: 99, time_ms: 0 };
    let named = |report: &Report| {
        matches!(report, Report::Fault { fault: Fault::OverTemperature, axis: 0, .. }).then_some(())
    };
    talk.ask(&heartbeat, named);
    let clear = Order::ClearFault { fault: Fault::OverTemperature, key: 0 };
    assert_eq!(talk.order(1, clear), AckCode::CauseRemains);
    let cool = Inject { axis: 0, fault: Some(AxisFault::Overheat(-100)) };
    talk.link.send(&Frame::new(0, Direction::ToDevice, 1, &cool.encode())).unwrap();
    talk.hear_for(Duration::from_secs(2));
    assert_eq!(talk.order(2, clear), AckCode::Accepted);
    // a jammed shaft: its distance from the set point went with the stop, so the fault may be cleared, and the next move
    // finds the jam again
    let board = Emulator::start();
    let (mut talk, id) = jam(&board);
    assert_eq!(talk.order(id + 1, Order::ClearFault { fault: Fault::Stall, key: 0 }), AckCode::Accepted);
    assert_eq!(talk.order(id + 2, Order::Arm { armed: true }), AckCode::Accepted);
    assert_eq!(talk.order(id + 3, Order::MovePair { a_urad: 0, b_urad: 0 }), AckCode::Accepted);
    talk.heard.clear();
    talk.ask(&heartbeat, |report| {
        matches!(report, Report::Fault { fault: Fault::Stall, axis: 1, .. }).then_some(())
    });
}

fn two_thousand_damaged_orders_do_nothing() {
    let board = Emulator::start();
    let mut talk = Talk::to(&board);
    talk.hello(5000);
    assert_eq!(talk.order(1, Order::Arm { armed: true }), AckCode::Accepted);
    assert_eq!(talk.order(2, Order::Home { axis: ALL_AXES }), AckCode::Accepted);
    talk.hear_for(Duration::from_millis(600));
    let before = talk.position(0);
    drop(talk);
    let mut line = serialport::new(board.port.to_string_lossy(), 1_000_000).open_native().unwrap();
    let mut rng = Rng::new(1, 1);
    for number in 0..2000u16 {
        let order = Order::MovePair { a_urad: 400_000, b_urad: -400_000 };
        let frame = Frame::command(number as u8, 1, &Command::Order { id: 100 + number, order });
        let mut bytes = frame.encode().bytes().to_vec();
        // the closing zero stays: a frame that runs into the next one would damage two
        let at = rng.below(bytes.len() as u64 - 1) as usize;
        bytes[at] ^= 1 << rng.below(8);
        let heartbeat = Frame::command(number as u8, 1, &Command::Heartbeat { session: 99, time_ms: 0 });
        for bytes in [&bytes[..], heartbeat.encode().bytes()] {
            let mut sent = 0;
            while sent < bytes.len() {
                match std::io::Write::write(&mut line, &bytes[sent..]) {
                    Ok(count) => sent += count,
                    Err(error) => assert_eq!(error.kind(), std::io::ErrorKind::TimedOut),
                }
            }
        }
        if number % 20 == 0 {
            std::thread::sleep(Duration::from_millis(5)); // what a megabaud line takes
        }
    }
    drop(line);
    let mut talk = Talk::to(&board);
    talk.hear_for(Duration::from_secs(1));
    assert!((talk.position(0) - before).abs() < 2000, "a damaged order moved it");
    let moved = |report: &&Report| {
        matches!(report, Report::Ack { id, .. } if *id >= 100)
            || matches!(report, Report::Target { state: State::Moving, .. })
    };
    assert_eq!(talk.heard.iter().find(moved), None);
    // and a whole one does: the line still works
    assert_eq!(talk.order(3000, Order::MovePair { a_urad: 400_000, b_urad: -400_000 }), AckCode::Accepted);
}

fn a_frozen_board_is_noticed() {
    let mut board = Emulator::start();
    let rig = ready(&board);
    board.control("stop");
    let end = Instant::now() + Duration::from_secs(10);
    let error = loop {
        match rig.status() {
            Err(error) => break error,
            Ok(_) => assert!(Instant::now() < end, "silence goes unnoticed"),
        }
        std::thread::sleep(Duration::from_millis(20));
    };
    assert!(matches!(error, RigError::NoAnswer { what: "heartbeats", .. }), "{error}");
    drop(rig);
    board.control("cont");
    let rig = ready(&board);
    rig.apply(&[0.1, -0.1]).unwrap();
}

fn a_silent_host_stops_the_rig_on_its_way() {
    let board = Emulator::start();
    let mut talk = Talk::to(&board);
    talk.hello(300);
    assert_eq!(talk.order(1, Order::Arm { armed: true }), AckCode::Accepted);
    assert_eq!(talk.order(2, Order::Home { axis: ALL_AXES }), AckCode::Accepted);
    let heartbeat = Command::Heartbeat { session: 99, time_ms: 0 };
    for _ in 0..30 {
        talk.send(&heartbeat);
        talk.hear_for(Duration::from_millis(20));
    }
    let from = talk.position(0);
    talk.send(&heartbeat);
    assert_eq!(talk.order(3, Order::MovePair { a_urad: 1_000_000, b_urad: 0 }), AckCode::Accepted);
    talk.hear_for(Duration::from_millis(1500)); // without a word
    let named = |report: &&Report| matches!(report, Report::Fault { fault: Fault::Watchdog, .. });
    assert!(talk.heard.iter().any(|report| named(&report)), "no watchdog fault");
    let stopped = talk.position(0);
    assert!(stopped > from + 20_000 && stopped < 600_000, "from {from} to {stopped}");
    talk.hear_for(Duration::from_millis(300));
    assert!((talk.position(0) - stopped).abs() < 3000, "it holds");
    assert_eq!(talk.order(4, Order::MovePair { a_urad: 0, b_urad: 0 }), AckCode::Fault);
}

fn a_brown_out_loses_the_position() {
    let mut board = Emulator::start();
    let rig = ready(&board);
    let reports = rig.reports();
    let mut on_the_way = 0;
    let result = rig.apply_with(&[0.9, -0.9], |progress| {
        if on_the_way == 0 && progress.measured_rad[0] > 0.3 {
            on_the_way = 1;
            board.control("system_reset");
        }
    });
    assert!(matches!(result, Err(RigError::Restarted { cause: ResetCause::BrownOut })), "{result:?}");
    let last: ServoReport = reports.try_iter().filter(|report| report.axis == 0).last().unwrap();
    drop(rig);
    let rig = Rig::connect_with(&board.port, patient()).unwrap();
    let status = rig.status().unwrap();
    assert_eq!(status.reset_cause, "brown_out");
    assert!(status.axes.iter().all(|axis| !axis.homed && axis.state == "idle"), "{status:?}");
    let at = status.axes[0].position_deg;
    let was = (f64::from(last.position_urad) * 1e-6).to_degrees();
    assert!((at - was).abs() < 5.0, "the shaft stands where it stood: {was} deg, now {at} deg");
    rig.arm().unwrap();
    let refused = rig.apply(&[0.0, 0.0]);
    assert!(matches!(refused, Err(RigError::Refused { code: AckCode::NotHomed, .. })), "{refused:?}");
    rig.home().unwrap();
    rig.apply(&[0.0, 0.0]).unwrap();
}

fn a_board_that_is_gone_is_a_hang_up() {
    let mut board = Emulator::start();
    let rig = ready(&board);
    board.kill();
    let end = Instant::now() + Duration::from_secs(10);
    let error = loop {
        match rig.status() {
            Err(error) => break error,
            Ok(_) => assert!(Instant::now() < end, "a dead board goes unnoticed"),
        }
    };
    assert!(matches!(error, RigError::Link(LinkError::HungUp { .. })), "{error}");
}

/// The axes stand at +0.03 and -0.02 rad, the encoders say zero, the switches close at -30 degrees.
fn axes_home_on_their_switches() {
    let mut board = Emulator::start_with_switches();
    let rig = Rig::connect_with(&board.port, patient()).unwrap();
    let before = rig.status().unwrap();
    assert!(
        before.homing_moves && before.axes.iter().all(|axis| axis.position_deg.abs() < 0.2),
        "{before:?}"
    );
    rig.arm().unwrap();
    let refused = rig.apply(&[0.1, -0.1]);
    assert!(matches!(refused, Err(RigError::Refused { code: AckCode::NotHomed, .. })), "{refused:?}");
    rig.home().unwrap();
    let homed = rig.status().unwrap();
    assert!(homed.axes.iter().all(|axis| axis.homed && (axis.position_deg + 30.0).abs() < 0.5), "{homed:?}");
    let applied = rig.apply(&[0.2, -0.2]).unwrap();
    assert!((applied.axes[0].measured_rad - 0.2).abs() < 0.006, "{applied:?}");
    drop(rig);
    // a sagging supply loses what was counted, and the angle with it
    board.control("system_reset");
    let rig = Rig::connect_with(&board.port, patient()).unwrap();
    let after = rig.status().unwrap();
    assert!(after.axes.iter().all(|axis| !axis.homed && axis.position_deg.abs() < 0.5), "{after:?}");
}
