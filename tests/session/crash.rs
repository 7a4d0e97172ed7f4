//! Recordings that ended badly: cut, killed, out of space.

use std::io::{BufRead as _, BufReader, Read as _};
use std::path::Path;
use std::process::{Child, Command, Stdio};

use outrigger::recording::{Session, file};

use super::round_trip::{packets_of, record_two};
use super::{payloads, sender, wait_until};

pub fn a_recording_cut_at_any_byte_opens() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path().join("whole");
    let streams = [1, 2].map(|seed| {
        let mut stream = payloads(12, seed);
        stream.iter_mut().for_each(|payload| payload.truncate(100 + payload.len() % 7));
        stream
    });
    record_two(&dir, [&streams[0], &streams[1]]);
    let whole = std::fs::read(dir.join(file::PACKETS)).unwrap();
    let ends = block_ends(&whole);
    let head = ends[2]; // section header and two interfaces
    let packets = std::fs::File::options().write(true).open(dir.join(file::PACKETS)).unwrap();
    for cut in (0..whole.len()).rev() {
        packets.set_len(cut as u64).unwrap();
        let session = Session::open(&dir).unwrap();
        assert!(session.problems().join(";").contains("packets.pcapng"), "{cut}: {:?}", session.problems());
        if cut < head {
            continue; // a recorder writes these before it says that it is ready
        }
        let found = packets_of(&session);
        let count: usize = found.values().map(Vec::len).sum();
        let expected = ends.iter().skip(3).filter(|end| **end <= cut).count().min(24);
        assert_eq!(count, expected, "cut at byte {cut} of {}", whole.len());
        for (sensor, packets) in found {
            assert!(packets.iter().zip(&streams[sensor]).all(|(found, sent)| found == sent));
        }
    }
}

/// Where each block of a pcapng file ends.
fn block_ends(content: &[u8]) -> Vec<usize> {
    let mut ends = Vec::new();
    let mut at = 0;
    while at < content.len() {
        at += u32::from_le_bytes(content[at + 4..at + 8].try_into().unwrap()) as usize;
        ends.push(at);
    }
    ends
}

/// A running `outrigger record` and the address it listens on.
pub struct Recorder {
    pub child: Child,
    pub address: String,
}

impl Recorder {
    /// Starts a program that becomes the recorder and waits until it listens.
    pub fn start(mut command: Command) -> Self {
        let mut child = command.stderr(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
        let mut said = BufReader::new(child.stderr.take().unwrap());
        let mut address = None;
        while address.is_none() {
            let mut line = String::new();
            assert!(said.read_line(&mut line).unwrap() > 0, "the recorder ended before it listened");
            address = line.trim_end().split_once("listening on ").map(|(_, address)| address.to_owned());
        }
        child.stderr = Some(said.into_inner());
        Self { child, address: address.unwrap() }
    }

    /// Starts `outrigger record` of one sensor into a folder.
    pub fn of(dir: &Path) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_outrigger"));
        command.args(["record", "--listen", "a=127.0.0.1:0", "--out"]).arg(dir);
        Self::start(command)
    }

    /// Waits for the end: exit code, and what was said on stdout and, since listening, on stderr.
    pub fn end(mut self) -> (Option<i32>, String, String) {
        let (mut stdout, mut stderr) = (String::new(), String::new());
        self.child.stdout.take().unwrap().read_to_string(&mut stdout).unwrap();
        self.child.stderr.take().unwrap().read_to_string(&mut stderr).unwrap();
        (self.child.wait().unwrap().code(), stdout, stderr)
    }
}

pub fn a_killed_recorder_leaves_a_session_that_opens() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path().join("walk");
    let mut recorder = Recorder::of(&dir);
    let (from, sent) = (sender(), payloads(200, 3));
    for payload in &sent[..100] {
        from.send_to(payload, &recorder.address).unwrap();
        std::thread::sleep(std::time::Duration::from_micros(200));
    }
    // it listens before its folder is there
    let recorded = || {
        let session = Session::open(&dir).ok()?;
        packets_of(&session).remove(&0)
    };
    wait_until("the first hundred reached the file by the recorder's own flushing", || {
        recorded().is_some_and(|packets| packets.len() == 100)
    });
    for payload in &sent[100..] {
        from.send_to(payload, &recorder.address).unwrap();
    }
    recorder.child.kill().unwrap();
    recorder.child.wait().unwrap();
    let session = Session::open(&dir).unwrap();
    assert!(!session.manifest().complete);
    assert!(session.problems()[0].contains("not closed"), "{:?}", session.problems());
    let found = recorded().unwrap();
    assert!(found.len() >= 100 && found.iter().zip(&sent).all(|(found, sent)| found == sent));
}

/// In a mount name space of its own, as root or as a user who may be root there.
fn unshared(script: &str) -> Command {
    let mut command = Command::new("unshare");
    command.args(["--mount", "--map-root-user", "sh", "-ec", script]);
    command
}

/// Whether a small file system can be mounted.
pub fn can_mount() -> bool {
    let folder = tempfile::tempdir().unwrap();
    let mut command = unshared("mount -t tmpfs -o size=1m tmpfs \"$0\"");
    command.arg(folder.path()).stderr(Stdio::null()).status().is_ok_and(|status| status.success())
}

pub fn a_full_disk_ends_the_session_in_order() {
    let folder = tempfile::tempdir().unwrap();
    let (disk, saved) = (folder.path().join("disk"), folder.path().join("saved"));
    std::fs::create_dir(&disk).unwrap();
    let script = "mount -t tmpfs -o size=6m tmpfs \"$0\"; set +e
        \"$2\" record --listen a=127.0.0.1:0 --out \"$0/walk\"; code=$?
        cp -r \"$0/walk\" \"$1\"; exit $code";
    let mut command = unshared(script);
    command.arg(&disk).arg(&saved).arg(env!("CARGO_BIN_EXE_outrigger"));
    let mut recorder = Recorder::start(command);
    let (from, sent) = (sender(), payloads(2000, 4));
    let mut stream = sent.iter();
    // far more than fits, until the recorder gives up
    while recorder.child.try_wait().unwrap().is_none() {
        for payload in stream.by_ref().take(20) {
            from.send_to(payload, &recorder.address).unwrap();
        }
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    let (code, _, said) = recorder.end();
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("left on the disk"), "a warning before: {said}");
    assert!(said.contains("disk full") && said.contains(&disk.join("walk").display().to_string()), "{said}");
    let session = Session::open(&saved).unwrap();
    let manifest = session.manifest();
    assert_eq!(
        session.problems().len(),
        1,
        "the failure, and no checksum that differs: {:?}",
        session.problems()
    );
    assert!(session.problems()[0].contains("disk full"), "{:?}", session.problems());
    assert!(!manifest.complete && manifest.losses.not_written > 0, "{manifest:?}");
    let found = packets_of(&session).remove(&0).unwrap();
    let bytes: usize = found.iter().map(Vec::len).sum();
    assert!(bytes > 4 << 20, "{bytes} bytes of 6 MiB");
    assert_eq!(manifest.sensors[0].packets, found.len() as u64);
    assert!(found.iter().zip(&sent).all(|(found, sent)| found == sent));
    assert!(
        said.contains(&format!(
            "{} bytes of packets",
            manifest.files.iter().find(|file| file.path == "packets.pcapng").unwrap().bytes
        )),
        "{said}"
    );
}
