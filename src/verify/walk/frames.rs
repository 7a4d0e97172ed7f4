//! Numbers of frames that make a map.

use std::ops::Range;
use std::str::FromStr;

/// Frames that make a map.
#[derive(Clone, Debug)]
pub(crate) struct Frames(pub Range<u64>);

impl FromStr for Frames {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let ends = text.split_once("..").and_then(|(a, b)| Some((a.parse().ok()?, b.parse().ok()?)));
        match ends {
            Some((from, to)) if from < to => Ok(Self(from..to)),
            _ => Err(format!("{text:?}: expected two numbers of frames that ascend, like 0..2")),
        }
    }
}
