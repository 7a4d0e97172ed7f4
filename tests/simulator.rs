//! The published simulator to the bit, and the general one against stored references.

use outrigger::base::instructions::Instructions;
use outrigger::design::objective::{Evaluation, Objective, Weights};
use outrigger::rig::{MountDeg, Path, Roll};
use outrigger::simulate::published::{Covered, Experiment, Preset, PublishedBox};
use outrigger::simulate::view::{Seen, View};
use serde::Deserialize;
use sha2::Digest as _;

use crate::support::{Case, case, shared, with_shared};
use outrigger::rig::{MountFile, SensorEntry};

pub const CASES: &[Case] = &[
    with_shared("the_definition_matches_the_released_program", the_definition_matches_the_released_program),
    with_shared("the_fast_way_matches_the_released_program", the_fast_way_matches_the_released_program),
    with_shared(
        "evaluate_prints_what_the_released_program_found",
        evaluate_prints_what_the_released_program_found,
    ),
    case("evaluate_scores_a_mount_file_as_it_is", evaluate_scores_a_mount_file_as_it_is),
    case("evaluate_says_what_sampling_is_worth", evaluate_says_what_sampling_is_worth),
    case("evaluate_refuses_what_it_cannot_score", evaluate_refuses_what_it_cannot_score),
    case("predict_counts_what_its_coverage_file_holds", predict_counts_what_its_coverage_file_holds),
    case("predict_refuses_what_it_cannot_cast", predict_refuses_what_it_cannot_cast),
];

/// One evaluation by the released program.
#[derive(Deserialize)]
#[allow(non_snake_case)] // the file's own names
struct Reference {
    id: String,
    kind: String,
    sensor: String,
    path_axis: String,
    vox: f64,
    az_samples: usize,
    symmetry: bool,
    fix_roll: Option<f64>,
    masters: Vec<[f64; 5]>,
    N: usize,
    U: u64,
    ge2: u64,
    per_sensor: Vec<u64>,
    unique_only: Vec<u64>,
    missed_ray_poses_per_sensor: Vec<u64>,
    rho: f64,
    delta_min_deg: Option<f64>,
    R_ov: f64,
    R_ang: f64,
    J: f64,
    boundary_voxels: u64,
    union_bits_sha256: String,
    counts_sha256: String,
}

impl Reference {
    fn all() -> Vec<Self> {
        #[derive(Deserialize)]
        struct File {
            cases: Vec<Reference>,
        }
        let text = std::fs::read_to_string(shared("reference/simulator/evaluations.json")).unwrap();
        let file: File = serde_json::from_str(&text).unwrap();
        assert_eq!(file.cases.len(), 70);
        file.cases
    }

    fn experiment(&self) -> Experiment {
        let preset = Preset::named(&format!("paper-{}", self.sensor.to_lowercase())).unwrap();
        Experiment {
            path: if self.path_axis == "x" { Path::Lateral } else { Path::Forward },
            voxel_m: self.vox,
            azimuths: self.az_samples,
            roll: self.fix_roll.map_or(Roll::Free, Roll::Fixed),
            mirror: self.symmetry,
            ..Experiment::published(preset)
        }
    }

    fn sensors(&self) -> Vec<MountDeg> {
        let masters: Vec<_> = self.masters.iter().map(|master| MountDeg::from(*master)).collect();
        self.experiment().sensors(&masters)
    }

    fn counts_sha256(seen: &Covered) -> String {
        let cells = seen.coverage.grid().len();
        let count = |index: usize| {
            (0..seen.coverage.sensors())
                .map(|sensor| u8::from(seen.coverage.contains(sensor, index)))
                .sum::<u8>()
        };
        let bytes: Vec<u8> = (0..cells).map(count).collect();
        sha2::Sha256::digest(&bytes).iter().map(|byte| format!("{byte:02x}")).collect()
    }

    /// What differs; empty when nothing does. Everything is compared to the bit except the angle and what follows from
    /// it: its arc cosine comes from another mathematics library, one unit in the last place apart in four cases. Score
    /// and angle are those of a rig, in radians.
    fn differences(&self, simulator: &PublishedBox, seen: &Covered) -> Vec<String> {
        let counts = seen.coverage.counts();
        let sensors = self.sensors();
        let objective = Objective::new(simulator.clone(), Weights::default(), 0.0).unwrap();
        let rig = objective.mounted(&sensors);
        let Evaluation { terms, min_angle_deg: angle_deg, rays, .. } = objective.evaluate_rig(&rig).unwrap();
        let viewed = View::see(simulator, &[rig]).swap_remove(0);
        let mut wrong = Vec::new();
        let mut check = |what: &str, same: bool| {
            if !same {
                wrong.push(format!("{} ({}): {what}", self.id, self.kind));
            }
        };
        check("N", sensors.len() == self.N);
        check(&format!("{viewed:?}"), viewed == Seen::exact(&counts, rays));
        check("reachable", simulator.reachable() == self.boundary_voxels);
        check(&format!("U {} for {}", counts.union, self.U), counts.union == self.U);
        check("ge2", counts.overlap == self.ge2);
        check("per_sensor", counts.per_sensor == self.per_sensor);
        check("unique_only", counts.unique_per_sensor == self.unique_only);
        check("missed", seen.lost_rays == self.missed_ray_poses_per_sensor);
        check("rho", counts.overlap_ratio() == self.rho);
        let angles = angle_deg.zip(self.delta_min_deg);
        check(
            &format!("delta {angle_deg:?} for {:?}", self.delta_min_deg),
            angle_deg == self.delta_min_deg || angles.is_some_and(|(a, b)| (a - b).abs() <= 5e-15),
        );
        check("R_ov", terms.overlap == self.R_ov);
        check(
            &format!("R_ang {} for {}", terms.angular, self.R_ang),
            (terms.angular - self.R_ang).abs() <= 5e-13,
        );
        check(
            &format!("J {} for {}", terms.objective(), self.J),
            (terms.objective() - self.J).abs() <= 5e-12,
        );
        check("union bits", seen.coverage.union_sha256() == self.union_bits_sha256);
        check("counts", Self::counts_sha256(seen) == self.counts_sha256);
        wrong
    }
}

fn the_definition_matches_the_released_program() {
    let mut wrong = Vec::new();
    for case in Reference::all() {
        let simulator = PublishedBox::new(&case.experiment()).unwrap();
        let seen = simulator.coverage_by_definition(&case.sensors()).unwrap();
        wrong.extend(case.differences(&simulator, &seen));
    }
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
}

/// Every way there is: with each instruction set of this machine, on one thread and on two, with the structure of the
/// walk and without.
fn the_fast_way_matches_the_released_program() {
    let pools = [1, 2].map(|threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap());
    let mut wrong = Vec::new();
    for case in Reference::all() {
        let simulator = PublishedBox::new(&case.experiment()).unwrap();
        let sensors = case.sensors();
        let seen = simulator.cover(&sensors).unwrap();
        wrong.extend(case.differences(&simulator, &seen));
        let walks = simulator.walks(&sensors);
        for instructions in Instructions::available() {
            for (pool, threads) in pools.iter().zip(1..) {
                let same = pool.install(|| {
                    let again = simulator.cover_with(&sensors, instructions).unwrap();
                    let counts = simulator.count_with(&sensors, instructions).unwrap();
                    again == seen && counts == seen.coverage.counts()
                });
                if !same {
                    wrong.push(format!("{}: {instructions:?}, {threads} threads", case.id));
                }
            }
            if simulator.cover_along_with(&walks, instructions).unwrap() != seen {
                wrong.push(format!("{}: {instructions:?}, pose by pose", case.id));
            }
        }
    }
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
}

fn evaluate(arguments: &[&str]) -> std::process::Output {
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_outrigger"));
    command.arg("predict").args(arguments).env_remove("OUTRIGGER_PRESET").env_remove("OUTRIGGER_JSON");
    command.output().unwrap()
}

/// Through the command line: the same bitmap, and the roll rule with its notice.
fn evaluate_prints_what_the_released_program_found() {
    let mut compared = 0;
    for case in Reference::all().into_iter().filter(|case| case.az_samples == 180 && case.vox >= 0.5) {
        let masters: Vec<_> =
            case.masters.iter().map(|m| m.map(|value| value.to_string()).join(",")).collect();
        let masters = masters.join(";");
        let preset = format!("paper-{}", case.sensor.to_lowercase());
        let voxel = case.vox.to_string();
        let path = if case.path_axis == "x" { "lateral" } else { "forward" };
        // what sampling is worth is not among the released program's figures
        let mut arguments = vec!["--json", "--fidelity", "given", "--preset", &preset];
        arguments.extend(["--masters", &masters, "--path", path]);
        arguments.extend(["--voxel", &voxel]);
        if !case.symmetry {
            arguments.push("--no-mirror");
        }
        let rule = match case.fix_roll {
            None => "free".to_owned(),
            Some(roll_deg) => format!("fixed:{roll_deg}"),
        };
        if case.fix_roll != Some(0.0) {
            arguments.extend(["--roll", &rule]);
        }
        let output = evaluate(&arguments);
        let errors = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.success(), "{}: {errors}", case.id);
        let replaced = case.fix_roll.is_some_and(|roll| case.masters.iter().any(|master| master[4] != roll));
        assert_eq!(errors.contains("roll is replaced"), replaced, "{}: {errors}", case.id);
        let document: serde_json::Value = crate::support::document(&output.stdout).unwrap();
        assert_eq!(document["coverage_sha256"], case.union_bits_sha256, "{}", case.id);
        assert_eq!(document["unique_voxels"], case.U, "{}", case.id);
        assert_eq!(document["overlap_ratio"], case.rho, "{}", case.id);
        assert_eq!(document["sensors"], case.N, "{}", case.id);
        assert!((document["objective"].as_f64().unwrap() - case.J).abs() < 1e-9, "{}", case.id);
        assert_eq!(document["min_angle_deg"].is_null(), case.N == 1, "{}", case.id);
        compared += 1;
    }
    assert!(compared > 30, "{compared}");
}

fn evaluate_scores_a_mount_file_as_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mount.json");
    let entry = |name: &str, sign: f64| SensorEntry {
        name: name.into(),
        model: "os1-64".into(),
        x_m: sign * 0.06,
        y_m: 0.1,
        z_m: -0.05,
        pitch_deg: sign * 25.0,
        ..SensorEntry::default()
    };
    let mut file = MountFile::new(vec![entry("right", 1.0), entry("left", -1.0)]);
    file.preset = Some("paper-os1-64".into());
    file.write(&path).unwrap();
    let document = |output: std::process::Output| -> serde_json::Value {
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        crate::support::document(&output.stdout).unwrap()
    };
    let path = path.to_str().unwrap();
    let from_file = document(evaluate(&["--json", "--mount", path]));
    let typed =
        document(evaluate(&["--json", "--preset", "paper-os1-64", "--masters", "0.06,0.1,-0.05,25,0"]));
    assert_eq!(from_file["coverage_sha256"], typed["coverage_sha256"]);
    assert_eq!(from_file["feasible"], true);
    let other = evaluate(&["--json", "--preset", "paper-vlp-16", "--mount", path]);
    assert_eq!(other.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&other.stderr).contains("right"), "the sensor is named");
}

fn evaluate_says_what_sampling_is_worth() {
    let pair = ["--preset", "paper-vlp-16", "--masters", "0.1,0,0,27,0"];
    let output = evaluate(&[&pair[..], &["--fidelity", "auto", "--tolerance", "5", "--json"]].concat());
    let document: serde_json::Value = crate::support::document(&output.stdout).unwrap();
    let fidelity = &document["fidelity"];
    let number = |value: &serde_json::Value| value.as_f64().unwrap();
    let (value, bound) = (number(&fidelity["value"]), number(&fidelity["bound"]));
    // near enough to converged for this
    let fine = ["--azimuths", "900", "--sub-poses", "8", "--phase", "free", "--json"];
    let fine: serde_json::Value =
        serde_json::from_slice(&evaluate(&[&pair[..], &fine].concat()).stdout).unwrap();
    let converged = number(&fine["objective"]);
    assert!((converged - value).abs() <= bound && bound <= 0.05 * value, "{converged} {fidelity}");
    // the published sampling misses far more than that
    assert!(converged - number(&document["objective"]) > 2.0 * bound, "{document}");
    assert_eq!(fidelity["within_tolerance"], true);
    let left_out = fidelity["left_out"].as_array().unwrap();
    assert!(left_out.iter().any(|left| left["worth"].is_number()), "{left_out:?}");
    // housings 21 cm apart hide a little of each other
    let touched = left_out.iter().find_map(|left| left["rays_touched"].as_f64()).unwrap();
    assert!((0.001..0.2).contains(&touched), "{touched}");
    assert!(fine["fidelity"].is_null());
}

fn evaluate_refuses_what_it_cannot_score() {
    let preset = ["--preset", "paper-os1-64"];
    let good = ["--masters", "0,0,0,25,0"];
    for (arguments, code, words) in [
        (&["--masters", "0,0,0,NaN,0"][..], 2, "finite"),
        (&["--masters", "0,0,0,25"], 2, "4 numbers"),
        (&["--masters", ""], 2, "master 1"),
        (&["--masters", "9,0,0,25,0"], 1, "stay inside the box"),
        (&[&good[..], &["--voxel", "0.3"]].concat(), 2, "0.3 m"),
        (&[&good[..], &["--azimuths", "0"]].concat(), 2, "expected a whole number from 1 to 65536"),
        (&[&good[..], &["--roll", "loose"]].concat(), 2, "fixed:0"),
        (&[&good[..], &["--fidelity", "auto", "--tolerance", "0"]].concat(), 2, "--tolerance <PERCENT>"),
        (&["--mount", "no-such-file.json"], 1, "no-such-file.json"),
        (&[], 2, "--mount"),
    ] {
        let output = evaluate(&[&preset[..], arguments].concat());
        let errors = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{arguments:?}: {errors}");
        assert!(errors.contains(words), "{arguments:?}: {errors}");
        assert!(output.stdout.is_empty(), "{arguments:?}");
    }
    let unknown = evaluate(&[&["--preset", "paper-os9"], &good[..]].concat());
    assert!(String::from_utf8_lossy(&unknown.stderr).contains("paper-vlp-16"));
}

/// A rig of two in a small room, and a walk of two metres.
struct Walk {
    _folder: tempfile::TempDir,
    mount: String,
    trajectory: String,
    out: String,
}

impl Walk {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
        let (mount, trajectory, out) = (path("mount.json"), path("walk.tum"), path("seen.ply"));
        let entry = |name: &str, sign: f64| SensorEntry {
            name: name.into(),
            model: "vlp-16".into(),
            x_m: sign * 0.08,
            y_m: 0.0,
            z_m: 0.0,
            pitch_deg: sign * 35.0,
            ..SensorEntry::default()
        };
        MountFile::new(vec![entry("right", 1.0), entry("left", -1.0)]).write(mount.as_ref()).unwrap();
        std::fs::write(&trajectory, "100.0 -1 0 1.5 0 0 0 1\n102.0 1 0 1.5 0 0 0 1\n").unwrap();
        Self { _folder: folder, mount, trajectory, out }
    }

    fn predict(&self, more: &[&str]) -> std::process::Output {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_outrigger"));
        command.args(["predict", "--json", "--mount", &self.mount]);
        if !more.contains(&"--trajectory") {
            command.args(["--trajectory", &self.trajectory]);
        }
        command.args(more).env_remove("OUTRIGGER_JSON").output().unwrap()
    }
}

fn predict_counts_what_its_coverage_file_holds() {
    let walk = Walk::new();
    let room = ["--room", "-3,-2,0,3,2,2.5", "--azimuths", "180", "--out", &walk.out];
    let output = walk.predict(&room);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let document: serde_json::Value = crate::support::document(&output.stdout).unwrap();
    assert_eq!(document["rays"], 2 * 16 * 3601);
    let voxels = document["unique_voxels"].as_u64().unwrap();
    // a room of 24 + 2 (15 + 10) m2 has about 7,400 voxels of 0.1 m
    assert!((6500..7800).contains(&voxels), "{voxels}");
    assert!(document["registration"]["translation_p5"].as_f64().unwrap() > 0.01);
    let file = std::fs::read(&walk.out).unwrap();
    let header_end = file.windows(11).position(|bytes| bytes == b"end_header\n").unwrap() + 11;
    assert_eq!((file.len() - header_end) as u64, voxels * 28);
    let header = String::from_utf8_lossy(&file[..header_end]);
    assert!(header.contains(&format!("element vertex {voxels}\n")) && header.contains("bit 1: left"));
    for vertex in file[header_end..].chunks(28) {
        let number = |at: usize| f64::from_le_bytes(vertex[at..at + 8].try_into().unwrap());
        let [x, y, z] = [number(0), number(8), number(16)];
        let off_walls = [3.0 - x.abs(), 2.0 - y.abs(), z, 2.5 - z];
        assert!(off_walls.iter().any(|off| off.abs() < 1e-9), "{x} {y} {z}: walls lie in voxel centres");
        assert!((1..=3).contains(&vertex[24]));
    }
    let again: serde_json::Value = serde_json::from_slice(&walk.predict(&room).stdout).unwrap();
    assert_eq!(document["coverage_sha256"], again["coverage_sha256"]);
    let shaded = walk.predict(&[&room[..], &["--operator", "-0.5,0,-1.5,-0.5,0,0.2,0.25"]].concat());
    let shaded: serde_json::Value = crate::support::document(&shaded.stdout).unwrap();
    assert!(shaded["returns"].as_u64() < document["returns"].as_u64(), "the operator shades beams");
    let within = walk.predict(&[&room[..4], &["--operator", "-1,0,0,1,0,0,0.5"]].concat());
    let said = String::from_utf8_lossy(&within.stderr);
    assert!(said.contains("right: not one ray came back") && said.contains("operator"), "{said}");
}

fn predict_refuses_what_it_cannot_cast() {
    let walk = Walk::new();
    let written = |name: &str, text: &str| {
        let path = std::path::Path::new(&walk.mount).with_file_name(name);
        std::fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let once = written("once.tum", "100.0 -1 0 1.5 0 0 0 1\n");
    let kitti = written("kitti.txt", "1 0 0 0 0 1 0 0 0 0 1 1.5\n1 0 0 1 0 1 0 0 0 0 1 1.5\n");
    let room = ["--room", "-3,-2,0,3,2,2.5"];
    for (arguments, code, words) in [
        (&["--room", "3,2,2,-3,-2,0"][..], 2, "--room"),
        (&["--room", "3,2,2"], 2, "3 numbers, expected 6"),
        (&["--scene", "no-such-mesh.ply"], 1, "no-such-mesh.ply"),
        (&[], 2, "--scene"),
        (&[&room[..], &["--voxel", "0"]].concat(), 2, "--voxel"),
        (&[&room[..], &["--voxel", "1e-9"]].concat(), 2, "--voxel"),
        (&[&room[..], &["--drop-out", "1.5"]].concat(), 2, "--drop-out"),
        (&[&room[..], &["--min-range", "5", "--max-range", "2"]].concat(), 2, "--min-range 5 is not below"),
        (&[&room[..], &["--report", "no-such-folder/page.html"]].concat(), 1, "cannot write no-such-folder"),
        (&[&room[..], &["--trajectory", &once]].concat(), 1, "expected at least one revolution of 0.1 s"),
        (
            &[&room[..], &["--trajectory", &kitti]].concat(),
            1,
            "12 columns, which are poses in KITTI format without times: give --rate",
        ),
    ] {
        let output = walk.predict(arguments);
        let errors = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{arguments:?}: {errors}");
        assert!(errors.contains(words), "{arguments:?}: {errors}");
        assert!(output.stdout.is_empty() && !std::path::Path::new(&walk.out).exists());
    }
}
