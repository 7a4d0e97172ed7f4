//! Packets of one Velodyne to frames.

use std::net::IpAddr;

use crate::catalogue;
use crate::completed::Completed;
use crate::decoder::{DecodeStats, Decoder, Rejected};
use crate::model::SensorModel;
use crate::packet::Packet;

use super::blocks::{self, BadBlocks};
use super::calibration::{StatusReader, UnitStatus};
use super::checks::{check, check_unknown, refuse_length};
use super::clock::{Follows, HourClock, Stamp};
use super::detect::{self, ENOUGH_PACKETS, Identity};
use super::heads::{Start, step_counts};
use super::odd_stamps::{Doubted, SecondClock};
use super::position::Position;
use super::product::{Product, ReturnMode};
use super::stream::{Cut, S1_PACKET_NS, Stream};
use super::window::{Held, Place, Window};
use super::wire::{DATA_PACKET_BYTES, DataPacket, POSITION_PACKET_BYTES};

/// How to decode.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// The product, where it is known; found from the packets otherwise.
    pub product: Option<Product>,
    /// The calibrated unit; the nominal model of the product otherwise. Decides no range: a frame holds raw ranges.
    pub model: Option<SensorModel>,
    /// What an HDL-64E says of itself, where that was read before: its own calibration holds from its first frame on.
    pub status: Option<UnitStatus>,
    /// Where frames end.
    pub cut: Cut,
    /// Sender; that of the first data packet otherwise.
    pub source: Option<IpAddr>,
    /// Packets held back to put swapped ones in order; [`DEFAULT_HELD_PACKETS`] otherwise. At least one: a packet
    /// that straddles a field-of-view window is dated by the one after it.
    pub held_packets: Option<usize>,
}

/// Packets held back by default (4 ms of a VLP-16).
pub const DEFAULT_HELD_PACKETS: usize = 3;

/// Decodes one sensor. In frames of two returns per firing the first layer is the last return, the second layer the
/// strongest, or the second strongest where the last is the strongest (which of the two the packet does not say);
/// a firing with one echo leaves the second layer empty. Frames of one return carry it in the first layer, strongest
/// or last as [`VelodyneDecoder::return_mode`] says.
#[derive(Debug)]
pub struct VelodyneDecoder {
    options: Options,
    pub(super) stats: DecodeStats,
    pub(super) source: Option<IpAddr>,
    /// Port that its data packets go to.
    pub(super) data_port: Option<u16>,
    undecided: Vec<Undecided>,
    pub(super) stream: Option<Stream>,
    model: Option<SensorModel>,
    mode: Option<ReturnMode>,
    /// Byte 1205 of the packets before; it does not change.
    pub(super) model_byte: Option<u8>,
    pub(super) clock: HourClock,
    /// Packets with stamps that are not believed yet, in the order they came.
    pub(super) doubted: Vec<Doubted>,
    pub(super) second_clock: SecondClock,
    /// Where the packet ended that came last, and how far its blocks are apart, counts.
    last_end: Option<[u16; 2]>,
    window: Window,
    /// Time stamps and first azimuths of packets decoded last, to tell a repeated packet from a late one.
    recent: std::collections::VecDeque<Start>,
    completed: Completed,
    status_reader: StatusReader,
    status: Option<UnitStatus>,
    calibrated_after_frames: Option<u64>,
}

#[derive(Debug)]
struct Undecided {
    host_ns: u64,
    payload: Box<[u8; DATA_PACKET_BYTES]>,
}

const RECENT_PACKETS: usize = 256;

impl VelodyneDecoder {
    /// A decoder that has seen nothing yet.
    pub fn new(options: Options) -> Self {
        let mut decoder = Self {
            source: options.source,
            data_port: None,
            options,
            stats: DecodeStats::default(),
            undecided: Vec::new(),
            stream: None,
            model: None,
            mode: None,
            model_byte: None,
            clock: HourClock::default(),
            doubted: Vec::new(),
            second_clock: SecondClock::default(),
            last_end: None,
            window: Window::default(),
            recent: std::collections::VecDeque::with_capacity(RECENT_PACKETS),
            completed: Completed::default(),
            status_reader: StatusReader::default(),
            status: None,
            calibrated_after_frames: None,
        };
        if let Some(product) = decoder.options.product
            && product != Product::Vls128
        {
            decoder.decide(Identity { product, cycle_ns: product.cycle_ns(), remark: None });
        }
        decoder
    }

    /// What sends the packets, once it is known.
    pub fn identity(&self) -> Option<&Identity> {
        self.stream.as_ref().map(|stream| &stream.identity)
    }

    /// Which returns the latest packet carried; none for HDL-64E: its packets do not report it.
    pub fn return_mode(&self) -> Option<ReturnMode> {
        self.mode
    }

    /// What an HDL-64E S2 or S3 reported about itself, its calibration included, once complete (about 1.2 s).
    pub fn unit_status(&self) -> Option<&UnitStatus> {
        self.status.as_ref()
    }

    /// How many frames were complete before the unit had sent its calibration; none where it has not.
    pub(crate) fn calibrated_after_frames(&self) -> Option<u64> {
        self.calibrated_after_frames
    }

    /// The azimuth at which it stands, degrees; none of a sensor that turns.
    pub(crate) fn still_at_deg(&self) -> Option<f64> {
        Some(f64::from(self.stream.as_ref()?.still_at_counts()?) / 100.0)
    }

    /// More packets come than one sensor can send.
    pub(crate) fn sends_too_often(&self) -> bool {
        self.stream.as_ref().is_some_and(Stream::is_too_fast)
    }

    /// Packets of two clocks come as one sensor's: those of the second are refused.
    pub(crate) fn has_second_clock(&self) -> bool {
        self.second_clock.is_certain()
    }

    fn decide(&mut self, identity: Identity) {
        let product = identity.product;
        self.model = self.options.model.clone().or_else(|| nominal(&identity));
        self.stream = Some(Stream::new(identity, self.options.cut));
        if let Some(status) = self.options.status.take() {
            self.believe(product, status);
        }
    }

    fn believe(&mut self, product: Product, status: UnitStatus) {
        if self.options.model.is_none()
            && status.calibrated.is_some()
            && let Ok(model) = status.calibration.model(product)
        {
            self.model = Some(model);
            self.calibrated_after_frames.get_or_insert(self.stats.frames);
        }
        self.status = Some(status);
    }

    fn take_any(&mut self, packet: &Packet<'_>) -> Result<(), Rejected> {
        if let Ok(payload) = <&[u8; DATA_PACKET_BYTES]>::try_from(packet.payload) {
            self.check_source(packet)?;
            match self.stream {
                Some(_) => self.accept(payload, packet.host_time_ns)?,
                None => self.keep_undecided(payload, packet.host_time_ns)?,
            }
            self.remember_source(packet);
            Ok(())
        } else if let Ok(payload) = <&[u8; POSITION_PACKET_BYTES]>::try_from(packet.payload) {
            self.check_source(packet)?;
            self.remember_source(packet);
            self.completed.add_position(Position::parse(payload, packet.host_time_ns));
            Ok(())
        } else {
            self.check_source(packet)?;
            Err(refuse_length(packet.payload))
        }
    }

    fn keep_undecided(&mut self, payload: &[u8; DATA_PACKET_BYTES], host_ns: u64) -> Result<(), Rejected> {
        check_unknown(DataPacket::of(payload))?;
        self.undecided.push(Undecided { host_ns, payload: Box::new(*payload) });
        self.try_to_decide(self.undecided.len() >= ENOUGH_PACKETS);
        Ok(())
    }

    fn try_to_decide(&mut self, all: bool) {
        let packets = self.undecided.iter().map(|undecided| DataPacket::of(&undecided.payload));
        let Some(mut identity) = detect::identify(packets, all) else { return };
        if let Some(product) = self.options.product {
            identity.product = product;
        }
        self.decide(identity);
        for undecided in std::mem::take(&mut self.undecided) {
            // the answer is no longer needed
            match self.accept(&undecided.payload, undecided.host_ns) {
                Ok(()) => {}
                Err(Rejected::Foreign { .. }) => self.stats.foreign += 1,
                Err(_) => self.stats.malformed += 1,
            }
        }
    }

    fn accept(&mut self, payload: &[u8; DATA_PACKET_BYTES], host_ns: u64) -> Result<(), Rejected> {
        let Some(stream) = &self.stream else { return Ok(()) };
        let bad = check(DataPacket::of(payload), stream, self.model_byte)?;
        let mended;
        let payload = if bad == BadBlocks::default() {
            payload
        } else {
            mended = blocks::mended(payload, stream.layout(DataPacket::of(payload)), bad);
            &mended
        };
        let data = DataPacket::of(payload);
        let is_timed = stream.product() != Product::Hdl64eS1;
        let period_ns = stream.period_ns(data);
        self.model_byte = Some(data.model_byte());
        self.mode = detect::mode(data).filter(|_| stream.product().model_byte().is_some());
        if !is_timed {
            if self.window.back().is_some_and(|newest| *newest.payload == *payload) {
                self.stats.duplicated += 1;
                return Ok(());
            }
            let time_ns = self.host_time_ns(host_ns);
            self.place(time_ns, Follows::On, host_ns, payload, bad);
            return Ok(());
        }
        let is_next = self.is_next(data);
        let stamp = Stamp { stamp_us: data.stamp_us(), host_ns, is_next, period_ns };
        match self.clock.resolve(stamp) {
            Some(resolved) => {
                if self.clock.newest_ns() == Some(resolved.time_ns) {
                    self.settle_doubted(Some(resolved.time_ns).filter(|_| resolved.follows == Follows::On));
                }
                self.place(resolved.time_ns, resolved.follows, host_ns, payload, bad);
            }
            None => self.doubt(stamp, payload, bad)?,
        }
        Ok(())
    }

    /// Whether a packet goes on at the azimuth where the one that came before it ended.
    fn is_next(&mut self, data: DataPacket<'_>) -> bool {
        let Some(stream) = &self.stream else { return false };
        let mut last = stream.layout(data).sequences.iter().rev().filter(|s| s.after_azimuth == 0);
        let last = [last.next(), last.next()].map(|s| s.map(|s| data.azimuth(usize::from(s.block))));
        let before = std::mem::take(&mut self.last_end);
        if let [Some(end), Some(earlier)] = last {
            let step = step_counts(earlier, end);
            self.last_end = (step > 0.0).then_some([end, step as u16]);
        }
        let Some([end, step]) = before else { return false };
        let ahead = step_counts(end, data.azimuth(0));
        (ahead - f64::from(step)).abs() <= 0.5 * f64::from(step)
    }

    /// Time of the newest packet that has its place, ns.
    pub(super) fn newest_placed_ns(&self) -> Option<u64> {
        let held = self.window.back().map(|held| held.time_ns);
        held.or(self.recent.back().map(|recent| recent.time_ns))
    }

    /// Puts a packet with a known time in its place.
    pub(super) fn place(
        &mut self,
        time_ns: u64,
        follows: Follows,
        host_ns: u64,
        payload: &[u8; DATA_PACKET_BYTES],
        bad: BadBlocks,
    ) {
        if follows != Follows::On {
            self.stats.pauses += u64::from(follows == Follows::Pause);
            self.flush();
            self.close_frame();
            self.recent.clear();
        }
        self.stats.bad_blocks += bad.count() as u64;
        if let Some(Start { time_ns: last_ns, .. }) = self.recent.back()
            && time_ns <= *last_ns
        {
            self.take_late(time_ns, host_ns, payload, bad);
            return;
        }
        match self.window.insert(time_ns, host_ns, payload, bad) {
            Place::Duplicate => {
                self.stats.duplicated += 1;
                return;
            }
            Place::Between => self.stats.reordered += 1,
            Place::Last => {}
        }
        self.stats.packets += 1;
        let held = self.options.held_packets.unwrap_or(DEFAULT_HELD_PACKETS).max(1);
        while self.window.len() > held {
            self.take_next();
        }
    }

    /// Time of a packet without a stamp: its arrival, or one period after the packet before.
    fn host_time_ns(&self, host_ns: u64) -> u64 {
        match (host_ns, self.newest_placed_ns()) {
            (0, None) => 0,
            (0, Some(newest_ns)) => newest_ns + S1_PACKET_NS as u64,
            (host_ns, newest_ns) => host_ns.max(newest_ns.map_or(0, |newest_ns| newest_ns + 1)),
        }
    }

    fn take_next(&mut self) {
        let (Some(product), Some(held)) = (self.stream.as_ref().map(Stream::product), self.window.pop())
        else {
            return;
        };
        if self.recent.len() == RECENT_PACKETS {
            self.recent.pop_front();
        }
        self.recent.push_back(held.start());
        if matches!(product, Product::Hdl64eS2 | Product::Hdl64eS3) {
            let packet = DataPacket::of(&held.payload);
            if let Some(status) = self.status_reader.push(packet.mode_byte(), packet.model_byte()) {
                self.believe(product, status);
            }
        }
        let Some(stream) = &mut self.stream else { return };
        stream.take(&held, self.window.front(), &mut self.stats, &mut self.completed);
        self.window.recycle(held);
    }

    /// Takes a packet that is older than what was decoded last.
    fn take_late(&mut self, time_ns: u64, host_ns: u64, payload: &[u8; DATA_PACKET_BYTES], bad: BadBlocks) {
        let itself = Start { time_ns, azimuth_counts: DataPacket::of(payload).azimuth(0) };
        if self.recent.contains(&itself) {
            self.stats.duplicated += 1;
            return;
        }
        // it was counted as lost when its successor came
        self.stats.lost_packets = self.stats.lost_packets.saturating_sub(1);
        let Some(stream) = &mut self.stream else { return };
        if stream.open_since_ns().is_none_or(|since_ns| time_ns < since_ns) {
            self.stats.late += 1;
            return;
        }
        self.stats.packets += 1;
        self.stats.reordered += 1;
        let held = Held { time_ns, host_ns, bad, payload: Box::new(*payload) };
        let at = self.recent.partition_point(|recent| recent.time_ns <= time_ns);
        stream.take_late(&held, self.recent.get(at).copied());
        self.recent.insert(at, itself);
    }

    fn flush(&mut self) {
        while self.window.len() > 0 {
            self.take_next();
        }
    }

    fn close_frame(&mut self) {
        if let Some(stream) = &mut self.stream {
            stream.close(false, &mut self.stats, &mut self.completed);
            stream.forget_previous();
        }
    }
}

impl Decoder for VelodyneDecoder {
    fn take(&mut self, packet: &Packet<'_>) -> Result<(), Rejected> {
        let result = self.take_any(packet);
        match &result {
            Err(Rejected::Foreign { .. }) => self.stats.foreign += 1,
            Err(_) => {
                self.stats.malformed += 1;
                self.stream.iter_mut().for_each(|stream| stream.refused.note());
            }
            Ok(()) => {}
        }
        result
    }

    fn end(&mut self) {
        if self.stream.is_none() {
            self.try_to_decide(true);
        }
        self.end_doubt();
        self.flush();
        self.close_frame();
    }

    fn completed(&self) -> &Completed {
        &self.completed
    }

    fn completed_mut(&mut self) -> &mut Completed {
        &mut self.completed
    }

    fn stats(&self) -> &DecodeStats {
        &self.stats
    }

    /// The model given in [`Options`], or the nominal one with fire offsets that follow the measured cycle, or, once an
    /// HDL-64E has sent it, the unit's own calibration.
    fn model(&self) -> Option<&SensorModel> {
        self.model.as_ref()
    }
}

/// The nominal model of a product, its fire offsets stretched to the measured cycle.
fn nominal(identity: &Identity) -> Option<SensorModel> {
    let model = catalogue::nominal(identity.product.name()).ok()?;
    let stretch = identity.cycle_ns / identity.product.cycle_ns();
    let mut beams = model.beams().to_vec();
    for beam in &mut beams {
        beam.fire_offset_ns *= stretch;
    }
    Some(model.with_beams(beams))
}
