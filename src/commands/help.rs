//! What every `--help` looks like: flags under headings, those of experts under `--help-all` alone, two examples at the end.

use clap::{Command, CommandFactory as _};

use super::Cli;

/// Flags of each heading, the same in every verb: a flag has one meaning.
const HEADINGS: [(&str, &[&str]); 4] = [
    (
        "Input",
        &[
            "arm",
            "calibration",
            "dry-run",
            "from",
            "home",
            "listen",
            "masters",
            "meta",
            "metadata",
            "model",
            "mount",
            "mounts",
            "planned",
            "port",
            "present",
            "preset",
            "resume",
            "sensor",
            "sensors",
        ],
    ),
    (
        "Scene",
        &[
            "align",
            "align-near",
            "map-frames",
            "mesh-unit",
            "room",
            "samples",
            "scene",
            "time-offset",
            "trajectory",
            "up",
        ],
    ),
    (
        "Model",
        &[
            "azimuths",
            "clearance",
            "evals",
            "ideal",
            "lambda",
            "limits-deg",
            "masters-max",
            "max-range",
            "method",
            "min-range",
            "no-baselines",
            "no-mirror",
            "operator",
            "pitch-limits",
            "robust",
            "seed",
            "space",
            "tilt-step",
            "tolerance",
            "voxel",
        ],
    ),
    (
        "Output",
        &[
            "corrected-mount",
            "drawing",
            "force",
            "format",
            "frame",
            "frames",
            "kitti",
            "map",
            "out",
            "report",
            "save-metadata",
            "scad",
            "tf",
            "to",
            "trajectory-out",
            "urdf",
        ],
    ),
];

/// What studies and experts set, in every verb or in one: accepted, and keys of rig.toml, but shown by `--help-all` only.
const EXPERT: &[&str] = &[
    "acquisition",
    "actual-pitch-deg",
    "announce",
    "aside-port",
    "aside-to",
    "attitude-sd",
    "axis-zero",
    "batch",
    "box",
    "cell",
    "certify",
    "columns",
    "corrupt",
    "count-instructions",
    "covered-out",
    "csv",
    "die-after",
    "disarm-minutes",
    "divergence",
    "draws",
    "drop-out",
    "duplicate",
    "early-stop",
    "encoder-on-motor",
    "engine",
    "export-published",
    "fidelity",
    "final-look",
    "foxglove-origin",
    "free-spin",
    "gate",
    "home-switch",
    "host-name",
    "http-fault",
    "imu-profile",
    "index",
    "interface",
    "least-distance",
    "log-format",
    "log-level",
    "map-hits",
    "map-path",
    "map-voxel",
    "masters-min",
    "max-incidence",
    "max-rays",
    "min-conditioning",
    "name",
    "no-housings",
    "node",
    "noise-m",
    "nulls",
    "odometry-max-range",
    "odometry-min-range",
    "odometry-voxel",
    "old-firmware",
    "on-time",
    "path",
    "phase",
    "pose-memory",
    "pose-sd",
    "position-hz",
    "profile",
    "pulse",
    "range-noise",
    "rate",
    "receive-buffer",
    "reflectivity",
    "registration-weight",
    "regret",
    "reorder",
    "rescore",
    "returns",
    "roll",
    "roll-limits",
    "rotate-mib",
    "rotate-minutes",
    "rotation-hz",
    "scan-stride",
    "serial",
    "shards",
    "silent-after",
    "slcan",
    "source",
    "speed",
    "spin-phase",
    "spin-rate",
    "stop-below-mib",
    "sub-poses",
    "sub-rays",
    "timeout-s",
    "trajectory-starts-with-recording",
    "velodyne-port",
    "warn-below-mib",
    "weights",
    "within",
    "can",
    "drop",
    "dynamixel",
    "http",
    "listen-for",
    "no-baselines",
    "replay --map",
    "sample-count",
    "tolerance-deg",
];

/// Verbs in which such a flag is everybody's.
const EVERYBODYS: [(&str, &str); 1] = [("replay", "rate")];

/// The last two lines of each verb's help.
pub const EXAMPLES: [(&str, [&str; 2]); 30] = [
    ("demo", ["demo", "demo --out tried --fault kill-sensor"]),
    ("doctor", ["doctor", "doctor --config rig.toml"]),
    ("init", ["init", "init survey --from capture.pcap"]),
    (
        "optimize",
        [
            "optimize --sensors os1-64,os1-64 --scene house.ply --trajectory walk.tum -o mount.json",
            "optimize --preset paper-os1-64 -o mount.json --report design.html",
        ],
    ),
    (
        "predict",
        [
            "predict --mount mount.json --scene house.ply --trajectory walk.tum --report seen.html",
            "predict --preset paper-vlp-16 --masters 0.1,0,0,20,0",
        ],
    ),
    ("mount", ["mount mount.json --drawing mount.dxf", "mount mount.json --urdf rig.urdf --tf rig.yaml"]),
    (
        "compare",
        [
            "compare walk --scene house.ply -o report",
            "compare walk --scene house.ply --trajectory walk.tum --align",
        ],
    ),
    ("boresight", ["boresight walk", "boresight walk --trajectory walk.tum --json"]),
    ("odometry", ["odometry walk -o path.tum", "odometry walk --scene house.ply -o path.tum"]),
    (
        "decode",
        ["decode capture.pcap --meta sensor.json -o points.laz", "decode walk --format ply -o points"],
    ),
    ("cut", ["cut capture.pcap -o part.pcap --from 1 --to 2", "cut walk -o left.mcap --sensor left"]),
    ("inspect", ["inspect capture.pcap", "inspect walk --json"]),
    (
        "record",
        [
            "record --listen left=7502:left.json --listen right=2368 -o walk",
            "record --config rig.toml --duration 60",
        ],
    ),
    ("daemon", ["daemon --config rig.toml", "daemon --config rig.toml --record"]),
    ("view", ["view capture.pcap --meta sensor.json", "view walk --trajectory walk.tum --no-open"]),
    ("replay", ["replay capture.pcap --to 127.0.0.1", "replay walk --to 192.168.1.20 --rate 2"]),
    ("rig status", ["rig status --port /dev/ttyACM0", "rig status --port can:can0 --json"]),
    ("rig home", ["rig home --port /dev/ttyACM0 --dry-run", "rig home --port /dev/ttyACM0 --arm"]),
    ("rig set", ["rig set 25 -25 --port /dev/ttyACM0 --dry-run", "rig set 25 -25 --port /dev/ttyACM0 --arm"]),
    (
        "rig apply",
        [
            "rig apply mount.json --port /dev/ttyACM0 --dry-run",
            "rig apply mount.json --port /dev/ttyACM0 --arm --home",
        ],
    ),
    ("rig watch", ["rig watch --port /dev/ttyACM0", "rig watch --port /dev/ttyACM0 --for 10 --json"]),
    ("rig stop", ["rig stop --port /dev/ttyACM0", "rig stop --port /dev/ttyACM0 --emergency"]),
    ("rig clear", ["rig clear --port /dev/ttyACM0", "rig clear --port can:can0"]),
    ("rig calibrate", ["rig calibrate walk", "rig calibrate walk --mount mount.json"]),
    ("sensor discover", ["sensor discover", "sensor discover --for 10 --json"]),
    ("sensor info", ["sensor info 192.168.1.101", "sensor info 192.168.1.101 --save-metadata left.json"]),
    (
        "sensor configure",
        [
            "sensor configure 192.168.1.101 --dest auto --lidar-port 7502",
            "sensor configure 192.168.1.101 --set lidar_mode=1024x10 --save",
        ],
    ),
    ("study", ["study pareto --quick --seeds 1", "study plan published -o published"]),
    (
        "mock sensor",
        [
            "mock sensor --model os1-64 --to 127.0.0.1:7502 --metadata left.json --duration 10",
            "mock sensor --model vlp-16 --to 127.0.0.1:2368 --scene house.ply --trajectory walk.tum",
        ],
    ),
    ("mock rig", ["mock rig", "mock rig --fault overheat@5"]),
];

/// What other programs, and older versions of this one, call a verb.
const OTHER_VERBS: [(&str, &str); 12] = [
    ("info", "inspect"),
    ("viz", "view"),
    ("slice", "cut"),
    ("convert", "decode"),
    ("export", "decode"),
    ("play", "replay"),
    ("simulate", "predict"),
    ("evaluate", "predict --preset"),
    ("validate", "predict --scene MESH --ideal"),
    ("stand", "rig calibrate"),
    ("discover", "sensor discover"),
    ("calibrate", "boresight (sensors) or rig calibrate (servos)"),
];

/// And a flag.
const OTHER_FLAGS: [(&str, &str); 4] =
    [("--mesh", "--scene"), ("--wearer", "--operator"), ("--output", "--out"), ("--extrinsics", "--mount")];

/// The command line with its headings and examples.
pub fn command() -> Command {
    arranged(Cli::command(), "")
}

fn arranged(verb: Command, above: &str) -> Command {
    let name = format!("{above}{}", verb.get_name());
    let name = if above.is_empty() && name == "outrigger" { String::new() } else { name };
    let verb = verb.mut_args(|arg| {
        let long = arg.get_long().unwrap_or_default().to_owned();
        let arg = match &*long {
            "out" => arg.short('o'),
            "force" => arg.short('f'),
            _ => arg,
        };
        let is_expert = (EXPERT.contains(&&*long) || EXPERT.contains(&&*format!("{name} --{long}")))
            && !EVERYBODYS.contains(&(&name, &long));
        let heading = HEADINGS.iter().find(|(_, flags)| flags.contains(&&*long)).map(|(heading, _)| *heading);
        match (is_expert, heading) {
            (true, _) => arg.help_heading("Expert").hide_short_help(true),
            (false, Some(heading)) => arg.help_heading(heading),
            (false, None) => arg,
        }
    });
    let verb = match EXAMPLES.iter().find(|(known, _)| *known == name) {
        Some((_, examples)) => {
            let before = verb.get_after_help().map_or(String::new(), |text| format!("{text}\n\n"));
            let [first, second] = examples;
            verb.after_help(format!("{before}Examples:\n  outrigger {first}\n  outrigger {second}"))
        }
        None => verb,
    };
    let above = if name.is_empty() { String::new() } else { format!("{name} ") };
    verb.mut_subcommands(|within| arranged(within, &above))
}

/// What is ours where a verb or a flag of another program was typed.
pub fn ours(typed: &str) -> Option<&'static str> {
    let name = typed.split('=').next().unwrap_or_default();
    OTHER_VERBS.iter().chain(&OTHER_FLAGS).find(|(theirs, _)| *theirs == name).map(|(_, ours)| *ours)
}
