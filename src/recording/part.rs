//! Which part of a recording is wanted.

use super::moment::Moment;

/// Times and sensors.
#[derive(Clone, Debug, Default)]
pub(crate) struct Part {
    pub from: Option<Moment>,
    /// The end, which is not included.
    pub to: Option<Moment>,
    /// Names or serial numbers of sensors; of none, all.
    pub only: Vec<String>,
}

impl Part {
    /// Whether a sensor is wanted.
    pub(crate) fn wants(&self, name: &str, serial: &str) -> bool {
        self.only.is_empty() || self.only.iter().any(|only| only == name || only == serial)
    }

    /// First revolution and the end of them, where these are what the times name.
    pub(crate) fn revolutions(&self) -> [Option<u64>; 2] {
        [self.from, self.to].map(|moment| moment.and_then(Moment::frame))
    }
}
