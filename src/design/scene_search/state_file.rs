//! `--resume` of a search in a scene: what it asked and what it found so far, in a file.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::plan::Plan;
use super::rig_space::RigSpace;
use super::weights::WeightRule;
use crate::base::files;
use crate::base::questions::first_difference;
use crate::design::robustness::Criterion;
use crate::simulate::view::{CastView, Quality, Seen, ViewSite};

const FORMAT: &str = "outrigger-scene-search/9";

/// What a search has found so far, in its order: with these it goes on, or again, as it did.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Findings {
    /// J by the model, as looked at first.
    pub scores: Vec<f64>,
    /// Of those looked at again, by all voxels.
    pub again: Vec<f64>,
    /// Of the rigs that were cast.
    pub exact: Vec<Seen>,
    /// Points with every beam, where the others were thinned.
    #[serde(default)]
    pub whole: Vec<(Vec<f64>, Seen)>,
}

/// Why a state file cannot be used.
#[derive(Debug, thiserror::Error)]
pub(crate) enum SceneStateError {
    #[error("state file {} cannot be read", path.display())]
    Unreadable { path: PathBuf, source: std::io::Error },
    #[error("state file {} cannot be written", path.display())]
    Unwritable { path: PathBuf, source: std::io::Error },
    #[error("state file {} holds no search in a scene", path.display())]
    NoSearch { path: PathBuf, source: serde_json::Error },
    #[error("state file {}: format is {found:?}, this program reads {FORMAT:?}", path.display())]
    Format { path: PathBuf, found: String },
    #[error("state file {}: its search has {difference}: give the same options, or another file", path.display())]
    OtherSearch { path: PathBuf, difference: String },
}

impl SceneStateError {
    /// Whether the command line asks for another search.
    pub(crate) fn is_usage(&self) -> bool {
        matches!(self, Self::Format { .. } | Self::OtherSearch { .. })
    }
}

/// All that decides what a search finds.
pub(crate) struct Question(Value);

/// What is asked for of a search, besides its rigs.
pub(crate) struct Asked<'a> {
    pub sensors: &'a [String],
    pub weights: WeightRule,
    pub is_ideal: bool,
    pub columns: Option<u32>,
    pub scan_stride: u32,
    pub quality: Quality,
    /// Which J of several sites counts.
    pub criterion: Criterion,
    /// Weight of registration strength, and the least conditioning that is allowed.
    pub registration: (f64, f64),
}

impl Question {
    pub(crate) fn of(asked: &Asked<'_>, plan: &Plan, rigs: &RigSpace, sites: &[CastView]) -> Self {
        let places: Vec<Value> = sites.iter().map(|cast| place(cast.site())).collect();
        let site = sites[0].site();
        let mut question = json!({
            "scene": places[0]["scene"],
            "trajectory": places[0]["trajectory"],
            "voxel_m": site.grid.voxel_m,
            "sensors": asked.sensors,
            "masters": rigs.masters.iter().map(|master| (master.unit, master.is_mirrored)).collect::<Vec<_>>(),
            "bounds": format!("{:?}", rigs.bounds),
            "roll_deg": rigs.fixed_roll_deg,
            "tilt_step_deg": rigs.tilt_step_deg,
            "clearance": format!("{:?}", rigs.keep_apart),
            "weights": asked.weights,
            "ideal": asked.is_ideal,
            "operator": format!("{:?}", site.shades),
            "azimuths": asked.columns,
            "scan_stride": asked.scan_stride,
            "plan": plan,
        });
        if asked.registration != (0.0, 0.0) {
            question["registration"] = json!(asked.registration);
        }
        if let Some(quality) = asked.quality.asked() {
            question["quality"] = json!(quality);
        }
        if sites.len() > 1 {
            question["sites"] = json!(places);
            question["robust"] = json!(asked.criterion);
        }
        // once through text, so that it compares equal to what was read
        Self(serde_json::from_str(&question.to_string()).unwrap_or_default())
    }
}

fn place(site: &ViewSite) -> Value {
    let bounds_m: Vec<f64> =
        site.scene.bounds_m().into_iter().flat_map(|bound_m| bound_m.to_array()).collect();
    json!({
        "scene": { "bounds_m": bounds_m, "triangles": site.scene.mesh().map(|mesh| mesh.triangles()) },
        "trajectory": {
            "length_m": site.trajectory.length_m(),
            "time_span_ns": site.trajectory.time_span_ns(),
        },
    })
}

#[derive(Serialize)]
struct Written<'a> {
    format: &'a str,
    question: &'a Value,
    findings: &'a Findings,
}

#[derive(Deserialize)]
struct Read {
    format: String,
    question: Value,
    findings: Findings,
}

/// The file of a search.
pub(crate) struct SearchState {
    path: PathBuf,
    question: Value,
    /// Mounts found when it was written last.
    written: std::cell::Cell<usize>,
}

/// Mounts after which it is written again.
const STEP: usize = 64;

impl SearchState {
    /// The file and what it says; nothing where there is none yet.
    pub(crate) fn open(
        path: &Path,
        Question(question): Question,
    ) -> Result<(Self, Findings), SceneStateError> {
        let state = Self { path: path.to_owned(), question, written: 0.into() };
        let text = match files::read_text(path) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                return Ok((state, Findings::default()));
            }
            text => text.map_err(|source| SceneStateError::Unreadable { path: path.into(), source })?,
        };
        let read: Read = serde_json::from_str(&text)
            .map_err(|source| SceneStateError::NoSearch { path: path.into(), source })?;
        if read.format != FORMAT {
            return Err(SceneStateError::Format { path: path.into(), found: read.format });
        }
        if let Some(other) =
            first_difference(&read.question, &state.question, &["/scene", "/trajectory", "/sites"])
        {
            let place = other.place.trim_start_matches('/').replace('/', " ");
            let difference = format!("{place} {}, asked for is {}", other.then, other.now);
            return Err(SceneStateError::OtherSearch { path: path.into(), difference });
        }
        Ok((state, read.findings))
    }

    /// Writes what was found, whole or not at all, where that is much more than is there.
    pub(crate) fn keep(&self, findings: &Findings) -> Result<(), SceneStateError> {
        let found = findings.scores.len() + STEP * findings.exact.len();
        if found < self.written.get() + STEP {
            return Ok(());
        }
        self.written.set(found);
        let written = Written { format: FORMAT, question: &self.question, findings };
        files::write_json(&self.path, &written)
            .map_err(|source| SceneStateError::Unwritable { path: self.path.clone(), source })
    }
}
