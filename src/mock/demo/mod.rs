//! The whole loop on mock devices: the best mounts are searched, the mock rig is tilted, two mock sensors walk and send UDP,
//! which is recorded, opened again, decoded and compared with the prediction.

mod document;
mod error;
mod report;
mod pictures;
mod plan;
mod problems;
mod replay;
mod sensors;
mod setup;
mod tilt;
mod walk;

pub(crate) use document::{Document, FORMAT};
pub(crate) use plan::{predict, search};
pub(crate) use problems::problems;
pub(crate) use replay::compare;
pub(crate) use report::report;
pub(crate) use setup::{DemoFault, Walk};
pub(crate) use tilt::drive;
pub(crate) use walk::record;
