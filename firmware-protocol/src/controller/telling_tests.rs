//! What a rig says unasked: how often, and with which numbers.

use std::vec::Vec;

use super::rule_tests::{HOST, Rig, hello};
use crate::config::Home;
use crate::servo::Reading;
use crate::{AxisConfig, Config, Fault, Faults, Order, Report, ResetCause, Source, State};

fn config() -> Config<2> {
    let axis = AxisConfig { jump_urad: 1_000_000, ..AxisConfig::default() };
    Config { axes: [axis; 2], uid: 11, firmware: 12, revision: 13, ..Config::default() }
}

fn count(rig: &Rig<2>, is: fn(&Report) -> bool) -> usize {
    rig.reports.iter().filter(|report| is(report)).count()
}

#[test]
fn each_report_has_its_period() {
    let mut rig = Rig::new(config(), Reading::Measured(0));
    rig.run(2);
    rig.tell(hello(HOST));
    rig.run(398);
    rig.reports.clear();
    rig.run(1000);
    assert_eq!(count(&rig, |report| matches!(report, Report::Position { .. })), 2 * 50);
    assert_eq!(count(&rig, |report| matches!(report, Report::Target { .. })), 2 * 20);
    assert_eq!(count(&rig, |report| matches!(report, Report::Heartbeat { .. })), 10);
    assert_eq!(count(&rig, |report| matches!(report, Report::Effort { .. })), 2 * 5);
    assert_eq!(count(&rig, |report| matches!(report, Report::Info { .. })), 0);
    // a loop that lagged says each once, and the next ones half a period later at the earliest
    rig.now_us += 1_000_000;
    rig.reports.clear();
    rig.run(1);
    assert_eq!(count(&rig, |report| matches!(report, Report::Position { .. })), 2);
    rig.run(9);
    assert_eq!(count(&rig, |report| matches!(report, Report::Position { .. })), 2);
    rig.run(1);
    assert_eq!(count(&rig, |report| matches!(report, Report::Position { .. })), 4);
}

#[test]
fn a_rig_says_who_it_is_until_somebody_answers() {
    let mut rig = Rig::new(config(), Reading::Measured(0));
    rig.run(401);
    assert_eq!(count(&rig, |report| matches!(report, Report::Info { session: 0, .. })), 4);
    let info = |rig: &mut Rig<2>| {
        rig.reports.clear();
        rig.tell(hello(HOST));
        let [info, identity, build] = rig.reports[..] else { panic!("{:?}", rig.reports) };
        assert_eq!(identity, Report::Identity { uid: 11 });
        assert_eq!(build, Report::Build { firmware: 12, revision: 13 });
        info
    };
    let expected = |capabilities| Report::Info {
        protocol: 1,
        axes: 2,
        capabilities,
        reset: ResetCause::Software,
        session: HOST,
    };
    assert_eq!(info(&mut rig), expected(1));
    rig.sense(0).reading = Reading::Unmeasured;
    rig.run(1);
    assert_eq!(info(&mut rig), expected(0));
    let mut seeks = config();
    seeks.axes[1].home = Home::switch_below(0);
    let mut rig = Rig::new(seeks, Reading::Measured(0));
    rig.run(1);
    assert_eq!(info(&mut rig), expected(3));
}

#[test]
fn reports_carry_what_was_read() {
    let mut rig = Rig::ready(config());
    rig.run(300);
    rig.reports.clear();
    let sense = rig.sense(1);
    (sense.temperature_c, sense.current_ma, sense.supply_mv) = (33, 44, 11_055);
    // 0.1 rad/s
    for ms in 1..=400 {
        rig.sense(1).reading = Reading::Measured(100 * ms);
        rig.step();
    }
    let effort =
        Report::Effort { axis: 1, temperature_c: 33, current_ma: 44, supply_mv: 11_055, speed_mrad_s: 100 };
    assert_eq!(rig.reports.iter().rfind(|report| matches!(report, Report::Effort { .. })), Some(&effort));
    let time_ms = (rig.now_us / 1000) as u16;
    let last =
        |rig: &Rig<2>, is: fn(&Report) -> bool| *rig.reports.iter().rfind(|report| is(report)).unwrap();
    let position = |report: &Report| matches!(report, Report::Position { axis: 1, .. });
    let Report::Position { time_ms: read_ms, position_urad, source, .. } = last(&rig, position) else {
        panic!("no position")
    };
    let age_ms = time_ms - read_ms;
    assert!(age_ms < 20);
    assert_eq!((position_urad, source), (40_000 - 100 * i32::from(age_ms), Source::Measured));
    assert_eq!(
        last(&rig, |report| matches!(report, Report::Heartbeat { .. })),
        Report::Heartbeat {
            state: State::Holding,
            armed: true,
            homed: true,
            faults: Faults::default(),
            session: HOST
        }
    );
    assert_eq!(
        last(&rig, |report| matches!(report, Report::Target { axis: 1, .. })),
        Report::Target { axis: 1, state: State::Holding, homed: true, id: rig.id, target_urad: 0 }
    );
    assert_eq!(rig.order(Order::Hold), crate::AckCode::Accepted);
}

#[test]
fn an_encoder_without_a_zero_is_not_homed() {
    let last = |rig: &mut Rig<2>, axis: u8| {
        rig.reports.clear();
        rig.run(25);
        let mut positions = rig.reports.iter().filter_map(|report| match report {
            Report::Position { axis: of, source, .. } if *of == axis => Some(*source),
            _ => None,
        });
        positions.next_back().unwrap()
    };
    let mut counts = config();
    counts.axes[1].home = Home::switch_below(0);
    let mut rig = Rig::new(counts, Reading::Measured(0));
    rig.run(2);
    assert_eq!([last(&mut rig, 0), last(&mut rig, 1)], [Source::Measured, Source::NotHomed], "one of two");
    rig.sense(1).reading = Reading::Missing;
    rig.run(200);
    assert_eq!(last(&mut rig, 1), Source::Stale);
    // an absolute encoder that was caught lying has a zero when it is homed again
    let mut rig = Rig::ready(Config { axes: [AxisConfig::default(); 2], ..config() });
    assert_eq!(last(&mut rig, 0), Source::Measured);
    rig.sense(0).reading = Reading::Measured(900_000);
    assert_eq!([last(&mut rig, 0), last(&mut rig, 1)], [Source::NotHomed, Source::Measured]);
    rig.run(600);
    let clear = Order::ClearFault { fault: Fault::EncoderJump, key: 0 };
    assert_eq!(rig.order(clear), crate::AckCode::Accepted);
    assert_eq!(last(&mut rig, 0), Source::NotHomed);
    assert_eq!(rig.order(Order::Arm { armed: true }), crate::AckCode::Accepted);
    assert_eq!(rig.order(Order::Home { axis: 0 }), crate::AckCode::Accepted);
    rig.run(400);
    assert_eq!(last(&mut rig, 0), Source::Measured);
}

/// A bus may take long: the angle is as old as the question, not as the answer.
#[test]
fn a_position_is_as_old_as_its_question() {
    let mut rig = Rig::new(config(), Reading::Measured(0));
    rig.run(900);
    let now_us = rig.now_us + 1000;
    rig.sense(0).sampled_us = [now_us - 700_000, now_us];
    rig.reports.clear();
    let Rig { controller, reports, .. } = &mut rig;
    (0..25).for_each(|ms| controller.step(now_us + 1000 * ms, &mut |report| reports.push(report)));
    let age_ms = rig.reports.iter().find_map(|report| match report {
        Report::Position { axis: 0, time_ms, .. } => Some(*time_ms),
        _ => None,
    });
    assert_eq!(age_ms, Some(((now_us - 700_000) / 1000) as u16));
}

#[test]
fn a_position_is_measured_commanded_or_stale() {
    let source = |reading, ms| {
        let mut rig = Rig::new(config(), Reading::Measured(0));
        rig.run(5);
        rig.sense(0).reading = reading;
        rig.reports.clear();
        rig.run(ms);
        let position = |report: &&Report| matches!(report, Report::Position { axis: 0, .. });
        match rig.reports.iter().rfind(position) {
            Some(Report::Position { source, .. }) => *source,
            _ => panic!("no position"),
        }
    };
    assert_eq!(source(Reading::Measured(0), 130), Source::Measured);
    assert_eq!(source(Reading::Unmeasured, 130), Source::Commanded);
    assert_eq!(source(Reading::Missing, 50), Source::Measured, "it says when it was read");
    assert_eq!(source(Reading::Missing, 130), Source::Stale);
    assert_eq!(source(Reading::Invalid, 130), Source::Stale);
}

#[test]
fn a_fault_is_reported_again_with_the_time_it_came() {
    let mut rig = Rig::ready(config());
    rig.reports.clear();
    rig.sense(1).temperature_c = 99;
    rig.run(1);
    let time_ms = (rig.now_us / 1000) as u16;
    rig.run(400);
    let faults = rig.reports.iter().filter(|report| matches!(report, Report::Fault { .. }));
    let expected = Report::Fault { fault: Fault::OverTemperature, axis: 1, time_ms, detail: 99 };
    assert_eq!(faults.collect::<Vec<_>>(), [&expected; 3]);
}
