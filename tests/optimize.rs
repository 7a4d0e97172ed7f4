//! Search methods on functions with known optima, on awkward objectives, and against reference medians.

use std::convert::Infallible;
use std::f64::consts::PI;
use std::sync::atomic::{AtomicBool, Ordering};

use outrigger::optimize::{Kind, Measured, Search, SearchError, Settings, Space, StoppedBy, Variable};

use crate::support::{Case, case};

pub const CASES: &[Case] = &[
    case("every_method_finds_the_minimum_of_branin", every_method_finds_the_minimum_of_branin),
    case("same_seed_same_search_on_one_and_two_threads", same_seed_same_search_on_one_and_two_threads),
    case("a_search_resumed_from_disk_ends_as_if_it_had_not_stopped", a_search_resumed_from_disk_goes_on),
    case("a_nan_is_an_error_that_names_the_point", a_nan_is_an_error_that_names_the_point),
    case("a_constant_objective_is_no_harm", a_constant_objective_is_no_harm),
    case("infeasible_starts_find_the_feasible_corner", infeasible_starts_find_the_feasible_corner),
    case("small_budgets_are_kept_to_the_evaluation", small_budgets_are_kept_to_the_evaluation),
];

fn real(name: &str, low: f64, high: f64) -> Variable {
    Variable { name: name.into(), low, high, integer: false, active_from: None, role: 0 }
}

fn settings(seed: u64, budget: usize) -> Settings {
    Settings { seed, budget, early_stop: false }
}

fn measured(score: f64) -> Result<Measured, Infallible> {
    Ok(Measured { score, violation: 0.0, rays: 7 })
}

/// Branin (Dixon, Szego 1978): three minima of 0.397887.
fn branin(x: &[f64]) -> f64 {
    let (a, b) = (x[0], x[1]);
    let inner = b - 5.1 / (4.0 * PI * PI) * a * a + 5.0 / PI * a - 6.0;
    -(inner * inner + 10.0 * (1.0 - 1.0 / (8.0 * PI)) * a.cos() + 10.0)
}

fn branin_space() -> Space {
    Space::new(vec![real("a", -5.0, 10.0), real("b", 0.0, 15.0)]).unwrap()
}

/// Evaluations for a test in which the model of a Bayesian method would take most of the time.
fn few_if_modelled(kind: Kind, budget: usize) -> usize {
    if kind == Kind::Bayesian { budget.min(60) } else { budget }
}

fn run(space: &Space, kind: Kind, settings: Settings, f: impl Fn(&[f64]) -> f64 + Sync) -> Search {
    let mut search = Search::new(space.clone(), kind, settings);
    let stop = AtomicBool::new(false);
    search.run(settings.budget, |x| measured(f(x)), |_| (), &stop).unwrap();
    search
}

fn every_method_finds_the_minimum_of_branin() {
    for &kind in Kind::ALL {
        let (budget, close) = match kind {
            Kind::Random => (2000, 0.1),
            Kind::Bayesian => (45, 0.02),
            _ => (400, 0.01),
        };
        let search = run(&branin_space(), kind, settings(1, budget), branin);
        let best = search.best().unwrap().score;
        assert!(best <= -0.397_887 + 1e-6 && best > -0.397_887 - close, "{}: {best}", kind.name());
        assert_eq!(search.rays(), 7 * search.evaluations() as u64);
    }
}

fn same_seed_same_search_on_one_and_two_threads() {
    for &kind in Kind::ALL {
        let budget = few_if_modelled(kind, 90);
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let search = pool.install(|| run(&branin_space(), kind, settings(5, budget), branin));
            serde_json::to_string(&search).unwrap()
        };
        assert_eq!(on(1), on(2), "{}", kind.name());
        let other = run(&branin_space(), kind, settings(6, budget), branin);
        assert_ne!(on(1), serde_json::to_string(&other).unwrap(), "{}: the seed does nothing", kind.name());
    }
}

fn a_search_resumed_from_disk_goes_on() {
    for &kind in Kind::ALL {
        let budget = few_if_modelled(kind, 80);
        let whole = run(&branin_space(), kind, settings(9, budget), branin);
        let mut search = Search::new(branin_space(), kind, settings(9, budget));
        for (leg, limit) in [7, 33, 34, budget].into_iter().enumerate() {
            // an interruption in the middle of a batch, then a limit, then the rest
            let stop = AtomicBool::new(false);
            let calls = std::sync::atomic::AtomicUsize::new(0);
            let objective = |x: &[f64]| {
                if leg == 1 && calls.fetch_add(1, Ordering::Relaxed) == 3 {
                    stop.store(true, Ordering::Relaxed);
                }
                measured(branin(x))
            };
            search.run(limit, objective, |_| (), &stop).unwrap();
            let text = serde_json::to_string(&search).unwrap();
            search = serde_json::from_str(&text).unwrap();
        }
        assert_eq!(
            serde_json::to_string(&whole).unwrap(),
            serde_json::to_string(&search).unwrap(),
            "{}",
            kind.name()
        );
    }
}

fn a_nan_is_an_error_that_names_the_point() {
    for &kind in Kind::ALL {
        let mut search = Search::new(branin_space(), kind, settings(1, 50));
        let stop = AtomicBool::new(false);
        let error = search.run(50, |_| measured(f64::NAN), |_| (), &stop).unwrap_err();
        assert!(matches!(error, SearchError::NotFinite { .. }));
        let text = error.to_string();
        assert!(text.contains("NaN") && text.contains("a = ") && text.contains("b = "), "{text}");
    }
}

fn a_constant_objective_is_no_harm() {
    for &kind in Kind::ALL {
        let budget = few_if_modelled(kind, 120);
        let search = run(&branin_space(), kind, settings(2, budget), |_| 3.0);
        assert_eq!(search.best().unwrap().score, 3.0);
        assert_eq!(search.best_at(), 1, "{}: an equal is not better", kind.name());
        assert_eq!(search.evaluations(), budget, "{}", kind.name());
    }
}

/// Feasible only where a + b >= 24, of 25 at most: no initial point is.
fn infeasible_starts_find_the_feasible_corner() {
    for &kind in Kind::ALL {
        if kind == Kind::Random {
            continue;
        }
        let budget = few_if_modelled(kind, 300);
        let mut search = Search::new(branin_space(), kind, settings(4, budget));
        let objective = |x: &[f64]| -> Result<Measured, Infallible> {
            Ok(Measured { score: -x[0], violation: (24.0 - x[0] - x[1]).max(0.0), rays: 0 })
        };
        search.run(budget, objective, |_| (), &AtomicBool::new(false)).unwrap();
        let best = search.best().unwrap();
        assert_eq!(best.violation, 0.0, "{}: {best:?}", kind.name());
        assert!(best.score > -9.9, "{}: the best feasible score is -9: {best:?}", kind.name());
        let history: Vec<_> = search.history().collect();
        assert_eq!(history.len(), budget);
        assert_eq!(history[budget - 1], (budget, Some(best.score)));
    }
}

fn small_budgets_are_kept_to_the_evaluation() {
    for &kind in Kind::ALL {
        for budget in [1, 2, 3, 11] {
            let mut search = Search::new(branin_space(), kind, settings(1, budget));
            let ended = search.run(budget, |x| measured(branin(x)), |_| (), &AtomicBool::new(false)).unwrap();
            assert_eq!(ended, StoppedBy::Budget);
            assert_eq!(search.evaluations(), budget, "{}", kind.name());
        }
    }
}
