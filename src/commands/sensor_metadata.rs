//! What is known of a sensor before its first packet.

use std::path::Path;

use anyhow::Context as _;
use sensors::ouster::Metadata;

use crate::live::config::Stream;
use crate::live::receive::{Listen, is_auxiliary};
use crate::live::watch::FirstLook;

/// A check of a sensor's first packets; auxiliary streams are not checked.
pub(super) fn first_look(sensor: &Stream, metadata: Option<&str>, listens: &[Listen]) -> Option<FirstLook> {
    if is_auxiliary(&sensor.listen.name, listens.iter().map(|listen| listen.name.as_str())) {
        return None;
    }
    let name = match (&sensor.metadata, &sensor.host) {
        (Some(path), _) => path.display().to_string(),
        (None, host) => host.clone().unwrap_or_default(),
    };
    let metadata = metadata.and_then(|text| Metadata::parse(text, &name).ok());
    Some(FirstLook::new(sensor.model.clone(), metadata.map(|metadata| (metadata, name))))
}

pub(super) fn read_metadata(path: &Path) -> anyhow::Result<String> {
    let text = crate::base::files::read_text(path).with_context(|| format!("metadata {}", path.display()))?;
    Metadata::parse(&text, &path.display().to_string())?;
    Ok(text)
}
