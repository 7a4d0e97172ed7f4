//! Field-of-view windows: a sensor can be set to fire in a sector only. It fills its packets all the same, so
//! azimuth and time jump, most often inside a packet. A jump between two packets may be lost packets as well.

use super::heads::step_counts;
use super::wire::AZIMUTH_COUNTS;

/// The dark sectors seen so far.
#[derive(Debug, Default)]
pub(crate) struct ViewWindows {
    /// Last azimuth before and first azimuth behind each dark sector, counts.
    dark: Vec<[u16; 2]>,
    /// Jumps between packets that count as losses, and how many packets.
    suspects: Vec<([u16; 2], u64)>,
}

/// Azimuths of the same edge differ by this from turn to turn, counts.
const EDGE_TOLERANCE: f64 = 150.0;
const MOST_WINDOWS: usize = 4;
const MOST_SUSPECTS: usize = 64;

impl ViewWindows {
    /// Takes a jump inside a packet: no packet can be missing there. Returns how many packets were called lost
    /// before, at this very jump, that never existed.
    pub(crate) fn learn(&mut self, gap: [u16; 2]) -> u64 {
        match self.dark.iter().position(|dark| same(*dark, gap)) {
            Some(known) => self.dark[known] = gap,
            None if self.dark.len() < MOST_WINDOWS => self.dark.push(gap),
            None => {}
        }
        let undone = self.suspects.iter().filter(|(jump, _)| same(*jump, gap)).map(|(_, lost)| lost).sum();
        self.suspects.retain(|(jump, _)| !same(*jump, gap));
        undone
    }

    /// Keeps a jump between packets that was counted as a loss.
    pub(crate) fn suspect(&mut self, jump: [u16; 2], lost: u64) {
        if self.suspects.len() < MOST_SUSPECTS {
            self.suspects.push((jump, lost));
        }
    }

    /// How much of the turn from `from` over `travelled` counts (whole turns included) is dark, counts.
    pub(crate) fn dark_counts(&self, from: u16, travelled: f64) -> f64 {
        let turn = f64::from(AZIMUTH_COUNTS);
        let of_one = |[start, end]: [u16; 2]| {
            let width = step_counts(start, end);
            let mut to_start = step_counts(from, start);
            if to_start > turn - EDGE_TOLERANCE {
                to_start -= turn;
            }
            let room = travelled + EDGE_TOLERANCE - to_start - width;
            if room < 0.0 { 0.0 } else { width * (1.0 + (room / turn).floor()) }
        };
        self.dark.iter().map(|dark| of_one(*dark)).sum()
    }
}

fn same(one: [u16; 2], other: [u16; 2]) -> bool {
    let near = |a: u16, b: u16| {
        let apart = f64::from(a.abs_diff(b));
        apart.min(f64::from(AZIMUTH_COUNTS) - apart) <= EDGE_TOLERANCE
    };
    near(one[0], other[0]) && near(one[1], other[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_jump_between_packets_is_forgiven_once_it_is_seen_inside_one() {
        let mut windows = ViewWindows::default();
        windows.suspect([9088, 27010], 75);
        windows.suspect([100, 900], 2);
        assert_eq!(windows.learn([9100, 27030]), 75);
        assert_eq!(windows.learn([9100, 27030]), 0);
    }

    #[test]
    fn dark_counts_include_each_crossing() {
        let mut windows = ViewWindows::default();
        windows.learn([9000, 27000]);
        assert_eq!(windows.dark_counts(8990, 18_020.0), 18_000.0);
        assert_eq!(windows.dark_counts(8000, 500.0), 0.0);
        assert_eq!(windows.dark_counts(28_000, 36_000.0), 18_000.0);
        assert_eq!(windows.dark_counts(8000, 36_000.0 + 19_100.0), 36_000.0);
    }
}
