//! What a servo axis measured of its own angle.

/// Two readings of an axis that stands still differ by this much at most where it does not say its uncertainty, rad.
const STANDS_WITHIN_RAD: f64 = 1e-3;

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
    span_rad: Option<[f64; 2]>,
    /// The pitch that counts where the axis has no zero, rad, and these times, ns: from the first to before the second.
    nominal: Option<(f64, Vec<[u64; 2]>)>,
}

impl TiltHistory {
    /// From readings in any order. While an axis holds and its readings stay within their uncertainty it stands still,
    /// and what they scatter by is the encoder's step: their mean is nearer to the truth than each of them, and a
    /// prediction that followed each would cover cells on both sides of an edge that the sensor saw from one.
    pub fn new(mut readings: Vec<TiltReading>) -> Self {
        readings.sort_by_key(|reading| reading.time_ns);
        let pitches = || readings.iter().map(|reading| reading.pitch_rad);
        let span_rad = pitches().reduce(f64::min).zip(pitches().reduce(f64::max)).map(<[f64; 2]>::from);
        let mut rest = &mut readings[..];
        while !rest.is_empty() {
            let (hold, after) = rest.split_at_mut(standing(rest));
            let mean_rad = hold.iter().map(|reading| reading.pitch_rad).sum::<f64>() / hold.len() as f64;
            hold.iter_mut().for_each(|reading| reading.pitch_rad = mean_rad);
            rest = after;
        }
        Self { readings, span_rad, nominal: None }
    }

    /// Another pitch counts in these times: the axis was not homed.
    pub fn set_nominal(&mut self, pitch_rad: f64, times_ns: Vec<[u64; 2]>) {
        self.nominal = Some((pitch_rad, times_ns));
    }

    /// Pitch at a host time: the mean of the hold it lies in, a straight line between readings of an axis that moves,
    /// and the nearest one outside all of them; none without a reading.
    pub fn pitch_rad_at(&self, host_time_ns: u64) -> Option<f64> {
        if let Some((pitch_rad, times_ns)) = &self.nominal
            && times_ns.iter().any(|[from_ns, to_ns]| (*from_ns..*to_ns).contains(&host_time_ns))
        {
            return Some(*pitch_rad);
        }
        let after = self.readings.partition_point(|reading| reading.time_ns <= host_time_ns);
        let before = after.checked_sub(1).map(|place| self.readings[place]);
        match (before, self.readings.get(after)) {
            (Some(from), Some(to)) => {
                let share = (host_time_ns - from.time_ns) as f64 / (to.time_ns - from.time_ns) as f64;
                Some(from.pitch_rad + share * (to.pitch_rad - from.pitch_rad))
            }
            (Some(last), None) => Some(last.pitch_rad),
            (None, Some(first)) => Some(first.pitch_rad),
            (None, None) => None,
        }
    }

    /// Least and greatest reading, rad.
    pub fn span_rad(&self) -> Option<[f64; 2]> {
        self.span_rad
    }
}

/// How many readings from the first on are of one hold: the same pitch held, all within one uncertainty of each other on
/// either side. At least one.
fn standing(readings: &[TiltReading]) -> usize {
    let first = readings[0];
    let [mut least, mut greatest] = [first.pitch_rad; 2];
    let hold = readings.iter().take_while(|reading| {
        least = least.min(reading.pitch_rad);
        greatest = greatest.max(reading.pitch_rad);
        let within_rad = reading.uncertainty_rad.unwrap_or(STANDS_WITHIN_RAD / 2.0);
        reading.held_rad.is_some()
            && reading.held_rad == first.held_rad
            && greatest - least <= 2.0 * within_rad
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
        assert_eq!(history.span_rad(), Some([0.1, 0.2]));
        assert_eq!(TiltHistory::default().pitch_rad_at(5), None);
    }

    #[test]
    fn while_an_axis_has_no_zero_the_nominal_pitch_counts() {
        let mut history = TiltHistory::new(vec![reading(300, 0.2, None), reading(400, 0.2, None)]);
        history.set_nominal(0.5, vec![[0, 300], [401, u64::MAX]]);
        let at = [0, 299, 300, 400, 401, 9000].map(|time_ns| history.pitch_rad_at(time_ns).unwrap());
        assert_eq!(at, [0.5, 0.5, 0.2, 0.2, 0.5, 0.5]);
        assert_eq!(history.span_rad(), Some([0.2; 2]), "of what was measured");
    }

    #[test]
    fn an_axis_that_holds_stands_at_the_mean_of_its_readings() {
        let held = |time_ns, pitch_rad| reading(time_ns, pitch_rad, Some(0.2));
        let history = TiltHistory::new(vec![
            reading(100, 0.1, None),
            held(200, 0.2000),
            held(300, 0.2004),
            held(400, 0.2004),
            // pushed aside: another stand
            held(500, 0.2100),
            held(600, 0.2100),
        ]);
        let mean_rad = (0.2 + 0.2004 + 0.2004) / 3.0;
        assert!(
            [200, 250, 399].iter().all(|at| (history.pitch_rad_at(*at).unwrap() - mean_rad).abs() < 1e-12)
        );
        assert!((history.pitch_rad_at(600).unwrap() - 0.21).abs() < 1e-12);
        assert_eq!(history.span_rad(), Some([0.1, 0.21]), "as read");
    }
}
