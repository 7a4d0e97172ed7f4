//! Every rule at its edge: what is just allowed, what is just too much, and when a cause counts as gone.

use std::vec;
use std::vec::Vec;

use super::sampling_tests::IdealServo;
use super::watch::is_jump;
use super::{Axis, Controller};
use crate::command::CLEAR_KEY;
use crate::config::Home;
use crate::servo::{Reading, Sense, Setpoint};
use crate::{
    ALL_AXES, AckCode, AxisConfig, Command, Config, Fault, HalfPlane, KeepOut, Order, Report, ResetCause,
    State,
};

/// Servos that do as the test says, and a clock that goes on by a millisecond a step.
pub(super) struct Rig<const N: usize> {
    pub(super) controller: Controller<IdealServo, N>,
    pub(super) now_us: u64,
    pub(super) id: u16,
    pub(super) reports: Vec<Report>,
}

pub(super) const HOST: u32 = 5;

pub(super) fn hello(nonce: u32) -> Command {
    Command::Hello { protocol_min: 1, protocol_max: 1, heartbeat_timeout_ms: 1000, nonce }
}

impl<const N: usize> Rig<N> {
    pub(super) fn new(config: Config<N>, reading: Reading) -> Self {
        let sense = Sense { reading, supply_mv: 12_000, ..Sense::UNREAD };
        let servos = [IdealServo { sense, setpoint: Setpoint::default() }; N];
        let controller = Controller::new(config, servos, ResetCause::Software, 0);
        Self { controller, now_us: 0, id: 0, reports: vec![] }
    }

    /// Armed, homed and holding at zero.
    pub(super) fn ready(config: Config<N>) -> Self {
        let mut rig = Self::new(config, Reading::Measured(0));
        rig.run(2);
        rig.tell(hello(HOST));
        assert_eq!(rig.order(Order::Arm { armed: true }), AckCode::Accepted);
        assert_eq!(rig.order(Order::Home { axis: ALL_AXES }), AckCode::Accepted);
        rig.run(310);
        assert_eq!(rig.controller.state(), State::Holding);
        rig
    }

    pub(super) fn tell(&mut self, command: Command) {
        let Self { controller, now_us, reports, .. } = self;
        controller.handle(*now_us, &command, &mut |report| reports.push(report));
    }

    pub(super) fn answer(&mut self, id: u16, order: Order) -> (AckCode, i32) {
        self.tell(Command::Order { id, order });
        match self.reports.last() {
            Some(Report::Ack { id: theirs, code, detail, .. }) if *theirs == id => (*code, *detail),
            other => panic!("no acknowledgement: {other:?}"),
        }
    }

    pub(super) fn order(&mut self, order: Order) -> AckCode {
        self.id += 1;
        self.answer(self.id, order).0
    }

    pub(super) fn sense(&mut self, axis: usize) -> &mut Sense {
        &mut self.controller.servo_mut(axis).unwrap().sense
    }

    pub(super) fn setpoint(&mut self, axis: usize) -> Setpoint {
        self.controller.servo_mut(axis).unwrap().setpoint
    }

    /// One step; torque as ordered, readings of this moment.
    pub(super) fn step(&mut self) {
        for axis in 0..N {
            self.sense(axis).torque = self.setpoint(axis).torque;
        }
        self.step_as_is();
    }

    pub(super) fn step_as_is(&mut self) {
        self.now_us += 1000;
        let now_us = self.now_us;
        self.tell(Command::Heartbeat { session: HOST, time_ms: 0 });
        (0..N).for_each(|axis| self.sense(axis).sampled_us = [now_us; 2]);
        let Self { controller, reports, .. } = self;
        controller.step(now_us, &mut |report| reports.push(report));
    }

    pub(super) fn run(&mut self, ms: u64) {
        (0..ms).for_each(|_| self.step());
    }

    /// Follows its set points without a lag.
    pub(super) fn follow(&mut self, ms: u64) {
        for _ in 0..ms {
            for axis in 0..N {
                self.sense(axis).reading = Reading::Measured(self.setpoint(axis).position_urad);
            }
            self.step();
        }
    }

    fn clear(&mut self, fault: Fault) -> AckCode {
        self.order(Order::ClearFault { fault, key: CLEAR_KEY })
    }

    /// Steps until there is a fault, and its report.
    pub(super) fn fault_after(&mut self, longest_ms: u64) -> Option<(u64, Fault, i32)> {
        for ms in 1..=longest_ms {
            self.reports.clear();
            self.step();
            if let Some(Report::Fault { fault, detail, .. }) =
                self.reports.iter().find(|report| matches!(report, Report::Fault { .. }))
            {
                return Some((ms, *fault, *detail));
            }
        }
        None
    }
}

/// Wide limits, so that one rule at a time is met.
fn axis() -> AxisConfig {
    AxisConfig { jump_urad: 1_000_000, stall_urad: 500_000, following_urad: 500_000, ..AxisConfig::default() }
}

fn ready(axis: AxisConfig) -> Rig<1> {
    Rig::ready(Config { axes: [axis], ..Config::default() })
}

/// A rule at its edge: no fault while `allowed`, and after `ms` of `broken` the fault with its detail, which cannot be
/// cleared before the cause is gone.
fn edge(
    axis: AxisConfig,
    allowed: fn(&mut Sense),
    broken: fn(&mut Sense),
    ms: u64,
    fault: Fault,
    detail: i32,
) {
    let mut rig = ready(axis);
    allowed(rig.sense(0));
    assert_eq!(rig.fault_after(400), None, "{fault:?}");
    broken(rig.sense(0));
    assert_eq!(rig.fault_after(400), Some((ms, fault, detail)));
    assert_eq!(rig.controller.state(), State::Fault);
    // where nothing may push against what stopped it, the set point is where the shaft is: nothing of the cause is left
    if fault != Fault::FollowingError && fault != Fault::Stall {
        assert_eq!(rig.clear(fault), AckCode::CauseRemains);
        allowed(rig.sense(0));
    }
    rig.run(1);
    assert_eq!((rig.clear(fault), rig.controller.state()), (AckCode::Accepted, State::Idle));
}

#[test]
fn each_rule_has_its_edge_and_its_patience() {
    let warm = |sense: &mut Sense| sense.temperature_c = 70;
    edge(axis(), warm, |sense| sense.temperature_c = 71, 1, Fault::OverTemperature, 71);
    let low = |sense: &mut Sense| sense.supply_mv = 10_500;
    edge(axis(), low, |sense| sense.supply_mv = 10_499, 22, Fault::UnderVoltage, 10_499);
    let much = |sense: &mut Sense| sense.current_ma = 1500;
    edge(axis(), much, |sense| sense.current_ma = 1501, 102, Fault::OverCurrent, 1501);
    let stalls = AxisConfig { stall_urad: 5000, ..axis() };
    let (near, away) = (
        |s: &mut Sense| s.reading = Reading::Measured(5000),
        |s: &mut Sense| {
            s.reading = Reading::Measured(-5001);
        },
    );
    edge(stalls, near, away, 152, Fault::Stall, 5001);
    let follows = AxisConfig { following_urad: 5000, ..axis() };
    edge(follows, near, away, 102, Fault::FollowingError, 5001);
    let limited = AxisConfig { minimum_urad: -4000, maximum_urad: 4000, tolerance_urad: 1000, ..axis() };
    edge(limited, near, away, 1, Fault::SoftLimit, -5001);
    let (near, away) = (
        |s: &mut Sense| s.reading = Reading::Measured(-5000),
        |s: &mut Sense| {
            s.reading = Reading::Measured(5001);
        },
    );
    edge(limited, near, away, 1, Fault::SoftLimit, 5001);
    let answers = |sense: &mut Sense| sense.reading = Reading::Measured(0);
    edge(axis(), answers, |sense| sense.reading = Reading::Invalid, 1, Fault::EncoderInvalid, 0);
    edge(axis(), answers, |sense| sense.reading = Reading::Missing, 101, Fault::EncoderInvalid, 0);
}

#[test]
fn a_shaft_stalls_after_it_stood_away_and_again_when_it_is_pushed_away() {
    let mut rig = ready(AxisConfig { stall_urad: 5000, ..axis() });
    for ms in 1..=160 {
        rig.sense(0).reading = Reading::Measured(6000 + ms % 2 * 3000);
        assert_eq!(rig.fault_after(1), None, "it moves");
    }
    assert_eq!(rig.fault_after(400), Some((151, Fault::Stall, 6000)));
    for (pushed_to_urad, answer) in [(999, AckCode::CauseRemains), (1000, AckCode::Accepted)] {
        rig.sense(0).reading = Reading::Measured(pushed_to_urad);
        rig.run(1);
        assert_eq!(rig.clear(Fault::Stall), answer, "{pushed_to_urad} urad");
    }
}

/// What comes and goes is no fault: the timeout starts again.
#[test]
fn the_timeout_starts_again_when_a_cause_goes() {
    let mut rig = ready(axis());
    for _ in 0..10 {
        rig.sense(0).supply_mv = 9000;
        assert_eq!(rig.fault_after(15), None);
        rig.sense(0).supply_mv = 11_000;
        assert_eq!(rig.fault_after(2), None);
    }
}

#[test]
fn a_servo_that_measures_nothing_has_no_supply_to_watch_nor_a_place_to_leave() {
    let mut rig = Rig::new(Config { axes: [axis()], ..Config::default() }, Reading::Unmeasured);
    rig.sense(0).supply_mv = 0;
    assert_eq!(rig.fault_after(100), None);
    assert_eq!(rig.clear(Fault::UnderVoltage), AckCode::Accepted);
    assert!(!rig.setpoint(0).torque, "it would jump");
    rig.tell(hello(HOST));
    assert_eq!(rig.order(Order::Arm { armed: true }), AckCode::Accepted);
    rig.run(1);
    assert!(rig.setpoint(0).torque);
    assert_eq!(rig.order(Order::Arm { armed: false }), AckCode::Accepted);
    rig.run(5);
    assert!(rig.setpoint(0).torque && rig.controller.state() == State::Idle, "it stays at its setpoint");
}

#[test]
fn a_servo_has_fifty_milliseconds_to_switch_its_torque_on() {
    let mut rig = ready(axis());
    assert_eq!(rig.clear(Fault::TorqueLost), AckCode::Accepted);
    rig.sense(0).torque = false;
    rig.step_as_is();
    assert!(rig.controller.faults().contains(Fault::TorqueLost), "it was on for long");
    assert_eq!(rig.clear(Fault::TorqueLost), AckCode::CauseRemains);
    rig.run(1);
    assert_eq!(rig.clear(Fault::TorqueLost), AckCode::Accepted);
    let free = AxisConfig { holds_when_idle: false, ..axis() };
    let mut rig = Rig::new(Config { axes: [free], ..Config::default() }, Reading::Measured(0));
    rig.run(2);
    rig.tell(hello(HOST));
    assert_eq!(rig.order(Order::Arm { armed: true }), AckCode::Accepted);
    (0..51).for_each(|_| rig.step_as_is());
    assert!(rig.controller.faults().is_empty() && rig.setpoint(0).torque);
    rig.step_as_is();
    assert!(rig.controller.faults().contains(Fault::TorqueLost));
}

#[test]
fn a_free_shaft_is_followed_and_a_held_one_is_not() {
    for holds_when_idle in [false, true] {
        let config = Config { axes: [AxisConfig { holds_when_idle, ..axis() }], ..Config::default() };
        let mut rig = Rig::new(config, Reading::Measured(7));
        rig.run(2);
        rig.sense(0).reading = Reading::Measured(2000);
        rig.run(2);
        let expected = if holds_when_idle { 7 } else { 2000 };
        assert_eq!((rig.setpoint(0).torque, rig.setpoint(0).position_urad), (holds_when_idle, expected));
    }
}

#[test]
fn a_jump_is_more_than_noise_and_what_the_time_allows() {
    let config = AxisConfig { jump_urad: 8000, top_speed_urad_s: 500_000, ..AxisConfig::default() };
    let rig = ready(config);
    let still = Axis { asked_us: 0, measured_urad: 0, swept_urad: (0, 0), ..rig.controller.axes[0] };
    let sent = Axis { swept_urad: (-10_000, 20_000), ..still };
    let far = Axis { swept_urad: (-1_000_000, 1_000_000), ..still };
    let free = Axis { torque_wanted_since: None, ..still };
    let let_go = Axis { sense: Sense { torque: false, ..still.sense }, ..still };
    assert!(still.torque_wanted_since.is_some() && still.sense.torque);
    // 0.1 s at 0.5 rad/s and the noise; from where it was sent; three times that; a turn a second
    for (axis, least, most) in [
        (still, -58_000, 58_000),
        (sent, -68_000, 78_000),
        (far, -158_000, 158_000),
        (free, -636_318, 636_318),
        (let_go, -636_318, 636_318),
    ] {
        let jumps = |now_urad| is_jump(&axis, &config, now_urad, 100_000);
        assert!(!jumps(least) && !jumps(most) && jumps(least - 1) && jumps(most + 1), "{axis:?}");
        let shifted = Axis { measured_urad: 5000, ..axis };
        assert!(is_jump(&shifted, &config, least - 1, 100_000));
    }
    assert!(!is_jump(&still, &config, 508_000, 9_000_000) && is_jump(&still, &config, 508_001, 9_000_000));
}

#[test]
fn a_jump_may_be_cleared_after_half_a_second_without_one() {
    let mut rig = ready(AxisConfig { jump_urad: 8000, ..axis() });
    rig.sense(0).reading = Reading::Measured(40_000);
    assert_eq!(rig.fault_after(1), Some((1, Fault::EncoderJump, 40_000)));
    assert_eq!(rig.setpoint(0).position_urad, 40_000, "nothing pushes against an encoder that lies");
    rig.run(499);
    assert_eq!(rig.clear(Fault::EncoderJump), AckCode::CauseRemains);
    rig.run(1);
    assert_eq!(rig.clear(Fault::EncoderJump), AckCode::Accepted);
    assert_eq!(rig.order(Order::Arm { armed: true }), AckCode::Accepted);
    assert_eq!(rig.order(Order::MoveTo { axis: 0, position_urad: 0 }), AckCode::NotHomed);
}

#[test]
fn a_first_fault_is_reported_and_a_second_of_its_kind_changes_nothing() {
    let mut rig = ready(axis());
    rig.sense(0).temperature_c = 80;
    assert_eq!(rig.fault_after(1), Some((1, Fault::OverTemperature, 80)));
    rig.sense(0).temperature_c = 90;
    assert_eq!(
        rig.fault_after(200).map(|(_, fault, detail)| (fault, detail)),
        Some((Fault::OverTemperature, 80))
    );
    assert_eq!(rig.setpoint(0).current_limit_ma, 500);
    assert_eq!(rig.order(Order::EStop), AckCode::Accepted);
    assert_eq!(rig.controller.state(), State::EStop);
    rig.sense(0).temperature_c = 30;
    rig.run(1);
    assert_eq!(
        (rig.clear(Fault::OverTemperature), rig.controller.state()),
        (AckCode::Accepted, State::EStop)
    );
    assert_eq!((rig.clear(Fault::EStop), rig.controller.state()), (AckCode::Accepted, State::Idle));
    rig.run(1);
    assert_eq!(rig.setpoint(0).current_limit_ma, 1500);
}

/// From inside the region the path out is open, and no other.
#[test]
fn a_pair_in_its_keep_out_region_is_a_fault_once_both_are_homed() {
    let keep_out = KeepOut::inside(&[HalfPlane { a: -1, b: 1, c: 300_000 }]).unwrap();
    let mut rig = Rig::new(
        Config { axes: [axis(); 2], keep_out, keep_out_margin_urad: 0, ..Config::default() },
        Reading::Measured(0),
    );
    rig.sense(1).reading = Reading::Measured(350_000);
    rig.run(2);
    rig.tell(hello(HOST));
    assert_eq!(rig.order(Order::Arm { armed: true }), AckCode::Accepted);
    for axis in [0, 1] {
        assert!(rig.controller.faults().is_empty());
        assert_eq!(rig.order(Order::Home { axis }), AckCode::Accepted);
        rig.run(310);
    }
    assert!(rig.controller.faults().contains(Fault::KeepOut));
    assert_eq!(rig.clear(Fault::KeepOut), AckCode::CauseRemains);
    rig.sense(1).reading = Reading::Measured(290_000);
    rig.run(1);
    assert_eq!(rig.clear(Fault::KeepOut), AckCode::Accepted);
    assert_eq!(rig.order(Order::Arm { armed: true }), AckCode::Accepted);
    let pair = |a_urad, b_urad| Order::MovePair { a_urad, b_urad };
    // the set point stands inside still
    assert_eq!(rig.order(pair(0, 400_000)), AckCode::KeepOut);
    assert_eq!(rig.order(pair(0, 200_000)), AckCode::Accepted);
}

#[test]
fn an_axis_without_a_switch_cannot_home_on_it() {
    let mut rig = Rig::new(
        Config { axes: [AxisConfig { home: Home::switch_below(0), ..axis() }], ..Config::default() },
        Reading::Measured(0),
    );
    rig.run(2);
    rig.tell(hello(HOST));
    assert_eq!(rig.order(Order::Arm { armed: true }), AckCode::Accepted);
    assert_eq!(rig.order(Order::Home { axis: 0 }), AckCode::Accepted);
    assert_eq!(rig.fault_after(1), Some((1, Fault::EncoderInvalid, 0)));
}
