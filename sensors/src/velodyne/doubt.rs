//! Packets with a time stamp that contradicts those before it: one odd stamp moves nothing, several that agree do.

use crate::decoder::Rejected;

use super::blocks::BadBlocks;
use super::checks::foreign;
use super::clock::{Follows, HourClock, Stamp};
use super::decoder::VelodyneDecoder;
use super::odd_stamps::Doubted;
use super::wire::DATA_PACKET_BYTES;

/// So many stamps in a row that agree with each other are believed against all before them.
const AGREEING: usize = 4;
/// A stamp alone at the end of the packets is believed up to here: packets were lost before it.
const LAST_AHEAD_US: i64 = 1_000_000;

impl VelodyneDecoder {
    /// Holds back a packet with an odd stamp until those after it decide.
    pub(super) fn doubt(
        &mut self,
        stamp: Stamp,
        payload: &[u8; DATA_PACKET_BYTES],
        bad: BadBlocks,
    ) -> Result<(), Rejected> {
        if self.doubted.last().is_some_and(|last| !HourClock::goes_on(last.stamp, stamp)) {
            self.settle_doubted(None);
        }
        if self.doubted.is_empty() && self.second_clock.take(stamp) {
            return Err(foreign(
                "its clock is another one than that of the packets between which it comes: two sensors send as one".into(),
            ));
        }
        self.doubted.push(Doubted { stamp, bad, payload: Box::new(*payload) });
        if self.doubted.len() >= AGREEING {
            self.believe_doubted();
        }
        Ok(())
    }

    /// The packets that were held back are dated by their neighbours: the newest before them and the next, where it has come.
    pub(super) fn settle_doubted(&mut self, next_ns: Option<u64>) {
        if self.doubted.is_empty() {
            return;
        }
        let doubted = std::mem::take(&mut self.doubted);
        let before_ns = self.newest_placed_ns().or(self.clock.newest_ns()).unwrap_or(0);
        let count = doubted.len() as u64 + 1;
        for (place, doubted) in (1..).zip(doubted) {
            let period_ns = doubted.stamp.period_ns.max(1) as u64;
            let time_ns = match next_ns.and_then(|next_ns| next_ns.checked_sub(before_ns)) {
                Some(span_ns) if span_ns >= count => before_ns + span_ns / count * place,
                _ => before_ns + period_ns * place,
            };
            let Doubted { stamp, bad, payload } = doubted;
            self.stats.odd_stamps += 1;
            self.clock.pass(time_ns, stamp.host_ns);
            self.place(time_ns, Follows::On, stamp.host_ns, &payload, bad);
        }
    }

    /// They agree with each other: the clock was set, or packets were lost before them.
    fn believe_doubted(&mut self) {
        for doubted in std::mem::take(&mut self.doubted) {
            let resolved =
                self.clock.resolve(doubted.stamp).unwrap_or_else(|| self.clock.believe(doubted.stamp));
            let Doubted { stamp, bad, payload } = doubted;
            self.place(resolved.time_ns, resolved.follows, stamp.host_ns, &payload, bad);
        }
    }

    /// Nothing more comes.
    pub(super) fn end_doubt(&mut self) {
        let newest_ns = self.clock.newest_ns();
        let is_near = |stamp: Stamp| {
            let ahead_us = newest_ns.map(|newest_ns| HourClock::us_ahead(newest_ns, stamp));
            !stamp.is_next && ahead_us.is_some_and(|ahead_us| (0..=LAST_AHEAD_US).contains(&ahead_us))
        };
        match self.doubted[..] {
            [] => {}
            [Doubted { stamp, .. }] if !is_near(stamp) => self.settle_doubted(None),
            _ => self.believe_doubted(),
        }
    }
}
