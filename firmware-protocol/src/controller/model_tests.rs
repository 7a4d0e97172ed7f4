//! The state machine under anything that may come, in any order and at any time: its invariants, and the only ways in
//! which it changes its state.

use proptest::prelude::*;

use super::tests::{APART_URAD, Bench, SESSION};
use crate::command::CLEAR_KEY;
use crate::simulated::AxisFault;
use crate::{ALL_AXES, Command, Fault, Order, State};

/// One thing that may happen.
#[derive(Clone, Debug)]
enum Event {
    Run { ms: u64, step_us: u64 },
    Order(Order),
    Old(u16, Order),
    Inject(usize, AxisFault),
    Repair(usize),
    Feed(bool),
    Switch(bool),
    Hello(u32),
    ClearAll,
    MakeReady,
}

fn order() -> impl Strategy<Value = Order> {
    let angle = -1_300_000i32..1_300_000;
    prop_oneof![
        6 => (angle.clone(), angle.clone()).prop_map(|(a_urad, b_urad)| Order::MovePair { a_urad, b_urad }),
        3 => (0u8..3, angle).prop_map(|(axis, position_urad)| Order::MoveTo { axis, position_urad }),
        1 => any::<bool>().prop_map(|armed| Order::Arm { armed }),
        1 => prop_oneof![Just(0), Just(1), Just(ALL_AXES)].prop_map(|axis| Order::Home { axis }),
        1 => Just(Order::Hold),
        1 => any::<u16>().prop_map(|deceleration_mrad_s2| Order::Stop { deceleration_mrad_s2 }),
        1 => Just(Order::EStop),
        1 => (0u8..2, 0u16..600, 0u16..3000).prop_map(|(axis, speed_mrad_s, acceleration_mrad_s2)| {
            Order::Profile { axis, speed_mrad_s, acceleration_mrad_s2 }
        }),
    ]
}

fn event() -> impl Strategy<Value = Event> {
    let fault = prop_oneof![
        Just(AxisFault::Stuck),
        (5u8..90).prop_map(AxisFault::Slow),
        (0i32..60_000).prop_map(AxisFault::Backlash),
        Just(AxisFault::EncoderFreeze),
        Just(AxisFault::EncoderInvalid),
        Just(AxisFault::Overheat(100)),
        Just(AxisFault::UnderVoltage(9000)),
    ];
    prop_oneof![
        8 => (1u64..1500, 200u64..4000).prop_map(|(ms, step_us)| Event::Run { ms, step_us }),
        8 => order().prop_map(Event::Order),
        1 => (0u16..40, order()).prop_map(|(back, order)| Event::Old(back, order)),
        1 => (0usize..2, fault).prop_map(|(axis, fault)| Event::Inject(axis, fault)),
        2 => (0usize..2).prop_map(Event::Repair),
        1 => any::<bool>().prop_map(Event::Feed),
        1 => any::<bool>().prop_map(Event::Switch),
        1 => (0u32..3).prop_map(Event::Hello),
        2 => Just(Event::ClearAll),
        4 => Just(Event::MakeReady),
    ]
}

/// What must hold whatever comes. A frozen encoder lets the shaft run on until the stall is found, by no more than
/// `BLIND_URAD`; everything else stays within a reading's honesty.
const BLIND_URAD: i32 = 150_000;
const SLACK_URAD: i32 = 12_000;

/// Every change of state between two looks at it. A step or an order may do two at once: a fault while homing ends, a
/// stop of a rig that stands.
const CHANGES: &[(State, &[State])] = &[
    (State::Boot, &[State::Idle, State::Fault, State::EStop]),
    (State::Idle, &[State::Holding, State::Fault, State::EStop]),
    (State::Holding, &[State::Homing, State::Moving, State::Idle, State::Fault, State::EStop]),
    (State::Homing, &[State::Holding, State::Idle, State::Fault, State::EStop]),
    (State::Moving, &[State::Holding, State::Idle, State::Fault, State::EStop]),
    (State::Fault, &[State::Idle, State::EStop]),
    (State::EStop, &[State::Idle, State::Fault]),
];

struct Invariants {
    state: State,
    slack_urad: [i32; 2],
    disarmed_since_us: Option<u64>,
    disarmed_at: [i32; 2],
    /// Largest play of each axis since it stood there: gears that lose play give up what they had at once.
    play_urad: [i32; 2],
    moved: bool,
}

impl Invariants {
    /// Gears that lose play turn the shaft by half of it, past a limit where it stands at one.
    fn lose_play(&mut self, bench: &mut Bench, axis: usize, before_urad: i32) {
        let lost_urad = (before_urad - play_urad(bench, axis)).max(0);
        self.slack_urad[axis] = self.slack_urad[axis].max(SLACK_URAD + lost_urad / 2);
    }

    fn check(&mut self, bench: &mut Bench) -> Result<(), TestCaseError> {
        let (state, faults) = (bench.controller.state(), bench.controller.faults());
        let before = core::mem::replace(&mut self.state, state);
        let allowed = CHANGES.iter().find(|(from, _)| *from == before).map_or(&[][..], |(_, to)| to);
        prop_assert!(state == before || allowed.contains(&state), "from {:?} to {:?}", before, state);
        let faulted = matches!(state, State::Fault | State::EStop);
        prop_assert_eq!(faulted, !faults.is_empty(), "{:?} with {:?}", state, faults);
        prop_assert_eq!(
            state == State::EStop,
            faults.contains(Fault::EStop),
            "{:?} with {:?}",
            state,
            faults
        );
        let moves = matches!(state, State::Holding | State::Homing | State::Moving);
        prop_assert_eq!(moves, bench.controller.armed(), "{:?}", state);
        let at = bench.at();
        for (angle, slack) in at.iter().zip(self.slack_urad) {
            prop_assert!(angle.abs() <= 1_047_198 + slack, "an axis at {} urad", angle);
        }
        let apart = i64::from(at[1]) - i64::from(at[0]);
        let slack = i64::from(self.slack_urad.iter().sum::<i32>() - 2 * SLACK_URAD);
        prop_assert!(apart < APART_URAD + slack, "in the keep-out region: {at:?}");
        self.moved |= at[0].abs() > 300_000;
        if bench.controller.armed() {
            self.disarmed_since_us = None;
            return Ok(());
        }
        let since = *self.disarmed_since_us.get_or_insert(bench.now_us);
        let play_urad = [0, 1].map(|axis| play_urad(bench, axis));
        // from full speed the gentlest profile stops within a second or, if slower, within what it was set to
        if bench.now_us - since < 1_500_000 || bench.controller.path.is_some() {
            (self.disarmed_at, self.play_urad) = (at, play_urad);
            return Ok(());
        }
        for axis in 0..2 {
            self.play_urad[axis] = self.play_urad[axis].max(play_urad[axis]);
            let crept = (at[axis] - self.disarmed_at[axis]).abs();
            prop_assert!(crept < 3000 + self.play_urad[axis], "axis {} moves disarmed: {}", axis, crept);
        }
        Ok(())
    }
}

fn play_urad(bench: &mut Bench, axis: usize) -> i32 {
    bench.controller.servo_mut(axis).unwrap().backlash_urad
}

fn live(seed: u64, events: &[Event]) -> Result<bool, TestCaseError> {
    let mut bench = Bench::new(seed);
    let mut invariants = Invariants {
        state: State::Boot,
        slack_urad: [SLACK_URAD; 2],
        disarmed_since_us: None,
        disarmed_at: [0; 2],
        play_urad: [0; 2],
        moved: false,
    };
    for event in events {
        match event {
            Event::Run { ms, step_us } => {
                for _ in 0..ms * 1000 / step_us {
                    bench.step(*step_us);
                    invariants.check(&mut bench)?;
                }
            }
            Event::Order(order) => {
                bench.order(*order);
                invariants.check(&mut bench)?;
            }
            Event::Old(back, order) => {
                bench.tell(Command::Order { id: bench.id.wrapping_sub(*back), order: *order });
            }
            Event::Inject(axis, fault) => {
                if *fault == AxisFault::EncoderFreeze {
                    invariants.slack_urad[*axis] = BLIND_URAD;
                }
                let before_urad = play_urad(&mut bench, *axis);
                bench.inject(*axis, *fault);
                invariants.lose_play(&mut bench, *axis, before_urad);
            }
            Event::Repair(axis) => {
                let before_urad = play_urad(&mut bench, *axis);
                let servo = bench.controller.servo_mut(*axis).unwrap();
                servo.repair(1500);
                servo.inject(AxisFault::Overheat(-100));
                invariants.lose_play(&mut bench, *axis, before_urad);
                // a shaft that may turn again goes to its setpoint
                invariants.disarmed_since_us = None;
            }
            Event::Feed(feeds) => bench.feeds = *feeds,
            Event::Switch(closed) => bench.controller.set_local_switch(*closed),
            Event::Hello(nonce) => {
                bench.tell(Command::Hello {
                    protocol_min: 1,
                    protocol_max: 1,
                    heartbeat_timeout_ms: 300,
                    nonce: SESSION - nonce,
                });
            }
            Event::ClearAll => {
                for fault in Fault::ALL {
                    bench.order(Order::ClearFault { fault, key: CLEAR_KEY });
                    invariants.check(&mut bench)?;
                }
            }
            Event::MakeReady => {
                bench.controller.set_local_switch(true);
                bench.feeds = true;
                bench.hello();
                invariants.check(&mut bench)?;
                bench.step(1000);
                invariants.check(&mut bench)?;
                for fault in Fault::ALL {
                    bench.order(Order::ClearFault { fault, key: CLEAR_KEY });
                    invariants.check(&mut bench)?;
                }
                for order in [Order::Arm { armed: true }, Order::Home { axis: ALL_AXES }] {
                    bench.order(order);
                    invariants.check(&mut bench)?;
                }
                for _ in 0..400 {
                    bench.step(1000);
                    invariants.check(&mut bench)?;
                }
            }
        }
        invariants.check(&mut bench)?;
    }
    Ok(invariants.moved)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn stays_inside_its_limits_whatever_comes(seed: u32, events in proptest::collection::vec(event(), 1..60)) {
        live(seed.into(), &events)?;
    }
}

/// Gears that lose their play while the rig is disarmed turn the shaft by it, which is no motion of the controller's.
#[test]
fn lost_play_is_no_motion() {
    let run = |ms| Event::Run { ms, step_us: 200 };
    let events = [
        Event::MakeReady,
        Event::Inject(1, AxisFault::Backlash(6550)),
        Event::Order(Order::MovePair { a_urad: 0, b_urad: -160_558 }),
        Event::Inject(0, AxisFault::Overheat(100)),
        Event::ClearAll,
        run(777),
        run(1123),
        Event::Inject(1, AxisFault::Backlash(0)),
        Event::MakeReady,
    ];
    live(0, &events).unwrap();
}

#[test]
fn lost_play_at_a_limit_is_no_motion() {
    let events = [
        Event::Inject(0, AxisFault::Backlash(32_143)),
        Event::MakeReady,
        Event::Order(Order::MovePair { a_urad: 1_043_744, b_urad: 0 }),
        Event::MakeReady,
        Event::Run { ms: 990, step_us: 300 },
        Event::MakeReady,
        Event::MakeReady,
        Event::Repair(0),
        Event::Run { ms: 1, step_us: 200 },
    ];
    live(0, &events).unwrap();
}

/// A shaft that still swings when its rig is disarmed, and an encoder that stops counting just then.
#[test]
fn a_frozen_encoder_drives_no_disarmed_shaft() {
    let run = |ms, step_us| Event::Run { ms, step_us };
    let events = [
        Event::Inject(0, AxisFault::EncoderFreeze),
        Event::MakeReady,
        Event::Order(Order::MovePair { a_urad: 0, b_urad: -116_582 }),
        Event::MakeReady,
        Event::Inject(1, AxisFault::EncoderFreeze),
        run(762, 2042),
        run(5000, 200),
    ];
    live(0, &events).unwrap();
}

/// A shaft that brakes for one reason, and an encoder that stops counting meanwhile: the first fault hides no second one.
#[test]
fn a_frozen_encoder_is_found_while_the_rig_brakes_for_another_fault() {
    let events = [
        Event::MakeReady,
        Event::Order(Order::Profile { axis: 0, speed_mrad_s: 215, acceleration_mrad_s2: 172 }),
        Event::Order(Order::MovePair { a_urad: 171_990, b_urad: 271_791 }),
        Event::MakeReady,
        Event::MakeReady,
        Event::Inject(1, AxisFault::UnderVoltage(9000)),
        Event::Inject(1, AxisFault::EncoderFreeze),
        Event::MakeReady,
        Event::MakeReady,
    ];
    live(0, &events).unwrap();
}

/// The property above must not hold for want of motion.
#[test]
fn the_property_sees_motion() {
    let pair = |a_urad, b_urad| Event::Order(Order::MovePair { a_urad, b_urad });
    let run = || Event::Run { ms: 2000, step_us: 1000 };
    let events = [run(), Event::MakeReady, pair(900_000, 0), run()];
    assert!(live(1, &events).unwrap());
}
