//! The order of a path's scans where the order is free: spread over the whole path, so that most of what there is
//! to find is found early.

const ROUNDS: u64 = 16;

/// The numbers below `count` in rounds: each round lies in the largest gaps of those before it.
pub(crate) fn rounds(count: u64) -> Vec<Vec<u64>> {
    let mut rounds = vec![Vec::new(); ROUNDS as usize];
    for number in 0..count {
        // the bits of the number backwards
        let round = (number % ROUNDS).reverse_bits() >> (64 - ROUNDS.trailing_zeros());
        rounds[round as usize].push(number);
    }
    rounds
}

/// Whether it pays to drop what was found from a search after this round: later ones find little.
pub(crate) fn is_worth_settling(round: usize) -> bool {
    (round + 1).is_power_of_two()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_number_comes_once_and_the_first_rounds_are_spread() {
        for count in [0, 1, 15, 16, 100] {
            let mut all: Vec<u64> = rounds(count).concat();
            all.sort_unstable();
            assert_eq!(all, (0..count).collect::<Vec<_>>());
        }
        assert_eq!(rounds(64)[0], [0, 16, 32, 48]);
        assert_eq!(rounds(64)[1], [8, 24, 40, 56]);
        assert!([0, 1, 3, 7, 15].into_iter().all(is_worth_settling) && !is_worth_settling(2));
    }
}
