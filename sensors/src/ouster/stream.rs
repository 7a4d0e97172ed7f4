//! Packets to frames: which frame a packet belongs to, when a frame is finished, and what was lost on the way.
//!
//! Two frames are under construction at most: the current one, and the next one while packets of both arrive. A
//! packet that continues neither (another initialization id, a frame counter that jumps or runs backwards) is held
//! until enough packets in a row agree with it; then the stream starts anew there and the held packets are taken.
//! One damaged counter can so neither split a frame nor merge two, and a restarted sensor loses nothing.

use super::assembly::{Assembly, End, Place, has};
use super::kernels::{Kernels, kernels};
use super::metadata::Metadata;
use super::wire::PacketFormat;
use crate::{DecodeStats, Frame};

/// Frames the counter may run ahead or behind before that is taken for a restart: 1.6 s at 10 Hz.
const NEAR_FRAMES: i64 = 16;
/// Packets in a row that make a restart believable, when nothing but a restart explains them.
const JUMP_PACKETS: usize = 3;
/// The same for packets that could as well be late ones of closed frames.
const LATE_PACKETS: usize = 16;
/// Packets of the next frame that end the wait for the rest of the current one.
const MOST_EARLY_PACKETS: usize = 8;
/// Closed frames whose packets are remembered, to tell a packet that came twice from one that came late.
const REMEMBERED_FRAMES: usize = 4;

pub(super) struct Stream {
    format: PacketFormat,
    kernels: Kernels,
    current: Assembly,
    next: Assembly,
    /// Newest frame counter that was opened.
    newest: Option<Newest>,
    closed: [Closed; REMEMBERED_FRAMES],
    closed_count: usize,
    /// Initialization id of the running stream and of the one before.
    init_id: Option<u32>,
    old_init_id: Option<u32>,
    strays: Strays,
    /// Refused packets since the last frame was closed, while none was open.
    rejected: u64,
}

#[derive(Clone, Copy)]
struct Newest {
    frame_id: u32,
    time_ns: u64,
}

/// The packets of a closed frame.
#[derive(Clone, Default)]
struct Closed {
    frame_id: Option<u32>,
    init_id: u32,
    came: Vec<u64>,
}

/// Packets that continue nothing, in the order they came.
#[derive(Default)]
struct Strays {
    why: Option<Stray>,
    places: Vec<Place>,
    bytes: Vec<u8>,
}

#[derive(Clone, Copy, PartialEq)]
enum Stray {
    /// Of a frame closed not long ago: late, unless the counter started over.
    Late,
    /// Of a frame far away.
    Jump,
    /// The sensor was initialised again.
    Restart,
}

type Out<'a> = &'a mut dyn FnMut(&Frame);

impl Stream {
    pub(super) fn new(metadata: &Metadata) -> Self {
        let words = metadata.packet_slots().div_ceil(64);
        Self {
            format: metadata.packet_format(),
            kernels: kernels(metadata.profile),
            current: Assembly::new(metadata),
            next: Assembly::new(metadata),
            newest: None,
            closed: std::array::from_fn(|_| Closed { came: vec![0; words], ..Closed::default() }),
            closed_count: 0,
            init_id: None,
            old_init_id: None,
            strays: Strays::default(),
            rejected: 0,
        }
    }

    /// Takes one whole and well-formed lidar packet.
    pub(super) fn take(
        &mut self,
        metadata: &Metadata,
        place: &Place,
        packet: &[u8],
        stats: &mut DecodeStats,
        out: Out<'_>,
    ) {
        let Some(why) = self.stray(metadata, place) else {
            self.forget_strays(stats);
            self.accept(metadata, place, packet, stats, out);
            return;
        };
        if why == Stray::Late && self.came_before(place) {
            stats.duplicated += 1;
            return;
        }
        if !self.agrees_with_strays(why, place) {
            self.forget_strays(stats);
        }
        self.strays.why = Some(why);
        self.strays.places.push(*place);
        self.strays.bytes.extend_from_slice(packet);
        let enough = if why == Stray::Late { LATE_PACKETS } else { JUMP_PACKETS };
        if self.strays.places.len() >= enough {
            self.restart(metadata, why, stats, out);
        }
    }

    /// Whether a packet tells the same story as those held before it.
    fn agrees_with_strays(&self, why: Stray, place: &Place) -> bool {
        let (Some(earlier), Some(first)) = (self.strays.why, self.strays.places.first()) else { return true };
        let near = why == Stray::Late || self.distance(first.frame_id, place.frame_id).abs() <= 1;
        earlier == why && first.init_id == place.init_id && near
    }

    /// A refused packet of this sensor: it explains one missing packet of the frame it came with.
    pub(super) fn note_rejected(&mut self) {
        if self.next.open {
            self.next.rejected += 1;
        } else if self.current.open {
            self.current.rejected += 1;
        } else {
            self.rejected += 1;
        }
    }

    /// Hands out what is under construction.
    pub(super) fn finish(&mut self, metadata: &Metadata, stats: &mut DecodeStats, out: Out<'_>) {
        match self.strays.why {
            Some(why @ (Stray::Jump | Stray::Restart)) if !self.strays_are_old() => {
                self.restart(metadata, why, stats, out);
            }
            _ => self.forget_strays(stats),
        }
        let end = if self.next.open { End::Followed } else { End::CutOff };
        self.close_current(metadata, end, stats, out);
        self.promote();
        self.close_current(metadata, End::CutOff, stats, out);
        self.newest = None;
        self.init_id = None;
        self.closed_count = 0;
        for closed in &mut self.closed {
            closed.frame_id = None;
        }
    }

    /// For sensors without lidar packets: a revolution known by its IMU and zone packets only.
    pub(super) fn note_revolution(
        &mut self,
        metadata: &Metadata,
        place: &Place,
        stats: &mut DecodeStats,
        out: Out<'_>,
    ) {
        if self.current.open && self.current.frame.frame_id != place.frame_id {
            if self.distance(self.current.frame.frame_id, place.frame_id) < 0 {
                return; // a straggler of a revolution that is over
            }
            self.close_current(metadata, End::Followed, stats, out);
        }
        if !self.current.open {
            self.current.start(place.frame_id, place.host_time_ns, false);
        }
        self.current.frame.host_time_ns[1] = place.host_time_ns;
        self.current.frame.health = place.health;
    }

    /// Why a packet does not continue the stream, if so.
    fn stray(&self, metadata: &Metadata, place: &Place) -> Option<Stray> {
        let newest = self.newest?;
        if self.init_id.is_some_and(|init_id| init_id != place.init_id) {
            return Some(Stray::Restart);
        }
        let oldest_open = if self.current.open { self.current.frame.frame_id } else { newest.frame_id };
        let distance = self.distance(oldest_open, place.frame_id);
        if distance == 0 && self.current.open || (1..=NEAR_FRAMES).contains(&distance) {
            return None;
        }
        debug_assert!(metadata.packet_slots() > 0);
        Some(if (-NEAR_FRAMES..=0).contains(&distance) { Stray::Late } else { Stray::Jump })
    }

    /// Frames from one counter value to another, the short way round.
    fn distance(&self, from: u32, to: u32) -> i64 {
        let modulus = self.format.header.frame_ids() as i64;
        let ahead = (i64::from(to) - i64::from(from)).rem_euclid(modulus);
        if ahead > modulus / 2 { ahead - modulus } else { ahead }
    }

    fn came_before(&self, place: &Place) -> bool {
        self.closed.iter().any(|closed| {
            closed.frame_id == Some(place.frame_id)
                && closed.init_id == place.init_id
                && has(&closed.came, place.slot)
        })
    }

    /// Takes a packet that continues the stream.
    fn accept(
        &mut self,
        metadata: &Metadata,
        place: &Place,
        packet: &[u8],
        stats: &mut DecodeStats,
        out: Out<'_>,
    ) {
        if !self.current.open {
            self.open(metadata, place, false, stats);
        } else if self.current.frame.frame_id != place.frame_id {
            self.accept_early(metadata, place, packet, stats, out);
            return;
        }
        if self.current.has(place.slot) {
            stats.duplicated += 1;
            return;
        }
        let behind = add(&mut self.current, &self.format, &self.kernels, metadata, place, packet);
        stats.reordered += u64::from(behind || self.next.open);
        if self.current.is_whole() {
            self.close_current(metadata, End::Followed, stats, out);
            self.promote();
        }
    }

    /// Takes a packet of a frame after the current one.
    fn accept_early(
        &mut self,
        metadata: &Metadata,
        place: &Place,
        packet: &[u8],
        stats: &mut DecodeStats,
        out: Out<'_>,
    ) {
        if self.next.open && self.next.frame.frame_id != place.frame_id {
            let between = self.distance(self.next.frame.frame_id, place.frame_id) < 0;
            self.close_current(metadata, End::Followed, stats, out);
            if between {
                // a frame that was counted as lost because a later one came first
                self.current.start(place.frame_id, place.host_time_ns, false);
                stats.lost_packets = stats.lost_packets.saturating_sub(metadata.packets_per_frame() as u64);
                self.accept(metadata, place, packet, stats, out);
                return;
            }
            self.promote();
        }
        if !self.next.open {
            self.open(metadata, place, true, stats);
        }
        if self.next.has(place.slot) {
            stats.duplicated += 1;
            return;
        }
        let behind = add(&mut self.next, &self.format, &self.kernels, metadata, place, packet);
        stats.reordered += u64::from(behind);
        let patience = (metadata.packets_per_frame() / 4).clamp(2, MOST_EARLY_PACKETS);
        if self.next.is_whole() || self.next.frame.packets as usize >= patience {
            self.close_current(metadata, End::Followed, stats, out);
            self.promote();
            if self.current.is_whole() {
                self.close_current(metadata, End::Followed, stats, out);
            }
        }
    }

    /// Opens the current or the next frame and counts frames that never came at all.
    fn open(&mut self, metadata: &Metadata, place: &Place, as_next: bool, stats: &mut DecodeStats) {
        if let Some(newest) = self.newest {
            let skipped = (self.distance(newest.frame_id, place.frame_id) - 1).max(0) as u64;
            stats.lost_packets += skipped * metadata.packets_per_frame() as u64;
        }
        let joined = self.newest.is_none();
        self.newest = Some(Newest { frame_id: place.frame_id, time_ns: place.time_ns });
        self.init_id.get_or_insert(place.init_id);
        let assembly = if as_next { &mut self.next } else { &mut self.current };
        assembly.start(place.frame_id, place.host_time_ns, joined);
        if !as_next {
            self.current.rejected = std::mem::take(&mut self.rejected);
        }
    }

    fn promote(&mut self) {
        if !self.current.open {
            std::mem::swap(&mut self.current, &mut self.next);
        }
    }

    fn close_current(&mut self, metadata: &Metadata, end: End, stats: &mut DecodeStats, out: Out<'_>) {
        if !self.current.open {
            return;
        }
        stats.lost_packets += self.current.close(metadata, end, |slot| slot_order(metadata, slot));
        let closed = &mut self.closed[self.closed_count % REMEMBERED_FRAMES];
        self.closed_count += 1;
        closed.frame_id = Some(self.current.frame.frame_id);
        closed.init_id = self.init_id.unwrap_or(0);
        closed.came.copy_from_slice(&self.current.came);
        stats.frames += 1;
        stats.complete_frames += u64::from(self.current.frame.complete);
        out(&self.current.frame);
    }

    /// The held packets were no accident: ends what is open and begins again with them.
    fn restart(&mut self, metadata: &Metadata, why: Stray, stats: &mut DecodeStats, out: Out<'_>) {
        let Some(first) = self.strays.places.first().copied() else { return };
        let skipped = self.newest.and_then(|newest| self.frames_slept(metadata, newest, &first));
        // a gap that the sensor's clock confirms was lost on the way; after any other jump nothing is known
        let end = if skipped.is_some() { End::Followed } else { End::CutOff };
        let current_end = if self.next.open { End::Followed } else { end };
        self.close_current(metadata, current_end, stats, out);
        self.promote();
        self.close_current(metadata, end, stats, out);
        match skipped {
            Some(skipped) => {
                stats.lost_packets += skipped * metadata.packets_per_frame() as u64;
                self.newest =
                    Some(Newest { frame_id: first.frame_id.wrapping_sub(1), time_ns: first.time_ns });
            }
            None => {
                stats.init_id_changes += 1;
                self.newest = None;
            }
        }
        if why == Stray::Restart {
            self.old_init_id = self.init_id;
        }
        self.init_id = Some(first.init_id);
        let mut strays = std::mem::take(&mut self.strays);
        let length = strays.bytes.len() / strays.places.len().max(1);
        for (place, packet) in strays.places.iter().zip(strays.bytes.chunks_exact(length.max(1))) {
            self.take(metadata, place, packet, stats, out);
        }
        strays.clear();
        if self.strays.why.is_none() {
            self.strays = strays; // keeps the buffers
        }
    }

    /// Whole frames that are missing before a packet, when the clock went on as far as the frame counter.
    fn frames_slept(&self, metadata: &Metadata, newest: Newest, first: &Place) -> Option<u64> {
        if self.init_id != Some(first.init_id) {
            return None;
        }
        let counted = self.distance(newest.frame_id, first.frame_id);
        let elapsed_ns = first.time_ns.checked_sub(newest.time_ns)?;
        let elapsed = elapsed_ns as f64 * 1e-9 * metadata.frame_rate_hz;
        let agree = counted > 0 && (elapsed - counted as f64).abs() <= 1.0 + 0.05 * counted as f64;
        agree.then(|| counted as u64 - 1)
    }

    fn strays_are_old(&self) -> bool {
        let old = self.old_init_id;
        self.strays.places.first().is_some_and(|first| {
            let behind =
                self.newest.is_some_and(|newest| self.distance(newest.frame_id, first.frame_id) <= 0);
            let same = self.init_id == Some(first.init_id);
            old.is_some() && old == Some(first.init_id) || same && behind
        })
    }

    /// The stream went on as before: the held packets were late, or damaged.
    fn forget_strays(&mut self, stats: &mut DecodeStats) {
        if self.strays.why.is_none() {
            return;
        }
        let count = self.strays.places.len() as u64;
        if self.strays.why == Some(Stray::Late) || self.strays_are_old() {
            stats.late += count;
        } else {
            stats.malformed += count;
            for _ in 0..count {
                self.note_rejected();
            }
        }
        self.strays.clear();
    }
}

impl Strays {
    fn clear(&mut self) {
        self.why = None;
        self.places.clear();
        self.bytes.clear();
    }
}

fn add(
    assembly: &mut Assembly,
    format: &PacketFormat,
    kernels: &Kernels,
    metadata: &Metadata,
    place: &Place,
    packet: &[u8],
) -> bool {
    let order = slot_order(metadata, place.slot).unwrap_or(place.time_ns);
    assembly.add(place, packet, format, kernels.unpack, metadata.expects_slot(place.slot), order)
}

/// When in a revolution a slot is sent. In a window that goes through column 0 only the clock knows.
fn slot_order(metadata: &Metadata, slot: usize) -> Option<u64> {
    let [first, last] = metadata.column_window;
    (first <= last).then_some(slot as u64)
}
