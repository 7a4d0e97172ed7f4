//! The state file of a search: what was asked, and how far it is.

use std::path::Path;

use anyhow::{Context as _, bail};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::outputs;
use crate::files;
use crate::optimize::{KeepApart, MountProblem, Search};
use crate::simulate::published::Roll;

const FORMAT: &str = "outrigger-search/4";

#[derive(Serialize)]
struct Written<'a> {
    format: &'a str,
    question: &'a Value,
    search: &'a Search,
}

#[derive(Deserialize)]
struct Read {
    format: String,
    question: Value,
    search: Search,
}

/// All that decides the score of a point: a search goes on only where this is the same.
pub fn question(problem: &MountProblem, keep_apart: KeepApart) -> anyhow::Result<Value> {
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
    if let (Some(question), Value::Object(found_with)) =
        (question.as_object_mut(), serde_json::to_value(outputs::found_with(objective))?)
    {
        question.extend(found_with);
    }
    let text = question.to_string();
    // once through text, so that it compares equal to what was read
    Ok(serde_json::from_str(&text)?)
}

/// The search of a state file; none if there is no such file yet.
pub fn read(path: &Path, question: &Value) -> anyhow::Result<Option<Search>> {
    let text = match crate::files::read_text(path) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        text => text.with_context(|| format!("state file {} cannot be read", path.display()))?,
    };
    let wrong = || format!("state file {} holds no search of this program", path.display());
    let read: Read = serde_json::from_str(&text).with_context(wrong)?;
    if read.format != FORMAT {
        bail!("state file {}: format is {:?}, this program reads {FORMAT:?}", path.display(), read.format);
    }
    if let Some(wanted) = question.as_object() {
        // the preset first: where it differs, so do others that follow from it
        let preset = wanted.get_key_value("preset");
        for (name, now) in preset.into_iter().chain(wanted) {
            let then = &read.question[name];
            if then != now {
                bail!(
                    "state file {}: its search has {name} {then}, asked for is {now}: give the same options, or another file",
                    path.display()
                );
            }
        }
    }
    read.search.check().map_err(|reason| anyhow::anyhow!("state file {}: {reason}", path.display()))?;
    Ok(Some(read.search))
}

/// Writes a state file, whole or not at all.
pub fn write(path: &Path, question: &Value, search: &Search) -> anyhow::Result<()> {
    files::write_json(path, &Written { format: FORMAT, question, search })
        .with_context(|| format!("state file {} cannot be written", path.display()))
}
