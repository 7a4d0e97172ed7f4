//! Studies: planned, cut, run in any order, merged.

use std::path::Path;
use std::process::Output;
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

use crate::support::{Case, case, shared, with_machine, with_shared};

pub const CASES: &[Case] = &[
    case("shards_in_any_order_merge_to_the_same_bytes", shards_in_any_order_merge_to_the_same_bytes),
    case("meshes_come_and_go", meshes_come_and_go),
    case("scripts_run_a_study_to_the_same_bytes", scripts_run_a_study_to_the_same_bytes),
    case("missing_and_unknown_studies_are_reported", missing_and_unknown_studies_are_reported),
    case("a_signal_ends_a_task_of_minutes_at_once", a_signal_ends_a_task_of_minutes_at_once),
    with_shared("walk_and_mount_are_searched_in_a_house", walk_and_mount_are_searched_in_a_house),
    with_machine(
        "instructions_are_counted_and_stay_the_same",
        "valgrind is not installed",
        has_valgrind,
        instructions_are_counted_and_stay_the_same,
    ),
];

fn has_valgrind() -> bool {
    std::process::Command::new("valgrind")
        .arg("--version")
        .output()
        .is_ok_and(|output| output.status.success())
}

fn study(arguments: &[&str], folder: &Path) -> Output {
    std::process::Command::new(env!("CARGO_BIN_EXE_outrigger"))
        .arg("study")
        .args(arguments)
        .arg("--out")
        .arg(folder)
        .env_remove("OUTRIGGER_JSON")
        .output()
        .unwrap()
}

fn ok(arguments: &[&str], folder: &Path) -> String {
    let output = study(arguments, folder);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

fn fails(arguments: &[&str], folder: &Path) -> String {
    let output = study(arguments, folder);
    assert_eq!(output.status.code(), Some(1), "{arguments:?}");
    assert!(output.stdout.is_empty());
    String::from_utf8(output.stderr).unwrap()
}

fn read(folder: &Path, name: &str) -> String {
    std::fs::read_to_string(folder.join(name)).unwrap()
}

fn shards_in_any_order_merge_to_the_same_bytes() {
    let (whole, cut) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let (whole, cut) = (whole.path(), cut.path());
    let text = ok(&["published", "--quick", "--seeds", "1", "--json"], whole);
    let document: serde_json::Value = serde_json::from_str(&text).unwrap();
    let claims = document["findings"]["claims"].as_array().unwrap();
    assert!(claims.len() >= 10, "{claims:?}");
    assert!(claims.iter().all(|claim| !claim["because"].as_str().unwrap().is_empty()));
    assert!(claims.iter().all(|claim| claim["verdict"] == "cannot_tell"), "a quick study decides nothing");

    ok(&["plan", "published", "--quick", "--seeds", "1"], cut);
    for shard in ["3/3", "1/3"] {
        ok(&["run", "published", "--shard", shard], cut);
    }
    let error = fails(&["merge", "published"], cut);
    assert!(error.contains("have no rows") && error.contains("2 shard files"), "{error}");
    damaged_shards_are_named_and_run_again(cut);
    let kept = std::fs::metadata(cut.join("shard-00001-of-00003.json")).unwrap().modified().unwrap();
    for shard in ["1/3", "2/3"] {
        ok(&["run", "published", "--shard", shard], cut);
    }
    let still = std::fs::metadata(cut.join("shard-00001-of-00003.json")).unwrap().modified().unwrap();
    assert_eq!(kept, still, "a shard that lies there is not run again");
    ok(&["merge", "published"], cut);
    assert_eq!(read(whole, "rows.csv"), read(cut, "rows.csv"));
    assert!(!read(cut, "rows.csv").lines().next().unwrap().contains("wall_"));
    assert!(read(cut, "times.csv").starts_with("wall_objective_s,wall_s"));
    for name in ["table-3.csv", "table-4.csv", "table-8.csv", "lambda.csv", "figure-10.csv"] {
        assert!(read(cut, name).lines().count() > 1, "{name}");
    }
    // the published value stands beside ours
    assert!(read(cut, "table-3.csv").contains("\"30,730.1\""));
    let page = read(cut, "report.html");
    assert!(page.contains("Table 8") && page.contains("<svg") && !page.contains("http://"), "{page}");
}

/// Cut short, or with one digit changed: never merged, named, and run again. Shards 1/3 and 3/3 lie there.
fn damaged_shards_are_named_and_run_again(folder: &Path) {
    let path = folder.join("shard-00003-of-00003.json");
    let whole = std::fs::read_to_string(&path).unwrap();
    let (start, end) = whole.split_at(whole.rfind("unique_voxels\":").unwrap() + 17);
    let digit = if end.starts_with('1') { "2" } else { "1" };
    let flipped = format!("{start}{digit}{}", &end[1..]);
    for damaged in [&whole[..whole.len() / 2], &flipped] {
        std::fs::write(&path, damaged).unwrap();
        let error = fails(&["merge", "published"], folder);
        assert!(
            error.contains("shard-00003-of-00003.json") && error.contains("nothing was merged"),
            "{error}"
        );
        assert!(!folder.join("rows.csv").exists());
        let again = study(&["run", "published", "--shard", "3/3"], folder);
        let notice = String::from_utf8_lossy(&again.stderr);
        assert!(again.status.success() && notice.contains("shard 3/3 was run again"), "{notice}");
        let times = |text: &str| text.matches("wall_").count();
        let redone = std::fs::read_to_string(&path).unwrap();
        assert_eq!(times(&redone), times(&whole));
    }
}

fn scripts_run_a_study_to_the_same_bytes() {
    let (whole, queued) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    ok(&["pareto", "--quick", "--seeds", "1"], whole.path());
    let text = ok(&["submit", "pareto", "--quick", "--seeds", "1", "--shards", "3", "--json"], queued.path());
    let start =
        serde_json::from_str::<serde_json::Value>(&text).unwrap()["start"].as_str().unwrap().to_owned();
    let run = std::process::Command::new("sh").arg("-c").arg(&start).output().unwrap();
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    for name in ["rows.csv", "pareto.csv", "findings.json"] {
        assert_eq!(read(whole.path(), name), read(queued.path(), name), "{name}");
    }
    let slurm = ["submit", "pareto", "--quick", "--seeds", "1", "--engine", "slurm", "--shards", "3"];
    ok(&slurm, queued.path());
    assert!(read(queued.path(), "shards.sbatch").contains("#SBATCH --array=1-3"));
}

fn missing_and_unknown_studies_are_reported() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    assert!(fails(&["run", "published", "--shard", "1/1"], folder).contains("study plan"));
    for (name, words) in [("unheard-of", "sensor-count"), ("joint", "--scene")] {
        let output = study(&[name], folder);
        let error = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code() == Some(2) && error.contains(words), "{error}");
    }
    ok(&["plan", "sensor-count", "--quick", "--seeds", "1"], folder);
    let error = fails(&["plan", "sensor-count", "--quick", "--seeds", "2"], folder);
    assert!(error.contains("another plan, of seeds 1, asked for is 2"), "{error}");
    assert!(fails(&["run", "published", "--shard", "1/1"], folder).contains("sensor-count"));
    let foreign = r#"{"format":"outrigger-study-shard/1","plan_sha256":"00","shard":{"index":1,"count":1},"done_sha256":"","done":[]}"#;
    std::fs::write(folder.join("shard-00001-of-00001.json"), foreign).unwrap();
    assert!(fails(&["merge", "sensor-count"], folder).contains("another plan"));
    let usage = study(&["run", "published", "--shard", "3/2"], folder);
    assert_eq!(usage.status.code(), Some(2));
}

/// A room as a mesh.
fn room(x_m: f64) -> String {
    let mut text = String::new();
    for (x, y, z) in (0..8).map(|corner| (corner & 1, corner >> 1 & 1, corner >> 2)) {
        text += &format!("v {} {} {}\n", f64::from(x) * x_m, f64::from(y) * 6.0, f64::from(z) * 2.5);
    }
    for [a, b, c, d] in [[1, 2, 4, 3], [5, 7, 8, 6], [1, 5, 6, 2], [3, 4, 8, 7], [1, 3, 7, 5], [2, 6, 8, 4]] {
        text += &format!("f {a} {b} {c} {d}\n");
    }
    text
}

/// What was done of the meshes that stay is kept, also of one that comes back.
fn meshes_come_and_go() {
    let folder = tempfile::tempdir().unwrap();
    let (scenes, out) = (folder.path().join("scenes"), folder.path().join("out"));
    std::fs::create_dir(&scenes).unwrap();
    std::fs::write(scenes.join("long.obj"), room(9.0)).unwrap();
    std::fs::write(scenes.join("short.obj"), room(7.0)).unwrap();
    let arguments = ["scenes", "--quick", "--scene", scenes.to_str().unwrap()];
    let run = || {
        let output = study(&arguments, &out);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{said}");
        (read(&out, "rows.csv"), said)
    };
    let (both, _) = run();
    assert!(both.contains("long") && both.contains("short"), "{both}");
    std::fs::rename(scenes.join("short.obj"), folder.path().join("short.obj")).unwrap();
    // whoever looked at it again would find no mesh
    std::fs::write(scenes.join("long.obj"), "").unwrap();
    let (alone, said) = run();
    assert!(said.contains("4 of the 4 of now are done already"), "{said}");
    assert!(alone.contains("long") && !alone.contains("short"), "{alone}");
    std::fs::rename(folder.path().join("short.obj"), scenes.join("short.obj")).unwrap();
    let (again, said) = run();
    assert!(said.contains("8 of the 8 of now are done already"), "{said}");
    assert_eq!(again, both);
}

fn walk_and_mount_are_searched_in_a_house() {
    let folder = tempfile::tempdir().unwrap();
    let scene = shared("scenes/house.ply");
    ok(&["joint", "--quick", "--seeds", "1", "--scene", scene.to_str().unwrap()], folder.path());
    let rows = read(folder.path(), "joint.csv");
    assert_eq!(rows.lines().count(), 3, "{rows}");
    for part in ["in turn", "together"] {
        let row = rows.lines().find(|row| row.contains(part)).unwrap();
        assert!(row.starts_with("vlp-16") && !row.contains("none"), "{row}");
    }
    assert!(read(folder.path(), "findings.json").contains("better searched together"));
}

fn instructions_are_counted_and_stay_the_same() {
    let count = || -> Vec<f64> {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        ok(&["plan", "speed-accuracy", "--quick", "--count-instructions"], folder);
        // one of its cases is enough
        let mut plan: serde_json::Value = serde_json::from_str(&read(folder, "plan.json")).unwrap();
        let is_one =
            |task: &serde_json::Value| task["part"] == "instructions" && task["case"] == "vlp-16-lateral";
        plan["tasks"].as_array_mut().unwrap().retain(is_one);
        std::fs::write(folder.join("plan.json"), plan.to_string()).unwrap();
        ok(&["run", "speed-accuracy", "--shard", "1/1"], folder);
        let shard: serde_json::Value =
            serde_json::from_str(&read(folder, "shard-00001-of-00001.json")).unwrap();
        let rows = shard["done"][0][1].as_array().unwrap();
        let names: Vec<_> = rows.iter().map(|row| row["model"].as_str().unwrap()).collect();
        assert_eq!(names, ["180 x 1 locked", "180 x 4 free"]);
        rows.iter().map(|row| row["instructions_per_mount"].as_f64().unwrap()).collect()
    };
    let (first, second) = (count(), count());
    // a ray takes some instructions, four times the rays take more
    assert!(first[0] > 59_040.0 && first[1] > 1.5 * first[0], "{first:?}");
    // what a process does beside its mounts differs by some ten thousand instructions: keys of hash maps, waiting threads
    for (first, second) in first.iter().zip(second) {
        assert!((first - second).abs() < 0.01 * first, "{first} and {second}");
    }
}

fn a_signal_ends_a_task_of_minutes_at_once() {
    let folder = tempfile::tempdir().unwrap();
    ok(&["plan", "speed-accuracy"], folder.path());
    for signal in [Signal::SIGINT, Signal::SIGTERM] {
        let mut program = std::process::Command::new(env!("CARGO_BIN_EXE_outrigger"));
        program.args(["study", "run", "speed-accuracy", "--shard", "1/1", "--out"]).arg(folder.path());
        let running = program.stderr(std::process::Stdio::piped()).spawn().unwrap();
        std::thread::sleep(Duration::from_secs(2));
        let told = Instant::now();
        kill(Pid::from_raw(running.id() as i32), signal).unwrap();
        let output = running.wait_with_output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(told.elapsed() < Duration::from_secs(10), "{signal} was heeded after {:?}", told.elapsed());
        assert_eq!(output.status.code(), Some(1), "{said}");
        assert!(said.contains("interrupted: whole shards stay"), "{said}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "plan.json alone");
    }
}
