//! A frame under construction.

use crate::frame::{Frame, Layer};

use super::heads::{Head, Spin, azimuth_rad};
use super::wire::{DataPacket, Layout, Part};

/// The frame that packets go into, and what is known about it so far.
#[derive(Debug, Default)]
pub(crate) struct Building {
    frame: Frame,
    /// Contiguous travel, for the encoder rate.
    pub spin: Spin,
    /// Packets that are missing inside.
    pub lost: u64,
    /// Columns came in another order than they were fired in.
    unsorted: bool,
}

impl Building {
    /// The last frame took its buffers along.
    pub fn lacks_buffers(&self) -> bool {
        self.frame.column_time_ns.capacity() == 0
    }

    /// Takes the buffers of a frame that nobody looks at any more.
    pub fn fill_with(&mut self, spent: Frame) {
        self.frame = spent;
    }

    /// Empties the frame for the next revolution; its buffers stay.
    pub fn restart(&mut self, frame_id: u32, channels: usize, dual: bool) {
        let frame = &mut self.frame;
        frame.frame_id = frame_id;
        frame.channels = channels;
        frame.column_time_ns.clear();
        frame.column_azimuth_rad.clear();
        frame.column_valid.clear();
        clear(&mut frame.first);
        match (&mut frame.second, dual) {
            (Some(second), true) => clear(second),
            (second, true) => *second = Some(Layer::default()),
            (second, false) => *second = None,
        }
        frame.packets = 0;
        frame.complete = false;
        frame.host_time_ns = [0; 2];
        self.spin = Spin::default();
        self.lost = 0;
        self.unsorted = false;
    }

    pub fn is_empty(&self) -> bool {
        self.frame.column_time_ns.is_empty()
    }

    /// Device time of the first column, ns.
    pub fn first_time_ns(&self) -> Option<u64> {
        self.frame.column_time_ns.first().copied()
    }

    /// Counts one packet into the frame.
    pub fn count_packet(&mut self, host_ns: u64) {
        let frame = &mut self.frame;
        frame.host_time_ns = match frame.packets {
            0 => [host_ns; 2],
            _ => [frame.host_time_ns[0].min(host_ns), frame.host_time_ns[1].max(host_ns)],
        };
        frame.packets += 1;
    }

    /// Appends sequences `from..to` of a packet.
    pub fn append(
        &mut self,
        packet: DataPacket<'_>,
        layout: &Layout,
        heads: &[Head],
        range: std::ops::Range<usize>,
        unit_mm: u32,
    ) {
        let frame = &mut self.frame;
        for (head, sequence) in heads[range.clone()].iter().zip(&layout.sequences[range]) {
            self.unsorted |= frame.column_time_ns.last().is_some_and(|last| *last > head.time_ns);
            frame.column_time_ns.push(head.time_ns);
            frame.column_azimuth_rad.push(azimuth_rad(head.azimuth_counts));
            frame.column_valid.push(true);
            let place = frame.first.range_mm.len();
            let end = place + frame.channels;
            frame.first.range_mm.resize(end, 0);
            frame.first.reflectivity.resize(end, 0);
            for part in sequence.first() {
                unpack(packet, *part, unit_mm, &mut frame.first, place);
            }
            if let Some(second) = &mut frame.second {
                second.range_mm.resize(end, 0);
                second.reflectivity.resize(end, 0);
                for part in sequence.second() {
                    unpack(packet, *part, unit_mm, second, place);
                }
                drop_repeated(&frame.first, second, place);
            }
        }
    }

    /// Closes the frame and gives it away.
    pub fn close(&mut self, complete: bool) -> Frame {
        if self.unsorted {
            self.sort();
        }
        let frame = &mut self.frame;
        frame.complete = complete && self.lost == 0;
        let rate = self.spin.rate().unwrap_or(0.0);
        frame.azimuth_rate_rad_per_ns = rate * std::f64::consts::TAU / f64::from(super::wire::AZIMUTH_COUNTS);
        std::mem::take(&mut self.frame)
    }

    fn sort(&mut self) {
        let frame = &mut self.frame;
        let mut order: Vec<usize> = (0..frame.column_time_ns.len()).collect();
        order.sort_by_key(|column| frame.column_time_ns[*column]);
        frame.column_time_ns = order.iter().map(|column| frame.column_time_ns[*column]).collect();
        frame.column_azimuth_rad = order.iter().map(|column| frame.column_azimuth_rad[*column]).collect();
        frame.column_valid = order.iter().map(|column| frame.column_valid[*column]).collect();
        let channels = frame.channels;
        for layer in [Some(&mut frame.first), frame.second.as_mut()].into_iter().flatten() {
            layer.range_mm = by_column(&layer.range_mm, &order, channels);
            layer.reflectivity = by_column(&layer.reflectivity, &order, channels);
        }
    }
}

fn by_column<T: Copy>(samples: &[T], order: &[usize], channels: usize) -> Vec<T> {
    order.iter().flat_map(|column| &samples[column * channels..(column + 1) * channels]).copied().collect()
}

fn clear(layer: &mut Layer) {
    layer.range_mm.clear();
    layer.reflectivity.clear();
}

fn unpack(packet: DataPacket<'_>, part: Part, unit_mm: u32, layer: &mut Layer, place: usize) {
    let (slot, lasers) = (usize::from(part.slot), usize::from(part.lasers));
    let from = place + usize::from(part.channel);
    let bytes = &packet.measurements(usize::from(part.block))[3 * slot..3 * (slot + lasers)];
    let ranges = &mut layer.range_mm[from..from + lasers];
    let reflectivities = &mut layer.reflectivity[from..from + lasers];
    for ((measurement, range), reflectivity) in bytes.chunks_exact(3).zip(ranges).zip(reflectivities) {
        *range = u32::from(u16::from_le_bytes([measurement[0], measurement[1]])) * unit_mm;
        *reflectivity = measurement[2];
    }
}

/// A firing with one echo is sent twice, or with an empty second return: the second layer keeps none of it.
fn drop_repeated(first: &Layer, second: &mut Layer, place: usize) {
    let ranges = first.range_mm[place..].iter().zip(&mut second.range_mm[place..]);
    let reflectivities = first.reflectivity[place..].iter().zip(&mut second.reflectivity[place..]);
    for ((first_range, second_range), (first_level, second_level)) in ranges.zip(reflectivities) {
        if *second_range == 0 || first_range == second_range && first_level == second_level {
            *second_range = 0;
            *second_level = 0;
        }
    }
}
