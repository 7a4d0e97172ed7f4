//! Packets that do not continue the stream, held until it is clear what they are.

use super::assembly::Place;

/// Packets in a row that make a jump or a restart believable, when nothing else explains them.
const JUMP_PACKETS: usize = 3;
/// The same for packets that could as well be late or doubled ones of closed frames.
const LATE_PACKETS: usize = 16;

/// Why a packet does not continue the stream.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) enum Stray {
    /// Of a frame closed not long ago: late or doubled, unless the counter started over.
    Late,
    /// Of this or the next frame by its counter, but at a time that does not fit.
    Clock,
    /// Of a frame far away, at a time that does not fit.
    Jump,
    /// The sensor was initialised again.
    Restart,
}

/// Held packets of one kind, in the order they came.
#[derive(Default)]
pub(super) struct Strays {
    why: Option<Stray>,
    places: Vec<Place>,
    bytes: Vec<u8>,
}

impl Strays {
    pub(super) fn why(&self) -> Option<Stray> {
        self.why
    }

    pub(super) fn places(&self) -> &[Place] {
        &self.places
    }

    /// Whether a packet tells the same story as those held before it. `distance` counts frames from one counter
    /// value to another.
    pub(super) fn agree(&self, why: Stray, place: &Place, distance: impl Fn(u32, u32) -> i64) -> bool {
        let Some(last) = self.places.last() else { return true };
        let near = why == Stray::Late || (0..=1).contains(&distance(last.frame_id, place.frame_id));
        self.why == Some(why) && last.init_id == place.init_id && near
    }

    /// Holds a packet; true when the held ones are believable.
    pub(super) fn hold(&mut self, why: Stray, place: &Place, packet: &[u8]) -> bool {
        self.why = Some(why);
        self.places.push(*place);
        self.bytes.extend_from_slice(packet);
        self.places.len() >= if why == Stray::Late { LATE_PACKETS } else { JUMP_PACKETS }
    }

    /// The held packets with their places; all have one length.
    pub(super) fn packets(&self) -> impl Iterator<Item = (&Place, &[u8])> {
        let length = self.bytes.len() / self.places.len().max(1);
        self.places.iter().zip(self.bytes.chunks_exact(length.max(1)))
    }

    pub(super) fn clear(&mut self) {
        self.why = None;
        self.places.clear();
        self.bytes.clear();
    }
}
