//! `outrigger view`: what the page is given is what `decode` gives.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use serde_json::Value;

use crate::decode::{decode, outrigger, path};
use crate::support::{Case, case, with_shared};

pub const CASES: &[Case] = &[
    with_shared("points_are_those_of_decode_in_any_order", points_are_those_of_decode_in_any_order),
    with_shared("points_lie_in_the_world_of_the_trajectory", points_lie_in_the_world_of_the_trajectory),
    with_shared("only_this_host_is_answered", only_this_host_is_answered),
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
