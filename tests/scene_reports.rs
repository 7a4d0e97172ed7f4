//! What stands beside a score or a prediction: single sensors, registration, divergence, calibrated units, pages.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use sensors::catalogue;
use sensors::ouster::{Metadata, Profile, Synthetic};
use serde_json::{Value, json};

use crate::support::{Case, case, shared, with_shared};

pub const CASES: &[Case] = &[
    case("single_sensors_stand_beside_a_score", single_sensors_stand_beside_a_score),
    case("registration_is_a_term_and_a_constraint", registration_is_a_term_and_a_constraint),
    case("a_search_keeps_the_least_conditioning", a_search_keeps_the_least_conditioning),
    case("the_published_divergence_scores_again", the_published_divergence_scores_again),
    case("units_of_a_rig_are_as_calibrated", units_of_a_rig_are_as_calibrated),
    case("every_flaw_has_its_option", every_flaw_has_its_option),
    case("a_single_sensor_needs_no_mount", a_single_sensor_needs_no_mount),
    case("columns_from_180_to_4096", columns_from_180_to_4096),
    case("a_mesh_is_asked_for_its_unit_and_axis", a_mesh_is_asked_for_its_unit_and_axis),
    case("an_error_tells_its_cause_once", an_error_tells_its_cause_once),
    case("pages_stand_alone", pages_stand_alone),
    with_shared(
        "a_prediction_covers_the_house_as_ideal_sensors_do",
        a_prediction_covers_the_house_as_ideal_sensors_do,
    ),
];

/// A folder with a room of 6 x 4 x 3 m as a mesh, a walk of 2 m in it, and a mount file.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        let folder = Self(tempfile::tempdir().unwrap());
        folder.write("room.obj", room(1.0, false).as_bytes());
        folder.write("walk.tum", b"0 2 2 1.5 0 0 0 1\n1 3 2 1.5 0 0 0 1\n2 4 2 1.5 0 0 0 1\n");
        folder.mount(&json!({}), ["vlp-16", "vlp-16"]);
        folder
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, bytes: &[u8]) {
        std::fs::write(self.path(name), bytes).unwrap();
    }

    fn mount(&self, calibrations: &Value, [right, left]: [&str; 2]) {
        let sensor = |name: &str, model: &str, side: f64| {
            json!({ "name": name, "model": model, "x_m": 0.08 * side, "y_m": 0.0, "z_m": 0.1, "pitch_deg": 30.0 * side,
                    "roll_deg": 0.0 })
        };
        let file = json!({
            "format": "outrigger-mount/1", "frame": "mount: x right, y forward, z up",
            "sensors": [sensor("right", right, 1.0), sensor("left", left, -1.0)], "calibrations": calibrations,
        });
        self.write("mount.json", file.to_string().as_bytes());
    }

    fn run(&self, arguments: &[&str]) -> Output {
        let mut command = Command::new(env!("CARGO_BIN_EXE_outrigger"));
        command
            .current_dir(self.0.path())
            .args(arguments)
            .env_remove("OUTRIGGER_JSON")
            .env_remove("OUTRIGGER_PRESET");
        command.output().unwrap()
    }

    fn document(&self, arguments: &[&str]) -> Value {
        let output = self.run(&[&["--json"], arguments].concat());
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
        crate::support::document(&output.stdout).unwrap()
    }

    /// A prediction in the bare room, as quick as can be.
    fn predict(&self, more: &[&str]) -> Value {
        let room = ["predict", "--mount", "mount.json", "--trajectory", "walk.tum", "--room", "0,0,0,6,4,3"];
        self.document(&[&room[..], more].concat())
    }

    fn error(&self, arguments: &[&str]) -> String {
        let output = self.run(arguments);
        assert!(matches!(output.status.code(), Some(1 | 2)), "{arguments:?}");
        assert!(output.stdout.is_empty());
        String::from_utf8_lossy(&output.stderr).into_owned()
    }
}

fn room(scale: f64, is_y_up: bool) -> String {
    let mut text = String::new();
    for n in 0..8_u8 {
        let side = |axis: u8, size: f64| scale * size * f64::from(n >> axis & 1);
        let (x, y, z) = (side(0, 6.0), side(1, 4.0), side(2, 3.0));
        text += &if is_y_up { format!("v {x} {z} {}\n", -y) } else { format!("v {x} {y} {z}\n") };
    }
    for q in [[1, 2, 4, 3], [5, 6, 8, 7], [1, 2, 6, 5], [3, 4, 8, 7], [1, 3, 7, 5], [2, 4, 8, 6]] {
        text += &format!("f {} {} {} {}\n", q[0], q[1], q[2], q[3]);
    }
    text
}

const GOOD: [&str; 5] = ["predict", "--preset", "paper-vlp-16", "--masters", "0.07,0.1,0.05,35,0"];

fn single_sensors_stand_beside_a_score() {
    let folder = Folder::new();
    let compared = [&GOOD[..], &["--baselines"]].concat();
    let document = folder.document(&compared);
    let single = |pitch: &str| {
        let masters = format!("0,0.1,0.05,{pitch},0");
        folder.document(&["predict", "--preset", "paper-vlp-16", "--no-mirror", "--masters", &masters])
    };
    let baselines = &document["baselines"];
    let level = single("0");
    assert_eq!(baselines["level_single"]["objective"], level["objective"]);
    assert_eq!(baselines["level_single"]["unique_voxels"], level["unique_voxels"]);
    let best = &baselines["best_single"];
    let again = single(&best["pitch_deg"].to_string());
    assert_eq!(best["objective"], again["objective"], "a search that is exact");
    let searched = baselines["pitch_search"].as_array().unwrap();
    assert_eq!(searched.len(), 91);
    assert!(searched.iter().all(|tried| tried[1].as_f64() <= best["objective"].as_f64()));
    let gain = document["unique_voxels"].as_i64().unwrap() - best["unique_voxels"].as_i64().unwrap();
    assert_eq!(best["gain_voxels"], gain);
    let text = String::from_utf8(folder.run(&compared).stdout).unwrap();
    assert!(text.contains("level single") && text.contains("best single"), "{text}");
    assert!(folder.document(&GOOD)["baselines"].is_null());
    // many rays: from coarse to fine, and no worse than its neighbours
    let fine = folder.document(&[&compared[..], &["--azimuths", "4096", "--sub-poses", "2"]].concat());
    let best_deg = fine["baselines"]["best_single"]["pitch_deg"].as_f64().unwrap();
    let searched = fine["baselines"]["pitch_search"].as_array().unwrap();
    assert!(
        (20..40).contains(&searched.len()) && searched.is_sorted_by(|a, b| a[0].as_f64() < b[0].as_f64())
    );
    assert!(searched.iter().any(|tried| (tried[0].as_f64().unwrap() - best_deg).abs() == 1.0));
}

fn registration_is_a_term_and_a_constraint() {
    let folder = Folder::new();
    let plain = folder.document(&GOOD);
    assert_eq!(plain["terms"]["registration"], 0.0);
    let least = plain["registration"]["translation_p5"].as_f64().unwrap();
    assert_eq!(plain["registration_path"].as_array().unwrap().len(), 9);
    let weighed = folder.document(&[&GOOD[..], &["--registration-weight", "1000"]].concat());
    let term = weighed["terms"]["registration"].as_f64().unwrap();
    assert!((term - 1000.0 * (least / 0.003).log10()).abs() < 1e-9);
    let more = weighed["objective"].as_f64().unwrap() - plain["objective"].as_f64().unwrap();
    assert!((more - term).abs() < 1e-9);
    let kept = folder.document(&[&GOOD[..], &["--min-conditioning", &(0.99 * least).to_string()]].concat());
    assert_eq!((&kept["feasible"], &kept["objective"]), (&json!(true), &plain["objective"]));
    let missed = folder.document(&[&GOOD[..], &["--min-conditioning", &(1.01 * least).to_string()]].concat());
    assert_eq!(missed["feasible"], false);
    assert_eq!(missed["violations"][0]["conditioning"], least);
    for wrong in ["--min-conditioning=0.4", "--registration-weight=-1"] {
        let error = folder.error(&[&GOOD[..], &[wrong]].concat());
        assert!(wrong.split('=').all(|part| error.contains(part)), "{error}");
    }
}

fn a_search_keeps_the_least_conditioning() {
    let folder = Folder::new();
    let search = |more: &[&str]| {
        let base = [
            "optimize",
            "--preset",
            "paper-vlp-16",
            "--masters-max",
            "1",
            "--method",
            "random",
            "--evals",
            "60",
        ];
        folder.document(&[&base[..], more].concat())
    };
    let free = search(&[]);
    let conditioning = |document: &Value| {
        let master = document["best"]["masters"][0].as_array().unwrap();
        let master = master.iter().map(Value::to_string).collect::<Vec<_>>().join(",");
        let scored = folder.document(&["predict", "--preset", "paper-vlp-16", "--masters", &master]);
        scored["registration"]["translation_p5"].as_f64().unwrap()
    };
    let least = 1.1 * conditioning(&free);
    let kept = search(&["--min-conditioning", &least.to_string()]);
    assert!(conditioning(&kept) >= least, "{kept}");
    assert!(kept["best"]["objective"].as_f64() <= free["best"]["objective"].as_f64());
    let weighed = search(&["--registration-weight", "500"]);
    assert!(weighed["best"]["terms"]["registration"].as_f64().unwrap() > 0.0);
}

fn the_published_divergence_scores_again() {
    let folder = Folder::new();
    let again = |seed: &str| folder.document(&[&GOOD[..], &["--rescore", "2", "--seed", seed]].concat());
    let one = again("1");
    assert_eq!(one["rescored"]["divergence_deg"], 0.09);
    assert_eq!(one["rescored"], again("1")["rescored"]);
    assert_ne!(one["rescored"]["objectives"], again("2")["rescored"]["objectives"]);
    assert_eq!(one["objective"], folder.document(&GOOD)["objective"], "the score itself has no divergence");
    let none = folder.document(&[&GOOD[..], &["--rescore", "1", "--divergence", "0"]].concat());
    // the quirk of rays along an axis is hit less often when directions are made units again
    let off = none["rescored"]["mean"].as_f64().unwrap() - none["objective"].as_f64().unwrap();
    assert!(off.abs() < 60.0, "{off}");
}

fn units_of_a_rig_are_as_calibrated() {
    let folder = Folder::new();
    folder.mount(&json!({ "left": "units/left.json" }), ["vlp-16", "os0-32"]);
    let wanted = Synthetic::new("os0-32", 7, Profile::Rng19Rfl8Sig16Nir16).columns(512, 16);
    let metadata = Metadata::synthetic(&wanted).unwrap().to_json();
    std::fs::create_dir(folder.path("units")).unwrap();
    folder.write("units/left.json", metadata.as_bytes());
    // a unit whose lowest beam looks 3 degrees lower
    let mut yaml = "distance_resolution: 0.002\nlasers:\n".to_owned();
    for (id, beam) in catalogue::nominal("vlp-16").unwrap().beams().iter().enumerate() {
        let lower = if id == 0 { 3.0_f64.to_radians() } else { 0.0 };
        yaml += &format!(
            "- {{laser_id: {id}, vert_correction: {}, rot_correction: 0}}\n",
            beam.elevation_rad - lower
        );
    }
    folder.write("right.yaml", yaml.as_bytes());
    let mixed = folder.predict(&[]);
    assert_eq!(mixed["sensors"][0]["model"], "vlp-16");
    assert_eq!(
        (&mixed["sensors"][1]["columns"], &mixed["sensors"][1]["rays"]),
        (&json!(512), &json!(10241 * 32))
    );
    let calibrated = folder.predict(&["--sensor", "right=right.yaml"]);
    assert_ne!(mixed["coverage_sha256"], calibrated["coverage_sha256"]);
    assert_eq!(mixed["sensors"][1]["voxels"], calibrated["sensors"][1]["voxels"]);
    let nominal = folder.predict(&["--sensor", "left=os0-32"]);
    assert_eq!(nominal["sensors"][1]["columns"], 1024);
    // of ideal sensors too, and for --mounts
    let surface =
        ["predict", "--ideal", "--scene", "room.obj", "--trajectory", "walk.tum", "--sample-count", "5000"];
    let quick = ["--azimuths", "60"];
    let both = folder.document(&[&surface[..], &quick, &["--mount", "mount.json"]].concat());
    assert_eq!(both["rays"], 20 * 60 * (16 + 32));
    let typed = |sensor: &str| {
        folder.document(&[&surface[..], &quick, &["--mounts", "0,0,0,20,0", "--sensor", sensor]].concat())
    };
    assert!(typed("right.yaml")["warnings"][0].as_str().unwrap().contains("vlp-16"));
    assert_ne!(typed("vlp-16:right.yaml")["completeness"], typed("vlp-16")["completeness"]);
    for (sensor, words) in [
        ("no-such.yaml", &["no-such.yaml"][..]),
        ("os9", &["os9", "vlp-16", "MODEL:FILE"]),
        ("rear=vlp-16", &["rear", "right, left"]),
        ("right=os1-64:right.yaml", &["right.yaml", "Velodyne", "os1-64"]),
    ] {
        let place = ["predict", "--mount", "mount.json", "--trajectory", "walk.tum", "--room", "0,0,0,6,4,3"];
        let error = folder.error(&[&place[..], &["--sensor", sensor]].concat());
        assert!(words.iter().all(|word| error.contains(word)), "{error}");
    }
    folder.mount(&json!({ "rear": "units/left.json" }), ["vlp-16", "os0-32"]);
    assert!(
        folder
            .error(&["predict", "--mount", "mount.json", "--trajectory", "walk.tum", "--room", "0,0,0,6,4,3"])
            .contains("calibrations names \"rear\"")
    );
}

fn every_flaw_has_its_option() {
    let folder = Folder::new();
    let returns =
        |more: &[&str]| folder.predict(&[&["--azimuths", "180"], more].concat())["returns"].as_u64().unwrap();
    let all = returns(&[]);
    for more in [
        &["--min-range", "2"][..],
        &["--max-range", "2.5"],
        &["--max-incidence", "45"],
        &["--drop-out", "0.2"],
        &["--reflectivity", "0.001"],
        &["--operator", "-0.5,0,-1.5,-0.5,0,0.2,0.25"],
    ] {
        assert!(returns(more) < all, "{more:?}");
    }
    assert!(returns(&["--no-housings"]) > all);
    let bright = returns(&["--reflectivity", "0.9"]);
    assert!(bright > all - all / 100, "a bright room near by returns nearly everything: {bright} of {all}");
    assert!(returns(&["--reflectivity", "0.0002"]) < bright / 2, "a black one does not");
    // a nearer limit does not make the sensor weaker
    assert_eq!(returns(&["--reflectivity", "0.9", "--max-range", "20"]), bright);
    let noisy = folder.predict(&["--azimuths", "180", "--range-noise", "0.1"]);
    assert!(noisy["outside_grid"].as_u64().unwrap() > 0);
    assert_eq!(returns(&["--sub-rays", "6"]), all, "a closed room always returns the median");
    let place = ["predict", "--mount", "mount.json", "--trajectory", "walk.tum", "--room", "0,0,0,6,4,3"];
    assert!(
        folder.error(&[&place[..], &["--reflectivity", "0"]].concat()).contains("'0' for '--reflectivity")
    );
}

/// Level at the platform's origin, which is said; and the trajectory may be planned or typed.
fn a_single_sensor_needs_no_mount() {
    let folder = Folder::new();
    let place = ["predict", "--room", "0,0,0,6,4,3", "--azimuths", "60", "--sensors", "vlp-16"];
    let alone = folder.document(&[&place[..], &["--trajectory", "walk.tum"]].concat());
    let typed =
        folder.document(&[&place[..], &["--trajectory", "walk.tum", "--mounts", "0,0,0,0,0"]].concat());
    assert_eq!(alone["coverage_sha256"], typed["coverage_sha256"]);
    let output = folder.run(&[&place[..], &["--trajectory", "2,2 4,2"]].concat());
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success() && text.contains("level at the platform's origin"), "{text}");
    assert!(text.contains("2 waypoints: 1 legs, 2.0 m"), "{text}");
    let planned = folder.run(&place);
    let text = String::from_utf8_lossy(&planned.stderr).into_owned();
    assert!(planned.status.success() && text.contains("planned trajectory: "), "{text}");
}

fn columns_from_180_to_4096() {
    let folder = Folder::new();
    let mut before = 0;
    for columns in ["180", "512", "1024", "2048", "4096"] {
        let document = folder.predict(&["--azimuths", columns]);
        let each = 2 * 16 * (20 * columns.parse::<u64>().unwrap() + 1);
        assert_eq!(document["rays"], each);
        let voxels = document["unique_voxels"].as_u64().unwrap();
        assert!(voxels >= before, "{columns} columns see no less");
        before = voxels;
    }
    let azimuths = |columns: &str| {
        folder.document(&[&GOOD[..], &["--azimuths", columns]].concat())["unique_voxels"].as_u64()
    };
    assert!(azimuths("4096") > azimuths("180"));
}

fn a_mesh_is_asked_for_its_unit_and_axis() {
    let folder = Folder::new();
    let ideal = [
        "predict",
        "--ideal",
        "--scene",
        "room.obj",
        "--trajectory",
        "walk.tum",
        "--sensor",
        "vlp-16",
        "--mounts",
    ];
    let quick = ["0,0,0,0,0", "--azimuths", "30", "--sample-count", "2000"];
    let all = |more: &[&'static str]| [&ideal[..], &quick, more].concat();
    let plain = folder.document(&all(&[]));
    assert_eq!((&plain["mesh"]["unit"], &plain["mesh"]["is_unit_stated"]), (&json!("m"), &json!(false)));
    let text = String::from_utf8(folder.run(&all(&[])).stdout).unwrap();
    assert!(text.contains("--mesh-unit") && text.contains("--up"), "{text}");
    let text = String::from_utf8(folder.run(&all(&["--mesh-unit", "m", "--up", "z"])).stdout).unwrap();
    assert!(!text.contains("nobody stated"), "{text}");
    folder.write("room.obj", room(1000.0, false).as_bytes());
    let error = folder.error(&all(&[]));
    assert!(
        error.contains("--mesh-unit") && error.contains("in mm it would be 6.00 x 4.00 x 3.00 m"),
        "{error}"
    );
    assert_eq!(folder.document(&all(&["--mesh-unit", "mm"]))["area_m2"], plain["area_m2"]);
    folder.write("room.obj", room(100.0, false).as_bytes());
    let doubted = folder.document(&all(&["--voxel", "5"]))["warnings"].to_string();
    assert!(doubted.contains("300 m high") && doubted.contains("--mesh-unit cm"), "{doubted}");
    folder.write("room.obj", room(1.0 / 0.0254, false).as_bytes());
    let doubted = folder.document(&all(&["--voxel", "5"]))["warnings"].to_string();
    assert!(
        doubted.contains("118 m high") && doubted.contains("in inches it would be 6.00 x 4.00 x 3.00 m"),
        "{doubted}"
    );
    // as high as a hall, and as a room in feet
    folder.write("room.obj", room(3.2808, false).as_bytes());
    assert!(!folder.document(&all(&[]))["warnings"].to_string().contains("--mesh-unit"));
    folder.write("room.obj", room(1.0, true).as_bytes());
    let turned = folder.document(&all(&["--up", "y"]));
    assert_eq!(turned["completeness"], plain["completeness"]);
    assert!(
        folder
            .error(&[
                "predict",
                "--mount",
                "mount.json",
                "--trajectory",
                "walk.tum",
                "--room",
                "0,0,0,6,4,3",
                "--up",
                "y"
            ])
            .contains("--up")
    );
}

fn an_error_tells_its_cause_once() {
    let folder = Folder::new();
    for arguments in [
        &["predict", "--preset", "paper-os1-64", "--mount", "missing.json"][..],
        &["decode", "missing.pcap"],
        &["predict", "--mount", "mount.json", "--trajectory", "missing.tum", "--room", "0,0,0,6,4,3"],
        &[
            "predict",
            "--ideal",
            "--scene",
            "missing.ply",
            "--trajectory",
            "walk.tum",
            "--mount",
            "mount.json",
        ],
    ] {
        let error = folder.error(arguments);
        assert!(error.contains("missing."), "{error}");
        assert_eq!(error.matches("os error 2").count(), 1, "{error}");
    }
}

/// No outside address, every picture with words for those who do not see it, and once the command that made them.
fn is_whole_page(path: &Path, figures: usize) -> String {
    let page = std::fs::read_to_string(path).unwrap();
    assert!(page.starts_with("<!doctype html>") && page.trim_end().ends_with("</html>"));
    for outside in ["<script src", "http://", "https://", "src=", "@import", "url("] {
        assert!(!page.contains(outside), "{outside}");
    }
    assert_eq!(page.matches("<figure>").count(), figures);
    assert_eq!(page.matches("Made by <code id=\"command\">outrigger ").count(), 1);
    let pictures = page.matches("<svg class=").count();
    assert_eq!(page.matches("role=\"img\" aria-label=\"").count(), pictures);
    assert!(!page.contains("aria-label=\"\"") && !page.contains("NaN"));
    page
}

fn pages_stand_alone() {
    let folder = Folder::new();
    folder.document(&[&GOOD[..], &["--baselines", "--report", "score.html"]].concat());
    let page = is_whole_page(&folder.path("score.html"), 3);
    assert!(page.contains("observable, but unseen") && page.contains("best single"));
    assert!(
        page.contains("--masters 0.07,0.1,0.05,35,0 --baselines --report score.html"),
        "the command as typed"
    );
    let predict =
        ["predict", "--mount", "mount.json", "--trajectory", "walk.tum", "--azimuths", "60", "--baselines"];
    let room = ["--room", "0,0,0,6,4,3", "--report", "room.html"];
    folder.document(&[&predict[..], &room].concat());
    assert!(is_whole_page(&folder.path("room.html"), 3).contains("right only"));
    let mesh = ["--scene", "room.obj", "--sample-count", "5000", "--report", "mesh.html"];
    let seen = folder.document(&[&predict[..], &mesh].concat());
    assert!(seen["reachable_voxels"].as_u64() >= seen["unique_voxels"].as_u64());
    for name in ["level_single", "best_single"] {
        assert!(seen["baselines"][name]["completeness"]["0.05"].as_f64().unwrap() > 0.0, "{seen}");
        let number = |of: &Value| of.as_i64().unwrap();
        let (all, alone) = (&seen["baselines"], &seen["baselines"][name]);
        let gain = number(&alone["gain_voxels"]);
        assert_eq!(gain, number(&all["rig"]["unique_voxels"]) - number(&alone["unique_voxels"]));
        assert!(gain > 0, "two see more of a bare room");
        assert!((0.0..0.5 * gain as f64).contains(&alone["gain_sd_voxels"].as_f64().unwrap()), "{all}");
        assert!((0.09..=1.0).contains(&all["rays_share"].as_f64().unwrap()), "{all}");
        assert!(number(&all["rig"]["unique_voxels"]) <= number(&seen["unique_voxels"]));
    }
    assert!(is_whole_page(&folder.path("mesh.html"), 4).contains("Blind spots"));
    let ideal =
        ["predict", "--ideal", "--scene", "room.obj", "--trajectory", "walk.tum", "--mount", "mount.json"];
    let quick = ["--azimuths", "60", "--sample-count", "5000", "--baselines", "--report", "surface.html"];
    folder.document(&[&ideal[..], &quick].concat());
    assert!(is_whole_page(&folder.path("surface.html"), 4).contains("degenerate"));
    let error = folder.error(&[&GOOD[..], &["--report", "no/such/folder.html"]].concat());
    assert!(error.contains("no/such/folder.html"), "{error}");
}

fn a_prediction_covers_the_house_as_ideal_sensors_do() {
    let folder = Folder::new();
    let mesh = shared("scenes/house.ply").display().to_string();
    let walk = std::fs::read_to_string(shared("reference/validation/house_trajectory.tum")).unwrap();
    let rows = walk.lines().filter(|line| !line.starts_with('#'));
    let first_seconds = rows.take_while(|line| line.split(' ').next().unwrap().parse::<f64>().unwrap() < 4.0);
    folder.write("walk.tum", first_seconds.collect::<Vec<_>>().join("\n").as_bytes());
    let common = ["--trajectory", "walk.tum", "--mount", "mount.json", "--azimuths", "360"];
    let samples = ["--sample-count", "20000"];
    let [predicted, validated] = [&["predict"][..], &["predict", "--ideal"]]
        .map(|verb| folder.document(&[verb, &["--scene", &mesh], &common, &samples].concat()));
    assert_eq!(predicted["observable_share"], validated["observable_share"]);
    for threshold in ["0.02", "0.05", "0.10"] {
        let share = |document: &Value| document["completeness"][threshold].as_f64().unwrap();
        // true beams against the ideal fan: another pattern of the same density
        assert!((share(&predicted) - share(&validated)).abs() < 0.02, "{predicted} {validated}");
        assert!(share(&predicted) > 0.05);
    }
    let least = |document: &Value| document["registration"]["translation_median"].as_f64().unwrap();
    assert!((least(&predicted) / least(&validated) - 1.0).abs() < 0.05);
}
