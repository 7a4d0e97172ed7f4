//! Firing sequences to data packets, as the sensor sends them.

use std::f64::consts::TAU;

use crate::frame::{Frame, Layer};

use super::calibration::{Health, UnitStatus, encode_status_bytes};
use super::product::{Product, ReturnMode};
use super::wire::{
    AZIMUTH_COUNTS, BANK_FLAGS, BLOCK_BYTES, BLOCKS, DATA_PACKET_BYTES, Layout, MODE_OFFSET, MODEL_OFFSET,
    Part, STAMP_OFFSET,
};

/// One firing sequence. Slices have one entry per laser.
#[derive(Clone, Copy, Debug)]
pub struct Column<'a> {
    /// Device time of the first firing, ns.
    pub time_ns: u64,
    /// Encoder azimuth of the first firing, rad, clockwise.
    pub azimuth_rad: f64,
    /// First return, mm; 0 is no return.
    pub range_mm: &'a [u32],
    /// Reflectivity of the first return.
    pub reflectivity: &'a [u8],
    /// Range and reflectivity of the second return, in dual mode; a range of 0 repeats the first return, as the
    /// sensor does for a single echo.
    pub second: Option<(&'a [u32], &'a [u8])>,
}

/// Makes the packets of one sensor. An HDL-64E S1 sends its lower block as often as its upper one here, and its
/// packets have no time. Sequences come in any number; a packet goes out whenever it is full, so a frame
/// may end in the middle of one, as it does on the wire.
#[derive(Clone, Debug)]
pub struct VelodyneEncoder {
    product: Product,
    mode: ReturnMode,
    cycle_ns: f64,
    layout: Layout,
    packet: Box<[u8; DATA_PACKET_BYTES]>,
    packet_time_ns: u64,
    filled: usize,
    last: Option<(u64, f64)>,
    rate_rad_per_ns: f64,
    /// HDL-64E: what follows the time stamp, packet after packet.
    trailers: Vec<[u8; 2]>,
    packets: usize,
}

impl VelodyneEncoder {
    /// An encoder for a product in a return mode.
    pub fn new(product: Product, mode: ReturnMode) -> Self {
        let mut encoder = Self {
            product,
            mode,
            cycle_ns: product.cycle_ns(),
            layout: Layout::of(product, mode == ReturnMode::Dual),
            packet: Box::new([0; DATA_PACKET_BYTES]),
            packet_time_ns: 0,
            filled: 0,
            last: None,
            rate_rad_per_ns: 0.0,
            trailers: [*b"HMSDNYGTV", *b"123456700"].concat()[..16].iter().map(|kind| [*kind, 0]).collect(),
            packets: 0,
        };
        encoder.clear();
        encoder
    }

    /// The same encoder of an HDL-64E S2 or S3 that sends this state and calibration along.
    pub fn with_status(mut self, status: &UnitStatus, health: &Health) -> Self {
        self.trailers = encode_status_bytes(status, health);
        self
    }

    /// Time from one sequence to the next that the sensor keeps, ns.
    pub fn cycle_ns(&self) -> f64 {
        self.cycle_ns
    }

    /// Takes one sequence; a packet that it fills goes to `out` with the device time of its first firing, ns.
    pub fn push_column(&mut self, column: Column<'_>, out: &mut dyn FnMut(u64, &[u8; DATA_PACKET_BYTES])) {
        if let Some((time_ns, azimuth_rad)) = self.last
            && column.time_ns > time_ns
        {
            let travelled_rad = (column.azimuth_rad - azimuth_rad).rem_euclid(TAU);
            self.rate_rad_per_ns = travelled_rad / (column.time_ns - time_ns) as f64;
        }
        self.last = Some((column.time_ns, column.azimuth_rad));
        let sequence = self.layout.sequences[self.filled];
        if self.filled == 0 {
            self.packet_time_ns = column.time_ns;
            self.put_stamp(column.time_ns);
        }
        let counts = (column.azimuth_rad * (f64::from(AZIMUTH_COUNTS) / TAU)).round();
        let counts = counts.rem_euclid(f64::from(AZIMUTH_COUNTS)) as u16;
        let first = |channel: usize| (column.range_mm[channel], column.reflectivity[channel]);
        let second = |channel: usize| match column.second {
            Some((range_mm, reflectivity)) if range_mm[channel] > 0 => {
                (range_mm[channel], reflectivity[channel])
            }
            _ => first(channel),
        };
        let azimuth = (sequence.after_azimuth == 0).then_some(counts);
        for part in sequence.first() {
            self.put(*part, azimuth, first);
        }
        for part in sequence.second() {
            self.put(*part, azimuth, second);
        }
        self.filled += 1;
        if self.filled == self.layout.sequences.len() {
            self.packets += 1;
            out(self.packet_time_ns, &self.packet);
            self.clear();
        }
    }

    /// Takes the valid columns of a frame.
    pub fn push_frame(&mut self, frame: &Frame, out: &mut dyn FnMut(u64, &[u8; DATA_PACKET_BYTES])) {
        for column in (0..frame.columns()).filter(|column| frame.column_valid[*column]) {
            let samples = column * frame.channels..(column + 1) * frame.channels;
            let slices =
                |layer: &'_ Layer| (layer.range_mm[samples.clone()].to_vec(), level(layer, &samples));
            let (range_mm, reflectivity) = slices(&frame.first);
            let second = frame.second.as_ref().map(slices);
            let column = Column {
                time_ns: frame.column_time_ns[column],
                azimuth_rad: frame.column_azimuth_rad[column],
                range_mm: &range_mm,
                reflectivity: &reflectivity,
                second: second.as_ref().map(|(range_mm, level)| (&range_mm[..], &level[..])),
            };
            self.push_column(column, out);
        }
    }

    /// Fills the last packet up with sequences without returns and sends it.
    pub fn finish(&mut self, out: &mut dyn FnMut(u64, &[u8; DATA_PACKET_BYTES])) {
        let lasers = self.product.lasers();
        let (ranges, levels) = (vec![0; lasers], vec![0; lasers]);
        while self.filled > 0 {
            let (time_ns, azimuth_rad) = self.last.unwrap_or_default();
            self.push_column(
                Column {
                    time_ns: time_ns + self.cycle_ns.round() as u64,
                    azimuth_rad: (azimuth_rad + self.rate_rad_per_ns * self.cycle_ns).rem_euclid(TAU),
                    range_mm: &ranges,
                    reflectivity: &levels,
                    second: None,
                },
                out,
            );
        }
    }

    fn clear(&mut self) {
        self.packet.fill(0);
        self.filled = 0;
        for (block, bank) in self.layout.banks.iter().enumerate().take(BLOCKS) {
            let flag = BANK_FLAGS[usize::from(*bank)].to_le_bytes();
            self.packet[block * BLOCK_BYTES..block * BLOCK_BYTES + 2].copy_from_slice(&flag);
        }
        let last = match self.product.model_byte() {
            Some(model) => [self.mode.byte(), model],
            None => self.trailers[self.packets % self.trailers.len()],
        };
        self.packet[MODE_OFFSET..=MODEL_OFFSET].copy_from_slice(&last);
    }

    fn put_stamp(&mut self, time_ns: u64) {
        if self.product == Product::Hdl64eS1 {
            let text = S1_TRAILERS[self.packets % S1_TRAILERS.len()];
            self.packet[STAMP_OFFSET..].copy_from_slice(text);
            return;
        }
        let stamp_ns = (time_ns % HOUR_NS) as f64 + self.product.stamp_lead_ns(self.cycle_ns);
        let stamp_us = (stamp_ns / 1e3).round() as u32 % HOUR_US;
        self.packet[STAMP_OFFSET..STAMP_OFFSET + 4].copy_from_slice(&stamp_us.to_le_bytes());
    }

    fn put(&mut self, part: Part, azimuth: Option<u16>, sample: impl Fn(usize) -> (u32, u8)) {
        let unit_mm = self.product.distance_unit_mm();
        let block = &mut self.packet[usize::from(part.block) * BLOCK_BYTES..][..BLOCK_BYTES];
        if let Some(azimuth) = azimuth {
            block[2..4].copy_from_slice(&azimuth.to_le_bytes());
        }
        let slots = block[4..].chunks_exact_mut(3).skip(usize::from(part.slot));
        let channels = usize::from(part.channel)..usize::from(part.channel + part.lasers);
        for (slot, channel) in slots.zip(channels) {
            let (range_mm, reflectivity) = sample(channel);
            // a range beyond the field cannot be encoded: no return
            let distance = u16::try_from(range_mm.saturating_add(unit_mm / 2) / unit_mm).unwrap_or(0);
            slot[..2].copy_from_slice(&distance.to_le_bytes());
            slot[2] = reflectivity;
        }
    }
}

/// Temperature and version, in turn, where other models have a time stamp.
const S1_TRAILERS: [&[u8; 6]; 2] = [b"\x1b DegC", b"v25c  "];
const HOUR_US: u32 = 3_600_000_000;
const HOUR_NS: u64 = 3_600_000_000_000;

fn level(layer: &Layer, samples: &std::ops::Range<usize>) -> Vec<u8> {
    layer.reflectivity.get(samples.clone()).map_or_else(|| vec![0; samples.len()], <[u8]>::to_vec)
}
