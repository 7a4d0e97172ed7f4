//! The sampling of beams along a trajectory.

pub mod column;
pub mod detection;
pub mod fan;
pub mod frames;
pub mod occluder;
pub mod published;
pub(crate) mod rounds;
pub mod scan;
pub mod sweep;
