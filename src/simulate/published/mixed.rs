//! Rigs with sensors of several types: each sensor is seen by the simulator of its type, and the voxels of all are one
//! coverage. All types share grid and walk, so that nothing is converted.

use super::shell::Shell;
use super::{Covered, ExperimentError, PublishedBox, fast};
use crate::base::instructions::Instructions;
use crate::rig::MountDeg;
use crate::world::coverage::Coverage;

impl PublishedBox {
    /// The simulator of a mount's beams. The mount must have been checked.
    pub(super) fn of(&self, sensor: &MountDeg) -> &Self {
        match sensor.sensor_type {
            0 => self,
            index => &self.more_types[index - 1],
        }
    }

    /// What each sensor sees by the fast method, in their order. Pairs stay together: both are of one type.
    pub(super) fn shells(&self, sensors: &[MountDeg], instructions: Instructions) -> Vec<Shell> {
        let see = |alike: &[MountDeg]| {
            let simulator = self.of(&alike[0]);
            // walk and grid decide whether there is a plan: all types have one, or none has
            let plan = simulator.plan.iter();
            plan.flat_map(|plan| fast::see(simulator, plan, alike, instructions)).collect::<Vec<_>>()
        };
        runs(sensors).flat_map(see).collect()
    }

    /// What sensors see, run by run of sensors of one type.
    pub(super) fn join(
        &self,
        sensors: &[MountDeg],
        see: impl Fn(&Self, &[MountDeg]) -> Result<Covered, ExperimentError>,
    ) -> Result<Covered, ExperimentError> {
        if self.more_types.is_empty() {
            return see(self, sensors);
        }
        let (mut bitmaps, mut lost_rays) = (Vec::new(), Vec::new());
        for alike in runs(sensors) {
            let seen = see(self.of(&alike[0]), alike)?;
            bitmaps.extend((0..alike.len()).map(|sensor| seen.coverage.sensor_bitmap(sensor).into_owned()));
            lost_rays.extend(seen.lost_rays);
        }
        Ok(Covered { coverage: Coverage::from_bitmaps(self.grid(), bitmaps), lost_rays })
    }
}

/// Neighbours of one type.
fn runs(sensors: &[MountDeg]) -> impl Iterator<Item = &[MountDeg]> {
    sensors.chunk_by(|a, b| a.sensor_type == b.sensor_type)
}
