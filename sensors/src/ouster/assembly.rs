//! One frame under construction.

use super::kernels::Unpack;
use super::metadata::Metadata;
use super::profile::ReturnLayout;
use super::wire::PacketFormat;
use crate::{Completed, DecodeStats, Frame, Health, Layer};

/// A lidar packet that passed every check, and where it belongs.
#[derive(Clone, Copy)]
pub(super) struct Place {
    pub(super) frame_id: u32,
    pub(super) init_id: u32,
    /// Place of the packet in the revolution: first column / columns per packet.
    pub(super) slot: usize,
    /// Time of the packet's first column, ns.
    pub(super) time_ns: u64,
    pub(super) host_time_ns: u64,
    pub(super) health: Health,
}

/// How much of a revolution the sensor certainly sent to us.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum End {
    /// The stream goes on after this frame.
    Followed,
    /// The stream ended inside this frame: nothing after the last packet is known to have been sent.
    CutOff,
}

/// Frame, bookkeeping of its packets, and the buffers both are reused from.
pub(super) struct Assembly {
    pub(super) frame: Frame,
    pub(super) open: bool,
    /// The stream began inside this frame: nothing before the first packet is known to have been sent.
    pub(super) joined: bool,
    /// One bit per slot that came.
    pub(super) came: Vec<u64>,
    /// Slots of the window that came.
    pub(super) expected_came: usize,
    /// Packets that were refused while the frame was open, and of these the ones after the last accepted packet: they
    /// explain as many missing slots.
    rejected: u64,
    rejected_since: u64,
    first_order: u64,
    last_order: u64,
    /// Columns that hold samples of the frame before in these buffers.
    stale: Vec<bool>,
}

impl Assembly {
    pub(super) fn new(metadata: &Metadata) -> Self {
        Self {
            frame: Frame::default(),
            open: false,
            joined: false,
            came: vec![0; metadata.packet_slots().div_ceil(64)],
            expected_came: 0,
            rejected: 0,
            rejected_since: 0,
            first_order: 0,
            last_order: 0,
            stale: Vec::new(),
        }
    }

    /// Begins a frame, in old buffers where there are any; samples of columns that do not come are cleared when it is
    /// closed.
    pub(super) fn start(&mut self, output: &mut Output<'_>, place: &Place, joined: bool) {
        self.open = true;
        self.joined = joined;
        self.came.fill(0);
        self.expected_came = 0;
        self.rejected = 0;
        self.rejected_since = 0;
        self.first_order = u64::MAX;
        self.last_order = 0;
        // one of another mode has another size
        let spent = output.completed.spent_frame();
        let spent = spent.filter(|frame| frame.columns() == output.metadata.columns_per_frame);
        self.frame = spent.unwrap_or_else(|| blank_frame(output.metadata));
        let frame = &mut self.frame;
        (frame.expected_packets, frame.azimuth_rate_rad_per_ns) = expectations(output.metadata);
        frame.frame_id = place.frame_id;
        frame.column_time_ns.fill(0);
        self.stale.clone_from(&frame.column_valid);
        frame.column_valid.fill(false);
        frame.packets = 0;
        frame.restarts = output.stats.init_id_changes;
        frame.complete = false;
        frame.host_time_ns = [place.host_time_ns; 2];
        frame.health = Health::default();
    }

    /// The sensor is set differently than it was thought to be: columns keep their numbers, and their azimuths follow.
    pub(super) fn follow(&mut self, metadata: &Metadata) {
        self.came.resize(metadata.packet_slots().div_ceil(64), 0);
        if !self.open {
            return;
        }
        if self.frame.columns() != metadata.columns_per_frame {
            let mut frame = blank_frame(metadata);
            let columns = frame.columns().min(self.frame.columns());
            frame.column_time_ns[..columns].copy_from_slice(&self.frame.column_time_ns[..columns]);
            frame.column_valid[..columns].copy_from_slice(&self.frame.column_valid[..columns]);
            frame.first.copy_samples(&self.frame.first, columns * frame.channels);
            if let (Some(second), Some(from)) = (&mut frame.second, &self.frame.second) {
                second.copy_samples(from, columns * frame.channels);
            }
            let Frame { frame_id, packets, restarts, host_time_ns, health, .. } = self.frame;
            self.frame = Frame { frame_id, packets, restarts, host_time_ns, health, ..frame };
            self.stale.resize(metadata.columns_per_frame, false);
        }
        (self.frame.expected_packets, self.frame.azimuth_rate_rad_per_ns) = expectations(metadata);
        let expects = |slot: &usize| metadata.expects_slot(*slot) && has(&self.came, *slot);
        self.expected_came = (0..metadata.packet_slots()).filter(expects).count();
    }

    /// Packets were refused that may belong here.
    pub(super) fn note_rejected(&mut self, count: u64) {
        self.rejected += count;
        self.rejected_since += count;
    }

    pub(super) fn has(&self, slot: usize) -> bool {
        has(&self.came, slot)
    }

    /// Whether every expected packet came.
    pub(super) fn is_whole(&self) -> bool {
        self.frame
            .expected_packets
            .is_some_and(|expected| expected > 0 && self.expected_came == expected as usize)
    }

    /// Takes a packet that is not here yet. Returns whether it came after a later one.
    pub(super) fn add(
        &mut self,
        place: &Place,
        packet: &[u8],
        format: &PacketFormat,
        unpack: Unpack,
        expected: bool,
        order: u64,
    ) -> bool {
        self.came[place.slot / 64] |= 1 << (place.slot % 64);
        self.expected_came += usize::from(expected);
        self.rejected_since = 0;
        let out_of_order = self.frame.packets > 0 && order < self.last_order;
        self.first_order = self.first_order.min(order);
        self.last_order = self.last_order.max(order);
        let frame = &mut self.frame;
        frame.packets += 1;
        frame.host_time_ns[1] = frame.host_time_ns[1].max(place.host_time_ns);
        frame.health = place.health;
        let Frame { channels, column_time_ns, column_valid, first, second, .. } = frame;
        let first_id = place.slot * format.columns_per_packet;
        let count = format.columns_per_packet.min(column_valid.len().saturating_sub(first_id));
        for index in 0..count {
            let header = format.read_column(format.column(packet, index));
            column_time_ns[first_id + index] = header.time_ns;
            column_valid[first_id + index] = header.valid;
        }
        let mut index = 0;
        for alike in column_valid[first_id..first_id + count].chunk_by(|a, b| a == b) {
            if alike[0] {
                let columns = format.columns(packet, index, alike.len());
                unpack(columns, (first_id + index) * *channels, first, second.as_mut());
            }
            index += alike.len();
        }
        out_of_order
    }

    /// Ends the frame: clears what did not come. Returns how many packets were lost, by the order numbers that
    /// `order_of` gives the expected slots, and how many refused packets may belong to the next frame.
    pub(super) fn close(
        &mut self,
        metadata: &Metadata,
        end: End,
        order_of: impl Fn(usize) -> Option<u64>,
    ) -> (u64, u64) {
        self.open = false;
        let frame = &mut self.frame;
        let mut all_valid = true;
        for (column, valid) in frame.column_valid.iter().enumerate() {
            if *valid {
                continue;
            }
            all_valid &= !metadata.in_window(column);
            if self.stale[column] {
                let samples = column * frame.channels..(column + 1) * frame.channels;
                clear(&mut frame.first, samples.clone());
                if let Some(second) = &mut frame.second {
                    clear(second, samples);
                }
            }
        }
        self.frame.complete = self.is_whole() && all_valid;
        let missing = (0..metadata.packet_slots())
            .filter(|slot| metadata.expects_slot(*slot) && !self.has(*slot))
            .filter(|slot| {
                let order = order_of(*slot);
                let before = self.joined && order.is_none_or(|order| order < self.first_order);
                let after = end == End::CutOff && order.is_none_or(|order| order > self.last_order);
                !before && !after
            })
            .count() as u64;
        let unexplained = self.rejected.saturating_sub(missing).min(self.rejected_since);
        (missing.saturating_sub(self.rejected), unexplained)
    }
}

/// Whether a slot is set in a bitmap of slots.
pub(super) fn has(came: &[u64], slot: usize) -> bool {
    came.get(slot / 64).is_some_and(|word| word >> (slot % 64) & 1 == 1)
}

/// Packets of a revolution and the encoder's rate, rad/ns.
fn expectations(metadata: &Metadata) -> (Option<u32>, f64) {
    (Some(metadata.packets_per_frame() as u32), std::f64::consts::TAU * metadata.frame_rate_hz * 1e-9)
}

/// A frame of the sensor's size without a sample.
pub(super) fn blank_frame(metadata: &Metadata) -> Frame {
    let columns = metadata.columns_per_frame;
    let samples = columns * metadata.pixels_per_column;
    let layout = metadata.profile.layout();
    let turn = std::f64::consts::TAU;
    Frame {
        channels: metadata.pixels_per_column,
        column_time_ns: vec![0; columns],
        column_azimuth_rad: (0..columns).map(|column| turn * column as f64 / columns as f64).collect(),
        column_valid: vec![false; columns],
        azimuth_rate_rad_per_ns: turn * metadata.frame_rate_hz * 1e-9,
        first: layer(&layout.first, samples, layout.raw_words),
        second: layout.is_dual().then(|| layer(&layout.second, samples, false)),
        expected_packets: Some(metadata.packets_per_frame() as u32),
        ..Frame::default()
    }
}

fn layer(layout: &ReturnLayout, samples: usize, raw_words: bool) -> Layer {
    fn array<T: Clone + Default>(samples: usize, there: bool) -> Vec<T> {
        vec![T::default(); if there { samples } else { 0 }]
    }
    Layer {
        range_mm: vec![0; samples],
        reflectivity: array(samples, layout.reflectivity.is_there()),
        signal: array(samples, layout.signal.is_there()),
        near_ir: array(samples, layout.near_ir.is_there()),
        flags: array(samples, layout.flags.is_there()),
        window: array(samples, layout.window.is_there()),
        zone_mask: array(samples, layout.zone_mask.is_there()),
        rgb: array(samples, layout.rgb[0].is_there()),
        raw_words: array(samples, raw_words),
    }
}

fn clear(layer: &mut Layer, samples: std::ops::Range<usize>) {
    fn zero<T: Clone + Default>(array: &mut [T], samples: std::ops::Range<usize>) {
        if let Some(part) = array.get_mut(samples) {
            part.fill(T::default());
        }
    }
    zero(&mut layer.range_mm, samples.clone());
    zero(&mut layer.reflectivity, samples.clone());
    zero(&mut layer.signal, samples.clone());
    zero(&mut layer.near_ir, samples.clone());
    zero(&mut layer.flags, samples.clone());
    zero(&mut layer.window, samples.clone());
    zero(&mut layer.zone_mask, samples.clone());
    zero(&mut layer.rgb, samples.clone());
    zero(&mut layer.raw_words, samples);
}

/// The sensor's metadata, and where a stream counts and puts its frames.
pub(super) struct Output<'a> {
    pub(super) metadata: &'a Metadata,
    pub(super) stats: &'a mut DecodeStats,
    pub(super) completed: &'a mut Completed,
}
