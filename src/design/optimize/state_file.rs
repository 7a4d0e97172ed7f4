//! The state file of a search: what was asked, and how far it is.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::{KeepApart, MountProblem, Search};
use crate::base::files;
use crate::base::questions::first_difference;
use crate::rig::Roll;

const FORMAT: &str = "outrigger-search/4";

#[derive(Serialize)]
struct WrittenState<'a> {
    format: &'a str,
    question: &'a Value,
    search: &'a Search,
}

#[derive(Deserialize)]
struct ReadState {
    format: String,
    question: Value,
    search: Search,
}

/// Why a state file cannot be used.
#[derive(Debug, thiserror::Error)]
pub(crate) enum StateError {
    #[error("state file {} cannot be read", .path.display())]
    Unreadable { path: PathBuf, source: std::io::Error },
    #[error("state file {} cannot be written", .path.display())]
    Unwritable { path: PathBuf, source: std::io::Error },
    #[error("state file {} holds no search of this program", .path.display())]
    NoSearch { path: PathBuf, source: serde_json::Error },
    #[error("state file {}: format is {found:?}, this program reads {FORMAT:?}", .path.display())]
    Format { path: PathBuf, found: String },
    /// The command line asks for another search.
    #[error(
        "state file {}: its search has {difference}: give the same options, or another file",
        .path.display()
    )]
    OtherSearch { path: PathBuf, difference: String },
    #[error("state file {}: {reason}", .path.display())]
    Damaged { path: PathBuf, reason: String },
}

/// All that decides the score of a point: a search goes on only where this is the same.
///
/// # Errors
/// A number that JSON does not hold.
pub(crate) fn question(problem: &MountProblem, keep_apart: KeepApart) -> serde_json::Result<Value> {
    let objective = problem.objective();
    let experiment = objective.simulator().experiment();
    let mut question = json!({
        "preset": experiment.name(),
        "mirror": experiment.mirror,
        "roll": match experiment.roll { Roll::Fixed(roll_deg) => json!(roll_deg), Roll::Free => json!("free") },
        "clearance": keep_apart,
        "search": problem.search(),
        "robust": problem.robustness(),
    });
    if let (Some(question), Value::Object(settings)) =
        (question.as_object_mut(), serde_json::to_value(objective.settings())?)
    {
        question.extend(settings);
    }
    let text = question.to_string();
    // once through text, so that it compares equal to what was read
    serde_json::from_str(&text)
}

/// The search of a state file; none if there is no such file yet.
pub(crate) fn read(path: &Path, question: &Value) -> Result<Option<Search>, StateError> {
    let text = match files::read_text(path) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        text => text.map_err(|source| StateError::Unreadable { path: path.into(), source })?,
    };
    let read: ReadState =
        serde_json::from_str(&text).map_err(|source| StateError::NoSearch { path: path.into(), source })?;
    if read.format != FORMAT {
        return Err(StateError::Format { path: path.into(), found: read.format });
    }
    if let Some(difference) = difference(&read.question, question) {
        return Err(StateError::OtherSearch { path: path.into(), difference });
    }
    read.search.check().map_err(|reason| StateError::Damaged { path: path.into(), reason })?;
    Ok(Some(read.search))
}

/// Where two questions differ: by the flag that decides it, with what it was and what is asked for.
fn difference(then: &Value, now: &Value) -> Option<String> {
    // preset and voxel first: where they differ, so do others that follow from them
    let found = first_difference(then, now, &["/preset", "/voxel_m"])?;
    let (flag, hint) = flag(&found.place);
    Some(format!("{flag} {}, asked for is {}{hint}", found.then, found.now))
}

/// The flag that decides what stands in one place of a question, and what else may.
fn flag(place: &str) -> (String, &'static str) {
    const AUTO: &str =
        " (--fidelity auto, as with --voxel alone, searches with free phases and four poses per metre)";
    let flag = match place.trim_start_matches('/') {
        "voxel_m" => "--voxel",
        "phase" => return ("--phase".into(), AUTO),
        "sub_poses" => return ("--sub-poses".into(), AUTO),
        "mirror" | "search/is_mirrored" | "search/is_mirrored_exactly" => "mirror images (--no-mirror)",
        "search/fixed_roll_deg" => "--roll",
        "search/fore_aft_symmetry" => return ("fore and aft alike (--phase)".into(), AUTO),
        "search/types" => "--preset",
        "search/tilt_step_deg" => "--tilt-step",
        "search/bounds/pitch_deg" => "--pitch-limits",
        "search/bounds/roll_deg" => "--roll-limits",
        "least_conditioning" => "--min-conditioning",
        "least_distance_m" => "--least-distance",
        place if place.starts_with("search/bounds/") => "--space",
        place if place.starts_with("robust") => "what --robust rests on:",
        place => return (format!("--{}", place.trim_start_matches("search/").replace(['_', '/'], "-")), ""),
    };
    (flag.into(), "")
}

/// Writes a state file, whole or not at all.
pub(crate) fn write(path: &Path, question: &Value, search: &Search) -> Result<(), StateError> {
    files::write_json(path, &WrittenState { format: FORMAT, question, search })
        .map_err(|source| StateError::Unwritable { path: path.into(), source })
}
