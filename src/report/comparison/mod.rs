//! What `compare` found, as a report.

mod maps;
mod rays;
mod sections;

pub(crate) use sections::{Pictures, in_figures, report};
