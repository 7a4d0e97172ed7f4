//! A recording decoded: its points in files, and what was found on the way.

mod clouds;
mod document;
mod error;
mod frames;
mod output;
mod packets;
mod placing;
mod spec;

pub(crate) use clouds::decode_clouds;
pub(crate) use document::{Document, FrameRow, SensorReport};
pub(crate) use error::DecodingError;
pub(crate) use frames::{FrameRange, OutputFrame};
pub(crate) use output::ensure_output;
pub(crate) use packets::decode;
pub(crate) use spec::DecodingSpec;

/// The message of a decoding that was stopped.
pub(crate) const INTERRUPTED: &str = "interrupted: whole files stay, unfinished ones are removed";
