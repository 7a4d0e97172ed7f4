//! When a shaft has torque, and its setpoint while it is held, braked or free.

use super::rule_tests::Rig;
use crate::servo::Reading;
use crate::{AckCode, AxisConfig, Config, Order, State};

fn axis(holds_when_idle: bool) -> AxisConfig {
    AxisConfig {
        jump_urad: 1_000_000,
        stall_urad: 500_000,
        following_urad: 500_000,
        holds_when_idle,
        ..AxisConfig::default()
    }
}

fn ready(holds_when_idle: bool) -> Rig<1> {
    Rig::ready(Config { axes: [axis(holds_when_idle)], ..Config::default() })
}

/// Armed once, and free again.
fn free() -> Rig<1> {
    let mut rig = ready(false);
    assert_eq!(rig.order(Order::Arm { armed: false }), AckCode::Accepted);
    rig.run(3);
    rig
}

fn setpoint(rig: &mut Rig<1>) -> (bool, i32) {
    (rig.setpoint(0).torque, rig.setpoint(0).position_urad)
}

#[test]
fn nothing_has_torque_before_every_encoder_was_read() {
    let mut rig = Rig::new(Config { axes: [axis(true); 2], ..Config::default() }, Reading::Measured(0));
    rig.sense(1).reading = Reading::Missing;
    rig.run(5);
    assert_eq!(rig.controller.state(), State::Boot);
    assert!(!rig.setpoint(0).torque && !rig.setpoint(1).torque);
}

#[test]
fn a_shaft_that_was_let_go_is_free_in_a_fault_as_well_and_is_followed() {
    let mut rig = free();
    rig.run(100);
    assert!(rig.controller.faults().is_empty(), "its torque was not lost, but switched off");
    assert_eq!(rig.order(Order::EStop), AckCode::Accepted);
    rig.sense(0).reading = Reading::Measured(2000);
    rig.run(2);
    assert_eq!(setpoint(&mut rig), (false, 2000));
}

#[test]
fn a_held_shaft_keeps_its_setpoint_until_it_is_disarmed() {
    let mut rig = ready(true);
    rig.sense(0).reading = Reading::Measured(2000);
    rig.run(1);
    assert_eq!(rig.order(Order::Hold), AckCode::Accepted);
    rig.run(1);
    assert_eq!(setpoint(&mut rig), (true, 0));
    assert_eq!(rig.order(Order::EStop), AckCode::Accepted);
    rig.run(2);
    assert_eq!(setpoint(&mut rig), (true, 0), "a fault holds");
    let mut rig = ready(true);
    rig.sense(0).reading = Reading::Measured(2000);
    rig.run(1);
    assert_eq!(rig.order(Order::Arm { armed: false }), AckCode::Accepted);
    rig.run(1);
    assert_eq!(setpoint(&mut rig), (true, 2000));
}

/// A servo may take a while to switch on; a rig that brakes meanwhile brakes while it moves.
#[test]
fn a_rig_brakes_before_its_torque_has_come_on() {
    let mut rig = free();
    assert_eq!(rig.order(Order::Arm { armed: true }), AckCode::Accepted);
    assert_eq!(rig.order(Order::MoveTo { axis: 0, position_urad: 900_000 }), AckCode::Accepted);
    (0..20).for_each(|_| rig.step_as_is());
    let (torque, before) = setpoint(&mut rig);
    assert!(torque && before > 0);
    assert_eq!(rig.order(Order::EStop), AckCode::Accepted);
    rig.step_as_is();
    assert!(rig.setpoint(0).position_urad > before);
    (0..20).for_each(|_| rig.step_as_is());
    assert_eq!(setpoint(&mut rig), (true, 0), "at rest it goes with the shaft");
}

#[test]
fn a_move_shorter_than_its_tolerance_is_completed() {
    let mut rig = ready(true);
    assert_eq!(rig.order(Order::MoveTo { axis: 0, position_urad: 2000 }), AckCode::Accepted);
    while rig.controller.state() == State::Moving {
        rig.run(1);
    }
    assert_eq!((rig.controller.state(), setpoint(&mut rig)), (State::Holding, (true, 2000)));
}
