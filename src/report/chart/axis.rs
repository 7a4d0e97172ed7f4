//! Ticks at round numbers.

/// An axis from data to pixels.
#[derive(Clone, Debug)]
pub struct Axis {
    scale: Scale,
    from_px: f64,
    to_px: f64,
}

#[derive(Clone, Copy, Debug)]
enum Scale {
    Even {
        low: f64,
        high: f64,
        step: f64,
    },
    /// Powers of ten.
    Decades {
        low: i32,
        high: i32,
    },
}

impl Axis {
    /// Spans the values (widened to round numbers) between two pixel positions with about `wanted` ticks.
    pub(crate) fn around(values: impl Iterator<Item = f64>, from_px: f64, to_px: f64, wanted: usize) -> Self {
        let (mut low, mut high) = span(values.filter(|value| value.is_finite())).unwrap_or((0.0, 1.0));
        if high - low <= f64::EPSILON * high.abs().max(1.0) {
            let pad = if low == 0.0 { 1.0 } else { 0.05 * low.abs() };
            (low, high) = (low - pad, high + pad);
        }
        let step = round_step((high - low) / wanted.max(1) as f64);
        let scale = Scale::Even { low: (low / step).floor() * step, high: (high / step).ceil() * step, step };
        Self { scale, from_px, to_px }
    }

    /// Spans the values above 0 by whole decades, evenly in their logarithm.
    pub(crate) fn decades(values: impl Iterator<Item = f64>, from_px: f64, to_px: f64) -> Self {
        let above = values.filter(|value| value.is_finite() && *value > 0.0);
        let (low, high) = span(above).unwrap_or((1.0, 10.0));
        let low = low.log10().floor() as i32;
        let high = (high.log10().ceil() as i32).max(low + 1);
        Self { scale: Scale::Decades { low, high }, from_px, to_px }
    }

    /// Pixel position of a value; over decades at the nearer end where it lies beyond.
    pub(crate) fn px(&self, value: f64) -> f64 {
        let share = match self.scale {
            Scale::Even { low, high, .. } => (value - low) / (high - low),
            Scale::Decades { .. } if value <= 0.0 => 0.0,
            Scale::Decades { low, high } => {
                ((value.log10() - f64::from(low)) / f64::from(high - low)).clamp(0.0, 1.0)
            }
        };
        self.from_px + share * (self.to_px - self.from_px)
    }

    /// Ticks: pixel position and label.
    pub(crate) fn ticks(&self) -> Vec<(f64, String)> {
        match self.scale {
            Scale::Even { low, high, step } => {
                let count = ((high - low) / step).round() as usize;
                let decimals = (-step.log10().floor()).max(0.0) as usize;
                let value = |place: usize| low + place as f64 * step;
                (0..=count)
                    .map(|place| (self.px(value(place)), super::number(value(place), decimals)))
                    .collect()
            }
            Scale::Decades { low, high } => {
                let label = |power: i32| match power {
                    -3..=0 => format!("{:.*}", power.unsigned_abs() as usize, 10f64.powi(power)),
                    1..=5 => super::number(10f64.powi(power), 0),
                    _ => format!("1e{power}"),
                };
                (low..=high).map(|power| (self.px(10f64.powi(power)), label(power))).collect()
            }
        }
    }
}

/// Min and max; none of no values.
fn span(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    values.fold(None, |span, value| match span {
        None => Some((value, value)),
        Some((low, high)) => Some((f64::min(low, value), f64::max(high, value))),
    })
}

/// The least of 1, 2, 5 times a power of ten that is not below the raw step.
pub(super) fn round_step(raw: f64) -> f64 {
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
        let ticks = axis.ticks();
        let [px, labels]: [Vec<String>; 2] = [
            ticks.iter().map(|tick| tick.0.to_string()).collect(),
            ticks.into_iter().map(|tick| tick.1).collect(),
        ];
        assert_eq!(labels, ["0", "20", "40", "60", "80", "100"]);
        assert_eq!(px, labels);
    }

    #[test]
    fn one_value_still_gives_an_axis() {
        let axis = Axis::around([5.0].into_iter(), 0.0, 100.0, 4);
        assert!((0.0..=100.0).contains(&axis.px(5.0)));
        let empty = Axis::around(std::iter::empty(), 0.0, 10.0, 4);
        assert!(empty.ticks().len() > 1);
    }

    #[test]
    fn decades_lie_evenly_and_hold_the_data() {
        let axis = Axis::decades([20.0, 3000.0].into_iter(), 0.0, 300.0);
        let ticks: Vec<(f64, String)> = axis.ticks();
        let labels: Vec<&str> = ticks.iter().map(|tick| tick.1.as_str()).collect();
        assert_eq!(labels, ["10", "100", "1,000", "10,000"]);
        assert!(ticks.iter().zip([0.0, 100.0, 200.0, 300.0]).all(|(tick, px)| (tick.0 - px).abs() < 1e-9));
        assert_eq!(axis.px(0.0), 0.0);
        assert!(Axis::decades([0.0, -1.0].into_iter(), 0.0, 10.0).ticks().len() > 1);
    }
}
