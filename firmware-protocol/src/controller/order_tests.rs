//! Orders one by one: what they answer, what they change, and what they leave alone.

use super::rule_tests::{HOST, Rig, hello};
use crate::servo::Reading;
use crate::{ALL_AXES, AckCode, AxisConfig, Command, Config, Fault, Limit, Order, Report, State};

/// Wide limits: 0.5 rad/s, 2 rad/s², an emergency stop with 10 rad/s².
fn axis() -> AxisConfig {
    AxisConfig {
        jump_urad: 1_000_000,
        stall_urad: 500_000,
        following_urad: 500_000,
        top_speed_urad_s: 500_000,
        ..AxisConfig::default()
    }
}

fn config() -> Config<2> {
    Config { axes: [axis(); 2], ..Config::default() }
}

fn to(position_urad: i32) -> Order {
    Order::MoveTo { axis: 0, position_urad }
}

#[test]
fn only_the_host_that_opened_a_session_keeps_it_alive() {
    let mut rig = Rig::new(config(), Reading::Measured(0));
    rig.run(2);
    rig.tell(hello(0));
    assert_eq!(rig.order(Order::Arm { armed: true }), AckCode::NoSession);
    rig.tell(hello(HOST));
    assert_eq!(rig.order(Order::Arm { armed: true }), AckCode::Accepted);
    // the same hello again disarms nothing, and lets no order be done twice
    rig.tell(hello(HOST));
    rig.run(2);
    assert!(rig.controller.armed());
    assert_eq!(rig.answer(rig.id.wrapping_sub(1), to(5)).0, AckCode::Outdated);
    // another host's heartbeat does not feed
    let alive = |rig: &mut Rig<2>, session, ms: u64| {
        rig.now_us += 1000 * ms;
        rig.tell(Command::Heartbeat { session, time_ms: 0 });
        let Rig { controller, now_us, .. } = rig;
        for number in 0..2 {
            controller.servo_mut(number).unwrap().sense.sampled_us = [*now_us; 2];
        }
        controller.step(*now_us, &mut |_| {});
        controller.faults().is_empty()
    };
    assert!(alive(&mut rig, HOST, 900) && alive(&mut rig, HOST + 1, 1000));
    assert!(!alive(&mut rig, HOST + 1, 1));
    assert!(rig.controller.faults().contains(Fault::Watchdog));
}

#[test]
fn a_heartbeat_may_stay_away_between_a_tenth_and_five_seconds() {
    for (asked_ms, timeout_ms) in [(0, 100), (300, 300), (60_000, 5000)] {
        let mut rig = Rig::new(config(), Reading::Measured(0));
        rig.run(2);
        let nonce = 9; // which the bench does not feed
        rig.tell(Command::Hello { protocol_min: 1, protocol_max: 1, heartbeat_timeout_ms: asked_ms, nonce });
        assert_eq!(rig.order(Order::Arm { armed: true }), AckCode::Accepted);
        rig.run(timeout_ms);
        assert!(rig.controller.faults().is_empty(), "{asked_ms} ms");
        let clear = Order::ClearFault { fault: Fault::Watchdog, key: 0 };
        assert_eq!(rig.order(clear), AckCode::Accepted, "there is no cause yet");
        rig.reports.clear();
        rig.run(1);
        let is_watchdog = |report: &Report| matches!(report, Report::Fault { fault: Fault::Watchdog, detail, .. } if *detail == timeout_ms as i32 + 1);
        assert!(rig.reports.iter().any(is_watchdog), "{asked_ms} ms");
        assert_eq!(rig.order(clear), AckCode::CauseRemains);
    }
}

/// Sixteen answers are remembered; older ones are outdated, and stopping never is.
#[test]
fn answers_are_remembered_by_number_and_message() {
    let mut rig = Rig::ready(config());
    let refused = (AckCode::Limit, 0);
    let first = rig.id + 1;
    for number in 0..16 {
        assert_eq!(rig.answer(first + number, to(2_000_000)), refused);
    }
    for number in 0..16 {
        assert_eq!(rig.answer(first + number, to(1000)), refused, "as it was answered before");
    }
    assert_eq!(rig.answer(first + 15, Order::Home { axis: 0 }).0, AckCode::Outdated, "another message");
    assert_eq!(rig.answer(first, to(1000)).0, AckCode::Outdated, "forgotten");
    assert_eq!(rig.answer(first + 14, Order::Hold).0, AckCode::Accepted);
    assert_eq!(rig.answer(first + 16, to(1000)).0, AckCode::Accepted);
    assert_eq!(
        rig.answer(first.wrapping_sub(9), Order::Stop { deceleration_mrad_s2: 0 }).0,
        AckCode::Accepted
    );
    rig.follow(500);
    assert_eq!(rig.controller.state(), State::Idle);
    // numbers wrap, and a late stop did not turn them back
    rig.id = first + 16;
    assert_eq!(rig.answer(rig.id, Order::Home { axis: 0 }).0, AckCode::Outdated);
    rig.id = rig.id.wrapping_add(30_000);
    assert_eq!(rig.order(Order::Arm { armed: true }), AckCode::Accepted);
}

/// How far a rig at full speed goes on, µrad.
fn stops_within(order: Order) -> i32 {
    let mut rig = Rig::ready(config());
    assert_eq!(rig.order(to(900_000)), AckCode::Accepted);
    rig.follow(600);
    let before = rig.setpoint(0);
    assert_eq!(before.velocity_urad_s, 500_000);
    assert_eq!(rig.order(order), AckCode::Accepted);
    rig.follow(600);
    assert_eq!(rig.setpoint(0).velocity_urad_s, 0);
    assert_eq!(rig.setpoint(1).position_urad, 0);
    rig.setpoint(0).position_urad - before.position_urad
}

#[test]
fn a_stop_decelerates_as_ordered_but_never_harder_than_an_emergency_stop() {
    let near = |order, expected: i32| {
        let distance = stops_within(order);
        assert!((distance - expected).abs() < 600, "{order:?}: {distance} urad");
    };
    // twice as hard as a move gains speed
    near(Order::Hold, 31_250);
    near(Order::Stop { deceleration_mrad_s2: 0 }, 31_250);
    near(Order::Stop { deceleration_mrad_s2: 5000 }, 25_000);
    near(Order::Stop { deceleration_mrad_s2: 60_000 }, 12_500);
    near(Order::EStop, 12_500);
}

#[test]
fn another_host_or_a_fault_brakes_as_hold_does() {
    let mut rig = Rig::ready(config());
    assert_eq!(rig.order(to(900_000)), AckCode::Accepted);
    rig.follow(600);
    rig.tell(hello(HOST + 1)); // a new session disarms, and brakes
    let before = rig.setpoint(0).position_urad;
    rig.follow(600);
    assert!((rig.setpoint(0).position_urad - before - 31_250).abs() < 600);
    let mut rig = Rig::ready(config());
    assert_eq!(rig.order(to(900_000)), AckCode::Accepted);
    rig.follow(600);
    let before = rig.setpoint(0).position_urad;
    rig.sense(1).temperature_c = 90;
    rig.follow(600);
    assert!((rig.setpoint(0).position_urad - before - 31_250).abs() < 600);
    assert_eq!(rig.controller.state(), State::Fault);
}

/// A profile that gains speed slowly may be in a hurry to stop.
#[test]
fn a_hold_brakes_within_four_degrees_whatever_the_profile() {
    let mut rig = Rig::ready(Config::<2>::default());
    let gentle = Order::Profile { axis: 0, speed_mrad_s: 523, acceleration_mrad_s2: 300 };
    assert_eq!(rig.order(gentle), AckCode::Accepted);
    assert_eq!(rig.order(to(1_000_000)), AckCode::Accepted);
    rig.follow(1650);
    let before = rig.setpoint(0);
    assert!(before.velocity_urad_s > 450_000, "{before:?}");
    assert_eq!(rig.order(Order::Hold), AckCode::Accepted);
    rig.follow(600);
    let moved_urad = rig.setpoint(0).position_urad - before.position_urad;
    assert!((20_000..69_813).contains(&moved_urad), "{moved_urad} urad");
}

#[test]
fn arming_needs_a_closed_switch_and_a_rig_that_stands() {
    let mut rig = Rig::new(config(), Reading::Missing);
    rig.run(2);
    rig.tell(hello(HOST));
    assert_eq!((rig.order(Order::Arm { armed: true }), rig.controller.state()), (AckCode::Busy, State::Boot));
    let set = Order::SetLimit { axis: 0, limit: Limit::Maximum, value: 900_000 };
    assert_eq!(rig.order(set), AckCode::Busy);
    let mut rig = Rig::ready(config());
    assert_eq!(rig.order(Order::Arm { armed: true }), AckCode::Accepted, "again");
    rig.controller.set_local_switch(false);
    assert_eq!(rig.order(Order::Arm { armed: true }), AckCode::Locked);
    rig.controller.set_local_switch(true);
    assert_eq!(rig.order(to(900_000)), AckCode::Accepted);
    assert_eq!(rig.order(Order::Home { axis: 0 }), AckCode::Busy);
    rig.follow(300);
    assert_eq!(rig.order(Order::Arm { armed: false }), AckCode::Accepted);
    rig.follow(1);
    assert_eq!(rig.order(Order::Arm { armed: true }), AckCode::Busy, "it brakes");
    assert_eq!(rig.order(to(0)), AckCode::Busy);
    assert_eq!(rig.order(Order::ClearFault { fault: Fault::Stall, key: 0 }), AckCode::Busy);
    assert_eq!(rig.order(set), AckCode::Busy);
    rig.follow(600);
    assert_eq!((rig.controller.armed(), rig.order(set)), (false, AckCode::Accepted));
    assert_eq!(rig.order(to(0)), AckCode::NotArmed);
}

#[test]
fn an_axis_is_homed_alone() {
    let mut rig = Rig::new(config(), Reading::Measured(0));
    rig.run(2);
    rig.tell(hello(HOST));
    assert_eq!(rig.order(Order::Arm { armed: true }), AckCode::Accepted);
    assert_eq!(rig.answer(50, Order::Home { axis: 2 }), (AckCode::BadArgument, 2));
    rig.id = 50;
    assert_eq!(rig.order(Order::Home { axis: 1 }), AckCode::Accepted);
    rig.run(299);
    assert_eq!(rig.controller.state(), State::Homing);
    assert_eq!(rig.order(Order::Home { axis: 0 }), AckCode::Busy, "it homes, though nothing moves");
    rig.run(1);
    assert_eq!(rig.controller.state(), State::Holding);
    assert!(rig.reports.contains(&Report::Done { id: 51, axis: ALL_AXES, error_urad: 0 }));
    assert_eq!(rig.answer(60, to(100)), (AckCode::NotHomed, 0));
    assert_eq!(rig.answer(61, Order::Home { axis: 0 }), (AckCode::Accepted, 0));
    rig.run(300);
    assert_eq!(rig.answer(62, to(100)), (AckCode::Accepted, 0));
}

#[test]
fn a_shaft_that_is_never_quiet_is_not_homed() {
    for (shakes_urad, quiet) in [(2500, true), (2501, false)] {
        let mut rig = Rig::new(config(), Reading::Measured(0));
        rig.run(2);
        rig.tell(hello(HOST));
        assert_eq!(rig.order(Order::Arm { armed: true }), AckCode::Accepted);
        assert_eq!(rig.order(Order::Home { axis: 0 }), AckCode::Accepted);
        for ms in 0..3000 {
            rig.sense(0).reading = Reading::Measured(if ms / 100 % 2 == 0 { shakes_urad } else { 0 });
            rig.step();
        }
        assert_eq!(rig.controller.state(), if quiet { State::Holding } else { State::Homing });
        rig.run(1);
        assert_eq!(rig.controller.faults().contains(Fault::EncoderInvalid), !quiet);
    }
}

#[test]
fn moves_are_refused_with_the_axis_that_cannot_go_there() {
    let mut rig = Rig::ready(config());
    let pair = |a_urad, b_urad| Order::MovePair { a_urad, b_urad };
    let most = axis().maximum_urad;
    rig.id = 100;
    assert_eq!(rig.answer(101, pair(0, most + 1)), (AckCode::Limit, 1));
    assert_eq!(rig.answer(102, pair(-most - 1, 0)), (AckCode::Limit, 0));
    assert_eq!(rig.answer(103, Order::MoveTo { axis: 2, position_urad: 0 }), (AckCode::BadArgument, 2));
    assert_eq!(rig.answer(104, pair(most, -most)), (AckCode::Accepted, 0));
    rig.follow(4000);
    assert_eq!([rig.setpoint(0), rig.setpoint(1)].map(|setpoint| setpoint.position_urad), [most, -most]);
    assert_eq!(rig.controller.state(), State::Holding);
    let mut one = Rig::ready(Config { axes: [axis()], ..Config::default() });
    assert_eq!(one.order(pair(0, 0)), AckCode::BadArgument);
}

#[test]
fn a_move_settles_within_its_tolerance_or_is_a_fault_after_a_second() {
    for (short_urad, done) in [(5236, true), (5237, false)] {
        let mut rig = Rig::ready(config());
        assert_eq!(rig.order(to(20_000)), AckCode::Accepted);
        rig.sense(0).reading = Reading::Measured(20_000 - short_urad);
        while rig.setpoint(0).position_urad != 20_000 {
            rig.run(1);
        }
        let done_report = Report::Done { id: rig.id, axis: ALL_AXES, error_urad: short_urad };
        assert_eq!(
            (rig.controller.state() == State::Holding, rig.reports.contains(&done_report)),
            (done, done)
        );
        rig.run(1000);
        assert!(rig.controller.faults().is_empty());
        rig.run(1);
        assert_eq!(rig.controller.faults().contains(Fault::FollowingError), !done);
    }
}

#[test]
fn a_profile_stays_within_the_limits_and_is_driven() {
    let mut rig = Rig::ready(config());
    let profile = |axis, speed_mrad_s, acceleration_mrad_s2| Order::Profile {
        axis,
        speed_mrad_s,
        acceleration_mrad_s2,
    };
    assert_eq!(rig.answer(500, profile(2, 100, 100)), (AckCode::BadArgument, 2));
    assert_eq!(rig.answer(501, profile(1, 0, 100)), (AckCode::BadArgument, 1));
    assert_eq!(rig.answer(502, profile(1, 100, 0)), (AckCode::BadArgument, 1));
    assert_eq!(rig.answer(503, profile(1, 501, 2000)), (AckCode::Limit, 1));
    assert_eq!(rig.answer(504, profile(1, 500, 2001)), (AckCode::Limit, 1));
    assert_eq!(rig.answer(505, profile(1, 500, 2000)), (AckCode::Accepted, 0));
    assert_eq!(rig.answer(506, profile(0, 50, 100)), (AckCode::Accepted, 0));
    assert_eq!(rig.answer(507, to(900_000)), (AckCode::Accepted, 0));
    rig.follow(250);
    assert_eq!(rig.setpoint(0).velocity_urad_s, 25_000);
    rig.follow(500);
    assert_eq!(rig.setpoint(0).velocity_urad_s, 50_000);
}

#[test]
fn limits_are_set_while_disarmed_and_reported() {
    let mut rig = Rig::new(config(), Reading::Measured(0));
    rig.run(2);
    rig.tell(hello(HOST));
    let reported = |rig: &mut Rig<2>, limit| {
        rig.reports.clear();
        rig.tell(Command::GetLimit { axis: 1, limit });
        match rig.reports[..] {
            [Report::Limit { axis: 1, limit: theirs, value }] if theirs == limit => value,
            ref other => panic!("{other:?}"),
        }
    };
    let given = AxisConfig::default();
    for (limit, value, refused, accepted) in [
        (Limit::Minimum, given.minimum_urad, [given.maximum_urad, -1_500_001], -1_500_000),
        (Limit::Maximum, given.maximum_urad, [-1_500_000, 1_500_001], 1_500_000),
        (Limit::Speed, 500_000, [999, 20_000_001], 1000),
        (Limit::Acceleration, given.top_acceleration_urad_s2, [999, 100_000_001], 1000),
        (Limit::Current, given.current_limit_ma.into(), [0, 40_000], 1),
    ] {
        assert_eq!(reported(&mut rig, limit), value);
        let set = |value| Order::SetLimit { axis: 1, limit, value };
        for value in refused {
            assert_eq!(rig.order(set(value)), AckCode::BadArgument, "{limit:?} {value}");
        }
        assert_eq!(rig.order(set(accepted)), AckCode::Accepted, "{limit:?}");
        assert_eq!(reported(&mut rig, limit), accepted);
    }
    for (limit, value) in [
        (Limit::ServoMinimum, -1_500_000),
        (Limit::ServoMaximum, 1_500_000),
        (Limit::Accuracy, given.accuracy_urad),
        (Limit::Resolution, given.resolution_urad),
        (Limit::LostMotion, given.lost_motion_urad),
    ] {
        assert_eq!(reported(&mut rig, limit), value);
        assert_eq!(rig.order(Order::SetLimit { axis: 1, limit, value: 1 }), AckCode::BadArgument);
    }
    let far = Order::SetLimit { axis: 2, limit: Limit::Speed, value: 5000 };
    assert_eq!(rig.answer(900, far), (AckCode::BadArgument, 2));
    rig.tell(Command::GetLimit { axis: 2, limit: Limit::Speed });
    assert!(matches!(rig.reports.last(), Some(Report::Ack { .. })), "it has no such axis");
    // a profile that was faster is no longer
    rig.id = 900;
    assert_eq!(rig.order(Order::Arm { armed: true }), AckCode::Accepted);
    assert_eq!(rig.order(Order::Home { axis: ALL_AXES }), AckCode::Accepted);
    rig.run(310);
    assert_eq!(rig.order(Order::MoveTo { axis: 1, position_urad: 2000 }), AckCode::Accepted);
    rig.follow(500);
    assert_eq!(rig.setpoint(1).velocity_urad_s, 500);
    rig.follow(1000);
    assert_eq!(rig.setpoint(1).velocity_urad_s, 1000);
}

#[test]
fn an_emergency_stop_that_is_not_latched_needs_no_key() {
    let mut rig = Rig::ready(config());
    let clear = |key| Order::ClearFault { fault: Fault::EStop, key };
    assert_eq!(rig.order(clear(0)), AckCode::Accepted);
    rig.controller.set_local_switch(false);
    assert_eq!(rig.order(clear(0)), AckCode::CauseRemains, "the next step will latch it");
    rig.controller.set_local_switch(true);
    assert_eq!(rig.order(Order::EStop), AckCode::Accepted);
    assert_eq!(rig.order(clear(0)), AckCode::Locked);
    assert_eq!(rig.controller.state(), State::EStop);
}
