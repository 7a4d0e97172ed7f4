//! Limits of the process: the size of a file, the number of open files.

use std::path::Path;
use std::process::{Command, Output};

use outrigger::recording::{Manifest, Session, file};

use super::crash::Recorder;
use super::round_trip::packets_of;
use super::{payloads, sender};

/// The program under a limit that the shell sets, without the open files that whoever starts the tests hands on: they count too.
fn limited(limit: &str) -> Command {
    let close =
        "for open in /proc/$$/fd/*; do open=${open##*/}; [ $open -le 2 ] || eval \"exec $open>&-\"; done";
    let mut command = Command::new("bash");
    let script = format!("{close}; ulimit {limit}; exec \"$0\" \"$@\"");
    command.args(["-c", &script]).arg(env!("CARGO_BIN_EXE_outrigger"));
    command
}

fn message(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

pub fn a_file_that_may_not_grow_ends_the_session_in_order() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path().join("walk");
    let mut command = limited("-f 200"); // 100 KiB or 200, as the shell counts
    command.args(["record", "--listen", "a=127.0.0.1:0", "--out"]).arg(&dir);
    let mut recorder = Recorder::start(command);
    let (from, sent) = (sender(), payloads(2000, 21));
    let mut stream = sent.iter();
    while recorder.child.try_wait().unwrap().is_none() {
        for payload in stream.by_ref().take(5) {
            from.send_to(payload, &recorder.address).unwrap();
        }
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    let (code, _, message) = recorder.end();
    assert_eq!(code, Some(1), "an error, and no signal: {message}");
    let path = dir.join(file::PACKETS);
    assert!(message.contains(&format!("{} is as large as a file may be", path.display())), "{message}");
    let session = Session::open(&dir).unwrap();
    let manifest = session.manifest();
    assert!(!manifest.complete && manifest.losses.not_written > 0, "{manifest:?}");
    assert_eq!(session.problems().len(), 1, "no digest differs: {:?}", session.problems());
    let found = packets_of(&session).remove(&0).unwrap();
    assert_eq!(manifest.sensors[0].packets, found.len() as u64);
    assert!(found.iter().zip(&sent).all(|(found, sent)| found == sent));
    let bytes = std::fs::metadata(&path).unwrap().len();
    assert!(bytes > 60 << 10 && bytes <= 200 << 10, "{bytes}");
}

pub fn what_cannot_be_written_is_an_error_of_every_verb() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let write = |arguments: &[&str]| limited("-f 0").args(arguments).output().unwrap();
    for arguments in [
        vec!["init", &path("rig.toml")],
        vec!["record", "--listen", "a=127.0.0.1:0", "--duration", "1", "--out", &path("walk")],
        vec!["demo", "--out", &path("demo")],
        vec!["mock", "rig", "--faults"],
    ] {
        let output = write(&arguments);
        let message = message(&output);
        assert!(matches!(output.status.code(), Some(1 | 2)), "{arguments:?}: {:?} {message}", output.status);
        assert!(!message.contains("panicked"), "{arguments:?}: {message}");
    }
    assert!(!folder.path().join("walk").exists() && !folder.path().join("rig.toml").exists());
}

fn ended_in_order(dir: &Path, output: &Output, limit: u32) -> bool {
    let message = message(output);
    assert!(!message.contains("panicked"), "{limit} files: {message}");
    match output.status.code() {
        // no packet came: what the recorder says with 3
        Some(0 | 3) => {
            assert!(Manifest::read(dir).unwrap().complete, "{limit} files: {message}");
            true
        }
        Some(1) => {
            assert!(message.contains("files") || message.contains("os error 24"), "{limit} files: {message}");
            assert!(
                !dir.exists() || !Session::open(dir).unwrap().manifest().complete,
                "{limit} files: {message}"
            );
            false
        }
        // not even the libraries of the program could be opened
        Some(127) if limit < 5 => false,
        other => panic!("{limit} files: {other:?} {message}"),
    }
}

pub fn too_few_files_are_an_error_and_no_panic() {
    let folder = tempfile::tempdir().unwrap();
    let mut outcomes = Vec::new();
    for limit in [4, 6, 8, 10, 12, 14, 16, 20, 24, 28, 32, 40, 64] {
        let dir = folder.path().join(limit.to_string());
        let mut command = limited(&format!("-n {limit}"));
        command.args(["record", "--listen", "a=127.0.0.1:0", "--listen", "b=127.0.0.1:0"]);
        let output = command.args(["--duration", "0.1", "--out"]).arg(&dir).output().unwrap();
        outcomes.push(ended_in_order(&dir, &output, limit));
    }
    assert!(!outcomes[2] && outcomes[12], "8 are too few, 64 enough: {outcomes:?}");
    assert!(!folder.path().join("8").exists(), "nothing is left of a session that could not begin");
}
