//! Motion along a straight segment with a trapezoid of speed, in integers.

/// Nanoradians per microradian: the fraction that keeps slow motion smooth.
const NANO: i64 = 1000;

/// The longest step the profile is advanced by at once, µs: a loop that lagged moves late, never far.
const LONGEST_STEP_US: u64 = 20_000;

/// Motion of all axes along one straight segment, from rest.
#[derive(Clone, Copy, Debug)]
pub struct Path<const N: usize> {
    start_urad: [i32; N],
    delta_urad: [i32; N],
    /// Length along the axis that has furthest to go, µrad.
    length_urad: i64,
    /// How far along, nrad.
    done_nrad: i64,
    /// µrad/s.
    speed: i64,
    top_speed: i64,
    acceleration: i64,
    braking: Option<i64>,
    /// Deceleration with which it stops for now.
    pausing: Option<i64>,
}

impl<const N: usize> Path<N> {
    /// A segment that keeps every axis within its own speed (µrad/s) and acceleration (µrad/s²).
    pub fn new(
        start_urad: [i32; N],
        target_urad: [i32; N],
        speeds: [i32; N],
        accelerations: [i32; N],
    ) -> Self {
        let mut delta_urad = [0; N];
        for axis in 0..N {
            delta_urad[axis] = target_urad[axis].saturating_sub(start_urad[axis]);
        }
        let length_urad = delta_urad.iter().map(|delta| i64::from(*delta).abs()).max().unwrap_or(0);
        let slowest = |rates: [i32; N]| {
            (0..N)
                .filter(|axis| delta_urad[*axis] != 0)
                .map(|axis| i64::from(rates[axis]).max(1) * length_urad / i64::from(delta_urad[axis]).abs())
                .min()
                .unwrap_or(1)
                .max(1)
        };
        Self {
            start_urad,
            delta_urad,
            length_urad,
            done_nrad: 0,
            speed: 0,
            top_speed: slowest(speeds),
            acceleration: slowest(accelerations),
            braking: None,
            pausing: None,
        }
    }

    /// Slow down and stop on the segment, µrad/s²; a stronger braking wins.
    pub fn brake(&mut self, acceleration: i32) {
        let wanted = i64::from(acceleration).max(1);
        self.braking = Some(self.braking.map_or(wanted, |before| before.max(wanted)));
    }

    /// Slow down for now, µrad/s²; `None` goes on to the end.
    pub fn pause(&mut self, acceleration: Option<i32>) {
        self.pausing = acceleration.map(|value| i64::from(value).max(1));
    }

    /// Whether the end, or the stop asked for, is reached.
    pub fn finished(&self) -> bool {
        self.done_nrad >= self.length_urad * NANO || (self.braking.is_some() && self.speed == 0)
    }

    /// Whether it was ordered to stop before its target.
    pub(crate) fn is_braking(&self) -> bool {
        self.braking.is_some()
    }

    /// Advances by a time.
    pub fn advance(&mut self, elapsed_us: u64) {
        let elapsed = elapsed_us.min(LONGEST_STEP_US) as i64;
        if self.finished() {
            self.speed = 0;
            return;
        }
        let length_nrad = self.length_urad * NANO;
        if let Some(deceleration) = self.braking.max(self.pausing) {
            self.speed = (self.speed - (deceleration * elapsed / 1_000_000).max(1)).max(0);
        } else {
            let gain = (self.acceleration * elapsed / 1_000_000).max(1);
            let left_urad = ((length_nrad - self.done_nrad) / NANO).max(0);
            // fastest speed from which the profile's acceleration still stops in what is left
            let stoppable = (2 * self.acceleration * left_urad).unsigned_abs().isqrt() as i64;
            self.speed = (self.speed + gain).min(self.top_speed).min(stoppable.max(gain));
        }
        self.done_nrad = (self.done_nrad + self.speed * elapsed / 1000).min(length_nrad);
        if self.done_nrad >= length_nrad {
            self.speed = 0;
        }
    }

    /// Setpoint of an axis now, µrad.
    pub fn position_urad(&self, axis: usize) -> i32 {
        self.start_urad[axis] + self.along(axis, self.done_nrad / NANO) as i32
    }

    /// How fast that moves, µrad/s.
    pub(crate) fn velocity_urad_s(&self, axis: usize) -> i32 {
        self.along(axis, self.speed) as i32
    }

    fn along(&self, axis: usize, value: i64) -> i64 {
        if self.length_urad == 0 { 0 } else { i64::from(self.delta_urad[axis]) * value / self.length_urad }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn takes_the_time_a_trapezoid_takes() {
        // 0.4 rad at 0.5 rad/s and 2 rad/s^2: 0.4 / 0.5 + 0.5 / 2 = 1.05 s
        let mut path = Path::new([0, 0], [400_000, -200_000], [500_000; 2], [2_000_000; 2]);
        let mut time_us = 0;
        while !path.finished() {
            path.advance(1000);
            time_us += 1000;
        }
        assert!((1_045_000..=1_060_000).contains(&time_us), "{time_us} us");
        assert_eq!([path.position_urad(0), path.position_urad(1)], [400_000, -200_000]);
    }

    #[test]
    fn brakes_only_on_command() {
        let mut path = Path::new([0], [400_000], [500_000], [2_000_000]);
        path.advance(10_000);
        assert!(!path.is_braking());
        path.brake(2_000_000);
        assert!(path.is_braking());
    }

    #[test]
    fn a_pause_ends_where_it_began_to_stand() {
        let mut path = Path::new([0], [400_000], [500_000], [2_000_000]);
        let mut run = |pause, ms: u64| {
            (0..ms).for_each(|_| {
                path.pause(pause);
                path.advance(1000);
            });
            (path.position_urad(0), path.velocity_urad_s(0), path.finished())
        };
        let (before, speed, _) = run(None, 300);
        assert_eq!(speed, 500_000);
        let (at, speed, finished) = run(Some(4_000_000), 500);
        assert!((at - before - 31_250).abs() < 600 && speed == 0 && !finished, "{before} {at} {speed}");
        assert_eq!(run(None, 2000), (400_000, 0, true));
    }

    proptest! {
        #[test]
        fn stays_on_the_segment_below_its_speeds(
            start in [-1_500_000i32..1_500_000, -1_500_000i32..1_500_000],
            target in [-1_500_000i32..1_500_000, -1_500_000i32..1_500_000],
            speeds in [1000i32..3_000_000, 1000i32..3_000_000],
            accelerations in [10_000i32..20_000_000, 10_000i32..20_000_000],
            steps in proptest::collection::vec(1u64..30_000, 1..200),
            brake_at in 0usize..250,
        ) {
            let mut path = Path::new(start, target, speeds, accelerations);
            let mut before = start;
            for (index, step) in steps.iter().enumerate() {
                if index == brake_at {
                    path.brake(2_000_000);
                }
                path.advance(*step);
                for axis in 0..2 {
                    let now = path.position_urad(axis);
                    let (low, high) = (start[axis].min(target[axis]), start[axis].max(target[axis]));
                    prop_assert!((low..=high).contains(&now));
                    let moved = i64::from(now - before[axis]).abs();
                    let elapsed = *step.min(&LONGEST_STEP_US) as i64;
                    prop_assert!(moved <= i64::from(speeds[axis]) * elapsed / 1_000_000 + 2);
                    prop_assert!((now - before[axis]) as i64 * i64::from(target[axis] - start[axis]) >= 0);
                    before[axis] = now;
                }
                // on the segment, to rounding: the cross product with its direction is small
                let (dx, dy) = (i64::from(target[0] - start[0]), i64::from(target[1] - start[1]));
                let (px, py) = (i64::from(before[0] - start[0]), i64::from(before[1] - start[1]));
                prop_assert!((dx * py - dy * px).abs() <= 2 * dx.abs().max(dy.abs()).max(1));
            }
        }
    }
}
