//! What keeps a rig from being built.

use super::{Clearance, Rig, Touching};

/// Pairs of sensors that cannot be built as they are mounted.
#[derive(Clone, Debug, serde::Serialize)]
pub(crate) struct Conflicts {
    /// Pairs of housings that are not apart.
    pub violations: Vec<Clearance>,
    /// Pairs of housings that touch as they are tilted, far apart as their origins may be.
    pub touching: Vec<Touching>,
}

impl Rig {
    pub(crate) fn conflicts(&self) -> Conflicts {
        let violations = self.clearances(0.0).into_iter().filter(|pair| !pair.is_sufficient()).collect();
        Conflicts { violations, touching: self.touching() }
    }
}

impl Conflicts {
    /// Each pair of sensors in words, with a label.
    pub(crate) fn figures(&self) -> impl Iterator<Item = (&'static str, String)> {
        let near = self.violations.iter().map(|pair| {
            format!(
                "{} and {} are {:.4} m apart, needed are {:.4} m",
                pair.first, pair.second, pair.distance_m, pair.needed_m
            )
        });
        near.chain(self.touching.iter().map(ToString::to_string)).map(|words| ("cannot be built", words))
    }
}
