//! The range of frames behind `--frames`.

use std::fmt;
use std::str::FromStr;

/// Frames from `first` up to, not including, `end`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct FrameRange {
    first: u64,
    end: u64,
}

impl Default for FrameRange {
    fn default() -> Self {
        Self { first: 0, end: u64::MAX }
    }
}

impl FrameRange {
    /// Those of them from one on, and before another.
    pub(crate) fn within(self, from: Option<u64>, end: Option<u64>) -> Self {
        Self { first: self.first.max(from.unwrap_or(0)), end: self.end.min(end.unwrap_or(u64::MAX)) }
    }

    /// Whether a frame is meant.
    pub(crate) fn contains(self, number: u64) -> bool {
        (self.first..self.end).contains(&number)
    }
}

impl fmt::Display for FrameRange {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self { first, end: u64::MAX } => write!(out, "{first}.."),
            Self { first, end } if *end == first + 1 => write!(out, "{first}"),
            Self { first, end } => write!(out, "{first}..{end}"),
        }
    }
}

impl FromStr for FrameRange {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number = |text: &str| text.parse::<u64>().map_err(|_| format!("{text:?} is no frame number"));
        let range = match text.split_once("..") {
            None => {
                let first = number(text)?;
                Self { first, end: first.saturating_add(1) }
            }
            Some((first, end)) => Self {
                first: if first.is_empty() { 0 } else { number(first)? },
                end: match end.strip_prefix('=') {
                    _ if end.is_empty() => u64::MAX,
                    Some(last) => number(last)?.saturating_add(1),
                    None => number(end)?,
                },
            },
        };
        if range.first >= range.end {
            return Err(format!("{text:?} holds no frame: the end is not included"));
        }
        Ok(range)
    }
}

/// The frame that points are in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum OutputFrame {
    /// Each sensor's own.
    #[default]
    Sensor,
    /// The rig's: x forward, y left, z up.
    Rig,
    /// The frame of a trajectory, each point at its own time.
    World,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_as_rust_writes_them() {
        let range = |text: &str| text.parse::<FrameRange>();
        assert_eq!(range("2..5"), Ok(FrameRange { first: 2, end: 5 }));
        assert_eq!(range("2..=5"), Ok(FrameRange { first: 2, end: 6 }));
        assert_eq!(range("2"), Ok(FrameRange { first: 2, end: 3 }));
        assert_eq!(range(".."), Ok(FrameRange::default()));
        assert_eq!(range("..5"), Ok(FrameRange { first: 0, end: 5 }));
        assert!(range("5..5").is_err() && range("a..").is_err());
    }
}
