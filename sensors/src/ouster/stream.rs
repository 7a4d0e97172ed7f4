//! Packets to frames: which frame a packet belongs to, when a frame is finished, and which packets were lost.
//!
//! Two frames are under construction at most: the current one, and the next one while packets of both arrive. A
//! packet is held while its initialization id, frame counter and clock do not continue what came before, until enough
//! packets in a row agree with it; then the stream goes on from there and the held packets are used. A damaged
//! counter can so neither split a frame nor merge two, and a restarted sensor loses nothing.

use super::assembly::{Assembly, End, Output, Place, has};
use super::kernels::{Kernels, kernels};
use super::metadata::Metadata;
use super::strays::{Stray, Strays};
use super::wire::PacketFormat;
use crate::{DecodeStats, Frame};

/// Frames a packet may be behind and still be called late: 1.6 s at 10 Hz.
const LATE_FRAMES: i64 = 16;
/// Packets of the next frame that end the wait for the rest of the current one.
const MOST_EARLY_PACKETS: usize = 8;
/// Number of closed frames to remember the packets of, to tell a packet that came twice from one that came late.
const REMEMBERED_FRAMES: usize = 4;
/// Packets after which another pace of columns shows.
const FIRST_PACKETS: usize = 2;
/// How far the clock may be from where the counter puts it: this part of a revolution, and of the time passed.
const CLOCK_TOLERANCE: (f64, f64) = (0.5, 0.05);

pub(super) struct Stream {
    format: PacketFormat,
    kernels: Kernels,
    current: Assembly,
    next: Assembly,
    /// Newest frame that was opened.
    newest: Option<u32>,
    /// The last accepted packet: where counter and clock stand.
    last: Option<Place>,
    closed: [Closed; REMEMBERED_FRAMES],
    closed_count: usize,
    /// Initialization id before the last restart.
    old_init_id: Option<u32>,
    strays: Strays,
    /// Refused packets since the last frame was closed, while none was open.
    rejected: u64,
    /// How many columns a revolution has is known of the packets: until then a frame waits for the next one's first packet.
    pub(super) is_settled: bool,
}

/// The packets of a closed frame.
#[derive(Clone, Default)]
struct Closed {
    frame_id: Option<u32>,
    init_id: u32,
    came: Vec<u64>,
    /// Packets of it that were counted as lost and have not come late.
    lost: u64,
}

impl Stream {
    pub(super) fn new(metadata: &Metadata) -> Self {
        let words = metadata.packet_slots().div_ceil(64);
        Self {
            format: metadata.packet_format(),
            kernels: kernels(metadata.profile),
            current: Assembly::new(metadata),
            next: Assembly::new(metadata),
            newest: None,
            last: None,
            closed: std::array::from_fn(|_| Closed { came: vec![0; words], ..Closed::default() }),
            closed_count: 0,
            old_init_id: None,
            strays: Strays::default(),
            rejected: 0,
            is_settled: true,
        }
    }

    /// The sensor is set differently than it was thought to be.
    pub(super) fn follow(&mut self, metadata: &Metadata) {
        self.format = metadata.packet_format();
        self.current.follow(metadata);
        self.next.follow(metadata);
        for closed in &mut self.closed {
            closed.came.resize(metadata.packet_slots().div_ceil(64), 0);
        }
    }

    /// Takes one whole and well-formed lidar packet.
    pub(super) fn take(&mut self, output: &mut Output<'_>, place: &Place, packet: &[u8]) {
        let Some(why) = self.stray(output.metadata, place) else {
            self.forget_strays(output.stats);
            self.accept(output, place, packet);
            return;
        };
        if !self.strays.agree(why, place, |from, to| self.distance(from, to)) {
            self.forget_strays(output.stats);
        }
        if self.strays.hold(why, place, packet) {
            self.believe_strays(output, why);
        }
    }

    /// A refused packet of this sensor: it explains one missing packet of the frame it came with.
    pub(super) fn note_rejected(&mut self) {
        if self.next.open {
            self.next.note_rejected(1);
        } else if self.current.open {
            self.current.note_rejected(1);
        } else {
            self.rejected += 1;
        }
    }

    /// Hands out what is under construction.
    pub(super) fn finish(&mut self, output: &mut Output<'_>) {
        self.forget_strays(output.stats);
        self.close_all(output, End::CutOff);
        self.restart();
    }

    /// The sensor is set otherwise from a packet of this frame on: what is under construction ends, but for a frame of which
    /// no more than its first packets came before that showed.
    pub(super) fn end_segment(&mut self, output: &mut Output<'_>, init_id: Option<u32>, frame_id: u32) {
        let before = self.last.map(|last| last.init_id);
        self.forget_strays(output.stats);
        let begins = |assembly: &Assembly| {
            let Frame { frame_id: own, packets, .. } = assembly.frame;
            assembly.open && own == frame_id && packets as usize <= FIRST_PACKETS && before == init_id
        };
        if begins(&self.next) {
            self.close_current(output, End::Followed);
            self.promote();
        }
        let is_begun = begins(&self.current);
        if !is_begun {
            self.close_all(output, End::CutOff);
        }
        self.restart();
        self.newest = is_begun.then_some(frame_id);
        if before.is_some() && before != init_id {
            self.old_init_id = before;
            output.stats.init_id_changes += 1;
        }
    }

    /// For sensors without lidar packets: a revolution known by its IMU and zone packets only.
    pub(super) fn note_revolution(&mut self, output: &mut Output<'_>, place: &Place) {
        if self.current.open && self.current.frame.frame_id != place.frame_id {
            if self.distance(self.current.frame.frame_id, place.frame_id) < 0 {
                return; // a straggler of a revolution that is over
            }
            self.close_current(output, End::Followed);
        }
        if !self.current.open {
            self.current.start(output, place, false);
        }
        self.current.frame.host_time_ns[1] = place.host_time_ns;
        self.current.frame.health = place.health;
    }

    /// Why a packet does not continue the stream, if so.
    fn stray(&self, metadata: &Metadata, place: &Place) -> Option<Stray> {
        let (newest, last) = (self.newest?, self.last?);
        if last.init_id != place.init_id {
            return Some(Stray::Restart);
        }
        let oldest_open = if self.current.open { self.current.frame.frame_id } else { newest };
        let distance = self.distance(oldest_open, place.frame_id);
        let closed = distance < 0 || distance == 0 && !self.current.open;
        match (closed, self.clock_fits(metadata, &last, place)) {
            (true, _) if distance >= -LATE_FRAMES => Some(Stray::Late),
            (true, _) => Some(Stray::Jump),
            (false, true) => None,
            (false, false) => Some(if distance <= 1 { Stray::Clock } else { Stray::Jump }),
        }
    }

    /// Frames from one counter value to another, in the shorter direction.
    fn distance(&self, from: u32, to: u32) -> i64 {
        let modulus = self.format.header.frame_ids() as i64;
        let ahead = (i64::from(to) - i64::from(from)).rem_euclid(modulus);
        if ahead > modulus / 2 { ahead - modulus } else { ahead }
    }

    /// Whether as much time passed between two packets as frame counter and columns say. In a window that goes
    /// through column 0 the counter may step at either end of it.
    fn clock_fits(&self, metadata: &Metadata, last: &Place, place: &Place) -> bool {
        let slots = place.slot as f64 - last.slot as f64;
        let turns = self.distance(last.frame_id, place.frame_id) as f64
            + slots * metadata.columns_per_packet as f64 / metadata.columns_per_frame as f64;
        let elapsed_ns = place.time_ns.wrapping_sub(last.time_ns) as i64;
        let elapsed = elapsed_ns as f64 * 1e-9 * metadata.frame_rate_hz;
        let tolerance = CLOCK_TOLERANCE.0 + CLOCK_TOLERANCE.1 * turns.abs();
        let wraps = metadata.column_window[0] > metadata.column_window[1];
        let off = (elapsed - turns).abs();
        off <= tolerance || wraps && (off - 1.0).abs() <= tolerance
    }

    /// Takes a packet that continues the stream.
    fn accept(&mut self, output: &mut Output<'_>, place: &Place, packet: &[u8]) {
        self.last = Some(*place);
        if !self.current.open {
            self.open(output, place, false);
        } else if self.current.frame.frame_id != place.frame_id {
            self.accept_early(output, place, packet);
            return;
        }
        if self.current.has(place.slot) {
            output.stats.duplicated += 1;
            return;
        }
        let behind = add(&mut self.current, &self.format, &self.kernels, output.metadata, place, packet);
        output.stats.reordered += u64::from(behind || self.next.open);
        if self.current.is_whole() && self.is_settled {
            self.close_current(output, End::Followed);
            self.promote();
        }
    }

    /// Takes a packet of a frame after the current one.
    fn accept_early(&mut self, output: &mut Output<'_>, place: &Place, packet: &[u8]) {
        if self.next.open && self.next.frame.frame_id != place.frame_id {
            let between = self.distance(self.next.frame.frame_id, place.frame_id) < 0;
            self.close_current(output, End::Followed);
            if between {
                // a frame that was counted as lost because a later one came first
                self.current.start(output, place, false);
                let expected = output.metadata.packets_per_frame() as u64;
                output.stats.lost_packets = output.stats.lost_packets.saturating_sub(expected);
                self.accept(output, place, packet);
                return;
            }
            self.promote();
        }
        if !self.next.open {
            self.open(output, place, true);
        }
        if self.next.has(place.slot) {
            output.stats.duplicated += 1;
            return;
        }
        let behind = add(&mut self.next, &self.format, &self.kernels, output.metadata, place, packet);
        output.stats.reordered += u64::from(behind);
        let patience = (output.metadata.packets_per_frame() / 4).clamp(2, MOST_EARLY_PACKETS);
        if self.next.is_whole() || self.next.frame.packets as usize >= patience || self.current.is_whole() {
            self.close_current(output, End::Followed);
            self.promote();
            if self.current.is_whole() {
                self.close_current(output, End::Followed);
            }
        }
    }

    /// Opens the current or the next frame and counts frames that never came at all.
    fn open(&mut self, output: &mut Output<'_>, place: &Place, as_next: bool) {
        if let Some(newest) = self.newest {
            let skipped = (self.distance(newest, place.frame_id) - 1).max(0) as u64;
            output.stats.lost_packets += skipped * output.metadata.packets_per_frame() as u64;
        }
        let joined = self.newest.is_none();
        self.newest = Some(place.frame_id);
        let rejected = if as_next { 0 } else { std::mem::take(&mut self.rejected) };
        let assembly = if as_next { &mut self.next } else { &mut self.current };
        assembly.start(output, place, joined);
        assembly.note_rejected(rejected);
    }

    fn promote(&mut self) {
        if !self.current.open {
            std::mem::swap(&mut self.current, &mut self.next);
        }
    }

    fn close_current(&mut self, output: &mut Output<'_>, end: End) {
        if !self.current.open {
            return;
        }
        let (lost, unexplained) =
            self.current.close(output.metadata, end, |slot| slot_order(output.metadata, slot));
        if self.next.open {
            self.next.note_rejected(unexplained);
        } else {
            self.rejected += unexplained;
        }
        let closed = &mut self.closed[self.closed_count % REMEMBERED_FRAMES];
        self.closed_count += 1;
        closed.frame_id = Some(self.current.frame.frame_id);
        closed.init_id = self.last.map_or(0, |last| last.init_id);
        closed.came.copy_from_slice(&self.current.came);
        closed.lost = lost;
        output.stats.lost_packets += lost;
        output.stats.frames += 1;
        output.stats.complete_frames += u64::from(self.current.frame.complete);
        output.completed.add_frame(std::mem::take(&mut self.current.frame));
    }

    /// Ends both frames, the newer one as `end` says.
    fn close_all(&mut self, output: &mut Output<'_>, end: End) {
        self.close_current(output, if self.next.open { End::Followed } else { end });
        self.promote();
        self.close_current(output, end);
    }

    fn restart(&mut self) {
        self.newest = None;
        self.last = None;
        self.rejected = 0;
        for closed in &mut self.closed {
            closed.frame_id = None;
        }
    }

    /// The held packets were no accident: the stream goes on with them.
    fn believe_strays(&mut self, output: &mut Output<'_>, why: Stray) {
        let has_init_id = output.metadata.profile.has_packet_header();
        let ahead = self
            .strays
            .places()
            .first()
            .zip(self.newest)
            .is_some_and(|(first, newest)| self.distance(newest, first.frame_id) > 0);
        if why == Stray::Clock {
            self.last = None; // the sensor's clock was set; its frames go on
        } else if why == Stray::Jump && has_init_id && ahead {
            self.close_all(output, End::Followed); // the sensor ran on unheard
            self.last = None;
        } else {
            self.close_all(output, End::CutOff);
            if why == Stray::Restart {
                self.old_init_id = self.last.map(|last| last.init_id);
            }
            // where packets name no initialization, the counter that started over tells
            output.stats.init_id_changes += u64::from(why == Stray::Restart || !has_init_id);
            self.restart();
        }
        let mut strays = std::mem::take(&mut self.strays);
        for (place, packet) in strays.packets() {
            self.take(output, place, packet);
        }
        if self.strays.why().is_none() {
            strays.clear();
            self.strays = strays; // keeps the buffers
        }
    }

    /// The stream went on as before: the held packets were late, or doubled, or damaged.
    fn forget_strays(&mut self, stats: &mut DecodeStats) {
        let Some(why) = self.strays.why() else { return };
        let strays = std::mem::take(&mut self.strays);
        for place in strays.places() {
            let of_before = self.old_init_id == Some(place.init_id);
            let behind = self.newest.is_some_and(|newest| self.distance(newest, place.frame_id) < 0);
            match why {
                Stray::Late => self.count_late(place, stats),
                Stray::Restart if of_before => stats.late += 1,
                Stray::Jump if behind => stats.late += 1,
                Stray::Clock | Stray::Jump | Stray::Restart => {
                    stats.packets -= 1; // counted too early
                    stats.malformed += 1;
                    self.note_rejected();
                }
            }
        }
        self.strays = strays;
        self.strays.clear();
    }

    /// A packet that came late is not lost; one that came before came twice.
    fn count_late(&mut self, place: &Place, stats: &mut DecodeStats) {
        let its_frame =
            |closed: &&mut Closed| closed.frame_id == Some(place.frame_id) && closed.init_id == place.init_id;
        let Some(closed) = self.closed.iter_mut().find(its_frame) else {
            stats.late += 1;
            return;
        };
        if has(&closed.came, place.slot) {
            stats.duplicated += 1;
            return;
        }
        closed.came[place.slot / 64] |= 1 << (place.slot % 64);
        let found = closed.lost.min(1);
        closed.lost -= found;
        stats.late += 1;
        stats.lost_packets = stats.lost_packets.saturating_sub(found);
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
