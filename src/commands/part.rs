//! Which part of a recording is wanted: the arguments that `decode` and `cut` share.

use crate::recording::moment::Moment;

/// Times and sensors.
#[derive(clap::Args, Debug, Default)]
pub struct PartArgs {
    /// First time: seconds since the start, seconds since 1970, a time such as 2023-11-14T22:13:20Z, or a revolution (12f).
    #[arg(long, value_name = "T")]
    pub from: Option<Moment>,
    /// End, which is not included.
    #[arg(long, value_name = "T")]
    pub to: Option<Moment>,
    /// Only this sensor: its name as `inspect` gives it, or its serial number. May be repeated.
    #[arg(long = "sensor", value_name = "NAME")]
    pub only: Vec<String>,
}

impl PartArgs {
    /// Whether a sensor is wanted.
    pub(crate) fn wants(&self, name: &str, serial: &str) -> bool {
        self.only.is_empty() || self.only.iter().any(|only| only == name || only == serial)
    }

    /// First revolution and the end of them, where these are what the times name.
    pub(crate) fn revolutions(&self) -> [Option<u64>; 2] {
        [self.from, self.to].map(|moment| moment.and_then(Moment::frame))
    }
}
