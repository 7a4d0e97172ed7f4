//! Folders and files that are moved, deleted, replaced or cut while a session is written into them.

use std::fs;
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::Command;

use nix::fcntl::{AT_FDCWD, RenameFlags, renameat2};
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use outrigger::recording::{Manifest, SensorInfo, Session, SessionError, SessionWriter, file};
use sensors::Packet;

use super::crash::Recorder;
use super::round_trip::packets_of;
use super::{payloads, sender, wait_until};
use crate::support::delete_under;

/// A recorder of which so many packets have reached the file.
fn recording(dir: &Path, sent: &[Vec<u8>]) -> Recorder {
    let recorder = Recorder::of(dir);
    send(&recorder, sent);
    wait_until("the packets reached the file", || {
        packets_in(dir).is_some_and(|found| found.len() == sent.len())
    });
    recorder
}

fn packets_in(dir: &Path) -> Option<Vec<Vec<u8>>> {
    packets_of(&Session::open(dir).ok()?).remove(&0)
}

fn send(recorder: &Recorder, payloads: &[Vec<u8>]) {
    let from = sender();
    for payload in payloads {
        from.send_to(payload, &recorder.address).unwrap();
        std::thread::sleep(std::time::Duration::from_micros(200));
    }
}

fn interrupt(recorder: Recorder) -> (Option<i32>, String, String) {
    ended_by(recorder, Signal::SIGINT)
}

fn ended_by(recorder: Recorder, signal: Signal) -> (Option<i32>, String, String) {
    kill(Pid::from_raw(recorder.child.id() as i32), signal).unwrap();
    recorder.end()
}

fn inspect(dir: &Path) -> (Option<i32>, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_outrigger")).arg("inspect").arg(dir).output().unwrap();
    (output.status.code(), String::from_utf8(output.stdout).unwrap())
}

pub fn a_folder_moved_while_recording_is_closed_there_and_recording_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let (dir, moved) = (folder.path().join("walk"), folder.path().join("walk-moved"));
    let sent = payloads(200, 11);
    let recorder = recording(&dir, &sent[..100]);
    fs::rename(&dir, &moved).unwrap();
    wait_until("a session has the name again", || Session::is_session(&dir));
    wait_until("the one before is closed", || Manifest::read(&moved).unwrap().complete);
    send(&recorder, &sent[100..]);
    let (code, stdout, message) = interrupt(recorder);
    assert_eq!((code, stdout.trim()), (Some(3), dir.to_str().unwrap()), "{message}");
    let words = format!("{} was moved to {} while recording", dir.display(), moved.display());
    assert!(message.contains(&words) && message.contains("recording goes on in"), "{message}");
    let [before, after] = [&moved, &dir].map(|dir| Session::open(dir).unwrap());
    assert_eq!((before.problems(), after.problems()), (&[][..], &[][..]));
    assert!(before.manifest().complete && after.manifest().complete);
    assert_eq!(after.manifest().follows.as_deref(), Some(words.as_str()));
    assert_eq!(after.manifest().losses.total(), 0, "no packet is lost");
    let all: Vec<_> = [&moved, &dir].into_iter().flat_map(|dir| packets_in(dir).unwrap()).collect();
    assert!(all == sent, "every packet is in one of the two: {} of {}", all.len(), sent.len());
    for (session, event) in [(&before, "displaced"), (&after, "session_displaced")] {
        let events: Vec<serde_json::Value> = session.events().unwrap();
        let told = events.iter().find(|told| told["event"] == event).unwrap_or_else(|| panic!("{events:?}"));
        assert_eq!(told["words"], words);
    }
    assert_eq!(inspect(&moved).0, Some(0));
    let (code, text) = inspect(&dir);
    assert!(code == Some(3) && text.contains(&words), "{text}");
}

pub fn a_folder_deleted_while_recording_is_counted_and_recording_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let parent = folder.path().join("today");
    let dir = parent.join("walk");
    let sent = payloads(150, 12);
    let recorder = recording(&dir, &sent[..100]);
    delete_under(&recorder.child, &parent);
    wait_until("a session goes on under the name", || {
        Manifest::read(&dir).is_ok_and(|manifest| manifest.follows.is_some())
    });
    send(&recorder, &sent[100..]);
    let (code, stdout, message) = interrupt(recorder);
    assert_eq!((code, stdout.trim()), (Some(3), dir.to_str().unwrap()), "{message}");
    let words = format!("{} was deleted while recording", dir.display());
    assert!(message.contains(&words) && message.contains("100 in a deleted file"), "{message}");
    let session = Session::open(&dir).unwrap();
    let manifest = session.manifest();
    assert_eq!((manifest.sensors[0].packets, manifest.sensors[0].losses.deleted), (50, 100));
    assert_eq!((manifest.losses.deleted, manifest.losses.total()), (100, 100));
    assert!(manifest.follows.as_ref().unwrap().starts_with(&words) && session.problems().is_empty());
    assert!(packets_in(&dir).unwrap() == sent[100..]);
    let (code, text) = inspect(&dir);
    assert!(
        code == Some(3) && text.contains("100 in a file that was deleted") && text.contains(&words),
        "{text}"
    );
}

pub fn a_link_in_place_of_the_folder_is_not_followed() {
    let folder = tempfile::tempdir().unwrap();
    let [dir, moved, other] = ["walk", "moved", "other"].map(|name| folder.path().join(name));
    fs::create_dir(&other).unwrap();
    let sent = payloads(60, 13);
    let recorder = recording(&dir, &sent[..40]);
    fs::rename(&dir, &moved).unwrap();
    symlink(&other, &dir).unwrap();
    let next = folder.path().join("walk-2");
    wait_until("recording goes on beside the link", || Session::is_session(&next));
    send(&recorder, &sent[40..]);
    let (code, stdout, message) = interrupt(recorder);
    assert_eq!((code, stdout.trim()), (Some(3), next.to_str().unwrap()), "{message}");
    assert_eq!(fs::read_dir(&other).unwrap().count(), 0);
    assert_eq!([packets_in(&moved).unwrap(), packets_in(&next).unwrap()].concat(), sent);
    // a link that leads to where the folder is now takes nothing away
    let recorder = recording(&folder.path().join("again"), &sent[..10]);
    symlink(folder.path().join("store"), folder.path().join("store")).unwrap();
    // at once: in between, the folder would have been away
    let [again, store] = ["again", "store"].map(|name| folder.path().join(name));
    renameat2(AT_FDCWD, &again, AT_FDCWD, &store, RenameFlags::RENAME_EXCHANGE).unwrap();
    std::thread::sleep(std::time::Duration::from_millis(1200)); // two ticks
    send(&recorder, &sent[10..20]);
    let (_, _, message) = interrupt(recorder);
    assert_eq!(packets_in(&folder.path().join("again")).map(|found| found.len()), Some(20), "{message}");
}

/// A session of two sensors with 30 packets, flushed.
fn session_of_thirty(dir: &Path) -> SessionWriter {
    let infos = ["left", "right"].map(|name| SensorInfo { name: name.into(), ..SensorInfo::default() });
    let writer = SessionWriter::create(dir, &infos).unwrap();
    for number in 0..30_u64 {
        write(&writer, (number % 3 / 2) as usize, number);
    }
    writer.write_servo(&1).unwrap();
    writer.write_event(&"a").unwrap();
    writer.flush().unwrap();
    writer
}

fn write(writer: &SessionWriter, sensor: usize, number: u64) {
    let (source, destination) = ("10.0.0.1:7502".parse().unwrap(), "10.0.0.2:7502".parse().unwrap());
    let payload = &number.to_le_bytes();
    writer
        .write_packet(
            sensor,
            &Packet { host_time_ns: 1_000 + number, source, destination, link: Default::default(), payload },
        )
        .unwrap();
}

type TakeAway = fn(&Path);

pub fn a_file_removed_from_a_session_is_named_and_its_packets_counted() {
    let cases: [(&str, TakeAway, &str, [u64; 2]); 7] = [
        (
            "deleted",
            |dir| fs::remove_file(dir.join(file::PACKETS)).unwrap(),
            "packets.pcapng was deleted",
            [20, 10],
        ),
        (
            "replaced",
            |dir| {
                fs::write(dir.join("new"), "other").unwrap();
                fs::rename(dir.join("new"), dir.join(file::PACKETS)).unwrap();
            },
            "packets.pcapng was replaced by another file",
            [20, 10],
        ),
        (
            "emptied",
            |dir| drop(fs::File::create(dir.join(file::PACKETS)).unwrap()),
            "packets.pcapng was cut to 0 of",
            [20, 10],
        ),
        (
            "renamed",
            |dir| fs::rename(dir.join(file::PACKETS), dir.join("kept.pcapng")).unwrap(),
            "packets.pcapng was moved to",
            [0, 0],
        ),
        ("servo", |dir| fs::remove_file(dir.join(file::SERVO)).unwrap(), "servo.jsonl was deleted", [0, 0]),
        (
            "manifest",
            |dir| fs::remove_file(dir.join(file::MANIFEST)).unwrap(),
            "manifest.json was deleted",
            [0, 0],
        ),
        (
            "events",
            |dir| {
                fs::remove_file(dir.join(file::EVENTS)).unwrap();
                fs::create_dir(dir.join(file::EVENTS)).unwrap();
            },
            "events.jsonl was replaced",
            [0, 0],
        ),
    ];
    for (name, take_away, words, deleted) in cases {
        let folder = tempfile::tempdir().unwrap();
        let (dir, next) = (folder.path().join(name), folder.path().join("next"));
        let writer = session_of_thirty(&dir);
        assert!(writer.displaced().is_none());
        take_away(&dir);
        wait_until("the writer sees it by itself", || writer.displaced().is_some());
        assert!(writer.displaced().unwrap().words.contains(words), "{:?}", writer.displaced());
        let infos = ["left", "right"].map(|name| SensorInfo { name: name.into(), ..SensorInfo::default() });
        let after = SessionWriter::create(&next, &infos).unwrap();
        let error = after.succeed(&writer, None).unwrap_err();
        let SessionError::Displaced { manifest, is_retained: true, .. } = &error else { panic!("{error}") };
        assert!(
            error.to_string().contains(&format!("{} packets are lost", deleted[0] + deleted[1])),
            "{error}"
        );
        assert_eq!(manifest.sensors.iter().map(|entry| entry.losses.deleted).collect::<Vec<_>>(), deleted);
        let on_disk = Manifest::read(&dir).unwrap();
        assert_eq!(&on_disk, &**manifest);
        assert!(!on_disk.complete && on_disk.failure.as_ref().unwrap().contains(words), "{on_disk:?}");
        let problems = Session::open(&dir).unwrap().problems().join("; ");
        assert!(!problems.contains("differs"), "{name}: {problems}");
        let followed = after.close(None).unwrap();
        assert!(followed.follows.unwrap().contains(words));
        assert_eq!(followed.losses.total(), 0, "{name}: the folder that is still there has the count");
    }
}

pub fn what_is_left_of_a_cut_file_is_counted() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path().join("walk");
    let writer = session_of_thirty(&dir);
    let path = dir.join(file::PACKETS);
    let whole = fs::metadata(&path).unwrap().len();
    fs::File::options().write(true).open(&path).unwrap().set_len(whole / 2).unwrap();
    write(&writer, 0, 30); // behind the cut, and not in place of what was cut off
    writer.flush().unwrap();
    let error = writer.close(None).unwrap_err();
    let SessionError::Displaced { manifest, .. } = error else { panic!("{error}") };
    let left: u64 = manifest.sensors.iter().map(|entry| entry.packets).sum();
    assert!((5..25).contains(&left), "{manifest:?}");
    assert_eq!(left + manifest.losses.deleted, 31);
    let session = Session::open(&dir).unwrap();
    let mut packets = session.packets().unwrap();
    let mut found = 0;
    while let Ok(Some(_)) = packets.next() {
        found += 1;
    }
    assert_eq!(found, left);
    assert_eq!(session.problems().len(), 1, "no digest differs: {:?}", session.problems());
}

pub fn an_unmounted_disk_is_closed_through_what_is_open() {
    let folder = tempfile::tempdir().unwrap();
    let (disk, saved) = (folder.path().join("disk"), folder.path().join("saved"));
    fs::create_dir(&disk).unwrap();
    // the copy is taken through a second mount of the same disk; a shell that was started in the background traps no SIGINT
    let script = "mount -t tmpfs -o size=64m tmpfs \"$0\"; mkdir \"$1\"; mount --bind \"$0\" \"$1\"; set +e
        trap : TERM
        \"$2\" record --listen a=127.0.0.1:0 --out \"$0/walk\" & child=$!; trap 'kill -TERM $child' TERM
        while [ ! -e \"$0/walk/manifest.json\" ]; do sleep 0.1; done; sleep 1; umount -l \"$0\"
        wait $child; code=$?; while kill -0 $child 2>/dev/null; do wait $child; code=$?; done
        cp -r \"$1/walk\" \"$1.copy\"; exit $code";
    let mut command = Command::new("unshare");
    command.args(["--mount", "--map-root-user", "sh", "-ec", script]);
    command.arg(&disk).arg(&saved).arg(env!("CARGO_BIN_EXE_outrigger"));
    let recorder = Recorder::start(command);
    let sent = payloads(40, 14);
    send(&recorder, &sent[..20]);
    wait_until("recording goes on below the disk", || Session::is_session(&disk.join("walk")));
    send(&recorder, &sent[20..]);
    let (code, _, message) = ended_by(recorder, Signal::SIGTERM);
    assert!(code == Some(3) && message.contains("its disk was unmounted"), "{code:?} {message}");
    let before = Session::open(&folder.path().join("saved.copy")).unwrap();
    assert!(before.manifest().complete && before.problems().is_empty(), "{:?}", before.problems());
    let found = packets_of(&before).remove(&0).unwrap_or_default();
    assert_eq!([found, packets_in(&disk.join("walk")).unwrap()].concat(), sent);
}
