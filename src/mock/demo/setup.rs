//! What the stages of the demo share.

use std::sync::atomic::AtomicBool;

use crate::rig::{MountFile, Rig};
use crate::world::scene::Scene;
use crate::world::trajectory::Trajectory;

/// What can be broken in the middle of the walk.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum DemoFault {
    /// The rig's cable: its pty closes.
    CutCable,
    /// The first sensor dies.
    KillSensor,
}

/// What the walk is given.
pub(crate) struct Walk<'a> {
    pub scene: &'a Scene,
    pub planned: &'a Trajectory,
    /// The walked trajectory, which the session records.
    pub trajectory: &'a Trajectory,
    pub rig: &'a Rig,
    pub mount: &'a MountFile,
    /// How many times faster than life.
    pub rate: f64,
    pub fault: Option<DemoFault>,
    pub stop: &'a AtomicBool,
}
