//! How long one published evaluation takes: the fast way, the definition, and numpy doing the definition's work.
//!
//! `cargo bench --bench simulator` prints medians and ratios, all from one run, so that the machine's mood cancels.
//! numpy is asked through the interpreter that `PYTHON` names (`python3` otherwise); without it that line says so.

use std::hint::black_box;
use std::time::Instant;

use outrigger::simulate::published::{Experiment, Path, Placement, Preset, Simulator};

fn main() {
    println!("one evaluation on one thread, medians in ms");
    println!("{:34}{:>9}{:>12}{:>12}{:>12}{:>8}", "", "fast", "definition", "numpy", "definition", "numpy");
    println!("{:34}{:>9}{:>12}{:>12}{:>12}{:>8}", "", "", "", "", "/ fast", "/ fast");
    for (name, preset, path, master) in [
        ("OS1-64 pair, lateral", "paper-os1-64", Path::Lateral, [0.0604, 0.21, -0.08, 32.7, 0.0]),
        ("OS1-64 pair, forward", "paper-os1-64", Path::Forward, [0.0604, 0.21, -0.08, 32.7, 0.0]),
        ("VLP-16 pair, lateral", "paper-vlp-16", Path::Lateral, [0.0722, 0.17, -0.05, 37.55, 0.0]),
        ("VLP-16 pair, forward", "paper-vlp-16", Path::Forward, [0.0722, 0.17, -0.05, 37.55, 0.0]),
    ] {
        let preset = Preset::named(preset).expect("a preset of this program");
        let experiment = Experiment { path, ..Experiment::published(preset) };
        let simulator = Simulator::new(&experiment).expect("the published experiment");
        let sensors = experiment.sensors(&[Placement::from(master)]);
        let fast = simulator.count(&sensors).expect("a mount inside the box");
        let definition = simulator.coverage_by_definition(&sensors).expect("a mount inside the box");
        assert_eq!(fast, definition.coverage.counts(), "both ways count the same");
        let fast_ms = median_ms(401, || drop(black_box(simulator.count(black_box(&sensors)))));
        let definition_ms =
            median_ms(5, || drop(black_box(simulator.coverage_by_definition(black_box(&sensors)))));
        let numpy = numpy_ms(preset, path, &sensors, fast.union);
        let numpy_column = numpy.map_or("none".to_owned(), |ms| format!("{ms:.1}"));
        let numpy_ratio = numpy.map_or("none".to_owned(), |ms| format!("{:.0}", ms / fast_ms));
        println!(
            "{name:34}{fast_ms:9.4}{definition_ms:12.2}{numpy_column:>12}{:12.0}{numpy_ratio:>8}",
            definition_ms / fast_ms
        );
    }
}

fn median_ms(repetitions: usize, mut call: impl FnMut()) -> f64 {
    let mut times_ms: Vec<_> = (0..repetitions)
        .map(|_| {
            let start = Instant::now();
            call();
            start.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    times_ms.sort_by(f64::total_cmp);
    times_ms[repetitions / 2]
}

/// Median of the same evaluation in vectorised numpy, which must see as many voxels.
fn numpy_ms(preset: &Preset, path: Path, sensors: &[Placement], union: u64) -> Option<f64> {
    let python = std::env::var("PYTHON").unwrap_or("python3".into());
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/bench/simulator_numpy.py");
    let mounts: Vec<_> = sensors.iter().map(|sensor| <[f64; 5]>::from(*sensor)).collect();
    let output = std::process::Command::new(python)
        .args([script, &preset.beams.to_string(), &preset.field_of_view_deg.to_string()])
        .arg(if path == Path::Lateral { "0" } else { "1" })
        .arg(serde_json::to_string(&mounts).expect("finite numbers"))
        .env("OMP_NUM_THREADS", "1")
        .output()
        .ok()?;
    if !output.status.success() {
        eprintln!("numpy: {}", String::from_utf8_lossy(&output.stderr).lines().last().unwrap_or_default());
        return None;
    }
    let text = String::from_utf8_lossy(&output.stdout);
    let mut numbers = text.split_whitespace();
    let seen: u64 = numbers.next()?.parse().ok()?;
    let difference = seen.abs_diff(union);
    assert!(difference <= 5, "numpy sees {seen} voxels, this program {union}");
    numbers.next()?.parse().ok()
}
