//! `outrigger decode` as a user meets it: the document against the digests of the peers, exit codes, messages.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use serde_json::Value;

use crate::support::datagram::{datagrams, write_capture};
use crate::support::{Case, shared, with_shared};

pub const CASES: &[Case] = &[
    with_shared("ouster_frames_equal_the_peers", ouster_frames_equal_the_peers),
    with_shared("velodyne_points_equal_the_peers", velodyne_points_equal_the_peers),
    with_shared("position_packets_with_a_wrong_length_count", position_packets_with_a_wrong_length_count),
    with_shared("two_sensors_on_one_port_are_told_apart", two_sensors_on_one_port_are_told_apart),
    with_shared("a_typed_name_says_the_format", a_typed_name_says_the_format),
    with_shared("what_is_read_twice_may_be_a_pipe", what_is_read_twice_may_be_a_pipe),
    with_shared("a_shared_identification_costs_one_datagram", a_shared_identification_costs_one_datagram),
    with_shared("frames_are_selected", frames_are_selected),
    with_shared("an_hdl_64e_says_how_it_is_calibrated", an_hdl_64e_says_how_it_is_calibrated),
    with_shared("calibrations_that_serve_nobody_are_told", calibrations_that_serve_nobody_are_told),
    with_shared("second_returns_have_the_ambient_light_too", second_returns_have_the_ambient_light_too),
    with_shared("names_without_an_extension_are_folders", names_without_an_extension_are_folders),
    with_shared("what_is_missing_is_said", what_is_missing_is_said),
    with_shared("a_cut_capture_is_decoded_up_to_the_cut", a_cut_capture_is_decoded_up_to_the_cut),
    with_shared("a_lost_packet_is_data_lost", a_lost_packet_is_data_lost),
    with_shared("pcapng_and_gzip_say_the_same", pcapng_and_gzip_say_the_same),
    with_shared("a_signal_leaves_no_unfinished_file", a_signal_leaves_no_unfinished_file),
];

const OS1: &str = "captures/ouster/OS-1-128_v2.3.0_1024x10_lb_n3.pcap";
const OS1_META: &str = "captures/ouster/OS-1-128_v2.3.0_1024x10.json";
const VLP16: &str = "captures/velodyne/mrpt_vlp16_gps.pcap";
const HDL64: &str = "captures/velodyne/synthetic/syn_hdl64e_S2_single_with_calib.pcap";

pub fn outrigger(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_outrigger")).args(arguments).output().unwrap()
}

pub fn path(name: &str) -> String {
    shared(name).to_str().unwrap().to_owned()
}

/// Exit code, document and what was said on stderr.
pub fn decode(capture: &str, metas: &[&str], more: &[&str]) -> (i32, Value, String) {
    let mut arguments = vec!["decode", capture, "--json"];
    arguments.extend(metas.iter().flat_map(|meta| ["--meta", meta]));
    arguments.extend(more);
    let output = outrigger(&arguments);
    let document = crate::support::document(&output.stdout).unwrap_or(Value::Null);
    (output.status.code().unwrap(), document, String::from_utf8(output.stderr).unwrap())
}

fn digest(name: &str) -> Value {
    serde_json::from_slice(&std::fs::read(shared(name)).unwrap()).unwrap()
}

fn close(a: &Value, b: &Value, tolerance: f64) -> bool {
    (a.as_f64().unwrap() - b.as_f64().unwrap()).abs() <= tolerance
}

fn ouster_frames_equal_the_peers() {
    for (capture, meta) in [
        (OS1, OS1_META),
        ("captures/ouster/OS-1-64_1024x10_fw20.pcap", "captures/ouster/OS-1-64_sensor_config_reduced.json"),
        ("captures/ouster/windowed_frame1.pcap", "captures/ouster/windowed_frame1_0.json"),
        ("captures/ouster/ouster_example.pcap", "captures/ouster/ouster_example.json"),
    ] {
        let (code, document, said) = decode(&path(capture), &[&path(meta)], &[]);
        assert_eq!(code, 0, "{capture}: {said}");
        let theirs = digest(&capture.replace(".pcap", ".digest.json"));
        let frames = document["sensors"][0]["frames"].as_array().unwrap();
        let expected = theirs["frames"].as_array().unwrap();
        assert_eq!(frames.len(), expected.len(), "{capture}");
        for (ours, theirs) in frames.iter().zip(expected) {
            for field in ["frame_id", "valid_columns", "complete", "points", "range_sum_mm"] {
                assert_eq!(ours[field], theirs[field], "{capture} {field}");
            }
            let points = theirs["points"].as_f64().unwrap();
            for axis in 0..3 {
                let (ours, theirs) = (&ours["xyz_sum_m"][axis], &theirs["xyz_sum_m"][axis]);
                assert!(close(ours, theirs, 1e-9 * points), "{capture} {axis}: {ours} {theirs}");
            }
        }
        assert_eq!(document["fragments_incomplete"], 0);
    }
}

fn velodyne_points_equal_the_peers() {
    let (code, document, said) = decode(&path(VLP16), &[], &[]);
    assert_eq!((code, said.as_str()), (0, ""));
    let sensor = &document["sensors"][0];
    assert_eq!(
        (&sensor["vendor"], &sensor["model"], &sensor["format"]),
        (&"Velodyne".into(), &"vlp-16".into(), &"strongest".into())
    );
    assert_eq!(sensor["position_packets"], 57);
    assert_eq!(document["unclaimed"].as_array().unwrap().len(), 0);
    let theirs = digest("captures/velodyne/mrpt_vlp16_gps.digest.json");
    for (ours, theirs) in
        sensor["frames"].as_array().unwrap().iter().zip(theirs["frames"].as_array().unwrap())
    {
        assert_eq!(ours["points"], theirs["points"]);
        for (axis, name) in ["x", "y", "z"].iter().enumerate() {
            // the peer rounds azimuths to 0.01 degrees
            let tolerance = 2e-4 * theirs["points"].as_f64().unwrap();
            let (ours, theirs) = (&ours["xyz_sum_m"][axis], &theirs["sum"][name]);
            assert!(close(ours, theirs, tolerance), "{name}: {ours} {theirs}");
        }
    }
}

/// What was typed counts, and not what the rig.toml says.
fn a_typed_name_says_the_format() {
    let folder = tempfile::tempdir().unwrap();
    let name = |name: &str| folder.path().join(name).display().to_string();
    std::fs::write(name("rig.toml"), "format = \"outrigger-rig/1\"\n[decode]\nformat = \"las\"\n").unwrap();
    let run = |more: &[&str]| {
        let mut arguments = vec!["--config".to_owned(), name("rig.toml"), "decode".into(), path(VLP16)];
        arguments.extend(more.iter().map(|word| (*word).to_owned()));
        let output = outrigger(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
        (output.status.code().unwrap(), String::from_utf8(output.stderr).unwrap())
    };
    let (code, said) = run(&["--out", &name("points.csv")]);
    assert_eq!(code, 0, "{said}");
    assert!(std::fs::read_to_string(name("points.csv")).unwrap().starts_with("sensor,"));
    let (code, said) = run(&["--out", &name("frames/")]);
    assert_eq!(code, 0, "{said}");
    let files = std::fs::read_dir(name("frames")).unwrap().map(|entry| entry.unwrap().path());
    assert!(files.into_iter().all(|file| file.extension().is_some_and(|extension| extension == "las")));
    let (code, said) = run(&["--format", "las", "--out", &name("other.csv")]);
    assert!(code == 2 && said.contains("--format las contradicts"), "{said}");
}

/// `compare` decodes a recording more than once, `replay` to one port looks at its ports first.
fn what_is_read_twice_may_be_a_pipe() {
    let folder = tempfile::tempdir().unwrap();
    let name = |name: &str| folder.path().join(name).display().to_string();
    let seat = serde_json::json!({"name": "vlp", "model": "vlp-16", "x_m": 0.0, "y_m": 0.0, "z_m": 0.0,
        "pitch_deg": 0.0, "roll_deg": 0.0});
    let mount = serde_json::json!({"format": "outrigger-mount/1", "frame": "mount: x right, y forward, z up",
        "sensors": [seat]});
    std::fs::write(name("mount.json"), mount.to_string()).unwrap();
    let capture = shared("captures/velodyne/nebula_vlp16.pcap");
    let (pipe, mount) = (name("pipe"), name("mount.json"));
    nix::unistd::mkfifo(pipe.as_str(), nix::sys::stat::Mode::S_IRWXU).unwrap();
    let run = |arguments: &[&str]| {
        std::thread::scope(|scope| {
            scope.spawn(|| std::fs::copy(&capture, &pipe).unwrap());
            let output = outrigger(arguments);
            let said = String::from_utf8_lossy(&output.stderr);
            serde_json::from_slice::<Value>(&output.stdout).expect(&said)
        })
    };
    let still = ["--map-frames", "0..2", "--trajectory", "still", "--mount", &mount, "--json"];
    let compared = run(&[&["compare", &pipe][..], &still].concat());
    assert!(compared["coverage"]["recorded"].as_u64() > Some(1000), "{compared:#}");
    // a single sensor without a mount is level at the origin, as in that mount file
    let unmounted = run(&["compare", &pipe, "--map-frames", "0..2", "--trajectory", "still", "--json"]);
    assert_eq!(unmounted["coverage"], compared["coverage"]);
    let from_file =
        outrigger(&["compare", capture.to_str().unwrap(), "--map-frames", "0..2", "--trajectory", "still"]);
    let stderr = String::from_utf8_lossy(&from_file.stderr);
    assert!(stderr.contains("no mount is given; it is level at the origin of the body"), "{stderr}");
    let replayed = run(&["replay", &pipe, "--to", "127.0.0.1:9", "--rate", "max", "--json"]);
    assert_eq!(replayed["packets"], 603);
}

/// Position packets of this sensor claim a wrong IP length.
fn position_packets_with_a_wrong_length_count() {
    let (code, document, said) = decode(&path("captures/velodyne/rustlidar_vlp16.pcap"), &[], &[]);
    assert_eq!((code, said.as_str()), (0, ""));
    assert_eq!(document["sensors"][0]["position_packets"], 16);
    assert_eq!(document["sensors"][0]["model"], "vlp-16");
}

fn two_sensors_on_one_port_are_told_apart() {
    for name in ["same_ports", "same_ports_legacy"] {
        let capture = path(&format!("captures/ouster/{name}.pcap"));
        let metas = [1, 2].map(|number| path(&format!("captures/ouster/{name}.{number}.json")));
        for order in [[0, 1], [1, 0]] {
            let (code, document, said) = decode(&capture, &order.map(|at| metas[at].as_str()), &[]);
            assert_eq!(code, 0, "{said}");
            assert_eq!(document["unclaimed"], serde_json::json!([]), "{said}");
            let mut sources = Vec::new();
            for sensor in document["sensors"].as_array().unwrap() {
                assert_eq!(sensor["frames"].as_array().unwrap().len(), 1);
                let imu_samples = if name == "same_ports" { 1 } else { 0 };
                assert_eq!(sensor["imu_samples"], imu_samples, "{name}");
                sources.push((sensor["model"].clone(), sensor["source"].as_str().unwrap().to_owned()));
            }
            sources.sort_by_key(|(model, _)| model.to_string());
            assert!(sources[0].0 == "OS-0-128" && sources[0].1.starts_with("169.254.92.158"), "{sources:?}");
            assert!(
                sources[1].0 == "OS-1-64-AH" && sources[1].1.starts_with("169.254.238.111"),
                "{sources:?}"
            );
        }
    }
}

fn a_shared_identification_costs_one_datagram() {
    let (capture, meta) = ("captures/ouster/duplicate_id.pcap", "captures/ouster/duplicate_id.json");
    let (code, document, said) = decode(&path(capture), &[&path(meta)], &[]);
    assert_eq!(code, 3, "{said}");
    assert_eq!(document["fragments_incomplete"], 1);
    let (ours, theirs) =
        (&document["sensors"][0]["frames"][0], &digest("captures/ouster/duplicate_id.digest.json"));
    assert_eq!(ours["range_sum_mm"], theirs["frames"][0]["range_sum_mm"]);
}

fn frames_are_selected() {
    let (_, all, _) = decode(&path(OS1), &[&path(OS1_META)], &[]);
    let (code, one, _) = decode(&path(OS1), &[&path(OS1_META)], &["--frames", "1..2"]);
    assert_eq!(code, 0);
    assert_eq!(one["sensors"][0]["frames"][0], all["sensors"][0]["frames"][1]);
    assert_eq!(one["sensors"][0]["totals"]["frames"], 1);
    // the rig.toml names the metadata
    let rig = tempfile::tempdir().unwrap();
    let config = rig.path().join("rig.toml");
    let sensor =
        format!("{{ name = \"a\", model = \"os1-128\", listen = 7502, metadata = \"{}\" }}", path(OS1_META));
    std::fs::write(&config, format!("format = \"outrigger-rig/1\"\nsensor = [{sensor}]\n")).unwrap();
    let (code, named, said) = decode(&path(OS1), &[], &["--config", config.to_str().unwrap()]);
    assert_eq!(code, 0, "{said}");
    assert_eq!(named["sensors"][0]["frames"], all["sensors"][0]["frames"]);
    let output = outrigger(&["decode", &path(OS1), "--frames", "3..3"]);
    assert_eq!(output.status.code(), Some(2));
    // frames that are not there: nothing is written, and that is said
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("points.csv");
    let (code, _, said) =
        decode(&path(OS1), &[&path(OS1_META)], &["--frames", "9", "--out", out.to_str().unwrap()]);
    assert_eq!((code, out.exists()), (1, false));
    assert!(said.contains("--frames 9: the recording has fewer, counted from 0: 3 of os-1-128"), "{said}");
    let output =
        outrigger(&["decode", &path(OS1), "--meta", &path(OS1_META), "--format", "csv", "--out", "-"]);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(2) && said.contains("not to stdout"), "{said}");
}

/// Its own calibration, among its status bytes, holds from the first frame on; where that is not to be had it is said.
fn an_hdl_64e_says_how_it_is_calibrated() {
    let (code, document, said) = decode(&path(HDL64), &[], &[]);
    assert_eq!((code, said.as_str()), (0, ""));
    assert_eq!(document["sensors"][0]["beams"], "as the unit says of itself");
    let theirs = digest(&HDL64.replace(".pcap", ".digest.json"));
    let frames = document["sensors"][0]["frames"].as_array().unwrap();
    assert!(frames.len() > 5);
    for (ours, theirs) in frames.iter().zip(theirs["frames"].as_array().unwrap()) {
        assert_eq!(ours["points"], theirs["points"]);
        for (axis, name) in ["x", "y", "z"].iter().enumerate() {
            // the peer rounds azimuths to 0.01 degrees; nominal beams are 0.3 m off
            let tolerance_m = 2e-3 * theirs["points"].as_f64().unwrap();
            let (ours, theirs) = (&ours["xyz_sum_m"][axis], &theirs["sum"][name]);
            assert!(close(ours, theirs, tolerance_m), "{name}: {ours} {theirs}");
        }
    }
    let folder = tempfile::tempdir().unwrap();
    let short = write_capture(&folder.path().join("short.pcap"), &datagrams(&shared(HDL64))[..1500]);
    let (code, document, said) = decode(short.to_str().unwrap(), &[], &[]);
    assert_eq!((code, &document["sensors"][0]["beams"]), (0, &"nominal".into()));
    assert!(said.contains("placed by nominal beams") && said.contains("--calibration FILE"), "{said}");
    // a pipe cannot be read before it is decoded
    let from = std::fs::File::open(path(HDL64)).unwrap();
    let mut program = Command::new(env!("CARGO_BIN_EXE_outrigger"));
    let output = program.args(["decode", "-"]).stdin(from).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(said.contains("frames are placed by nominal beams: the unit had not sent"), "{said}");
}

fn calibrations_that_serve_nobody_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let written = |name: &str, lasers: usize| {
        let lines: String =
            (0..lasers).map(|id| format!("- {{laser_id: {id}, vert_correction: 0.0{id}}}\n")).collect();
        let file = folder.path().join(name);
        std::fs::write(&file, format!("lasers:\n{lines}")).unwrap();
        file.to_str().unwrap().to_owned()
    };
    let (right, wrong) = (written("right.yaml", 16), written("wrong.yaml", 32));
    let elsewhere = format!("10.9.8.7={right}");
    for (capture, metas, given, words) in [
        (VLP16, vec![], &elsewhere, "is not used: no Velodyne is that of 10.9.8.7; there is 10.0.0.100:2368"),
        (OS1, vec![path(OS1_META)], &right, "is not used: no Velodyne is in the recording"),
    ] {
        let metas: Vec<&str> = metas.iter().map(String::as_str).collect();
        let (code, document, said) = decode(&path(capture), &metas, &["--calibration", given]);
        assert!(code == 0 && said.contains(&format!("calibration {right} {words}")), "{said}");
        let beams = if metas.is_empty() { "nominal" } else { "of the metadata" };
        assert_eq!(document["sensors"][0]["beams"], beams);
    }
    let (code, document, said) = decode(&path(VLP16), &[], &["--calibration", &right]);
    assert_eq!((code, said.as_str()), (0, ""));
    assert_eq!(document["sensors"][0]["beams"], format!("as {right} says"));
    for verb in ["decode", "inspect"] {
        let output = outrigger(&[verb, &path(VLP16), "--calibration", &wrong]);
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.code() == Some(1) && output.stdout.is_empty(), "{verb}: {said}");
        assert!(said.contains(&format!("{wrong}, given for the vlp-16 from 10.0.0.100")), "{said}");
        assert!(said.contains("32 given, a vlp-16 has 16"), "{said}");
    }
    let (code, _, said) = decode(&path(VLP16), &[], &["--calibration", &format!("left={right}")]);
    assert!(code == 2 && said.contains("is no session, so its sensors have no names"), "{said}");
}

/// There is one level of it for both returns of a firing.
fn second_returns_have_the_ambient_light_too() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("points.csv");
    let name = "captures/ouster/OS-0-32-U1_v2.2.0_1024x10";
    let (capture, meta) = (path(&format!("{name}.pcap")), path(&format!("{name}.json")));
    let (code, _, said) = decode(&capture, &[&meta], &["--out", out.to_str().unwrap()]);
    assert_eq!(code, 0, "{said}");
    let text = std::fs::read_to_string(&out).unwrap();
    let mut levels = [0_u64; 2];
    for line in text.lines().skip(1) {
        let cells: Vec<&str> = line.split(',').collect();
        levels[cells[4].parse::<usize>().unwrap() - 1] += cells[13].parse::<u64>().unwrap();
    }
    assert!(levels.iter().all(|sum| *sum > 10_000), "{levels:?}");
}

/// What lies behind `--out`: a file, or a folder of files.
fn names_without_an_extension_are_folders() {
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let capture = place("walk.pcap");
    std::fs::copy(shared(VLP16), &capture).unwrap();
    let into = |out: &str| {
        let more = ["--format", "csv", "--out", out, "--force", "--frames", "0"];
        let (code, _, said) = decode(&capture, &[], &more);
        (code, said)
    };
    assert_eq!(into(&place("points.txt")).0, 0);
    assert!(Path::new(&place("points.txt")).is_file());
    for name in ["points", "dotted.d/"] {
        assert_eq!(into(&place(name)).0, 0);
        assert_eq!(std::fs::read_dir(place(name)).unwrap().count(), 1);
    }
    std::fs::write(place("taken"), "").unwrap();
    for (out, words) in [("taken", "cannot be a folder"), ("walk.pcap", "this is the recording itself")] {
        let (code, said) = into(&place(out));
        assert!(code == 1 && said.contains(words), "{said}");
    }
    assert!(std::fs::metadata(&capture).unwrap().len() > 100_000);
}

/// What is there, why nothing decodes, and what would help.
fn what_is_missing_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let alone = folder.path().join("alone.pcap");
    std::fs::copy(shared(OS1), &alone).unwrap();
    let of_legacy =
        &["192 packets of 8448 bytes to port 7502", "122201000998", "--meta", "/api/v1/sensor/metadata"];
    let cases: [(String, Vec<String>, &[&str]); 6] = [
        (alone.to_str().unwrap().into(), vec![], of_legacy),
        (path("captures/ouster/VLI-16-one-packet.pcap"), vec![], &["1212 bytes", "port 2368"]),
        (path("captures/ouster/empty_pcap.pcap"), vec![], &["no packets at all"]),
        (path("captures/README.md"), vec![], &["README.md is no capture", "# Captures"]),
        (
            path(OS1),
            vec![path("captures/ouster/OS-0-128-U1_v2.3.0_1024x10.json")],
            &["122201000998", "122150000150"],
        ),
        (
            path("captures/ouster/OS-1-64_1024x10_fw20.pcap"),
            vec![path("captures/ouster/OS-2-32-U0_v2.0.0_1024x10.json")],
            &["12608 bytes", "6464 bytes", "LEGACY x 64 pixels"],
        ),
    ];
    for (capture, metas, expected) in cases {
        let metas: Vec<&str> = metas.iter().map(String::as_str).collect();
        let (code, document, said) = decode(&capture, &metas, &[]);
        assert_eq!((code, document), (1, Value::Null), "{capture}: {said}");
        for text in expected {
            assert!(said.contains(text), "{capture}: {text:?} is not in: {said}");
        }
        let asks = said.contains("/api/v1/sensor/metadata");
        assert!(!asks || metas.is_empty(), "what was given is not asked for: {said}");
    }
}

fn a_cut_capture_is_decoded_up_to_the_cut() {
    let folder = tempfile::tempdir().unwrap();
    let cut = folder.path().join("cut.pcap");
    let whole = std::fs::read(shared(VLP16)).unwrap();
    std::fs::write(&cut, &whole[..300_000]).unwrap();
    let (code, document, said) = decode(cut.to_str().unwrap(), &[], &[]);
    assert_eq!(code, 3);
    assert!(said.contains("byte 299516"), "{said}");
    assert_eq!(document["capture_counters"]["truncated"]["offset"], 299_516);
    let mut damaged = whole.clone();
    damaged[299_516 + 8..299_516 + 12].fill(0xFF);
    let broken = folder.path().join("broken.pcap");
    std::fs::write(&broken, &damaged).unwrap();
    let (code, _, said) = decode(broken.to_str().unwrap(), &[], &[]);
    let unread = format!("from there on {} bytes were not read", whole.len() - 299_516);
    assert!(code == 3 && said.contains("damaged at byte 299516") && said.contains(&unread), "{said}");
    let (_, all, _) = decode(&path(VLP16), &[], &[]);
    for frame in 0..2 {
        assert_eq!(document["sensors"][0]["frames"][frame], all["sensors"][0]["frames"][frame]);
    }
}

/// The capture again as pcapng, without the lidar packets that `leave_out` names by their number.
fn rewritten(capture: &str, to: &Path, leave_out: &[usize]) -> PathBuf {
    let mut number = 0;
    let mut all = datagrams(&shared(capture));
    all.retain(|datagram| {
        let lidar = datagram.payload.len() > 1000;
        number += usize::from(lidar);
        !lidar || !leave_out.contains(&(number - 1))
    });
    write_capture(to, &all)
}

fn a_lost_packet_is_data_lost() {
    let folder = tempfile::tempdir().unwrap();
    let less = rewritten(OS1, &folder.path().join("less.pcapng"), &[100]);
    let (code, document, said) = decode(less.to_str().unwrap(), &[&path(OS1_META)], &[]);
    assert_eq!(code, 3);
    assert_eq!(document["sensors"][0]["counters"]["lost_packets"], 1);
    assert_eq!(document["sensors"][0]["frames"][1]["complete"], false);
    assert!(said.contains("1 packets never came"), "{said}");
}

fn pcapng_and_gzip_say_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let again = rewritten(OS1, &folder.path().join("again.pcapng"), &[]);
    let (_, mut original, _) = decode(&path(OS1), &[&path(OS1_META)], &[]);
    let packed = folder.path().join("again.pcapng.gz");
    let mut file = flate2::write::GzEncoder::new(std::fs::File::create(&packed).unwrap(), Default::default());
    file.write_all(&std::fs::read(&again).unwrap()).unwrap();
    file.finish().unwrap();
    for name in [again, packed] {
        let (code, mut document, _) = decode(name.to_str().unwrap(), &[&path(OS1_META)], &[]);
        assert_eq!(code, 0);
        original["capture"] = document["capture"].take();
        document["capture"] = original["capture"].clone();
        assert_eq!(document, original);
    }
}

fn a_signal_leaves_no_unfinished_file() {
    for signal in [Signal::SIGINT, Signal::SIGTERM] {
        let folder = tempfile::tempdir().unwrap();
        let mut program = Command::new(env!("CARGO_BIN_EXE_outrigger"));
        program.args(["decode", "-", "--out"]).arg(folder.path().join("points.las"));
        let piped = program.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut running = piped.spawn().unwrap();
        let capture = std::fs::read(shared(VLP16)).unwrap();
        let mut packets = running.stdin.take().unwrap();
        packets.write_all(&capture[..capture.len() / 2]).unwrap();
        let files = || std::fs::read_dir(folder.path()).unwrap().count();
        let began = Instant::now();
        while files() == 0 {
            assert!(began.elapsed() < Duration::from_secs(30), "no file was begun");
            std::thread::sleep(Duration::from_millis(10));
        }
        kill(Pid::from_raw(running.id() as i32), signal).unwrap();
        packets.write_all(&capture[capture.len() / 2..]).ok(); // it may have ended by then
        drop(packets);
        let output = running.wait_with_output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{said}");
        assert!(said.contains("interrupted: whole files stay"), "{said}");
        assert!(output.stdout.is_empty());
        assert_eq!(files(), 0);
    }
}
