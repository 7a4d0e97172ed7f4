//! How well an angle is known: what the encoder resolves, how much its readings scatter while the axis holds, what its own
//! scale errs, and the play between it and the load.

/// Readings of a hold.
const MAX_READINGS: usize = 64;

/// Parts of the error of an angle that the rig tells of itself, µrad.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Encoder {
    /// Largest error of its own scale.
    pub accuracy_urad: i32,
    /// One count.
    pub resolution_urad: i32,
    /// Play between encoder and load.
    pub lost_motion_urad: i32,
}

/// Readings of an axis since it holds.
#[derive(Clone, Debug, Default)]
pub(super) struct Held {
    target_urad: i32,
    readings: std::collections::VecDeque<i32>,
}

impl Held {
    /// Takes a reading; an axis that moves, or has another target, starts again.
    pub(crate) fn hear(&mut self, holds: bool, target_urad: i32, position_urad: i32) {
        if !holds || target_urad != self.target_urad {
            self.readings.clear();
        }
        self.target_urad = target_urad;
        if holds {
            if self.readings.len() == MAX_READINGS {
                self.readings.pop_front();
            }
            self.readings.push_back(position_urad);
        }
    }

    /// Forgets what was read before now.
    pub(crate) fn forget(&mut self) {
        self.readings.clear();
    }

    /// How many readings there are.
    pub(crate) fn count(&self) -> usize {
        self.readings.len()
    }

    /// Their mean, µrad.
    pub(crate) fn mean_urad(&self) -> Option<f64> {
        let sum: i64 = self.readings.iter().map(|reading| i64::from(*reading)).sum();
        (!self.readings.is_empty()).then(|| sum as f64 / self.readings.len() as f64)
    }

    /// Half the distance between the lowest and the highest, µrad, rounded up.
    pub(crate) fn scatter_urad(&self) -> i32 {
        match (self.readings.iter().min(), self.readings.iter().max()) {
            (Some(low), Some(high)) => (high - low + 1) / 2,
            _ => 0,
        }
    }

    /// Half the width in which the true angle lies around the mean (around a single reading while it moves), µrad. Angles
    /// are those of an axis that came from below; one that may have come from above may stand off by the whole play.
    pub(crate) fn uncertainty_urad(&self, encoder: Encoder, from_below: bool) -> i32 {
        let play_urad = if from_below { 0 } else { encoder.lost_motion_urad };
        [(encoder.resolution_urad + 1) / 2, self.scatter_urad(), play_urad]
            .into_iter()
            .fold(encoder.accuracy_urad, i32::saturating_add)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_add_up_and_motion_starts_again() {
        let encoder = Encoder { accuracy_urad: 100, resolution_urad: 383, lost_motion_urad: 2000 };
        let mut held = Held::default();
        assert_eq!((held.mean_urad(), held.uncertainty_urad(encoder, true)), (None, 292));
        for reading in [1000, 1400, 1100] {
            held.hear(true, 1200, reading);
        }
        assert_eq!((held.count(), held.scatter_urad()), (3, 200));
        assert!((held.mean_urad().unwrap() - 1166.67).abs() < 0.01);
        assert_eq!(held.uncertainty_urad(encoder, true), 100 + 192 + 200);
        assert_eq!(held.uncertainty_urad(encoder, false), 100 + 192 + 200 + 2000);
        held.hear(true, 1300, 1000);
        assert_eq!(held.count(), 1, "another target");
        held.hear(false, 1300, 1000);
        assert_eq!(held.count(), 0, "it moves");
        (0..100).for_each(|reading| held.hear(true, 1300, reading));
        assert_eq!((held.count(), held.scatter_urad()), (64, 32));
    }
}
