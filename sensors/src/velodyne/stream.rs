//! From ordered packets of one sensor to frames: what is lost in between, and where a revolution ends.

use crate::completed::Completed;
use crate::decoder::DecodeStats;

use super::building::Building;
use super::detect::{ENOUGH_PACKETS, Identity, is_dual};
use super::heads::{Heads, Spin, Start, is_gap, step_counts};
use super::product::Product;
use super::view::ViewWindows;
use super::window::Held;
use super::wire::{AZIMUTH_COUNTS, DataPacket, Layout};

/// Where one frame ends and the next begins.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Cut {
    /// Frames are whole packets: the packet in which a revolution is reached, counted from the end of the packet
    /// that closed the frame before, is the frame's last. No packet is split and the first frame is a whole
    /// revolution, from wherever the recording begins.
    #[default]
    Packets,
    /// Frames begin with the first firing sequence at or after this encoder azimuth (clockwise), rad; the first and
    /// the last frame are parts of a revolution.
    Azimuth(f64),
}

/// The layouts of a product's packets.
#[derive(Debug)]
struct Layouts {
    single: Layout,
    dual: Layout,
    /// That of the packet in hand, of an HDL-64E S1.
    by_flags: Layout,
}

impl Layouts {
    fn of(&self, packet: DataPacket<'_>, product: Product) -> &Layout {
        match product {
            Product::Hdl64eS1 => &self.by_flags,
            _ if is_dual(packet, product) => &self.dual,
            _ => &self.single,
        }
    }
}

/// A packet of an HDL-64E S1, ns: as seen by hosts; it has no clock.
pub(crate) const S1_PACKET_NS: f64 = 384_300.0;

/// Columns at which a frame ends without a whole turn, so that a sensor that stands still fills no memory: those of a
/// second or more, and the slowest turn takes a fifth of that.
const MOST_COLUMNS: usize = 1 << 15;

/// A turn, counts.
const TURN: f64 = AZIMUTH_COUNTS as f64;

/// Decodes packets in order.
#[derive(Debug)]
pub(crate) struct Stream {
    pub identity: Identity,
    cut: Cut,
    layouts: Layouts,
    heads: Heads,
    building: Building,
    /// Contiguous travel of the frame before, for the rate while the present one is young.
    spin_before: Spin,
    previous: Option<Previous>,
    windows: ViewWindows,
    is_dual: bool,
    frames: u32,
    /// Whether the frame under construction began where a frame should.
    begun_whole: bool,
    pub refused: Refused,
    /// Azimuth travelled over all packets, counts, and how many packets these were: a sensor that does not turn shows by it.
    turned: (f64, u64),
    pace: Pace,
}

/// How fast packets come, by their own stamps. Stamps alone may lie: those of two sensors go on at two azimuths, too.
#[derive(Debug, Default)]
struct Pace {
    since_ns: u64,
    packets: u32,
    breaks: u32,
    is_too_fast: bool,
}

impl Pace {
    /// Packets that show it.
    const PACKETS: u32 = 64;

    fn add(&mut self, time_ns: u64, period_ns: i64, goes_on: bool) {
        if self.packets == 0 {
            (self.since_ns, self.breaks) = (time_ns, 0);
        }
        self.packets += 1;
        self.breaks += u32::from(!goes_on);
        if self.packets > Self::PACKETS {
            let span_ns = time_ns.saturating_sub(self.since_ns) as f64;
            let is_fast = 1.5 * span_ns < f64::from(Self::PACKETS) * period_ns as f64;
            self.is_too_fast |= is_fast && 2 * self.breaks > Self::PACKETS;
            self.packets = 0;
        }
    }
}

/// Packets of this sensor that came and could not be used: each explains one that is missing nearby.
#[derive(Debug, Default)]
pub(crate) struct Refused {
    packets: u64,
    /// Packets after which they explain nothing any more.
    left: u32,
}

impl Refused {
    const NEARBY: u32 = 16;

    pub(crate) fn note(&mut self) {
        self.packets += 1;
        self.left = Self::NEARBY;
    }

    /// How many of the lost packets they are.
    fn excuse(&mut self, lost: u64) -> u64 {
        let excused = self.packets.min(lost);
        self.left = self.left.saturating_sub(1);
        self.packets = if self.left == 0 { 0 } else { self.packets - excused };
        excused
    }
}

/// The packet before.
#[derive(Clone, Copy, Debug)]
struct Previous {
    last_counts: u16,
    end_ns: u64,
    /// Azimuth since the frame began ([`Cut::Packets`]) or since the cut angle ([`Cut::Azimuth`]), counts.
    travelled_counts: f64,
}

/// What lies between a packet and the one before.
#[derive(Clone, Copy, Debug, Default)]
struct Between {
    /// Azimuth from the last block of the one to the first block of the other, whole turns included, counts.
    step_counts: f64,
    lost: u64,
}

impl Stream {
    pub(crate) fn new(identity: Identity, cut: Cut) -> Self {
        let product = identity.product;
        Self {
            layouts: Layouts {
                single: Layout::of(product, false),
                dual: Layout::of(product, true),
                by_flags: Layout::default(),
            },
            identity,
            cut,
            heads: Heads::default(),
            building: Building::default(),
            spin_before: Spin::default(),
            previous: None,
            windows: ViewWindows::default(),
            is_dual: false,
            frames: 0,
            begun_whole: cut == Cut::Packets,
            refused: Refused::default(),
            turned: (0.0, 0),
            pace: Pace::default(),
        }
    }

    pub(crate) fn product(&self) -> Product {
        self.identity.product
    }

    /// The layout of a packet.
    pub(crate) fn layout(&self, packet: DataPacket<'_>) -> &Layout {
        self.layouts.of(packet, self.product())
    }

    /// Time from one packet to the next, ns.
    pub(crate) fn period_ns(&self, packet: DataPacket<'_>) -> i64 {
        (self.layout(packet).sequences.len() as f64 * self.identity.cycle_ns) as i64
    }

    /// Whether more packets come than one sensor can send.
    pub(crate) fn is_too_fast(&self) -> bool {
        self.pace.is_too_fast
    }

    /// The azimuth at which the sensor stands, counts; none of one that turns, or of which too little was seen.
    pub(crate) fn still_at_counts(&self) -> Option<u16> {
        let (travelled_counts, packets) = self.turned;
        (packets >= ENOUGH_PACKETS as u64 && travelled_counts.abs() < packets as f64)
            .then_some(self.heads.last_counts)
    }

    /// Device time of the first column of the open frame.
    pub(crate) fn open_since_ns(&self) -> Option<u64> {
        self.building.first_time_ns()
    }

    /// Takes the next packet in order; `next` is the one after it, where it is known.
    pub(crate) fn take(
        &mut self,
        held: &Held,
        next: Option<&Held>,
        stats: &mut DecodeStats,
        completed: &mut Completed,
    ) {
        let packet = DataPacket::of(&held.payload);
        let dual = is_dual(packet, self.product());
        if dual != self.is_dual && !self.building.is_empty() {
            self.close(false, stats, completed);
            self.previous = None;
        }
        self.is_dual = dual;
        if self.building.is_empty() {
            self.restart(completed);
        }
        self.read_heads(held, next.map(Held::start));
        for gap in &self.heads.gaps {
            stats.lost_packets = stats.lost_packets.saturating_sub(self.windows.learn(*gap));
        }
        let between = self.between();
        // what came damaged is not lost
        let refused = self.refused.excuse(between.lost);
        stats.lost_packets += between.lost - refused;
        self.building.lost += between.lost;
        if self.identity.product != Product::Hdl64eS1 {
            self.pace.add(held.time_ns, self.period_ns(packet), self.goes_on());
        }
        self.turned.0 += between.step_counts + self.heads.travelled_counts;
        self.turned.1 += 1;
        match self.cut {
            Cut::Packets => self.take_whole(held, between, stats, completed),
            Cut::Azimuth(cut_rad) => self.take_by_azimuth(held, between, cut_rad, stats, completed),
        }
    }

    /// Takes a packet that came late, into the frame that is still open; `next` is the one after it in time.
    pub(crate) fn take_late(&mut self, held: &Held, next: Option<Start>) {
        let heads = self.heads.clone();
        self.read_heads(held, next);
        self.building.lost = self.building.lost.saturating_sub(1);
        self.append(held, 0..self.heads.heads.len());
        self.heads = heads;
    }

    /// Ends the open frame where it is.
    pub(crate) fn close(&mut self, complete: bool, stats: &mut DecodeStats, completed: &mut Completed) {
        if self.building.is_empty() {
            return;
        }
        let complete = complete && self.begun_whole;
        let frame = self.building.close(complete);
        stats.frames += 1;
        stats.complete_frames += u64::from(frame.complete);
        completed.add_frame(frame);
        self.frames = self.frames.wrapping_add(1);
        self.spin_before = self.building.spin;
        self.restart(completed);
        self.begun_whole = self.cut == Cut::Packets;
    }

    fn restart(&mut self, completed: &mut Completed) {
        if self.building.lacks_buffers() {
            self.building.fill_with(completed.spent_frame().unwrap_or_default());
        }
        self.building.restart(self.frames, self.identity.product.lasers(), self.is_dual);
    }

    /// Forgets the packet before: time or sensor started again.
    pub(crate) fn forget_previous(&mut self) {
        self.previous = None;
        self.pace = Pace { is_too_fast: self.pace.is_too_fast, ..Pace::default() };
    }

    /// Whether the packet in hand goes on at the azimuth where the one before ended.
    fn goes_on(&self) -> bool {
        let Some(previous) = self.previous else { return true };
        let blocks = self.heads.blocks();
        let usual = self.heads.travelled_counts / (blocks.max(2) - 1) as f64;
        blocks < 2 || !is_gap(step_counts(previous.last_counts, self.heads.first_counts), usual)
    }

    fn read_heads(&mut self, held: &Held, next: Option<Start>) {
        let packet = DataPacket::of(&held.payload);
        let product = self.identity.product;
        if product == Product::Hdl64eS1 {
            self.layouts.by_flags.by_flags(packet);
            self.identity.cycle_ns = S1_PACKET_NS / self.layouts.by_flags.sequences.len() as f64;
        }
        let cycle_ns = self.identity.cycle_ns;
        let lead_ns = product.stamp_lead_ns(cycle_ns).round() as u64;
        let following = next.map(|next| Start { time_ns: next.time_ns.saturating_sub(lead_ns), ..next });
        let layout = self.layouts.of(packet, product);
        let spin = self.spin();
        let time_ns = held.time_ns.saturating_sub(lead_ns);
        self.heads.fill(packet, layout, cycle_ns, time_ns, spin, following);
    }

    /// The best record of the spin there is.
    fn spin(&self) -> Spin {
        let present = self.building.spin;
        if present.time_ns >= self.spin_before.time_ns.min(LONG_SPIN_NS) { present } else { self.spin_before }
    }

    fn between(&mut self) -> Between {
        let Some(previous) = self.previous else { return Between::default() };
        let sequences = self.heads.heads.len().max(1) as f64;
        let cycle_ns = self.identity.cycle_ns;
        let period_ns = sequences * cycle_ns;
        let step = step_counts(previous.last_counts, self.heads.first_counts);
        let start_ns = self.heads.heads.first().map_or(previous.end_ns, |head| head.time_ns);
        let pause_ns = start_ns.wrapping_sub(previous.end_ns) as i64 as f64;
        let Some(rate) = self.spin().rate().or(self.heads.spin.rate()).filter(|rate| *rate > 0.0) else {
            return Between { step_counts: step, lost: (pause_ns / period_ns).round().max(0.0) as u64 };
        };
        let usual = rate * cycle_ns * sequences / self.heads.blocks().max(1) as f64;
        // one usual step passes between neighbours; the pause comes on top
        let expected = rate * pause_ns + usual;
        let has_clock = self.identity.product != Product::Hdl64eS1;
        // without a clock of the sensor, swapped packets are not put in order: a step can go back
        let least_turns = if has_clock { 0.0 } else { -1.0 };
        let whole_turns = ((expected - step) / TURN).round().max(least_turns);
        let unwrapped = step + whole_turns * TURN;
        // of few sequences a packet turns hardly further than a gap is wide: stamps and azimuths together tell that one is missing
        let is_missing =
            has_clock && pause_ns > 0.5 * period_ns && unwrapped > usual + 0.5 * rate * period_ns;
        if !is_gap(unwrapped, usual) && !is_missing {
            self.building.spin.add(Spin { travelled_counts: step, time_ns: usual / rate });
            return Between { step_counts: step, lost: 0 };
        }
        if !has_clock {
            let lost = ((unwrapped - usual) / (rate * period_ns)).round().max(0.0) as u64;
            return Between { step_counts: unwrapped, lost };
        }
        if pause_ns < 0.5 * period_ns {
            return Between { step_counts: unwrapped, lost: 0 };
        }
        let dark_ns = self.windows.dark_counts(previous.last_counts, unwrapped) / rate;
        let lost = ((pause_ns - dark_ns) / period_ns).round().max(0.0) as u64;
        if lost > 0 {
            self.windows.suspect([previous.last_counts, self.heads.first_counts], lost);
        }
        Between { step_counts: unwrapped, lost }
    }

    fn take_whole(
        &mut self,
        held: &Held,
        between: Between,
        stats: &mut DecodeStats,
        completed: &mut Completed,
    ) {
        let mut travelled = match self.previous {
            None => 0.0,
            Some(previous) => {
                let at_start = previous.travelled_counts + between.step_counts;
                if at_start >= TURN && between.lost > 0 {
                    self.close(true, stats, completed);
                    self.building.lost = between.lost;
                    self.heads.travelled_counts
                } else {
                    at_start + self.heads.travelled_counts
                }
            }
        };
        self.append(held, 0..self.heads.heads.len());
        self.building.spin.add(self.heads.spin);
        if travelled >= TURN || self.building.columns() >= MOST_COLUMNS {
            self.close(travelled >= TURN, stats, completed);
            travelled = 0.0;
        }
        self.remember(travelled);
    }

    fn take_by_azimuth(
        &mut self,
        held: &Held,
        between: Between,
        cut_rad: f64,
        stats: &mut DecodeStats,
        completed: &mut Completed,
    ) {
        let cut = (cut_rad.to_degrees() * 100.0).rem_euclid(TURN);
        let first = f64::from(self.heads.first_counts);
        let start = match self.previous {
            None => (first - cut).rem_euclid(TURN),
            Some(previous) => previous.travelled_counts + between.step_counts,
        };
        let mut turn = turns(self.previous.map_or(start, |previous| previous.travelled_counts));
        let (mut position, mut azimuth, mut from) = (start, first, 0);
        for column in 0..self.heads.heads.len() {
            let next = self.heads.heads[column].azimuth_counts;
            let step = (next - azimuth).rem_euclid(TURN);
            position += if step > TURN - 100.0 { step - TURN } else { step };
            azimuth = next;
            if turns(position) > turn {
                turn = turns(position);
                self.append(held, from..column);
                from = column;
                self.close(true, stats, completed);
                self.begun_whole = true;
                self.building.lost = if column == 0 { between.lost } else { 0 };
            }
        }
        self.append(held, from..self.heads.heads.len());
        self.building.spin.add(self.heads.spin);
        if self.building.columns() >= MOST_COLUMNS {
            self.close(false, stats, completed);
        }
        self.remember(start + self.heads.travelled_counts);
    }

    fn append(&mut self, held: &Held, range: std::ops::Range<usize>) {
        if range.is_empty() {
            return;
        }
        let packet = DataPacket::of(&held.payload);
        let product = self.identity.product;
        let layout = self.layouts.of(packet, product);
        self.building.count_packet(held.host_ns);
        let unit_mm = product.distance_unit_mm();
        self.building.append(packet, layout, &self.heads.heads, range, unit_mm, held.bad);
    }

    fn remember(&mut self, travelled_counts: f64) {
        self.previous = Some(Previous {
            last_counts: self.heads.last_counts,
            end_ns: self.heads.end_ns,
            travelled_counts,
        });
    }
}

/// A record of the spin this long is as good as a longer one, ns.
const LONG_SPIN_NS: f64 = 2e7;

/// Whole turns in a position; the tolerance keeps sums of interpolated steps on the right side of a cut.
fn turns(position_counts: f64) -> f64 {
    (position_counts + 1e-6).div_euclid(TURN)
}
