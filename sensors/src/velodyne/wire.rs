//! The data packet, 1206 bytes: twelve blocks of a flag, an azimuth and 32 measurements, then six bytes of time and
//! factory values. Sources: VLP-16 manual 63-9243 ch. 9, VLS-128 manual 63-9483, HDL-64E S3 manual.

use super::product::{Family, Product};

/// UDP payload of a data packet.
pub const DATA_PACKET_BYTES: usize = 1206;
/// UDP payload of a position packet.
pub const POSITION_PACKET_BYTES: usize = 512;
/// Port that data packets go to by default.
pub const DATA_PORT: u16 = 2368;
/// Port that position packets go to by default.
pub const POSITION_PORT: u16 = 8308;
/// Azimuth counts in a turn (0.01 degree each).
pub const AZIMUTH_COUNTS: u16 = 36_000;

pub(crate) const BLOCKS: usize = 12;
pub(crate) const BLOCK_BYTES: usize = 100;
pub(crate) const STAMP_OFFSET: usize = 1200;
pub(crate) const MODE_OFFSET: usize = 1204;
pub(crate) const MODEL_OFFSET: usize = 1205;

/// Flags of the four banks of 32 lasers, as little-endian words.
pub(crate) const BANK_FLAGS: [u16; 4] = [0xEEFF, 0xDDFF, 0xCCFF, 0xBBFF];

/// A data packet of the right length; nothing else is checked yet.
#[derive(Clone, Copy)]
pub(crate) struct DataPacket<'a>(&'a [u8; DATA_PACKET_BYTES]);

impl<'a> DataPacket<'a> {
    pub(crate) fn of(payload: &'a [u8; DATA_PACKET_BYTES]) -> Self {
        Self(payload)
    }

    pub(crate) fn flag(self, block: usize) -> u16 {
        self.word(block * BLOCK_BYTES)
    }

    /// Azimuth of a block, counts; some firmware writes a whole turn for none.
    pub(crate) fn azimuth(self, block: usize) -> u16 {
        match self.raw_azimuth(block) {
            AZIMUTH_COUNTS => 0,
            counts => counts,
        }
    }

    /// The same as it was sent.
    pub(crate) fn raw_azimuth(self, block: usize) -> u16 {
        self.word(block * BLOCK_BYTES + 2)
    }

    /// The whole packet, and where the measurement of a slot lies in it: distance (2 bytes) and reflectivity, 32 times
    /// in a block.
    pub(crate) fn measurements(self, block: usize, slot: usize) -> (&'a [u8; DATA_PACKET_BYTES], usize) {
        (self.0, block * BLOCK_BYTES + 4 + 3 * slot)
    }

    pub(crate) fn stamp_us(self) -> u32 {
        let [.., a, b, c, d, _, _] = *self.0;
        u32::from_le_bytes([a, b, c, d])
    }

    /// The last six bytes.
    pub(crate) fn trailer(self) -> &'a [u8] {
        &self.0[STAMP_OFFSET..]
    }

    pub(crate) fn mode_byte(self) -> u8 {
        self.0[MODE_OFFSET]
    }

    pub(crate) fn model_byte(self) -> u8 {
        self.0[MODEL_OFFSET]
    }

    /// The bank of a block, by its flag.
    pub(crate) fn bank(self, block: usize) -> Option<usize> {
        BANK_FLAGS.iter().position(|flag| *flag == self.flag(block))
    }

    fn word(self, at: usize) -> u16 {
        u16::from_le_bytes([self.0[at], self.0[at + 1]])
    }
}

/// Some lasers of one block: slots `slot..slot + lasers` are the channels from `channel` on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Part {
    pub block: u8,
    pub slot: u8,
    pub channel: u8,
    pub lasers: u8,
}

/// Where one firing sequence lies in a packet.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sequence {
    /// Block that holds the sequence's azimuth.
    pub block: u8,
    /// Sequences since the one that the block's azimuth belongs to (1 for the second half of a VLP-16 block).
    pub after_azimuth: u8,
    /// Cycles since the packet's time stamp.
    pub cycles: u8,
    parts: u8,
    first: [Part; 4],
    second: [Part; 4],
}

impl Sequence {
    /// Parts of the first return.
    pub(crate) fn first(&self) -> &[Part] {
        &self.first[..usize::from(self.parts)]
    }

    /// Parts of the second return, in the same order; empty unless the packet carries two.
    pub(crate) fn second(&self) -> &[Part] {
        let used = if self.second[0].lasers > 0 { usize::from(self.parts) } else { 0 };
        &self.second[..used]
    }

    fn new(block: usize, cycles: usize) -> Self {
        Self { block: block as u8, cycles: cycles as u8, ..Self::default() }
    }

    fn add(&mut self, first: Part, second: Option<Part>) {
        let place = usize::from(self.parts);
        self.first[place] = first;
        self.second[place] = second.unwrap_or_default();
        self.parts += 1;
    }
}

/// The layout of a packet: at most 24 sequences.
#[derive(Clone, Debug, Default)]
pub(crate) struct Layout {
    pub sequences: Vec<Sequence>,
    /// Blocks in use; the rest is filler.
    pub blocks: usize,
    /// Bank that each block must have; empty where the flags themselves decide (HDL-64E).
    pub banks: Vec<u8>,
}

impl Layout {
    /// The layout that a product's packets have by their return mode. In dual packets of 16, 32 and 128 lasers
    /// blocks come in pairs, last return before strongest; an HDL-64E sends the strongest of both banks before the
    /// last of both. The last return is the first layer of a frame.
    pub(crate) fn of(product: Product, dual: bool) -> Self {
        let mut layout = Self::default();
        let part = |block: usize, slot: usize, channel: usize, lasers: usize| Part {
            block: block as u8,
            slot: slot as u8,
            channel: channel as u8,
            lasers: lasers as u8,
        };
        let blocks_per_azimuth = if dual { 2 } else { 1 };
        match product.family() {
            Family::Sixteen => {
                for block in (0..BLOCKS).step_by(blocks_per_azimuth) {
                    for half in 0..2 {
                        let mut sequence = Sequence::new(block, layout.sequences.len());
                        sequence.after_azimuth = half as u8;
                        let second = dual.then(|| part(block + 1, 16 * half, 0, 16));
                        sequence.add(part(block, 16 * half, 0, 16), second);
                        layout.sequences.push(sequence);
                    }
                }
                (layout.blocks, layout.banks) = (BLOCKS, vec![0; BLOCKS]);
            }
            Family::ThirtyTwo => {
                for block in (0..BLOCKS).step_by(blocks_per_azimuth) {
                    let mut sequence = Sequence::new(block, layout.sequences.len());
                    sequence.add(part(block, 0, 0, 32), dual.then(|| part(block + 1, 0, 0, 32)));
                    layout.sequences.push(sequence);
                }
                (layout.blocks, layout.banks) = (BLOCKS, vec![0; BLOCKS]);
            }
            Family::SixtyFour => {
                for block in (0..BLOCKS).step_by(2 * blocks_per_azimuth) {
                    let mut sequence = Sequence::new(block, layout.sequences.len());
                    for bank in 0..2 {
                        let (strongest, last) = (block + bank, block + bank + 2);
                        if dual {
                            sequence
                                .add(part(last, 0, 32 * bank, 32), Some(part(strongest, 0, 32 * bank, 32)));
                        } else {
                            sequence.add(part(strongest, 0, 32 * bank, 32), None);
                        }
                    }
                    layout.sequences.push(sequence);
                }
                (layout.blocks, layout.banks) = (BLOCKS, [0, 1].repeat(BLOCKS / 2));
            }
            Family::OneTwentyEight => {
                let blocks_per_sequence = 4 * blocks_per_azimuth;
                layout.blocks = product.sequences_per_packet(dual) * blocks_per_sequence;
                for block in (0..layout.blocks).step_by(blocks_per_sequence) {
                    let mut sequence = Sequence::new(block, layout.sequences.len());
                    for bank in 0..4 {
                        let at = block + bank * blocks_per_azimuth;
                        sequence
                            .add(part(at, 0, 32 * bank, 32), dual.then(|| part(at + 1, 0, 32 * bank, 32)));
                        layout.banks.extend(vec![bank as u8; blocks_per_azimuth]);
                    }
                    layout.sequences.push(sequence);
                }
            }
        }
        layout
    }

    /// The layout of one packet by its flags, for an HDL-64E S1: upper blocks come three times as often as lower
    /// ones; neighbours of different banks with one azimuth are one sequence.
    pub(crate) fn by_flags(&mut self, packet: DataPacket<'_>) {
        self.sequences.clear();
        self.blocks = BLOCKS;
        let mut block = 0;
        while block < BLOCKS {
            let mut sequence = Sequence::new(block, self.sequences.len());
            let banks = [packet.bank(block), packet.bank((block + 1).min(BLOCKS - 1))];
            let together = block + 1 < BLOCKS
                && banks[0] != banks[1]
                && packet.azimuth(block) == packet.azimuth(block + 1);
            let blocks = if together { 2 } else { 1 };
            for (at, bank) in banks.into_iter().enumerate().take(blocks) {
                let channel = 32 * bank.unwrap_or(0) as u8;
                sequence.add(Part { block: (block + at) as u8, slot: 0, channel, lasers: 32 }, None);
            }
            self.sequences.push(sequence);
            block += blocks;
        }
    }
}
