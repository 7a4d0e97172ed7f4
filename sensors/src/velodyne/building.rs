//! A frame under construction.

use crate::frame::{Frame, Layer};

use super::blocks::BadBlocks;
use super::heads::{Head, Spin, azimuth_rad};
use super::kernels::{self, drop_repeated};
use super::wire::{DataPacket, Layout, Part};

/// The frame that packets go into, and what is known about it so far.
#[derive(Debug, Default)]
pub(crate) struct Building {
    frame: Frame,
    /// Contiguous travel, for the encoder rate.
    pub spin: Spin,
    /// Packets that are missing inside.
    pub lost: u64,
    /// First column of each packet and the packet's time, as they came.
    packets: Vec<(u64, usize)>,
    /// Packets came in another order than they were sent in.
    unsorted: bool,
    /// A block of some packet could not be used.
    has_bad_blocks: bool,
}

impl Building {
    /// The last frame took its buffers along.
    pub(crate) fn lacks_buffers(&self) -> bool {
        self.frame.column_time_ns.capacity() == 0
    }

    /// Reuses the buffers of a frame that is no longer needed.
    pub(crate) fn fill_with(&mut self, spent: Frame) {
        self.frame = spent;
    }

    /// Empties the frame for the next revolution; its buffers stay.
    pub(crate) fn restart(&mut self, frame_id: u32, channels: usize, dual: bool) {
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
        self.packets.clear();
        self.unsorted = false;
        self.has_bad_blocks = false;
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.frame.column_time_ns.is_empty()
    }

    /// Columns so far.
    pub(crate) fn columns(&self) -> usize {
        self.frame.column_time_ns.len()
    }

    /// Device time of the first column, ns.
    pub(crate) fn first_time_ns(&self) -> Option<u64> {
        self.frame.column_time_ns.first().copied()
    }

    /// Counts one packet into the frame.
    pub(crate) fn count_packet(&mut self, host_ns: u64) {
        let frame = &mut self.frame;
        frame.host_time_ns = match frame.packets {
            0 => [host_ns; 2],
            _ => [frame.host_time_ns[0].min(host_ns), frame.host_time_ns[1].max(host_ns)],
        };
        frame.packets += 1;
    }

    /// Appends sequences of a packet; `heads` are those of all its sequences.
    pub(crate) fn append(
        &mut self,
        packet: DataPacket<'_>,
        layout: &Layout,
        heads: &[Head],
        range: std::ops::Range<usize>,
        unit_mm: u32,
        bad: BadBlocks,
    ) {
        let frame = &mut self.frame;
        let time_ns = heads[range.start].time_ns;
        self.unsorted |= self.packets.last().is_some_and(|(last_ns, _)| *last_ns > time_ns);
        self.packets.push((time_ns, frame.column_time_ns.len()));
        frame.column_time_ns.extend(heads[range.clone()].iter().map(|head| head.time_ns));
        let azimuths_rad = heads[range.clone()].iter().map(|head| azimuth_rad(head.azimuth_counts));
        frame.column_azimuth_rad.extend(azimuths_rad);
        frame.column_valid.resize(frame.column_time_ns.len(), true);
        if bad != BadBlocks::default() {
            self.has_bad_blocks = true;
            let valid = frame.column_valid.iter_mut().rev().take(range.len()).rev();
            for (valid, sequence) in valid.zip(&layout.sequences[range.clone()]) {
                *valid = !bad.spoil(sequence);
            }
        }

        let place = frame.first.range_mm.len();
        let (channels, sequences) = (frame.channels, &layout.sequences[range]);
        let places = (place..).step_by(channels);
        let (ranges_mm, levels) = grow(&mut frame.first, place + sequences.len() * channels);
        for (sequence, at) in sequences.iter().zip(places.clone()) {
            for part in sequence.first() {
                unpack(packet, *part, unit_mm, &mut ranges_mm[at..], &mut levels[at..]);
            }
        }
        if let Some(second) = &mut frame.second {
            let (second_mm, second_levels) = grow(second, place + sequences.len() * channels);
            for (sequence, at) in sequences.iter().zip(places) {
                for part in sequence.second() {
                    unpack(packet, *part, unit_mm, &mut second_mm[at..], &mut second_levels[at..]);
                }
            }
            drop_repeated(
                (&ranges_mm[place..], &levels[place..]),
                (&mut second_mm[place..], &mut second_levels[place..]),
            );
        }
    }

    /// Closes the frame and gives it away.
    pub(crate) fn close(&mut self, complete: bool) -> Frame {
        if self.unsorted {
            self.sort();
        }
        let frame = &mut self.frame;
        frame.complete = complete && self.lost == 0 && !self.has_bad_blocks;
        let rate = self.spin.rate().unwrap_or(0.0);
        frame.azimuth_rate_rad_per_ns = rate * std::f64::consts::TAU / f64::from(super::wire::AZIMUTH_COUNTS);
        std::mem::take(&mut self.frame)
    }

    /// Puts packets in order of their time. The columns of one stay together: where stamps lie closer than a packet's
    /// firings take, those of neighbours overlap, in time but not in the world.
    fn sort(&mut self) {
        let frame = &mut self.frame;
        let ends = self.packets.iter().skip(1).map(|(_, first)| *first).chain([frame.column_time_ns.len()]);
        let mut runs: Vec<_> =
            self.packets.iter().zip(ends).map(|((time_ns, first), end)| (*time_ns, *first..end)).collect();
        runs.sort_by_key(|(time_ns, _)| *time_ns);
        let order: Vec<usize> = runs.into_iter().flat_map(|(_, columns)| columns).collect();
        frame.column_time_ns = by_column(&frame.column_time_ns, &order, 1);
        frame.column_azimuth_rad = by_column(&frame.column_azimuth_rad, &order, 1);
        frame.column_valid = by_column(&frame.column_valid, &order, 1);
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

/// Makes room for samples up to `end`, without a return.
fn grow(layer: &mut Layer, end: usize) -> (&mut [u32], &mut [u8]) {
    layer.range_mm.resize(end, 0);
    layer.reflectivity.resize(end, 0);
    (&mut layer.range_mm, &mut layer.reflectivity)
}

fn clear(layer: &mut Layer) {
    layer.range_mm.clear();
    layer.reflectivity.clear();
}

/// `range_mm` and `reflectivity` begin with the sequence's first channel.
fn unpack(packet: DataPacket<'_>, part: Part, unit_mm: u32, range_mm: &mut [u32], reflectivity: &mut [u8]) {
    let (bytes, at) = packet.measurements(usize::from(part.block), usize::from(part.slot));
    let from = usize::from(part.channel);
    let to = from + usize::from(part.lasers);
    kernels::unpack(bytes, at, unit_mm, &mut range_mm[from..to], &mut reflectivity[from..to]);
}
