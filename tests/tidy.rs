//! Habits that hold the house together: the order of wings, no circles, units in names, nothing of this machine in the text.

use std::path::{Path, PathBuf};

use crate::support::{Case, case};

mod circles;
mod words;

pub const CASES: &[Case] = &[
    case("wings_use_only_wings_above_them", wings_use_only_wings_above_them),
    case("no_files_import_each_other_in_a_circle", no_files_import_each_other_in_a_circle),
    case("no_verb_imports_a_verb", no_verb_imports_a_verb),
    case("few_files_know_the_published_experiment", few_files_know_the_published_experiment),
    case("verbs_print_reports", verbs_print_reports),
    case("lengths_angles_and_times_carry_their_unit", lengths_angles_and_times_carry_their_unit),
    case("names_and_messages_use_the_glossary", names_and_messages_use_the_glossary),
    case("no_path_of_one_machine", no_path_of_one_machine),
    case("files_are_opened_for_reading_in_one_place", files_are_opened_for_reading_in_one_place),
    case("every_dependency_has_its_reason", every_dependency_has_its_reason),
];

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    let mut folders = vec![folder.to_path_buf()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).unwrap().map(Result::unwrap) {
            let path = entry.path();
            if path.is_dir() {
                if path.file_name().is_some_and(|name| name != "target") {
                    folders.push(path);
                }
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                files.push(path);
            }
        }
    }
    files.sort();
    files
}

fn wings() -> Vec<String> {
    let text = std::fs::read_to_string(root().join("src/lib.rs")).unwrap();
    text.lines()
        .filter_map(|line| line.strip_prefix("pub mod ")?.strip_suffix(';').map(str::to_owned))
        .collect()
}

fn wings_use_only_wings_above_them() {
    let order = wings();
    assert_eq!(order.len(), 14, "src/lib.rs lists the wings: {order:?}");
    let mut offences = Vec::new();
    for file in rust_files(&root().join("src")) {
        let relative = file.strip_prefix(root().join("src")).unwrap();
        let first = relative.components().next().unwrap().as_os_str().to_str().unwrap();
        let module = first.trim_end_matches(".rs");
        let Some(place) = order.iter().position(|name| name == module) else {
            assert!(["lib", "main"].contains(&module), "{} is not listed in src/lib.rs", relative.display());
            continue;
        };
        let text = std::fs::read_to_string(&file).unwrap();
        for (number, line) in text.lines().enumerate() {
            for used in line.split("crate::").skip(1) {
                let used: String = used.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
                if let Some(at) = order.iter().position(|name| *name == used)
                    && at > place
                {
                    offences.push(format!("{}:{} uses {used}", relative.display(), number + 1));
                }
            }
        }
    }
    assert!(offences.is_empty(), "wings that use a wing below them:\n{}", offences.join("\n"));
}

fn no_files_import_each_other_in_a_circle() {
    let folders = ["src", "sensors/src", "firmware-protocol/src"];
    let circles: Vec<String> =
        folders.iter().flat_map(|folder| circles::circles(&root().join(folder))).collect();
    assert!(circles.is_empty(), "files that import each other in a circle:\n{}", circles.join("\n"));
}

/// What mounts see is asked of a view or of an objective; what the published experiment is made of is known to few.
fn few_files_know_the_published_experiment() {
    let source = root().join("src");
    let is_inside = |file: &PathBuf| {
        ["simulate/published", "study/published"].iter().any(|own| file.starts_with(source.join(own)))
    };
    let imports = |file: &PathBuf| std::fs::read_to_string(file).unwrap().contains("simulate::published");
    let mut know: Vec<_> = rust_files(&source).into_iter().filter(|file| !is_inside(file)).collect();
    know.retain(imports);
    assert!((1..=5).contains(&know.len()), "{know:?}");
}

/// A result is written once, as a report, which is text and page; what goes on for long or is no result prints lines.
fn verbs_print_reports() {
    const OTHERS: [&str; 6] =
        ["output.rs", "manual.rs", "rig.rs", "rig/watch.rs", "daemon/serve.rs", "record/conclude.rs"];
    let folder = root().join("src/commands");
    let prints = |file: &PathBuf| {
        let text = std::fs::read_to_string(file).unwrap();
        ["print_text(", "print_json("].iter().any(|call| text.contains(call))
    };
    let mut printing: Vec<_> = rust_files(&folder).into_iter().filter(prints).collect();
    printing.retain(|file| !OTHERS.iter().any(|other| *file == folder.join(other)));
    assert!(printing.is_empty(), "call print_result with a report: {printing:?}");
}

/// A path may lead to a pipe that nobody writes to or a device that never ends: `src/files.rs` has what refuses them.
fn files_are_opened_for_reading_in_one_place() {
    // what the system has under /proc and /sys, the captures of a command line (pipes among them), a session being written
    const OTHERS: [&str; 8] = [
        "base/files.rs",
        "verify/readiness/machine.rs",
        "commands/signals.rs",
        "daemon/engine/memory.rs",
        "mock/transmit.rs",
        "recording/packet_reader.rs",
        "recording/whereabouts.rs",
        "drive/usb.rs",
    ];
    let mut offences = Vec::new();
    for file in rust_files(&root().join("src")) {
        let relative = file.strip_prefix(root().join("src")).unwrap();
        if OTHERS.iter().any(|other| relative == Path::new(other)) {
            continue;
        }
        let text = std::fs::read_to_string(&file).unwrap();
        let code = text.split("#[cfg(test)]").next().unwrap();
        for (number, line) in code.lines().enumerate() {
            if ["fs::read(", "fs::read_to_string(", "File::open("].iter().any(|call| line.contains(call)) {
                offences.push(format!("{}:{}", relative.display(), number + 1));
            }
        }
    }
    assert!(offences.is_empty(), "use crate::base::files to read:\n{}", offences.join("\n"));
}

/// A verb is a module of `commands` with a public `run`.
fn no_verb_imports_a_verb() {
    let folder = root().join("src/commands");
    let mut files: Vec<(String, String)> = Vec::new(); // module, its code
    for file in rust_files(&folder) {
        let relative = file.strip_prefix(&folder).unwrap();
        let module = relative.iter().next().unwrap().to_str().unwrap().trim_end_matches(".rs").to_owned();
        let text = std::fs::read_to_string(&file).unwrap();
        files.push((module, text.split("#[cfg(test)]").next().unwrap().to_owned()));
    }
    let runs = |text: &str| text.contains("\npub fn run(") || text.contains("\npub async fn run(");
    let mut verbs: Vec<&str> = Vec::new();
    for (module, text) in &files {
        if runs(text) && module != "mod" && !verbs.contains(&module.as_str()) {
            verbs.push(module);
        }
    }
    assert!(verbs.len() > 15, "{verbs:?}");
    let mut offences = Vec::new();
    for (module, text) in files.iter().filter(|(module, _)| verbs.contains(&module.as_str())) {
        for path in ["crate::commands::", "super::super::"] {
            for used in text.split(path).skip(1) {
                let used: String = used.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
                if used != *module && verbs.contains(&used.as_str()) {
                    offences.push(format!("{module} uses {used}"));
                }
            }
        }
    }
    assert!(offences.is_empty(), "verbs that import a verb:\n{}", offences.join("\n"));
}

/// Public fields of type f64 or u64 that measure something say in what: a bare `range: f64` is refused.
fn lengths_angles_and_times_carry_their_unit() {
    const QUANTITIES: &[&str] = &[
        "range",
        "distance",
        "length",
        "height",
        "radius",
        "azimuth",
        "elevation",
        "pitch",
        "roll",
        "yaw",
        "time",
        "duration",
        "age",
        "speed",
        "voxel",
        "angle",
    ];
    let mut offences = Vec::new();
    for folder in ["src", "sensors/src", "firmware-protocol/src"] {
        for file in rust_files(&root().join(folder)) {
            let text = std::fs::read_to_string(&file).unwrap();
            for (number, line) in text.lines().enumerate() {
                let Some(field) = line.trim().strip_prefix("pub ") else { continue };
                let Some((name, kind)) = field.split_once(": ") else { continue };
                let number_kind = ["f64,", "f32,", "u64,", "i64,", "u32,", "i32,"].contains(&kind);
                if number_kind && QUANTITIES.contains(&name) {
                    offences.push(format!("{}:{} {name}", file.display(), number + 1));
                }
            }
        }
    }
    assert!(offences.is_empty(), "quantities without a unit in their name:\n{}", offences.join("\n"));
}

fn names_and_messages_use_the_glossary() {
    let mut offences = Vec::new();
    for folder in ["src", "sensors/src", "firmware-protocol/src"] {
        for file in rust_files(&root().join(folder)) {
            offences.extend(words::replaced(&file, &std::fs::read_to_string(&file).unwrap()));
        }
    }
    assert!(offences.is_empty(), "words that the glossary replaces:\n{}", offences.join("\n"));
}

fn no_path_of_one_machine() {
    let listed = std::process::Command::new("git").args(["ls-files", "-z"]).current_dir(root()).output();
    let Ok(listed) = listed else { panic!("git is needed to list the project's files") };
    let mut offences = Vec::new();
    for name in String::from_utf8_lossy(&listed.stdout).split('\0').filter(|name| !name.is_empty()) {
        let Ok(text) = std::fs::read_to_string(root().join(name)) else { continue };
        for (number, line) in text.lines().enumerate() {
            // spelled in two halves so that this file does not find itself
            for needle in [concat!("/ho", "me/"), concat!("/wo", "rk/"), concat!("/ro", "ot/")] {
                if line.contains(needle) {
                    offences.push(format!("{name}:{} {needle}", number + 1));
                }
            }
        }
    }
    assert!(offences.is_empty(), "paths of one machine:\n{}", offences.join("\n"));
}

fn every_dependency_has_its_reason() {
    let mut offences = Vec::new();
    for folder in [
        ".",
        "sensors",
        "sensors/fuzz",
        "firmware-protocol",
        "firmware-protocol/fuzz",
        "firmware-protocol/firmware",
    ] {
        let manifest = format!("{folder}/Cargo.toml");
        let text = std::fs::read_to_string(root().join(&manifest)).unwrap();
        let mut inside = false;
        for (number, line) in text.lines().enumerate() {
            if line.starts_with('[') {
                inside = line.ends_with("dependencies]");
            } else if inside && !line.trim().is_empty() && !line.contains(" # ") {
                offences.push(format!("{manifest}:{} {line}", number + 1));
            }
        }
    }
    assert!(offences.is_empty(), "dependencies without a reason:\n{}", offences.join("\n"));
}
