//! What the stages of the demo share.

use std::sync::atomic::AtomicBool;

use super::Fault;
use crate::rig::{MountFile, Rig};
use crate::world::scene::Scene;
use crate::world::trajectory::Trajectory;

/// What the walk is given.
pub struct Walk<'a> {
    pub scene: &'a Scene,
    pub planned: &'a Trajectory,
    /// The walked trajectory, which the session records.
    pub trajectory: &'a Trajectory,
    pub rig: &'a Rig,
    pub mount: &'a MountFile,
    /// How many times faster than life.
    pub rate: f64,
    pub fault: Option<Fault>,
    pub stop: &'a AtomicBool,
}
