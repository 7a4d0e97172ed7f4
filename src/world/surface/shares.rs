//! Shares of a surface: which of its samples can be seen from the path at all, and how many are covered.

use std::collections::BTreeMap;

use glam::DVec3;
use serde::Serialize;

use super::{Completeness, SurfaceSamples, THRESHOLDS_M};
use crate::world::scene::Scene;

/// Rank of the threshold that the shares of the observable surface and the search for a baseline use: 5 cm.
pub(crate) const MAIN_RANK: usize = 1;

/// Samples of a surface and which of them are observable.
pub(crate) struct ObservableSurface {
    pub samples: SurfaceSamples,
    pub is_observable: Vec<bool>,
}

impl ObservableSurface {
    /// The observable set is that with a line of sight from one of the stations.
    pub(crate) fn new(scene: &Scene, samples: SurfaceSamples, stations_m: &[DVec3]) -> Self {
        let is_observable = scene.observable(&samples, stations_m);
        Self { samples, is_observable }
    }

    /// The observable points, m.
    pub(crate) fn observable_m(&self) -> impl Iterator<Item = DVec3> {
        let points = self.samples.points_m().iter().zip(&self.is_observable);
        points.filter(|(_, is_observable)| **is_observable).map(|(point_m, _)| *point_m)
    }

    pub(crate) fn observable_share(&self) -> f64 {
        self.observable_m().count() as f64 / self.samples.len() as f64
    }

    pub(crate) fn shares(&self, completeness: &Completeness) -> SurfaceShares {
        let by_threshold = THRESHOLDS_M.iter().zip(completeness.shares());
        SurfaceShares {
            completeness: by_threshold.map(|(limit_m, share)| (format!("{limit_m:.2}"), share)).collect(),
            completeness_of_observable: completeness.share_of(&self.is_observable, MAIN_RANK),
        }
    }
}

/// Shares of a surface that are covered.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct SurfaceShares {
    /// By threshold in metres: "0.02" and so on.
    pub completeness: BTreeMap<String, f64>,
    /// At 5 cm; null when nothing is observable.
    pub completeness_of_observable: Option<f64>,
}

impl SurfaceShares {
    /// At 5 cm.
    pub(crate) fn main(&self) -> f64 {
        self.completeness.values().nth(MAIN_RANK).copied().unwrap_or(0.0)
    }

    /// In percent, for tables: each threshold, then the share of the observable surface.
    pub(crate) fn percent(&self) -> Vec<String> {
        let shares = self.completeness.values().map(|share| format!("{:.3}", 100.0 * share));
        let observable = self.completeness_of_observable.map_or("-".into(), |s| format!("{:.3}", 100.0 * s));
        shares.chain([observable]).collect()
    }
}
