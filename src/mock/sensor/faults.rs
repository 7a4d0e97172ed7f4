//! What a network does to packets, from a seed.

use crate::base::rng::Rng;

/// Faults to inject. Probabilities are per packet.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Faults {
    /// Seed of every choice.
    pub seed: u64,
    /// Probability that a packet is never sent. The first and the last of a stream always are: no receiver could count what was
    /// dropped before or after them.
    pub drop: f64,
    /// Probability that it is sent twice.
    pub duplicate: f64,
    /// Probability that it is sent after the one that follows it.
    pub reorder: f64,
    /// Probability that one bit of it is turned over.
    pub corrupt: f64,
    /// From this time of the stream on nothing is sent, s.
    pub silent_after_s: Option<f64>,
}

/// What was done to a stream.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct FaultCounts {
    /// Never sent.
    pub dropped: u64,
    /// Sent twice.
    pub duplicated: u64,
    /// Sent after their follower.
    pub reordered: u64,
    /// Sent with one bit turned over.
    pub corrupted: u64,
    /// Not sent because the sensor was silent.
    pub silent: u64,
}

/// Applies faults to a stream of packets.
#[derive(Debug)]
pub struct FaultInjector {
    faults: Faults,
    rng: Rng,
    held: Option<Vec<u8>>,
    /// A packet was given before.
    begun: bool,
    /// The packet dropped last, when none came after it.
    dropped_last: Option<Vec<u8>>,
    counts: FaultCounts,
}

impl FaultInjector {
    /// For one stream; two streams of one seed need different numbers.
    pub fn new(faults: Faults, stream: u64) -> Self {
        Self {
            faults,
            rng: Rng::new(faults.seed, stream),
            held: None,
            begun: false,
            dropped_last: None,
            counts: FaultCounts::default(),
        }
    }

    /// Takes the packet of a time of the stream (s since its start) and hands what is to be sent, in order, to `send`.
    pub fn apply<E>(
        &mut self,
        time_s: f64,
        packet: &[u8],
        send: &mut dyn FnMut(&[u8]) -> Result<(), E>,
    ) -> Result<(), E> {
        if self.faults.silent_after_s.is_some_and(|silent_s| time_s >= silent_s) {
            self.counts.silent += 1;
            self.dropped_last = None; // not a word more
            return Ok(());
        }
        // every packet draws the same numbers, so that one fault's rate does not move where another strikes
        let [dropped, duplicated, reordered, corrupted] =
            [self.faults.drop, self.faults.duplicate, self.faults.reorder, self.faults.corrupt]
                .map(|probability| self.rng.uniform() < probability);
        let bit = self.rng.below(8 * packet.len().max(1) as u64) as usize;
        if dropped && std::mem::replace(&mut self.begun, true) {
            self.counts.dropped += 1;
            self.dropped_last = Some(packet.to_vec());
            return Ok(());
        }
        self.begun = true;
        self.dropped_last = None;
        let mut damaged = Vec::new();
        let packet = if corrupted && !packet.is_empty() {
            self.counts.corrupted += 1;
            damaged.extend_from_slice(packet);
            damaged[bit / 8] ^= 1 << (bit % 8);
            &damaged
        } else {
            packet
        };
        if reordered && self.held.is_none() {
            self.counts.reordered += 1;
            self.held = Some(packet.to_vec());
            return Ok(());
        }
        send(packet)?;
        if duplicated {
            self.counts.duplicated += 1;
            send(packet)?;
        }
        self.release(send)
    }

    /// Sends what is still held back, and says what was done.
    pub fn finish<E>(&mut self, send: &mut dyn FnMut(&[u8]) -> Result<(), E>) -> Result<FaultCounts, E> {
        self.release(send)?;
        if let Some(last) = self.dropped_last.take() {
            self.counts.dropped -= 1;
            send(&last)?;
        }
        Ok(self.counts)
    }

    fn release<E>(&mut self, send: &mut dyn FnMut(&[u8]) -> Result<(), E>) -> Result<(), E> {
        self.held.take().map_or(Ok(()), |held| send(&held))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn through(faults: Faults) -> (Vec<u8>, FaultCounts) {
        let mut injector = FaultInjector::new(faults, 1);
        let mut sent = Vec::new();
        let mut send = |packet: &[u8]| -> Result<(), ()> {
            sent.push(packet[0]);
            Ok(())
        };
        for number in 0..200u8 {
            injector.apply(f64::from(number), &[number, 0], &mut send).unwrap();
        }
        let counts = injector.finish(&mut send).unwrap();
        (sent, counts)
    }

    #[test]
    fn without_faults_everything_passes() {
        assert_eq!(through(Faults::default()).0, (0..200).collect::<Vec<u8>>());
    }

    #[test]
    fn each_packet_is_accounted_for() {
        let faults = Faults { seed: 5, drop: 0.1, duplicate: 0.1, reorder: 0.1, ..Faults::default() };
        let (sent, counts) = through(faults);
        assert!(counts.dropped > 5 && counts.duplicated > 5 && counts.reordered > 5, "{counts:?}");
        assert_eq!(sent.len() as u64, 200 - counts.dropped + counts.duplicated);
        let backward = sent.windows(2).filter(|pair| pair[1] < pair[0]).count() as u64;
        assert_eq!(backward, counts.reordered, "one held at the very end would only come last");
        assert_eq!(through(faults).0, sent, "same seed, same stream");
    }

    /// Whatever the seed, the ends are there, and what is missing between them is what was counted.
    #[test]
    fn drops_lie_between_packets_that_came() {
        for seed in 0..50 {
            let (sent, counts) = through(Faults { seed, drop: 0.7, ..Faults::default() });
            assert_eq!((sent.first(), sent.last()), (Some(&0), Some(&199)));
            assert_eq!(sent.len() as u64 + counts.dropped, 200);
        }
    }

    #[test]
    fn silence_begins_when_asked_and_damage_turns_one_bit() {
        let (sent, counts) = through(Faults { silent_after_s: Some(50.0), ..Faults::default() });
        assert_eq!((sent.len(), counts.silent), (50, 150));
        let mut injector = FaultInjector::new(Faults { corrupt: 1.0, ..Faults::default() }, 0);
        let mut different = 0;
        let mut send = |packet: &[u8]| -> Result<(), ()> {
            different = packet.iter().map(|byte| byte.count_ones()).sum();
            Ok(())
        };
        injector.apply(0.0, &[0; 100], &mut send).unwrap();
        assert_eq!(different, 1);
    }
}
