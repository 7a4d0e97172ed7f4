//! Minimum of a smooth function of a few variables within bounds: BFGS with projected steps
//! (Nocedal, Wright 2006, doi:10.1007/978-0-387-40065-5, algorithm 6.1).

use nalgebra::{DMatrix, DVector};

const ARMIJO: f64 = 1e-4;
const HALVINGS: usize = 20;
const GRADIENT_TOLERANCE: f64 = 1e-4;

/// Least value found from `start`, and where. `function` returns value and gradient, or `None` where it is undefined.
pub(crate) fn minimise(
    function: impl Fn(&[f64]) -> Option<(f64, Vec<f64>)>,
    start: &[f64],
    bounds: &[(f64, f64)],
    iterations: usize,
) -> Option<(f64, Vec<f64>)> {
    let n = start.len();
    let project = |x: &mut [f64]| {
        for (value, (low, high)) in x.iter_mut().zip(bounds) {
            *value = value.clamp(*low, *high);
        }
    };
    let mut x = start.to_vec();
    project(&mut x);
    let (mut value, mut gradient) = function(&x)?;
    let mut inverse = DMatrix::<f64>::identity(n, n);
    let mut is_fresh = true;
    for _ in 0..iterations {
        // a variable that presses against its bound stays there
        let pressed: Vec<bool> = (0..n)
            .map(|i| (x[i] <= bounds[i].0 && gradient[i] > 0.0) || (x[i] >= bounds[i].1 && gradient[i] < 0.0))
            .collect();
        let free = DVector::from_fn(n, |i, _| if pressed[i] { 0.0 } else { gradient[i] });
        if free.amax() < GRADIENT_TOLERANCE {
            break;
        }
        let mut direction = -(&inverse * &free);
        for i in 0..n {
            if pressed[i] {
                direction[i] = 0.0;
            }
        }
        let mut slope = direction.dot(&free);
        if slope >= 0.0 {
            inverse = DMatrix::identity(n, n);
            is_fresh = true;
            direction = -free.clone();
            slope = direction.dot(&free);
        }
        // the first step of a fresh matrix has no scale: at most one unit
        let mut length = if is_fresh { 1.0 / direction.amax().max(1.0) } else { 1.0 };
        let mut accepted = None;
        for _ in 0..HALVINGS {
            let mut there: Vec<f64> = (0..n).map(|i| x[i] + length * direction[i]).collect();
            project(&mut there);
            if let Some((new_value, new_gradient)) = function(&there)
                && new_value <= value + ARMIJO * length * slope
            {
                accepted = Some((there, new_value, new_gradient));
                break;
            }
            length *= 0.5;
        }
        let Some((there, new_value, new_gradient)) = accepted else {
            if is_fresh {
                break;
            }
            inverse = DMatrix::identity(n, n);
            is_fresh = true;
            continue;
        };
        let s = DVector::from_fn(n, |i, _| there[i] - x[i]);
        let y = DVector::from_fn(n, |i, _| new_gradient[i] - gradient[i]);
        let curvature = s.dot(&y);
        if curvature > 1e-12 {
            let rho = 1.0 / curvature;
            let left = DMatrix::identity(n, n) - rho * &s * y.transpose();
            inverse = &left * &inverse * left.transpose() + rho * &s * s.transpose();
            is_fresh = false;
        }
        let gained = value - new_value;
        (x, value, gradient) = (there, new_value, new_gradient);
        if gained < 1e-9 * value.abs().max(1.0) {
            break;
        }
    }
    Some((value, x))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rosenbrock_and_a_minimum_on_the_border() {
        let rosenbrock = |x: &[f64]| {
            let (a, b) = (1.0 - x[0], x[1] - x[0] * x[0]);
            Some((a * a + 100.0 * b * b, vec![-2.0 * a - 400.0 * x[0] * b, 200.0 * b]))
        };
        let wide = [(-5.0, 5.0), (-5.0, 5.0)];
        let (value, x) = minimise(rosenbrock, &[-1.2, 1.0], &wide, 200).unwrap();
        assert!(value < 1e-5 && (x[0] - 1.0).abs() < 1e-2, "{value} {x:?}");
        let (value, x) = minimise(rosenbrock, &[-1.2, 1.0], &[(-5.0, 0.5), (-5.0, 5.0)], 200).unwrap();
        assert!((value - 0.25).abs() < 1e-4 && x[0] == 0.5, "{value} {x:?}");
    }
}
