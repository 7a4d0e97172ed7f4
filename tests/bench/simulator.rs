//! The published evaluation: the fast way and the way for any poses beside the definition, and numpy doing the
//! definition's work.
//!
//! `cargo bench --bench simulator` prints medians of processor time on one thread and their ratios, all from one run,
//! so that the machine's mood cancels. numpy is asked through the interpreter that `PYTHON` names (`python3`
//! otherwise); without it its column says none.

mod support;

use std::hint::black_box;
use std::time::Instant;

use outrigger::base::instructions::Instructions;
use outrigger::rig::{MountDeg, Path};
use outrigger::simulate::published::{Experiment, Preset, PublishedBox};
use support::{median, median_cpu_s};

fn main() {
    println!("one evaluation, processor time on one thread, medians in ms; ratios to the fast way");
    println!("{:22}{:>9}{:>17}{:>18}{:>16}", "", "fast", "any poses", "definition", "numpy");
    for (name, preset, path, master) in [
        ("OS1-64 pair, lateral", "paper-os1-64", Path::Lateral, [0.0604, 0.21, -0.08, 32.7, 0.0]),
        ("OS1-64 pair, forward", "paper-os1-64", Path::Forward, [0.0604, 0.21, -0.08, 32.7, 0.0]),
        ("VLP-16 pair, lateral", "paper-vlp-16", Path::Lateral, [0.0722, 0.17, -0.05, 37.55, 0.0]),
        ("VLP-16 pair, forward", "paper-vlp-16", Path::Forward, [0.0722, 0.17, -0.05, 37.55, 0.0]),
    ] {
        let preset = Preset::named(preset).expect("a preset of this program");
        let experiment = Experiment { path, ..Experiment::published(preset) };
        let simulator = PublishedBox::new(&experiment).expect("the published experiment");
        let sensors = experiment.sensors(&[MountDeg::from(master)]);
        let walks = simulator.walks(&sensors);
        let definition = simulator.coverage_by_definition(&sensors).expect("a mount inside the box");
        let counts = definition.coverage.counts();
        assert_eq!(simulator.count(&sensors).as_ref(), Ok(&counts), "the fast way counts the same");
        assert_eq!(simulator.cover_along(&walks).as_ref(), Ok(&definition), "pose by pose the same is seen");
        let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("one thread");
        let [fast_ms, any_ms, definition_ms] = alone.install(|| {
            [
                1e3 * median_cpu_s(401, || drop(black_box(simulator.count(black_box(&sensors))))),
                1e3 * median_cpu_s(51, || drop(black_box(simulator.cover_along(black_box(&walks))))),
                1e3 * median_cpu_s(5, || {
                    drop(black_box(simulator.coverage_by_definition(black_box(&sensors))));
                }),
            ]
        });
        let numpy = match numpy_ms(preset, path, &sensors, counts.union) {
            Some(ms) => format!("{ms:8.1} ({:5.0})", ms / fast_ms),
            None => "none".into(),
        };
        println!(
            "{name:22}{fast_ms:9.4}{any_ms:9.3} ({:5.1}){definition_ms:9.2} ({:6.0}){numpy:>16}",
            any_ms / fast_ms,
            definition_ms / fast_ms
        );
        if name.starts_with("OS1-64 pair, lateral") {
            alone.install(|| instruction_sets(&simulator, &sensors));
            threads(&simulator, &sensors);
        }
    }
}

fn instruction_sets(simulator: &PublishedBox, sensors: &[MountDeg]) {
    let walks = simulator.walks(sensors);
    for instructions in Instructions::available() {
        let fast_ms = 1e3
            * median_cpu_s(201, || drop(black_box(simulator.count_with(black_box(sensors), instructions))));
        let any_ms = 1e3
            * median_cpu_s(21, || {
                drop(black_box(simulator.cover_along_with(black_box(&walks), instructions)))
            });
        println!("  with {instructions:?}: fast {fast_ms:.4}, any poses {any_ms:.3}");
    }
}

/// Time on the wall, because that is what a second thread is for: one thread and two in turn.
fn threads(simulator: &PublishedBox, sensors: &[MountDeg]) {
    let pools =
        [1, 2].map(|threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads"));
    let walks = simulator.walks(sensors);
    let compare = |name: &str, call: &(dyn Fn() + Sync)| {
        let mut times_ms = [Vec::new(), Vec::new()];
        for _ in 0..401 {
            for (pool, times_ms) in pools.iter().zip(&mut times_ms) {
                pool.install(|| {
                    let start = Instant::now();
                    call();
                    times_ms.push(1e3 * start.elapsed().as_secs_f64());
                });
            }
        }
        let [one_ms, two_ms] = times_ms.map(median);
        println!(
            "  on the wall, {name}: one thread {one_ms:.4}, two {two_ms:.4}, ratio {:.2}",
            one_ms / two_ms
        );
    };
    compare("fast", &|| drop(black_box(simulator.count(black_box(sensors)))));
    compare("any poses", &|| drop(black_box(simulator.cover_along(black_box(&walks)))));
}

/// Median of the same evaluation in vectorised numpy, which must see as many voxels.
fn numpy_ms(preset: &Preset, path: Path, sensors: &[MountDeg], union: u64) -> Option<f64> {
    let mounts: Vec<_> = sensors.iter().map(|sensor| <[f64; 5]>::from(*sensor)).collect();
    let axis = if path == Path::Lateral { "0" } else { "1" };
    let mounts = serde_json::to_string(&mounts).expect("finite numbers");
    let arguments = [preset.beams.to_string(), preset.field_of_view_deg.to_string(), axis.into(), mounts];
    let text = support::python("simulator_numpy.py", &arguments)?;
    let mut numbers = text.split_whitespace();
    let seen: u64 = numbers.next()?.parse().ok()?;
    let difference = seen.abs_diff(union);
    assert!(difference <= 5, "numpy sees {seen} voxels, this program {union}");
    numbers.next()?.parse().ok()
}
