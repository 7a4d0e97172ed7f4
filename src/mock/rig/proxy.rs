//! A line that damages what it carries: seeded, in given time.

use crate::base::rng::Rng;

/// How much goes wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Damage {
    /// Share of writes that something happens to, 0..=1.
    pub share: f64,
    /// Longest delay of a delayed or split write, µs.
    pub longest_delay_us: u64,
}

/// One direction of a line.
#[derive(Clone, Debug)]
pub struct Proxy {
    damage: Damage,
    rng: Rng,
    waiting: Vec<(u64, u64, Vec<u8>)>,
    count: u64,
}

impl Proxy {
    /// A line with this much damage; what happens comes from the seed, another stream for each direction.
    pub(crate) fn new(damage: Damage, seed: u64, stream: u64) -> Self {
        Self { damage, rng: Rng::new(seed, stream), waiting: Vec::new(), count: 0 }
    }

    /// Takes one write.
    pub(crate) fn send(&mut self, now_us: u64, bytes: &[u8]) {
        if self.rng.uniform() >= self.damage.share || bytes.is_empty() {
            return self.queue(now_us, bytes.to_vec());
        }
        let later_us = now_us + self.rng.below(self.damage.longest_delay_us.max(1));
        let at = self.rng.below(bytes.len() as u64) as usize;
        let mut changed = bytes.to_vec();
        match self.rng.below(8) {
            0 => {} // lost
            1 => {
                changed.remove(at);
                self.queue(now_us, changed);
            }
            2 => {
                changed[at] ^= 1 << self.rng.below(8);
                self.queue(now_us, changed);
            }
            3 => {
                self.queue(now_us, bytes.to_vec());
                self.queue(later_us, changed);
            }
            4 => self.queue(later_us, changed), // whatever comes meanwhile overtakes it
            5 => {
                let tail = changed.split_off(at);
                self.queue(now_us, changed);
                self.queue(later_us, tail);
            }
            6 => {
                changed.insert(at, self.rng.bits() as u8);
                self.queue(now_us, changed);
            }
            _ => {
                let garbage = (0..self.rng.below(200)).map(|_| self.rng.bits() as u8).collect();
                self.queue(now_us, garbage);
                self.queue(now_us, changed);
            }
        }
    }

    fn queue(&mut self, due_us: u64, bytes: Vec<u8>) {
        self.count += 1;
        self.waiting.push((due_us, self.count, bytes));
    }

    /// What arrives by now, in the order of arrival.
    pub(crate) fn receive(&mut self, now_us: u64) -> Vec<u8> {
        let (mut arrived, waiting): (Vec<_>, _) =
            std::mem::take(&mut self.waiting).into_iter().partition(|(due_us, ..)| *due_us <= now_us);
        self.waiting = waiting;
        arrived.sort_by_key(|(due_us, count, _)| (*due_us, *count));
        arrived.into_iter().flat_map(|(.., bytes)| bytes).collect()
    }
}
