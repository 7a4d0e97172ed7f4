//! The search in the furnished house: what it costs and what it loses against the best mounts known there.
//!
//! `cargo bench --bench search` runs `optimize` with five seeds for a pair of OS1-64 and of VLP-16 at an eighth of all beams
//! (`SEEDS`, `EVALS` change that) and prints J, its loss, wall time and processor time, and how many rays the search saved against
//! casting every mount. The house lies in the folder that `OUTRIGGER_SHARED` names (default `../shared`).

mod support;

use std::path::PathBuf;
use std::process::Command;

use serde_json::Value;
use support::environment;

fn main() {
    let shared = PathBuf::from(std::env::var_os("OUTRIGGER_SHARED").unwrap_or("../shared".into()));
    let reference = shared.join("reference/scene_search/house.json");
    let Ok(text) = std::fs::read_to_string(&reference) else {
        println!("LEFT OUT: the house (no {})", reference.display());
        return;
    };
    let reference: Value = serde_json::from_str(&text).expect("a JSON document");
    let (seeds, evaluations) = (environment("SEEDS", 5.0) as u64, environment("EVALS", 1000.0) as u64);
    println!("{} threads", std::thread::available_parallelism().map_or(1, usize::from));
    println!("sensors   seed         J   loss %   wall s    cpu s  rays of all mounts / rays cast");
    for sensor in ["os1-64", "vlp-16"] {
        let known = reference["best_known"][sensor].as_array().expect("a list").iter();
        let best_known =
            known.filter_map(|entry| entry["0.1"]["j"].as_f64()).fold(f64::NEG_INFINITY, f64::max);
        let rays_of_one = reference["pairs"][sensor][0]["rays"].as_f64().expect("a number");
        for seed in 1..=seeds {
            let before_s = children_cpu_s();
            let output = Command::new(env!("CARGO_BIN_EXE_outrigger"))
                .args([
                    "optimize",
                    "--json",
                    "--ideal",
                    "--azimuths",
                    "512",
                    "--scan-stride",
                    "4",
                    "--voxel",
                    "0.1",
                ])
                .args(["--weights", "published", "--sensors", &format!("{sensor},{sensor}")])
                .args(["--seed", &seed.to_string(), "--evals", &evaluations.to_string(), "--scene"])
                .arg(shared.join("scenes/house.ply"))
                .arg("--trajectory")
                .arg(shared.join("reference/validation/house_trajectory.tum"))
                .output()
                .expect("the program runs");
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
            let found: Value = serde_json::from_slice(&output.stdout).expect("a JSON document");
            let number = |value: &Value| value.as_f64().expect("a number");
            let j = number(&found["best"]["objective"]);
            println!(
                "{sensor:10}{seed:4}{j:10.1}{:9.3}{:9.2}{:9.2}{:10.1}",
                100.0 * (best_known - j) / best_known,
                number(&found["wall_s"]),
                children_cpu_s() - before_s,
                evaluations as f64 * rays_of_one / number(&found["rays"])
            );
        }
    }
}

/// Processor time of all children that ended, s (proc_pid_stat(5)).
fn children_cpu_s() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").expect("every Linux has it");
    let after_name = stat.rsplit_once(')').map_or("", |(_, rest)| rest);
    let ticks: f64 =
        after_name.split_whitespace().skip(13).take(2).filter_map(|ticks| ticks.parse::<f64>().ok()).sum();
    ticks / 100.0
}
