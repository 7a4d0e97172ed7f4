//! A published experiment as typed: its options, and the masters scored in it.

use std::str::FromStr;

use anyhow::bail;

use super::prices::Prices;
use crate::objective::{Objective, Weights};
use crate::simulate::published::{Experiment, Path, Phase, Preset, Roll, Simulator};

/// A published experiment and what may be changed about it.
#[derive(clap::Args, Debug, Clone)]
pub struct ExperimentArgs {
    /// The experiment: paper-os1-64 or paper-vlp-16; both, with a comma, for a rig that may mix their sensors.
    #[arg(long, env = "OUTRIGGER_PRESET", value_delimiter = ',', value_name = "PRESET,PRESET")]
    preset: Vec<String>,
    /// Direction of the walk in the mount frame: lateral as published, forward as the text has it.
    #[arg(long, default_value = "lateral")]
    path: PathArg,
    /// Edge of a voxel: 5 m divided by a whole number [default: the preset's 0.5].
    #[arg(long, value_name = "M")]
    voxel: Option<f64>,
    /// Columns per revolution [default: the preset's 180].
    #[arg(long, value_name = "N")]
    azimuths: Option<usize>,
    /// Roll of every master: fixed:DEG, or free to take it as given [default: fixed:0; free for a mount file].
    #[arg(long, value_name = "RULE")]
    roll: Option<RollArg>,
    /// Take the masters as they are, without mirror images.
    #[arg(long)]
    no_mirror: bool,
    /// Poses per metre of the walk.
    #[arg(long, value_name = "N", default_value_t = 1)]
    sub_poses: usize,
    /// Where each revolution starts: locked at azimuth 0, or free (moved on from pose to pose, and no ray lost).
    #[arg(long, default_value = "locked")]
    phase: PhaseArg,
    /// Price of one sensor in J: one number, or one for each model of a mixed rig ("os1-64=2000,vlp-16=800").
    #[arg(long, value_name = "J", default_value_t, allow_hyphen_values = true)]
    lambda: Prices,
    /// Least distance between sensor origins; the housings are always asked for.
    #[arg(long, value_name = "M", default_value_t = 0.0)]
    least_distance: f64,
    /// Adds to J this times log10(q / 0.003), q being the least translation eigenvalue per hit (5th percentile along
    /// the path): how well scans are tied down.
    #[arg(long, value_name = "J", default_value_t = 0.0)]
    registration_weight: f64,
    /// Least such q that is allowed (0.003 is loose, 1/3 the most there can be).
    #[arg(long, value_name = "Q", default_value_t = 0.0)]
    min_conditioning: f64,
}

#[derive(clap::ValueEnum, Clone, Copy, Debug)]
enum PathArg {
    Lateral,
    Forward,
}

#[derive(clap::ValueEnum, Clone, Copy, Debug)]
enum PhaseArg {
    Locked,
    Free,
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

impl ExperimentArgs {
    /// Whether this is a scene that nobody published, with nothing said about how finely it is to be looked at.
    pub fn is_new_scene(&self) -> bool {
        let is_fineness_said =
            self.azimuths.is_some() || self.sub_poses != 1 || matches!(self.phase, PhaseArg::Free);
        self.voxel.is_some() && !is_fineness_said
    }

    /// The objective that was asked for; `otherwise` names presets (with commas) where none are given, `roll` is the
    /// rule where none is given.
    pub fn objective(&self, otherwise: Option<&str>, roll: Roll) -> anyhow::Result<Objective> {
        let given = self.preset.iter().map(String::as_str);
        let otherwise = otherwise.filter(|_| self.preset.is_empty());
        let names = given.chain(otherwise.iter().flat_map(|names| names.split(',')));
        let presets = names.map(|name| Preset::named(name.trim())).collect::<Result<Vec<_>, _>>()?;
        let Some(preset) = presets.first() else {
            bail!("which experiment? Give --preset, one of {}", Preset::names());
        };
        let experiment = Experiment {
            path: match self.path {
                PathArg::Lateral => Path::Lateral,
                PathArg::Forward => Path::Forward,
            },
            voxel_m: self.voxel.unwrap_or(preset.voxel_m),
            azimuths: self.azimuths.unwrap_or(preset.azimuths),
            roll: self.roll.map_or(roll, |rule| rule.0),
            mirror: !self.no_mirror,
            sub_poses: self.sub_poses,
            phase: match self.phase {
                PhaseArg::Locked => Phase::Locked,
                PhaseArg::Free => Phase::Free,
            },
            ..Experiment::mixed(&presets)?
        };
        if !(self.least_distance.is_finite() && self.least_distance >= 0.0) {
            bail!("--least-distance {}, expected a finite number of at least 0", self.least_distance);
        }
        let prices = self.lambda.of(&experiment)?;
        if !(self.registration_weight.is_finite() && self.registration_weight >= 0.0) {
            bail!("--registration-weight {}, expected a number of at least 0", self.registration_weight);
        }
        if !(0.0..1.0 / 3.0).contains(&self.min_conditioning) {
            bail!("--min-conditioning {}, expected at least 0 and below 1/3", self.min_conditioning);
        }
        let weights = Weights {
            sensor_cost: prices[0],
            registration: self.registration_weight,
            least_conditioning: self.min_conditioning,
            ..Weights::default()
        };
        let objective = Objective::new(Simulator::new(&experiment)?, weights, self.least_distance)?;
        Ok(objective.with_prices(prices))
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
