//! `rig.toml` as a user meets it: written by `init`, read by every verb, outdone by flags and environment.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

use crate::support::{Case, case};

pub const CASES: &[Case] = &[
    case("the_file_that_init_writes_is_accepted", the_file_that_init_writes_is_accepted),
    case("flag_wins_over_environment_over_file", flag_wins_over_environment_over_file),
    case("one_of_several_flags_may_stand_in_the_file", one_of_several_flags_may_stand_in_the_file),
    case("mistakes_are_named_with_their_line", mistakes_are_named_with_their_line),
    case("the_page_of_keys_is_up_to_date", the_page_of_keys_is_up_to_date),
    case("the_doctor_names_what_is_wrong", the_doctor_names_what_is_wrong),
    case("the_doctor_holds_the_file_against_what_comes", the_doctor_holds_the_file_against_what_comes),
    case("sensors_of_the_file_are_recorded", sensors_of_the_file_are_recorded),
];

const MASTER: &str = "0.06,0.0,0.0,25,0";

fn outrigger(arguments: &[&str], environment: &[(&str, &str)]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_outrigger"));
    command.args(arguments).envs(environment.iter().copied()).output().unwrap()
}

fn json(output: &Output) -> Value {
    crate::support::document(&output.stdout).unwrap_or_else(|_| panic!("{output:?}"))
}

/// A file with these lines below its format.
fn file(folder: &Path, text: &str) -> PathBuf {
    let path = folder.join("rig.toml");
    std::fs::write(&path, format!("format = \"outrigger-rig/1\"\n{text}")).unwrap();
    path
}

fn the_file_that_init_writes_is_accepted() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path().join("new");
    let written = outrigger(&["init", dir.to_str().unwrap()], &[]);
    assert!(written.status.success(), "{written:?}");
    let path = dir.join("rig.toml");
    let path = path.to_str().unwrap();
    let again = outrigger(&["init", dir.to_str().unwrap()], &[]);
    assert_eq!(again.status.code(), Some(1));
    assert!(String::from_utf8(again.stderr).unwrap().contains("rig.toml exists already"));
    let named = folder.path().join("other/mine.toml");
    assert!(outrigger(&["init", named.to_str().unwrap()], &[]).status.success() && named.is_file());
    let by_file = json(&outrigger(&["predict", "--config", path, "--masters", MASTER, "--json"], &[]));
    let by_flags = json(&outrigger(
        &["predict", "--preset", "paper-os1-64", "--path", "forward", "--masters", MASTER, "--json"],
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

/// Flags of which one must be given and one at most: the file may name it, and what is typed wins over it.
fn one_of_several_flags_may_stand_in_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let scored = |masters: &str, more: &[&str]| {
        let path = file(folder.path(), &format!("[predict]\npreset = \"paper-vlp-16\"\n{masters}"));
        let output =
            outrigger(&[&["predict", "--json", "--config", path.to_str().unwrap()], more].concat(), &[]);
        assert!(output.status.success(), "{output:?}");
        json(&output)["mounts"][0][3].as_f64().unwrap()
    };
    let of_file = format!("masters = \"{MASTER}\"\n");
    assert_eq!(scored(&of_file, &[]), 25.0);
    let mount = folder.path().join("mount.json");
    let out = ["--masters-max", "1", "--evals", "4", "--pitch-limits", "10,12", "--out"];
    let searched = outrigger(
        &[&["optimize", "--preset", "paper-vlp-16"], &out[..], &[mount.to_str().unwrap()]].concat(),
        &[],
    );
    assert!(searched.status.success(), "{searched:?}");
    let typed = scored(&of_file, &["--mount", mount.to_str().unwrap()]);
    assert!((10.0..=12.0).contains(&typed), "{typed}: the mount that was typed counts");
    let both = file(folder.path(), &format!("[predict]\nmount = \"mount.json\"\n{of_file}"));
    let output = outrigger(&["predict", "--config", both.to_str().unwrap()], &[]);
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.contains("rig.toml:4: `masters` and `mount` of line 3 exclude each other"), "{said}");
    for falsey in ["0", "false", ""] {
        let asked = ["predict", "--preset", "paper-vlp-16", "--masters", MASTER];
        let text = outrigger(&asked, &[("OUTRIGGER_JSON", falsey)]).stdout;
        assert!(text.starts_with(b"paper-vlp-16"), "{falsey:?}: {}", String::from_utf8_lossy(&text));
        assert!(json(&outrigger(&asked, &[("OUTRIGGER_JSON", "1")]))["objective"].is_number());
    }
}

fn mistakes_are_named_with_their_line() {
    let folder = tempfile::tempdir().unwrap();
    for (text, code, words) in [
        ("[fly]\n", 1, "rig.toml:2: no verb is called `fly`; known are"),
        ("[mock.plane]\n", 1, "rig.toml:2: no verb is called `mock plane`; known are rig, sensor"),
        ("[predict]\nspeed = 3\n", 1, "rig.toml:3: [predict] has no key `speed`; known are"),
        ("[rig]\n\narm = 3\n", 1, "rig.toml:4: `arm` is true or false"),
        ("[rig]\nport = [\"a\", \"b\"]\n", 1, "rig.toml:3: `port` is one value, not an array"),
        ("[predict]\npath = \"up\"\n", 2, "rig.toml:3, 'path'"),
        ("[predict]\nazimuths = \"many\"\n", 2, "rig.toml:3, 'azimuths'"),
        ("[predict\n", 1, "rig.toml:2: "),
    ] {
        let path = file(folder.path(), text);
        let output = outrigger(&["predict", "--masters", MASTER, "--config", path.to_str().unwrap()], &[]);
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(
            output.status.code() == Some(code) && said.contains(words),
            "{text}: {:?} {said}",
            output.status
        );
    }
    for (setting, words) in [
        ("timeout_s = -5", "'-5' of "),
        ("tolerance_deg = 0", "above 0 and below 90 degrees"),
        ("approach_deg = 90", "below 90 degrees"),
    ] {
        let path = file(folder.path(), &format!("[rig]\nport = \"none\"\n{setting}\n"));
        let output = outrigger(&["rig", "status", "--config", path.to_str().unwrap()], &[]);
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(said.contains(words) && said.contains("rig.toml:4, '"), "{setting}: {said}");
    }
    let missing = outrigger(&["man", "--config", "no-such.toml"], &[]);
    assert_eq!(missing.status.code(), Some(1));
    assert!(String::from_utf8(missing.stderr).unwrap().contains("cannot read no-such.toml"));
}

/// The page in the repository is what the program prints: `outrigger man --keys > docs/configuration.md` mends it.
fn the_page_of_keys_is_up_to_date() {
    let printed = outrigger(&["man", "--keys"], &[]);
    let page =
        std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/docs/configuration.md")).unwrap();
    assert!(
        String::from_utf8(printed.stdout).unwrap() == page,
        "run outrigger man --keys > docs/configuration.md"
    );
}

fn the_doctor_names_what_is_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let taken = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    let sensor =
        |listen: &str| format!("[[sensor]]\nname = \"left\"\nmodel = \"os1-64\"\nlisten = \"{listen}\"\n");
    let occupied = sensor(&taken.local_addr().unwrap().to_string());
    let path = file(folder.path(), &occupied);
    let out = folder.path().to_str().unwrap();
    let look = |more: &[&str]| {
        let common =
            ["doctor", "--json", "--out", out, "--config", path.to_str().unwrap(), "--listen-for", "0.1"];
        let output = outrigger(&[&common[..], more].concat(), &[]);
        (output.status.code(), json(&output))
    };
    let state = |document: &serde_json::Value, name: &str| {
        let checks = document["checks"].as_array().unwrap();
        let check =
            checks.iter().find(|check| check["name"] == name).unwrap_or_else(|| panic!("{document:#}"));
        (check["state"].as_str().unwrap().to_owned(), check["found"].as_str().unwrap().to_owned())
    };
    let (exit, document) = look(&["--port", "/dev/no-such-rig"]);
    assert_eq!((exit, &document["verdict"]), (Some(3), &"mend".into()), "{document:#}");
    let (ports, found) = state(&document, "ports");
    assert!(ports == "bad" && found.contains("already listens"), "{found}");
    let (rig, found) = state(&document, "rig /dev/no-such-rig");
    assert!(rig == "bad" && found.contains("No such file"), "{found}");
    assert_ne!(state(&document, "disk speed").1, "");
    file(folder.path(), &format!("{occupied}[rig]\nport = \"can:none7\"\n"));
    let (rig, found) = state(&look(&[]).1, "rig can:none7");
    assert!(rig == "bad" && found.contains("cannot open can:none7"), "{found}");
    drop(taken);
    file(folder.path(), &sensor("127.0.0.1:0"));
    let (_, document) = look(&[]);
    let (silent, found) = state(&document, "packets of left");
    assert!(silent == "bad" && found.starts_with("0 packets"), "{found}");
    let (metadata, found) = state(&document, "metadata of left");
    assert!(metadata == "bad" && found.contains("cannot be decoded"), "{found}");
    assert_eq!(std::fs::read_dir(out).unwrap().count(), 1, "nothing is left behind");
    // recording makes its folder
    let missing = format!("{out}/missing");
    let document = json(&outrigger(&["doctor", "--json", "--out", &missing], &[]));
    assert!(state(&document, "disk speed").1.contains("which recording will make"), "{document:#}");
    assert!(!std::path::Path::new(&missing).exists());
}

/// What a rig.toml names is read and held against what comes.
fn the_doctor_holds_the_file_against_what_comes() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let port = std::net::UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let to = format!("127.0.0.1:{port}");
    let mock = std::process::Command::new(env!("CARGO_BIN_EXE_outrigger"))
        .args([
            "mock",
            "sensor",
            "--model",
            "os1-64",
            "--to",
            &to,
            "--metadata",
            &at("left.json"),
            "--serial",
            "77",
        ])
        .stdout(std::process::Stdio::piped())
        .spawn();
    let mut mock = Running(mock.unwrap());
    let mut line = String::new();
    std::io::BufRead::read_line(&mut std::io::BufReader::new(mock.0.stdout.as_mut().unwrap()), &mut line)
        .unwrap();
    let theirs = std::fs::read_to_string(at("left.json")).unwrap().replace("\"77\"", "\"78\"");
    std::fs::write(at("other.json"), theirs).unwrap();
    let mount = |name: &str| {
        format!(
            "{{\"format\": \"outrigger-mount/1\", \"frame\": \"mount: x right, y forward, z up\", \"sensors\": [{{\"name\": \"{name}\", \"model\": \"os1-64\", \"x_m\": 0, \
             \"y_m\": 0, \"z_m\": 0, \"pitch_deg\": 0, \"roll_deg\": 0}}]}}"
        )
    };
    std::fs::write(at("mount.json"), mount("left")).unwrap();
    let rig = format!(
        "[[sensor]]\nname = \"left\"\nmodel = \"os1-64\"\nlisten = \"{to}\"\nmetadata = \"left.json\"\n\
         [record]\nmount = \"mount.json\"\nreceive_buffer = 1\n[daemon]\nroom = \"-10,-6,-1.5,10,6,2.5\"\n"
    );
    let bad = |from: &str, to: &str| {
        let path = file(folder.path(), &rig.replace(from, to));
        let output = outrigger(
            &["doctor", "--json", "--listen-for", "1", "--config", path.to_str().unwrap(), "--out", &at("")],
            &[],
        );
        let document = json(&output);
        let checks = document["checks"].as_array().unwrap();
        // how fast this machine's disk is, or what its kernel grants, is not what is looked at
        let of_rig = |check: &&serde_json::Value| {
            let name = check["name"].as_str().unwrap();
            !name.starts_with("disk") && name != "receive buffer"
        };
        let bad = checks.iter().filter(|check| check["state"] == "bad").filter(of_rig);
        bad.map(|check| format!("{}: {}\n", check["name"], check["found"])).collect::<String>()
    };
    assert_eq!(bad("", ""), "");
    for (from, to, words) in [
        ("left.json", "nope.json", "nope.json"),
        ("left.json", "other.json", "metadata is of"),
        ("left.json", "mount.json", "metadata of left"),
        ("os1-64", "os1-128", "`model` says os1-128"),
        ("os1-64", "vlp-16", "`model` says vlp-16"),
        ("metadata = \"left.json\"", "", "neither `metadata` nor `host`"),
        ("name = \"left\"", "name = \"links\"", "links"),
        ("\"mount.json\"", "\"nomount.json\"", "nomount.json"),
        ("-10,-6,-1.5,10,6,2.5", "1,2,3", "room"),
    ] {
        let found = bad(from, to);
        assert!(found.contains(words), "{to}: {found}");
    }
    // the recorder tells it, too, when the first packets come
    let path = file(folder.path(), &rig.replace("left.json", "other.json"));
    let config = path.to_str().unwrap();
    let recorded =
        outrigger(&["record", "--config", config, "--out", &at("walk"), "--duration", "1", "--json"], &[]);
    let document = json(&recorded);
    let warned = document["warnings"].to_string();
    assert!(
        recorded.status.success() && warned.contains("left: its packets cannot be decoded"),
        "{document:#}"
    );
    let events = std::fs::read_to_string(folder.path().join("walk/events.jsonl")).unwrap();
    assert!(events.contains("not_decoded"), "{events}");
    let listen = format!("left={to}");
    let recorded = outrigger(&["record", "--listen", &listen, "--out", &at("bare"), "--duration", "1"], &[]);
    let said = String::from_utf8_lossy(&recorded.stderr).into_owned();
    assert!(recorded.status.success() && said.contains("--save-metadata"), "{said}");
}

/// Ends a program that a failed case would leave behind.
struct Running(std::process::Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
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
