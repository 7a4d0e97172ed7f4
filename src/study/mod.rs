//! Studies: many runs with rows that together answer a question.
//!
//! A study is a list of tasks and, for each, a function from the task to plain rows; findings are made from all rows. Tasks
//! know nothing of each other, so they may run in any order, on any number of machines ([`shard`]): the merged rows are the
//! same to the byte. Measured times are the exception; fields that hold one begin with `wall_` and are stored apart.

mod joint;
mod mesh_site;
mod methods;
mod page;
mod pareto;
mod published;
mod rows;
mod saved_rows;
mod scenes;
mod searches;
mod sensor_count;
pub mod shard;
mod speed_accuracy;
mod spread;
mod stability;
pub mod submit;
mod walks;

pub use page::csv;
pub(crate) use page::findings_report;
pub use rows::{Row, number, text};
pub use spread::Spread;

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::Value;

/// What a study is asked for.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Size {
    /// Seeds of each search.
    pub seeds: u64,
    /// A tenth of the evaluations and fewer settings: whether it runs, not what it finds.
    pub quick: bool,
    /// Mesh for studies in a scene, or a folder of meshes.
    pub scene: Option<PathBuf>,
    /// Walk through the scene (TUM); a straight line through it otherwise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trajectory: Option<PathBuf>,
    /// Whether instructions are counted, too.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub count_instructions: bool,
}

/// A question answered by many runs.
pub trait Study: Sync {
    /// Name on the command line.
    fn name(&self) -> &'static str;

    /// What it asks, in one sentence.
    fn about(&self) -> &'static str;

    /// The tasks, each a JSON object that says all about it.
    ///
    /// # Errors
    /// What is missing for this study.
    fn tasks(&self, size: &Size) -> Result<Vec<Value>, StudyError>;

    /// Rows of one task.
    ///
    /// # Errors
    /// What failed.
    fn run(&self, task: &Value) -> Result<Vec<Row>, StudyError>;

    /// What the rows of all tasks say.
    fn findings(&self, rows: &[Row]) -> Findings;

    /// Whether it looks at a scene that is given.
    fn takes_a_scene(&self) -> bool {
        false
    }

    /// Whether what it says rests on how its seeds spread.
    fn rests_on_seeds(&self) -> bool {
        true
    }
}

/// Every study.
pub const STUDIES: &[&dyn Study] = &[
    &published::Published,
    &methods::Methods,
    &sensor_count::SensorCount,
    &pareto::Pareto,
    &joint::Joint,
    &speed_accuracy::SpeedAccuracy,
    &stability::Stability,
    &scenes::Scenes,
];

/// The study of a name.
///
/// # Errors
/// There is none; the message lists those there are.
pub(crate) fn named(name: &str) -> Result<&'static dyn Study, StudyError> {
    STUDIES.iter().copied().find(|study| study.name() == name).ok_or_else(|| {
        let known: Vec<_> = STUDIES.iter().map(|study| study.name()).collect();
        StudyError(format!("no study is named {name:?}: there are {}", known.join(", ")))
    })
}

/// Why a study cannot go on.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct StudyError(pub String);

impl StudyError {
    fn of(error: impl std::fmt::Display) -> Self {
        Self(error.to_string())
    }

    fn at(path: &Path, error: impl std::fmt::Display) -> Self {
        Self(format!("{}: {error}", path.display()))
    }
}

/// What a study found.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Findings {
    /// The sentence a reader takes away.
    pub summary: String,
    /// Claims that were examined.
    pub claims: Vec<Claim>,
    /// Tables.
    pub tables: Vec<Table>,
    /// What failed, each once, with its reason: nothing here speaks of it.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub failed: Vec<String>,
    /// Pictures.
    #[serde(skip)]
    pub figures: Vec<Figure>,
}

/// Fewer seeds have no spread to speak of.
const FEW_SEEDS: u64 = 5;

impl Findings {
    /// As far as they hold when made at this size: a quick study or one of few seeds decides no claim.
    pub(crate) fn at_size(mut self, study: &dyn Study, size: &Size) -> Self {
        let too_small = if size.quick {
            "--quick: this shows what the study writes, not what it finds.".to_owned()
        } else if study.rests_on_seeds() && size.seeds < FEW_SEEDS {
            format!("{} seeds are too few to tell anything for sure.", size.seeds)
        } else {
            return self;
        };
        self.summary = format!("{too_small} {}", self.summary);
        self.claims.iter_mut().for_each(|claim| claim.verdict = Verdict::CannotTell);
        self
    }
}

/// A picture with its caption.
#[derive(Clone, Debug)]
pub struct Figure {
    /// The picture.
    pub svg: String,
    /// What it shows.
    pub caption: String,
}

/// A published claim and what came of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Claim {
    /// What is claimed, and where.
    pub claim: String,
    /// Whether it stands.
    pub verdict: Verdict,
    /// The numbers that decide.
    pub because: String,
}

/// What came of a claim.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Our numbers agree.
    Stands,
    /// They do not.
    DoesNotStand,
    /// They cannot tell.
    CannotTell,
}

impl Verdict {
    pub(crate) fn words(self) -> &'static str {
        match self {
            Self::Stands => "stands",
            Self::DoesNotStand => "does not stand",
            Self::CannotTell => "cannot tell",
        }
    }
}

/// A table of findings.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Table {
    /// Name of its CSV file.
    pub name: String,
    /// What it shows.
    pub title: String,
    /// How to read it.
    pub note: String,
    /// Header.
    pub columns: Vec<String>,
    /// Cells as they are shown.
    pub rows: Vec<Vec<String>>,
}

impl Table {
    fn new(name: &str, title: &str, note: &str, columns: &[&str]) -> Self {
        let columns = columns.iter().map(|column| (*column).to_owned()).collect();
        Self { name: name.into(), title: title.into(), note: note.into(), columns, rows: Vec::new() }
    }
}
