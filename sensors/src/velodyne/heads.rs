//! Time and azimuth of each firing sequence of a packet.

use std::f64::consts::TAU;

use super::wire::{AZIMUTH_COUNTS, DataPacket, Layout};

/// When and where a firing sequence began.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Head {
    /// Device time, ns.
    pub time_ns: u64,
    /// Encoder azimuth, counts of 0.01 degree, in [0, 36000).
    pub azimuth_counts: f64,
}

/// What a packet says about the spin.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Spin {
    /// Azimuth travelled over contiguous blocks, counts.
    pub travelled_counts: f64,
    /// Time that took, ns.
    pub time_ns: f64,
}

impl Spin {
    /// Counts per ns, once something was travelled.
    pub(crate) fn rate(&self) -> Option<f64> {
        (self.time_ns > 0.0).then(|| self.travelled_counts / self.time_ns)
    }

    pub(crate) fn add(&mut self, other: Self) {
        self.travelled_counts += other.travelled_counts;
        self.time_ns += other.time_ns;
    }
}

/// Heads of one packet and how it travels.
#[derive(Clone, Debug, Default)]
pub(crate) struct Heads {
    pub heads: Vec<Head>,
    /// Azimuth of the first and the last block, counts.
    pub first_counts: u16,
    pub last_counts: u16,
    /// Azimuth from the first to the last block, gaps included, counts.
    pub travelled_counts: f64,
    /// Contiguous travel.
    pub spin: Spin,
    /// Azimuths on both sides of each gap.
    pub gaps: Vec<[u16; 2]>,
    /// Time of the sequence that follows the packet's last without a gap, ns.
    pub end_ns: u64,
    steps: Vec<f64>,
    sorted_steps: Vec<f64>,
    azimuths: Vec<u16>,
}

/// A step from block to block, counts; slow or jittering spin can step back a little.
pub(crate) fn step_counts(from: u16, to: u16) -> f64 {
    let turn = i32::from(AZIMUTH_COUNTS);
    let step = (i32::from(to) - i32::from(from)).rem_euclid(turn);
    f64::from(if step >= turn - MOST_BACK { step - turn } else { step })
}

/// Most jitter against the spin, counts.
const MOST_BACK: i32 = 100;

/// Whether a step between neighbours is a gap: much wider than the usual one.
pub(crate) fn is_gap(step: f64, usual: f64) -> bool {
    step > 3.0 * usual.max(0.0) + 20.0
}

/// When and where a packet starts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Start {
    /// Device time of its first sequence (of its stamp, until the lead of the stamp is subtracted), ns.
    pub time_ns: u64,
    /// Azimuth of its first block, counts.
    pub azimuth_counts: u16,
}

impl Heads {
    /// Fills in the heads of a packet with its first sequence at `time_ns`. `spin` is what is known of the rate
    /// from before; `following` dates the sequences behind an azimuth gap exactly, because a packet has one stamp
    /// and the sensor's clock runs on while no laser fires. A gap never makes heads run backward,
    /// nor brings them past `following`.
    pub(crate) fn fill(
        &mut self,
        packet: DataPacket<'_>,
        layout: &Layout,
        cycle_ns: f64,
        time_ns: u64,
        spin: Spin,
        following: Option<Start>,
    ) {
        let sequences = &layout.sequences;
        self.heads.clear();
        self.gaps.clear();
        self.azimuths.clear();
        self.azimuths.extend(
            sequences.iter().filter(|s| s.after_azimuth == 0).map(|s| packet.azimuth(usize::from(s.block))),
        );
        let cycles_per_block = (sequences.len() / self.azimuths.len().max(1)).max(1) as f64;
        let block_ns = cycles_per_block * cycle_ns;

        self.steps.clear();
        self.steps.extend(self.azimuths.windows(2).map(|pair| step_counts(pair[0], pair[1])));
        let known = spin.rate().map(|rate| rate * block_ns);
        let usual = match (known, self.steps.len()) {
            (Some(step), 0..=3) => step,
            (_, 0) => 0.0,
            _ => {
                self.sorted_steps.clone_from(&self.steps);
                usual_step(&mut self.sorted_steps)
            }
        };
        self.spin = Spin::default();
        self.travelled_counts = 0.0;
        for step in &self.steps {
            self.travelled_counts += step;
            if !is_gap(*step, usual) {
                self.spin.add(Spin { travelled_counts: *step, time_ns: block_ns });
            }
        }
        let rate = self.spin.rate().or(spin.rate()).unwrap_or(0.0);
        // the longer record is the better one where a gap of half a turn is turned into time
        let rate_for_gaps = if spin.time_ns > self.spin.time_ns { spin.rate().unwrap_or(rate) } else { rate };

        let mut gap_ns = 0.0;
        let mut gap_places = None;
        let mut block = 0;
        for (place, sequence) in sequences.iter().enumerate() {
            if sequence.after_azimuth == 0 {
                if block > 0 && is_gap(self.steps[block - 1], usual) {
                    let wider = self.steps[block - 1] - rate_for_gaps * block_ns;
                    gap_ns += if rate_for_gaps > 0.0 { wider / rate_for_gaps } else { 0.0 };
                    self.gaps.push([self.azimuths[block - 1], self.azimuths[block]]);
                    let (first, _) = gap_places.unwrap_or((place, place));
                    gap_places = Some((first, place));
                }
                block += 1;
            }
            let after_ns = f64::from(sequence.after_azimuth) * cycle_ns;
            let azimuth = f64::from(self.azimuths[block - 1]) + rate * after_ns;
            let cycles_ns = f64::from(sequence.cycles) * cycle_ns;
            self.heads.push(Head {
                time_ns: time_ns + nearest(cycles_ns + gap_ns),
                azimuth_counts: in_turn(azimuth),
            });
        }
        self.first_counts = self.azimuths.first().copied().unwrap_or(0);
        self.last_counts = self.azimuths.last().copied().unwrap_or(0);
        let length_ns = sequences.last().map_or(0.0, |s| f64::from(s.cycles) + 1.0) * cycle_ns;
        self.end_ns = time_ns + nearest(length_ns + gap_ns);
        if let (Some(places), Some(following)) = (gap_places, following) {
            let contiguous = !is_gap(step_counts(self.last_counts, following.azimuth_counts), usual);
            let turn_ns = f64::from(AZIMUTH_COUNTS) / rate_for_gaps.max(f64::MIN_POSITIVE);
            // contiguous but much later: whole turns were lost in between
            let late_ns = following.time_ns.saturating_sub(self.end_ns) as f64;
            let exact = contiguous && late_ns <= 0.25 * turn_ns;
            self.date_behind(places, [time_ns, following.time_ns], length_ns, exact, layout, cycle_ns);
        }
    }

    /// Blocks with an azimuth of their own.
    pub(crate) fn blocks(&self) -> usize {
        self.azimuths.len()
    }

    /// Dates the sequences behind the first of the gaps so that they end before the next packet begins, and those
    /// behind the last so that they end just there if it follows on them `exact`ly. The width of a gap is no measure
    /// of its time then: the stamps, of this packet and the next, say how long it took.
    fn date_behind(
        &mut self,
        (first_gap, last_gap): (usize, usize),
        [time_ns, next_ns]: [u64; 2],
        length_ns: f64,
        exact: bool,
        layout: &Layout,
        cycle_ns: f64,
    ) {
        let date = |dated_ns: u64, since_start_ns: f64, place: usize| {
            let without_gap_ns = time_ns + since_start_ns.round() as u64;
            let before_next_ns = next_ns.saturating_sub((length_ns - since_start_ns).round() as u64);
            let dated_ns =
                if exact && place >= last_gap { before_next_ns } else { dated_ns.min(before_next_ns) };
            dated_ns.max(without_gap_ns)
        };
        for (place, sequence) in layout.sequences.iter().enumerate().skip(first_gap) {
            let head = &mut self.heads[place];
            head.time_ns = date(head.time_ns, f64::from(sequence.cycles) * cycle_ns, place);
        }
        self.end_ns = date(self.end_ns, length_ns, layout.sequences.len());
    }
}

/// The nearest whole number of a time that is not negative; halves up.
fn nearest(time_ns: f64) -> u64 {
    (time_ns + 0.5) as u64
}

/// An azimuth in [0, 36000); most lie there, or one turn above.
fn in_turn(azimuth_counts: f64) -> f64 {
    let turn = f64::from(AZIMUTH_COUNTS);
    if (0.0..turn).contains(&azimuth_counts) {
        azimuth_counts
    } else if (turn..2.0 * turn).contains(&azimuth_counts) {
        azimuth_counts - turn
    } else {
        azimuth_counts.rem_euclid(turn)
    }
}

/// The (lower) median of the steps: a gap among them does not move it.
fn usual_step(steps: &mut [f64]) -> f64 {
    let middle = (steps.len() - 1) / 2;
    *steps.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Encoder azimuth in rad, in [0, 2 pi).
pub(crate) fn azimuth_rad(counts: f64) -> f64 {
    let azimuth_rad = counts * (TAU / f64::from(AZIMUTH_COUNTS));
    if azimuth_rad >= TAU { 0.0 } else { azimuth_rad }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::velodyne::product::Product;
    use crate::velodyne::wire::{BLOCK_BYTES, BLOCKS, DATA_PACKET_BYTES};

    const CYCLE_NS: f64 = 55_296.0;
    const RATE: Spin = Spin { travelled_counts: 21_000.0, time_ns: 1000.0 * CYCLE_NS };

    /// Heads of a dual-return packet of a VLP-32C at time 1 s, stamps and all.
    fn dated(azimuths: [u16; BLOCKS / 2], following: Option<Start>) -> Heads {
        let mut payload = [0; DATA_PACKET_BYTES];
        for (block, azimuth) in azimuths.iter().flat_map(|azimuth| [azimuth; 2]).enumerate() {
            payload[block * BLOCK_BYTES + 2..][..2].copy_from_slice(&azimuth.to_le_bytes());
        }
        let mut heads = Heads::default();
        let layout = Layout::of(Product::Vlp32c, true);
        heads.fill(DataPacket::of(&payload), &layout, CYCLE_NS, START_NS, RATE, following);
        heads
    }

    fn after_start_ns(heads: &Heads) -> Vec<u64> {
        heads.heads.iter().map(|head| head.time_ns - START_NS).collect()
    }

    const START_NS: u64 = 1_000_000_000;
    const WITHOUT_GAP_NS: [u64; 6] = [0, 55_296, 110_592, 165_888, 221_184, 276_480];
    const WINDOW: [u16; 6] = [9013, 9034, 9054, 9074, 9094, 27_014];

    #[test]
    fn the_next_stamp_dates_what_lies_behind_a_gap() {
        for pause_ns in [0, 5_000_000, 47_000_000, 50_000_000] {
            let next = Start { time_ns: START_NS + 331_776 + pause_ns, azimuth_counts: 27_035 };
            let heads = dated(WINDOW, Some(next));
            let times = after_start_ns(&heads);
            assert_eq!(times[..5], WITHOUT_GAP_NS[..5]);
            assert_eq!(times[5], 276_480 + pause_ns);
            assert_eq!(heads.end_ns, next.time_ns);
        }
        let alone = after_start_ns(&dated(WINDOW, None));
        assert!((46_000_000..48_000_000).contains(&alone[5]), "{alone:?}");
    }

    #[test]
    fn no_gap_reaches_past_the_next_packet() {
        // another gap behind the packet: its stamp is a bound still
        let next = Start { time_ns: START_NS + 1_331_776, azimuth_counts: 30_000 };
        let heads = dated(WINDOW, Some(next));
        assert_eq!(after_start_ns(&heads)[5], 1_276_480);
        // two gaps in one packet
        let next = Start { time_ns: START_NS + 331_776, azimuth_counts: 27_035 };
        let heads = dated([9013, 9034, 12_000, 12_021, 12_042, 27_014], Some(next));
        assert_eq!(after_start_ns(&heads), WITHOUT_GAP_NS);
        // stamps closer than the firings of a packet: no gap is left, and firings keep their order
        let next = Start { time_ns: START_NS + 200_000, azimuth_counts: 27_035 };
        assert_eq!(after_start_ns(&dated(WINDOW, Some(next))), WITHOUT_GAP_NS);
    }

    #[test]
    fn a_turn_lost_behind_a_gap_is_not_the_gaps() {
        let next = Start { time_ns: START_NS + 47_000_000 + 94_793_143, azimuth_counts: 27_035 };
        let heads = dated(WINDOW, Some(next));
        assert_eq!(after_start_ns(&heads), after_start_ns(&dated(WINDOW, None)));
    }
}
