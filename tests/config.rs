//! `rig.toml` as a user meets it: written by `init`, read by every verb, outdone by flags and environment.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

use crate::support::{Case, case};

pub const CASES: &[Case] = &[
    case("what_init_writes_is_taken", what_init_writes_is_taken),
    case("flag_wins_over_environment_over_file", flag_wins_over_environment_over_file),
    case("mistakes_are_named_with_their_line", mistakes_are_named_with_their_line),
    case("sensors_of_the_file_are_recorded", sensors_of_the_file_are_recorded),
];

const MASTER: &str = "0.06,0.0,0.0,25,0";

fn outrigger(arguments: &[&str], environment: &[(&str, &str)]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_outrigger"));
    command.args(arguments).envs(environment.iter().copied()).output().unwrap()
}

fn json(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{output:?}"))
}

/// A file with these lines below its format.
fn file(folder: &Path, text: &str) -> PathBuf {
    let path = folder.join("rig.toml");
    std::fs::write(&path, format!("format = \"outrigger-rig/1\"\n{text}")).unwrap();
    path
}

fn what_init_writes_is_taken() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path().join("new");
    let written = outrigger(&["init", dir.to_str().unwrap()], &[]);
    assert!(written.status.success(), "{written:?}");
    let path = dir.join("rig.toml");
    let path = path.to_str().unwrap();
    let again = outrigger(&["init", dir.to_str().unwrap()], &[]);
    assert_eq!(again.status.code(), Some(1));
    assert!(String::from_utf8(again.stderr).unwrap().contains("rig.toml exists already"));
    let by_file = json(&outrigger(&["evaluate", "--config", path, "--masters", MASTER, "--json"], &[]));
    let by_flags = json(&outrigger(
        &["evaluate", "--preset", "paper-os1-64", "--path", "forward", "--masters", MASTER, "--json"],
        &[],
    ));
    assert_eq!(by_file["objective"], by_flags["objective"]);
    let rig = outrigger(&["rig", "status", "--config", path], &[]);
    assert!(String::from_utf8(rig.stderr).unwrap().contains("which rig?"), "the template names no port");
}

fn flag_wins_over_environment_over_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = file(folder.path(), "[rig]\nport = \"of_the_file\"\n");
    let path = path.to_str().unwrap();
    let tried = |arguments: &[&str], environment: &[(&str, &str)]| {
        let arguments = [&["rig", "status"], arguments].concat();
        String::from_utf8(outrigger(&arguments, environment).stderr).unwrap()
    };
    let by_file = tried(&["--config", path], &[]);
    let resolved = folder.path().join("of_the_file");
    assert!(by_file.contains(resolved.to_str().unwrap()), "a path is relative to its file: {by_file}");
    let in_environment = ("OUTRIGGER_RIG_PORT", "/of_the_environment");
    assert!(tried(&["--config", path], &[in_environment]).contains("/of_the_environment"));
    assert!(tried(&["--config", path, "--port", "/of_the_flag"], &[in_environment]).contains("/of_the_flag"));
    assert!(tried(&[], &[("OUTRIGGER_CONFIG", path)]).contains("of_the_file"));
}

fn mistakes_are_named_with_their_line() {
    let folder = tempfile::tempdir().unwrap();
    for (text, code, words) in [
        ("[fly]\n", 1, "rig.toml:2: no verb is called `fly`; known are"),
        ("[mock.plane]\n", 1, "rig.toml:2: no verb is called `mock plane`; known are rig, sensor"),
        ("[evaluate]\nspeed = 3\n", 1, "rig.toml:3: [evaluate] has no key `speed`; known are"),
        ("[rig]\n\narm = 3\n", 1, "rig.toml:4: `arm` is true or false"),
        ("[rig]\nport = [\"a\", \"b\"]\n", 1, "rig.toml:3: `port` is one value, not an array"),
        ("[evaluate]\npath = \"up\"\n", 2, "rig.toml:3, 'path'"),
        ("[evaluate]\nazimuths = \"many\"\n", 2, "rig.toml:3, 'azimuths'"),
        ("[evaluate\n", 1, "rig.toml:2: "),
    ] {
        let path = file(folder.path(), text);
        let output = outrigger(&["evaluate", "--masters", MASTER, "--config", path.to_str().unwrap()], &[]);
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(
            output.status.code() == Some(code) && said.contains(words),
            "{text}: {:?} {said}",
            output.status
        );
    }
    let missing = outrigger(&["man", "--config", "no-such.toml"], &[]);
    assert_eq!(missing.status.code(), Some(1));
    assert!(String::from_utf8(missing.stderr).unwrap().contains("cannot read no-such.toml"));
}

fn sensors_of_the_file_are_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let path = file(
        folder.path(),
        "[[sensor]]\nname = \"left\"\nmodel = \"os1-64\"\nlisten = \"127.0.0.1:0\"\nlisten_aside = \"127.0.0.1:0\"\n\
         [[sensor]]\nname = \"right\"\nmodel = \"vlp-16\"\nlisten = \"127.0.0.1:0\"\n\
         [record]\nout = \"session\"\nduration = 0.2\n",
    );
    let output = outrigger(&["record", "--json", "--config", path.to_str().unwrap()], &[]);
    assert_eq!(output.status.code(), Some(3), "no packet came: {output:?}");
    let document = json(&output);
    let names: Vec<_> =
        document["sensors"].as_array().unwrap().iter().map(|sensor| &sensor["name"]).collect();
    assert_eq!(names, ["left", "left-aside", "right"]);
    assert!(folder.path().join("session/packets.pcapng").exists());
    let without = outrigger(&["record"], &[]);
    assert!(String::from_utf8(without.stderr).unwrap().contains("--config RIG.toml"));
}
