//! What makes a prediction doubtful.

use super::{Prediction, Site};
use crate::simulate::scan::Scanner;
use crate::world::surface::ObservableSurface;

/// A voxel of the surface is known of if a sample falls into it: of fewer samples for each than this, many are not.
const SAMPLES_PER_VOXEL: f64 = 4.0;

/// What is odd about a prediction, a sentence each.
pub(crate) fn doubts(
    scanner: &Scanner<'_>,
    site: &Site,
    surface: Option<&ObservableSurface>,
    prediction: &Prediction,
) -> Vec<String> {
    let mut doubts = without_returns(scanner, &prediction.returns);
    doubts.extend(
        surface.zip(site.loaded.scene.mesh()).and_then(|(surface, mesh)| {
            few_samples(surface.samples.len(), mesh.area_m2(), site.grid.voxel_m)
        }),
    );
    if scanner.sensor_errors.range_noise_m > 0.0 {
        doubts.push(
            "--range-noise throws returns into voxels next to the surface, and these count as seen, and as voxels that can \
             be seen: both numbers are greater than without noise"
                .into(),
        );
    }
    doubts
}

/// Sensors without a return, and why most likely.
fn without_returns(scanner: &Scanner<'_>, returns: &[u64]) -> Vec<String> {
    let silent = scanner.rig.sensors.iter().zip(returns).filter(|(_, returns)| **returns == 0);
    silent
        .map(|(sensor, _)| {
            format!(
                "{}: not one ray came back: is its mount in metres, is it inside the operator or another housing, and does the \
                 scene lie within its range?",
                sensor.name
            )
        })
        .collect()
}

/// Says so where surface samples are too few to count the voxels that can be seen.
fn few_samples(samples: usize, area_m2: f64, voxel_m: f64) -> Option<String> {
    let needed = SAMPLES_PER_VOXEL * area_m2 / (voxel_m * voxel_m);
    ((samples as f64) < needed).then(|| {
        format!(
            "{samples} samples on {area_m2:.0} m2 are too few for voxels of {voxel_m} m: more can be seen than are counted \
             as such; --sample-count {:.0} would do",
            needed.ceil()
        )
    })
}
