//! What a servo axis measured of its own angle.

/// Two readings of an axis that stands still differ by this much at most where it does not say its uncertainty, rad.
const STANDS_WITHIN_RAD: f64 = 1e-3;

/// How far from the nearest reading an angle is still known, ns: a line to a rig is called lost before.
const KNOWN_WITHIN_NS: u64 = 5_000_000_000;
/// Times within a revolution at which the angle is sampled: an axis turns by degrees in one.
const KNOTS: usize = 5;

/// One reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TiltReading {
    /// When it was read, ns on the host's clock.
    pub time_ns: u64,
    /// The angle, rad.
    pub pitch_rad: f64,
    /// Half the width in which the true angle lies around it, rad, where the axis says so.
    pub uncertainty_rad: Option<f64>,
    /// The pitch, rad, that the axis holds; none while it moves.
    pub held_rad: Option<f64>,
}

/// Pitches of one axis over a recording.
#[derive(Clone, Debug, Default)]
pub struct TiltHistory {
    /// In order of time; those of one hold bear their mean.
    readings: Vec<TiltReading>,
    /// Host times in which the axis has no zero, ns: from the first to before the second.
    without_zero_ns: Vec<[u64; 2]>,
}

impl TiltHistory {
    /// From readings in any order. While an axis holds and its readings stay within their uncertainty it stands still,
    /// and what they scatter by is the encoder's step: their mean is nearer to the truth than each of them, and a
    /// prediction that followed each would cover cells on both sides of an edge that the sensor saw from one.
    pub(crate) fn new(mut readings: Vec<TiltReading>) -> Self {
        readings.sort_by_key(|reading| reading.time_ns);
        let mut rest = &mut readings[..];
        while !rest.is_empty() {
            let (hold, after) = rest.split_at_mut(standing(rest));
            let mean_rad = hold.iter().map(|reading| reading.pitch_rad).sum::<f64>() / hold.len() as f64;
            hold.iter_mut().for_each(|reading| reading.pitch_rad = mean_rad);
            rest = after;
        }
        Self { readings, without_zero_ns: Vec::new() }
    }

    /// In these host times the axis was not homed: no pitch is known.
    pub(crate) fn with_times_without_zero(mut self, times_ns: Vec<[u64; 2]>) -> Self {
        self.without_zero_ns = times_ns;
        self
    }

    /// Whether the axis was not homed at a host time.
    pub(crate) fn lacks_zero(&self, host_time_ns: u64) -> bool {
        self.without_zero_ns.iter().any(|[from_ns, to_ns]| (*from_ns..*to_ns).contains(&host_time_ns))
    }

    /// Pitch at a host time: the mean of the hold it lies in, a straight line between readings of an axis that moves, and
    /// the nearest one before the first and after the last. None where the nearest reading is seconds away, unless the
    /// axis held one angle from the reading before to the one behind, and while the axis was not homed.
    pub(crate) fn pitch_rad_at(&self, host_time_ns: u64) -> Option<f64> {
        if self.lacks_zero(host_time_ns) {
            return None;
        }
        let after = self.readings.partition_point(|reading| reading.time_ns <= host_time_ns);
        let before = after.checked_sub(1).map(|place| self.readings[place]);
        let is_near = |reading: &TiltReading| reading.time_ns.abs_diff(host_time_ns) <= KNOWN_WITHIN_NS;
        match (before, self.readings.get(after)) {
            (Some(from), Some(to)) => {
                let is_held = from.held_rad.is_some() && from.held_rad == to.held_rad;
                if !is_held && !is_near(&from) && !is_near(to) {
                    return None;
                }
                let share = (host_time_ns - from.time_ns) as f64 / (to.time_ns - from.time_ns) as f64;
                Some(from.pitch_rad + share * (to.pitch_rad - from.pitch_rad))
            }
            (Some(only), None) => is_near(&only).then_some(only.pitch_rad),
            (None, Some(only)) => is_near(only).then_some(only.pitch_rad),
            (None, None) => None,
        }
    }

    /// Pitch through a revolution: `host_ns` and `device_ns` are the times of its first and last column by the host's clock
    /// and by the sensor's. None where it is not known at some time of it.
    pub(crate) fn pitch_over(&self, host_ns: [u64; 2], device_ns: [u64; 2]) -> Option<FramePitch> {
        let span_ns = host_ns[1].saturating_sub(host_ns[0]);
        let at = |knot: usize| self.pitch_rad_at(host_ns[0] + span_ns / (KNOTS - 1) as u64 * knot as u64);
        let mut knots_rad = [0.0; KNOTS];
        for (knot, rad) in knots_rad.iter_mut().enumerate() {
            *rad = at(knot)?;
        }
        Some(FramePitch { knots_rad, device_ns })
    }

    /// Whether there is a reading.
    pub(crate) fn is_measured(&self) -> bool {
        !self.readings.is_empty()
    }

    /// Readings within a time of the host, ns.
    pub(crate) fn readings_within(&self, [first_ns, last_ns]: [u64; 2]) -> usize {
        let before = |time_ns: u64| self.readings.partition_point(|reading| reading.time_ns < time_ns);
        before(last_ns.saturating_add(1)).saturating_sub(before(first_ns))
    }

    /// How far the nearest reading is from a time of the host, ns.
    pub(crate) fn nearest_ns(&self, host_time_ns: u64) -> Option<u64> {
        self.readings.iter().map(|reading| reading.time_ns.abs_diff(host_time_ns)).min()
    }
}

/// Pitch of a sensor while it turned once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FramePitch {
    /// At even times of the revolution, rad.
    knots_rad: [f64; KNOTS],
    /// First and last column by the sensor's clock.
    device_ns: [u64; 2],
}

impl FramePitch {
    /// One pitch all along, rad.
    pub fn constant(pitch_rad: f64) -> Self {
        Self { knots_rad: [pitch_rad; KNOTS], device_ns: [0; 2] }
    }

    /// At a time of the sensor's clock, rad.
    pub(crate) fn at(&self, device_ns: u64) -> f64 {
        let [first_ns, last_ns] = self.device_ns;
        let span_ns = last_ns.saturating_sub(first_ns);
        if span_ns == 0 || self.is_constant() {
            return self.mean_rad();
        }
        let place =
            device_ns.saturating_sub(first_ns).min(span_ns) as f64 / span_ns as f64 * (KNOTS - 1) as f64;
        let knot = (place as usize).min(KNOTS - 2);
        let [from, to] = [self.knots_rad[knot], self.knots_rad[knot + 1]];
        from + (place - knot as f64) * (to - from)
    }

    /// Over the revolution, rad.
    pub(crate) fn mean_rad(&self) -> f64 {
        if self.is_constant() {
            return self.knots_rad[0];
        }
        self.knots_rad.iter().sum::<f64>() / KNOTS as f64
    }

    /// Minimum and maximum, rad.
    pub(crate) fn span_rad(&self) -> [f64; 2] {
        let fold = |pick: fn(f64, f64) -> f64| self.knots_rad.iter().copied().fold(self.knots_rad[0], pick);
        [fold(f64::min), fold(f64::max)]
    }

    /// Whether it is the same all along.
    pub(crate) fn is_constant(&self) -> bool {
        self.knots_rad.iter().all(|rad| *rad == self.knots_rad[0])
    }
}

/// How many readings from the first on are of one hold: the same pitch held, all within one uncertainty of each other on
/// either side. At least one.
fn standing(readings: &[TiltReading]) -> usize {
    let first = readings[0];
    let [mut min_rad, mut max_rad] = [first.pitch_rad; 2];
    let hold = readings.iter().take_while(|reading| {
        min_rad = min_rad.min(reading.pitch_rad);
        max_rad = max_rad.max(reading.pitch_rad);
        let within_rad = reading.uncertainty_rad.unwrap_or(STANDS_WITHIN_RAD / 2.0);
        reading.held_rad.is_some()
            && reading.held_rad == first.held_rad
            && max_rad - min_rad <= 2.0 * within_rad
    });
    hold.count().max(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reading(time_ns: u64, pitch_rad: f64, held_rad: Option<f64>) -> TiltReading {
        TiltReading { time_ns, pitch_rad, uncertainty_rad: Some(0.0004), held_rad }
    }

    #[test]
    fn between_readings_the_axis_moved_steadily() {
        let history = TiltHistory::new(vec![reading(300, 0.2, None), reading(100, 0.1, None)]);
        assert!((history.pitch_rad_at(200).unwrap() - 0.15).abs() < 1e-15);
        assert_eq!(history.pitch_rad_at(0), Some(0.1));
        assert_eq!(history.pitch_rad_at(900), Some(0.2));
        assert_eq!(TiltHistory::default().pitch_rad_at(5), None);
    }

    #[test]
    fn while_an_axis_has_no_zero_its_pitch_is_unknown() {
        let readings = vec![reading(300, 0.2, None), reading(400, 0.2, None)];
        let history = TiltHistory::new(readings).with_times_without_zero(vec![[0, 300], [401, u64::MAX]]);
        let at = [0, 299, 300, 400, 401, 9000].map(|time_ns| history.pitch_rad_at(time_ns));
        assert_eq!(at, [None, None, Some(0.2), Some(0.2), None, None]);
        assert_eq!(history.pitch_over([290, 310], [0, 1]), None);
    }

    #[test]
    fn an_axis_that_holds_stands_at_the_mean_of_its_readings() {
        let held = |time_ns, pitch_rad| reading(time_ns, pitch_rad, Some(0.2));
        let history = TiltHistory::new(vec![
            reading(100, 0.1, None),
            held(200, 0.2000),
            held(300, 0.2004),
            held(400, 0.2004),
            // pushed away: another stand
            held(500, 0.2100),
            held(600, 0.2100),
        ]);
        let mean_rad = (0.2 + 0.2004 + 0.2004) / 3.0;
        assert!(
            [200, 250, 399].iter().all(|at| (history.pitch_rad_at(*at).unwrap() - mean_rad).abs() < 1e-12)
        );
        assert!((history.pitch_rad_at(600).unwrap() - 0.21).abs() < 1e-12);
    }

    #[test]
    fn an_angle_is_known_near_readings_and_through_a_hold() {
        const S: u64 = 1_000_000_000;
        let history = TiltHistory::new(vec![
            reading(100 * S, 0.1, None),
            reading(200 * S, 0.2, Some(0.2)),
            reading(300 * S, 0.2, Some(0.2)),
        ]);
        let at = |seconds: u64| history.pitch_rad_at(seconds * S);
        assert_eq!([at(94), at(95), at(150)], [None, Some(0.1), None]);
        assert_eq!([at(250), at(305), at(306)], [Some(0.2), Some(0.2), None]);
        assert_eq!(
            (history.readings_within([150 * S, 300 * S]), history.nearest_ns(90 * S)),
            (2, Some(10 * S))
        );
    }

    #[test]
    fn a_revolution_of_an_axis_that_moves_has_an_angle_at_each_of_its_times() {
        let history =
            TiltHistory::new((0..50).map(|n| reading(1_000 + n * 20, 0.01 * n as f64, None)).collect());
        // the sensor counts from power-on
        let pitch = history.pitch_over([1_100, 1_200], [7, 107]).unwrap();
        for (device_ns, expected_rad) in
            [(0, 0.05), (7, 0.05), (32, 0.0625), (57, 0.075), (107, 0.1), (500, 0.1)]
        {
            let found_rad = pitch.at(device_ns);
            assert!((found_rad - expected_rad).abs() < 1e-12, "{device_ns}: {found_rad}");
        }
        assert!((pitch.mean_rad() - 0.075).abs() < 1e-12);
        assert_eq!(history.pitch_over([1_000, 9_000_000_000], [0, 1]), None);
    }
}
