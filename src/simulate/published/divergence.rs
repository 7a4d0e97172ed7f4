//! The published re-score: every ray thrown off by noise on its direction, cast by the definition.

use super::{Placement, Seen, Simulator, brute};
use crate::coverage::Coverage;
use crate::rng::Rng;

/// Standard deviation of the published re-score, on each component of a unit direction: 0.09 degrees in radians.
pub const PUBLISHED_DIVERGENCE_RAD: f64 = 0.09 * std::f64::consts::PI / 180.0;

impl Simulator {
    /// Which voxels each sensor sees when a normal number of this deviation is added to each component of every direction,
    /// which is then brought back to length one. A noisy direction has no component that is exactly zero: no ray is lost.
    ///
    /// # Errors
    /// Those of [`Simulator::see`].
    pub fn see_diverged(
        &self,
        sensors: &[Placement],
        deviation_rad: f64,
        seed: u64,
    ) -> Result<Seen, super::ExperimentError> {
        self.check(sensors)?;
        let one = |(index, sensor)| diverged(self, sensor, deviation_rad, &mut Rng::new(seed, index as u64));
        let (bitmaps, lost_rays) = sensors.iter().enumerate().map(one).unzip();
        Ok(Seen { coverage: Coverage::from_bitmaps(self.grid(), bitmaps), lost_rays })
    }
}

fn diverged(simulator: &Simulator, sensor: &Placement, deviation_rad: f64, rng: &mut Rng) -> (Vec<u64>, u64) {
    let mut bitmap = vec![0u64; simulator.cells.iter().product::<usize>().div_ceil(64)];
    let mut lost = 0;
    for (pose, station_m) in simulator.stations_m.iter().enumerate() {
        let origin_m = brute::origin_m(simulator, sensor, *station_m);
        for azimuth in 0..simulator.experiment.azimuths {
            let azimuth_rad = brute::azimuth_rad(simulator, pose, azimuth);
            for beam in 0..simulator.elevations.len() {
                let straight = brute::direction(simulator, sensor, azimuth_rad, beam);
                let off = straight.map(|component| component + deviation_rad * rng.normal());
                let length = off.iter().map(|component| component * component).sum::<f64>().sqrt();
                match brute::voxel(simulator, origin_m, off.map(|component| component / length)) {
                    Some(index) => bitmap[index / 64] |= 1 << (index % 64),
                    None => lost += 1,
                }
            }
        }
    }
    (bitmap, lost)
}
