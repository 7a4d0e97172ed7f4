//! The rig: the mock device behind a pty and behind a damaged line, driven as the program drives it.

use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use firmware_protocol::simulated::AxisFault;
use firmware_protocol::{AckCode, Command, Frame, HalfPlane, KeepOut, ResetCause};
use outrigger::drive::{LinkError, Options, Rig, RigController, RigError, SerialLink};
use outrigger::mock::rig::{AxisKind, Damage, MockConfig, MockFault, MockRig, SimulatedLink};
use outrigger::recording::ServoReport;

use crate::support::{Case, case};

pub const CASES: &[Case] = &[
    case("pitches_are_applied_over_a_pty_and_read_back", pitches_are_applied_over_a_pty_and_read_back),
    case("a_cut_cable_ends_a_move_with_an_error", a_cut_cable_ends_a_move_with_an_error),
    case("a_second_program_cannot_open_the_line", a_second_program_cannot_open_the_line),
    case("a_rig_that_does_not_answer_is_named", a_rig_that_does_not_answer_is_named),
    case("each_layer_refuses_its_own_limits", each_layer_refuses_its_own_limits),
    case("faults_are_reported_by_name", faults_are_reported_by_name),
    case("a_restart_during_a_move_is_reported_as_such", a_restart_during_a_move_is_reported_as_such),
    case(
        "slow_answers_are_waited_for_and_wrong_ones_ignored",
        slow_answers_are_waited_for_and_wrong_ones_ignored,
    ),
    case("interrupts_hold_then_stop", interrupts_hold_then_stop),
    case("a_pitch_is_approached_from_below", a_pitch_is_approached_from_below),
    case("a_second_host_takes_over_and_the_first_says_so", a_second_host_takes_over_and_the_first_says_so),
    case("a_servo_that_measures_nothing_says_so", a_servo_that_measures_nothing_says_so),
    case("the_rig_speaks_through_a_can_adapter", the_rig_speaks_through_a_can_adapter),
    case("stamps_are_on_the_hosts_clock", stamps_are_on_the_hosts_clock),
    case("a_late_answer_is_as_old_as_its_question", a_late_answer_is_as_old_as_its_question),
    case("what_is_not_homed_is_not_measured", what_is_not_homed_is_not_measured),
    case("axes_home_on_switches_and_lose_their_zero", axes_home_on_switches_and_lose_their_zero),
    case("the_true_angle_lies_within_the_uncertainty", the_true_angle_lies_within_the_uncertainty),
];

const NO_DAMAGE: Damage = Damage { share: 0.0, longest_delay_us: 0 };

type Simulated = RigController<SimulatedLink>;

/// Armed and homed, in simulated time.
fn ready(link: SimulatedLink, options: Options) -> Simulated {
    let mut rig = RigController::connect(link, options).unwrap();
    rig.arm().unwrap();
    rig.home().unwrap();
    rig
}

fn clean(seed: u64) -> SimulatedLink {
    SimulatedLink::new(MockConfig::default(), seed, NO_DAMAGE)
}

/// A session that a busy machine does not end: threads that race real time may wait for each other for seconds.
pub fn patient() -> Options {
    let long = Duration::from_secs(5);
    Options { heartbeat_timeout: long, link_timeout: long, answer_within: long, ..Options::new_session() }
}

fn pitches_are_applied_over_a_pty_and_read_back() {
    let mock = MockRig::start(MockConfig::default(), 1).unwrap();
    let rig = Rig::connect_with(mock.path(), patient()).unwrap();
    let reports = rig.reports();
    let refused = rig.apply(&[0.1, -0.1]);
    assert!(matches!(refused, Err(RigError::Refused { code: AckCode::NotArmed, .. })), "{refused:?}");
    rig.arm().unwrap();
    let refused = rig.apply(&[0.1, -0.1]);
    assert!(matches!(refused, Err(RigError::Refused { code: AckCode::NotHomed, .. })), "{refused:?}");
    rig.home().unwrap();
    let pitches = [0.2f64, -0.2];
    let mut seen = Vec::new();
    let applied = rig.apply_with(&pitches, |progress| seen.push(progress.measured_rad.clone())).unwrap();
    assert!(seen.len() > 3, "progress is told");
    for (axis, wanted) in applied.axes.iter().zip(pitches) {
        assert!((axis.measured_rad - wanted).abs() < 0.3f64.to_radians(), "{axis:?}");
        assert_eq!(axis.source, "measured");
        assert!(axis.uncertainty_rad.unwrap() > 0.0);
    }
    let status = rig.status().unwrap();
    assert!(status.axes.iter().all(|axis| axis.state == "holding" && axis.faults.is_empty()), "{status:?}");
    let heard: Vec<ServoReport> = reports.try_iter().collect();
    assert!(heard.iter().any(|report| report.state == "moving"), "{} reports", heard.len());
    assert!(
        heard.iter().all(|report| report.uncertainty_urad.is_some_and(|width| width >= 192)),
        "{heard:?}"
    );
    for axis in 0..2 {
        let times: Vec<u64> =
            heard.iter().filter(|report| report.axis == axis).map(|report| report.time_ns).collect();
        assert!(times.windows(2).all(|pair| pair[0] < pair[1]), "time goes on");
    }
    let line = serde_json::to_string(&heard[0]).unwrap();
    assert_eq!(serde_json::from_str::<ServoReport>(&line).unwrap(), heard[0]);
}

fn a_cut_cable_ends_a_move_with_an_error() {
    let mock = MockRig::start(MockConfig::default(), 2).unwrap();
    let rig = Rig::connect_with(mock.path(), patient()).unwrap();
    let reports = rig.reports();
    rig.arm().unwrap();
    rig.home().unwrap();
    let mut cut = Some(mock);
    let started = Instant::now();
    let result = rig.apply_with(&[0.9, -0.9], |_| {
        // the move has begun when progress is told
        if started.elapsed() > Duration::from_millis(300) {
            cut.take().into_iter().for_each(MockRig::close);
        }
    });
    let error = result.unwrap_err();
    assert!(cut.is_none() && matches!(error, RigError::Link(LinkError::HungUp { .. })), "{error}");
    assert!(error.to_string().starts_with("rig cable: "), "{error}");
    // the channel closes, and everything asked later says why
    assert!(reports.into_iter().count() > 0);
    for _ in 0..3 {
        assert!(matches!(rig.status(), Err(RigError::Link(LinkError::HungUp { .. }))));
    }
    assert_eq!(rig.reports().into_iter().count(), 0);
}

fn a_second_program_cannot_open_the_line() {
    let mock = MockRig::start(MockConfig::default(), 3).unwrap();
    let first = SerialLink::open(mock.path()).unwrap();
    let second = SerialLink::open(mock.path()).err();
    assert!(matches!(second, Some(LinkError::InUse { .. })), "{second:?}");
    drop(first);
    SerialLink::open(mock.path()).unwrap();
    let nothing = SerialLink::open(std::path::Path::new("/dev/no-such-rig")).err().unwrap().to_string();
    assert!(nothing.contains("cannot open /dev/no-such-rig"), "{nothing}");
}

fn a_rig_that_does_not_answer_is_named() {
    let mut link = clean(4);
    link.inject_at(0, MockFault::WrongId(true));
    let error = RigController::connect(link, Options::default()).err().unwrap();
    assert!(matches!(error, RigError::NoAnswer { what: "hello", .. }), "{error}");
    assert!(error.to_string().contains("of them for others"), "{error}");
    let mut link = clean(4);
    link.inject_at(1_000_000, MockFault::WrongId(true));
    let lost = ready(link, Options::default()).idle(Duration::from_secs(3)).unwrap_err().to_string();
    assert!(lost.contains("node 1 says nothing any more, node 2 does"), "{lost}");
    // a stranger that was heard for a moment, before the rig itself was heard again, is no reason for its silence
    let mut link = clean(4);
    for (at_us, fault) in [
        (1_000_000, MockFault::WrongId(true)),
        (1_300_000, MockFault::WrongId(false)),
        (1_600_000, MockFault::Late(600_000)),
    ] {
        link.inject_at(at_us, fault);
    }
    let mut rig = ready(link, Options::default());
    rig.idle(Duration::from_millis(300)).unwrap();
    let lost = rig.idle(Duration::from_secs(4)).unwrap_err().to_string();
    assert!(lost.contains("it says nothing at all"), "{lost}");
    let wrong = RigController::connect(clean(4), Options { node: 9, ..Options::default() }).err().unwrap();
    assert!(matches!(wrong, RigError::NoAnswer { what: "hello", .. }), "{wrong}");
}

fn each_layer_refuses_its_own_limits() {
    let outside = |rig: &mut Simulated, pitches: [f64; 2]| match rig.apply(&pitches, |_| {}) {
        Err(RigError::OutsideLimits { axis, limits_of, .. }) => (axis, limits_of),
        other => panic!("{other:?}"),
    };
    let limits_rad = vec![(-0.5, 0.5), (-2.0, 2.0)];
    let mut rig = ready(clean(5), Options { limits_rad, ..Options::default() });
    assert_eq!(outside(&mut rig, [0.6, 0.0]), (0, "the configured"));
    assert_eq!(outside(&mut rig, [0.0, 1.1]), (1, "the firmware's"));
    // firmware that would allow more than the servo can do
    let mut firmware = MockConfig::default().firmware;
    firmware.axes[1].maximum_urad = 2_000_000;
    let loose = MockConfig { firmware, ..MockConfig::default() };
    let mut rig = ready(SimulatedLink::new(loose, 5, NO_DAMAGE), Options::default());
    assert_eq!(outside(&mut rig, [0.0, 1.8]), (1, "the servo's own"));
    // the keep-out region, here and in the firmware
    let region = KeepOut::inside(&[HalfPlane { a: -1, b: 1, c: 1_000_000 }]).unwrap();
    let mut rig = ready(clean(6), Options { keep_out: region, ..Options::default() });
    assert!(matches!(rig.apply(&[-0.6, 0.6], |_| {}), Err(RigError::KeepOut { .. })));
    let mut rig = ready(clean(6), Options::default());
    let refused = rig.apply(&[-0.75, 0.75], |_| {});
    assert!(matches!(refused, Err(RigError::Refused { code: AckCode::KeepOut, .. })), "{refused:?}");
    // numbers that are none
    assert!(matches!(rig.apply(&[f64::NAN, 0.0], |_| {}), Err(RigError::NoAngle { axis: 0, .. })));
    assert!(matches!(rig.apply(&[0.0], |_| {}), Err(RigError::AxisCount { given: 1, axes: 2 })));
    // after all those refusals the rig stands where it stood, and still moves
    rig.apply(&[0.3, -0.3], |_| {}).unwrap();
}

fn faults_are_reported_by_name() {
    let cases = [
        (AxisFault::Stuck, "stall"),
        (AxisFault::Slow(10), "following_error"),
        (AxisFault::EncoderJump(150_000), "encoder_jump"),
        (AxisFault::EncoderFreeze, "stall"),
        (AxisFault::EncoderInvalid, "encoder_invalid"),
        (AxisFault::Overheat(200), "over_temperature"),
        (AxisFault::UnderVoltage(8000), "under_voltage"),
        (AxisFault::TorqueLost, "torque_lost"),
    ];
    for (broken, name) in cases {
        let mut link = clean(7);
        link.inject_at(1_200_000, MockFault::Axis(1, broken));
        let mut rig = ready(link, Options::default());
        let error = rig.apply(&[0.9, -0.9], |_| {}).unwrap_err();
        let RigError::Fault { faults, axis } = &error else { panic!("{broken:?}: {error}") };
        assert!(faults.contains(&name.to_owned()), "{broken:?}: {error}");
        assert_eq!(*axis, Some(1), "{broken:?}");
        rig.idle(Duration::from_millis(400)).unwrap();
        let status = rig.status().unwrap();
        assert!(status.axes[1].faults.contains(&name.to_owned()), "{broken:?}: {status:?}");
        assert!(!status.axes[0].faults.contains(&name.to_owned()), "{broken:?}: {status:?}");
        let refused = rig.arm().unwrap_err();
        assert!(matches!(refused, RigError::Fault { .. }), "{refused}");
        if let AxisFault::Overheat(_) | AxisFault::UnderVoltage(_) = broken {
            let stays = rig.clear_faults().unwrap_err().to_string();
            assert_eq!(stays, format!("rig: fault {name} (axis 1) is not cleared: its cause is still there"));
        }
    }
    // more play is no fault: the encoder sits on the output
    let mut link = clean(7);
    link.inject_at(0, MockFault::Axis(0, AxisFault::Backlash(20_000)));
    ready(link, Options::default()).apply(&[0.4, -0.4], |_| {}).unwrap();
}

fn a_restart_during_a_move_is_reported_as_such() {
    let mut link = clean(8);
    link.inject_at(1_200_000, MockFault::Reboot);
    let mut rig = ready(link, Options::default());
    let error = rig.apply(&[0.9, -0.9], |_| {}).unwrap_err();
    assert!(matches!(error, RigError::Restarted { cause: ResetCause::BrownOut }), "{error}");
    assert!(error.to_string().contains("not homed"), "{error}");
}

fn slow_answers_are_waited_for_and_wrong_ones_ignored() {
    let mut link = clean(9);
    link.inject_at(1_000_000, MockFault::Late(400));
    let mut rig = ready(link, Options::default());
    rig.idle(Duration::from_millis(500)).unwrap();
    let applied = rig.apply(&[0.3, -0.3], |_| {}).unwrap();
    assert!((applied.axes[0].measured_rad - 0.3).abs() < 0.006);
    let mut link = clean(9);
    link.inject_at(1_200_000, MockFault::WrongId(true));
    link.inject_at(1_900_000, MockFault::WrongId(false));
    ready(link, Options::default()).apply(&[0.9, -0.9], |_| {}).unwrap();
}

fn interrupts_hold_then_stop() {
    let mut rig = ready(clean(10), Options::default());
    let interrupt = rig.interrupt();
    let mut steps = 0;
    let result = rig.apply(&[0.9, -0.9], |_| {
        steps += 1;
        if steps == 20 {
            interrupt.raise();
        }
    });
    assert!(matches!(result, Err(RigError::Interrupted { action: "the rig holds" })), "{result:?}");
    assert_eq!(rig.status().unwrap().axes[0].state, "holding", "who says so has waited for it");
    rig.idle(Duration::from_secs(1)).unwrap();
    let status = rig.status().unwrap();
    assert_eq!((status.axes[0].state.as_str(), status.armed), ("holding", true));
    assert!(status.axes[0].position_deg < 40.0, "{status:?}");
    assert!(
        matches!(rig.apply(&[0.0, 0.0], |_| {}), Err(RigError::Interrupted { .. })),
        "nothing begins again"
    );
    interrupt.reset();
    let mut steps = 0;
    let result = rig.apply(&[-0.2, 0.2], |_| {
        steps += 1;
        if steps == 10 {
            interrupt.raise();
            interrupt.raise();
        }
    });
    assert!(matches!(result, Err(RigError::Interrupted { action: "emergency stop" })), "{result:?}");
    rig.idle(Duration::from_millis(500)).unwrap();
    assert_eq!(rig.status().unwrap().axes[0].state, "e_stop");
    interrupt.reset();
    assert!(matches!(rig.arm(), Err(RigError::Fault { .. })));
    rig.clear_faults().unwrap();
    rig.arm().unwrap();
    rig.apply(&[0.0, 0.0], |_| {}).unwrap();
}

/// With play before the shaft, where it stands depends on where it came from, unless that is always the same side.
fn a_pitch_is_approached_from_below() {
    let mut directions = Vec::new();
    for start in [0.6, -0.6] {
        let mut rig = ready(clean(14), Options::default());
        rig.apply(&[start, start], |_| {}).unwrap();
        let mut seen = Vec::new();
        let applied = rig.apply(&[0.2, 0.1], |progress| seen.push(progress.measured_rad[0])).unwrap();
        assert!(applied.axes.iter().all(|axis| axis.approach == "from_below"), "{applied:?}");
        let lowest = seen.iter().rev().take_while(|at| **at < 0.21).fold(f64::MAX, |low, at| low.min(*at));
        directions.push(lowest < 0.2 - 0.012);
    }
    assert_eq!(directions, [true, true]);
    // where the limits leave no room, it says so
    let mut rig = ready(clean(14), Options::default());
    let applied = rig.apply(&[0.3, -1.045], |_| {}).unwrap();
    assert!(applied.axes.iter().all(|axis| axis.approach == "either"), "{applied:?}");
    let mut straight = ready(clean(14), Options { approach_rad: 0.0, ..Options::default() });
    straight.apply(&[0.6, 0.0], |_| {}).unwrap();
    let mut lowest = f64::MAX;
    straight.apply(&[0.2, 0.0], |progress| lowest = lowest.min(progress.measured_rad[0])).unwrap();
    assert!(lowest > 0.19, "{lowest}");
}

fn a_second_host_takes_over_and_the_first_says_so() {
    let hello = Command::Hello { protocol_min: 1, protocol_max: 1, heartbeat_timeout_ms: 1000, nonce: 4711 };
    let mut link = clean(15);
    link.another_says_at(2_000_000, Frame::command(0, 1, &hello));
    let mut rig = ready(link, Options::default());
    let error = rig.apply(&[1.0, -1.0], |_| {}).unwrap_err();
    assert!(matches!(error, RigError::OtherHost), "{error}");
}

fn a_servo_that_measures_nothing_says_so() {
    let config = MockConfig { kind: AxisKind::Pulse, ..MockConfig::default() };
    let mut rig = ready(SimulatedLink::new(config, 11, NO_DAMAGE), Options::default());
    let applied = rig.apply(&[0.3, -0.3], |_| {}).unwrap();
    assert!(applied.axes.iter().all(|axis| axis.source == "commanded"), "{applied:?}");
    assert!(applied.axes.iter().all(|axis| axis.uncertainty_rad.is_none()), "nobody looks: {applied:?}");
    let axis = &rig.status().unwrap().axes[0];
    assert_eq!((axis.source.as_str(), axis.uncertainty_deg), ("commanded", None));
    // the pulse ends at 45 degrees though the firmware would allow 60
    assert!(matches!(
        rig.apply(&[0.9, 0.0], |_| {}),
        Err(RigError::OutsideLimits { limits_of: "the servo's own", .. })
    ));
}

fn the_rig_speaks_through_a_can_adapter() {
    let mock = MockRig::start(MockConfig { slcan: true, ..MockConfig::default() }, 13).unwrap();
    let rig = Rig::connect_with(format!("slcan:{}", mock.path().display()), patient()).unwrap();
    rig.arm().unwrap();
    rig.home().unwrap();
    let applied = rig.apply(&[0.15, 0.1]).unwrap();
    assert!((applied.axes[1].measured_rad - 0.1).abs() < 0.006, "{applied:?}");
    assert_eq!(rig.status().unwrap().damaged, 0);
    let missing = Rig::connect("can:no-such-bus").err().unwrap();
    assert!(missing.to_string().contains("cannot open can:no-such-bus"), "{missing}");
}

fn stamps_are_on_the_hosts_clock() {
    let heard: Arc<Mutex<Vec<ServoReport>>> = Arc::default();
    let sink = heard.clone();
    let mut link = clean(12);
    link.inject_at(2_000_000, MockFault::Late(30));
    let mut rig = ready(link, Options { report_every: Duration::ZERO, ..Options::default() });
    rig.idle(Duration::from_millis(1500)).unwrap();
    rig.reports_to(Box::new(move |report| sink.lock().unwrap().push(report)));
    rig.idle(Duration::from_secs(3)).unwrap();
    let status = rig.status().unwrap();
    // readings come 30 ms late and every 20 ms, and their stamps say so
    assert!(status.axes.iter().all(|axis| (15.0..60.0).contains(&axis.age_ms)), "{status:?}");
    assert!(heard.lock().unwrap().len() > 200);
}

/// Watches where the axes of a simulated rig really are, µrad.
/// Every answer comes 0.7 s late, that to the question for the clock as well: later than the next question.
fn a_late_answer_is_as_old_as_its_question() {
    let mut link = clean(12);
    link.inject_at(1_000, MockFault::Late(700));
    let mut rig = RigController::connect(link, Options::default()).unwrap();
    rig.idle(Duration::from_secs(2)).unwrap();
    let status = rig.status().unwrap();
    for axis in &status.axes {
        assert!((700.0..1500.0).contains(&axis.age_ms), "{axis:?}");
        assert_eq!((axis.source.as_str(), axis.uncertainty_deg), ("stale", None), "{axis:?}");
    }
}

/// Encoders that count from where they were switched on, homed after a second; an absolute one is measured all along.
fn what_is_not_homed_is_not_measured() {
    let heard: Arc<Mutex<Vec<ServoReport>>> = Arc::default();
    let sink = heard.clone();
    let mut config = MockConfig { start_urad: Some([200_000, -100_000]), ..MockConfig::default() };
    config = config.with_home_switches(-300_000);
    let mut rig =
        RigController::connect(SimulatedLink::new(config, 16, NO_DAMAGE), Options::default()).unwrap();
    rig.reports_to(Box::new(move |report| sink.lock().unwrap().push(report)));
    rig.idle(Duration::from_secs(1)).unwrap();
    for axis in rig.status().unwrap().axes {
        let known = (axis.source.as_str(), axis.uncertainty_deg, axis.homed);
        assert_eq!(known, ("not_homed", None, false), "{axis:?}");
    }
    rig.arm().unwrap();
    rig.home().unwrap();
    rig.idle(Duration::from_secs(1)).unwrap();
    for axis in rig.status().unwrap().axes {
        assert!(axis.source == "measured" && axis.uncertainty_deg.is_some() && axis.homed, "{axis:?}");
    }
    let heard = heard.lock().unwrap();
    for axis in 0..2 {
        let own: Vec<&ServoReport> = heard.iter().filter(|report| report.axis == axis).collect();
        let homed = own.iter().position(|report| report.source == "measured").unwrap();
        let (before, after) = own.split_at(homed);
        assert!(before.len() > 20 && after.len() > 10, "{} {}", before.len(), after.len());
        let is_bare = |report: &&ServoReport| {
            report.source == "not_homed" && report.homed == Some(false) && report.uncertainty_urad.is_none()
        };
        assert!(before.iter().all(is_bare), "axis {axis}");
        assert!(
            after.iter().all(|report| report.source == "measured" && report.homed == Some(true)),
            "axis {axis}"
        );
        assert!((after[0].position_urad + 300_000).abs() < 12_000, "{:?}", after[0]);
    }
    let mut rig = RigController::connect(clean(17), Options::default()).unwrap();
    let axis = &rig.status().unwrap().axes[0];
    assert!(axis.source == "measured" && axis.uncertainty_deg.is_some() && !axis.homed, "{axis:?}");
}

fn truth_of(link: &mut SimulatedLink) -> Arc<Mutex<[i32; 2]>> {
    let truth: Arc<Mutex<[i32; 2]>> = Arc::default();
    let seen = truth.clone();
    link.watch(move |now| *seen.lock().unwrap() = now.position_urad);
    truth
}

fn axes_home_on_switches_and_lose_their_zero() {
    let config = MockConfig::default().with_home_switches(-523_599);
    let mut link = SimulatedLink::new(config, 16, NO_DAMAGE);
    link.inject_at(60_000_000, MockFault::Reboot);
    let truth = truth_of(&mut link);
    let mut rig = RigController::connect(link, Options::default()).unwrap();
    let start = rig.status().unwrap();
    assert!(start.homing_moves && start.axes.iter().all(|axis| axis.position_deg.abs() < 0.1), "{start:?}");
    assert!(
        truth.lock().unwrap().iter().any(|at| at.abs() > 20_000),
        "the encoders know nothing of where they are"
    );
    rig.arm().unwrap();
    let refused = rig.apply(&[0.1, 0.1], |_| {});
    assert!(matches!(refused, Err(RigError::Refused { code: AckCode::NotHomed, .. })), "{refused:?}");
    rig.home().unwrap();
    rig.apply(&[0.3, -0.2], |_| {}).unwrap();
    let at = *truth.lock().unwrap();
    assert!((at[0] - 300_000).abs() < 6000 && (at[1] + 200_000).abs() < 6000, "{at:?}");
    let lost = rig.idle(Duration::from_secs(60)).unwrap_err();
    assert!(matches!(lost, RigError::Restarted { .. }), "{lost}");
    let mut link = SimulatedLink::new(MockConfig::default().with_home_switches(-3_000_000), 16, NO_DAMAGE);
    link.watch(|_| {});
    let mut rig = RigController::connect(
        link,
        Options { settle_within: Duration::from_secs(60), ..Options::default() },
    )
    .unwrap();
    rig.arm().unwrap();
    let never = rig.home().unwrap_err();
    assert!(matches!(never, RigError::Fault { .. }), "a switch out of reach: {never}");
}

/// Whatever the seed, wherever the encoder sits, from whichever side: and the bound is not much wider than what happens.
fn the_true_angle_lies_within_the_uncertainty() {
    let play_rad = 1500e-6;
    for on_motor in [false, true] {
        for approach_rad in [0.0, 0.02] {
            let (mut worst_rad, mut bound_rad) = (0f64, 0f64);
            for seed in 0..12 {
                let config = MockConfig::default();
                let config = if on_motor { config.with_encoders_on_motors() } else { config };
                let mut link = SimulatedLink::new(config, seed, NO_DAMAGE);
                let truth = truth_of(&mut link);
                let mut rig = ready(link, Options { approach_rad, ..Options::default() });
                rig.apply(&[0.4, 0.4], |_| {}).unwrap();
                let to = 0.1 + 0.017 * seed as f64;
                let applied = rig.apply(&[to, -to], |_| {}).unwrap();
                let at = *truth.lock().unwrap();
                for (axis, at_urad) in applied.axes.iter().zip(at) {
                    let error_rad = (axis.measured_rad - f64::from(at_urad) * 1e-6).abs();
                    let uncertainty_rad = axis.uncertainty_rad.unwrap();
                    assert!(
                        error_rad <= uncertainty_rad,
                        "seed {seed}, on motor {on_motor}: {axis:?}, true {at_urad}"
                    );
                    assert!(axis.readings >= 8, "{axis:?}");
                    (worst_rad, bound_rad) = (worst_rad.max(error_rad), bound_rad.max(uncertainty_rad));
                }
                let status = rig.status().unwrap();
                let told_rad = status.axes[0].uncertainty_deg.unwrap().to_radians();
                assert!((told_rad - applied.axes[0].uncertainty_rad.unwrap()).abs() < 500e-6);
            }
            // coming from above, a load behind the play stands off by it, and that is said
            let either = on_motor && approach_rad == 0.0;
            assert_eq!(worst_rad > 0.9 * play_rad, either, "worst {worst_rad}");
            assert_eq!(bound_rad > play_rad, either, "bound {bound_rad}");
            assert!(bound_rad < 3.0 * worst_rad + 300e-6, "worst {worst_rad}, bound {bound_rad}");
        }
    }
}
