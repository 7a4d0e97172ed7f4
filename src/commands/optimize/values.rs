//! Values of the flags of `optimize`.

use std::num::NonZeroUsize;
use std::str::FromStr;

use crate::design::optimize::KeepApart;

/// Whether something is done.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Switch {
    /// It is.
    On,
    /// It is not.
    Off,
}

/// Two numbers, the first not above the second where they are a range.
#[derive(Clone, Copy, Debug)]
pub(super) struct Range(pub f64, pub f64);

impl FromStr for Range {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match numbers(text)?.as_slice() {
            [first, second] if first <= second => Ok(Self(*first, *second)),
            [first, second] => Err(format!("{first} is above {second}, expected the least one first")),
            other => Err(format!("{} numbers, expected 2", other.len())),
        }
    }
}

/// Degrees by which something may be turned: beyond half a turn in each direction there are but the same angles again.
pub(super) fn tilts(text: &str) -> Result<Range, String> {
    let Range(low, high) = text.parse()?;
    match low >= -180.0 && high <= 180.0 {
        true => Ok(Range(low, high)),
        false => Err(format!("{low} to {high} degrees, expected within -180 to 180")),
    }
}

/// By how much a built mount may be off: m, degrees.
#[derive(Clone, Copy, Debug)]
pub(super) struct MountErrors(pub f64, pub f64);

impl FromStr for MountErrors {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match numbers(text)?.as_slice() {
            [position_m, angle_deg] => Ok(Self(*position_m, *angle_deg)),
            other => Err(format!("{} numbers, expected 2: metres and degrees", other.len())),
        }
    }
}

/// Minimum and maximum x, y and z.
#[derive(Clone, Copy, Debug)]
pub(super) struct Corners(pub [f64; 6]);

impl FromStr for Corners {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = numbers(text)?;
        let found = numbers.len();
        let corners: [f64; 6] =
            numbers.try_into().map_err(|_| format!("{found} numbers, expected 6: x,x,y,y,z,z"))?;
        for (pair, name) in corners.chunks(2).zip(["x", "y", "z"]) {
            if pair[0] > pair[1] {
                return Err(format!(
                    "{name}: {} is above {}, expected the least one first",
                    pair[0], pair[1]
                ));
            }
        }
        Ok(Self(corners))
    }
}

fn numbers(text: &str) -> Result<Vec<f64>, String> {
    let parts = text.split(',').map(|part| part.trim().parse().ok().filter(|v: &f64| v.is_finite()));
    parts.collect::<Option<_>>().ok_or_else(|| "every part must be a finite number".into())
}

/// The minimum distance between sensors.
#[derive(Clone, Copy, Debug)]
pub(super) struct ClearanceArg(pub KeepApart);

impl FromStr for ClearanceArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "none" => Ok(Self(KeepApart::None)),
            "housing" => Ok(Self(KeepApart::Housings)),
            number => match number.parse::<f64>() {
                Ok(least_m) if least_m.is_finite() && least_m >= 0.0 => {
                    Ok(Self(KeepApart::Distance(least_m)))
                }
                _ => Err("give housing, none, or a distance in metres".into()),
            },
        }
    }
}

pub(super) fn batch(text: &str) -> Result<NonZeroUsize, String> {
    crate::commands::ranges::count(1, 1024)(text).map(|points| NonZeroUsize::MIN.saturating_add(points - 1))
}

pub(super) fn percent(text: &str) -> Result<f64, String> {
    let value: Option<f64> = text.parse().ok().filter(|value: &f64| *value > 0.0 && *value < 100.0);
    value.ok_or_else(|| format!("{text:?}: give percent above 0 and below 100"))
}
