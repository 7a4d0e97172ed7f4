//! The examples of each verb.

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
