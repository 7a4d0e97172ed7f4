//! What `compare` found, as a report.

mod maps;
mod rays;
mod sections;

pub(crate) use sections::{in_figures, report};

use crate::verify::compare::Replayed;
use crate::world::local_origin::LocalOrigin;
use crate::world::scene::Scene;
use crate::world::trajectory::Trajectory;

/// What the pictures of a page show.
pub(crate) struct Pictures<'a> {
    pub replayed: &'a Replayed,
    pub scene: &'a Scene,
    pub trajectory: &'a Trajectory,
    pub agree_within_m: f64,
    pub origin: LocalOrigin,
}
