//! When a spinning sensor fires and where it looks then.

use std::f64::consts::TAU;

use super::Column;

/// How firings follow each other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Spin {
    /// Fired at fixed encoder angles, so many to a revolution (Ouster).
    Angles {
        /// Columns of a revolution.
        columns: usize,
        /// Revolutions per second.
        rate_hz: f64,
    },
    /// Fired by the clock, wherever the encoder is (Velodyne).
    Clock {
        /// From one firing to the next, ns.
        cycle_ns: f64,
        /// Revolutions per second.
        rate_hz: f64,
    },
}

impl Spin {
    /// Revolutions per second.
    pub fn rate_hz(&self) -> f64 {
        match *self {
            Spin::Angles { rate_hz, .. } | Spin::Clock { rate_hz, .. } => rate_hz,
        }
    }

    /// Turn of the encoder, rad/ns.
    pub fn azimuth_rate_rad_per_ns(&self) -> f64 {
        TAU * self.rate_hz() * 1e-9
    }

    /// Firings of a revolution, counted from 0; the first begins at `start_ns` and azimuth 0.
    pub fn columns(&self, start_ns: u64, revolution: u32) -> Vec<Column> {
        let turn_ns = 1e9 / self.rate_hz();
        let begin_ns = f64::from(revolution) * turn_ns;
        match *self {
            Spin::Angles { columns, .. } => (0..columns)
                .map(|column| {
                    let share = column as f64 / columns as f64;
                    Column {
                        time_ns: start_ns + (begin_ns + share * turn_ns).round() as u64,
                        azimuth_rad: share * TAU,
                    }
                })
                .collect(),
            Spin::Clock { cycle_ns, .. } => {
                let first = (begin_ns / cycle_ns).ceil() as u64;
                let end = ((begin_ns + turn_ns) / cycle_ns).ceil() as u64;
                (first..end)
                    .map(|firing| {
                        let at_ns = firing as f64 * cycle_ns;
                        let share = (at_ns - begin_ns) / turn_ns;
                        Column { time_ns: start_ns + at_ns.round() as u64, azimuth_rad: share * TAU }
                    })
                    .collect()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clocked_firings_go_on_across_revolutions() {
        let spin = Spin::Clock { cycle_ns: 55_296.0, rate_hz: 10.0 };
        let all: Vec<Column> = (0..20).flat_map(|revolution| spin.columns(1000, revolution)).collect();
        assert_eq!(all[0], Column { time_ns: 1000, azimuth_rad: 0.0 });
        for pair in all.windows(2) {
            let step_ns = pair[1].time_ns - pair[0].time_ns;
            assert!((55_295..=55_297).contains(&step_ns), "{step_ns}");
            let turned = (pair[1].azimuth_rad - pair[0].azimuth_rad).rem_euclid(TAU);
            assert!((turned - spin.azimuth_rate_rad_per_ns() * 55_296.0).abs() < 1e-9);
            assert!(pair[1].azimuth_rad < TAU);
        }
    }

    #[test]
    fn angles_repeat_each_revolution() {
        let spin = Spin::Angles { columns: 1024, rate_hz: 20.0 };
        let (first, third) = (spin.columns(0, 0), spin.columns(0, 2));
        assert_eq!(first.len(), 1024);
        assert_eq!(third[512].time_ns, 125_000_000);
        assert!(first.iter().zip(&third).all(|(a, b)| a.azimuth_rad == b.azimuth_rad));
    }
}
