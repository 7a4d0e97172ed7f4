//! `predict --ideal` and `optimize --scene` as a user meets them.

use crate::optimize::command::{json, outrigger};
use crate::support::shared;

fn house() -> [String; 4] {
    let path = |name: &str| shared(name).to_str().unwrap().to_owned();
    let walk = path("reference/validation/house_trajectory.tum");
    ["--scene".into(), path("scenes/house.ply"), "--trajectory".into(), walk]
}

fn with_house<'a>(before: &[&'a str], house: &'a [String; 4], after: &[&'a str]) -> Vec<&'a str> {
    let house = house.iter().map(String::as_str);
    before.iter().copied().chain(house).chain(after.iter().copied()).collect()
}

/// The surface is judged elsewhere.
const QUICK: [&str; 3] = ["--no-baselines", "--sample-count", "10000"];

pub fn predict_casts_ideal_mounts() {
    let reference = super::reference();
    let entry = &reference.pairs["vlp-16"][4];
    let [x, y, z, pitch, roll] = entry.master;
    let mounts = format!("--mounts={x},{y},{z},{pitch},{roll};{},{y},{z},{},{roll}", -x, -pitch);
    let place = house();
    let flags =
        ["--ideal", "--azimuths", "512", "--scan-stride", "4", "--voxel", "0.1", "--sensors", "vlp-16"];
    let asked = [
        with_house(&["predict", "--json", "--weights", "published", &mounts], &place, &flags),
        QUICK.to_vec(),
    ]
    .concat();
    let found = json(&asked);
    assert_eq!(found["unique_voxels"], entry.fine.union);
    assert_eq!(found["overlap_voxels"], entry.fine.overlap);
    assert_eq!(found["per_sensor_voxels"], serde_json::json!(entry.fine.per_sensor));
    assert_eq!(found["coverage_sha256"], entry.fine.union_sha256.as_str());
    assert_eq!(found["rays"], entry.rays);
    let j = found["objective"].as_f64().unwrap();
    assert!((j - entry.fine.j).abs() < 1e-6, "{j} {}", entry.fine.j);
    assert!(found["reachable_voxels"].as_u64().unwrap() > entry.fine.union * 9 / 10, "{found}");
    let noisy = with_house(&["predict", &mounts, "--range-noise", "0.1"], &place, &flags);
    let output = outrigger(&noisy);
    let words = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(2) && words.contains("--range-noise"), "{words}");
    let two = with_house(&["predict", "--sensors", "vlp-16,os1-64,os1-64", &mounts], &place, &["--ideal"]);
    let output = outrigger(&two);
    let words = String::from_utf8_lossy(&output.stderr);
    assert!(words.contains("3 models") && words.contains("2 sensors"), "{words}");
}

pub fn optimize_finds_a_pair_in_the_house() {
    let folder = tempfile::tempdir().unwrap();
    let mount = folder.path().join("mount.json").to_str().unwrap().to_owned();
    let place = house();
    let flags = [
        "--sensors",
        "vlp-16,vlp-16",
        "--ideal",
        "--azimuths",
        "512",
        "--scan-stride",
        "4",
        "--weights",
        "published",
        "--evals",
        "300",
        "--json",
        "-o",
        &mount,
    ];
    let found = json(&with_house(&["optimize"], &place, &flags));
    let j = found["best"]["objective"].as_f64().unwrap();
    // of 1,000 evaluations a release build loses 0.1 % at most; of 300 somewhat more
    assert!(j > 62_181.8 * 0.995, "{j}");
    assert_eq!(found["best"]["sensors"].as_array().unwrap().len(), 2);
    assert!(found["best"]["unique_voxels"].as_u64() > found["level"]["unique_voxels"].as_u64());
    assert!(found["model"]["model_error"]["sd"].as_f64().unwrap() < 400.0, "{}", found["model"]);
    let history = found["history"].as_array().unwrap();
    assert_eq!(history[history.len() - 1][1], found["best"]["objective"]);

    // the mount file says the same, beam by beam
    let predicted = json(&with_house(
        &["predict", "--json", "--mount", &mount],
        &place,
        &[&["--ideal", "--azimuths", "512", "--scan-stride", "4", "--weights", "published"][..], &QUICK]
            .concat(),
    ));
    let [found, predicted] = [&found["best"], &predicted].map(|best| best["unique_voxels"].as_i64().unwrap());
    assert!((found - predicted).abs() <= 8, "{found} {predicted}");
}

const ROOM: &str = "--room=-6,-4,0,6,4,3";

pub fn optimize_searches_a_room() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (mount, walk) = (path("mount.json"), path("walk.tum"));
    let asked = |threads: &str| {
        let output = std::process::Command::new(env!("CARGO_BIN_EXE_outrigger"))
            .args(["optimize", ROOM, "--trajectory", "-3,0 3,0 3,2", "--sensors", "vlp-16,os1-16", "--json"])
            .args([
                "--azimuths",
                "180",
                "--voxel",
                "0.5",
                "--evals",
                "120",
                "--roll",
                "free",
                "--scan-stride",
                "3",
            ])
            .args(["-o", &mount, "--trajectory-out", &walk])
            .env("RAYON_NUM_THREADS", threads)
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let mut document: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        document["wall_s"] = 0.into();
        document
    };
    let found = asked("1");
    assert_eq!(found, asked("3"), "the same on any number of threads");
    let sensors = found["best"]["sensors"].as_array().unwrap();
    let models: Vec<_> = sensors.iter().map(|sensor| sensor["model"].as_str().unwrap()).collect();
    assert_eq!(models, ["vlp-16", "os1-16"], "unlike sensors are no mirrored pair");
    assert_eq!(found["best"]["masters"].as_array().unwrap().len(), 2);
    let share = found["best"]["observable_share"].as_f64().unwrap();
    assert!((0.9..=1.0).contains(&share), "{share}");
    let text = std::fs::read_to_string(&walk).unwrap();
    assert!(text.lines().nth(1).unwrap().starts_with("0.000000000 -3 0 1.6 "), "{text}");
    let again =
        json(&["predict", "--json", "--mount", &mount, ROOM, "--trajectory", &walk, "--voxel", "0.5"]);
    assert!(again["unique_voxels"].as_u64().unwrap() > 0);
}

pub fn refuses() {
    let waypoints = ["--trajectory", "-3,0 3,0"];
    let sensors = ["--sensors", "vlp-16,vlp-16"];
    for (typed, words) in [
        (&[ROOM, "--trajectory", "-3,0 3,0"][..], "--sensors"),
        (&[ROOM, sensors[0], "vlp-17", waypoints[0], waypoints[1]], "vlp-17"),
        (&["--room=-6,-4,0,6,4,1.5", sensors[0], sensors[1]], "--trajectory"),
        (&[ROOM, sensors[0], sensors[1], "--trajectory", "0,0"], "1 waypoints"),
        (&[ROOM, sensors[0], sensors[1], "--trajectory", "0,0 1,2,3,4"], "4 numbers"),
        (&[ROOM, sensors[0], sensors[1], "--trajectory", "0,0 20,0"], "waypoint 2 (20, 0)"),
        (&[ROOM, sensors[0], sensors[1], "--trajectory", "nowhere.tum"], "nowhere.tum"),
        (&[ROOM, sensors[0], sensors[1], "--trajectory", "0,0,1 1e7,0,1"], "20000 m at most"),
        (&[ROOM, sensors[0], sensors[1], waypoints[0], waypoints[1], "--voxel", "0.005"], "--voxel"),
        (&[ROOM, sensors[0], sensors[1], waypoints[0], waypoints[1], "--robust", "expected"], "--robust"),
        (&["--preset", "paper-os1-64", sensors[0], sensors[1]], "--sensors"),
        (&[ROOM, sensors[0], sensors[1], waypoints[0], waypoints[1], "--space=0,0.01,0,0,0,0"], "none of"),
    ] {
        let output = outrigger(&[&["optimize", "--evals", "20", "--azimuths", "90"], typed].concat());
        let messages = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && messages.contains(words), "{typed:?}: {messages}");
        assert!(!messages.contains("panicked"), "{messages}");
    }
}
