//! Rigs that mix sensor types.

use std::sync::atomic::{AtomicBool, Ordering};

use outrigger::base::rng::Rng;
use outrigger::design::objective::{Objective, Weights};
use outrigger::design::optimize::{KeepApart, Kind, MountProblem, MountSearch, Search, Settings};
use outrigger::rig::{MountDeg, Path, Phase, Roll};
use outrigger::simulate::published::{Experiment, Preset, PublishedBox};

use super::command::{json, outrigger};

fn presets() -> [&'static Preset; 2] {
    ["paper-os1-64", "paper-vlp-16"].map(|name| Preset::named(name).unwrap())
}

fn mixed() -> Experiment {
    Experiment::mixed(&presets()).unwrap()
}

fn objective(experiment: &Experiment, prices: [f64; 2]) -> Objective {
    let simulator = PublishedBox::new(experiment).unwrap();
    Objective::new(simulator, Weights::default(), 0.0).unwrap().with_prices(prices.to_vec())
}

/// Masters of both types in turn, three of them.
fn masters(rng: &mut Rng) -> Vec<MountDeg> {
    let ranges = [(-0.1, 0.15), (-0.25, 0.25), (-0.15, 0.15), (-90.0, 90.0), (-20.0, 20.0)];
    let one = |index: usize| {
        let values = ranges.map(|(low, high)| rng.between(low, high));
        MountDeg { sensor_type: (index + 1) % 2, ..MountDeg::from(values) }
    };
    (0..3).map(one).collect()
}

/// Every sensor seen on its own by the simulator of its model, straight from the definition, and the voxels joined here.
pub fn a_mixed_rig_sees_what_its_sensors_see() {
    let mut rng = Rng::new(21, 0);
    for (path, phase, roll, mirror) in [
        (Path::Lateral, Phase::Locked, Roll::Fixed(0.0), true),
        (Path::Forward, Phase::Locked, Roll::Free, true),
        (Path::Forward, Phase::Locked, Roll::Free, false),
        (Path::Lateral, Phase::Free, Roll::Free, true),
    ] {
        let changed = |from: Experiment| Experiment { path, phase, roll, mirror, azimuths: 60, ..from };
        let experiment = changed(mixed());
        let alone =
            presets().map(|preset| PublishedBox::new(&changed(Experiment::published(preset))).unwrap());
        let (prices, weights) = ([1500.0, 700.0], Weights::default());
        let objective = objective(&experiment, prices);
        let sensors = experiment.sensors(&masters(&mut rng));
        let (mut union, mut twice) = (Vec::new(), Vec::new());
        let mut voxels = Vec::new();
        let mut price = 0.0;
        for sensor in &sensors {
            let of_its_own = MountDeg { sensor_type: 0, ..*sensor };
            let seen = alone[sensor.sensor_type].coverage_by_definition(&[of_its_own]).unwrap();
            let seen = seen.coverage.union();
            union.resize(seen.len(), 0_u64);
            twice.resize(seen.len(), 0_u64);
            for ((union, twice), seen) in union.iter_mut().zip(&mut twice).zip(&seen) {
                *twice |= *union & seen;
                *union |= seen;
            }
            voxels.push(seen.iter().map(|word| u64::from(word.count_ones())).sum::<u64>());
            price += prices[sensor.sensor_type];
        }
        let seen = objective.simulator().cover(&sensors).unwrap();
        assert_eq!(seen.coverage.union(), union, "{path:?} {phase:?}");
        assert_eq!(seen, objective.simulator().coverage_by_definition(&sensors).unwrap());
        let count = |words: &[u64]| words.iter().map(|word| u64::from(word.count_ones())).sum::<u64>();
        let evaluation = objective.evaluate_rig(&objective.mounted(&sensors)).unwrap();
        assert_eq!((evaluation.unique_voxels, &evaluation.per_sensor_voxels), (count(&union), &voxels));
        let overlap = count(&twice) as f64 / count(&union) as f64;
        assert_eq!(evaluation.overlap_ratio, overlap);
        let expected = count(&union) as f64 + weights.overlap_term(overlap) - price
            + weights.angular_term(evaluation.min_angle_deg);
        assert!((evaluation.objective - expected).abs() < 1e-9, "{} {expected}", evaluation.objective);
        let models: Vec<_> = sensors.iter().map(|sensor| presets()[sensor.sensor_type].model).collect();
        assert_eq!(evaluation.models, models);
        let rays: u64 = sensors.iter().map(|s| alone[s.sensor_type].experiment().rays_per_sensor()).sum();
        assert_eq!(evaluation.rays, rays);
    }
}

/// A rig of one type scores as ever, whichever types it might have had.
pub fn types_that_are_not_used_change_nothing() {
    let mut rng = Rng::new(22, 0);
    for (index, preset) in presets().into_iter().enumerate() {
        let alone = Objective::published(preset.name, |_| ()).unwrap();
        let both = objective(&mixed(), [2000.0; 2]);
        let masters = masters(&mut rng);
        let of_type = |sensor_type: usize| -> Vec<MountDeg> {
            masters.iter().map(|master| MountDeg { sensor_type, ..*master }).collect()
        };
        let evaluation = alone.evaluate(&of_type(0)).unwrap();
        assert_eq!(both.evaluate(&of_type(index)).unwrap(), evaluation);
        // one preset makes the experiment and the space that there always were
        assert_eq!(Experiment::mixed(&[preset]).unwrap(), *alone.simulator().experiment());
        assert_eq!(MountSearch::of(&alone, 5).space().unwrap().len(), 21);
    }
}

pub fn masters_may_change_places_with_their_types() {
    let mut rng = Rng::new(23, 0);
    let experiment = Experiment { roll: Roll::Free, ..mixed() };
    let problem = MountProblem::new(objective(&experiment, [2000.0, 800.0]), 3, KeepApart::Housings);
    let space = problem.space().unwrap();
    for _ in 0..4 {
        let mut values = space.sample(&mut rng);
        values[0] = 3.0;
        // y as it is: the two ends of the walk change places by the first master's
        (0..3).for_each(|master| values[2 + 6 * master] = values[2 + 6 * master].abs());
        let measured = problem.measure(&values).unwrap();
        let mut swapped = values.clone();
        swapped[1..].rotate_left((values.len() - 1) / 3);
        assert_ne!(swapped, values);
        let of_swapped = problem.measure(&swapped).unwrap();
        assert_eq!((of_swapped.score, of_swapped.rays), (measured.score, measured.rays));
        // the distances that miss are summed in another order
        assert!((of_swapped.violation - measured.violation).abs() < 1e-12);
        assert_eq!(space.canonical(&swapped), space.canonical(&values), "equal rigs are one point");
        // but not without their types
        let mut exchanged = values.clone();
        let types: Vec<usize> = (1..=3).map(|master| master * (values.len() - 1) / 3).collect();
        exchanged[types[0]] = 1.0 - values[types[0]];
        assert_ne!(space.canonical(&exchanged), space.canonical(&values));
    }
    // a master beyond the count has no type to reckon with
    let mut values = space.sample(&mut rng);
    values[0] = 1.0;
    let mut other = values.clone();
    let last = values.len() - 1;
    other[last] = 1.0 - values[last];
    assert_eq!(space.canonical(&other), space.canonical(&values));
    assert!(!space.free(&values).contains(&last));
}

/// A pair of VLP-16 sees some 1,400 voxels less than one of OS1-64: which is worth it is a question of their prices.
pub fn every_method_finds_the_type_that_is_worth_its_price() {
    for (prices, expected) in [([2000.0, 2000.0], "os1-64"), ([4000.0, 800.0], "vlp-16")] {
        let problem = MountProblem::new(objective(&mixed(), prices), 2, KeepApart::None);
        for &kind in Kind::ALL {
            let mut search = Search::new(problem.space().unwrap(), kind, Settings::new(4, 60));
            let stop = AtomicBool::new(false);
            search.run(60, |values| problem.measure(values), |_| (), &stop).unwrap();
            let masters = problem.masters(&search.best().unwrap().candidate.values);
            let experiment = problem.objective().simulator().experiment();
            let models: Vec<_> = masters.iter().map(|master| experiment.model_of(master)).collect();
            assert!(
                models.iter().all(|model| *model == expected),
                "{} at {prices:?}: {models:?}",
                kind.name()
            );
        }
    }
}

pub fn a_mixed_search_is_the_same_resumed_and_on_any_threads() {
    let problem = MountProblem::new(objective(&mixed(), [2000.0, 800.0]), 3, KeepApart::Housings);
    for &kind in Kind::ALL {
        let start = || Search::new(problem.space().unwrap(), kind, Settings::new(7, 40));
        let run = |search: &mut Search, until: usize, threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let stop = AtomicBool::new(false);
            pool.install(|| {
                let leave = |search: &Search| {
                    stop.store(search.evaluations() >= until, Ordering::Relaxed);
                };
                search.run(40, |values| problem.measure(values), leave, &stop).unwrap()
            });
        };
        let (mut one, mut two) = (start(), start());
        run(&mut one, 40, 1);
        run(&mut two, 15, 2);
        let written = serde_json::to_string(&two).unwrap();
        let mut resumed: Search = serde_json::from_str(&written).unwrap();
        resumed.check().unwrap();
        run(&mut resumed, 40, 2);
        let whole = |search: &Search| serde_json::to_string(search).unwrap();
        assert_eq!(whole(&resumed), whole(&one), "{}", kind.name());
    }
}

/// Housings differ: an OS1 has a radius of 42.5 mm, a VLP-16 one of 51.6 mm.
pub fn unlike_housings_keep_their_own_distance() {
    let experiment = Experiment { mirror: false, ..mixed() };
    let objective = objective(&experiment, [2000.0; 2]);
    let at = |x_m: f64, sensor_type| MountDeg { x_m, sensor_type, ..MountDeg::default() };
    let radius_m = |model: &str| sensors::catalogue::nominal(model).unwrap().housing_radius_m;
    let (ouster_m, velodyne_m) = (radius_m("os1-64"), radius_m("vlp-16"));
    assert!(velodyne_m > ouster_m + 0.005, "{ouster_m} {velodyne_m}");
    for (first, second, needed_m) in [
        (0, 0, 2.0 * ouster_m),
        (0, 1, ouster_m + velodyne_m),
        (1, 0, ouster_m + velodyne_m),
        (1, 1, 2.0 * velodyne_m),
    ] {
        for (off_m, is_retained) in [(1e-6, true), (-1e-6, false)] {
            let pair = [at(0.0, first), at(needed_m + off_m, second)];
            let evaluation = objective.evaluate_rig(&objective.mounted(&pair)).unwrap();
            assert_eq!(evaluation.feasible, is_retained, "{first} {second}: {:?}", evaluation.violations);
        }
    }
    // what the search minimises is what is missing
    let problem = MountProblem::new(objective, 2, KeepApart::Housings);
    let violation = |types: [f64; 2]| {
        let values = [2.0, 0.0, 0.0, 0.1, 0.0, types[0], 0.0, 0.0, 0.0, 0.0, types[1]];
        problem.measure(&values).unwrap().violation
    };
    assert_eq!(violation([0.0, 0.0]), 0.0, "0.1 m apart, one above the other");
    assert!(violation([1.0, 1.0]) > 0.0 && violation([1.0, 1.0]) > violation([0.0, 1.0]));
}

pub fn experiments_that_cannot_share_a_rig_are_refused() {
    let [ouster, velodyne] = presets();
    for bad in [&[][..], &[ouster, ouster], &[ouster, velodyne, ouster]] {
        assert!(Experiment::mixed(bad).unwrap_err().to_string().contains("make no rig"));
    }
    let unknown = MountDeg { sensor_type: 2, ..MountDeg::default() };
    let error = PublishedBox::new(&mixed()).unwrap().count(&[MountDeg::default(), unknown]).unwrap_err();
    assert!(error.to_string().contains("sensor 2 is of type 2"), "{error}");
}

pub fn the_command_mixes_types() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let [mount, csv, report, state] = ["mount.json", "mount.csv", "mount.html", "state.json"].map(path);
    let both = ["--preset", "paper-os1-64,paper-vlp-16", "--lambda", "os1-64=2000,vlp-16=-500"];
    // two masters of which the cheaper type pays for itself
    let search =
        ["--method", "pattern", "--evals", "60", "--seed", "2", "--masters-min", "2", "--masters-max", "2"];
    let outputs = ["--out", &mount, "--csv", &csv, "--report", &report, "--resume", &state, "--json"];
    let found = json(&[&["optimize"], &both[..], &search, &outputs].concat());
    assert_eq!(found["preset"], "paper-os1-64,paper-vlp-16");
    assert_eq!(found["prices"], serde_json::json!([2000.0, -500.0]));
    let models = found["best"]["models"].as_array().unwrap().clone();
    assert_eq!(models.len(), 4);
    assert_eq!((&models[0], &models[2]), (&models[1], &models[3]), "a pair is of one type");
    assert_eq!(found["best"]["master_models"], serde_json::json!([models[0], models[2]]));

    let file: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&mount).unwrap()).unwrap();
    let of_file: Vec<_> = file["sensors"].as_array().unwrap().iter().map(|s| s["model"].clone()).collect();
    assert_eq!((of_file, &file["preset"]), (models.clone(), &found["preset"]));
    let rows = std::fs::read_to_string(&csv).unwrap();
    for (row, model) in rows.lines().skip(1).zip(&models) {
        assert_eq!(row.split(',').nth(1), model.as_str());
    }
    assert!(std::fs::read_to_string(&report).unwrap().contains(">model</th>"));

    // whatever was found, one of each is scored as it is listed
    let mut one_of_each = file.clone();
    for (index, sensor) in one_of_each["sensors"].as_array_mut().unwrap().iter_mut().enumerate() {
        sensor["model"] = ["os1-64", "vlp-16"][index / 2].into();
    }
    one_of_each.as_object_mut().unwrap().remove("master_models");
    std::fs::write(path("each.json"), one_of_each.to_string()).unwrap();
    let lambda = &both[2..];
    let evaluate = |file: &str| json(&[&["predict", "--json", "--mount", file], lambda].concat());
    assert_eq!(evaluate(&mount)["objective"], found["best"]["objective"], "the mount file scores as found");
    let each = evaluate(&path("each.json"));
    assert_eq!(each["models"], serde_json::json!(["os1-64", "os1-64", "vlp-16", "vlp-16"]));
    assert_eq!(each["terms"]["cost"], -3000.0);
    let masters: Vec<String> = (0..2)
        .map(|index| {
            let master: Vec<f64> = serde_json::from_value(file["masters"][index].clone()).unwrap();
            let numbers: Vec<_> = master.iter().map(f64::to_string).collect();
            format!("{},{}", numbers.join(","), ["os1-64", "vlp-16"][index])
        })
        .collect();
    let typed = json(&[&["predict", "--json", "--masters", &masters.join(";")], &both[..]].concat());
    assert_eq!(typed["coverage_sha256"], each["coverage_sha256"]);

    // a state file goes on only with the same types and prices
    let again = json(
        &[
            &["optimize"],
            &both[..],
            &["--resume", &state, "--json", "--masters-min", "2", "--masters-max", "2"],
        ]
        .concat(),
    );
    assert_eq!(again["history"], found["history"]);
    for (arguments, words) in [
        (vec!["optimize", "--preset", "paper-os1-64", "--resume", &state], "preset"),
        (
            vec![
                "optimize",
                both[0],
                both[1],
                "--masters-min",
                "2",
                "--masters-max",
                "2",
                "--resume",
                &state,
            ],
            "lambda",
        ),
        (vec!["optimize", both[0], both[1], "--certify", "64"], "--certify"),
        (vec!["optimize", both[0], both[1], "--export-published", &csv], "--export-published"),
        (vec!["optimize", both[0], both[1], "--lambda", "os1-64=5"], "no price for vlp-16"),
        (vec!["optimize", "--preset", "paper-vlp-16,paper-vlp-16"], "make no rig"),
        (vec!["predict", "--preset", "paper-os1-64", "--mount", "EACH"], "with commas"),
        (vec!["predict", both[0], both[1], "--masters", "0,0,0,20,0"], "master 1"),
    ] {
        let each = path("each.json");
        let arguments: Vec<&str> =
            arguments.iter().map(|a| if *a == "EACH" { &each[..] } else { a }).collect();
        let output = outrigger(&arguments);
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success() && error.contains(words), "{arguments:?}: {error}");
    }
}
