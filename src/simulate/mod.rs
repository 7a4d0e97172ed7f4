//! The sampling of beams along a trajectory.

pub mod column;
pub mod detection;
pub mod fan;
pub mod occluder;
pub mod published;
pub mod scan;
