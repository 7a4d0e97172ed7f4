//! `--resume` of a search in a scene: what it asked and what it found so far, in a file.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::args::Args;
use crate::base::files;
use crate::base::questions::first_difference;
use crate::commands::wrong_usage;
use crate::design::scene_search::{Findings, Plan, RigSpace};
use crate::simulate::view::CastView;

const FORMAT: &str = "outrigger-scene-search/2";

/// All that decides what a search finds.
pub(super) struct Question(Value);

impl Question {
    pub(crate) fn of(args: &Args, plan: &Plan, rigs: &RigSpace, cast: &CastView) -> Self {
        let site = cast.site();
        let of_scene: Vec<f64> =
            site.scene.bounds_m().into_iter().flat_map(|bound_m| bound_m.to_array()).collect();
        let trajectory = json!({
            "length_m": site.trajectory.length_m(),
            "time_span_ns": site.trajectory.time_span_ns(),
        });
        let question = json!({
            "scene": { "bounds_m": of_scene, "triangles": site.scene.mesh().map(|mesh| mesh.triangles()) },
            "trajectory": trajectory,
            "voxel_m": site.grid.voxel_m,
            "sensors": args.scene.sensors,
            "masters": rigs.masters.iter().map(|master| (master.unit, master.is_mirrored)).collect::<Vec<_>>(),
            "bounds": format!("{:?}", rigs.bounds),
            "roll_deg": rigs.fixed_roll_deg,
            "tilt_step_deg": rigs.tilt_step_deg,
            "clearance": format!("{:?}", rigs.keep_apart),
            "weights": args.scene.weights,
            "ideal": args.scene.ideal,
            "operator": format!("{:?}", site.shades),
            "azimuths": args.experiment.of_scene().columns,
            "scan_stride": args.scene.scan_stride,
            "plan": plan,
        });
        // once through text, so that it compares equal to what was read
        Self(serde_json::from_str(&question.to_string()).unwrap_or_default())
    }
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
pub(super) struct State {
    path: PathBuf,
    question: Value,
    /// Mounts found when it was written last.
    written: std::cell::Cell<usize>,
}

/// Mounts after which it is written again.
const STEP: usize = 64;

impl State {
    /// The file and what it says; nothing where there is none yet.
    pub(crate) fn open(path: &Path, Question(question): Question) -> anyhow::Result<(Self, Findings)> {
        let state = Self { path: path.to_owned(), question, written: 0.into() };
        let text = match files::read_text(path) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                return Ok((state, Findings::default()));
            }
            text => text.with_context(|| format!("state file {} cannot be read", path.display()))?,
        };
        let read: Read = serde_json::from_str(&text)
            .with_context(|| format!("state file {} holds no search in a scene", path.display()))?;
        if read.format != FORMAT {
            return Err(wrong_usage(format!(
                "state file {}: format is {:?}, this program reads {FORMAT:?}",
                path.display(),
                read.format
            )));
        }
        if let Some(other) = first_difference(&read.question, &state.question, &["/scene", "/trajectory"]) {
            return Err(wrong_usage(format!(
                "state file {}: its search has {} {}, asked for is {}: give the same options, or another file",
                path.display(),
                other.place.trim_start_matches('/').replace('/', " "),
                other.then,
                other.now
            )));
        }
        Ok((state, read.findings))
    }

    /// Writes what was found, whole or not at all, where that is much more than is there.
    pub(crate) fn keep(&self, findings: &Findings) -> anyhow::Result<()> {
        let found = findings.scores.len() + STEP * findings.exact.len();
        if found < self.written.get() + STEP {
            return Ok(());
        }
        self.written.set(found);
        let written = Written { format: FORMAT, question: &self.question, findings };
        files::write_json(&self.path, &written)
            .with_context(|| format!("state file {} cannot be written", self.path.display()))
    }
}
