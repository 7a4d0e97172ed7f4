//! Rigs that were cast.

use crate::design::objective::Terms;
use crate::design::registration::RegistrationQuality;
use crate::rig::Rig;
use crate::simulate::view::Seen;
use crate::world::coverage::Coverage;

/// A rig that was cast.
#[derive(Clone, Debug)]
pub(crate) struct Exact {
    pub values: Vec<f64>,
    pub rig: Rig,
    pub seen: Seen,
    /// By the beams that judge while searching, where these are not all.
    pub seen_thinned: Option<Seen>,
    pub terms: Terms,
    /// Where it counts.
    pub registration: Option<RegistrationQuality>,
    /// By how much it misses what is asked: distances between sensors, m, and the share of the conditioning.
    pub violation: f64,
    /// What errors of building take from J, where that is what is searched: by the model, or by `losses`.
    pub loss: f64,
    /// The same of each draw, where they were cast.
    pub losses: Option<Vec<f64>>,
    /// By site the voxels seen, where they are held.
    pub coverage: Option<Vec<Coverage>>,
}

impl Exact {
    /// J as planned.
    pub(crate) fn objective(&self) -> f64 {
        self.terms.objective()
    }

    /// What is searched: J as planned, or over errors of building.
    pub(crate) fn score(&self) -> f64 {
        self.objective() - self.loss
    }
}

/// How far a rig is tilted in all, rad.
pub(super) fn tilt_rad(rig: &Rig) -> f64 {
    let tilts = rig.sensors.iter().map(|sensor| sensor.mount.pitch_rad.hypot(sensor.mount.roll_rad));
    tilts.sum()
}
