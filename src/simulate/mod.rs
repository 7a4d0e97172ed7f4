//! The sampling of beams along a trajectory.

pub mod fan;
pub mod occluder;
pub mod published;
pub mod scan;
