//! The sampling of beams along a trajectory.

pub mod published;
