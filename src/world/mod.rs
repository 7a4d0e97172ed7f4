//! What is around the rig, where it goes, and which of it was seen.

pub mod scene;
pub mod trajectory;
pub mod coverage;
pub mod surface;
pub mod local_origin;
pub(crate) mod placement;
