//! When an encoder is missing and when it jumped, for readings that come when a bus lets them.

use super::Controller;
use crate::config::Home;
use crate::servo::{Reading, Sense, Servo, ServoHoming, Setpoint};
use crate::{ALL_AXES, AxisConfig, Command, Config, Fault, Order, ResetCause, State};

/// An actuator that says what the test puts into it.
#[derive(Clone, Copy, Debug)]
pub(super) struct IdealServo {
    pub(super) sense: Sense,
    pub(super) setpoint: Setpoint,
}

impl Servo for IdealServo {
    fn sense(&mut self, _now_us: u64) -> Sense {
        self.sense
    }

    fn drive(&mut self, _now_us: u64, setpoint: Setpoint) {
        self.setpoint = setpoint;
    }

    fn range_urad(&self) -> (i32, i32) {
        (-1_500_000, 1_500_000)
    }
}

/// Five counts of a servo with 4096 to the turn.
const NOISE_URAD: i32 = 8000;
/// 2 degrees.
const JUMP_URAD: i32 = 34_907;

struct Bench {
    controller: Controller<IdealServo, 1>,
    now_us: u64,
    id: u16,
}

impl Bench {
    fn new(home: Home) -> Self {
        let axes = [AxisConfig { jump_urad: NOISE_URAD, home, ..AxisConfig::default() }];
        let servo = IdealServo { sense: Sense::UNREAD, setpoint: Setpoint::default() };
        let controller =
            Controller::new(Config { axes, ..Config::default() }, [servo], ResetCause::PowerOn, 0);
        let mut bench = Self { controller, now_us: 0, id: 0 };
        bench.poll(1000, 1000, Some(0));
        let hello = Command::Hello { protocol_min: 1, protocol_max: 1, heartbeat_timeout_ms: 5000, nonce: 1 };
        bench.controller.handle(bench.now_us, &hello, &mut |_| {});
        bench.order(Order::Arm { armed: true });
        bench.poll(1000, 1000, Some(0));
        bench
    }

    /// Holding at zero, homed, read every 5 ms.
    fn holding() -> Self {
        let mut bench = Self::new(Home::Absolute);
        bench.order(Order::Home { axis: ALL_AXES });
        for _ in 0..80 {
            bench.poll(5000, 1000, Some(0));
        }
        assert_eq!(bench.controller.state(), State::Holding);
        bench
    }

    fn order(&mut self, order: Order) {
        self.id += 1;
        self.controller.handle(self.now_us, &Command::Order { id: self.id, order }, &mut |_| {});
    }

    fn servo(&mut self) -> &mut IdealServo {
        self.controller.servo_mut(0).unwrap()
    }

    /// A round that ends `after_us` from the last one's end: its question left `ago_us` before that end and was answered a
    /// millisecond later, or never.
    fn poll(&mut self, after_us: u64, ago_us: u64, answer_urad: Option<i32>) {
        self.now_us += after_us;
        let now_us = self.now_us;
        let asked_us = now_us - ago_us;
        let servo = self.servo();
        servo.sense.torque = servo.setpoint.torque;
        servo.sense.reading = answer_urad.map_or(Reading::Missing, Reading::Measured);
        servo.sense.sampled_us = [asked_us, (asked_us + 1000).min(now_us)];
        let heartbeat = Command::Heartbeat { session: 1, time_ms: 0 };
        self.controller.handle(now_us, &heartbeat, &mut |_| {});
        self.controller.step(now_us, &mut |_| {});
    }

    fn has(&self, fault: Fault) -> bool {
        self.controller.faults().contains(fault)
    }
}

/// However seldom the bus is asked, up to what a push on the shaft could do in the time.
#[test]
fn a_jump_of_two_degrees_at_rest_is_found() {
    for period_us in [1000, 5000, 10_000, 20_000, 45_000] {
        for jump_urad in [JUMP_URAD, -JUMP_URAD] {
            let mut bench = Bench::holding();
            for _ in 0..10 {
                bench.poll(period_us, 1000, Some(300));
            }
            assert!(bench.controller.faults().is_empty(), "{period_us} us: {:?}", bench.controller.faults());
            bench.poll(period_us, 1000, Some(jump_urad));
            assert!(bench.has(Fault::EncoderJump), "{period_us} us, {jump_urad} urad");
        }
    }
}

/// At 30 degrees a second the shaft lags, a round takes 300 ms after its reading, and the next reading is where the
/// shaft was sent: with the stamps of the samples that is motion, with those of the rounds it would be a leap.
#[test]
fn a_late_poll_during_a_fast_move_is_no_jump() {
    let run = |honest: bool| {
        let mut bench = Bench::holding();
        bench.order(Order::MoveTo { axis: 0, position_urad: 900_000 });
        let lag_urad = 45_000;
        for _ in 0..100 {
            let at = bench.servo().setpoint.position_urad - lag_urad;
            bench.poll(5000, 1000, Some(at.max(0)));
        }
        let sent_to = bench.servo().setpoint.position_urad;
        assert!(sent_to > 150_000 && bench.controller.faults().is_empty());
        // sampled at the begin of a round that then waited for something else
        bench.poll(300_000, if honest { 300_000 } else { 1000 }, Some(sent_to - lag_urad));
        bench.poll(5000, 1000, Some(sent_to));
        bench.has(Fault::EncoderJump)
    };
    assert!(!run(true));
    assert!(run(false), "the test sees what the stamps are for");
}

#[test]
fn a_jump_while_moving_is_found_and_lagging_is_none() {
    for jumped in [false, true] {
        let mut bench = Bench::holding();
        bench.order(Order::MoveTo { axis: 0, position_urad: 900_000 });
        for round in 0..100 {
            let leap = if jumped && round == 60 { 3 * JUMP_URAD } else { 0 };
            let at = bench.servo().setpoint.position_urad - 20_000 + leap;
            bench.poll(10_000, 1000, Some(at.max(0)));
        }
        assert_eq!(bench.has(Fault::EncoderJump), jumped);
    }
}

#[test]
fn an_encoder_is_missing_by_questions_and_by_time() {
    // the host could not run: no question, no fault
    let mut bench = Bench::holding();
    bench.poll(400_000, 1000, Some(0));
    assert!(bench.controller.faults().is_empty());
    // two questions that waited long
    bench.poll(200_000, 200_000, None);
    bench.poll(200_000, 200_000, None);
    bench.poll(5000, 1000, Some(0));
    assert!(bench.controller.faults().is_empty());
    // many in a short time: not yet
    for _ in 0..9 {
        bench.poll(10_000, 10_000, None);
        assert!(!bench.has(Fault::EncoderInvalid));
    }
    // and then it is
    bench.poll(12_000, 10_000, None);
    assert!(bench.has(Fault::EncoderInvalid));
}

/// A bus that loses every third answer does not keep an axis from being homed; one that answers nothing for a while does.
#[test]
fn a_shaft_is_quiet_though_some_readings_stay_away() {
    for (lost, homes) in [(1, true), (20, false)] {
        let mut bench = Bench::new(Home::Absolute);
        bench.order(Order::Home { axis: ALL_AXES });
        for round in 0..120 {
            bench.poll(5000, 1000, (round % (2 + lost) >= lost).then_some(0));
        }
        assert_eq!(bench.controller.state() == State::Holding, homes, "{:?}", bench.controller.faults());
    }
}

#[test]
fn a_shaft_without_torque_may_be_turned_by_hand() {
    let mut bench = Bench::holding();
    bench.order(Order::Arm { armed: false });
    bench.poll(5000, 1000, Some(0));
    bench.servo().setpoint.torque = false;
    for step in 0..100 {
        bench.poll(5000, 1000, Some(step * 5000)); // 57 degrees a second
        bench.servo().setpoint.torque = false;
    }
    assert!(!bench.has(Fault::EncoderJump), "{:?}", bench.controller.faults());
}

#[test]
fn an_actuator_may_find_its_zero_by_itself() {
    let mut bench = Bench::new(Home::ByServo { longest_us: 5_000_000 });
    bench.order(Order::Home { axis: 0 });
    bench.poll(5000, 1000, Some(0));
    bench.poll(5000, 1000, Some(0));
    assert!(bench.servo().setpoint.home && bench.controller.state() == State::Homing);
    bench.servo().sense.homing = ServoHoming::Underway;
    for step in 0..100 {
        bench.poll(5000, 1000, Some(-2000 * step)); // it seeks, and nothing that moves so is a fault
    }
    assert!(bench.controller.faults().is_empty(), "{:?}", bench.controller.faults());
    bench.servo().sense.homing = ServoHoming::Done;
    bench.poll(5000, 1000, Some(50_000)); // its zero is another one now
    bench.poll(5000, 1000, Some(50_000));
    assert_eq!(bench.controller.state(), State::Holding, "{:?}", bench.controller.faults());
    assert_eq!((bench.servo().setpoint.home, bench.servo().setpoint.position_urad), (false, 50_000));
    // one that gives up, and one that takes for ever
    for answer in [ServoHoming::Failed, ServoHoming::Underway] {
        let mut bench = Bench::new(Home::ByServo { longest_us: 1_000_000 });
        bench.order(Order::Home { axis: 0 });
        bench.poll(5000, 1000, Some(0));
        bench.servo().sense.homing = answer;
        for _ in 0..250 {
            bench.poll(5000, 1000, Some(0));
        }
        assert!(bench.has(Fault::EncoderInvalid), "{answer:?}");
        assert!(!bench.servo().setpoint.home);
    }
}

#[test]
fn nothing_is_moved_further_while_an_encoder_is_silent() {
    let mut bench = Bench::holding();
    bench.order(Order::MoveTo { axis: 0, position_urad: 900_000 });
    for _ in 0..60 {
        let at = bench.servo().setpoint.position_urad;
        bench.poll(5000, 1000, Some(at));
    }
    for _ in 0..3 {
        bench.poll(5000, 1000, None);
    }
    let stood = bench.servo().setpoint;
    for _ in 0..10 {
        bench.poll(5000, 1000, None);
    }
    assert_eq!(
        (bench.servo().setpoint.position_urad, bench.servo().setpoint.velocity_urad_s),
        (stood.position_urad, 0)
    );
    for _ in 0..600 {
        let at = bench.servo().setpoint.position_urad;
        bench.poll(5000, 1000, Some(at));
    }
    assert_eq!((bench.servo().setpoint.position_urad, bench.controller.state()), (900_000, State::Holding));
}

#[test]
fn set_points_go_on_by_a_reading_of_sixty_milliseconds_ago_and_by_no_older_one() {
    for (ago_us, goes_on) in [(60_000, true), (60_001, false)] {
        let mut bench = Bench::holding();
        bench.order(Order::MoveTo { axis: 0, position_urad: 900_000 });
        bench.poll(10_000, 1000, Some(0));
        let before = bench.servo().setpoint.position_urad;
        bench.poll(10_000, ago_us, Some(0));
        assert_eq!(bench.servo().setpoint.position_urad > before, goes_on, "{ago_us} us");
    }
}

/// A device that answers the questions of long ago, one by one: the set points wait for what it shows, and it did not stall.
#[test]
fn old_news_neither_stall_a_shaft_nor_let_it_run_ahead() {
    let mut bench = Bench::holding();
    bench.order(Order::MoveTo { axis: 0, position_urad: 900_000 });
    let mut shown = 0;
    for _ in 0..20 {
        shown = bench.servo().setpoint.position_urad;
        bench.poll(10_000, 1000, Some(shown));
    }
    for round in 1..30 {
        bench.poll(10_000, 10_000 * round, Some(shown)); // a sample of the time when it fell behind
    }
    let ahead = bench.servo().setpoint.position_urad - shown;
    assert!((0..60_000).contains(&ahead), "{ahead} urad ahead of what is seen");
    assert!(bench.controller.faults().is_empty(), "{:?}", bench.controller.faults());
    // news again, and it still stands there: that is a stall
    for _ in 0..60 {
        bench.poll(5000, 1000, Some(shown));
    }
    assert!(!bench.controller.faults().is_empty());
}
