//! What the packets of a sensor show of its settings, held against what its metadata say: a file of another day describes the
//! sensor as it was set then, and packets are the truth.

use super::metadata::Metadata;
use super::wire::{ColumnHeader, PacketFormat};

/// Columns of one revolution that sensors can be set to.
const COLUMNS: [usize; 4] = [512, 1024, 2048, 4096];
/// Revolutions per second that sensors can be set to, and what goes together.
const RATES_HZ: [f64; 3] = [5.0, 10.0, 20.0];
const MODES: [(usize, f64); 6] =
    [(512, 10.0), (512, 20.0), (1024, 10.0), (1024, 20.0), (2048, 10.0), (4096, 5.0)];
/// Times between columns that are looked at, and how many must agree.
const MOST_PERIODS: usize = 31;
const LEAST_PERIODS: usize = 3;
/// Revolutions that are looked at.
const MOST_TURNS: usize = 8;
/// How far a rate may be from one that a sensor can be set to.
const RATE_TOLERANCE: f64 = 0.04;
/// How far the time between columns may be from the metadata's: the next mode is a factor of two away.
const PERIOD_TOLERANCE: f64 = 0.25;
/// Packets that are farther apart in time have a pause between them, ns.
const LONGEST_GAP_NS: f64 = 1e9;
/// Words of a bitmap of columns.
const WORDS: usize = COLUMNS[3] / 64;

/// One setting that metadata and packets do not agree on; the packets count.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Correction {
    /// Its name in metadata.
    pub setting: &'static str,
    /// What the metadata say.
    pub stated: String,
    /// What the packets show.
    pub found: String,
    /// Host time from which they show it, UTC ns; `None` where that is so from the first packet on.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub since_ns: Option<u64>,
}

/// How a packet does not continue what the sensor sent before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Break {
    /// After a pause or another initialization, or its columns follow each other at another pace.
    Segment,
    /// The revolution before had another number of columns.
    Turn,
}

/// Columns per revolution and revolutions per second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Mode {
    pub columns: usize,
    pub rate_hz: f64,
}

impl Mode {
    pub(crate) fn of(metadata: &Metadata) -> Self {
        Self { columns: metadata.columns_per_frame, rate_hz: metadata.frame_rate_hz }
    }
}

/// The first lidar packets of a sensor since it was initialised.
#[derive(Debug)]
pub(super) struct Evidence {
    init_id: Option<u32>,
    last: Option<Seen>,
    /// Times between neighbouring columns, ns.
    periods_ns: Vec<f64>,
    /// The time that most of them agree on, ns.
    period_ns: Option<f64>,
    /// From a packet to the first of the next revolution: time, ns, and how far its column is behind.
    turns: Vec<[f64; 2]>,
    max_column: usize,
    frames: usize,
    newest: Option<u32>,
    /// Valid columns of all revolutions.
    columns: [u64; WORDS],
    /// Revolutions that were there from their first packet to that of the next.
    whole_frames: usize,
}

/// Where a lidar packet begins.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    pub frame_id: u32,
    column: usize,
    time_ns: u64,
}

impl Seen {
    pub(crate) fn of(format: &PacketFormat, frame_id: u32, packet: &[u8]) -> Self {
        let first = format.read_column(format.column(packet, 0));
        Self { frame_id, column: usize::from(first.measurement_id), time_ns: first.time_ns }
    }

    fn is_of_next_frame(&self, last: &Self, frame_ids: u64) -> bool {
        (u64::from(last.frame_id) + 1) % frame_ids == u64::from(self.frame_id)
    }
}

impl Default for Evidence {
    fn default() -> Self {
        Self {
            init_id: None,
            last: None,
            periods_ns: Vec::new(),
            period_ns: None,
            turns: Vec::new(),
            max_column: 0,
            frames: 0,
            newest: None,
            columns: [0; WORDS],
            whole_frames: 0,
        }
    }
}

impl Evidence {
    /// Whether a packet can still show something.
    pub(crate) fn is_open_to(&self, init_id: u32) -> bool {
        self.frames < MOST_TURNS || self.init_id != Some(init_id)
    }

    /// Whether a revolution was seen to its end: how many columns it has is known.
    pub(crate) fn has_turned(&self) -> bool {
        self.frames > 0
    }

    /// How a packet does not continue those before it, once a revolution of them was seen.
    pub(crate) fn broken(&self, metadata: &Metadata, init_id: u32, seen: &Seen) -> Option<Break> {
        let (Some(last), Some(period_ns), true) = (self.last, self.period_ns, self.is_decided()) else {
            return None;
        };
        let known = metadata.columns_per_frame;
        let elapsed_ns = seen.time_ns.wrapping_sub(last.time_ns) as i64 as f64;
        if self.init_id != Some(init_id) || seen.column >= known || elapsed_ns.abs() > LONGEST_GAP_NS {
            return Some(Break::Segment);
        }
        let columns = seen.column as f64 - last.column as f64;
        if last.frame_id == seen.frame_id {
            let is_off = || !keeps_pace(elapsed_ns, columns, period_ns);
            return (columns > 0.0 && elapsed_ns > 0.0 && is_off()).then_some(Break::Segment);
        }
        // through column 0 the counter may step at either end of the window
        let [first, end] = metadata.column_window;
        let frame_ids = metadata.packet_format().header.frame_ids();
        let is_next = seen.is_of_next_frame(&last, frame_ids);
        let other = || nearest_columns(elapsed_ns / period_ns - columns).is_some_and(|turn| turn != known);
        (is_next && first <= end && other()).then_some(Break::Turn)
    }

    /// A packet that shows nothing new: the next is held against it.
    pub(crate) fn follow(&mut self, seen: Seen) {
        self.last = Some(seen);
    }

    /// The revolution before this packet had another number of columns than those before it.
    pub(crate) fn forget_turns(&mut self) {
        let Self { init_id, last, periods_ns, period_ns, .. } = std::mem::take(self);
        *self = Self { init_id, last, periods_ns, period_ns, ..Self::default() };
    }

    /// Whether the mode is known: by a revolution's end, and by the time between columns.
    pub(crate) fn is_decided(&self) -> bool {
        self.has_turned() && self.period_ns.is_some()
    }

    /// Takes a lidar packet whose columns follow one another.
    pub(crate) fn take(&mut self, format: &PacketFormat, seen: Seen, init_id: u32, packet: &[u8]) {
        if self.init_id != Some(init_id) {
            *self = Self { init_id: Some(init_id), ..Self::default() };
        }
        if seen.column + format.columns_per_packet > COLUMNS[3] {
            return;
        }
        let last = self.last.replace(seen);
        let fits = last.is_none_or(|last| self.compare(last, seen, format.header.frame_ids()));
        if !fits {
            return;
        }
        for index in 0..format.columns_per_packet {
            let ColumnHeader { measurement_id, valid, .. } = format.read_column(format.column(packet, index));
            let column = usize::from(measurement_id);
            if valid && column < COLUMNS[3] {
                self.columns[column / 64] |= 1 << (column % 64);
                self.max_column = self.max_column.max(column);
            }
        }
    }

    /// Whether a packet lies where the one before leads to expect; what lies between them is noted.
    fn compare(&mut self, last: Seen, seen: Seen, frame_ids: u64) -> bool {
        let elapsed_ns = seen.time_ns.wrapping_sub(last.time_ns) as i64 as f64;
        let columns = seen.column as f64 - last.column as f64;
        let is_next = seen.is_of_next_frame(&last, frame_ids);
        if elapsed_ns <= 0.0 || elapsed_ns > LONGEST_GAP_NS {
            return last.frame_id == seen.frame_id && elapsed_ns.abs() <= LONGEST_GAP_NS;
        }
        if is_next {
            if self.turns.len() < MOST_TURNS {
                self.turns.push([elapsed_ns, columns]);
            }
            // a late packet of the revolution before may lie between two of this one
            if self.newest != Some(seen.frame_id) {
                self.newest = Some(seen.frame_id);
                self.whole_frames += usize::from(self.frames > 0);
                self.frames += 1;
            }
            return true;
        }
        if last.frame_id != seen.frame_id || columns <= 0.0 {
            return last.frame_id == seen.frame_id;
        }
        let fits = self.period_ns.is_none_or(|period_ns| keeps_pace(elapsed_ns, columns, period_ns));
        if fits && self.periods_ns.len() < MOST_PERIODS {
            self.periods_ns.push(elapsed_ns / columns);
            self.period_ns = agreed(&self.periods_ns);
        }
        fits
    }

    /// The mode of the packets, where it is not that of the metadata, which were given with another perhaps.
    pub(crate) fn other_mode(&self, metadata: &Metadata, given: Mode) -> Option<Mode> {
        let period_ns = self.period_ns?;
        let known = Mode::of(metadata);
        let turned = self.columns_by_turns(period_ns);
        let fits = (period_ns * known.columns as f64 * known.rate_hz * 1e-9 - 1.0).abs() < PERIOD_TOLERANCE
            && self.max_column < known.columns
            && turned.is_none_or(|columns| columns == known.columns);
        if fits {
            return None;
        }
        let rate_hz = |columns: usize| 1e9 / (period_ns * columns as f64);
        let is_rate = |rate_hz: f64, set: f64| (rate_hz / set - 1.0).abs() < RATE_TOLERANCE;
        let found = match turned {
            Some(columns) => {
                let set = RATES_HZ.into_iter().find(|set| is_rate(rate_hz(columns), *set));
                set.map(|rate_hz| Mode { columns, rate_hz })
            }
            None => {
                let possible = || {
                    let long_enough = MODES.into_iter().filter(|(columns, _)| *columns > self.max_column);
                    let modes = long_enough.filter(|(columns, set)| is_rate(rate_hz(*columns), *set));
                    modes.map(|(columns, rate_hz)| Mode { columns, rate_hz })
                };
                let of_rate = possible().find(|mode| mode.rate_hz == given.rate_hz);
                let of_columns = || possible().find(|mode| mode.columns == given.columns);
                of_rate.or_else(of_columns).or_else(|| possible().next())
            }
        };
        found.filter(|mode| *mode != known)
    }

    /// Columns of a revolution, by how long it took: windows and losses do not matter.
    fn columns_by_turns(&self, period_ns: f64) -> Option<usize> {
        let of_turn = |[elapsed_ns, behind]: &[f64; 2]| nearest_columns(elapsed_ns / period_ns - behind);
        let counts: Vec<usize> = self.turns.iter().filter_map(of_turn).collect();
        let votes = |columns: &usize| counts.iter().filter(|other| *other == columns).count();
        COLUMNS.into_iter().filter(|columns| votes(columns) > 0).max_by_key(votes)
    }

    /// The window of the packets, where valid columns lie outside of that of the metadata.
    pub(crate) fn wider_window(&self, metadata: &Metadata) -> Option<[usize; 2]> {
        let is_full = metadata.column_window == [0, metadata.columns_per_frame - 1];
        if is_full { None } else { self.other_window(metadata) }
    }

    /// The window of the packets, if it differs from that of the metadata while the mode agrees.
    pub(crate) fn other_window(&self, metadata: &Metadata) -> Option<[usize; 2]> {
        let all = metadata.columns_per_frame;
        let came = |column: usize| self.columns[column / 64] >> (column % 64) & 1 == 1;
        let is_outside = |column: &usize| !metadata.expects_slot(column / metadata.columns_per_packet);
        let outside = (0..all).filter(|column| came(*column) && is_outside(column)).count();
        let is_silent = |slot: usize| {
            let first = slot * metadata.columns_per_packet;
            !(first..(first + metadata.columns_per_packet).min(all)).any(came)
        };
        let silent = (0..metadata.packet_slots())
            .filter(|slot| metadata.expects_slot(*slot) && is_silent(*slot))
            .count();
        // one packet may be lost, two that never come in several revolutions are not sent
        let is_narrower = self.whole_frames >= 3 && silent >= 2;
        if outside < 2 && !is_narrower {
            return None;
        }
        let [start, length] = longest_gap(all, &came);
        let window = if self.whole_frames > 0 && length >= 2 * metadata.columns_per_packet {
            [(start + length) % all, (start + all - 1) % all]
        } else {
            [0, all - 1]
        };
        (window != metadata.column_window).then_some(window)
    }
}

/// The time between columns that most pairs of packets agree on, ns, where they are several.
fn agreed(periods_ns: &[f64]) -> Option<f64> {
    if periods_ns.len() < LEAST_PERIODS {
        return None;
    }
    let mut sorted = periods_ns.to_vec();
    sorted.sort_by(f64::total_cmp);
    let median_ns = sorted[sorted.len() / 2];
    let near = sorted.iter().filter(|period_ns| (*period_ns / median_ns - 1.0).abs() < 0.05).count();
    (3 * near >= 2 * sorted.len()).then_some(median_ns)
}

fn keeps_pace(elapsed_ns: f64, columns: f64, period_ns: f64) -> bool {
    (elapsed_ns / (columns * period_ns) - 1.0).abs() < PERIOD_TOLERANCE
}

/// The number of columns of a revolution that can be set, and is this one.
fn nearest_columns(columns: f64) -> Option<usize> {
    COLUMNS.into_iter().find(|set| (columns / *set as f64 - 1.0).abs() < RATE_TOLERANCE)
}

/// Where the longest run of columns begins that never came, around the circle, and its length.
fn longest_gap(all: usize, came: &dyn Fn(usize) -> bool) -> [usize; 2] {
    let Some(origin) = (0..all).find(|column| came(*column)) else { return [0, 0] };
    let (mut best, mut length) = ([0, 0], 0);
    for step in 1..=all {
        let column = (origin + step) % all;
        if !came(column) {
            length += 1;
            continue;
        }
        if length > best[1] {
            best = [(column + all - length) % all, length];
        }
        length = 0;
    }
    best
}
