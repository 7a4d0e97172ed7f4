//! The trajectory of a recording: from a file, its own, or by odometry; and where it lies in a scene.

mod by_odometry;
mod clocks;
mod error;
mod found;
mod frames;
mod in_scene;
mod walk_site;
mod spec;
mod world;

pub(crate) use by_odometry::{OdometryResult, OdometrySpec};
pub(crate) use clocks::Offset;
pub(crate) use error::WalkError;
pub(crate) use frames::Frames;
pub(crate) use in_scene::{Placed, Walk, in_scene};
pub(crate) use spec::WalkSiteSpec;
pub(crate) use walk_site::WalkSite;
pub(crate) use world::registration;
