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
    pub fn rate(&self) -> Option<f64> {
        (self.time_ns > 0.0).then(|| self.travelled_counts / self.time_ns)
    }

    pub fn add(&mut self, other: Self) {
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
    azimuths: Vec<u16>,
}

/// A step from block to block, counts; slow or jittering spin can step back a little.
pub(crate) fn step_counts(from: u16, to: u16) -> f64 {
    let turn = i32::from(AZIMUTH_COUNTS);
    let step = (i32::from(to) - i32::from(from)).rem_euclid(turn);
    f64::from(if step >= turn - MOST_BACK { step - turn } else { step })
}

/// Greatest jitter against the spin, counts.
const MOST_BACK: i32 = 100;

/// Whether a step between neighbours is a gap: much wider than the usual one.
pub(crate) fn is_gap(step: f64, usual: f64) -> bool {
    step > 3.0 * usual.max(0.0) + 20.0
}

/// What follows a packet, as far as it is known.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Following {
    /// Device time of its first sequence, ns.
    pub time_ns: u64,
    /// Azimuth of its first block, counts.
    pub azimuth_counts: u16,
}

impl Heads {
    /// Fills in the heads of a packet whose first sequence began at `time_ns`. `spin` is what is known of the rate
    /// from before; `following` dates the sequences behind an azimuth gap exactly, because a packet has one stamp
    /// and the sensor's clock runs on while no laser fires.
    pub fn fill(
        &mut self,
        packet: DataPacket<'_>,
        layout: &Layout,
        cycle_ns: f64,
        time_ns: u64,
        spin: Spin,
        following: Option<Following>,
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
            _ => usual_step(&mut self.steps.clone()),
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
        let mut last_gap = None;
        let mut block = 0;
        for (place, sequence) in sequences.iter().enumerate() {
            if sequence.after_azimuth == 0 {
                if block > 0 && is_gap(self.steps[block - 1], usual) {
                    let wider = self.steps[block - 1] - rate_for_gaps * block_ns;
                    gap_ns += if rate_for_gaps > 0.0 { wider / rate_for_gaps } else { 0.0 };
                    self.gaps.push([self.azimuths[block - 1], self.azimuths[block]]);
                    last_gap = Some(place);
                }
                block += 1;
            }
            let after_ns = f64::from(sequence.after_azimuth) * cycle_ns;
            let azimuth = f64::from(self.azimuths[block - 1]) + rate * after_ns;
            let cycles_ns = f64::from(sequence.cycles) * cycle_ns;
            self.heads.push(Head {
                time_ns: time_ns + (cycles_ns + gap_ns).round() as u64,
                azimuth_counts: azimuth.rem_euclid(f64::from(AZIMUTH_COUNTS)),
            });
        }
        self.first_counts = self.azimuths.first().copied().unwrap_or(0);
        self.last_counts = self.azimuths.last().copied().unwrap_or(0);
        let length_ns = sequences.last().map_or(0.0, |s| f64::from(s.cycles) + 1.0) * cycle_ns;
        self.end_ns = time_ns + (length_ns + gap_ns).round() as u64;
        if let (Some(gap), Some(following)) = (last_gap, following) {
            self.date_from(gap, length_ns, following, usual, rate_for_gaps, layout, cycle_ns);
        }
    }

    /// Blocks with an azimuth of their own.
    pub fn blocks(&self) -> usize {
        self.azimuths.len()
    }

    /// Dates the sequences from `gap` on by the packet that follows them without another gap.
    #[allow(clippy::too_many_arguments)]
    fn date_from(
        &mut self,
        gap: usize,
        length_ns: f64,
        following: Following,
        usual: f64,
        rate: f64,
        layout: &Layout,
        cycle_ns: f64,
    ) {
        let contiguous = !is_gap(step_counts(self.last_counts, following.azimuth_counts), usual);
        let turn_ns = f64::from(AZIMUTH_COUNTS) / rate.max(f64::MIN_POSITIVE);
        let off_ns = following.time_ns.abs_diff(self.end_ns) as f64;
        if !contiguous || off_ns > 0.25 * turn_ns {
            return;
        }
        self.end_ns = following.time_ns;
        for (head, sequence) in self.heads.iter_mut().zip(&layout.sequences).skip(gap) {
            let before_end_ns = length_ns - f64::from(sequence.cycles) * cycle_ns;
            head.time_ns = following.time_ns.saturating_sub(before_end_ns.round() as u64);
        }
    }
}

/// The (lower) median of the steps: a gap among them does not move it.
fn usual_step(steps: &mut [f64]) -> f64 {
    steps.sort_by(f64::total_cmp);
    steps[(steps.len() - 1) / 2]
}

/// Encoder azimuth in rad, in [0, 2 pi).
pub(crate) fn azimuth_rad(counts: f64) -> f64 {
    let azimuth_rad = counts * (TAU / f64::from(AZIMUTH_COUNTS));
    if azimuth_rad >= TAU { 0.0 } else { azimuth_rad }
}
