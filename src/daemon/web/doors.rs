//! Which connections and requests are let in. Rules of addresses alone, so that they can be tested without a network:
//!
//! - A connection that has not brought a whole request yet costs little. There is room for so many of one address and so
//!   many of all other machines, and where there is none, the oldest one of whoever has the most is closed for the new
//!   one: who asks at once is served, however many others wait.
//! - A request in progress needs a slot. Those of other machines without the token get a part of the slots, and each address
//!   a part of that; no address, known or not, gets all of them. Stops need no slot.

use std::collections::HashMap;
use std::net::{IpAddr, Ipv4Addr};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::Notify;

/// Connections of one address that have not brought a whole request yet.
const WAITING_OF_ONE: usize = 64;
/// The same of all addresses but those of this machine, which so has a room of its own.
const WAITING_OF_OTHERS: usize = 192;

/// Where a connection comes from, as far as limits go.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Origin {
    /// This machine, by any of its loopback addresses.
    Here,
    V4(Ipv4Addr),
    /// The first 64 bits: who has a network of IPv6 has all of its addresses (RFC 4291, 2.5.4).
    V6(u64),
}

impl Origin {
    pub(crate) fn of(address: IpAddr) -> Self {
        match address.to_canonical() {
            address if address.is_loopback() => Self::Here,
            IpAddr::V4(address) => Self::V4(address),
            IpAddr::V6(address) => Self::V6((address.to_bits() >> 64) as u64),
        }
    }
}

/// Connections that have not brought a whole request yet.
#[derive(Debug, Default)]
pub(super) struct Doors {
    waiting: Mutex<Waiting>,
}

/// Oldest first.
#[derive(Debug, Default)]
struct Waiting {
    entries: Vec<Entry>,
    made: u64,
}

#[derive(Debug)]
struct Entry {
    id: u64,
    origin: Origin,
    close: Arc<Notify>,
}

impl Waiting {
    /// Which one is to go when one more of this origin comes, by place.
    fn victim(&self, origin: Origin) -> Option<usize> {
        let mut counts: HashMap<Origin, usize> = HashMap::new();
        self.entries.iter().for_each(|entry| *counts.entry(entry.origin).or_default() += 1);
        let oldest_of = |wanted: Origin| self.entries.iter().position(|entry| entry.origin == wanted);
        if counts.get(&origin).is_some_and(|count| *count >= WAITING_OF_ONE) {
            return oldest_of(origin);
        }
        let here = counts.remove(&Origin::Here).unwrap_or(0);
        if origin == Origin::Here || self.entries.len() - here < WAITING_OF_OTHERS {
            return None;
        }
        let most = counts.values().max().copied()?;
        self.entries.iter().position(|entry| counts.get(&entry.origin) == Some(&most))
    }
}

impl Doors {
    /// One more waits; another may have to go for it.
    pub(crate) fn wait(self: &Arc<Self>, origin: Origin, close: &Arc<Notify>) -> Wait {
        let mut waiting = self.lock();
        if let Some(place) = waiting.victim(origin) {
            waiting.entries.remove(place).close.notify_one();
        }
        waiting.made += 1;
        let id = waiting.made;
        waiting.entries.push(Entry { id, origin, close: Arc::clone(close) });
        Wait { doors: Arc::clone(self), id }
    }

    /// Closes the one that has waited longest; there are no file descriptors left.
    pub(crate) fn close_oldest(&self) {
        let mut waiting = self.lock();
        if !waiting.entries.is_empty() {
            waiting.entries.remove(0).close.notify_one();
        }
    }

    fn lock(&self) -> MutexGuard<'_, Waiting> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A connection that waits, until this is dropped.
#[derive(Debug)]
pub(super) struct Wait {
    doors: Arc<Doors>,
    id: u64,
}

impl Drop for Wait {
    fn drop(&mut self) {
        self.doors.lock().entries.retain(|entry| entry.id != self.id);
    }
}

/// How many may be in progress at once.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    pub all: usize,
    /// Of one address that is known: this machine, or one that showed the token.
    pub of_one: usize,
    /// Of all unknown addresses together, and of one of them.
    pub of_unknown: usize,
    pub of_one_unknown: usize,
}

/// Requests that are carried out.
pub(super) const REQUESTS: Limits = Limits { all: 96, of_one: 64, of_unknown: 24, of_one_unknown: 8 };
/// Streams; an unknown address gets none.
pub(super) const STREAMS: Limits = Limits { all: 80, of_one: 64, of_unknown: 0, of_one_unknown: 0 };

/// Slots for requests or streams, and who has them.
#[derive(Debug)]
pub(super) struct Slots {
    limits: Limits,
    /// By origin and whether it is known.
    used: Mutex<HashMap<(Origin, bool), usize>>,
}

impl Slots {
    pub(crate) fn new(limits: Limits) -> Self {
        Self { limits, used: Mutex::default() }
    }

    /// A slot, if there is one for this origin.
    pub(crate) fn take(self: &Arc<Self>, origin: Origin, is_known: bool) -> Option<Slot> {
        let mut used = self.used.lock().unwrap_or_else(PoisonError::into_inner);
        let all: usize = used.values().sum();
        let unknown: usize = used.iter().filter(|((_, known), _)| !known).map(|(_, count)| count).sum();
        let Limits { all: most, of_one, of_unknown, of_one_unknown } = self.limits;
        let mine = used.get(&(origin, is_known)).copied().unwrap_or(0);
        let has_room = if is_known { mine < of_one } else { unknown < of_unknown && mine < of_one_unknown };
        if all >= most || !has_room {
            return None;
        }
        *used.entry((origin, is_known)).or_default() += 1;
        Some(Slot { slots: Arc::clone(self), owner: (origin, is_known) })
    }
}

/// A slot, until this is dropped.
#[derive(Debug)]
pub(super) struct Slot {
    slots: Arc<Slots>,
    owner: (Origin, bool),
}

impl Drop for Slot {
    fn drop(&mut self) {
        let mut used = self.slots.used.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(count) = used.get_mut(&self.owner) {
            *count -= 1;
            if *count == 0 {
                used.remove(&self.owner);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn origin(address: &str) -> Origin {
        Origin::of(address.parse().unwrap())
    }

    #[test]
    fn addresses_of_one_owner_count_together() {
        assert_eq!(origin("127.0.0.1"), origin("127.0.0.4"));
        assert_eq!(origin("::1"), Origin::Here);
        assert_eq!(origin("::ffff:127.0.0.1"), Origin::Here);
        assert_eq!(origin("::ffff:10.0.0.9"), origin("10.0.0.9"));
        assert_ne!(origin("10.0.0.8"), origin("10.0.0.9"));
        assert_eq!(origin("2001:db8:1:2::5"), origin("2001:db8:1:2:ffff::1"));
        assert_ne!(origin("2001:db8:1:2::5"), origin("2001:db8:1:3::5"));
        assert_ne!(origin("fe80::1"), Origin::Here);
    }

    /// Connections that stay when these come one after the other, by address.
    fn staying(doors: &Arc<Doors>, waits: &[(&str, Wait)]) -> HashMap<String, usize> {
        let waiting = doors.lock();
        let mut counts = HashMap::new();
        for (address, wait) in waits {
            let stays = waiting.entries.iter().any(|entry| entry.id == wait.id);
            *counts.entry((*address).to_owned()).or_default() += usize::from(stays);
        }
        counts
    }

    fn come<'a>(doors: &Arc<Doors>, addresses: impl Iterator<Item = &'a str>) -> Vec<(&'a str, Wait)> {
        addresses.map(|address| (address, doors.wait(origin(address), &Arc::default()))).collect()
    }

    #[test]
    fn who_waits_in_crowds_loses_the_oldest_and_a_newcomer_always_stays() {
        let doors = Arc::new(Doors::default());
        let friend = come(&doors, std::iter::once("10.0.0.7"));
        let crowd = come(&doors, std::iter::repeat_n("10.0.0.9", 200));
        assert_eq!(staying(&doors, &crowd)["10.0.0.9"], WAITING_OF_ONE);
        let same = come(&doors, std::iter::once("10.0.0.9"));
        let stays = |waits| staying(&doors, waits).values().sum::<usize>();
        assert_eq!((stays(&friend), stays(&same)), (1, 1), "neither is lost for the crowd");
        let newest = crowd.last().unwrap().1.id;
        assert!(doors.lock().entries.iter().any(|entry| entry.id == newest), "the oldest went");
    }

    #[test]
    fn four_crowds_leave_room_for_others_and_this_machine_has_its_own() {
        let doors = Arc::new(Doors::default());
        let four = ["10.0.0.1", "10.0.0.2", "10.0.0.3", "10.0.0.4"];
        let crowds = come(&doors, (0..200).map(|at| four[at % 4]));
        let fifth = come(&doors, ["10.0.0.5", "10.0.0.6"].into_iter());
        let here = come(&doors, std::iter::repeat_n("127.0.0.1", 60));
        let counts = staying(&doors, &crowds);
        let stay: usize = counts.values().sum();
        assert_eq!(stay, WAITING_OF_OTHERS - 2);
        assert!(four.iter().all(|address| (47..=48).contains(&counts[*address])), "{counts:?}");
        assert_eq!(staying(&doors, &fifth).values().sum::<usize>(), 2);
        assert_eq!(staying(&doors, &here)["127.0.0.1"], 60);
        drop((crowds, fifth, here));
        assert!(doors.lock().entries.is_empty());
    }

    #[test]
    fn the_one_that_has_to_go_gets_an_answer() {
        let doors = Arc::new(Doors::default());
        let close = Arc::new(Notify::new());
        let first = doors.wait(origin("10.0.0.9"), &close);
        let rest = come(&doors, std::iter::repeat_n("10.0.0.9", WAITING_OF_ONE));
        let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
        runtime.block_on(close.notified());
        drop((first, rest));
    }

    #[test]
    fn unknown_addresses_get_a_part_of_the_slots_and_none_gets_all() {
        let slots = Arc::new(Slots::new(REQUESTS));
        let take = |address: &str, is_known| slots.take(origin(address), is_known);
        let mut held = Vec::new();
        for address in ["10.0.0.1", "10.0.0.2", "10.0.0.3", "10.0.0.4"] {
            held.extend((0..50).map_while(|_| take(address, false)));
        }
        assert_eq!(held.len(), REQUESTS.of_unknown);
        assert!(take("10.0.0.5", false).is_none(), "other machines have had theirs");
        held.extend((0..200).map_while(|_| take("10.0.0.1", true)));
        assert_eq!(held.len(), REQUESTS.of_unknown + REQUESTS.of_one, "of one who knows the token");
        assert!(take("127.0.0.1", true).is_some(), "this machine is not shut out");
        drop(held);
        assert!(slots.used.lock().unwrap().is_empty());
        let streams = Arc::new(Slots::new(STREAMS));
        assert!(streams.take(origin("10.0.0.1"), false).is_none());
    }
}
