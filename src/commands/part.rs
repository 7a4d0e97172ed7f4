//! Which part of a recording is wanted: the arguments that `decode` and `cut` share.

use crate::recording::moment::Moment;
use crate::recording::part::Part;

/// Times and sensors.
#[derive(clap::Args, Debug, Default)]
pub struct PartArgs {
    /// First time: seconds since the start, seconds since 1970, a time such as 2023-11-14T22:13:20Z, or a revolution (12f).
    #[arg(long, value_name = "T")]
    from: Option<Moment>,
    /// End, which is not included.
    #[arg(long, value_name = "T")]
    to: Option<Moment>,
    /// Only this sensor: its name as `inspect` gives it, or its serial number. May be repeated.
    #[arg(long = "sensor", value_name = "NAME")]
    only: Vec<String>,
}

impl PartArgs {
    pub(crate) fn part(&self) -> Part {
        Part { from: self.from, to: self.to, only: self.only.clone() }
    }
}
