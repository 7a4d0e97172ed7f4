//! Sessions from anyone: what their manifest says is held against what is there, and leads nowhere else.

use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use nix::sys::stat::Mode;
use nix::unistd::mkfifo;
use outrigger::recording::{Manifest, SensorInfo, Session, SessionWriter, file};
use outrigger::rig::{MountFile, SensorEntry};
use sensors::Packet;
use sensors::ouster::{Metadata, Profile, Synthetic};
use serde_json::{Value, json};

use super::wait_until;

/// The program, ended where it waits for what never comes.
fn outrigger(arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_outrigger"));
    let mut child = command.args(arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    wait_until(&format!("{arguments:?} ends"), || child.try_wait().unwrap().is_some());
    child.wait_with_output().unwrap()
}

/// Exit code, and what was printed.
fn inspect(dir: &Path) -> (Option<i32>, String) {
    let output = outrigger(&["inspect", dir.to_str().unwrap()]);
    let printed = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap());
    (output.status.code(), printed.concat())
}

fn entry(name: &str) -> SensorEntry {
    let (name, model) = (name.into(), "vlp-16".into());
    SensorEntry { name, model, x_m: 0.0, y_m: 0.0, z_m: 0.0, pitch_deg: 0.0, ..SensorEntry::default() }
}

/// A closed session of `left`, which sent ten packets, and `right`, which sent so many.
fn session(dir: &Path, of_right: u64) -> PathBuf {
    let wanted = Synthetic::new("os1-16", 1, Profile::Rng19Rfl8Sig16Nir16).columns(512, 16);
    let metadata = Metadata::synthetic(&wanted).unwrap().to_json();
    let info = |name: &str| SensorInfo {
        name: name.into(),
        address: Some("127.0.0.1:2368".parse().unwrap()),
        metadata: (name == "left").then(|| metadata.clone()),
        ..SensorInfo::default()
    };
    let writer = SessionWriter::create(dir, &["left", "left-aside", "right"].map(info)).unwrap();
    writer.put_mount(&MountFile::new(vec![entry("left"), entry("right")]), &[]).unwrap();
    let (source, destination) = ("10.0.0.1:2368".parse().unwrap(), "10.0.0.2:2368".parse().unwrap());
    for number in 0..10 + of_right {
        let sensor = if number < 10 { 0 } else { 2 };
        let packet = Packet {
            host_time_ns: 1_000 + number,
            source,
            destination,
            link: Default::default(),
            payload: b"payload",
        };
        writer.write_packet(sensor, &packet).unwrap();
    }
    writer.close(None).unwrap();
    dir.to_owned()
}

fn change(dir: &Path, change: impl FnOnce(&mut Value)) {
    let path = dir.join(file::MANIFEST);
    let mut manifest: Value = serde_json::from_str(&fs::read_to_string(&path).unwrap()).unwrap();
    change(&mut manifest);
    fs::write(path, manifest.to_string()).unwrap();
}

pub fn a_sensor_that_was_silent_all_along_is_named_when_read() {
    let folder = tempfile::tempdir().unwrap();
    let dir = session(&folder.path().join("walk"), 0);
    let (code, text) = inspect(&dir);
    assert_eq!(code, Some(3), "{text}");
    assert!(text.contains("right: not one packet was recorded on port 2368"), "{text}");
    assert!(!text.contains("left: not one packet") && !text.contains("left-aside"), "{text}");
    // of a recorder that was killed: its counters count nothing, its packets do
    change(&dir, |manifest| {
        manifest["complete"] = false.into();
        manifest["sensors"][0]["packets"] = 0.into();
    });
    let (code, text) = inspect(&dir);
    assert!(code == Some(3) && text.contains("right: not one packet"), "{text}");
    assert!(!text.contains("left: not one packet") && !text.contains("has 0 packets"), "{text}");
    // one that the mount file has, and that was not recorded
    let writer = SessionWriter::create(&folder.path().join("rear"), &[]).unwrap();
    writer.put_mount(&MountFile::new(vec![entry("rear")]), &[]).unwrap();
    writer.close(None).unwrap();
    let (code, text) = inspect(&folder.path().join("rear"));
    assert!(code == Some(3) && text.contains("rear: mount.json has it, and it was not recorded"), "{text}");
}

type Change = fn(&mut Value);

pub fn counters_that_contradict_the_packets_are_named_with_both_values() {
    let folder = tempfile::tempdir().unwrap();
    let whole = session(&folder.path().join("whole"), 5);
    let manifest = Manifest::read(&whole).unwrap();
    assert_eq!(manifest.contradictions(&[10, 0, 5], &[]), [""; 0]);
    let cases: [(Change, &str); 4] = [
        (
            |manifest| manifest["sensors"][2]["packets"] = 6.into(),
            "right: manifest.json has 6 packets, packets.pcapng 5",
        ),
        (
            |manifest| manifest["losses"]["queue_dropped"] = 7.into(),
            "manifest.json: losses are 7 in all, those of its sensors 0",
        ),
        (
            |manifest| {
                manifest["losses"]["queue_dropped"] = 3.into();
                manifest["sensors"][0]["losses"]["queue_dropped"] = 3.into();
            },
            "left: manifest.json has 3 packets lost, packets.pcapng 0",
        ),
        (
            |manifest| manifest["sensors"][2]["name"] = "back".into(),
            "back: manifest.json has back as interface 2, packets.pcapng right",
        ),
    ];
    for (at, (make, words)) in cases.into_iter().enumerate() {
        let dir = session(&folder.path().join(at.to_string()), 5);
        change(&dir, make);
        let (code, text) = inspect(&dir);
        assert!(code == Some(3) && text.contains(words), "{words}: {text}");
    }
    // a sensor that the manifest does not have
    let dir = session(&folder.path().join("fewer"), 5);
    change(&dir, |manifest| drop(manifest["sensors"].as_array_mut().unwrap().pop()));
    let (code, text) = inspect(&dir);
    let words = "packets.pcapng: 5 packets of interface 2, but manifest.json names 2 sensors";
    assert!(code == Some(3) && text.contains(words), "{text}");
}

pub fn files_that_no_digest_covers_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let problems = |dir: &Path| Session::open(dir).unwrap().problems().join("; ");
    let dir = session(&folder.path().join("walk"), 5);
    assert_eq!(problems(&dir), "");
    let whole = fs::read_to_string(dir.join(file::MANIFEST)).unwrap();
    let no_file = "manifest.json has no digest: no file of the session is covered by one";
    change(&dir, |manifest| drop(manifest.as_object_mut().unwrap().remove("files")));
    assert_eq!(problems(&dir), no_file);
    let (code, text) = inspect(&dir);
    assert!(code == Some(3) && text.contains(no_file), "{text}");
    fs::write(dir.join(file::MANIFEST), &whole).unwrap();
    let without = |of: &'static str| {
        move |manifest: &mut Value| {
            let files = manifest["files"].as_array_mut().unwrap();
            files.iter_mut().filter(|file| of.is_empty() || file["path"] == of).for_each(|file| {
                file.as_object_mut().unwrap().remove("sha256");
            });
        }
    };
    change(&dir, without("servo.jsonl"));
    assert_eq!(problems(&dir), "servo.jsonl: manifest.json has no digest of it");
    change(&dir, without(""));
    assert_eq!(problems(&dir), no_file);
    fs::write(dir.join(file::MANIFEST), &whole).unwrap();
    change(&dir, |manifest| {
        manifest["files"].as_array_mut().unwrap().retain(|file| file["path"] != file::PACKETS)
    });
    assert_eq!(problems(&dir), "packets.pcapng: manifest.json has no digest of it");
}

pub fn a_manifest_leads_nowhere_out_of_its_folder() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("secret.json"), "{}").unwrap();
    let dir = session(&folder.path().join("walk"), 5);
    let whole = fs::read_to_string(dir.join(file::MANIFEST)).unwrap();
    let absolute = folder.path().join("secret.json").display().to_string();
    for (pointer, value, words) in [
        ("/files/0/path", "../secret.json", "files[0].path: \"../secret.json\" leads out of the folder"),
        ("/files/0/path", &absolute, "leads out of the folder; expected a path in it"),
        ("/sensors/0/metadata", "metadata/../../secret.json", "sensors[0].metadata: "),
        ("/sensors/0/metadata", &absolute, "leads out of the folder"),
        ("/sensors/0/name", "../left", "sensors[0]: sensor name \"../left\""),
        ("/sensors/0/name", "right", "sensors[2] is called \"right\" like sensors[0]"),
    ] {
        change(&dir, |manifest| *manifest.pointer_mut(pointer).unwrap() = json!(value));
        let error = Session::open(&dir).unwrap_err().to_string();
        assert!(error.contains("manifest.json") && error.contains(words), "{pointer} {value}: {error}");
        fs::write(dir.join(file::MANIFEST), &whole).unwrap();
    }
    let (code, text) = {
        change(&dir, |manifest| manifest["files"][0]["path"] = json!("../secret.json"));
        inspect(&dir)
    };
    assert!(code == Some(1) && text.contains("leads out of the folder"), "{text}");
    // what a mount file names, too
    let dir = session(&folder.path().join("mounted"), 5);
    for path in ["../secret.json", &absolute] {
        let mut mount: Value =
            serde_json::from_str(&fs::read_to_string(dir.join(file::MOUNT)).unwrap()).unwrap();
        mount["calibrations"] = json!({"left": path});
        fs::write(dir.join(file::MOUNT), mount.to_string()).unwrap();
        let error = Session::open(&dir).unwrap().mount().unwrap_err().to_string();
        assert!(error.contains("calibrations of left") && error.contains("leads out"), "{error}");
    }
}

pub fn what_is_no_file_in_a_session_is_named_and_not_waited_for() {
    let folder = tempfile::tempdir().unwrap();
    let outside = folder.path().join("outside");
    fs::write(&outside, "{}").unwrap();
    type Placed = fn(&Path, &Path);
    let places: [(&str, Placed, &str); 4] = [
        ("pipe", |path, _| mkfifo(path, Mode::S_IRWXU).unwrap(), "it is a pipe, expected a file"),
        ("folder", |path, _| fs::create_dir(path).unwrap(), "it is a folder, expected a file"),
        (
            "device",
            |path, _| symlink("/dev/zero", path).unwrap(),
            "it is a link out of its folder, to /dev/zero",
        ),
        ("link", |path, outside| symlink(outside, path).unwrap(), "it is a link out of its folder"),
    ];
    for (kind, make, words) in places {
        for name in [file::PACKETS, file::SERVO, file::EVENTS, file::MOUNT, "metadata/left.json"] {
            let dir = session(&folder.path().join(format!("{kind}-{}", name.replace('/', "-"))), 5);
            fs::remove_file(dir.join(name)).unwrap();
            make(&dir.join(name), &outside);
            let (code, text) = inspect(&dir);
            let expected = if name == file::PACKETS { 1 } else { 3 };
            assert!(code == Some(expected) && text.contains(words), "{kind} {name}: {code:?} {text}");
            let session = Session::open(&dir).unwrap();
            let error = match name {
                file::PACKETS => session.packets().err().map(|error| error.to_string()),
                file::SERVO => session.servo::<Value>().err().map(|error| error.to_string()),
                file::EVENTS => session.events::<Value>().err().map(|error| error.to_string()),
                file::MOUNT => session.mount().err().map(|error| error.to_string()),
                _ => session.metadata("left").err().map(|error| error.to_string()),
            };
            assert!(error.as_ref().is_some_and(|error| error.contains(words)), "{kind} {name}: {error:?}");
        }
    }
    // a link that stays inside is a file
    let dir = session(&folder.path().join("inside"), 5);
    fs::rename(dir.join(file::PACKETS), dir.join("kept.pcapng")).unwrap();
    symlink("kept.pcapng", dir.join(file::PACKETS)).unwrap();
    assert_eq!(inspect(&dir).0, Some(0));
}

pub fn a_pipe_without_a_writer_is_refused_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let pipe = |name: &str| {
        let path = folder.path().join(name);
        mkfifo(&path, Mode::S_IRWXU).unwrap();
        path.display().to_string()
    };
    let capture = folder.path().join("walk");
    session(&capture, 5);
    let capture = capture.display().to_string();
    for arguments in [
        vec!["inspect", &capture, "--meta", &pipe("meta.json")],
        vec!["inspect", &capture, "--calibration", &pipe("db.xml")],
        vec!["--config", &pipe("rig.toml"), "record"],
        vec!["compare", &capture, "--mount", &pipe("mount.json"), "--room=-1,-1,0,1,1,1"],
    ] {
        let output = outrigger(&arguments);
        let message = String::from_utf8_lossy(&output.stderr);
        assert!(
            !output.status.success() && message.contains("pipe without a writer"),
            "{arguments:?}: {message}"
        );
    }
    for name in ["room.ply", "room.obj", "room.gltf"] {
        let error = outrigger::world::scene::load_mesh(Path::new(&pipe(name)), None, None).err().unwrap();
        assert!(format!("{:#}", anyhow::Error::new(error)).contains("pipe without a writer"), "{name}");
    }
    for (name, words) in
        [("cloud.pcd", "pipe without a writer"), ("cloud.las", "it is a pipe, expected a file")]
    {
        let error = outrigger::world::scene::read_cloud(Path::new(&pipe(name)), |_| {}).err().unwrap();
        assert!(format!("{:#}", anyhow::Error::new(error)).contains(words), "{name}");
    }
    // a pipe that someone writes to is read to its end
    let written = folder.path().join("written.toml");
    mkfifo(&written, Mode::S_IRWXU).unwrap();
    let path = written.clone();
    let writer = std::thread::spawn(move || {
        let mut pipe = fs::File::options().write(true).open(path).unwrap();
        std::thread::sleep(std::time::Duration::from_millis(200));
        std::io::Write::write_all(&mut pipe, b"format = \"outrigger-rig/1\"\n").unwrap();
    });
    let text = loop {
        match outrigger::base::files::read_text(&written) {
            Err(error) if error.to_string().contains("without a writer") => {} // its writer comes next
            text => break text.unwrap(),
        }
    };
    writer.join().unwrap();
    assert_eq!(text, "format = \"outrigger-rig/1\"\n");
}

pub fn buffers_of_a_gltf_lie_beside_it() {
    let folder = tempfile::tempdir().unwrap();
    let outside = folder.path().join("outside.bin");
    fs::write(&outside, [0; 64]).unwrap();
    let scene = folder.path().join("scene");
    fs::create_dir(&scene).unwrap();
    symlink(&outside, scene.join("link.bin")).unwrap();
    mkfifo(&scene.join("pipe.bin"), Mode::S_IRWXU).unwrap();
    fs::create_dir(scene.join("folder.bin")).unwrap();
    let absolute = outside.display().to_string();
    for (uri, words) in [
        ("../outside.bin", "leads out of the folder"),
        (absolute.as_str(), "leads out of the folder"),
        ("link.bin", "it is a link out of its folder"),
        ("pipe.bin", "it is a pipe, expected a file"),
        ("folder.bin", "it is a folder, expected a file"),
        ("http://example.org/a.bin", "is no file in the folder of this one"),
    ] {
        let gltf = json!({"asset": {"version": "2.0"}, "buffers": [{"uri": uri, "byteLength": 64}]});
        fs::write(scene.join("room.gltf"), gltf.to_string()).unwrap();
        let error = outrigger::world::scene::load_mesh(&scene.join("room.gltf"), None, None).err().unwrap();
        let error = format!("{:#}", anyhow::Error::new(error));
        assert!(error.contains(words) && error.contains(uri), "{uri}: {error}");
    }
}
