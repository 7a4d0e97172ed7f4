//! The surface of a mesh as sample points: which of them can be seen from the path, and what share is covered.

use std::collections::BTreeMap;
use std::path::PathBuf;

use anyhow::Context as _;
use glam::DVec3;
use serde::Serialize;

use crate::world::scene::Mesh;
use crate::world::surface::{Completeness, SurfaceSamples, THRESHOLDS_M, observable, read_points};

/// Rank of the threshold that the shares of the observable surface and the search for a baseline use: 5 cm.
pub const MAIN_RANK: usize = 1;
/// Line of sight may end this much before a point, m.
const SIGHT_TOLERANCE_M: f64 = 0.02;

/// Where the samples come from.
#[derive(clap::Args, Debug)]
pub struct SampleArgs {
    /// Surface samples: a NumPy file of floats, shape (n, 3), metres, in the frame of the trajectory.
    #[arg(long, value_name = "FILE", conflicts_with = "sample_count")]
    samples: Option<PathBuf>,
    /// Samples drawn from the mesh, evenly over its area.
    #[arg(long, value_name = "N", default_value_t = 1_000_000, value_parser = clap::value_parser!(u32).range(1..=100_000_000))]
    sample_count: u32,
}

impl SampleArgs {
    /// Reads or draws the samples.
    pub fn take(&self, mesh: &Mesh, seed: u64) -> anyhow::Result<SurfaceSamples> {
        let Some(path) = &self.samples else {
            return Ok(SurfaceSamples::of_mesh(mesh, self.sample_count as usize, seed));
        };
        let bytes = crate::base::files::read(path).with_context(|| path.display().to_string())?;
        let points_m = read_points(&bytes).with_context(|| path.display().to_string())?;
        SurfaceSamples::new(points_m).with_context(|| path.display().to_string())
    }
}

/// Samples and which of them can be seen at all.
pub struct Surface {
    pub samples: SurfaceSamples,
    pub visible: Vec<bool>,
}

impl Surface {
    /// The observable set is that with a line of sight from one of the stations.
    pub fn new(mesh: &Mesh, samples: SurfaceSamples, stations_m: &[DVec3]) -> Self {
        let visible = observable(mesh, &samples, stations_m, SIGHT_TOLERANCE_M);
        Self { samples, visible }
    }

    /// Share of the samples that can be seen.
    pub fn observable_share(&self) -> f64 {
        self.visible.iter().filter(|seen| **seen).count() as f64 / self.visible.len() as f64
    }

    /// What share is covered.
    pub fn covered(&self, completeness: &Completeness) -> Covered {
        Covered {
            completeness: by_threshold(completeness.shares()),
            completeness_of_observable: completeness.share_of(&self.visible, MAIN_RANK),
        }
    }
}

/// Shares of the surface.
#[derive(Clone, Debug, Serialize)]
pub struct Covered {
    /// By threshold in metres.
    pub completeness: BTreeMap<String, f64>,
    /// At 5 cm; null when nothing is observable.
    pub completeness_of_observable: Option<f64>,
}

impl Covered {
    /// At 5 cm.
    pub fn main(&self) -> f64 {
        self.completeness.values().nth(MAIN_RANK).copied().unwrap_or(0.0)
    }

    /// The shares in percent, for tables: each threshold, then the share of the observable surface.
    pub fn percent(&self) -> Vec<String> {
        let shares = self.completeness.values().map(|share| format!("{:.3}", 100.0 * share));
        let observable = self.completeness_of_observable.map_or("-".into(), |s| format!("{:.3}", 100.0 * s));
        shares.chain([observable]).collect()
    }
}

/// Values by threshold, "0.02" and so on.
pub fn by_threshold(values: Vec<f64>) -> BTreeMap<String, f64> {
    THRESHOLDS_M.iter().zip(values).map(|(threshold_m, value)| (format!("{threshold_m:.2}"), value)).collect()
}
