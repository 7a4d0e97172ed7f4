//! How an axis finds its zero: by a switch from either side, or by itself.

use super::rule_tests::{HOST, Rig, hello};
use crate::config::Home;
use crate::servo::{Reading, ServoHoming};
use crate::{AckCode, AxisConfig, Config, Fault, Order, Report, State};

/// At the switch, by its side.
const AT_URAD: i32 = 40_000;
const LOST_MOTION_URAD: i32 = 3000;

/// Homing was ordered, its switch is open.
fn seeking(home: Home) -> Rig<1> {
    let axis = AxisConfig {
        jump_urad: 1_000_000,
        stall_urad: 500_000,
        following_urad: 500_000,
        lost_motion_urad: LOST_MOTION_URAD,
        home,
        ..AxisConfig::default()
    };
    let mut rig = Rig::new(Config { axes: [axis], ..Config::default() }, Reading::Measured(0));
    rig.sense(0).home_switch = Some(false);
    rig.run(2);
    rig.tell(hello(HOST));
    assert_eq!(rig.order(Order::Arm { armed: true }), AckCode::Accepted);
    assert_eq!(rig.order(Order::Home { axis: 0 }), AckCode::Accepted);
    rig
}

fn switch(speed_urad_s: i32) -> Home {
    Home::Switch { at_urad: AT_URAD, speed_urad_s, longest_urad: 20_000 }
}

#[test]
fn an_axis_goes_towards_an_open_switch_at_once() {
    for (speed_urad_s, side) in [(-100_000, -1), (100_000, 1)] {
        let mut rig = seeking(switch(speed_urad_s));
        rig.follow(2);
        assert_eq!(rig.setpoint(0).position_urad.signum(), side);
    }
}

/// Angles count from where the load rests when it comes from below: play shows only where it comes from above.
#[test]
fn a_switch_that_is_met_from_above_closes_below_its_angle_by_the_play() {
    for (speed_urad_s, found_urad) in [(-100_000, AT_URAD - LOST_MOTION_URAD), (100_000, AT_URAD)] {
        let mut rig = seeking(switch(speed_urad_s));
        rig.follow(100);
        rig.sense(0).home_switch = Some(true);
        rig.run(30); // the shaft stands where the switch closed
        assert_eq!(rig.controller.state(), State::Holding);
        let position = |report: &&Report| matches!(report, Report::Position { .. });
        let Some(Report::Position { position_urad, .. }) = rig.reports.iter().rfind(position) else {
            panic!("no position")
        };
        assert_eq!(*position_urad, found_urad);
    }
}

#[test]
fn a_switch_is_sought_as_far_as_it_may_be_and_no_further() {
    let mut rig = seeking(switch(-100_000));
    while rig.controller.faults().is_empty() {
        assert!(rig.now_us < 1_000_000, "it goes on for ever");
        rig.follow(1);
    }
    let is_fault = |report: &&Report| matches!(report, Report::Fault { .. });
    let Some(Report::Fault { fault, detail, .. }) = rig.reports.iter().find(is_fault) else {
        panic!("no fault")
    };
    assert_eq!((*fault, *detail), (Fault::EncoderInvalid, 20_000));
}

#[test]
fn an_actuator_that_seeks_its_zero_has_its_time_and_may_give_up() {
    // the fault tells the time it took, in ms, or that it gave up
    for (says, ms, detail) in [(ServoHoming::Underway, 101, 101), (ServoHoming::Failed, 2, -1)] {
        let mut rig = seeking(Home::ByServo { longest_us: 100_000 });
        rig.sense(0).homing = says;
        assert_eq!(rig.fault_after(400), Some((ms, Fault::EncoderInvalid, detail)));
    }
}
