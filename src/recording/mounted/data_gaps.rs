//! When each sensor sent data: a sensor with a gap covers less than predicted, though all that it recorded
//! agrees.

use crate::recording::fault::Fault;
use crate::rig::Rig;

/// Five revolutions at 10 Hz.
const MIN_GAP_NS: u64 = 500_000_000;

/// When the frames of one sensor were recorded, by its own clock.
#[derive(Clone, Debug, Default)]
pub(crate) struct DataSpan {
    span_ns: Option<[u64; 2]>,
    /// Between two frames.
    gaps_ns: Vec<[u64; 2]>,
}

impl DataSpan {
    /// Adds a frame by the times of its first and last column.
    pub(crate) fn add(&mut self, [first_ns, last_ns]: [u64; 2]) {
        let span_ns = self.span_ns.get_or_insert([first_ns, last_ns]);
        if first_ns.saturating_sub(span_ns[1]) >= MIN_GAP_NS {
            self.gaps_ns.push([span_ns[1], first_ns]);
        }
        *span_ns = [span_ns[0].min(first_ns), span_ns[1].max(last_ns)];
    }

    /// The longest gap within a stretch of time, where there is one.
    fn longest_gap_ns(&self, [from_ns, to_ns]: [u64; 2]) -> Option<[u64; 2]> {
        let [first_ns, last_ns] = self.span_ns?;
        let ends = [[from_ns, first_ns], [last_ns, to_ns]];
        let all = self.gaps_ns.iter().chain(&ends);
        let within = all.map(|gap| [gap[0].max(from_ns), gap[1].min(to_ns)]);
        let lasts_ns = |[begin_ns, end_ns]: &[u64; 2]| end_ns.saturating_sub(*begin_ns);
        within.max_by_key(lasts_ns).filter(|gap| lasts_ns(gap) >= MIN_GAP_NS)
    }
}

/// Two sensors that never sent data at once, and how long after the end of the first the second begins, s.
pub(crate) fn apart<'a>(rig: &'a Rig, data_spans: &[DataSpan]) -> Option<([&'a str; 2], f64)> {
    let mut spans: Vec<([u64; 2], &str)> = rig
        .sensors
        .iter()
        .zip(data_spans)
        .filter_map(|(sensor, data_span)| Some((data_span.span_ns?, sensor.name.as_str())))
        .collect();
    spans.sort_unstable();
    spans.windows(2).find_map(|pair| {
        let [([_, end_ns], first), ([begin_ns, _], second)] = [pair[0], pair[1]];
        (begin_ns > end_ns).then(|| ([first, second], (begin_ns - end_ns) as f64 * 1e-9))
    })
}

/// Sensors without data for a while between the first and the last frame of any and within the trajectory's
/// time on the recording's clock. Sensors without any frame are left out.
pub(crate) fn data_gaps(rig: &Rig, data_spans: &[DataSpan], trajectory_ns: [u64; 2]) -> Vec<Fault> {
    let spans = || data_spans.iter().filter_map(|data_span| data_span.span_ns);
    let Some((first_ns, last_ns)) = spans().map(|s| s[0]).min().zip(spans().map(|s| s[1]).max()) else {
        return Vec::new();
    };
    let recorded_ns = [first_ns.max(trajectory_ns[0]), last_ns.min(trajectory_ns[1])];
    let silent = rig.sensors.iter().zip(data_spans).filter_map(|(sensor, data_span)| {
        let [begin_ns, end_ns] = data_span.longest_gap_ns(recorded_ns)?;
        let at_s = |time_ns: u64| (time_ns - recorded_ns[0]) as f64 * 1e-9;
        let when = match (begin_ns == recorded_ns[0], end_ns == recorded_ns[1]) {
            (false, true) => format!("from {:.1} s on", at_s(begin_ns)),
            (true, _) => format!("before {:.1} s", at_s(end_ns)),
            (false, false) => format!("between {:.1} and {:.1} s", at_s(begin_ns), at_s(end_ns)),
        };
        let words = format!("{} sends nothing {when}, of {:.1} s", sensor.name, at_s(recorded_ns[1]));
        Some(Fault::new("silent_sensor", vec![sensor.name.clone()], words))
    });
    silent.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const TENTH_NS: u64 = 100_000_000;

    fn data_span(revolutions: impl Iterator<Item = u64>) -> DataSpan {
        let mut data_span = DataSpan::default();
        revolutions.for_each(|at| data_span.add([at * TENTH_NS, (at + 1) * TENTH_NS - 1]));
        data_span
    }

    #[test]
    fn short_pauses_are_no_gaps() {
        let within = |from: u64, to: u64| [from * TENTH_NS, to * TENTH_NS];
        let dies = data_span(10..50);
        assert_eq!(dies.longest_gap_ns(within(10, 110)), Some([50 * TENTH_NS - 1, 110 * TENTH_NS]));
        assert_eq!(dies.longest_gap_ns(within(0, 50)), Some([0, 10 * TENTH_NS]));
        let pauses = data_span((10..30).chain(40..50));
        assert_eq!(pauses.longest_gap_ns(within(10, 50)), Some([30 * TENTH_NS - 1, 40 * TENTH_NS]));
        assert_eq!(pauses.longest_gap_ns(within(10, 30)), None);
        let lossy = data_span((10..50).filter(|at| at % 4 != 0));
        assert_eq!(lossy.longest_gap_ns(within(10, 52)), None);
        assert_eq!(DataSpan::default().longest_gap_ns(within(0, 50)), None);
    }
}
