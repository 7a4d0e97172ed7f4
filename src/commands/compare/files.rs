//! What `compare` writes and prints.

use std::path::Path;

use anyhow::Context as _;

use super::Args;
use super::document::{Document, Unplaced};
use crate::base::files::write_json;
use crate::commands::{Context, Outcome, output};
use crate::report::comparison;
use crate::rig::MountFile;
use crate::verify::align::Alignment;
use crate::verify::compare::Replayed;
use crate::verify::judgement::comparison::{Reason, Verdict};
use crate::world::local_origin::LocalOrigin;
use crate::world::scene::Scene;
use crate::world::trajectory::Trajectory;

/// Where no place of the trajectory in the scene is sure, nothing is compared.
pub(super) fn unplaced(
    args: &Args,
    context: Context,
    alignment: &Alignment,
    problems: Vec<String>,
    wall_s: f64,
) -> anyhow::Result<Outcome> {
    let document = Unplaced {
        format: "outrigger-compare/1",
        verdict: Verdict::CannotTell,
        reason: Reason::of_placement(alignment),
        words: [alignment.words()],
        alignment,
        problems,
        wall_s,
    };
    if let Some(out) = &args.out {
        std::fs::create_dir_all(out).with_context(|| format!("cannot use the folder {}", out.display()))?;
        let json = out.join("report.json");
        write_json(&json, &document).with_context(|| format!("cannot write {}", json.display()))?;
    }
    let text = || format!("{} {}\n", Verdict::CannotTell.label(), document.words[0]);
    output::print_result(context.json, &document, text, &document.problems)?;
    Ok(Outcome::DataLost)
}

/// The files; false where one that was asked for has nothing to say.
pub(super) fn write(
    args: &Args,
    document: &Document,
    replayed: &Replayed,
    (scene, origin): (&Scene, LocalOrigin),
    trajectory: &Trajectory,
    mut file: MountFile,
) -> anyhow::Result<bool> {
    if let Some(out) = &args.out {
        let cannot = |path: &Path| format!("cannot write {}", path.display());
        std::fs::create_dir_all(out).with_context(|| format!("cannot use the folder {}", out.display()))?;
        let json = out.join("report.json");
        write_json(&json, document).with_context(|| cannot(&json))?;
        let html = out.join("report.html");
        let page = comparison::page(
            &document.comparison,
            (&document.problems, &document.zeros()),
            replayed,
            scene,
            trajectory,
            (args.gate, origin),
            &output::again(),
        );
        page.write(&html).with_context(|| cannot(&html))?;
    }
    if let Some(path) = &args.corrected_mount {
        let found_offset = document.comparison.mount.iter().any(|check| check.tilt_error_deg.is_some());
        if !found_offset {
            output::say_notice("no corrected mount is written: the pitch of no sensor is observable");
            return Ok(false);
        }
        for (entry, check) in file.sensors.iter_mut().zip(&document.comparison.mount) {
            entry.x_m = check.corrected.x_m;
            entry.y_m = check.corrected.y_m;
            entry.z_m = check.corrected.z_m;
            entry.pitch_deg = check.corrected.pitch_rad.to_degrees();
            entry.roll_deg = check.corrected.roll_rad.to_degrees();
        }
        file.masters = None;
        file.master_models = None;
        file.objective = None;
        file.write(path)?;
    }
    Ok(true)
}

pub(super) fn conclude(
    args: &Args,
    context: Context,
    document: &Document,
    whole: bool,
) -> anyhow::Result<Outcome> {
    if context.json {
        output::print_json(document)?;
    } else {
        output::print_text(&comparison::text(&document.comparison, &document.zeros()))?;
        if let Some(out) = &args.out {
            output::print_text(&format!("{}\n", out.join("report.html").display()))?;
        }
    }
    for problem in &document.problems {
        output::say_notice(problem);
    }
    let matches = document.comparison.verdict == Verdict::Matches;
    Ok(if matches && whole { Outcome::Done } else { Outcome::DataLost })
}
