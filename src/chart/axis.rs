//! Ticks at round numbers.

/// An axis from data to pixels.
#[derive(Clone, Debug)]
pub struct Axis {
    low: f64,
    high: f64,
    from_px: f64,
    to_px: f64,
    step: f64,
}

impl Axis {
    /// Spans the values (widened to round numbers) between two pixel positions with about `wanted` ticks.
    pub fn around(values: impl Iterator<Item = f64>, from_px: f64, to_px: f64, wanted: usize) -> Self {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for value in values.filter(|value| value.is_finite()) {
            low = low.min(value);
            high = high.max(value);
        }
        if low > high {
            (low, high) = (0.0, 1.0);
        }
        if high - low <= f64::EPSILON * high.abs().max(1.0) {
            let pad = if low == 0.0 { 1.0 } else { 0.05 * low.abs() };
            (low, high) = (low - pad, high + pad);
        }
        let step = round_step((high - low) / wanted.max(1) as f64);
        Self { low: (low / step).floor() * step, high: (high / step).ceil() * step, from_px, to_px, step }
    }

    /// Pixel position of a value.
    pub fn px(&self, value: f64) -> f64 {
        self.from_px + (value - self.low) / (self.high - self.low) * (self.to_px - self.from_px)
    }

    /// Ticks: value and label.
    pub fn ticks(&self) -> Vec<(f64, String)> {
        let count = ((self.high - self.low) / self.step).round() as usize;
        let decimals = (-self.step.log10().floor()).max(0.0) as usize;
        (0..=count)
            .map(|place| {
                let value = self.low + place as f64 * self.step;
                (value, super::number(value, decimals))
            })
            .collect()
    }
}

/// The least of 1, 2, 5 times a power of ten that is not below the raw step.
fn round_step(raw: f64) -> f64 {
    let power = 10f64.powf(raw.log10().floor());
    [1.0, 2.0, 5.0, 10.0]
        .into_iter()
        .map(|m| m * power)
        .find(|step| *step >= raw * (1.0 - 1e-12))
        .unwrap_or(raw)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_hold_the_data() {
        let axis = Axis::around([3.0, 97.0].into_iter(), 0.0, 100.0, 5);
        let values: Vec<f64> = axis.ticks().iter().map(|tick| tick.0).collect();
        assert_eq!(values, [0.0, 20.0, 40.0, 60.0, 80.0, 100.0]);
    }

    #[test]
    fn one_value_still_gives_an_axis() {
        let axis = Axis::around([5.0].into_iter(), 0.0, 100.0, 4);
        assert!((0.0..=100.0).contains(&axis.px(5.0)));
        let empty = Axis::around(std::iter::empty(), 0.0, 10.0, 4);
        assert!(empty.ticks().len() > 1);
    }
}
