//! Blocks of a data packet that are damaged: each costs itself, and not the eleven others.

use std::ops::Range;

use super::heads::step_counts;
use super::wire::{AZIMUTH_COUNTS, BANK_FLAGS, BLOCK_BYTES, DATA_PACKET_BYTES, DataPacket, Layout, Sequence};

/// An azimuth between two that lie closer than this cannot be elsewhere, counts: no field-of-view window is so narrow.
const CLOSE_COUNTS: f64 = 400.0;
/// How far an azimuth may be from those of its neighbours, counts.
const JITTER_COUNTS: f64 = 20.0;

/// Which blocks of a packet cannot be used, one bit each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct BadBlocks(u16);

impl BadBlocks {
    pub(crate) fn find(blocks: Range<usize>, is_good: impl Fn(usize) -> bool) -> Self {
        Self(blocks.filter(|block| !is_good(*block)).fold(0, |bits, block| bits | 1 << block))
    }

    pub(crate) fn count(self) -> usize {
        self.0.count_ones() as usize
    }

    pub(crate) fn first(self) -> Option<usize> {
        (self.0 != 0).then(|| self.0.trailing_zeros() as usize)
    }

    pub(crate) fn has(self, block: usize) -> bool {
        self.0 >> block & 1 == 1
    }

    /// Whether the first return of a sequence lies in one of them.
    pub(crate) fn spoil(self, sequence: &Sequence) -> bool {
        self.0 != 0 && sequence.first().iter().any(|part| self.has(usize::from(part.block)))
    }

    fn with(self, block: usize) -> Self {
        Self(self.0 | 1 << block)
    }
}

/// The blocks that share one azimuth, in order.
fn groups(layout: &Layout) -> Vec<Range<usize>> {
    let starts: Vec<usize> =
        layout.sequences.iter().filter(|s| s.after_azimuth == 0).map(|s| usize::from(s.block)).collect();
    let ends = starts.iter().skip(1).copied().chain([layout.blocks]);
    starts.iter().zip(ends).map(|(start, end)| *start..end).collect()
}

/// The azimuth of a group that blocks which are not bad say; none without one.
fn azimuth(data: DataPacket<'_>, group: &Range<usize>, bad: BadBlocks) -> Option<u16> {
    group.clone().find(|block| !bad.has(*block)).map(|block| data.azimuth(block))
}

/// These, and those with an invalid azimuth, or with one far from both neighbours while these are close to each other.
pub(crate) fn with_bad_azimuths(data: DataPacket<'_>, layout: &Layout, bad: BadBlocks) -> BadBlocks {
    let mut bad = bad;
    for block in 0..layout.blocks {
        if data.raw_azimuth(block) > AZIMUTH_COUNTS {
            bad = bad.with(block);
        }
    }
    let groups = groups(layout);
    for three in groups.windows(3) {
        let [Some(before), Some(behind)] = [&three[0], &three[2]].map(|group| azimuth(data, group, bad))
        else {
            continue;
        };
        let between = step_counts(before, behind);
        if !(0.0..CLOSE_COUNTS).contains(&between) {
            continue;
        }
        for block in three[1].clone().filter(|block| !bad.has(*block)).collect::<Vec<_>>() {
            let step = step_counts(before, data.azimuth(block));
            if !(-JITTER_COUNTS..=between + JITTER_COUNTS).contains(&step) {
                bad = bad.with(block);
            }
        }
    }
    bad
}

/// The packet with its bad blocks empty, at the azimuths that the others leave them.
pub(crate) fn mended(
    payload: &[u8; DATA_PACKET_BYTES],
    layout: &Layout,
    bad: BadBlocks,
) -> [u8; DATA_PACKET_BYTES] {
    let data = DataPacket::of(payload);
    let groups = groups(layout);
    let known: Vec<Option<u16>> = groups.iter().map(|group| azimuth(data, group, bad)).collect();
    let nearest = |mut places: &mut dyn Iterator<Item = usize>| {
        Iterator::find_map(&mut places, |at| known[at].map(|counts| (at as f64, counts)))
    };
    // two that are known, on either side where there are any: between and beyond them azimuths rise evenly
    let estimate = |at: usize| -> u16 {
        let before = nearest(&mut (0..at).rev());
        let behind = nearest(&mut (at + 1..known.len()));
        let (from, to) = match (before, behind) {
            (Some(before), Some(behind)) => (before, behind),
            (Some(before), None) => {
                let earlier = nearest(&mut (0..before.0 as usize).rev()).unwrap_or(before);
                (earlier, before)
            }
            (None, Some(behind)) => {
                let later = nearest(&mut (behind.0 as usize + 1..known.len())).unwrap_or(behind);
                (behind, later)
            }
            (None, None) => return 0,
        };
        let rate = if to.0 > from.0 { step_counts(from.1, to.1) / (to.0 - from.0) } else { 0.0 };
        let turn = f64::from(AZIMUTH_COUNTS);
        (f64::from(from.1) + rate * (at as f64 - from.0)).round().rem_euclid(turn) as u16
    };
    let mut mended = *payload;
    for (at, group) in groups.iter().enumerate() {
        let counts = known[at].unwrap_or_else(|| estimate(at));
        for block in group.clone().filter(|block| bad.has(*block)) {
            let bytes = &mut mended[block * BLOCK_BYTES..(block + 1) * BLOCK_BYTES];
            bytes.fill(0);
            let bank = layout.banks.get(block).map_or(0, |bank| usize::from(*bank));
            bytes[..2].copy_from_slice(&BANK_FLAGS[bank].to_le_bytes());
            bytes[2..4].copy_from_slice(&counts.to_le_bytes());
        }
    }
    mended
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::velodyne::product::Product;
    use crate::velodyne::wire::BLOCKS;

    fn packet(azimuths: [u16; BLOCKS]) -> [u8; DATA_PACKET_BYTES] {
        let mut payload = [7; DATA_PACKET_BYTES];
        for (block, azimuth) in azimuths.iter().enumerate() {
            payload[block * BLOCK_BYTES..][..2].copy_from_slice(&BANK_FLAGS[0].to_le_bytes());
            payload[block * BLOCK_BYTES + 2..][..2].copy_from_slice(&azimuth.to_le_bytes());
        }
        payload
    }

    fn azimuths(payload: &[u8; DATA_PACKET_BYTES]) -> Vec<u16> {
        (0..BLOCKS).map(|block| DataPacket::of(payload).azimuth(block)).collect()
    }

    #[test]
    fn a_bad_block_takes_the_azimuth_that_its_neighbours_leave_it() {
        let whole: [u16; BLOCKS] = std::array::from_fn(|block| (35_900 + 40 * block as u16) % 36_000);
        let layout = Layout::of(Product::Vlp16, false);
        for wrong in [36_001, 65_535, 12_345] {
            for block in 0..BLOCKS {
                let mut damaged = whole;
                damaged[block] = wrong;
                let payload = packet(damaged);
                let bad = with_bad_azimuths(DataPacket::of(&payload), &layout, BadBlocks::default());
                if wrong < 36_000 && (block == 0 || block == BLOCKS - 1) {
                    continue; // a gap may lie there
                }
                assert_eq!((bad.count(), bad.first()), (1, Some(block)), "{wrong}");
                let mended = mended(&payload, &layout, bad);
                assert_eq!(azimuths(&mended), whole);
                assert!(mended[block * BLOCK_BYTES + 4..][..96].iter().all(|byte| *byte == 0));
            }
        }
    }

    #[test]
    fn azimuth_36000_counts_as_zero() {
        let mut counts: [u16; BLOCKS] = std::array::from_fn(|block| (35_920 + 40 * block as u16) % 36_000);
        assert_eq!(counts[2], 0);
        counts[2] = 36_000;
        let payload = packet(counts);
        let layout = Layout::of(Product::Vlp16, false);
        let bad = with_bad_azimuths(DataPacket::of(&payload), &layout, BadBlocks::default());
        assert_eq!((bad, azimuths(&payload)[2]), (BadBlocks::default(), 0));
    }

    #[test]
    fn a_field_of_view_gap_is_no_damage() {
        let counts: [u16; BLOCKS] =
            std::array::from_fn(|block| if block < 5 { 8900 } else { 27_000 } + 20 * block as u16);
        let layout = Layout::of(Product::Vlp32c, false);
        let payload = packet(counts);
        let bad = with_bad_azimuths(DataPacket::of(&payload), &layout, BadBlocks::default());
        assert_eq!(bad, BadBlocks::default());
    }
}
