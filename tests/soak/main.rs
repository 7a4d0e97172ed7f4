//! Hours of trouble: the daemon with three mock sensors, a mock rig, pages and a small disk, and a fault every few seconds,
//! all of it from one seed.
//!
//!     cargo bench --bench soak                               # two hours
//!     OUTRIGGER_SOAK_SECONDS=300 OUTRIGGER_SOAK_SEED=7 cargo bench --bench soak
//!
//! What must hold: every fault is explained by the state in bounded time and forgotten when it is over; packets received
//! and packets counted as lost are those that were sent, over the daemon's life and in each session; every session is
//! whole, opens with `inspect` and verifies; memory, open files and threads do not grow; the daemon ends in order.
//! Exit status 1 when something did not.

#![allow(clippy::unwrap_used)] // a run that cannot go on may say so and end

use std::os::unix::fs::MetadataExt as _;
use std::os::unix::process::CommandExt as _;
use std::process::Command;
use std::time::{Duration, Instant};

use outrigger::rig::MountFile;

#[path = "../daemon/program.rs"]
#[allow(dead_code)] // the tests of the daemon use more of it
mod program;
#[path = "../daemon/sensor.rs"]
#[allow(dead_code)]
mod sensor;

mod feed;
mod pages;
mod recorder;
mod rig;
mod sensors_lane;
mod watch;

use feed::{Feed, Gate};
use program::{Bench, Running};
use watch::{Log, Watch};

const CONFIG: &str = "[rig]\nport = \"rig\"\nlimits_deg = [[-45, 45]]\ntimeout_s = 60\n[predict]\nmount = \"mount.json\"\n\
                      room = \"-6,-4,-1.5,6,4,2\"\n";
/// Where sessions go is so small, MiB.
const DISK_MIB: u64 = 512;
/// Growth of memory that is no leak, whatever the length of the run, MiB.
const GROWTH_MIB: f64 = 8.0;

fn environment<T: std::str::FromStr>(name: &str, usual: T) -> T {
    let Ok(text) = std::env::var(name) else { return usual };
    text.parse().unwrap_or_else(|_| panic!("{name}={text} is no number"))
}

/// Goes on in a mount name space of its own with a small disk for sessions: as root, or as a user who may be root there.
fn with_a_small_disk() -> std::path::PathBuf {
    if let Some(disk) = std::env::var_os("OUTRIGGER_SOAK_DISK") {
        return disk.into();
    }
    let folder = std::env::temp_dir().join(format!("outrigger-soak-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let mut command = Command::new("unshare");
    command.arg("--mount");
    if std::fs::metadata("/proc/self").unwrap().uid() != 0 {
        command.arg("--map-root-user");
    }
    let script = format!("mount -t tmpfs -o size={DISK_MIB}m tmpfs \"$OUTRIGGER_SOAK_DISK\"; exec \"$0\"");
    command.args(["sh", "-ec", &script]).arg(std::env::current_exe().unwrap());
    panic!("no small disk: unshare: {}", command.env("OUTRIGGER_SOAK_DISK", folder).exec());
}

fn start(bench: &Bench, disk: &std::path::Path) -> Running {
    let config = std::fs::read_to_string(bench.path("rig.toml")).unwrap();
    let config = config.replace("listen = \"127.0.0.1:0\"", "listen = \"0.0.0.0:0\"\nsource = \"127.0.0.1\"");
    std::fs::write(bench.path("rig.toml"), config).unwrap();
    let sensors = [("left", "os1-16", -0.1), ("right", "vlp-16", 0.1), ("front", "vlp-16", 0.0)];
    let entries = sensors.map(|(name, model, x_m)| sensor::entry(name, model, [x_m, 0.0], 0.0));
    MountFile::new(entries.to_vec()).write(&bench.path("mount.json")).unwrap();
    let mut command = Command::new(program_path());
    let more = ["--warn-below-mib", "96", "--stop-below-mib", "64"];
    command.args(bench.arguments(&disk.join("sessions"), &more));
    Running::start(command)
}

fn main() {
    let disk = with_a_small_disk();
    let length = Duration::from_secs(environment("OUTRIGGER_SOAK_SECONDS", 7200));
    let seed: u64 = environment("OUTRIGGER_SOAK_SEED", 1);
    let bench = Bench::new(&["left", "right", "front"], CONFIG);
    let mut arm = rig::Bench::plug(bench.path("rig"));
    let daemon = start(&bench, &disk);
    let gate = Gate::default();
    let feeds: [Feed; 3] = std::array::from_fn(|number| {
        let port = daemon.sensor(number).port();
        Feed::new(number, (std::net::Ipv4Addr::LOCALHOST, port).into(), &gate)
    });
    let log = Log::default();
    let watch = Watch::new(&daemon, &log, length);
    println!(
        "seed {seed}, {} s, daemon {}, sessions in {}",
        length.as_secs(),
        daemon.child.id(),
        disk.display()
    );
    let begun = Instant::now();
    std::thread::scope(|scope| {
        let watching = scope.spawn(|| watch.run());
        let lanes = [
            scope.spawn(|| sensors_lane::ouster(&watch, &feeds[0], seed)),
            scope.spawn(|| sensors_lane::velodyne(&watch, &feeds[1], seed)),
            scope.spawn(|| sensors_lane::process(&watch, &feeds[2], &program_path(), seed)),
            scope.spawn(|| rig::lane(&watch, &mut arm, seed)),
            scope.spawn(|| pages::lane(&watch, daemon.address, seed)),
            scope.spawn(|| recorder::lane(&watch, &gate, &feeds, &disk, &program_path(), seed)),
        ];
        for lane in lanes {
            if lane.join().is_err() {
                log.fail("a lane of this program panicked".into());
            }
        }
        watch.end();
        watching.join().unwrap();
    });
    recorder::balance(&watch, &gate, &feeds, "at the end");
    let (code, said) = daemon.end();
    let expected = if log.data_was_lost() { 3 } else { 0 };
    if code != Some(expected) {
        log.fail(format!("the daemon ended with {code:?}, not {expected}"));
    }
    log.read(&said);
    drop(feeds);
    let good = log.conclude(begun.elapsed(), GROWTH_MIB);
    std::process::exit(i32::from(!good));
}

/// Another program than the one built beside this one, where it is named.
fn program_path() -> std::path::PathBuf {
    std::env::var_os("OUTRIGGER_SOAK_PROGRAM").map_or(env!("CARGO_BIN_EXE_outrigger").into(), Into::into)
}
