//! The best mounts in any scene: a model of what rigs see looks at a thousand of them, a dozen exact evaluations correct it,
//! and the best **exact** one wins.
//!
//! What the model gets wrong is smooth in the mount: it borrows visibility from the middle between the sensors. A few terms,
//! fitted to exact minus model, take most of it out.

mod answer;
mod built;
mod climb;
mod correction;
mod draws;
mod exact;
mod fidelities;
mod judging;
mod local;
mod plan;
mod quadratic;
mod ridge;
mod rig_space;
mod search;
mod sites;
mod state_file;
mod weights;

pub(crate) use answer::{Answer, CoveredSite, FlatRange, Judged, JudgedAtSite};
pub(crate) use built::BuildErrors;
pub(crate) use correction::ModelError;
pub(crate) use exact::Exact;
pub(crate) use fidelities::Fidelity;
pub(crate) use plan::{Judges, Plan};
pub(crate) use rig_space::{RigSpace, is_of_few_channels};
pub(crate) use search::{SceneSearch, SearchEnd};
pub(crate) use sites::{Views, affordable_stride};
pub(crate) use state_file::{Asked, Findings, Question, SceneStateError, SearchState};
pub(crate) use weights::{SceneWeights, WeightRule, no_fewer_than_seen, share_of};
