//! The sampling of beams along a trajectory.
