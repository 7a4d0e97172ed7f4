//! The program as a user meets it: flags, exit codes, JSON documents, messages.

use std::process::{Command, Output};

use sensors::capture::PcapWriter;

use crate::support::{Case, case};

pub const CASES: &[Case] = &[
    case("wrong_usage_is_exit_code_2", wrong_usage_is_exit_code_2),
    case("every_verb_explains_itself", every_verb_explains_itself),
    case("manual_and_completions_are_printed", manual_and_completions_are_printed),
    case("every_verb_has_a_page_of_its_own", every_verb_has_a_page_of_its_own),
    case("pages_that_the_service_names_are_printed", pages_that_the_service_names_are_printed),
    case("a_missing_or_wrong_file_is_named", a_missing_or_wrong_file_is_named),
    case("a_closed_pipe_is_no_panic", a_closed_pipe_is_no_panic),
];

fn outrigger(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_outrigger")).args(arguments).output().unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn wrong_usage_is_exit_code_2() {
    for arguments in [
        &["predict", "--presett", "paper-os1-64"][..],
        &["no-such-verb"],
        &["predict", "--preset", "paper-os1-64", "--masters", "0,0,0,NaN,0"],
        &["predict", "--preset", "paper-os1-64", "--masters", "0,0,0,5"],
        &["optimize", "--preset", "paper-os1-64", "--pitch-limits", "30,10"],
        &["decode"],
        // what has no use, and what does not fit together: told before a file is read
        &["predict", "--mount", "none", "--trajectory", "none", "--room=0,0,0,1,1,1", "--map-voxel", "0.2"],
        &["predict", "--mount", "none", "--trajectory", "none", "--room=0,0,0,1,1,1", "--up", "y"],
        &["compare", "none", "--room=0,0,0,1,1,1", "--map-hits", "3"],
        &["compare", "none", "--map-frames", "0..2", "--mesh-unit", "mm"],
        &["compare", "none", "--room=0,0,0,1,1,1", "--trajectory", "still", "--rate", "10"],
        &["compare", "none", "--room=0,0,0,1,1,1", "--trajectory", "still", "--odometry-voxel", "1"],
        &["compare", "none", "--map-frames", "0..2", "--align"],
        &["compare", "none", "--room=0,0,0,1,1,1", "--voxel", "0"],
        &["boresight", "none", "--trajectory", "still", "--odometry-voxel", "1"],
        &["boresight", "none", "--pose-sd", "0"],
        &["predict", "--masters", "0,0,0,5,0"],
        &["predict", "--preset", "paper-os9", "--masters", "0,0,0,5,0"],
        &["predict", "--preset", "paper-os1-64", "--masters", "0,0,0,5,0", "--voxel", "0.3"],
        &["predict", "--preset", "paper-os1-64", "--masters", "0,0,0,5,0", "--divergence", "1"],
        &["predict", "--mount", "none", "--no-mirror"],
        &["predict", "--room=0,0,0,1,1,1"],
        &["predict", "--sensors", "vlp-16", "--room=0,0,0,1,1,1", "--no-mirror"],
        &["predict", "--sensors", "vlp-16,vlp-16", "--room=0,0,0,1,1,1"],
        &["predict", "--sensors", "vlp-16", "--room=0,0,0,1,1,1", "--preset", "paper-vlp-16"],
        &["optimize", "--preset", "paper-os1-64", "--lambda", "vlp-16=1"],
        &["study", "unheard-of"],
        &["study", "joint"],
        &["study", "run", "published", "--seeds", "3"],
        &["study", "published", "--shards", "3"],
        &["daemon"],
        &["record"],
        &["rig", "status"],
        &["sensor", "info"],
        &["sensor", "configure", "127.0.0.1"],
        &["replay", "none", "--to", "127.0.0.1", "--map", "1=2", "--map", "1=3"],
        &["mock", "rig", "--dynamixel", "--fault", "reboot@1"],
        &["mock", "sensor", "--model", "vlp-16", "--to", "127.0.0.1:9", "--box=1,0,0,0,1,1"],
        &["mount", "none", "--drawing", "mount.png"],
        &["view", "none", "--listen", "192.0.2.1:80"],
        &["decode", "none", "--meta", "192.168.1.10="],
        &["predict", "--sensors", "vlp-16", "--room=0,0,0,1,1,1", "--operator=0,0,0,0,0,1,0"],
        &["man", "fly"],
    ] {
        let output = outrigger(arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", stderr(&output));
        assert!(output.stdout.is_empty() && !output.stderr.is_empty(), "{arguments:?}");
    }
}

fn verbs() -> Vec<String> {
    let help = outrigger(&["--help"]);
    let text = String::from_utf8(help.stdout).unwrap();
    let commands = text.split("Commands:").nth(1).unwrap().split("Options:").next().unwrap();
    let verb = |line: &str| line.strip_prefix("  ")?.split_whitespace().next().map(str::to_owned);
    commands.lines().filter(|line| !line.starts_with("   ")).filter_map(verb).collect()
}

fn every_verb_explains_itself() {
    let verbs = verbs();
    assert!(verbs.len() > 10, "{verbs:?}");
    for verb in &verbs {
        let output = outrigger(&[verb, "--help"]);
        assert!(output.status.success(), "{verb}");
        assert!(output.stdout.len() > 100, "{verb} says nothing about itself");
    }
}

fn manual_and_completions_are_printed() {
    let manual = String::from_utf8(outrigger(&["man"]).stdout).unwrap();
    let completions = String::from_utf8(outrigger(&["completions", "bash"]).stdout).unwrap();
    assert!(manual.contains(".TH outrigger"), "{manual}");
    for verb in verbs() {
        assert!(completions.contains(&verb), "{verb}");
        assert!(manual.contains(&verb), "{verb}");
    }
}

fn every_verb_has_a_page_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let pages = folder.path().join("man");
    assert!(outrigger(&["man", "--pages", pages.to_str().unwrap()]).status.success());
    for name in
        std::iter::once("outrigger".to_owned()).chain(verbs().iter().map(|verb| format!("outrigger-{verb}")))
    {
        let page = std::fs::read_to_string(pages.join(format!("{name}.1"))).unwrap();
        assert!(page.contains(&format!(".TH {name} 1")), "{name}: {page:.300}");
    }
    assert!(pages.join("outrigger-rig-status.1").exists(), "verbs within verbs too");
}

fn pages_that_the_service_names_are_printed() {
    let unit = include_str!("../src/packaging/outrigger.service");
    let named: Vec<&str> = unit
        .lines()
        .filter_map(|line| line.strip_prefix("Documentation="))
        .flat_map(str::split_whitespace)
        .map(|page| page.strip_prefix("man:").and_then(|page| page.strip_suffix("(1)")).unwrap())
        .collect();
    assert!(!named.is_empty());
    for page in named {
        let verb = page.strip_prefix("outrigger-").unwrap();
        let text = String::from_utf8(outrigger(&["man", verb]).stdout).unwrap();
        assert!(text.contains(&format!(".TH {page} 1")), "{page}: {text:.300}");
        assert!(unit.contains(&format!("outrigger man {verb} > ")), "how {page} is installed is said");
    }
    let wrong = outrigger(&["man", "fly"]);
    let said = String::from_utf8_lossy(&wrong.stderr).into_owned();
    assert!(wrong.status.code() == Some(2) && said.contains("fly") && said.contains("daemon"), "{said}");
}

fn a_missing_or_wrong_file_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let nan = folder.path().join("nan.json");
    let sensor = r#"{"name":"a","model":"os1-64","x_m":NaN,"y_m":0,"z_m":0,"pitch_deg":0,"roll_deg":0}"#;
    let frame = "mount: x right, y forward, z up";
    std::fs::write(
        &nan,
        format!("{{\"format\":\"outrigger-mount/1\",\"frame\":\"{frame}\",\"sensors\":[{sensor}]}}"),
    )
    .unwrap();
    let nan = nan.to_str().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (mount, walk, capture) = (path("mount.json"), path("walk.tum"), path("empty.pcap"));
    std::fs::write(&mount, std::fs::read_to_string(nan).unwrap().replace("NaN", "0")).unwrap();
    std::fs::write(&walk, "0 0 0 1 0 0 0 1\n1 1 0 1 0 0 0 1\n").unwrap();
    let _header = PcapWriter::new(std::fs::File::create(&capture).unwrap()).unwrap();
    let elsewhere = ["predict", "--mount", &mount, "--trajectory", &walk, "--scene", "Cargo.toml"];
    for (arguments, named) in [
        (&["decode", "no-such.pcap"][..], "no-such.pcap"),
        (&["inspect", "no-such.pcap"], "no-such.pcap"),
        (&["decode", "none.mcap", "--frame", "world", "-o", "none.laz"], "none.mcap: No such file"),
        (&["boresight", "no-such-session"], "no-such-session: No such file"),
        (&["rig", "calibrate", "no-such-session"], "no-such-session: No such file"),
        (&["compare", "no-such-session", "--room=-5,-4,0,5,4,3"], "no-such-session: No such file"),
        (&["boresight", "Cargo.toml"], "Cargo.toml is no capture"),
        (&["compare", "Cargo.toml", "--room=-5,-4,0,5,4,3"], "Cargo.toml is no capture"),
        (&["boresight", &capture], "empty.pcap: no LiDAR data was decoded"),
        (&elsewhere, "expected a session, a mesh (.obj, .ply, .stl, .gltf, .glb, .off) or a cloud (.ply"),
        (&["rig", "status", "--port", "Cargo.toml"], "cannot open Cargo.toml: it is no serial device"),
        (
            &["rig", "status", "--port", "dynamixel:Cargo.toml@57600:1,2"],
            "cannot open Cargo.toml: it is no serial",
        ),
        (&["decode", "Cargo.toml"], "Cargo.toml"),
        (&["inspect", "src"], "src: a folder without manifest.json; expected a capture file, or a session"),
        (&["predict", "--preset", "paper-os1-64", "--mount", nan], "nan.json"),
        (&["predict", "--preset", "paper-os1-64", "--mount", nan], "x_m"),
        // before the search, not after it
        (&["optimize", "--evals", "100000", "--out", "no-such/m.json"], "cannot write no-such/m.json"),
        (&["optimize", "--evals", "100000", "--report", "src"], "cannot write src: it is a folder"),
    ] {
        let output = Command::new(env!("CARGO_BIN_EXE_outrigger"))
            .args(arguments)
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .output()
            .unwrap();
        assert_eq!(output.status.code(), Some(1), "{arguments:?}: {}", stderr(&output));
        assert!(stderr(&output).contains(named), "{arguments:?}: {}", stderr(&output));
        assert!(output.stdout.is_empty(), "{arguments:?}");
    }
}

fn a_closed_pipe_is_no_panic() {
    for arguments in [
        &["predict", "--preset", "paper-vlp-16", "--masters", "0.1,0,0,20,0", "--json"][..],
        &["completions", "bash"],
        &["man", "predict"],
        &["man", "--keys"],
    ] {
        let mut child = Command::new(env!("CARGO_BIN_EXE_outrigger"))
            .args(arguments)
            .stdout(std::process::Stdio::piped())
            .stderr(std::process::Stdio::piped())
            .spawn()
            .unwrap();
        drop(child.stdout.take());
        let output = child.wait_with_output().unwrap();
        assert!(output.status.success() && output.stderr.is_empty(), "{arguments:?}: {}", stderr(&output));
    }
}
