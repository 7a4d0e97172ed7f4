//! Names of the sensors of a recording, for documents and files.

use sensors::router::{Router, Sensor};

/// One name per sensor, in order; no two the same.
pub(crate) fn ids(router: &Router) -> Vec<String> {
    let mut known = Vec::new();
    for sensor in router.sensors() {
        next_id(sensor, &mut known);
    }
    known
}

/// As the recording calls it, or by product and serial number (or sender, where there is none); numbered where that is
/// in use.
pub(crate) fn next_id(sensor: &Sensor, known: &mut Vec<String>) -> String {
    let tail = match (sensor.serial(), sensor.source()) {
        ("", Some(source)) => source.ip().to_string(),
        (serial, _) => serial.to_owned(),
    };
    let unnamed = || format!("{}-{tail}", sensor.product()).to_lowercase();
    let plain: String = sensor
        .name
        .clone()
        .unwrap_or_else(unnamed)
        .chars()
        .map(|c| if c.is_ascii_alphanumeric() || "._".contains(c) { c } else { '-' })
        .collect();
    let plain = plain.trim_end_matches('-').to_owned();
    let numbered = (2..).map(|number| format!("{plain}-{number}"));
    let id = std::iter::once(plain.clone()).chain(numbered).find(|id| !known.contains(id)).unwrap_or(plain);
    known.push(id.clone());
    id
}
