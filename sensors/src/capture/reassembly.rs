//! IP fragments back to UDP datagrams (RFC 791 section 3.2, RFC 8200 section 4.5), in bounded memory.
//!
//! Sensors with large packets count identifications fast, and a capture may miss fragments: two datagrams can carry
//! the same identification. A fragment therefore joins a datagram only where its bytes are still missing; where they
//! are there already with other content, a second datagram with that identification begins.

use std::net::IpAddr;

use crate::Link;

/// Most datagrams open at once; Linux allows for fewer bytes.
const SLOTS: usize = 64;
/// A datagram is given up when its last fragment is older than this. Fragments of one datagram leave a sensor back to
/// back; a 16-bit identification comes round after 51 s at the 1280 packets per second of an OS1-128.
const LIFETIME_NS: u64 = 2_000_000_000;
/// A datagram has at most 65535 bytes and fragments begin at multiples of 8.
const UNITS: usize = 8192;

/// Which datagram a fragment of UDP belongs to.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) struct Key {
    pub(super) source: IpAddr,
    pub(super) destination: IpAddr,
    pub(super) link: Link,
    pub(super) identification: u32,
}

pub(super) struct Fragment<'a> {
    pub(super) key: Key,
    pub(super) offset: usize,
    pub(super) more: bool,
    pub(super) payload: &'a [u8],
}

impl Key {
    /// A number that differs where keys differ, but for rare accidents.
    fn mark(&self) -> u64 {
        let number = |address: IpAddr| match address {
            IpAddr::V4(address) => u64::from(address.to_bits()),
            IpAddr::V6(address) => (address.to_bits() >> 64) as u64 ^ address.to_bits() as u64,
        };
        let mixed = number(self.source).wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ number(self.destination);
        mixed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ u64::from(self.identification)
    }
}

impl Fragment<'_> {
    /// Its units of 8 bytes in a bitmap: words, and which bits of each.
    fn words(&self) -> impl Iterator<Item = (usize, u64)> {
        let (first, end) = (self.offset / 8, (self.offset + self.payload.len()).div_ceil(8));
        (first / 64..end.div_ceil(64)).map(move |word| {
            let (from, to) = (first.saturating_sub(word * 64), (end - word * 64).min(64));
            (word, u64::MAX << from & u64::MAX >> (64 - to))
        })
    }
}

/// What a fragment did.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Added {
    /// Its datagram is complete: [`Reassembly::datagram`] has it until the next fragment.
    Complete(usize),
    Waiting,
    Duplicate,
    /// Past the end of any datagram, or not in steps of 8 bytes.
    Malformed,
}

#[derive(Default)]
pub(super) struct Reassembly {
    slots: Vec<Slot>,
    /// Of each slot's key: most fragments are distinguished by these alone.
    marks: Vec<u64>,
    /// Where the fragment before went.
    latest: usize,
    /// No slot is older or newer than these, so that slots are looked through for old ones only when there may be one.
    times_ns: Option<[u64; 2]>,
    /// Ever increasing, to tell older from newer slots.
    turn: u64,
    incomplete: u64,
}

struct Slot {
    key: Key,
    state: State,
    begun: u64,
    time_ns: u64,
    data: Vec<u8>,
    have: Box<[u64; UNITS / 64]>,
    units: usize,
    total: Option<usize>,
}

/// In the order in which slots are used again.
#[derive(Clone, Copy, PartialEq, Eq)]
enum State {
    Free,
    /// Delivered; remembered to recognise fragments that come twice.
    Complete,
    Waiting,
}

impl Reassembly {
    /// Datagrams given up because a fragment never came.
    pub(super) fn incomplete(&self) -> u64 {
        self.incomplete
    }

    /// The datagram that [`Added::Complete`] named.
    pub(super) fn datagram(&self, slot: usize) -> &[u8] {
        let slot = &self.slots[slot];
        &slot.data[..slot.total.unwrap_or(0)]
    }

    pub(super) fn add(&mut self, fragment: &Fragment<'_>, time_ns: u64) -> Added {
        let end = fragment.offset + fragment.payload.len();
        let uneven = fragment.more && !fragment.payload.len().is_multiple_of(8);
        if fragment.payload.is_empty() || end > 65535 || uneven {
            return Added::Malformed;
        }
        self.expire(time_ns);
        let at = match self.newest_match(fragment, Slot::misses) {
            Some(at) => at,
            None if self.newest_match(fragment, Slot::repeats).is_some() => return Added::Duplicate,
            None => self.begin(fragment.key),
        };
        self.latest = at;
        self.times_ns = match self.times_ns {
            Some([oldest, newest]) => Some([oldest.min(time_ns), newest.max(time_ns)]),
            None => Some([time_ns; 2]),
        };
        let slot = &mut self.slots[at];
        slot.time_ns = time_ns;
        if slot.take(fragment) { Added::Complete(at) } else { Added::Waiting }
    }

    /// The slot begun last, of those with the fragment's key that fit.
    fn newest_match(&self, fragment: &Fragment<'_>, fits: fn(&Slot, &Fragment<'_>) -> bool) -> Option<usize> {
        let matches = |slot: &Slot| slot.key == fragment.key && fits(slot, fragment);
        if self.slots.get(self.latest).is_some_and(|slot| slot.begun == self.turn && matches(slot)) {
            return Some(self.latest); // none was begun later
        }
        let mark = fragment.key.mark();
        let found = self.marks.iter().enumerate().filter(|(_, other)| **other == mark);
        found.map(|(at, _)| at).filter(|at| matches(&self.slots[*at])).max_by_key(|at| self.slots[*at].begun)
    }

    /// Gives up every open datagram: the capture is over.
    pub(super) fn finish(&mut self) {
        self.incomplete += self.slots.iter().filter(|slot| slot.state == State::Waiting).count() as u64;
        self.slots.clear();
        self.marks.clear();
        self.times_ns = None;
    }

    fn expire(&mut self, now_ns: u64) {
        let none_is_old =
            |times_ns: [u64; 2]| times_ns.iter().all(|time_ns| time_ns.abs_diff(now_ns) <= LIFETIME_NS);
        if self.times_ns.is_none_or(none_is_old) {
            return;
        }
        self.times_ns = None;
        for slot in self.slots.iter_mut().filter(|slot| slot.state != State::Free) {
            if slot.time_ns.abs_diff(now_ns) > LIFETIME_NS {
                self.incomplete += u64::from(slot.state == State::Waiting);
                slot.state = State::Free;
            } else {
                let [oldest, newest] = self.times_ns.unwrap_or([slot.time_ns; 2]);
                self.times_ns = Some([oldest.min(slot.time_ns), newest.max(slot.time_ns)]);
            }
        }
    }

    /// A fresh slot: a free one, a new one, the oldest complete one, or the oldest at all, which is given up.
    fn begin(&mut self, key: Key) -> usize {
        self.turn += 1;
        // state first, then age, in one number
        let order = |slot: &Slot| (slot.state as u64) << 62 | slot.begun;
        let reused = self.slots.iter().enumerate().min_by_key(|(_, slot)| order(slot));
        let reused = match reused {
            Some((at, slot)) if slot.state == State::Free || self.slots.len() == SLOTS => Some(at),
            _ => None,
        };
        let at = reused.unwrap_or(self.slots.len());
        if reused.is_none() {
            let have = Box::new([0; UNITS / 64]);
            self.slots.push(Slot {
                key,
                state: State::Free,
                begun: 0,
                time_ns: 0,
                data: Vec::new(),
                have,
                units: 0,
                total: None,
            });
            self.marks.push(0);
        }
        self.marks[at] = key.mark();
        let slot = &mut self.slots[at];
        self.incomplete += u64::from(slot.state == State::Waiting);
        (slot.key, slot.state, slot.begun, slot.total) = (key, State::Waiting, self.turn, None);
        slot.data.clear();
        slot.have.fill(0);
        slot.units = 0;
        at
    }
}

impl Slot {
    /// Waiting, and nothing of the fragment is there yet, nor does it contradict what is.
    fn misses(&self, fragment: &Fragment<'_>) -> bool {
        let end = fragment.offset + fragment.payload.len();
        let fits = match (self.total, fragment.more) {
            (Some(total), true) => end <= total,
            (Some(_), false) => false,
            (None, true) => true,
            (None, false) => self.data.len() <= end,
        };
        self.state == State::Waiting
            && fits
            && fragment.words().all(|(word, bits)| self.have[word] & bits == 0)
    }

    /// Every byte of the fragment is there already, the same.
    fn repeats(&self, fragment: &Fragment<'_>) -> bool {
        let end = fragment.offset + fragment.payload.len();
        self.state != State::Free
            && fragment.words().all(|(word, bits)| self.have[word] & bits == bits)
            && self.data.get(fragment.offset..end) == Some(fragment.payload)
    }

    /// Takes the bytes in; whether the datagram is complete now.
    fn take(&mut self, fragment: &Fragment<'_>) -> bool {
        let end = fragment.offset + fragment.payload.len();
        if self.data.len() == fragment.offset {
            self.data.extend_from_slice(fragment.payload);
        } else {
            self.data.resize(self.data.len().max(end), 0);
            self.data[fragment.offset..end].copy_from_slice(fragment.payload);
        }
        for (word, bits) in fragment.words() {
            self.have[word] |= bits;
            self.units += bits.count_ones() as usize; // none was there before
        }
        if !fragment.more {
            self.total = Some(end);
        }
        let complete = self.total.is_some_and(|total| self.units == total.div_ceil(8));
        if complete {
            self.state = State::Complete;
        }
        complete
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KEY: Key = Key {
        source: IpAddr::V4(std::net::Ipv4Addr::new(10, 0, 0, 1)),
        destination: IpAddr::V4(std::net::Ipv4Addr::new(10, 0, 0, 2)),
        link: Link { interface: 0, vlan: 0, hardware: [0; 6] },
        identification: 7,
    };

    fn pieces(datagram: &[u8]) -> Vec<Fragment<'_>> {
        let count = datagram.len().div_ceil(16);
        let piece =
            |(number, payload)| Fragment { key: KEY, offset: number * 16, more: number + 1 < count, payload };
        datagram.chunks(16).enumerate().map(piece).collect()
    }

    #[test]
    fn any_order_and_doubles_give_the_datagram_once() {
        let datagram: Vec<u8> = (0..100).collect();
        for seed in 0..50_usize {
            let mut order: Vec<usize> = (0..7).flat_map(|piece| [piece, piece]).collect();
            let length = order.len();
            for at in 0..length {
                order.swap(at, (at * 31 + seed * 17) % length);
            }
            let mut pool = Reassembly::default();
            let pieces = pieces(&datagram);
            let mut complete = 0;
            for piece in order {
                if let Added::Complete(slot) = pool.add(&pieces[piece], 5) {
                    assert_eq!(pool.datagram(slot), datagram);
                    complete += 1;
                }
            }
            pool.finish();
            assert_eq!((complete, pool.incomplete()), (1, 0), "seed {seed}");
        }
    }

    #[test]
    fn two_datagrams_with_one_identification_are_not_mixed() {
        let (first, second) = (vec![1; 50], vec![2; 50]);
        let mut pool = Reassembly::default();
        assert_eq!(pool.add(&pieces(&first)[0], 0), Added::Waiting);
        for piece in &pieces(&second)[..3] {
            assert_eq!(pool.add(piece, 1), Added::Waiting);
        }
        let Added::Complete(slot) = pool.add(&pieces(&second)[3], 1) else { panic!("not complete") };
        assert_eq!(pool.datagram(slot), second);
        pool.finish();
        assert_eq!(pool.incomplete(), 1);
    }

    #[test]
    fn old_and_too_many_are_given_up_and_counted() {
        let datagram = vec![3; 50];
        let mut pool = Reassembly::default();
        pool.add(&pieces(&datagram)[0], 0);
        pool.add(&pieces(&datagram)[1], LIFETIME_NS + 1);
        assert_eq!(pool.incomplete(), 1);
        for identification in 100..100 + SLOTS as u32 {
            let key = Key { identification, ..KEY };
            pool.add(&Fragment { key, ..pieces(&datagram).remove(0) }, LIFETIME_NS + 1);
        }
        assert_eq!((pool.slots.len(), pool.incomplete()), (SLOTS, 2));
    }

    #[test]
    fn what_no_datagram_can_hold_is_refused() {
        let mut pool = Reassembly::default();
        let refused = |offset, more, payload| Fragment { key: KEY, offset, more, payload };
        assert_eq!(pool.add(&refused(65528, false, &[0; 8]), 0), Added::Malformed);
        assert_eq!(pool.add(&refused(0, true, &[0; 9]), 0), Added::Malformed);
        assert_eq!(pool.add(&refused(0, false, &[]), 0), Added::Malformed);
    }
}
