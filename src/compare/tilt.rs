//! The tilt of a sensor's axis over the recording, from what the axis measured.

/// Measured pitches over host time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TiltHistory {
    /// Host time in ns and pitch in rad, in order of time.
    measured: Vec<(u64, f64)>,
}

impl TiltHistory {
    /// From reports in any order.
    pub fn new(mut measured: Vec<(u64, f64)>) -> Self {
        measured.sort_by_key(|report| report.0);
        Self { measured }
    }

    /// Pitch at a host time, straight line between reports and the nearest one outside them; none without a report.
    pub fn pitch_rad_at(&self, host_time_ns: u64) -> Option<f64> {
        let after = self.measured.partition_point(|report| report.0 <= host_time_ns);
        let before = after.checked_sub(1).map(|place| self.measured[place]);
        match (before, self.measured.get(after)) {
            (Some((from_ns, from_rad)), Some((to_ns, to_rad))) => {
                let share = (host_time_ns - from_ns) as f64 / (to_ns - from_ns) as f64;
                Some(from_rad + share * (to_rad - from_rad))
            }
            (Some(last), None) => Some(last.1),
            (None, Some(first)) => Some(first.1),
            (None, None) => None,
        }
    }

    /// Least and greatest pitch, rad.
    pub fn span_rad(&self) -> Option<[f64; 2]> {
        let pitches = || self.measured.iter().map(|report| report.1);
        Some([pitches().reduce(f64::min)?, pitches().reduce(f64::max)?])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn between_reports_the_axis_moved_steadily() {
        let history = TiltHistory::new(vec![(300, 0.2), (100, 0.1)]);
        assert!((history.pitch_rad_at(200).unwrap() - 0.15).abs() < 1e-15);
        assert_eq!(history.pitch_rad_at(0), Some(0.1));
        assert_eq!(history.pitch_rad_at(900), Some(0.2));
        assert_eq!(history.span_rad(), Some([0.1, 0.2]));
        assert_eq!(TiltHistory::default().pitch_rad_at(5), None);
    }
}
