//! Every flag that takes a number, as the command line's own definition lists them, with numbers that nobody means: each
//! is refused or quickly done, within the limits that files are read under.

use clap::{Arg, Command, CommandFactory as _};
use outrigger::commands::Cli;

use super::seeds::Kit;
use super::{run, verdict};

const VALUES: &[&str] =
    &["0", "-1", "NaN", "inf", "1e-9", "1e9", "1e308", "18446744073709551615", "4294967296", "65535"];

/// What a flag's value is called where it is no number.
const NO_NUMBER: &[&str] = &[
    "FILE",
    "PATH",
    "DIR",
    "NAME",
    "ADDRESS",
    "HOST",
    "STATE",
    "MODEL",
    "URL",
    "PRESET",
    "JSON",
    "FORMAT",
    "MODE",
    "RULE",
    "VERB",
    "I/N",
    "TOML",
    "json",
    "SENSOR",
    "LEVEL",
    "KEY",
    "FAULT",
    "INTERFACE",
    "A..B",
    "LIST",
    "PORT",
];

/// Small inputs of each verb, as lists of words.
fn bases(kit: &Kit) -> Vec<(&'static str, Vec<String>)> {
    let [walk, mount, mesh, session, capture, meta, out] =
        ["walk.tum", "mount.json", "room.obj", "session", "good.pcap", "meta.json", "out/made"]
            .map(|name| kit.path(name).display().to_string());
    let cloud = kit.path("cloud.pcd").display().to_string();
    std::fs::write(&cloud, super::scene_seeds::pcds().remove(0)).unwrap();
    let room = "--room=-4,-3,0,4,3,3";
    let search_in_a_room = "optimize --room=-3,-3,0,3,3,3 --trajectory=-1,0,1.6;1,0,1.6 --sensors vlp-16,vlp-16 --evals 6 \
                            --azimuths 60 --voxel 0.5 --scan-stride 5";
    let search = "optimize --preset paper-vlp-16 --evals 6 --method random --fidelity given";
    let scan = format!("--mount {mount} --trajectory {walk} --azimuths 8");
    let predict = format!("predict {scan} --voxel 0.5 --fidelity given");
    let lines = [
        ("predict", format!("{predict} {room}")),
        ("predict", format!("{predict} --scene {mesh} --sample-count 100")),
        ("predict", format!("{predict} --scene {cloud}")),
        ("predict", format!("predict --ideal --scene {mesh} {scan} --sample-count 100")),
        ("compare", format!("compare {session} {room} --nulls 0 --voxel 0.5")),
        ("compare", format!("compare {session} --scene {cloud} --nulls 0 --voxel 0.5")),
        (
            "compare",
            format!("compare {session} --map-frames 0..1 --trajectory odometry --nulls 0 --voxel 0.5"),
        ),
        ("boresight", format!("boresight {session}")),
        ("rig calibrate", format!("rig calibrate {session}")),
        ("odometry", format!("odometry {capture} --meta {meta} --mount {mount} --out {out}")),
        ("predict", "predict --preset paper-vlp-16 --masters 0.1,0,0.1,20,0".into()),
        ("optimize", search.into()),
        ("optimize", format!("{search} --robust expected --draws 2")),
        ("optimize", search.replace("random", "bayesian")),
        ("optimize", search_in_a_room.into()),
        ("demo", format!("demo --out {out} --evals 2 --rate 100 --speed 20")),
        ("study", format!("study plan pareto --quick --seeds 1 --out {out}")),
        ("study", format!("study submit pareto --quick --seeds 1 --shards 2 --out {out}")),
        ("record", format!("record --listen a=127.0.0.1:0 --out {out} --for 0.2")),
        ("replay", format!("replay {session} --to 127.0.0.1 --rate max")),
        ("daemon", format!("daemon --listen 127.0.0.1:0 --sessions {out} --room=0,0,0,1,1,1")),
        ("doctor", format!("doctor --out {} --listen-for 0.1", kit.path("").display())),
        (
            "mock sensor",
            "mock sensor --model vlp-16 --to 127.0.0.1:9 --box=-4,-3,-1,4,3,2 --duration 0.2".into(),
        ),
        ("mount", format!("mount {mount} --urdf {out}")),
        ("mock rig", "mock rig".into()),
        ("rig status", format!("rig status --port {out}")),
        ("sensor discover", "sensor discover --interface 127.0.0.1 --for 0.1".into()),
        ("sensor configure", "sensor configure 127.0.0.1:9 --within 0.1".into()),
    ];
    lines.map(|(verb, line)| (verb, line.split_whitespace().map(str::to_owned).collect())).into()
}

/// The verb of a path of names.
fn verb(names: &str) -> Command {
    let mut command = Cli::command();
    command.build();
    names.split(' ').fold(command, |command, name| command.find_subcommand(name).unwrap().clone())
}

fn takes_a_number(argument: &Arg) -> bool {
    let names = argument.get_value_names().unwrap_or_default();
    let is_named_so = names.iter().any(|name| NO_NUMBER.iter().any(|part| name.contains(part)));
    argument.get_long().is_some()
        && argument.get_action().takes_values()
        && argument.get_possible_values().is_empty()
        && !is_named_so
}

pub fn feed() {
    let kit = Kit::new();
    // every line takes minutes
    let all = super::wanted() >= 100;
    let (mut faults, mut tried, mut refused, mut flags) = (Vec::new(), 0_usize, 0_usize, 0_usize);
    for (names, base) in bases(&kit) {
        for argument in verb(names).get_arguments().filter(|argument| takes_a_number(argument)) {
            flags += 1;
            let flag = format!("--{}", argument.get_long().unwrap());
            for (number, value) in VALUES.iter().enumerate() {
                // a seed may be any number, and a whole demo is no small input; so many regions or mounts are minutes
                // of work that was asked for
                let is_long = (names == "demo" && flag == "--seed")
                    || (["--certify", "--evals"].contains(&flag.as_str()) && *value == "65535");
                if is_long || !(all || (number + flags).is_multiple_of(VALUES.len())) {
                    continue;
                }
                kit.empty_out();
                let output = run(&with(&base, &flag, value), 8);
                tried += 1;
                refused += usize::from(output.status.code() == Some(2));
                if let Err(fault) = verdict(&kit, &output) {
                    faults.push(format!("{names} {flag}={value}: {fault}"));
                }
            }
        }
    }
    for corners in
        ["0,0,0,1e9,1e9,1e9", "0,0,0,1e308,1e308,1e308", "0,0,0,9999,9999,9999", "0,0,0,1e-9,1e-9,1e-9"]
    {
        let (_, base) = bases(&kit).remove(0);
        let base: Vec<String> = base.into_iter().filter(|word| !word.starts_with("--room")).collect();
        kit.empty_out();
        let output = run(&with(&base, "--room", corners), 8);
        tried += 1;
        if let Err(fault) = verdict(&kit, &output) {
            faults.push(format!("predict --room={corners}: {fault}"));
        }
    }
    println!("flags: {tried} lines, {refused} refused as typed, {} failed", faults.len());
    assert!(flags > 60, "{flags} flags take a number");
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

/// A command line with another value of a flag.
fn with(base: &[String], flag: &str, value: &str) -> Vec<String> {
    let mut line = Vec::new();
    let mut words = base.iter();
    while let Some(word) = words.next() {
        if word == flag {
            words.next();
        } else if !word.starts_with(&format!("{flag}=")) {
            line.push(word.clone());
        }
    }
    line.push(format!("{flag}={value}"));
    line
}
