//! What the flags of `rig` mean.

use super::{Action, Args};
use crate::commands::defaults::section;
use crate::commands::{Verb, ensure_consistent};
use crate::drive::Options;
use crate::live::config::Config;

pub(in crate::commands) fn options(args: &Args, axes: usize) -> anyhow::Result<Options> {
    let approach_rad = args.approach_deg.to_radians();
    let mut limits_rad: Vec<_> =
        args.limits_deg.iter().map(|(low, high)| (low.to_radians(), high.to_radians())).collect();
    if let [all] = limits_rad[..] {
        limits_rad = vec![all; axes];
    }
    let given = limits_rad.len();
    let words = format!("--limits-deg is given {given} times for {axes} pitches");
    ensure_consistent([(given > 0 && axes > 0 && given != axes, words)])?;
    let tolerance_rad = args.tolerance_deg.to_radians();
    Ok(Options {
        settle_within: args.timeout_s,
        tolerance_rad,
        limits_rad,
        approach_rad,
        node: args.node,
        ..Options::new_session()
    })
}

/// Names of the sensors on axis 0, 1, ..., as a rig.toml has them under [rig.apply]; empty where it says nothing of it.
pub(in crate::commands) fn axes_of(config: &Config) -> anyhow::Result<Vec<String>> {
    let args: Args = section(config, &["rig", "apply", "-"], |verb| match verb {
        Verb::Rig(args) => Some(args),
        _ => None,
    })?;
    Ok(if let Action::Apply { sensors, .. } = args.action { sensors } else { Vec::new() })
}
