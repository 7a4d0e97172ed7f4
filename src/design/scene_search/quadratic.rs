//! A quadratic through evaluated points and where it is highest: what single points scatter, it averages (Box, Wilson 1951,
//! doi:10.1111/j.2517-6161.1951.tb00067.x).

use super::ridge::RidgeFit;

/// Points for each coefficient: the best of them, if there are so many, and never fewer than the second.
const POINTS: [f64; 2] = [4.0, 1.33];
/// Weight of a coefficient of size one against the data, in points.
const RIDGE: f64 = 1e-5;
/// Rounds of coordinates when its highest point is looked for.
const ROUNDS: usize = 12;

/// A value and how it goes from a middle.
pub(super) struct Quadratic {
    middle: Vec<f64>,
    reach: f64,
    fit: RidgeFit,
}

impl Quadratic {
    /// Fits to points of the unit cube with their values, best first, that lie within `reach` of the first one in every
    /// coordinate; none where these are too few.
    pub(super) fn fit(scored: &[(Vec<f64>, f64)], reach: f64) -> Option<Self> {
        let (middle, top) = scored.first()?;
        let n = middle.len();
        let columns = 1 + n + n * (n + 1) / 2;
        let is_near = |point: &[f64]| point.iter().zip(middle).all(|(a, b)| (a - b).abs() <= reach);
        let [most, least] = POINTS.map(|share| (share * columns as f64) as usize);
        let near: Vec<&(Vec<f64>, f64)> =
            scored.iter().filter(|(point, _)| is_near(point)).take(most).collect();
        if near.len() < least {
            return None;
        }
        let rows: Vec<Vec<f64>> = near.iter().map(|(point, _)| terms(point, middle, reach)).collect();
        let targets: Vec<f64> = near.iter().map(|(_, value)| value - top).collect();
        let weight = RIDGE * rows.len() as f64;
        let fit = RidgeFit::new(&rows, &targets, |column| if column == 0 { 0.0 } else { weight })?;
        Some(Self { middle: middle.clone(), reach, fit })
    }

    fn value(&self, point: &[f64]) -> f64 {
        self.fit.value(&terms(point, &self.middle, self.reach))
    }

    /// The highest point of the unit cube within `near` of the middle in every coordinate, one coordinate after the other.
    pub(super) fn highest(&self, near: f64) -> Vec<f64> {
        let mut point = self.middle.clone();
        for _ in 0..ROUNDS {
            for axis in 0..point.len() {
                let (low, high) = ((self.middle[axis] - near).max(0.0), (self.middle[axis] + near).min(1.0));
                let (centre, half) = (0.5 * (low + high), 0.5 * (high - low));
                let [at_low, at_centre, at_high] = [low, centre, high].map(|value| {
                    point[axis] = value;
                    self.value(&point)
                });
                let (slope, bend) = (0.5 * (at_high - at_low), 0.5 * (at_low + at_high) - at_centre);
                point[axis] = match bend < 0.0 {
                    true => (centre - half * slope / (2.0 * bend)).clamp(low, high),
                    false if at_high > at_low => high,
                    false => low,
                };
            }
        }
        point
    }
}

/// One, the distances from the middle, and their products.
fn terms(point: &[f64], middle: &[f64], reach: f64) -> Vec<f64> {
    let off: Vec<f64> = point.iter().zip(middle).map(|(a, b)| (a - b) / reach).collect();
    let mut terms = vec![1.0];
    terms.extend(&off);
    for (at, one) in off.iter().enumerate() {
        terms.extend(off[at..].iter().map(|other| one * other));
    }
    terms
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::Rng;

    /// Scattered values around a hill at `top`, best first.
    fn hill(top: [f64; 3], count: usize) -> Vec<(Vec<f64>, f64)> {
        let mut rng = Rng::new(9, 0);
        let mut point = || {
            let point: Vec<f64> = (0..3).map(|_| rng.between(0.2, 1.0)).collect();
            let [x, y, z] = [0, 1, 2].map(|axis| point[axis] - top[axis]);
            let value = 500.0 - 300.0 * (x * x + y * y + 2.0 * z * z + x * y) + 10.0 * rng.normal();
            (point, value)
        };
        let mut scored: Vec<_> = (0..count).map(|_| point()).collect();
        scored.sort_by(|a, b| b.1.total_cmp(&a.1));
        scored
    }

    #[test]
    fn a_scattered_hill_has_its_top_where_it_is() {
        let scored = hill([0.6, 0.5, 0.7], 60);
        let top = Quadratic::fit(&scored, 1.0).unwrap().highest(0.5);
        for (found, expected) in top.iter().zip([0.6, 0.5, 0.7]) {
            assert!((found - expected).abs() < 0.06, "{top:?}");
        }
    }

    #[test]
    fn a_top_outside_is_looked_for_at_the_border() {
        let top = Quadratic::fit(&hill([1.3, 0.5, 0.7], 60), 1.0).unwrap().highest(0.9);
        assert!(top[0] == 1.0 && top.iter().all(|value| (0.0..=1.0).contains(value)), "{top:?}");
    }

    #[test]
    fn too_few_points_make_none() {
        assert!(Quadratic::fit(&[], 1.0).is_none());
        assert!(Quadratic::fit(&hill([0.5; 3], 12), 1.0).is_none());
        assert!(Quadratic::fit(&hill([0.5; 3], 60), 1e-3).is_none());
    }
}
