//! Known clocks behind known networks: reported values must hold the truth.

use super::*;
use crate::base::rng::Rng;

const HOST_NS: u64 = 1_700_000_000_000_000_000;

fn state_of(device_ns: u64) -> ClockState {
    let mut watch = ClockWatch::default();
    watch.add(HOST_NS, device_ns);
    watch.report().unwrap().state
}

#[test]
fn clocks_are_named_by_what_they_show() {
    assert_eq!(state_of(991_587_364_520), ClockState::SincePowerOn);
    assert_eq!(state_of(HOST_NS - 3_000_000), ClockState::Utc);
    assert_eq!(state_of(HOST_NS + 37_000_000_000), ClockState::Tai);
    assert_eq!(state_of(HOST_NS - 25 * 60_000_000_000), ClockState::Unsynchronised);
}

#[test]
fn drift_needs_time() {
    let mut watch = ClockWatch::default();
    for frame in 0..200_u64 {
        watch.add(HOST_NS + frame * 100_010_000, 5_000_000_000 + frame * 100_000_000);
        let drift_ppm = watch.report().unwrap().drift_ppm;
        assert!(frame < 130 || drift_ppm.is_some(), "{frame}");
        assert!(frame > 90 || drift_ppm.is_none(), "{frame}");
    }
    let drift_ppm = watch.report().unwrap().drift_ppm.unwrap();
    assert!((drift_ppm - 100.0).abs() < 0.1, "{drift_ppm}");
}

/// A clock that drifts, packets that leave every 10 ms and take 0.2 ms and more: mostly little, at times a lot.
struct Network {
    rng: Rng,
    drift: f64,
    watch: ClockWatch,
    sent: u64,
}

const DEVICE_NS: u64 = 77_000_000_000;
const MIN_DELAY_NS: f64 = 200_000.0;

impl Network {
    fn new(seed: u64, drift_ppm: f64) -> Self {
        Self { rng: Rng::new(seed, 1), drift: drift_ppm * 1e-6, watch: ClockWatch::default(), sent: 0 }
    }

    /// Host time at which a packet of this device time leaves.
    fn leaves_ns(&self, device_ns: u64) -> u64 {
        HOST_NS + ((device_ns - DEVICE_NS) as f64 * (1.0 + self.drift)) as u64
    }

    fn run(&mut self, seconds: u64, host_shift_ns: i64, device_shift_ns: i64, slow_ns: f64) {
        for _ in 0..seconds * 100 {
            let device_ns = DEVICE_NS + self.sent * 10_000_000;
            let burst = if self.rng.between(0.0, 1.0) < 0.02 { 50e6 } else { 0.3e6 };
            let late_ns = MIN_DELAY_NS + slow_ns - burst * (1.0 - self.rng.between(0.0, 1.0)).ln();
            let host_ns = self.leaves_ns(device_ns).saturating_add_signed(host_shift_ns) + late_ns as u64;
            self.watch.add(host_ns, device_ns.saturating_add_signed(device_shift_ns));
            self.sent += 1;
        }
    }
}

#[test]
fn offset_and_drift_lie_within_their_uncertainty() {
    let (mut inside, mut runs) = (0, 0);
    for seed in 0..40 {
        let drift_ppm = -60.0 + 3.0 * seed as f64;
        let mut network = Network::new(seed, drift_ppm);
        network.run(120, 0, 0, 0.0);
        let report = network.watch.report().unwrap();
        assert_eq!((report.jumps.len(), report.steps_back, report.state), (0, 0, ClockState::SincePowerOn));
        let device_ns = DEVICE_NS + (network.sent - 1) * 10_000_000;
        let true_s = (i128::from(network.leaves_ns(device_ns)) - i128::from(device_ns)) as f64 * 1e-9;
        let error_s = report.host_minus_device_s - MIN_DELAY_NS * 1e-9 - true_s;
        let drift_error_ppm = report.drift_ppm.unwrap() - drift_ppm;
        // 30 times better than the burst that one packet in fifty has
        assert!(error_s.abs() < 100e-6 && drift_error_ppm.abs() < 1.0, "{error_s} s, {drift_error_ppm} ppm");
        assert!(
            report.uncertainty_s.unwrap() < 300e-6 && report.drift_uncertainty_ppm.unwrap() < 3.0,
            "{report:?}"
        );
        let (host_ns, _) = network.watch.host_ns(device_ns).unwrap();
        assert!(host_ns.abs_diff(network.leaves_ns(device_ns)) < 300_000);
        runs += 2;
        inside += usize::from(error_s.abs() <= report.uncertainty_s.unwrap());
        inside += usize::from(drift_error_ppm.abs() <= report.drift_uncertainty_ppm.unwrap());
    }
    assert!(inside * 100 >= runs * 95, "{inside} of {runs}");
}

#[test]
fn jumps_are_found_whichever_clock_is_set() {
    for (host_ns, device_ns) in
        [(0, 2_000_000_000), (0, -2_000_000_000), (50_000_000, 0), (-50_000_000, 0), (0, 37_000_000_000)]
    {
        let mut network = Network::new(3, 20.0);
        network.run(30, 0, 0, 0.0);
        network.run(30, host_ns, device_ns, 0.0);
        let report = network.watch.report().unwrap();
        let change_s = (host_ns - device_ns) as f64 * 1e-9;
        assert_eq!(report.jumps.len(), 1, "{host_ns} {device_ns}: {report:?}");
        assert!((report.jumps[0].change_s - change_s).abs() < 0.005, "{host_ns} {device_ns}: {report:?}");
        // a burst of delay next to it leaves open which clock it was, and never blames the wrong one
        let blameless = if device_ns == 0 { Moved::Device } else { Moved::Host };
        assert_ne!(report.jumps[0].moved, blameless, "{host_ns} {device_ns}: {report:?}");
        // and later reports are of the time after it
        assert!((report.drift_ppm.unwrap() - 20.0).abs() < 3.0, "{report:?}");
    }
}

#[test]
fn a_sensor_that_restarts_is_a_jump() {
    let mut network = Network::new(4, 0.0);
    network.run(20, 0, 0, 0.0);
    for frame in 0..200u64 {
        network
            .watch
            .add(HOST_NS + 30_000_000_000 + frame * 100_000_000, 5_000_000_000 + frame * 100_000_000);
    }
    let report = network.watch.report().unwrap();
    assert_eq!((report.jumps.len(), report.steps_back), (1, 1), "{report:?}");
    assert!(report.drift_ppm.unwrap().abs() < 0.1, "{report:?}");
}

/// After each start the clock stands some milliseconds elsewhere: less than a jump, and more than 200 ppm of a line over all.
/// Frames of a recording that is played three times, and of a sensor whose clock is set back to where it never was.
#[test]
fn a_recording_that_begins_again_is_a_replay() {
    let mut watch = ClockWatch::default();
    for frame in 0..150_u64 {
        watch.add(HOST_NS + frame * 100_000_000, 1_585_897_255_313_000_000 + frame % 50 * 100_000_000);
    }
    let report = watch.report().unwrap();
    assert_eq!((report.replays, report.steps_back, report.jump_count), (2, 2, 2));
    let mut watch = ClockWatch::default();
    for frame in 0..100_u64 {
        let set_back_ns = if frame < 50 { 0 } else { 3_600_000_000_000 };
        watch.add(HOST_NS + frame * 100_000_000, HOST_NS + frame * 100_000_000 - set_back_ns);
    }
    let report = watch.report().unwrap();
    assert_eq!((report.replays, report.jump_count), (0, 1));
}

#[test]
fn restarts_are_no_drift() {
    for is_announced in [true, false] {
        let mut network = Network::new(6, 20.0);
        network.run(15, 0, 0, 0.0);
        for start in 1..=3 {
            network.sent += 300; // three seconds of silence
            if is_announced {
                network.watch.restart();
            }
            network.run(15, 0, start * -3_000_000, 0.0);
        }
        let report = network.watch.report().unwrap();
        assert_eq!((report.restarts, report.jump_count), (if is_announced { 3 } else { 0 }, 0), "{report:?}");
        let (drift_ppm, sure_ppm) = (report.drift_ppm.unwrap(), report.drift_uncertainty_ppm.unwrap());
        assert!((drift_ppm - 20.0).abs() < sure_ppm.max(5.0), "{drift_ppm} +- {sure_ppm}");
        assert_eq!(report.text().contains("started again 3 times"), is_announced, "{}", report.text());
    }
}

/// Frames every 100 ms, stamped quickly: it is plain which clock it was.
#[test]
fn the_clock_that_was_set_is_named() {
    let day_ns = 86_400_000_000_000;
    for (host_ns, device_ns, moved) in [
        (100 * day_ns, 0, Moved::Host),
        (-3_000_000_000, 0, Moved::Host),
        (150_000_000, 0, Moved::Host),
        (0, 100 * day_ns, Moved::Device),
        (0, -150_000_000, Moved::Device),
    ] {
        let mut watch = ClockWatch::default();
        for frame in 0..200_u64 {
            let [host_set_ns, device_set_ns] = if frame < 100 { [0, 0] } else { [host_ns, device_ns] };
            let late_ns = frame * 7919 % 300_000;
            watch.add(
                (HOST_NS + frame * 100_000_000 + late_ns).saturating_add_signed(host_set_ns),
                (DEVICE_NS + frame * 100_000_000).saturating_add_signed(device_set_ns),
            );
        }
        let report = watch.report().unwrap();
        let [jump] = report.jumps[..] else { panic!("{host_ns} {device_ns}: {report:?}") };
        assert_eq!(jump.moved, moved, "{host_ns} {device_ns}: {report:?}");
        let change_s = (host_ns - device_ns) as f64 * 1e-9;
        assert!((jump.change_s - change_s).abs() < 1e-3, "{report:?}");
        let set_at_ns = (HOST_NS + 10_000_000_000).saturating_add_signed(host_ns);
        assert!(jump.host_ns.abs_diff(set_at_ns) < 1_000_000, "when it happened: {report:?}");
    }
}

/// A clock that is set in its first second: too early for a line, too far for any delay.
#[test]
fn a_far_jump_needs_no_seconds_before_it() {
    for change_ns in [90_000_000_000_i64, -90_000_000_000] {
        let mut watch = ClockWatch::default();
        for frame in 0..12_u64 {
            let shift_ns = if frame < 4 { 0 } else { change_ns };
            watch.add(
                HOST_NS + frame * 100_000_000,
                (500_000_000_000 + frame * 100_000_000).saturating_add_signed(shift_ns),
            );
        }
        let report = watch.report().unwrap();
        let [jump] = report.jumps[..] else { panic!("{report:?}") };
        assert!((jump.change_s + change_ns as f64 * 1e-9).abs() < 1e-6, "{report:?}");
    }
}

/// A network that is 5 ms slower for half a minute moves no clock.
#[test]
fn a_slow_network_is_no_jump() {
    let mut network = Network::new(5, 10.0);
    network.run(60, 0, 0, 0.0);
    network.run(30, 0, 0, 5e6);
    network.run(60, 0, 0, 0.0);
    let report = network.watch.report().unwrap();
    assert_eq!(report.jumps.len(), 0, "{report:?}");
    assert!((report.drift_ppm.unwrap() - 10.0).abs() < 2.0, "{report:?}");
}

#[test]
fn any_times_are_accepted() {
    let mut watch = ClockWatch::default();
    let mut rng = Rng::new(1, 9);
    for _ in 0..5000 {
        watch.add(rng.bits() >> (rng.bits() % 64), rng.bits() >> (rng.bits() % 64));
    }
    assert!(watch.report().is_some());
    let _ = watch.host_ns(u64::MAX);
}
