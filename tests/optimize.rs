//! Search methods on functions with known optima, on awkward objectives, and against reference medians.

pub mod command;
mod mixed;

use std::convert::Infallible;
use std::f64::consts::PI;
use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::ValueEnum as _;
use outrigger::design::objective::{Objective, Weights};
use outrigger::design::optimize::{
    Acquisition, Bayesian, Candidate, KeepApart, Kind, Measured, MountProblem, Optimizer as _, Search,
    SearchError, Settings, Space, StoppedBy, Trial, Variable,
};
use outrigger::rig::Path;
use outrigger::simulate::published::{Experiment, Preset, PublishedBox};

use crate::support::{Case, case, shared, with_shared};

pub const CASES: &[Case] = &[
    case("every_method_finds_the_minimum_of_branin", every_method_finds_the_minimum_of_branin),
    case("same_seed_same_search_on_one_and_two_threads", same_seed_same_search_on_one_and_two_threads),
    case("a_search_resumed_from_disk_ends_as_if_it_had_not_stopped", a_search_resumed_from_disk_goes_on),
    case("every_acquisition_climbs_alone_and_in_batches", every_acquisition_climbs_alone_and_in_batches),
    case("a_batch_holds_different_points", a_batch_holds_different_points),
    case("a_nan_is_an_error_that_names_the_point", a_nan_is_an_error_that_names_the_point),
    case("a_constant_objective_is_no_harm", a_constant_objective_is_no_harm),
    case("infeasible_starts_find_the_feasible_corner", infeasible_starts_find_the_feasible_corner),
    case("methods_climb_hartmann_in_six_dimensions", methods_climb_hartmann_in_six_dimensions),
    case("mixed_spaces_find_the_right_count", mixed_spaces_find_the_right_count),
    case(
        "a_proof_keeps_the_staged_method_from_counts_that_cannot_win",
        a_proof_keeps_the_staged_method_from_counts_that_cannot_win,
    ),
    case("ties_between_integers_do_not_stop_the_search", ties_between_integers_do_not_stop_the_search),
    case("more_evaluations_than_points_is_no_harm", more_evaluations_than_points_is_no_harm),
    case("the_published_rules_end_a_search_by_themselves", the_published_rules_end_a_search_by_themselves),
    with_shared(
        "methods_beat_chance_on_the_published_objective",
        methods_beat_chance_on_the_published_objective,
    ),
    case("the_command_finds_writes_and_goes_on", command::the_command_finds_writes_and_goes_on),
    case("ctrl_c_gives_the_best_so_far_at_once", command::ctrl_c_gives_the_best_so_far_at_once),
    case("the_default_gives_what_is_best_as_built", command::the_default_gives_what_is_best_as_built),
    case("housings_that_must_not_collide_do_not", command::housings_that_must_not_collide_do_not),
    case(
        "prices_at_which_counts_tie_do_not_stop_the_search",
        prices_at_which_counts_tie_do_not_stop_the_search,
    ),
    case("a_plateau_of_many_sensors_does_not_hide_few", a_plateau_of_many_sensors_does_not_hide_few),
    case("needles_on_a_hill_are_climbed", needles_on_a_hill_are_climbed),
    case("optima_on_a_border_are_hit", optima_on_a_border_are_hit),
    case("a_servo_s_steps_and_limits_are_kept", command::a_servo_s_steps_and_limits_are_kept),
    case("robust_searches_report_what_is_built", command::robust_searches_report_what_is_built),
    case("a_search_looks_again_at_what_it_liked", command::a_search_looks_again_at_what_it_liked),
    case("a_budget_of_rays_and_all_outputs", command::a_budget_of_rays_and_all_outputs),
    case(
        "the_published_export_is_read_as_it_was_found",
        command::the_published_export_is_read_as_it_was_found,
    ),
    case("a_mount_is_scored_as_it_was_found", command::a_mount_is_scored_as_it_was_found),
    case(
        "batches_and_acquisitions_are_chosen_by_flags",
        command::batches_and_acquisitions_are_chosen_by_flags,
    ),
    case(
        "a_certificate_lies_between_what_was_found_and_the_plain_bound",
        command::a_certificate_lies_between_what_was_found_and_the_plain_bound,
    ),
    case("small_budgets_are_kept_to_the_evaluation", small_budgets_are_kept_to_the_evaluation),
    case("a_mixed_rig_sees_what_its_sensors_see", mixed::a_mixed_rig_sees_what_its_sensors_see),
    case("types_that_are_not_used_change_nothing", mixed::types_that_are_not_used_change_nothing),
    case("masters_may_change_places_with_their_types", mixed::masters_may_change_places_with_their_types),
    case(
        "every_method_finds_the_type_that_is_worth_its_price",
        mixed::every_method_finds_the_type_that_is_worth_its_price,
    ),
    case(
        "a_mixed_search_is_the_same_resumed_and_on_any_threads",
        mixed::a_mixed_search_is_the_same_resumed_and_on_any_threads,
    ),
    case("unlike_housings_keep_their_own_distance", mixed::unlike_housings_keep_their_own_distance),
    case(
        "experiments_that_cannot_share_a_rig_are_refused",
        mixed::experiments_that_cannot_share_a_rig_are_refused,
    ),
    case("the_command_mixes_types", mixed::the_command_mixes_types),
];

fn real(name: &str, low: f64, high: f64) -> Variable {
    Variable { name: name.into(), low, high, integer: false, active_from: None, role: 0 }
}

fn settings(seed: u64, budget: usize) -> Settings {
    Settings::new(seed, budget)
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
    if matches!(kind, Kind::Bayesian | Kind::Staged) { budget.min(60) } else { budget }
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
            Kind::Bayesian | Kind::Staged => (45, 0.02),
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

/// Each choice of the next point finds the minimum, one point at a time and several side by side, on any number of
/// threads, and what is chosen makes a difference where there is noise.
fn every_acquisition_climbs_alone_and_in_batches() {
    let mut ways = Vec::new();
    for &acquisition in Acquisition::value_variants() {
        for batch in [1, 4] {
            let batch = NonZeroUsize::new(batch).unwrap();
            let settings = Settings { acquisition, batch, ..settings(3, 44) };
            let on = |threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| run(&branin_space(), Kind::Bayesian, settings, branin))
            };
            let search = on(1);
            assert!(search.history().eq(on(2).history()), "{acquisition:?}, {batch} at once");
            let best = search.best().unwrap().score;
            // four at once decide a quarter as often
            let least = if batch.get() == 1 { -0.45 } else { -0.8 };
            assert!(best > least, "{acquisition:?}, {batch} at once: {best}");
            let noisy = |x: &[f64]| {
                let hash = (x[0].to_bits() ^ x[1].to_bits()).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40;
                branin(x) + 100.0 * hash as f64 / f64::from(1 << 24)
            };
            let way = run(&branin_space(), Kind::Bayesian, settings, noisy).best().unwrap().clone();
            ways.push(way.candidate.values);
        }
    }
    // the guard need not have been asked
    ways.sort_by(|a, b| a.partial_cmp(b).unwrap());
    ways.dedup();
    assert!(ways.len() >= 4, "{ways:?}");
}

/// A batch is proposed before any of it is known, and its points lie apart.
fn a_batch_holds_different_points() {
    let settings = Settings { batch: NonZeroUsize::new(5).unwrap(), ..settings(1, 60) };
    let mut method = Bayesian::new(branin_space(), settings);
    let tell = |method: &mut Bayesian, asked: Vec<Candidate>| {
        let trial =
            |candidate: Candidate| Trial { score: branin(&candidate.values), violation: 0.0, candidate };
        method.tell(&asked.into_iter().map(trial).collect::<Vec<_>>());
    };
    let seeds = method.ask();
    tell(&mut method, seeds);
    for _ in 0..4 {
        let asked = method.ask();
        assert_eq!(asked.len(), 5);
        for (index, one) in asked.iter().enumerate() {
            for other in &asked[..index] {
                let apart = (one.values[0] - other.values[0]).hypot(one.values[1] - other.values[1]);
                assert!(apart > 0.01, "{asked:?}");
            }
        }
        tell(&mut method, asked);
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
            continue; // the corner is 1 in 450 of the space
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

/// Hartmann 6 (Dixon, Szego 1978): minimum -3.32237.
fn hartmann6(x: &[f64]) -> f64 {
    const ALPHA: [f64; 4] = [1.0, 1.2, 3.0, 3.2];
    const A: [[f64; 6]; 4] = [
        [10.0, 3.0, 17.0, 3.5, 1.7, 8.0],
        [0.05, 10.0, 17.0, 0.1, 8.0, 14.0],
        [3.0, 3.5, 1.7, 10.0, 17.0, 8.0],
        [17.0, 8.0, 0.05, 10.0, 0.1, 14.0],
    ];
    const P: [[f64; 6]; 4] = [
        [0.1312, 0.1696, 0.5569, 0.0124, 0.8283, 0.5886],
        [0.2329, 0.4135, 0.8307, 0.3736, 0.1004, 0.9991],
        [0.2348, 0.1451, 0.3522, 0.2883, 0.3047, 0.6650],
        [0.4047, 0.8828, 0.8732, 0.5743, 0.1091, 0.0381],
    ];
    let hill = |i: usize| {
        let squares: f64 = (0..6).map(|j| A[i][j] * (x[j] - P[i][j]).powi(2)).sum();
        ALPHA[i] * (-squares).exp()
    };
    (0..4).map(hill).sum()
}

fn methods_climb_hartmann_in_six_dimensions() {
    let space = Space::new((1..=6).map(|i| real(&format!("x{i}"), 0.0, 1.0)).collect()).unwrap();
    for (kind, budget, least) in [
        (Kind::Random, 3000, 2.2),
        (Kind::Staged, 1500, 3.1),
        (Kind::Pattern, 1500, 3.1),
        (Kind::Bayesian, 70, 2.8),
        (Kind::Genetic, 3000, 3.1),
        (Kind::ParticleSwarm, 3000, 3.1),
        (Kind::CmaEs, 3000, 3.1),
        (Kind::DifferentialEvolution, 3000, 3.1),
    ] {
        let best = run(&space, kind, settings(3, budget), hartmann6).best().unwrap().score;
        assert!(best > least && best < 3.322_38, "{}: {best}", kind.name());
    }
}

/// One part or two are worth exactly the same wherever the first is: neither may keep the search from the best place.
fn prices_at_which_counts_tie_do_not_stop_the_search() {
    for &kind in Kind::ALL {
        let budget = few_if_modelled(kind, 400);
        let search = run(&parts_space(), kind, settings(6, budget), |x| {
            let used = x[0] as usize;
            let mean = x[1..=used].iter().map(|place| (place - 0.3).abs()).sum::<f64>() / used as f64;
            10.0 - mean
        });
        let best = search.best().unwrap();
        assert!(best.score > 9.95, "{}: {best:?}", kind.name());
    }
}

/// A smooth hill of 1 under needles of width 0.002 and height 0.3, piecewise constant.
fn needles(x: &[f64]) -> f64 {
    let hill = 1.0 - 0.5 * (x[0] - 0.4).powi(2) - 0.5 * (x[1] + 0.2).powi(2);
    let cell = ((x[0] * 500.0).floor() * 131.0 + (x[1] * 40.0).floor() * 7919.0) as i64;
    let hash = (cell as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40;
    hill + 0.3 * (hash as f64 / f64::from(1 << 24)).powi(8)
}

fn needles_on_a_hill_are_climbed() {
    let space = Space::new(vec![real("a", -1.0, 1.0), real("b", -1.0, 1.0)]).unwrap();
    let at = |kind, budget| {
        let mut scores: Vec<f64> = (1..=3)
            .map(|seed| run(&space, kind, settings(seed, budget), needles).best().unwrap().score)
            .collect();
        scores.sort_by(f64::total_cmp);
        scores[1]
    };
    let chance = at(Kind::Random, 500);
    for kind in [Kind::Staged, Kind::Genetic, Kind::ParticleSwarm] {
        let found = at(kind, 500);
        assert!(found > chance && found > 1.2, "{}: {found}, chance {chance}", kind.name());
    }
}

/// The best place is a corner of the box.
fn optima_on_a_border_are_hit() {
    let space = Space::new(vec![real("a", -1.0, 1.0), real("b", -1.0, 1.0), real("c", -1.0, 1.0)]).unwrap();
    for kind in [Kind::Staged, Kind::Genetic, Kind::ParticleSwarm] {
        let search = run(&space, kind, settings(1, 400), |x| x[0] - x[1] + (7.0 * x[2]).sin());
        let best = search.best().unwrap();
        assert_eq!(best.candidate.values[..2], [1.0, -1.0], "{}: {best:?}", kind.name());
    }
}

fn counted(name: &str, low: f64, high: f64, active_from: u32) -> Variable {
    Variable { active_from: Some(active_from), ..real(name, low, high) }
}

/// One to three parts, each adding `1 - |place - 0.3|`, each costing 0.8 but the second, which costs 1.3: two parts at
/// 0.3 are not worth it, so one is best, and it scores 1.
fn parts(x: &[f64]) -> f64 {
    let used = x[0] as usize;
    let value: f64 = x[1..=used].iter().map(|place| 1.0 - (place - 0.3).abs()).sum();
    value - [0.0, 1.3, 2.1][used - 1]
}

fn parts_space() -> Space {
    let count =
        Variable { name: "parts".into(), low: 1.0, high: 3.0, integer: true, active_from: None, role: 0 };
    let place = |part: u32| Variable { role: 1, ..counted(&format!("place {part}"), -1.0, 1.0, part) };
    Space::new(vec![count, real("place 1", -1.0, 1.0), place(2), place(3)]).unwrap()
}

fn mixed_spaces_find_the_right_count() {
    for &kind in Kind::ALL {
        let budget = few_if_modelled(kind, 600);
        let search = run(&parts_space(), kind, settings(2, budget), parts);
        let best = search.best().unwrap();
        assert_eq!(best.candidate.values[0], 1.0, "{}: {best:?}", kind.name());
        assert!(best.score > 0.97, "{}: {best:?}", kind.name());
    }
}

fn a_proof_keeps_the_staged_method_from_counts_that_cannot_win() {
    let space = parts_space().with_ceilings(vec![1.0, 0.7, 0.6]);
    let dear = std::sync::atomic::AtomicUsize::new(0);
    let objective = |x: &[f64]| {
        dear.fetch_add(usize::from(x[0] > 1.0), Ordering::Relaxed);
        parts(x)
    };
    let search = run(&space, Kind::Staged, settings(2, 60), objective);
    assert!(search.best().unwrap().score > 0.9);
    assert_eq!(dear.load(Ordering::Relaxed), 0, "one part scores above 0.7 at once: more cannot win");
}

/// The published search with the OS1-64.
fn published(path: Path) -> MountProblem {
    let experiment = Experiment { path, ..Experiment::published(Preset::named("paper-os1-64").unwrap()) };
    let objective = Objective::new(PublishedBox::new(&experiment).unwrap(), Weights::default(), 0.0).unwrap();
    MountProblem::new(objective, 5, KeepApart::None)
}

/// Along the path four OS1-64 see nearly everything whatever their tilts, for a J of 26,700 to 26,850; two need the right
/// tilt, and reach 28,300. From these seeds a model of all counts at once never came back to two.
fn a_plateau_of_many_sensors_does_not_hide_few() {
    let problem = published(Path::Forward);
    for seed in [1, 5] {
        let mut search = Search::new(problem.space().unwrap(), Kind::Bayesian, settings(seed, 56));
        search.run(56, |x| problem.measure(x), |_| (), &AtomicBool::new(false)).unwrap();
        let best = search.best().unwrap();
        assert!(best.candidate.values[0] == 1.0 && best.score > 27_500.0, "{seed}: {best:?}");
    }
}

/// All values of an integer tie but for a tiny slope in the other variable.
fn ties_between_integers_do_not_stop_the_search() {
    for &kind in Kind::ALL {
        let budget = few_if_modelled(kind, 200);
        let search = run(&parts_space(), kind, settings(8, budget), |x| 1e-6 * x[1]);
        let best = search.best().unwrap();
        assert!(best.score > 0.9e-6, "{}: {best:?}", kind.name());
        assert_eq!(search.evaluations(), budget);
    }
}

/// Only four different points exist: duplicates cannot be avoided.
fn more_evaluations_than_points_is_no_harm() {
    let place =
        Variable { name: "place".into(), low: 0.0, high: 3.0, integer: true, active_from: None, role: 0 };
    let space = Space::new(vec![place]).unwrap();
    for &kind in Kind::ALL {
        let mut search = Search::new(space.clone(), kind, settings(1, 30));
        search.run(30, |x| measured(x[0]), |_| (), &AtomicBool::new(false)).unwrap();
        assert_eq!(search.best().unwrap().score, 3.0, "{}", kind.name());
        assert_eq!(search.evaluations(), 30, "{}", kind.name());
    }
}

fn the_published_rules_end_a_search_by_themselves() {
    for kind in [Kind::Bayesian, Kind::Genetic, Kind::ParticleSwarm] {
        let published = Settings { early_stop: true, ..settings(1, kind.published_budget()) };
        let mut search = Search::new(branin_space(), kind, published);
        let ended = search.run(published.budget, |x| measured(branin(x)), |_| (), &AtomicBool::new(false));
        assert_eq!(ended.unwrap(), StoppedBy::Converged, "{}", kind.name());
        assert!(search.evaluations() > 51 && search.evaluations() < published.budget, "{}", kind.name());
    }
}

/// Medians over a few seeds on the published objective beside the stored median of random search with as many
/// evaluations in the same space: whoever does not beat chance is broken.
fn methods_beat_chance_on_the_published_objective() {
    let text = std::fs::read_to_string(shared("reference/optimizers/published_os1_64.json")).unwrap();
    let reference: serde_json::Value = serde_json::from_str(&text).unwrap();
    let chance = reference["budgets"]["56"]["random search"]["median"].as_f64().unwrap();
    let problem = published(Path::Lateral);
    for kind in [Kind::Staged, Kind::Bayesian, Kind::Pattern] {
        let mut scores: Vec<f64> = (1..=5)
            .map(|seed| {
                let mut search = Search::new(problem.space().unwrap(), kind, settings(seed, 56));
                search.run(56, |x| problem.measure(x), |_| (), &AtomicBool::new(false)).unwrap();
                search.best().unwrap().score
            })
            .collect();
        scores.sort_by(f64::total_cmp);
        assert!(scores[2] > chance, "{}: {scores:?}, chance {chance}", kind.name());
    }
}
