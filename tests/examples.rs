//! Every command line that help, README and docs show: it parses as the program is, and runs on small data; help is short.

use std::net::SocketAddr;
use std::path::Path;
use std::process::{Command, Output};

use glam::DVec3;
use outrigger::commands::help;
use outrigger::recording::{SensorInfo, SessionWriter};
use outrigger::rig::{MountFile, SensorEntry};
use outrigger::world::scene::{BoxScene, Scene};
use outrigger::world::trajectory::Trajectory;
use sensors::ouster::{Metadata, Profile, Synthetic};

use crate::support::walk::Walk;
use crate::support::{Case, case};

pub const CASES: &[Case] = &[
    case("help_is_short_and_ends_in_examples", help_is_short_and_ends_in_examples),
    case("names_of_other_programs_lead_to_ours", names_of_other_programs_lead_to_ours),
    case("every_command_line_parses", every_command_line_parses),
    case("every_command_line_runs_on_small_data", every_command_line_runs_on_small_data),
    case("a_recording_makes_a_rig_file", a_recording_makes_a_rig_file),
];

const MAX_VERBS: usize = 20;
const MAX_FLAGS: usize = 100;
/// Two screens.
const MAX_LINES: usize = 100;

/// Command lines that are parsed only, by how they begin, and why.
const PARSED_ONLY: &[(&str, &str)] = &[
    ("rig status", "needs a servo rig; tests/rig_verbs.rs runs it on mocks"),
    ("rig home", "needs a servo rig; tests/rig_verbs.rs runs it on mocks"),
    ("rig set", "needs a servo rig; tests/rig_verbs.rs runs it on mocks"),
    ("rig apply", "needs a servo rig; tests/rig_verbs.rs runs it on mocks"),
    ("rig watch", "needs a servo rig; tests/rig_verbs.rs runs it on mocks"),
    ("rig stop", "needs a servo rig; tests/rig_verbs.rs runs it on mocks"),
    ("rig clear", "needs a servo rig; tests/rig_verbs.rs runs it on mocks"),
    ("rig calibrate", "needs a session of moving axes; tests/compare/stand.rs makes one"),
    ("sensor", "needs a live sensor; tests/sensor_setup.rs has mocks"),
    ("record", "needs live sensors; tests/session has mocks"),
    ("daemon", "serves until it is stopped; tests/daemon runs it"),
    ("view", "serves until it is stopped; tests/view.rs runs it"),
    ("mock rig", "serves until it is stopped; tests/rig_verbs.rs runs it"),
    ("mock sensor", "sends until it is stopped; tests/closed_loop.rs runs it"),
    ("replay walk --to 192.168", "sends to another machine"),
    ("doctor", "judges this machine; tests/config.rs runs it"),
    ("study published", "hours"),
    ("study run", "hours"),
    ("study methods", "hours"),
    ("study sensor-count", "hours"),
    ("study joint", "minutes"),
    ("demo", "tests/demo.rs runs it"),
    ("boresight", "minutes; tests/compare runs it"),
    ("odometry", "a minute; tests/compare runs it"),
];

/// What makes a line quick: its verb, what it has, and what is added.
const QUICKER: &[(&str, &str, &str)] = &[
    ("optimize", "--robust", "--evals 4"),
    ("optimize", "--preset", "--evals 4 --final-look off"),
    ("optimize", "", "--evals 4 --azimuths 32 --voxel 1 --scan-stride 10"),
    ("predict", "--preset", ""),
    ("predict", "--room", "--azimuths 32 --voxel 1 --fidelity given"),
    ("predict", "--ideal", "--azimuths 32 --voxel 1 --sample-count 1000"),
    ("predict", "", "--azimuths 32 --voxel 1 --fidelity given --sample-count 1000"),
    // without a trajectory: minutes of odometry, of which tests/compare has plenty
    ("compare", "", "--nulls 0 --voxel 1 --trajectory walk.tum"),
    ("study", "", "--seeds 1 --quick"),
    ("replay", "", "--rate max"),
];

fn outrigger(folder: &Path, arguments: &[String]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_outrigger"));
    command.current_dir(folder).args(arguments);
    for name in ["OUTRIGGER_JSON", "OUTRIGGER_PRESET", "OUTRIGGER_CONFIG", "OUTRIGGER_RIG_PORT"] {
        command.env_remove(name);
    }
    command.output().unwrap()
}

fn words(line: &str) -> Vec<String> {
    line.split_whitespace().map(str::to_owned).collect()
}

fn help_of(verb: &str) -> String {
    let output = outrigger(Path::new("."), &words(&format!("{verb} --help")));
    String::from_utf8(output.stdout).unwrap()
}

fn verbs_within(help: &str) -> Vec<&str> {
    let Some((_, commands)) = help.split_once("Commands:\n") else { return Vec::new() };
    let verb = |line: &'_ str| line.strip_prefix("  ").filter(|line| !line.starts_with(' ')).is_some();
    commands
        .lines()
        .take_while(|line| !line.is_empty())
        .filter(|line| verb(line))
        .filter_map(|line| line.split_whitespace().next())
        .collect()
}

fn help_is_short_and_ends_in_examples() {
    let program = help_of("");
    let verbs = verbs_within(&program);
    assert!(verbs.len() <= MAX_VERBS && verbs.len() > 10, "{verbs:?}");
    let mut flags = std::collections::BTreeSet::new();
    let mut leaves = 0;
    for verb in verbs {
        let help = help_of(verb);
        let within = verbs_within(&help).into_iter().map(|name| (format!("{verb} {name}"), String::new()));
        let mut pages: Vec<(String, String)> = within.collect();
        if pages.is_empty() {
            pages.push((verb.to_owned(), help.clone()));
        }
        for (name, page) in pages {
            let page = if page.is_empty() { help_of(&name) } else { page };
            leaves += 1;
            let lines: Vec<&str> = page.trim_end().lines().collect();
            assert!(lines.len() <= MAX_LINES, "{name} --help has {} lines", lines.len());
            let [.., title, first, second] = lines[..] else { panic!("{page}") };
            let is_example = |line: &str| line.starts_with(&format!("  outrigger {name}"));
            assert!(title == "Examples:" && is_example(first) && is_example(second), "{page}");
            let long = lines.iter().filter_map(|line| {
                let line = line.trim_start();
                let line = line
                    .strip_prefix('-')
                    .filter(|line| !line.starts_with('-'))
                    .map_or(line, |line| &line[3..]);
                line.trim_start().strip_prefix("--")?.split(|c: char| !c.is_alphanumeric() && c != '-').next()
            });
            flags.extend(long.map(str::to_owned));
        }
    }
    assert!(flags.len() <= MAX_FLAGS && flags.len() > 40, "{} flags: {flags:?}", flags.len());
    assert_eq!(leaves, help::EXAMPLES.len(), "an example for each verb, and no other");
    let all = String::from_utf8(outrigger(Path::new("."), &words("optimize --help-all")).stdout).unwrap();
    assert!(
        all.contains("Expert:") && all.contains("--certify") && !help_of("optimize").contains("--certify")
    );
}

fn names_of_other_programs_lead_to_ours() {
    for (line, ours) in [
        ("viz", "view"),
        ("slice", "cut"),
        ("convert", "decode"),
        ("info", "inspect"),
        ("evaluate", "predict --preset"),
        ("validate", "predict --scene MESH --ideal"),
        ("stand", "rig calibrate"),
        ("inspekt", "inspect"),
        ("predict --mesh house.ply", "--scene"),
        ("predict --wearer 1", "--operator"),
        ("decode --metta a.json", "--meta"),
    ] {
        let output = outrigger(Path::new("."), &words(line));
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{line}: {text}");
        assert!(text.contains(&format!("'{ours}'")), "{line}: {text}");
    }
}

/// Where a line stands, and the words behind `outrigger`.
fn lines_shown() -> Vec<(String, String)> {
    let of_help = help::EXAMPLES.iter().flat_map(|(verb, examples)| {
        examples.iter().map(move |line| (format!("{verb} --help"), (*line).to_owned()))
    });
    let mut lines: Vec<(String, String)> = of_help.collect();
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut pages = vec![root.join("README.md")];
    let docs = std::fs::read_dir(root.join("docs")).unwrap().map(|entry| entry.unwrap().path());
    pages.extend(docs.filter(|path| path.extension().is_some_and(|ending| ending == "md")));
    pages.sort();
    for page in pages {
        let text = std::fs::read_to_string(&page).unwrap().replace("\\\n", " ");
        let name = page.file_name().unwrap().to_string_lossy().into_owned();
        let mut is_shell = false;
        for line in text.lines() {
            if let Some(kind) = line.trim_start().strip_prefix("```") {
                is_shell = !is_shell && kind == "sh";
                continue;
            }
            let command = line.split(" #").next().unwrap_or_default().trim();
            let command = [" | ", " > ", "; "]
                .iter()
                .fold(command, |command, end| command.split(end).next().unwrap_or_default());
            if let Some(command) = command.strip_prefix("outrigger ").filter(|_| is_shell) {
                lines.push((name.clone(), command.trim().to_owned()));
            }
        }
    }
    assert!(lines.iter().any(|(page, _)| page == "README.md"), "README.md shows commands in ```sh blocks");
    lines
}

fn every_command_line_parses() {
    for (page, line) in lines_shown() {
        let typed = std::iter::once("outrigger".to_owned()).chain(shell_words(&line));
        let parsed = help::command().try_get_matches_from(typed);
        assert!(parsed.is_ok(), "{page}: outrigger {line}: {}", parsed.unwrap_err());
    }
}

/// Words of a line; quotation marks hold spaces.
fn shell_words(line: &str) -> Vec<String> {
    let parts = line.split('"').enumerate();
    let mut words: Vec<String> = vec![String::new()];
    for (index, part) in parts {
        let mut first = true;
        for word in part.split(|c: char| index % 2 == 0 && c.is_whitespace()) {
            if !std::mem::replace(&mut first, false) {
                words.push(String::new());
            }
            words.last_mut().unwrap().push_str(word);
        }
    }
    words.retain(|word| !word.is_empty());
    words
}

const START_NS: u64 = 1_763_722_223_000_000_000;
/// Low and high corner of the room, m.
const ROOM_M: [DVec3; 2] = [DVec3::new(-4.0, -3.0, -1.6), DVec3::new(5.0, 3.5, 1.4)];

/// What the lines name: a recorded walk through a room, its capture, metadata, mount, trajectory, and the room as a mesh.
fn small_data(folder: &Path) {
    let path = |name: &str| folder.join(name);
    let trajectory =
        Trajectory::straight(DVec3::new(-1.0, 0.0, 0.0), DVec3::new(1.0, 0.0, 0.0), 1.0, START_NS);
    std::fs::write(path("walk.tum"), trajectory.to_tum()).unwrap();
    let entry = |name: &str, side: f64| SensorEntry {
        name: name.into(),
        model: "os1-64".into(),
        x_m: 0.1 * side,
        pitch_deg: 20.0 * side,
        ..SensorEntry::default()
    };
    let mount = MountFile::new(vec![entry("left", -1.0), entry("right", 1.0)]);
    mount.write(&path("mount.json")).unwrap();
    record(&path("walk"), &mount, &trajectory);
    for (from, to) in [("left", "sensor"), ("left", "left"), ("right", "right")] {
        std::fs::copy(path(&format!("walk/metadata/{from}.json")), path(&format!("{to}.json"))).unwrap();
    }
    let mut mesh = "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\nelement face 6\n\
                    property list uchar int vertex_indices\nend_header\n"
        .to_owned();
    for corner in 0..8_usize {
        let [x, y, z] = [0, 1, 2].map(|axis| ROOM_M[corner >> axis & 1][axis]);
        mesh += &format!("{x} {y} {z}\n");
    }
    for quad in ["0 1 3 2", "4 5 7 6", "0 1 5 4", "2 3 7 6", "0 2 6 4", "1 3 7 5"] {
        mesh += &format!("4 {quad}\n");
    }
    std::fs::write(path("house.ply"), mesh).unwrap();
    for line in ["cut walk -o capture.pcap", "init"] {
        let output = outrigger(folder, &words(line));
        assert!(output.status.success(), "{line}: {}", String::from_utf8_lossy(&output.stderr));
    }
}

/// A session of two Ousters along a trajectory.
fn record(session: &Path, mount: &MountFile, trajectory: &Trajectory) {
    let scene = Scene::Box(BoxScene::closed(ROOM_M[0], ROOM_M[1]));
    let metadata = |sensor: usize| {
        let serial = 122_000_000_001 + sensor as u64;
        let wanted = Synthetic::new("os1-64", serial, Profile::Rng19Rfl8Sig16Nir16);
        Metadata::synthetic(&wanted.columns(512, 16)).unwrap()
    };
    let destination = |sensor: usize| SocketAddr::from(([10, 0, 0, 100], 7502 + 2 * sensor as u16));
    let info = |(sensor, name): (usize, &str)| SensorInfo {
        name: name.into(),
        address: Some(destination(sensor)),
        metadata: Some(metadata(sensor).to_json()),
        ..SensorInfo::default()
    };
    let infos: Vec<SensorInfo> = ["left", "right"].into_iter().enumerate().map(info).collect();
    let writer = SessionWriter::create(session, &infos).unwrap();
    let rig = mount.rig().unwrap();
    let mounts = rig.sensors.iter().enumerate();
    let sent = mounts.map(|(sensor, mounted)| (metadata(sensor), mounted.mount, destination(sensor)));
    Walk { scene: &scene, trajectory, noise_m: 0.01, seed: 3 }.write(&writer, sent);
    writer.put_mount(mount, &[]).unwrap();
    writer.put_trajectory(trajectory).unwrap();
    writer.close(None).unwrap();
}

fn every_command_line_runs_on_small_data() {
    let folder = tempfile::tempdir().unwrap();
    small_data(folder.path());
    let (mut faults, mut ran) = (Vec::new(), 0);
    for (page, line) in lines_shown() {
        if PARSED_ONLY.iter().any(|(begin, _)| line.starts_with(begin)) {
            continue;
        }
        let mut arguments = shell_words(&line);
        let is_meant = |(verb, part, _): &&(&str, &str, &str)| line.starts_with(verb) && line.contains(part);
        let more = QUICKER.iter().find(is_meant).map_or("", |(_, _, more)| more);
        for pair in words(more).chunks(2) {
            if !arguments.contains(&pair[0]) {
                arguments.extend_from_slice(pair);
            }
        }
        if ["decode", "cut", "init"].iter().any(|verb| line.starts_with(verb)) && !line.contains("--force") {
            arguments.push("--force".into());
        }
        let output = outrigger(folder.path(), &arguments);
        ran += 1;
        if !matches!(output.status.code(), Some(0 | 3)) {
            faults.push(format!(
                "{page}: outrigger {}: {}",
                arguments.join(" "),
                String::from_utf8_lossy(&output.stderr)
            ));
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
    assert!(ran > 20, "{ran}");
}

fn a_recording_makes_a_rig_file() {
    let folder = tempfile::tempdir().unwrap();
    small_data(folder.path());
    let run = |line: &str| outrigger(folder.path(), &words(line));
    let made = run("init rig --from walk --json");
    let document: serde_json::Value = crate::support::document(&made.stdout).unwrap();
    assert_eq!(document["files"].as_array().unwrap().len(), 3, "two sensors' metadata: {document}");
    let text = std::fs::read_to_string(folder.path().join("rig/rig.toml")).unwrap();
    assert_eq!(text.matches("\n[[sensor]]\n").count(), 2, "{text}");
    assert_eq!(text.matches("\nmodel = \"os1-64\"\nlisten = 750").count(), 2, "{text}");
    // the metadata are the recording's: the capture decodes with them
    let [sensor, made] = ["capture.pcap --config rig/rig.toml", "walk"].map(|what| {
        let output = run(&format!("decode {what} --json"));
        let document: serde_json::Value = crate::support::document(&output.stdout).unwrap();
        document["sensors"]
            .as_array()
            .unwrap()
            .iter()
            .map(|sensor| sensor["totals"]["points"].as_u64().unwrap())
            .sum::<u64>()
    });
    assert!(sensor > 0 && sensor == made, "{sensor} {made}");
    let none = run("init none --from mount.json");
    assert_eq!(none.status.code(), Some(1));
    assert!(!folder.path().join("none").exists(), "nothing is left of what failed");
    let unneeded = run("init other --meta sensor.json");
    assert_eq!(unneeded.status.code(), Some(2));
}
