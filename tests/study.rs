//! Studies: planned, cut, run in any order, merged.

use std::path::Path;
use std::process::Output;

use crate::support::{Case, case, shared, with_shared};

pub const CASES: &[Case] = &[
    case("shards_in_any_order_merge_to_the_same_bytes", shards_in_any_order_merge_to_the_same_bytes),
    case("what_is_missing_or_foreign_is_said", what_is_missing_or_foreign_is_said),
    with_shared("walk_and_mount_are_searched_in_a_house", walk_and_mount_are_searched_in_a_house),
];

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

    ok(&["plan", "published", "--quick", "--seeds", "1"], cut);
    for shard in ["3/3", "1/3"] {
        ok(&["run", "published", "--shard", shard], cut);
    }
    let error = fails(&["merge", "published"], cut);
    assert!(error.contains("have no rows") && error.contains("2 shard files"), "{error}");
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

fn what_is_missing_or_foreign_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    assert!(fails(&["run", "published", "--shard", "1/1"], folder).contains("study plan"));
    let error = fails(&["unheard-of"], folder);
    assert!(error.contains("unheard-of") && error.contains("sensor-count"), "{error}");
    assert!(fails(&["joint"], folder).contains("--scene"));
    ok(&["plan", "sensor-count", "--quick", "--seeds", "1"], folder);
    assert!(fails(&["plan", "sensor-count", "--quick", "--seeds", "2"], folder).contains("another plan"));
    assert!(fails(&["run", "published", "--shard", "1/1"], folder).contains("sensor-count"));
    let foreign =
        r#"{"format":"outrigger-study-shard/1","plan_sha256":"00","shard":{"index":1,"count":1},"done":[]}"#;
    std::fs::write(folder.join("shard-00001-of-00001.json"), foreign).unwrap();
    assert!(fails(&["merge", "sensor-count"], folder).contains("another plan"));
    let usage = study(&["run", "published", "--shard", "3/2"], folder);
    assert_eq!(usage.status.code(), Some(2));
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
