//! Metadata of a sensor before it is recorded.

use anyhow::Context as _;
use sensors::ouster::Metadata;

use super::watch::say;
use crate::live::config::Stream;
use crate::live::setup::{Sensor, warnings};
use crate::live::watch::read_metadata;

/// Metadata of a sensor: from its file, else from itself. What the sensor says of itself is printed, and where it is not
/// what the file says.
pub(in crate::commands) fn metadata_of(sensor: &Stream) -> anyhow::Result<Option<String>> {
    let name = &sensor.listen.name;
    let file = sensor.metadata.as_deref().map(read_metadata).transpose().with_context(|| name.clone())?;
    let Some(host) = &sensor.host else { return Ok(file) };
    let mut state = match Sensor::at(host).and_then(|found| found.read()) {
        Ok(state) => state,
        // what lies on the disk will do
        Err(error) if file.is_some() => {
            say(&format!("warning: {name}: {error}; its metadata file is used unseen"));
            return Ok(file);
        }
        Err(error) => return Err(error).with_context(|| format!("{name}: metadata")),
    };
    if let (Some(theirs), Some(ours)) = (&state.metadata, &file) {
        state.warnings.extend(warnings::of_metadata(theirs, ours)?);
    }
    for warning in &state.warnings {
        say(&format!("warning: {name}: {}", warning.text));
    }
    if let (Some(theirs), None) = (&state.metadata, &file) {
        Metadata::parse(theirs, host)?;
    }
    Ok(file.or(state.metadata))
}
