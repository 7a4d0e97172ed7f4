use super::*;
use crate::simulate::published::{Experiment, Preset};

fn seen(union: u64, overlap: u64) -> Seen {
    Seen::exact(&Counts { union, overlap, per_sensor: vec![], unique_per_sensor: vec![] }, 0)
}

#[test]
fn the_overlap_window_has_its_published_edges() {
    let overlap = |twice| score(&Weights::default(), &seen(1000, twice), None, 0.0).overlap;
    assert_eq!(overlap(0), -50.0);
    assert!((overlap(30) + 20.0).abs() < 1e-9);
    assert_eq!(overlap(50), 300.0);
    assert_eq!(overlap(100), 300.0);
    assert!((overlap(600) + 300.0).abs() < 1e-9);
}

#[test]
fn parallel_axes_cost_two_thousand_and_thirty_degrees_earn_a_hundred() {
    let angular = |angle_deg| score(&Weights::default(), &seen(1, 0), angle_deg, 0.0).angular;
    assert_eq!(angular(Some(0.0)), -2000.0);
    assert_eq!(angular(Some(15.0)), -1000.0);
    assert_eq!(angular(Some(30.0)), 100.0);
    assert_eq!(angular(None), 100.0);
}

#[test]
fn angles_between_axes() {
    assert_eq!(min_angle_deg(&[[0.0, 0.0, 1.0]]), None);
    let least = min_angle_deg(&[[0.0, 0.0, 2.0], [1.0, 0.0, 0.0], [1.0, 0.0, 1.0]]).unwrap();
    assert!((least - 45.0).abs() < 1e-12);
}

#[test]
fn angles_do_not_depend_on_where_axes_point_or_how_long_they_are() {
    let corner = [[2.0, 3.0, 6.0], [3.0, -6.0, 2.0], [12.0, 4.0, -6.0]];
    assert!((min_angle_deg(&corner).unwrap() - 90.0).abs() < 1e-12);
    assert_eq!(min_angle_deg(&[[1.0, 2.0, 2.0], [-2.0, -4.0, -4.0]]), Some(180.0));
    assert!((min_angle_deg(&[[1.0, 1.0, 0.0], [0.0, 3.0, 3.0]]).unwrap() - 60.0).abs() < 1e-12);
}

#[test]
fn j_is_the_sum_of_its_terms() {
    let terms = Terms { coverage: 1000.0, overlap: 300.0, angular: -50.0, cost: -4000.0, registration: 7.0 };
    assert_eq!(terms.objective(), -2743.0);
    assert_eq!(score(&Weights::default(), &seen(10, 0), None, 4000.0).cost, -4000.0);
}

fn quality(translation_p5: f64) -> RegistrationQuality {
    RegistrationQuality {
        scans: 9,
        translation_median: 0.1,
        translation_p5,
        rotation_median_m2: 0.1,
        rotation_p5_m2: 0.1,
        degenerate_share: 0.0,
        weakest_direction: None,
    }
}

/// Two sensor types on a coarse version of the published experiment.
fn objective(weights: Weights, least_distance_m: f64) -> Objective {
    let presets = ["paper-os1-64", "paper-vlp-16"].map(|name| Preset::named(name).unwrap());
    let experiment = Experiment { azimuths: 36, ..Experiment::mixed(&presets).unwrap() };
    Objective::new(PublishedBox::new(&experiment).unwrap(), weights, least_distance_m).unwrap()
}

fn sensor(x_m: f64, sensor_type: usize) -> MountDeg {
    MountDeg { x_m, pitch_deg: 300.0 * x_m, sensor_type, ..MountDeg::default() }
}

#[test]
fn ten_times_the_least_eigenvalue_earns_the_weight_of_registration() {
    let weights = Weights { registration: 200.0, ..Weights::default() };
    let term =
        |p5| objective(weights, 0.0).terms(&Rig::default(), &seen(1, 0), Some(&quality(p5))).registration;
    assert_eq!(term(DEGENERATE), 0.0);
    assert!((term(10.0 * DEGENERATE) - 200.0).abs() < 1e-9);
    assert!((term(0.01 * DEGENERATE) + 400.0).abs() < 1e-9);
    assert_eq!(term(0.0), term(LEAST_EIGENVALUE));
    assert!((term(1.0 / 3.0) - weights.best_registration_term()).abs() < 1e-9);
    assert_eq!(objective(weights, 0.0).terms(&Rig::default(), &seen(1, 0), None).registration, 0.0);
}

#[test]
fn every_sensor_costs_what_its_type_costs() {
    let sensors = [sensor(-0.1, 0), sensor(0.1, 0), sensor(0.0, 1)];
    let cost = |objective: &Objective| objective.terms(&objective.mounted(&sensors), &seen(1, 0), None).cost;
    let published = objective(Weights::default(), 0.0);
    assert_eq!((published.prices(), cost(&published)), (&[2000.0, 2000.0][..], -6000.0));
    let one_given = published.clone().with_prices(vec![1500.0]);
    assert_eq!((one_given.prices(), cost(&one_given)), (&[1500.0, 2000.0][..], -5000.0));
    assert_eq!(cost(&published.with_prices(vec![1500.0, 800.0])), -3800.0);
}

#[test]
fn an_evaluation_says_what_the_simulator_counted() {
    let objective = objective(Weights::default(), 0.0);
    let sensors = [sensor(-0.1, 0), sensor(0.1, 1)];
    let counted = objective.simulator().count(&sensors).unwrap();
    let rig = objective.mounted(&sensors);
    let evaluation = objective.evaluate_rig(&rig).unwrap();
    assert!(counted.union > 1000 && counted.overlap > 0);
    assert_eq!(
        (evaluation.unique_voxels, evaluation.overlap_ratio),
        (counted.union, counted.overlap_ratio())
    );
    assert_eq!(evaluation.reachable_voxels, objective.simulator().reachable());
    assert_eq!(evaluation.per_sensor_voxels, counted.per_sensor);
    assert_eq!(evaluation.unique_per_sensor, counted.unique_per_sensor);
    assert_eq!((evaluation.sensors, &evaluation.models[..]), (2, &["os1-64", "vlp-16"][..]));
    assert_eq!(evaluation.rays, 41 * 36 * (64 + 16));
    assert!((evaluation.min_angle_deg.unwrap() - 60.0).abs() < 1e-9);
    let terms = objective.terms(&rig, &Seen::exact(&counted, 0), None);
    assert_eq!((evaluation.terms, evaluation.objective), (terms, terms.objective()));
    assert_eq!((terms.coverage, terms.angular, terms.cost), (counted.union as f64, 100.0, -4000.0));
    assert_eq!(objective.score(&rig).unwrap(), evaluation.objective);
    assert_eq!((evaluation.feasible, evaluation.registration), (true, None));
    // a master and its mirror image
    let masters = objective.evaluate(&[sensor(0.1, 0)]).unwrap();
    let pair = objective.mounted(&[sensor(0.1, 0), sensor(-0.1, 0)]);
    assert_eq!(masters, objective.evaluate_rig(&pair).unwrap());
}

#[test]
fn registration_is_looked_at_where_weight_or_constraint_asks() {
    let weights = Weights::default();
    let asked = |weights: Weights| {
        let objective = objective(weights, 0.0);
        let rig = objective.mounted(&[sensor(0.1, 0)]);
        let scores = objective.evaluate_rig(&rig).unwrap();
        assert_eq!(scores.registration, objective.registration(&rig));
        assert_eq!(scores.objective, objective.score(&rig).unwrap());
        (scores.registration, scores.terms.registration)
    };
    assert_eq!(asked(weights), (None, 0.0));
    let (quality, term) = asked(Weights { registration: 100.0, ..weights });
    assert!(quality.is_some() && term != 0.0);
    assert_eq!(asked(Weights { least_conditioning: 1e-9, ..weights }), (quality, 0.0));
}

#[test]
fn conditioning_falls_short_by_a_share_of_what_is_needed() {
    let shortfall = |least_conditioning, p5: Option<f64>| {
        let weights = Weights { least_conditioning, ..Weights::default() };
        weights.conditioning_shortfall(p5.map(quality).as_ref())
    };
    assert_eq!(shortfall(0.01, Some(0.0075)), 0.25);
    assert_eq!(shortfall(0.01, Some(0.01)), 0.0);
    assert_eq!(shortfall(0.01, Some(0.02)), 0.0);
    assert_eq!(shortfall(0.01, None), 1.0);
    assert_eq!(shortfall(0.0, None), 0.0);
}

#[test]
fn violations_are_named_with_their_numbers() {
    let near = [sensor(-0.02, 0), sensor(0.02, 0)];
    let evaluate = |objective: Objective, sensors: &[MountDeg]| {
        objective.evaluate_rig(&objective.mounted(sensors)).unwrap()
    };
    let evaluation = evaluate(objective(Weights::default(), 0.0), &near);
    assert!(!evaluation.feasible);
    let reported: Vec<_> = evaluation.violations.iter().map(Violation::to_string).collect();
    assert_eq!(reported, ["sensor 1 and sensor 2 are 0.0400 m apart, needed are 0.0870 m"]);
    let apart = [sensor(-0.1, 0), sensor(0.1, 0)];
    let evaluation = evaluate(objective(Weights::default(), 0.3), &apart);
    let reported: Vec<_> = evaluation.violations.iter().map(Violation::to_string).collect();
    assert_eq!(reported, ["sensor 1 and sensor 2 are 0.2000 m apart, needed are 0.3000 m"]);
    let out_of_reach = Weights { least_conditioning: 0.5, ..Weights::default() };
    let evaluation = evaluate(objective(out_of_reach, 0.0), &apart);
    let conditioning = evaluation.registration.unwrap().translation_p5;
    assert!(!evaluation.feasible && conditioning > 0.0);
    assert_eq!(evaluation.violations, [Violation::Conditioning { conditioning, needed_conditioning: 0.5 }]);
    assert_eq!(
        Violation::Conditioning { conditioning: 0.0123456, needed_conditioning: 0.5 }.to_string(),
        "conditioning of registration is 0.012346, needed is 0.5"
    );
}

#[test]
fn housings_are_those_of_the_types_and_of_the_first_where_there_is_no_such_type() {
    let objective = objective(Weights::default(), 0.1);
    let radius_m = |model| catalogue::nominal(model).unwrap().housing_radius_m;
    let (os1_m, vlp_m) = (radius_m("os1-64"), radius_m("vlp-16"));
    assert!(2.0 * os1_m < 0.1 && 2.0 * vlp_m > 0.1 && objective.least_distance_m() == 0.1);
    let sensors = [sensor(0.1, 1), sensor(-0.1, 0), sensor(0.0, 7)];
    let rig = objective.mounted(&sensors);
    let parts = rig.sensors.iter().map(|part| (part.name.as_str(), part.mount, part.model.housing_radius_m));
    let expected = [
        ("sensor 1", sensors[0].mount(), vlp_m),
        ("sensor 2", sensors[1].mount(), os1_m),
        ("sensor 3", sensors[2].mount(), os1_m),
    ];
    assert_eq!(parts.collect::<Vec<_>>(), expected);
    let unknown = objective.evaluate(&sensors[2..]).unwrap_err().to_string();
    assert!(unknown.contains("sensor 1 is of type 7"), "{unknown}");
}

#[test]
fn another_experiment_leaves_weights_and_prices() {
    let weights = Weights { angle_reward: 50.0, ..Weights::default() };
    let before = objective(weights, 0.2).with_prices(vec![1.0, 2.0]);
    let after = before.changed(|experiment| experiment.voxel_m = 1.0).unwrap();
    assert_eq!((after.weights(), after.prices(), after.least_distance_m()), (&weights, &[1.0, 2.0][..], 0.2));
    assert!(after.simulator().reachable() < before.simulator().reachable());
}

#[test]
fn coverage_is_saturated_when_at_most_one_voxel_of_a_thousand_is_missed() {
    let objective = objective(Weights::default(), 0.0);
    let mut evaluation = objective.evaluate_rig(&objective.mounted(&[sensor(0.1, 0)])).unwrap();
    let mut says = |unique, reachable| {
        (evaluation.unique_voxels, evaluation.reachable_voxels) = (unique, reachable);
        evaluation.saturation()
    };
    assert_eq!(says(998, 1000), None);
    assert!(says(999, 1000).unwrap().starts_with("999 of 1000 voxels that can be reached are seen"));
    assert!(says(1000, 1000).is_some());
    assert_eq!(says(0, 0), None);
}
