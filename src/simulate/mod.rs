//! The sampling of beams along a trajectory.

pub mod occluder;
pub mod published;
pub mod scan;
