//! `predict --ideal` and `optimize --scene` as a user meets them.

use crate::optimize::command::{json, outrigger};
use crate::support::shared;
use outrigger::base::rng::Rng;

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
const QUICK: [&str; 2] = ["--sample-count", "10000"];

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

pub fn a_prediction_is_scored() {
    let mounts = "--mounts=0.08,0,0.1,30,0;-0.08,0,0.1,-30,0";
    let place = ["--room=0,0,0,6,4,3", "--trajectory", "2,2,1.5 4,2,1.5", "--azimuths", "180"];
    let predict = |more: &[&str]| {
        json(&[&["predict", "--json", "--sensors", "vlp-16", mounts][..], &place, more].concat())
    };
    for (scored, more) in [
        (predict(&[]), &[][..]),
        (predict(&["--weights", "published"]), &["--weights", "published"]),
        (predict(&["--ideal"]), &[]),
    ] {
        let number = |value: &serde_json::Value| value.as_f64().unwrap();
        let voxels = |value: &serde_json::Value| value.as_array().unwrap().iter().map(number).sum::<f64>();
        let (union, overlap) = (number(&scored["unique_voxels"]), number(&scored["overlap_voxels"]));
        assert_eq!(voxels(&scored["per_sensor_voxels"]), union + overlap, "{scored}");
        assert_eq!(voxels(&scored["unique_per_sensor"]), union - overlap);
        assert!((number(&scored["overlap_ratio"]) - overlap / union).abs() < 1e-12);
        assert!((number(&scored["min_angle_deg"]) - 60.0).abs() < 1e-9);
        let terms = &scored["terms"];
        assert_eq!(number(&terms["coverage"]), union);
        let scale = match more.is_empty() {
            true => number(&scored["reachable_voxels"]) / 35_048.0,
            false => 1.0,
        };
        assert!((number(&terms["cost"]) + 4000.0 * scale).abs() < 1e-6, "{terms}");
        assert!((number(&terms["angular"]) - 100.0 * scale).abs() < 1e-6, "{terms}");
        let sum = terms.as_object().unwrap().values().map(number).sum::<f64>();
        assert!((number(&scored["objective"]) - sum).abs() < 1e-6, "{scored}");
    }
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
    // a less tilted mount may be the best where the beams cannot tell
    let best_found = history[history.len() - 1][1].as_f64().unwrap();
    assert!((0.0..=60.0).contains(&(best_found - j)), "{best_found} {j}");

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
        let mut document: serde_json::Value = crate::support::document(&output.stdout).unwrap();
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

/// Of few columns, which miss some voxels: the page lists as many as the figure leaves.
fn assert_blind_spots_are_what_is_missed(page: &str) {
    let few = ["--sensors", "vlp-16,vlp-16", "--azimuths", "20", "--scan-stride", "5", "--report", page];
    let found = in_room(&few);
    let voxels = |what: &serde_json::Value| what.as_u64().unwrap();
    let missed = voxels(&found["reachable_voxels"]) - voxels(&found["best"]["unique_voxels"]);
    let html = std::fs::read_to_string(page).unwrap();
    let number = |text: &str| text.rsplit('>').next()?.split(" voxel").next()?.parse::<u64>().ok();
    let listed: Vec<u64> = html.split(" around (").filter_map(number).collect();
    assert!(listed.len() < 10 && missed > 0 && listed.iter().sum::<u64>() == missed, "{listed:?} {missed}");
    assert_speed_stands_against_accuracy(&html);
}

/// Every count errs less than one of fewer voxels, or fewer revolutions.
fn assert_speed_stands_against_accuracy(html: &str) {
    let table = html.split("Speed against accuracy").nth(1).expect("the heading");
    let error = |name: &str| -> f64 {
        let row = table.split(&format!(">{name}</td>")).nth(1).unwrap_or_else(|| panic!("{name}: {table}"));
        let cells: Vec<&str> =
            row.split("</td>").take(2).map(|cell| cell.rsplit('>').next().unwrap()).collect();
        assert!(cells[0].parse::<f64>().is_ok_and(|ms| ms >= 0.0), "{name}: {cells:?}");
        cells[1].replace(',', "").parse().unwrap()
    };
    assert!(error("model, every voxel") <= error("model, one voxel in 16"));
    assert!(error("one revolution in 4") <= error("one revolution in 16"));
    assert!(error("beams of the search") >= 0.0);
}

/// A search in the room, as JSON.
fn in_room(flags: &[&str]) -> serde_json::Value {
    let place =
        ["optimize", ROOM, "--trajectory", "-3,0 3,0 3,2", "--voxel", "0.5", "--evals", "60", "--json"];
    json(&[&place[..], flags].concat())
}

pub fn searches_with_any_sensor() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let seen = |sensors: &str| {
        let found = in_room(&["--sensors", sensors, "--azimuths", "300", "--scan-stride", "3"]);
        found["best"]["observable_share"].as_f64().unwrap()
    };
    // a dome sees its own half of the room, a Mid-360 a band of 59 degrees from 7 below the level up
    for (sensors, least) in [
        ("hesai-xt32,hesai-xt32", 0.9),
        ("robosense-bpearl,vlp-16", 0.9),
        ("osdome-64", 0.7),
        ("livox-mid-360", 0.5),
    ] {
        let share = seen(sensors);
        assert!((least..=1.0).contains(&share), "{sensors}: {share}");
    }
    // a narrow forward cone sees less of a room than a ring of beams
    let (cone, ring) = (seen("livox-mid-40"), seen("vlp-16"));
    assert!(cone > 0.05 && cone < 0.8 * ring, "{cone} {ring}");

    // a table of the VLP-16's own beams is a VLP-16, and its mount file leads back to it
    let table = path("mine.csv");
    let elevations = (0..16).map(|row| format!("{}\n", -15 + 2 * row)).collect::<String>();
    std::fs::write(&table, format!("elevation_deg\n{elevations}")).unwrap();
    let mount = path("mount.json");
    let flags = ["--ideal", "--azimuths", "300", "--scan-stride", "3", "--sensors"];
    let own = in_room(&[&flags[..], &[&format!("vlp-16:{table}"), "-o", &mount]].concat());
    let known = in_room(&[&flags[..], &["vlp-16"]].concat());
    assert_eq!(own["best"], known["best"]);
    let text = std::fs::read_to_string(&mount).unwrap();
    assert!(text.contains("mine.csv"), "{text}");
    let again = json(&[
        "predict",
        "--json",
        "--mount",
        &mount,
        ROOM,
        "--trajectory",
        "-3,0 3,0 3,2",
        "--voxel",
        "0.5",
        "--ideal",
    ]);
    assert!(again["unique_voxels"].as_u64() >= own["best"]["unique_voxels"].as_u64());
    std::fs::write(&table, "elevation_deg\n1\nhigh\n").unwrap();
    let output = outrigger(&["optimize", ROOM, "--sensors", &table, "--trajectory", "-3,0 3,0"]);
    let words = String::from_utf8_lossy(&output.stderr);
    assert!(
        output.status.code() == Some(2) && words.contains("line 3") && words.contains("mine.csv"),
        "{words}"
    );
}

pub fn compares_numbers_of_sensors() {
    let found =
        in_room(&["--sensors", "vlp-16", "--count", "1..2", "--azimuths", "120", "--scan-stride", "5"]);
    let by_count = found["by_count"].as_array().unwrap();
    assert_eq!((by_count[0]["sensors"].as_u64(), by_count[1]["sensors"].as_u64()), (Some(1), Some(2)));
    assert!(by_count[1]["unique_voxels"].as_u64() >= by_count[0]["unique_voxels"].as_u64(), "{by_count:?}");
    let of_best = found["best"]["sensors"].as_array().unwrap().len() as u64;
    let best = by_count.iter().find(|found| found["sensors"] == of_best).unwrap();
    let others = by_count.iter().map(|found| found["objective"].as_f64().unwrap());
    assert_eq!(best["objective"].as_f64().unwrap(), others.fold(f64::NEG_INFINITY, f64::max));
}

pub fn operators_and_housings_shade() {
    let flags = ["--sensors", "vlp-16,vlp-16", "--azimuths", "120", "--scan-stride", "5"];
    let j = |more: &[&str]| {
        let level = in_room(&[&flags[..], more].concat());
        level["level"]["per_sensor_voxels"][0].as_u64().unwrap()
    };
    let (ideal, housed) = (j(&["--ideal", "--space=0.2,0.2,0,0,0,0"]), j(&["--space=0.2,0.2,0,0,0,0"]));
    let behind = j(&["--space=0.2,0.2,0,0,0,0", "--operator=-0.4,0,-1,-0.4,0,0.4,0.3"]);
    assert!(ideal > 0 && behind < housed, "{ideal} {housed} {behind}");
}

/// Where everything is seen whatever the tilt, nothing is tilted.
pub fn prefers_the_level_mount() {
    let flags = ["--sensors", "os1-64", "--azimuths", "200", "--scan-stride", "10", "--voxel", "2.5"];
    let place = [
        "optimize",
        "--room=-5,-5,0,5,5,3",
        "--trajectory",
        "-4,-4 4,-4 4,4 -4,4",
        "--evals",
        "40",
        "--json",
    ];
    let found = json(&[&place[..], &flags].concat());
    assert_eq!(found["best"]["observable_share"], 1.0);
    assert_eq!(found["best"]["sensors"][0]["pitch_deg"], 0.0, "{}", found["best"]);
    assert_eq!(found["tolerance"]["worst_loss_share"], 0.0);
}

pub fn goes_on_from_a_state_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (state, page, csv) = (path("state.json"), path("page.html"), path("history.csv"));
    let flags = ["--sensors", "vlp-16,vlp-16", "--azimuths", "120", "--scan-stride", "5"];
    let files = ["--resume", &state, "--report", &page, "--csv", &csv];
    let first = in_room(&[&flags[..], &files].concat());
    let html = std::fs::read_to_string(&page).unwrap();
    assert!(html.contains("of what can be seen") && html.contains("Who sees what"), "{}", html.len());
    assert_blind_spots_are_what_is_missed(&path("few.html"));
    let lines = std::fs::read_to_string(&csv).unwrap();
    assert_eq!(lines.lines().count() - 1, first["history"].as_array().unwrap().len());
    // what was found before is not looked at again, and half of it leads to the same
    let text = std::fs::read_to_string(&state).unwrap();
    let mut kept: serde_json::Value = serde_json::from_str(&text).unwrap();
    let scores = kept["findings"]["scores"].as_array_mut().unwrap();
    assert!(scores.len() >= 40, "{}", scores.len());
    scores.truncate(32);
    kept["findings"]["exact"] = serde_json::json!([]);
    std::fs::write(&state, kept.to_string()).unwrap();
    let again = in_room(&[&flags[..], &["--resume", &state]].concat());
    assert_eq!((&again["best"], &again["history"]), (&first["best"], &first["history"]));
    let other =
        [&["optimize", ROOM, "--trajectory", "-3,0 3,0", "--resume", &state, "--evals", "60"][..], &flags];
    let output = outrigger(&other.concat());
    let words = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(2) && words.contains("trajectory"), "{words}");
}

pub fn thins_the_beams_of_dear_rigs() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (state, mount) = (path("state.json"), path("mount.json"));
    let place = [ROOM, "--trajectory", "-2,0 2,0", "--ideal", "--json"];
    let searched = ["--sensors", "os0-128,os0-128", "--evals", "40", "--resume", &state, "-o", &mount];
    let found = json(&[&["optimize"][..], &place, &searched].concat());
    let plan = &found["plan"];
    assert_eq!((&plan["thinning"], &plan["whole"]), (&2.into(), &3.into()), "{plan}");
    // the count of the best mount is that of all its beams
    let predicted = json(&[&["predict", "--mount", &mount][..], &place].concat());
    let [best, predicted] = [&found["best"], &predicted].map(|seen| seen["unique_voxels"].as_i64().unwrap());
    assert!((best - predicted).abs() <= 8, "{best} {predicted}");
    let again = json(&[&["optimize"][..], &place, &searched[..6]].concat());
    assert_eq!(again["best"], found["best"]);
}

pub fn errors_of_building_are_reckoned_with() {
    let flags = [
        ROOM,
        "--sensors",
        "vlp-16,vlp-16",
        "--trajectory",
        "-3,0 3,0",
        "--azimuths",
        "90",
        "--weights",
        "published",
    ];
    let search = |more: &[&str]| json(&[&["optimize", "--json", "--evals", "60"][..], &flags, more].concat());
    let planned = search(&[]);
    assert!(planned.get("as_built").is_none() && planned["tolerance"]["draws"] == 16);
    let number = |found: &serde_json::Value, name: &str| found["as_built"][name].as_f64().unwrap();

    // no error, no difference
    let exact = search(&["--robust", "worst", "--draws", "2", "--tolerance", "0,0"]);
    assert_eq!(exact["best"], planned["best"]);
    assert_eq!((number(&exact, "deviation"), number(&exact, "draws")), (0.0, 2.0));
    assert_eq!(exact["as_built"]["worst"], planned["best"]["objective"]);
    assert_eq!(exact["tolerance"]["worst_loss_share"], 0.0);
    let spun = search(&["--robust", "expected", "--draws", "2", "--tolerance", "0,0", "--free-spin"]);
    assert_eq!(spun["best"], planned["best"]);
    assert!(number(&spun, "deviation") > 0.0, "{spun}");

    // one draw is the rig that is off by the first random numbers, as `predict` sees it
    let off = search(&["--robust", "worst", "--draws", "1", "--tolerance", "0.02,2"]);
    assert_eq!(off["as_built"]["worst"], off["as_built"]["mean"]);
    let sensors = off["best"]["sensors"].as_array().unwrap();
    let built = sensors.iter().enumerate().map(|(at, sensor)| {
        let mut rng = Rng::new(1, at as u64);
        let names = [("x_m", 0.02), ("y_m", 0.02), ("z_m", 0.02), ("pitch_deg", 2.0), ("roll_deg", 2.0)];
        let off = names.map(|(name, most)| sensor[name].as_f64().unwrap() + rng.between(-most, most));
        off.map(|value| value.to_string()).join(",")
    });
    let mounts = format!("--mounts={}", built.collect::<Vec<_>>().join(";"));
    let predicted = json(&[&["predict", "--json", &mounts][..], &flags].concat());
    let [expected, found] = [predicted["objective"].as_f64().unwrap(), number(&off, "mean")];
    assert!((expected - found).abs() <= 4.0, "{expected} {found}");
    assert!((expected - off["best"]["objective"].as_f64().unwrap()).abs() > 10.0, "{off}");
}

pub fn registration_counts() {
    let flags = [ROOM, "--trajectory", "-3,0 3,0", "--azimuths", "180", "--voxel", "0.2"];
    let folder = tempfile::tempdir().unwrap();
    let mount = folder.path().join("mount.json").to_str().unwrap().to_owned();
    let searched = ["--json", "--evals", "100", "--sensors", "vlp-16", "--weights", "published"];
    let search = |more: &[&str]| json(&[&["optimize"][..], &searched, &flags, more].concat());
    let p5 = |found: &serde_json::Value| found["registration"]["translation_p5"].as_f64().unwrap();
    let as_predicted = || p5(&json(&[&["predict", "--json", "--mount", &mount][..], &flags].concat()));
    let plain = search(&["-o", &mount]);
    assert!(plain["best"].get("registration").is_none(), "{plain}");
    let before = as_predicted();
    let weighted = search(&["--registration-weight", "20000", "-o", &mount]);
    let (best, after) = (&weighted["best"], as_predicted());
    let term = best["terms"]["registration"].as_f64().unwrap();
    assert!((term - 20_000.0 * (p5(best) / 0.003).log10()).abs() < 1e-6, "{best}");
    // level, a single sensor sees most, and nothing of floor and ceiling that tells its height
    assert!(before < 0.02 && after > 0.2, "{before} {after}");
    assert!((p5(best) / after - 1.0).abs() < 0.15, "{} {after}", p5(best));
    assert!(p5(&weighted["level"]) < 0.02, "{weighted}");
    let least = 0.9 * p5(best);
    let constrained = search(&["--min-conditioning", &least.to_string()]);
    assert!(p5(&constrained["best"]) >= least, "{constrained}");
    assert_eq!(constrained["best"]["terms"]["registration"], 0.0);
    let refused =
        outrigger(&[&["optimize", "--min-conditioning", "0.32"][..], &searched[1..], &flags].concat());
    let words = String::from_utf8_lossy(&refused.stderr);
    assert!(refused.status.code() == Some(1) && words.contains("--min-conditioning"), "{words}");
}

pub fn refuses() {
    let waypoints = ["--trajectory", "-3,0 3,0"];
    let sensors = ["--sensors", "vlp-16,vlp-16"];
    for (typed, words) in [
        (&[ROOM, "--trajectory", "-3,0 3,0"][..], "--sensors"),
        (&[ROOM, sensors[0], "vlp-17", waypoints[0], waypoints[1]], "vlp-17"),
        (&[ROOM, sensors[0], "left=vlp-16", waypoints[0], waypoints[1]], "left"),
        (&[ROOM, sensors[0], sensors[1], waypoints[0], waypoints[1], "--count", "4..1"], "4..1"),
        (&["--room=-6,-4,0,6,4,1.5", sensors[0], sensors[1]], "--trajectory"),
        (&[ROOM, sensors[0], sensors[1], "--trajectory", "0,0"], "1 waypoints"),
        (&[ROOM, sensors[0], sensors[1], "--trajectory", "0,0 1,2,3,4"], "4 numbers"),
        (&[ROOM, sensors[0], sensors[1], "--trajectory", "0,0 20,0"], "waypoint 2 (20, 0)"),
        (&[ROOM, sensors[0], sensors[1], "--trajectory", "nowhere.tum"], "nowhere.tum"),
        (&[ROOM, sensors[0], sensors[1], "--trajectory", "0,0,1 1e7,0,1"], "20000 m at most"),
        (&[ROOM, sensors[0], sensors[1], waypoints[0], waypoints[1], "--voxel", "0.005"], "--voxel"),
        (&[ROOM, sensors[0], sensors[1], waypoints[0], waypoints[1], "--tolerance", "-1,0"], "tolerance -1"),
        (&[ROOM, sensors[0], sensors[1], waypoints[0], waypoints[1], "--draws", "4"], "--robust"),
        (&["--preset", "paper-os1-64", sensors[0], sensors[1]], "--sensors"),
        (&[ROOM, sensors[0], sensors[1], waypoints[0], waypoints[1], "--space=0,0.01,0,0,0,0"], "none of"),
    ] {
        let output = outrigger(&[&["optimize", "--evals", "20", "--azimuths", "90"], typed].concat());
        let messages = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && messages.contains(words), "{typed:?}: {messages}");
        assert!(!messages.contains("panicked"), "{messages}");
    }
}
