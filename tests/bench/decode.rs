//! How fast one core decodes: capture file to XYZ arrays, beside the sensors' own or a well-known package, and a plain
//! copy of the bytes. `cargo bench --bench decode [-- NAME]`; captures come from the folder that `OUTRIGGER_SHARED`
//! names (default `../shared`), peers from the interpreter that `PYTHON` names (`python3` otherwise).
//!
//! Each capture is first made long (its packets over and over, counters and stamps moved on). All ways through it, ours
//! and the peer's, then take turns, so that the machine's mood cancels; figures are medians, a run's time is the lesser
//! of processor and wall time. Ours goes the way of the program: reader, router, decoder with every field, projector.

#[path = "decode/ours.rs"]
mod ours;
#[path = "decode/peer.rs"]
mod peer;
#[path = "decode/recording.rs"]
mod recording;
#[allow(dead_code)] // not every bench needs all of it
mod support;

use std::path::{Path, PathBuf};
use std::time::Instant;

use sensors::ouster::{Metadata, Profile};

use ours::{Met, Points, Way};
use peer::Peer;
use recording::{Recording, Sensor, datagrams};
use support::{median, process_cpu_s};

const ROUNDS: usize = 5;
/// Shortest timing; faster ways are repeated within one.
const LEAST_S: f64 = 0.1;
const FILE_BYTES: usize = 40 << 20;
/// Captures with fewer lidar packets say nothing about speed.
const LEAST_PACKETS: usize = 8;

const WAYS: [Way; 6] = [Way::Read, Way::Frames, Way::Single, Way::Double, Way::CoreSingle, Way::CoreDouble];

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|word| word != "--bench").collect();
    if let [flag, capture, meta] = &arguments[..]
        && flag == "--peak-memory"
    {
        return println!("{}", peak_memory_kib(capture.as_ref(), meta));
    }
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    let shared = std::env::var_os("OUTRIGGER_SHARED").map_or_else(|| root.join("../shared"), PathBuf::from);
    let wanted = arguments.first().map_or("", String::as_str);
    let recordings = recordings(&shared.join("captures"));
    let chosen: Vec<_> = recordings.iter().filter(|recording| recording.name.contains(wanted)).collect();
    assert!(!chosen.is_empty(), "no capture with {wanted:?} in its name below {}", shared.display());
    let folder = tempfile::tempdir().expect("a folder for long captures");
    println!("{}", HEAD.join("\n"));
    let rows: Vec<Row> = chosen.iter().map(|recording| Row::measure(recording, folder.path())).collect();
    summarise(&rows);
    println!("\npeak memory of a process that turns a file into points");
    memory(chosen[0], folder.path());
    if let [_, .., last] = &chosen[..] {
        memory(last, folder.path());
    }
}

const HEAD: [&str; 3] = [
    "                                                        M points/s     MB/s  time to  times as fast as the peer   where the time goes",
    "                                                                                copy   from a file  from memory   read frame project",
    "capture                        format                     f32    f64      f32       =1    f32    f64    f32    f64      %     %       %",
];

/// The medians of one capture, s.
struct Row {
    name: String,
    ours: [f64; WAYS.len()],
    peer: Option<PeerTimes>,
}

struct PeerTimes {
    file: f64,
    file_double: Option<f64>,
    core: f64,
    core_double: Option<f64>,
}

impl Row {
    fn measure(recording: &Recording, folder: &Path) -> Self {
        let path = folder.join("long.pcap");
        recording.write_long(&path, FILE_BYTES);
        let met = ours::count(&path, &recording.sensor);
        let packets = datagrams(&path);
        let mut peer = Peer::start(&path, &recording.sensor);
        let peer_ways: &[&str] = match recording.sensor {
            Sensor::Ouster { .. } => &["file", "file_range", "file_f64", "core", "core_f64"],
            Sensor::Velodyne(_) => &["file", "file_range", "core"],
        };
        let bytes = std::fs::read(&path).expect("the long capture");
        let mut copy = vec![0; bytes.len()];
        let mut points = Points::default();
        let mut times: Vec<Vec<f64>> = vec![Vec::new(); WAYS.len() + 1 + peer_ways.len()];
        for _ in 0..ROUNDS {
            for (way, times) in WAYS.into_iter().zip(&mut times) {
                times.push(timed_s(|| match way {
                    Way::CoreSingle | Way::CoreDouble => {
                        ours::core(way, &packets, &recording.sensor, &mut points);
                    }
                    _ => ours::file(way, &path, &recording.sensor, &mut points),
                }));
            }
            times[WAYS.len()].push(timed_s(|| {
                copy.copy_from_slice(std::hint::black_box(&bytes));
                std::hint::black_box(&copy);
            }));
            if let Ok(peer) = &mut peer {
                for (way, times) in peer_ways.iter().zip(&mut times[WAYS.len() + 1..]) {
                    times.push(peer.run_s(way));
                }
            }
        }
        let medians: Vec<f64> = times.into_iter().filter(|times| !times.is_empty()).map(median).collect();
        let (ours, rest) = medians.split_at(WAYS.len());
        let row = Self {
            name: recording.name.clone(),
            ours: std::array::from_fn(|way| ours[way]),
            peer: peer.is_ok().then(|| match *rest {
                [_, file, range, file_double, core, core_double] => PeerTimes {
                    file: file.min(range),
                    file_double: Some(file_double),
                    core,
                    core_double: Some(core_double),
                },
                [_, structures, arrays, core] => {
                    PeerTimes { file: structures.min(arrays), file_double: None, core, core_double: None }
                }
                _ => unreachable!("as many as ways"),
            }),
        };
        row.print(recording, met, bytes.len(), rest[0]);
        match peer {
            Ok(peer) if peer.points.abs_diff(met.points) * 50 > met.points => {
                println!("    the peer finds {} points, we {}", peer.points, met.points);
            }
            Ok(_) => {}
            Err(reason) => println!("    no peer: {reason}"),
        }
        row
    }

    fn print(&self, recording: &Recording, met: Met, bytes: usize, copy_s: f64) {
        let [read, frames, single, double, ..] = self.ours;
        let format = match &recording.sensor {
            Sensor::Ouster { metadata, .. } => {
                format!("{} x{}", metadata.profile.name(), metadata.pixels_per_column)
            }
            Sensor::Velodyne(model) => (*model).to_owned(),
        };
        // a Velodyne is made of points, an Ouster of pixels: the peers' arrays hold those
        let points = match recording.sensor {
            Sensor::Ouster { .. } => met.samples,
            Sensor::Velodyne(_) => met.points,
        } as f64;
        let share = |seconds: f64| 100.0 * seconds.max(0.0) / single;
        let faster = |seconds: Option<f64>, way: usize| {
            seconds.map_or("-".into(), |seconds| format!("{:.1}", seconds / self.ours[way]))
        };
        let peer = self.peer.as_ref();
        println!(
            "{:30.30} {:24.24} {:6.0} {:6.0} {:8.0} {:8.1} {:>6} {:>6} {:>6} {:>6} {:6.0} {:5.0} {:7.0}",
            self.name,
            format.replace("RNG", "").replace("RFL", "").replace("SIG", "").replace("NIR", ""),
            points / single / 1e6,
            points / double / 1e6,
            bytes as f64 / single / 1e6,
            single / copy_s,
            faster(peer.map(|peer| peer.file), 2),
            faster(peer.and_then(|peer| peer.file_double), 3),
            faster(peer.map(|peer| peer.core), 4),
            faster(peer.and_then(|peer| peer.core_double), 5),
            share(read),
            share(frames - read),
            share(single - frames),
        );
    }
}

fn summarise(rows: &[Row]) {
    let least = |what: &str, ratio: &dyn Fn(&Row) -> Option<f64>| {
        let found = rows.iter().filter_map(|row| Some((ratio(row)?, &row.name)));
        if let Some((ratio, name)) = found.min_by(|a, b| a.0.total_cmp(&b.0)) {
            println!("least ratio to the peer, {what}: {ratio:.2} ({name})");
        }
    };
    println!();
    least("file to f32", &|row| Some(row.peer.as_ref()?.file / row.ours[2]));
    least("file to f64", &|row| Some(row.peer.as_ref()?.file_double? / row.ours[3]));
    least("memory to f32", &|row| Some(row.peer.as_ref()?.core / row.ours[4]));
    least("memory to f64", &|row| Some(row.peer.as_ref()?.core_double? / row.ours[5]));
}

/// Seconds of one run.
fn timed_s(mut run: impl FnMut()) -> f64 {
    let (cpu_start_s, start, mut runs) = (process_cpu_s(), Instant::now(), 0);
    loop {
        run();
        runs += 1;
        let least_s = (process_cpu_s() - cpu_start_s).min(start.elapsed().as_secs_f64());
        if least_s >= LEAST_S {
            return least_s / f64::from(runs);
        }
    }
}

/// Every capture of the collection that both sides read.
fn recordings(captures: &Path) -> Vec<Recording> {
    let mut found = Vec::new();
    for folder in ["ouster", "ouster/synthetic", "velodyne", "velodyne/synthetic"] {
        let Ok(entries) = std::fs::read_dir(captures.join(folder)) else { continue };
        let mut digests: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
        digests.retain(|path| path.to_string_lossy().ends_with(".digest.json"));
        digests.sort();
        for digest in digests {
            let name = digest.file_name().unwrap_or_default().to_string_lossy().replace(".digest.json", "");
            let capture = digest.with_file_name(format!("{name}.pcap"));
            let sensor = match folder.starts_with("ouster") {
                true => ouster(&digest),
                false => Sensor::Velodyne(velodyne(&name)),
            };
            let packets = match &sensor {
                Sensor::Ouster { metadata, .. } if metadata.profile == Profile::Off => 0,
                Sensor::Ouster { metadata, .. } => {
                    let length = metadata.packet_format().packet_bytes();
                    datagrams(&capture)
                        .iter()
                        .filter(|packet| packet.packet().payload.len() == length)
                        .count()
                }
                Sensor::Velodyne(_) => LEAST_PACKETS,
            };
            if packets < LEAST_PACKETS {
                println!("left out: {name}, which has {packets} lidar packets");
                continue;
            }
            if name.contains("lb_n3") || name.contains("fw20") {
                let name = format!("{}, fragments", &name[..name.len().min(18)]);
                found.push(Recording {
                    name,
                    fragmented: true,
                    capture: capture.clone(),
                    sensor: sensor.clone(),
                });
            }
            found.push(Recording { name, fragmented: false, capture, sensor });
        }
    }
    found
}

fn ouster(digest: &Path) -> Sensor {
    let text = std::fs::read_to_string(digest).expect("a digest");
    let digest_json: serde_json::Value = serde_json::from_str(&text).expect("a digest");
    let meta =
        digest.with_file_name(digest_json["metadata"].as_str().expect("the digest names its metadata"));
    let text = std::fs::read_to_string(&meta).expect("metadata");
    Sensor::Ouster { metadata: Box::new(Metadata::parse(&text, "metadata").expect("metadata")), meta }
}

/// What the peer calls the model; the captures are named after it, but for one.
fn velodyne(name: &str) -> &'static str {
    let models = [
        ("hdl32e", "HDL32E"),
        ("hdl64e_S2", "HDL64E_S2"),
        ("vls128", "VLS128"),
        ("vlp32", "VLP32C"),
        ("vlp16", "VLP16"),
    ];
    models.iter().find(|(part, _)| name.contains(part)).expect("a model in the capture's name").1
}

/// Peak memory of a process for a file and for one twenty times as long.
fn memory(recording: &Recording, folder: &Path) {
    let path = folder.join("memory.pcap");
    let meta = match &recording.sensor {
        Sensor::Ouster { meta, .. } => meta.display().to_string(),
        Sensor::Velodyne(model) => (*model).to_owned(),
    };
    for length in [FILE_BYTES / 20, FILE_BYTES] {
        recording.write_long(&path, length);
        let program = std::env::current_exe().expect("this program");
        let output = std::process::Command::new(program).arg("--peak-memory").arg(&path).arg(&meta).output();
        let said = output.map(|output| String::from_utf8_lossy(&output.stdout).trim().to_owned());
        let kib = said.expect("this program runs");
        println!("    {:30} file {:6.1} MiB, peak {kib} KiB", recording.name, length as f64 / 1048576.0);
    }
}

fn peak_memory_kib(capture: &Path, meta: &str) -> u64 {
    let sensor = match std::fs::read_to_string(meta) {
        Ok(text) => Sensor::Ouster {
            metadata: Box::new(Metadata::parse(&text, meta).expect("metadata")),
            meta: meta.into(),
        },
        Err(_) => Sensor::Velodyne("any"),
    };
    ours::file(Way::Single, capture, &sensor, &mut Points::default());
    let status = std::fs::read_to_string("/proc/self/status").expect("a Linux machine");
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).expect("the kernel counts");
    peak.trim().trim_end_matches(" kB").parse().expect("a number")
}
