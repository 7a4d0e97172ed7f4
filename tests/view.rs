//! `outrigger view`: what the page is given is what `decode` gives.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use serde_json::Value;

use crate::decode::{decode, outrigger, path};
use crate::support::{Case, case, with_shared};

pub const CASES: &[Case] = &[
    with_shared("points_are_those_of_decode_in_any_order", points_are_those_of_decode_in_any_order),
    with_shared("far_revolutions_of_a_long_recording_are_those_of_decode", far_revolutions),
    with_shared("points_lie_in_the_world_of_the_trajectory", points_lie_in_the_world_of_the_trajectory),
    with_shared("only_this_host_is_answered", only_this_host_is_answered),
    with_shared("a_scene_lies_under_the_points", a_scene_lies_under_the_points),
    case("a_report_holds_what_it_shows_in_3d", a_report_holds_what_it_shows_in_3d),
    case("a_file_without_packets_is_refused", a_file_without_packets_is_refused),
];

const VELODYNE: &str = "captures/velodyne/nebula_vls128.pcap";
const OUSTER: [&str; 2] =
    ["captures/ouster/OS-1-128_v2.3.0_1024x10_lb_n3.pcap", "captures/ouster/OS-1-128_v2.3.0_1024x10.json"];
/// Bytes before the first point.
const HEADER: usize = 40;

struct Viewer {
    child: Child,
    address: String,
}

impl Viewer {
    fn start(arguments: &[&str]) -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_outrigger"))
            .args(["view", "--no-open"])
            .args(arguments)
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let address = line.trim().trim_start_matches("http://").trim_end_matches('/').to_owned();
        Self { child, address }
    }

    fn get_as(&self, path: &str, host: &str) -> (u16, Vec<u8>) {
        let mut stream = TcpStream::connect(&self.address).unwrap();
        write!(stream, "GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n").unwrap();
        let mut bytes = Vec::new();
        stream.read_to_end(&mut bytes).unwrap();
        let head = bytes.windows(4).position(|four| four == b"\r\n\r\n").unwrap();
        let code = std::str::from_utf8(&bytes[9..12]).unwrap().parse().unwrap();
        (code, bytes.split_off(head + 4))
    }

    fn get(&self, path: &str) -> (u16, Vec<u8>) {
        self.get_as(path, &self.address)
    }

    /// The index of the whole recording.
    fn index(&self) -> Value {
        let until = Instant::now() + Duration::from_secs(120);
        loop {
            let index: Value = serde_json::from_slice(&self.get("/api/recording/0").1).unwrap();
            if index["is_whole"] == true {
                return index;
            }
            assert!(Instant::now() < until, "the recording is not read to its end");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// First returns of a revolution: how many, and the sum of their positions.
    fn first_returns(&self, frame: &str, number: usize) -> (u64, [f64; 3]) {
        let (code, bytes) = self.get(&format!("/api/points/{frame}/0/{number}"));
        assert_eq!(code, 200);
        let count = u32::from_le_bytes(bytes[..4].try_into().unwrap()) as usize;
        assert_eq!(bytes.len(), HEADER + count * 30);
        let is_first = |at: usize| bytes[HEADER + count * 29 + at] == 1;
        let (mut points, mut sum_m) = (0, [0.0; 3]);
        for at in (0..count).filter(|at| is_first(*at)) {
            points += 1;
            for (axis, sum) in sum_m.iter_mut().enumerate() {
                let place = HEADER + 12 * at + 4 * axis;
                *sum += f64::from(f32::from_le_bytes(bytes[place..place + 4].try_into().unwrap()));
            }
        }
        (points, sum_m)
    }
}

impl Drop for Viewer {
    fn drop(&mut self) {
        kill(Pid::from_raw(self.child.id() as i32), Signal::SIGINT).unwrap();
        let status = self.child.wait().unwrap();
        if !std::thread::panicking() {
            assert_eq!(status.code(), Some(0), "Ctrl-C ends it in order");
        }
    }
}

fn assert_equal(viewer: &Viewer, frames: &[Value], number: usize, shift_m: [f64; 3], frame: &str) {
    let (points, sum_m) = viewer.first_returns(frame, number);
    assert_eq!(Some(points), frames[number]["points"].as_u64(), "revolution {number}");
    for axis in 0..3 {
        let expected_m = frames[number]["xyz_sum_m"][axis].as_f64().unwrap() + points as f64 * shift_m[axis];
        // 32 bits hold a position to some micrometres
        let apart_m = (sum_m[axis] - expected_m).abs();
        assert!(apart_m < 1e-5 * points as f64, "revolution {number}: {sum_m:?}, expected {expected_m}");
    }
}

fn points_are_those_of_decode_in_any_order() {
    for (capture, metas) in [(path(VELODYNE), vec![]), (path(OUSTER[0]), vec![path(OUSTER[1])])] {
        let metas: Vec<&str> = metas.iter().map(String::as_str).collect();
        let (_, document, _) = decode(&capture, &metas, &[]);
        let frames = document["sensors"][0]["frames"].as_array().unwrap();
        let mut arguments = vec![capture.as_str()];
        arguments.extend(metas.iter().flat_map(|meta| ["--meta", meta]));
        let viewer = Viewer::start(&arguments);
        let index = viewer.index();
        assert_eq!(index["sensors"][0]["revolutions"].as_array().unwrap().len(), frames.len());
        for number in (0..frames.len()).rev().chain(0..frames.len()) {
            assert_equal(&viewer, frames, number, [0.0; 3], "sensor");
        }
        assert_eq!(viewer.get(&format!("/api/points/sensor/0/{}", frames.len())).0, 404);
        assert_eq!(viewer.get("/api/points/world/0/0").0, 400, "no trajectory was given");
    }
}

/// The whole revolutions of the capture again and again, each time later.
fn long_recording(to: &std::path::Path, turns: u64) {
    const STAMP: usize = 16 + 42 + 1200;
    const AZIMUTH: usize = 16 + 42 + 2;
    let capture = std::fs::read(path(VELODYNE)).unwrap();
    let u32_at = |bytes: &[u8], at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    let time_us = |record: &[u8]| u64::from(u32_at(record, 0)) * 1_000_000 + u64::from(u32_at(record, 4));
    let azimuth = |record: &[u8]| u16::from_le_bytes([record[AZIMUTH], record[AZIMUTH + 1]]);
    let mut records = Vec::new();
    let mut at = 24;
    while at < capture.len() {
        let length = 16 + u32_at(&capture, at + 8) as usize;
        records.push(&capture[at..at + length]);
        at += length;
    }
    let begins: Vec<_> =
        (1..records.len()).filter(|at| azimuth(records[*at]) < azimuth(records[at - 1])).collect();
    let (first, behind) = (begins[0], *begins.last().unwrap());
    let span_us = time_us(records[behind]) - time_us(records[first]);
    let mut long = capture[..24].to_vec();
    for turn in 0..turns {
        for record in &records[first..behind] {
            let (mut later, host_us) = (record.to_vec(), time_us(record) + turn * span_us);
            later[..4].copy_from_slice(&((host_us / 1_000_000) as u32).to_le_bytes());
            later[4..8].copy_from_slice(&((host_us % 1_000_000) as u32).to_le_bytes());
            let stamp_us = (u64::from(u32_at(record, STAMP)) + turn * span_us) % 3_600_000_000;
            later[STAMP..STAMP + 4].copy_from_slice(&(stamp_us as u32).to_le_bytes());
            long.extend(later);
        }
    }
    std::fs::write(to, long).unwrap();
}

fn far_revolutions() {
    let folder = tempfile::tempdir().unwrap();
    let long = folder.path().join("long.pcap");
    long_recording(&long, 8);
    let long = long.to_str().unwrap();
    let (_, document, _) = decode(long, &[], &[]);
    let frames = document["sensors"][0]["frames"].as_array().unwrap();
    assert!(frames.len() > 14, "{}: more than the program stores from the start", frames.len());
    let viewer = Viewer::start(&[long]);
    assert_eq!(viewer.index()["sensors"][0]["revolutions"].as_array().unwrap().len(), frames.len());
    for number in (9..frames.len()).step_by(2).chain((8..frames.len()).rev().step_by(2)) {
        assert_equal(&viewer, frames, number, [0.0; 3], "sensor");
    }
}

fn points_lie_in_the_world_of_the_trajectory() {
    let capture = path(VELODYNE);
    let (_, document, _) = decode(&capture, &[], &[]);
    let frames = document["sensors"][0]["frames"].as_array().unwrap();
    let time_s = |name: &str, frame: &Value| frame[name].as_u64().unwrap() / 1_000_000_000;
    let (first_s, last_s) =
        (time_s("first_time_ns", &frames[0]), time_s("last_time_ns", frames.last().unwrap()) + 2);
    let folder = tempfile::tempdir().unwrap();
    let walk = folder.path().join("walk.tum");
    // far out in UTM, and turned by half a turn about up
    let pose = "412345.25 5567890.5 312.125 0 0 1 0";
    std::fs::write(&walk, format!("{} {pose}\n{last_s} {pose}\n", first_s - 1)).unwrap();
    let viewer = Viewer::start(&[&capture, "--trajectory", walk.to_str().unwrap()]);
    let index = viewer.index();
    assert_eq!(index["origin_m"], serde_json::json!([412_345.0, 5_567_891.0, 312.0]));
    for number in [frames.len() - 1, 0] {
        let mut turned = frames.clone();
        for sum_m in turned[number]["xyz_sum_m"].as_array_mut().unwrap().iter_mut().take(2) {
            *sum_m = (-sum_m.as_f64().unwrap()).into();
        }
        assert_equal(&viewer, &turned, number, [0.25, -0.5, 0.125], "world");
    }
}

/// Two walls of a room of 6 x 4 x 3 m, in UTM.
const WALLS: &str = "v 412340 5567890 312\nv 412346 5567890 312\nv 412346 5567890 315\nv 412346 5567894 312\n\
                     f 1 2 3\nf 2 4 3\n";

fn a_scene_lies_under_the_points() {
    let capture = path(VELODYNE);
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &str| {
        std::fs::write(folder.path().join(name), text).unwrap();
        folder.path().join(name).display().to_string()
    };
    let walk = file(
        "walk.tum",
        "1585897000 412345.25 5567890.5 312.125 0 0 0 1\n1585897900 412345.25 5567890.5 312.125 0 0 0 1\n",
    );
    let scene = file("walls.obj", WALLS);
    let viewer = Viewer::start(&[&capture, "--trajectory", &walk, "--scene", &scene]);
    let index = viewer.index();
    let origin_m: Vec<f64> = serde_json::from_value(index["origin_m"].clone()).unwrap();
    let (code, bytes) = viewer.get("/api/scene");
    assert_eq!((code, &bytes[..8]), (200, &[1, 0, 0, 0, 6, 0, 0, 0][..]), "two triangles");
    let corner_m = |corner: usize| {
        [0, 1, 2].map(|axis| {
            let at = 8 + 12 * corner + 4 * axis;
            f64::from(f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())) + origin_m[axis]
        })
    };
    assert_eq!(corner_m(0), [412_340.0, 5_567_890.0, 312.0]);
    assert_eq!(corner_m(4), [412_346.0, 5_567_894.0, 312.0]);
    assert_eq!(Viewer::start(&[&capture, "--trajectory", &walk]).get("/api/scene").0, 404);
    let output = outrigger(&["view", "--no-open", &capture, "--scene", &scene]);
    let words = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.code() == Some(2) && words.contains("--trajectory"), "{words}");
}

/// The data of a page's 3-D picture.
fn orbit_of(page: &str) -> Value {
    let start = page.find("<script type=\"application/json\">").unwrap() + 32;
    let end = start + page[start..].find("</script>").unwrap();
    serde_json::from_str(&page[start..end]).unwrap()
}

fn a_report_holds_what_it_shows_in_3d() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name).display().to_string();
    std::fs::write(file("walk.tum"), "0 2 2 1.5 0 0 0 1\n1 4 2 1.5 0 0 0 1\n").unwrap();
    let output = outrigger(&[
        "--json",
        "predict",
        "--mounts=0.1,0,0.1,30,0;-0.1,0,0.1,-30,0",
        "--sensors",
        "vlp-16",
        "--room",
        "0,0,0,6,4,3",
        "--trajectory",
        &file("walk.tum"),
        "--azimuths",
        "60",
        "--fidelity",
        "given",
        "--report",
        &file("page.html"),
    ]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let document: Value = crate::support::document(&output.stdout).unwrap();
    let page = std::fs::read_to_string(file("page.html")).unwrap();
    let orbit = orbit_of(&page);
    let layers = orbit["layers"].as_array().unwrap();
    let places_m = |layer: &Value| -> Vec<[f64; 3]> {
        let bytes = STANDARD.decode(layer["places"].as_str().unwrap()).unwrap();
        let counts: Vec<i16> = bytes.chunks(2).map(|two| i16::from_le_bytes([two[0], two[1]])).collect();
        let metres = |axis: usize, count: i16| {
            orbit["middle_m"][axis].as_f64().unwrap() + f64::from(count) * orbit["count_m"].as_f64().unwrap()
        };
        counts.chunks(3).map(|place| [0, 1, 2].map(|axis| metres(axis, place[axis]))).collect()
    };
    let cells = || layers.iter().filter(|layer| layer["shape"] == "points");
    let all: usize = cells().map(|layer| places_m(layer).len()).sum();
    assert_eq!(Some(all as u64), document["reachable_voxels"].as_u64());
    let unseen = cells()
        .find(|layer| layer["name"] == "observable, but unseen")
        .map_or(0, |layer| places_m(layer).len());
    assert_eq!(Some((all - unseen) as u64), document["unique_voxels"].as_u64());
    // walls lie in the middle of their voxels
    for [x, y, z] in cells().flat_map(places_m) {
        let off_m = [x, 6.0 - x, y, 4.0 - y, z, 3.0 - z].map(f64::abs);
        assert!(off_m.iter().any(|off_m| *off_m < 1e-3), "{x} {y} {z}");
    }
    let path: Vec<_> =
        layers.iter().filter(|layer| layer["name"] == "trajectory").flat_map(places_m).collect();
    assert!((path[0][0] - 2.0).abs() < 1e-3 && (path.last().unwrap()[0] - 4.0).abs() < 1e-3, "{path:?}");
    assert!(layers.iter().any(|layer| layer["name"] == "field of view of sensor 1"));
    assert!(page.contains("<svg class=\"cells\"") && page.len() < 8_000_000);
}

fn only_this_host_is_answered() {
    let viewer = Viewer::start(&[&path(VELODYNE)]);
    let (code, page) = viewer.get("/");
    assert!(code == 200 && page.starts_with(b"<!doctype html>"));
    assert_eq!(viewer.get_as("/api/recording/0", "example.org").0, 403);
    assert_eq!(viewer.get("/api/nothing").0, 404);
}

fn a_file_without_packets_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("notes.txt");
    std::fs::write(&file, "no packets").unwrap();
    let output = outrigger(&["view", "--no-open", file.to_str().unwrap()]);
    let words = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{words}");
    assert!(words.contains("notes.txt"), "{words}");
    let output = outrigger(&["view", "--no-open", "--listen", "0.0.0.0:0", file.to_str().unwrap()]);
    assert_ne!(output.status.code(), Some(0));
}
