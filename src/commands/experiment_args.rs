//! A published experiment as typed.

mod objective;

use std::str::FromStr;

use super::scene_args::one_of;
use crate::design::objective::Prices;
use crate::rig::{Path, Phase, Roll};

/// A published experiment and what may be changed about it.
#[derive(clap::Args, Debug, Clone)]
pub struct ExperimentArgs {
    /// The experiment: paper-os1-64 or paper-vlp-16; both, with a comma, for a rig that may mix their sensors.
    #[arg(long, env = "OUTRIGGER_PRESET", value_delimiter = ',', value_name = "PRESET,PRESET")]
    preset: Vec<String>,
    /// Direction of the walk in the mount frame: lateral as published, forward as the text has it [default: lateral].
    #[arg(long, value_parser = one_of(&[("lateral", Path::Lateral), ("forward", Path::Forward)]))]
    path: Option<Path>,
    /// Edge of a voxel [default: 0.1 in a scene; the preset's 0.5, or 5 m divided by another whole number].
    #[arg(long, value_name = "M", value_parser = crate::commands::ranges::within(1e-3, 1000.0))]
    voxel: Option<f64>,
    /// Columns per revolution [default: the preset's 180; in a scene as the calibration says, else 1024 for Ouster models, 1800
    /// for others].
    #[arg(long, value_name = "N", value_parser = crate::commands::ranges::count(1, 65_536))]
    azimuths: Option<usize>,
    /// Roll of every master: fixed:DEG, or free to take it as given [default: fixed:0; free for a mount file].
    #[arg(long, value_name = "RULE")]
    roll: Option<RollArg>,
    /// Take the masters as they are, without mirror images.
    #[arg(long)]
    no_mirror: bool,
    /// Poses per metre of the walk [default: 1].
    #[arg(long, value_name = "N", value_parser = crate::commands::ranges::count(1, 1000))]
    sub_poses: Option<usize>,
    /// Where each revolution starts: locked at azimuth 0, or free (moved on from pose to pose, and no ray lost) [default:
    /// locked].
    #[arg(long, value_parser = one_of(&[("locked", Phase::Locked), ("free", Phase::Free)]))]
    phase: Option<Phase>,
    /// Price of one sensor in J: one number, or one for each model of a mixed rig ("os1-64=2000,vlp-16=800") [default:
    /// 2000].
    #[arg(long, value_name = "J", allow_hyphen_values = true)]
    lambda: Option<Prices>,
    /// Least distance between sensor origins; the housings are always asked for [default: 0].
    #[arg(long, value_name = "M", value_parser = crate::commands::ranges::within(0.0, 1000.0))]
    least_distance: Option<f64>,
    /// Adds to J this times log10(q / 0.003), q being the least translation eigenvalue per hit (5th percentile along
    /// the path): registration strength of the scans [default: 0].
    #[arg(long, value_name = "J", value_parser = crate::commands::ranges::within(0.0, 1e12))]
    registration_weight: Option<f64>,
    /// Least such q that is allowed (0.003 is degenerate, 1/3 the most there can be) [default: 0].
    #[arg(long, value_name = "Q", value_parser = crate::commands::ranges::within(0.0, 1.0))]
    min_conditioning: Option<f64>,
}

/// How finely is looked.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum FidelityArg {
    /// As the other arguments say.
    Given,
    /// As finely as the question needs.
    Auto,
}

impl FidelityArg {
    /// Without flags: a published experiment is sampled as it was published.
    pub(crate) fn for_scene(is_new: bool) -> Self {
        if is_new { Self::Auto } else { Self::Given }
    }
}

#[derive(Clone, Copy, Debug)]
struct RollArg(Roll);

impl FromStr for RollArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "free" {
            return Ok(Self(Roll::Free));
        }
        let roll_deg = text.strip_prefix("fixed:").and_then(|number| number.parse::<f64>().ok());
        match roll_deg.filter(|value| value.is_finite()) {
            Some(roll_deg) => Ok(Self(Roll::Fixed(roll_deg))),
            None => Err("give free, or fixed: and an angle in degrees (fixed:0)".into()),
        }
    }
}

/// What holds for a search in any scene, too.
pub struct SceneSettings {
    pub voxel_m: Option<f64>,
    pub columns: Option<u32>,
    /// The rule; fixed at zero where none is given.
    pub roll: Roll,
    pub is_mirrored: bool,
}

impl ExperimentArgs {
    /// What has no use in a scene.
    pub(crate) const ONLY_PUBLISHED: [&str; 6] =
        ["preset", "path", "sub_poses", "phase", "lambda", "least_distance"];

    pub(crate) fn of_scene(&self) -> SceneSettings {
        SceneSettings {
            voxel_m: self.voxel,
            columns: self.azimuths.map(|columns| columns as u32),
            roll: self.roll.map_or(Roll::Fixed(0.0), |rule| rule.0),
            is_mirrored: !self.no_mirror,
        }
    }

    /// Whether this is an unpublished scene without a specified sampling.
    pub(crate) fn is_new_scene(&self) -> bool {
        let is_fineness_stated = self.azimuths.is_some()
            || self.sub_poses.is_some_and(|poses| poses != 1)
            || self.phase == Some(Phase::Free);
        self.voxel.is_some() && !is_fineness_stated
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_roll_is_an_angle() {
        assert!("fixed:NaN".parse::<RollArg>().is_err());
    }
}
