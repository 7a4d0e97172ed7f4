//! The published objective as a filter, so that other programs' optimizers can be run on it: one line of JSON in,
//! `[[x_m, y_m, z_m, pitch_deg, roll_deg], ...]` (masters), one line with J out.
//!
//! `cargo run --release --example objective -- PRESET lateral|forward [free]`

use std::io::{BufRead as _, Write as _};

use outrigger::design::objective::{Objective, Weights};
use outrigger::rig::{MountDeg, Path, Roll};
use outrigger::simulate::published::{Experiment, Preset, PublishedBox};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [preset, path, rest @ ..] = arguments.as_slice() else {
        return Err(
            "give a preset, then lateral or forward, then (for a roll that is not fixed at 0) free".into()
        );
    };
    let path = match path.as_str() {
        "lateral" => Path::Lateral,
        "forward" => Path::Forward,
        other => return Err(format!("{other}: give lateral or forward").into()),
    };
    let roll = match rest {
        [] => Roll::Fixed(0.0),
        [free] if free == "free" => Roll::Free,
        _ => return Err("after the path there may be free, nothing else".into()),
    };
    let experiment = Experiment { path, roll, ..Experiment::published(Preset::named(preset)?) };
    let objective = Objective::new(PublishedBox::new(&experiment)?, Weights::default(), 0.0)?;
    let mut out = std::io::stdout().lock();
    for line in std::io::stdin().lock().lines() {
        let masters: Vec<[f64; 5]> = serde_json::from_str(&line?)?;
        let masters: Vec<MountDeg> = masters.into_iter().map(MountDeg::from).collect();
        writeln!(out, "{}", objective.evaluate(&masters)?.objective)?;
        out.flush()?;
    }
    Ok(())
}
