//! What `compare` writes and prints.

use std::path::Path;

use anyhow::Context as _;

use super::Args;
use super::document::{Document, Unplaced};
use crate::base::files::write_json;
use crate::commands::{Context, Outcome, output};
use crate::report::Report;
use crate::rig::MountFile;
use crate::verify::align::Alignment;
use crate::verify::judgement::comparison::{Reason, Verdict};

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
    let sentence = format!("{}: {}", Verdict::CannotTell.label(), document.words[0]);
    let report = Report::new("Predicted against recorded", &sentence);
    output::print_result(context.json, &document, &report, &document.problems)?;
    Ok(Outcome::DataLost)
}

/// The files; false where one that was asked for has nothing to say.
pub(super) fn write(
    args: &Args,
    (document, report): (&Document, &Report),
    mut file: MountFile,
) -> anyhow::Result<bool> {
    if let Some(out) = &args.out {
        let cannot = |path: &Path| format!("cannot write {}", path.display());
        std::fs::create_dir_all(out).with_context(|| format!("cannot use the folder {}", out.display()))?;
        let json = out.join("report.json");
        write_json(&json, document).with_context(|| cannot(&json))?;
        let html = out.join("report.html");
        output::write_page(Some(&html), report)?;
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
    (document, mut report): (&Document, Report),
    whole: bool,
) -> anyhow::Result<Outcome> {
    if let Some(out) = &args.out {
        report.heading("");
        report.note(out.join("report.html").display().to_string());
    }
    output::print_result(context.json, document, &report, &document.problems)?;
    let matches = document.comparison.verdict == Verdict::Matches;
    Ok(if matches && whole { Outcome::Done } else { Outcome::DataLost })
}
