//! The state machine on the simulated axis: each fault by name, and invariants under anything that may come.

use std::vec;
use std::vec::Vec;

use super::Controller;
use crate::command::CLEAR_KEY;
use crate::config::Home;
use crate::simulated::{AxisFault, SimulatedAxis};
use crate::{
    ALL_AXES, AckCode, Command, Config, Fault, HalfPlane, KeepOut, Limit, Order, Report, ResetCause, State,
};

pub(super) const SESSION: u32 = 77;
/// B - A may not exceed this, µrad.
pub(super) const APART_URAD: i64 = 1_200_000;

fn config() -> Config<2> {
    let keep_out = KeepOut::inside(&[HalfPlane { a: -1, b: 1, c: APART_URAD }]).unwrap();
    Config { keep_out, ..Config::default() }
}

pub(super) struct Bench {
    pub(super) controller: Controller<SimulatedAxis, 2>,
    pub(super) now_us: u64,
    reports: Vec<Report>,
    pub(super) id: u16,
    pub(super) feeds: bool,
}

impl Bench {
    pub(super) fn new(seed: u64) -> Self {
        let axes = [SimulatedAxis::new(seed, 30_000, 0), SimulatedAxis::new(seed + 1, -20_000, 0)];
        let controller = Controller::new(config(), axes, ResetCause::PowerOn, 0);
        Self { controller, now_us: 0, reports: vec![], id: 0, feeds: true }
    }

    /// Armed and homed.
    fn ready(seed: u64) -> Self {
        let mut bench = Self::new(seed);
        bench.run(50);
        bench.hello();
        assert_eq!(bench.order(Order::Arm { armed: true }), AckCode::Accepted);
        assert_eq!(bench.order(Order::Home { axis: ALL_AXES }), AckCode::Accepted);
        bench.run(600);
        assert_eq!(bench.controller.state(), State::Holding);
        bench
    }

    pub(super) fn hello(&mut self) {
        self.tell(Command::Hello {
            protocol_min: 1,
            protocol_max: 3,
            heartbeat_timeout_ms: 300,
            nonce: SESSION,
        });
    }

    pub(super) fn tell(&mut self, command: Command) {
        let Self { controller, now_us, reports, .. } = self;
        controller.handle(*now_us, &command, &mut |report| reports.push(report));
    }

    pub(super) fn order(&mut self, order: Order) -> AckCode {
        self.id += 1;
        self.order_as(self.id, order)
    }

    fn order_as(&mut self, id: u16, order: Order) -> AckCode {
        self.tell(Command::Order { id, order });
        match self.reports.iter().rev().find(|report| matches!(report, Report::Ack { .. })) {
            Some(Report::Ack { id: theirs, code, .. }) if *theirs == id => *code,
            other => panic!("no acknowledgement: {other:?}"),
        }
    }

    pub(super) fn step(&mut self, elapsed_us: u64) {
        self.now_us += elapsed_us;
        if self.feeds {
            self.tell(Command::Heartbeat { session: SESSION, time_ms: 0 });
        }
        let Self { controller, now_us, reports, .. } = self;
        controller.step(*now_us, &mut |report| reports.push(report));
    }

    fn run(&mut self, ms: u64) {
        (0..ms).for_each(|_| self.step(1000));
    }

    pub(super) fn inject(&mut self, axis: usize, fault: AxisFault) {
        self.controller.servo_mut(axis).unwrap().inject(fault);
    }

    pub(super) fn at(&mut self) -> [i32; 2] {
        [0, 1].map(|axis| self.controller.servo_mut(axis).unwrap().true_position_urad())
    }

    fn pair(&mut self, a_urad: i32, b_urad: i32) -> AckCode {
        self.order(Order::MovePair { a_urad, b_urad })
    }
}

fn near(a: i32, b: i32) -> bool {
    (a - b).abs() < 5236
}

#[test]
fn moves_a_pair_and_says_done() {
    let mut bench = Bench::ready(1);
    assert_eq!(bench.pair(436_332, -436_332), AckCode::Accepted);
    assert_eq!(bench.pair(0, 0), AckCode::Busy);
    bench.run(1500);
    assert_eq!(bench.controller.state(), State::Holding);
    let [a, b] = bench.at();
    assert!(near(a, 436_332) && near(b, -436_332), "{a} {b}");
    assert!(bench.reports.iter().any(|report| matches!(report, Report::Done { error_urad: 0..=5236, .. })));
}

#[test]
fn the_same_order_again_changes_nothing_and_an_old_one_is_refused() {
    let mut bench = Bench::ready(2);
    let pair = Order::MovePair { a_urad: 100_000, b_urad: 100_000 };
    let id = bench.id + 1;
    assert_eq!(bench.order_as(id, pair), AckCode::Accepted);
    bench.run(10);
    assert_eq!(bench.order_as(id, pair), AckCode::Accepted);
    bench.run(2000);
    bench.id = id;
    assert_eq!(bench.pair(0, 0), AckCode::Accepted);
    bench.run(2000);
    // a repeat that was late: answered from memory, not done
    assert_eq!(bench.order_as(id, pair), AckCode::Accepted);
    assert_eq!(
        bench.order_as(id.wrapping_sub(20), Order::MoveTo { axis: 0, position_urad: 9 }),
        AckCode::Outdated
    );
    bench.run(1000);
    assert!(near(bench.at()[0], 0));
}

#[test]
fn refuses_by_reason() {
    let mut bench = Bench::new(3);
    bench.run(50);
    assert_eq!(bench.order(Order::Arm { armed: true }), AckCode::NoSession);
    bench.hello();
    assert_eq!(bench.pair(0, 0), AckCode::NotArmed);
    assert_eq!(bench.order(Order::Arm { armed: true }), AckCode::Accepted);
    assert_eq!(bench.pair(0, 0), AckCode::NotHomed);
    let set = Order::SetLimit { axis: 0, limit: Limit::Maximum, value: 900_000 };
    assert_eq!(bench.order(set), AckCode::Busy);
    assert_eq!(bench.order(Order::Home { axis: 7 }), AckCode::BadArgument);
    assert_eq!(bench.order(Order::Home { axis: ALL_AXES }), AckCode::Accepted);
    bench.run(600);
    assert_eq!(bench.pair(1_100_000, 0), AckCode::Limit);
    assert_eq!(bench.pair(-700_000, 700_000), AckCode::KeepOut);
    bench.controller.servo_mut(1).unwrap().range_urad = (-400_000, 400_000);
    assert_eq!(bench.pair(0, -500_000), AckCode::ServoLimit);
    assert_eq!(bench.order(Order::MoveTo { axis: 2, position_urad: 0 }), AckCode::BadArgument);
    let profile = |speed_mrad_s| Order::Profile { axis: 0, speed_mrad_s, acceleration_mrad_s2: 1000 };
    assert_eq!(bench.order(profile(0)), AckCode::BadArgument);
    assert_eq!(bench.order(profile(600)), AckCode::Limit);
    assert_eq!(bench.order(profile(100)), AckCode::Accepted);
    assert_eq!(bench.order(Order::Arm { armed: false }), AckCode::Accepted);
    bench.run(5);
    assert_eq!(bench.order(set), AckCode::Accepted);
    let silly = Order::SetLimit { axis: 0, limit: Limit::Minimum, value: 950_000 };
    assert_eq!(bench.order(silly), AckCode::BadArgument);
}

#[test]
fn a_version_that_is_not_shared_opens_no_session() {
    let mut bench = Bench::new(4);
    bench.run(50);
    bench.tell(Command::Hello { protocol_min: 2, protocol_max: 9, heartbeat_timeout_ms: 300, nonce: 5 });
    assert!(
        bench.reports.iter().any(|report| matches!(report, Report::Info { session: 0, protocol: 1, .. }))
    );
    assert_eq!(bench.order(Order::Arm { armed: true }), AckCode::NoSession);
}

/// Every fault of the plant, while moving: latched under its own name within a second, motion refused, standing still,
/// cleared after repair and not before.
#[test]
fn every_axis_fault_is_found_by_name() {
    let cases = [
        (AxisFault::Stuck, Fault::Stall),
        (AxisFault::Slow(10), Fault::FollowingError),
        (AxisFault::EncoderJump(150_000), Fault::EncoderJump),
        (AxisFault::EncoderFreeze, Fault::Stall),
        (AxisFault::EncoderInvalid, Fault::EncoderInvalid),
        (AxisFault::Overheat(200), Fault::OverTemperature),
        (AxisFault::UnderVoltage(8000), Fault::UnderVoltage),
        (AxisFault::TorqueLost, Fault::TorqueLost),
    ];
    for (broken, expected) in cases {
        let mut bench = Bench::ready(5);
        assert_eq!(bench.pair(500_000, -500_000), AckCode::Accepted);
        bench.run(300);
        bench.inject(1, broken);
        bench.run(900);
        assert!(bench.controller.faults().contains(expected), "{broken:?}: {:?}", bench.controller.faults());
        assert_eq!(bench.controller.state(), State::Fault);
        assert!(!bench.controller.armed());
        let named =
            |report: &Report| matches!(report, Report::Fault { fault, axis: 1, .. } if *fault == expected);
        assert!(bench.reports.iter().any(named), "{broken:?}");
        assert_eq!(bench.pair(0, 0), AckCode::Fault);
        assert_eq!(bench.order(Order::Arm { armed: true }), AckCode::Fault);
        bench.run(500);
        let before = bench.at();
        bench.run(500);
        if broken != AxisFault::TorqueLost {
            assert!(
                (0..2).all(|axis| (bench.at()[axis] - before[axis]).abs() < 1000),
                "{broken:?} keeps moving"
            );
        }
        let persists = matches!(
            broken,
            AxisFault::EncoderInvalid
                | AxisFault::Overheat(_)
                | AxisFault::UnderVoltage(_)
                | AxisFault::TorqueLost
        );
        let clear = Order::ClearFault { fault: expected, key: 0 };
        if persists {
            assert_eq!(bench.order(clear), AckCode::CauseRemains, "{broken:?}");
        }
        let axis = bench.controller.servo_mut(1).unwrap();
        axis.repair(1500);
        axis.inject(AxisFault::Overheat(-200));
        bench.run(1500);
        for fault in Fault::ALL {
            assert_eq!(
                bench.order(Order::ClearFault { fault, key: 0 }),
                AckCode::Accepted,
                "{broken:?} {fault:?}"
            );
        }
        assert_eq!(bench.controller.state(), State::Idle, "{broken:?}");
        assert!(!bench.controller.armed());
    }
}

#[test]
fn a_silent_host_is_a_watchdog_fault_that_stops_the_move() {
    let mut bench = Bench::ready(6);
    assert_eq!(bench.pair(800_000, -100_000), AckCode::Accepted);
    bench.run(300);
    bench.feeds = false;
    bench.run(1200);
    assert!(bench.controller.faults().contains(Fault::Watchdog));
    let [a, b] = bench.at();
    assert!(a < 600_000, "{a}");
    // still on the straight line between start and target
    let along = f64::from(a - 30_000) / 770_000.0;
    assert!((f64::from(b + 20_000) - along * -80_000.0).abs() < 6000.0, "{a} {b}");
    let clear = Order::ClearFault { fault: Fault::Watchdog, key: 0 };
    assert_eq!(bench.order(clear), AckCode::CauseRemains);
    bench.feeds = true;
    bench.run(50);
    assert_eq!(bench.order(clear), AckCode::Accepted);
}

/// 150 ms at 30 degrees a second and the braking distance: 6.5 degrees, and what the shaft lags behind.
#[test]
fn a_pair_with_a_silent_host_stops_within_ten_degrees_and_goes_on_when_it_is_back() {
    let mut bench = Bench::ready(6);
    assert_eq!(bench.pair(1_000_000, -150_000), AckCode::Accepted);
    bench.run(800);
    let before = bench.at()[0];
    bench.feeds = false;
    bench.run(290);
    let later = bench.at()[0];
    assert!(bench.controller.faults().is_empty(), "the agreed 300 ms are not over");
    assert!((f64::from(later - before) * 1e-6).to_degrees() < 8.0, "{before} {later}");
    assert_eq!(bench.controller.state(), State::Moving);
    bench.feeds = true;
    bench.run(3000);
    let [a, b] = bench.at();
    assert!(near(a, 1_000_000) && near(b, -150_000), "{a} {b}");
    assert_eq!((bench.controller.state(), bench.controller.armed()), (State::Holding, true));
    // one that stays away is a fault where the pair stands
    assert_eq!(bench.pair(0, 0), AckCode::Accepted);
    bench.run(800);
    let before = bench.at()[0];
    bench.feeds = false;
    bench.run(2000);
    let moved_deg = (f64::from(before - bench.at()[0]) * 1e-6).to_degrees();
    assert!((3.0..9.0).contains(&moved_deg), "{moved_deg} degrees");
    assert_eq!((bench.controller.state(), bench.controller.armed()), (State::Fault, false));
}

#[test]
fn an_emergency_stop_needs_key_and_switch() {
    let mut bench = Bench::ready(7);
    assert_eq!(bench.pair(800_000, 0), AckCode::Accepted);
    bench.run(500);
    let before = bench.at()[0];
    assert_eq!(bench.order(Order::EStop), AckCode::Accepted);
    bench.run(300);
    assert_eq!(bench.controller.state(), State::EStop);
    assert!(
        bench.at()[0] - before < 40_000,
        "stops from 0.5 rad/s with 10 rad/s2 in 14 mrad and what it lags"
    );
    let clear = |key| Order::ClearFault { fault: Fault::EStop, key };
    assert_eq!(bench.order(clear(0)), AckCode::Locked);
    bench.controller.set_local_switch(false);
    assert_eq!(bench.order(clear(CLEAR_KEY)), AckCode::Locked);
    bench.controller.set_local_switch(true);
    assert_eq!(bench.order(clear(CLEAR_KEY)), AckCode::Accepted);
    assert_eq!(bench.pair(0, 0), AckCode::NotArmed);
    bench.controller.set_local_switch(false);
    bench.run(1);
    assert_eq!(bench.controller.state(), State::EStop);
}

#[test]
fn hold_stays_armed_and_stop_disarms() {
    let mut bench = Bench::ready(8);
    assert_eq!(bench.pair(900_000, 0), AckCode::Accepted);
    bench.run(400);
    assert_eq!(bench.order(Order::Hold), AckCode::Accepted);
    bench.run(600);
    assert_eq!((bench.controller.state(), bench.controller.armed()), (State::Holding, true));
    assert!(bench.at()[0] < 500_000);
    assert_eq!(bench.pair(-900_000, 0), AckCode::Accepted);
    bench.run(400);
    assert_eq!(bench.order(Order::Stop { deceleration_mrad_s2: 5000 }), AckCode::Accepted);
    bench.run(400);
    assert_eq!((bench.controller.state(), bench.controller.armed()), (State::Idle, false));
}

#[test]
fn another_host_finds_a_disarmed_rig() {
    let mut bench = Bench::ready(9);
    bench.tell(Command::Hello { protocol_min: 1, protocol_max: 1, heartbeat_timeout_ms: 300, nonce: 9 });
    bench.run(10);
    assert_eq!((bench.controller.state(), bench.controller.armed()), (State::Idle, false));
}

/// A pair with encoders that count from where they were switched on, with switches at -30 degrees.
fn switched(start_urad: [i32; 2]) -> Bench {
    const AT_URAD: i32 = -523_599;
    let mut config = config();
    for axis in &mut config.axes {
        axis.home = Home::switch_below(AT_URAD);
    }
    let axes = [0, 1]
        .map(|axis| SimulatedAxis::new(axis as u64 + 1, start_urad[axis], 0).counting_from_start(AT_URAD));
    let mut bench = Bench::new(1);
    bench.controller = Controller::new(config, axes, ResetCause::BrownOut, 0);
    bench.run(50);
    bench.hello();
    assert_eq!(bench.order(Order::Arm { armed: true }), AckCode::Accepted);
    bench
}

#[test]
fn an_axis_without_an_absolute_encoder_homes_on_its_switch() {
    // the second one stands behind its switch already, and first goes away from it
    let mut bench = switched([200_000, -600_000]);
    assert_eq!(bench.pair(0, 0), AckCode::NotHomed);
    assert_eq!(bench.order(Order::Home { axis: ALL_AXES }), AckCode::Accepted);
    bench.run(3000);
    assert_eq!(bench.controller.state(), State::Homing);
    assert!((bench.at()[1] + 600_000).abs() < 3000, "the second axis waits for the first");
    bench.run(9000);
    assert_eq!(bench.controller.state(), State::Holding, "{:?}", bench.controller.faults());
    assert_eq!(bench.pair(300_000, -300_000), AckCode::Accepted);
    bench.run(3000);
    // the switch is read once a millisecond while the shaft goes 0.1 mrad in it, and the gears have play
    let [a, b] = bench.at();
    assert!((a - 300_000).abs() < 6000 && (b + 300_000).abs() < 6000, "{a} {b}");
    assert_eq!(bench.pair(1_040_000, 0), AckCode::Accepted, "limits are those of the homed angle");
}

#[test]
fn a_rig_that_still_brakes_from_seeking_takes_no_move() {
    let mut bench = switched([200_000, 100_000]);
    assert_eq!(bench.order(Order::Home { axis: ALL_AXES }), AckCode::Accepted);
    bench.run(20_000);
    assert_eq!(bench.pair(300_000, 300_000), AckCode::Accepted);
    bench.run(5000);
    assert_eq!(bench.order(Order::Home { axis: ALL_AXES }), AckCode::Accepted);
    bench.run(300);
    assert_eq!(bench.order(Order::Hold), AckCode::Accepted);
    assert_eq!((bench.controller.state(), bench.pair(0, 0)), (State::Holding, AckCode::Busy));
    bench.run(1000);
    assert_eq!(bench.pair(0, 0), AckCode::Accepted);
}

/// A host that pairs the last angle it received with "homed" must not have one that counts from elsewhere.
#[test]
fn an_angle_of_the_new_zero_is_reported_before_homed_is() {
    let mut bench = switched([200_000, -600_000]);
    assert_eq!(bench.order(Order::Home { axis: ALL_AXES }), AckCode::Accepted);
    let (mut angles, mut homed) = ([None; 2], [false; 2]);
    while bench.controller.state() == State::Homing {
        bench.reports.clear();
        bench.step(1000);
        let at = bench.at();
        for report in &bench.reports {
            match *report {
                Report::Position { axis, position_urad, .. } => {
                    angles[usize::from(axis)] = Some(position_urad)
                }
                Report::Target { axis, homed: is_homed, .. } => homed[usize::from(axis)] = is_homed,
                Report::Done { .. } => homed = [true; 2],
                _ => {}
            }
            for axis in (0..2).filter(|axis| homed[*axis]) {
                let angle = angles[axis].unwrap_or(i32::MAX);
                assert!(
                    (angle - at[axis]).abs() < 10_000,
                    "axis {axis} at {}: {angle} was reported",
                    at[axis]
                );
            }
        }
    }
    assert_eq!((bench.controller.state(), homed), (State::Holding, [true; 2]));
}

#[test]
fn a_switch_that_never_closes_is_a_fault() {
    let mut bench = switched([200_000, 0]);
    bench.controller.servo_mut(0).unwrap().home_switch_urad = Some(-3_000_000);
    assert_eq!(bench.order(Order::Home { axis: 0 }), AckCode::Accepted);
    bench.run(20_000);
    assert!(!bench.controller.faults().is_empty());
    assert_eq!(bench.controller.state(), State::Fault);
    let before = bench.at()[0];
    bench.run(1000);
    assert!((bench.at()[0] - before).abs() < 3000, "it stands");
    assert!(!bench.controller.armed());
}

#[test]
fn homing_on_a_switch_stops_on_command() {
    let mut bench = switched([200_000, 0]);
    assert_eq!(bench.order(Order::Home { axis: 0 }), AckCode::Accepted);
    bench.run(1000);
    assert_eq!(bench.order(Order::Hold), AckCode::Accepted);
    bench.run(500);
    let before = bench.at()[0];
    bench.run(1000);
    assert!((bench.at()[0] - before).abs() < 3000);
    assert_eq!(bench.pair(0, 0), AckCode::NotHomed);
}
