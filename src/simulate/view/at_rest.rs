//! Some beams of a rig that stands still, and places along the trajectory: enough for what a few beams tell.

use glam::{DMat3, DVec3};

use super::{CastView, Shades};
use crate::rig::{MountedSensor, Rig};
use crate::simulate::occluder::Occluder;

/// A beam in the frame of the body.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BeamAtRest {
    pub origin_m: DVec3,
    pub direction: DVec3,
    /// Distances from its origin at which it returns: from the least range to the maximum, or to where the rig or its operator
    /// blocks it.
    pub returns_m: (f64, f64),
}

impl CastView {
    /// Beams of all sensors of a rig: of each so many columns and rows at most, evenly chosen, column by column.
    pub(crate) fn beams_at_rest(&self, rig: &Rig, [columns, rows]: [usize; 2]) -> Vec<BeamAtRest> {
        let Shades { has_housings, operator } = self.site().shades;
        let of_sensor = |(number, sensor): (usize, &MountedSensor)| {
            let (fan, _) = self.fan_of(&sensor.model);
            let housings = if has_housings { Occluder::other_housings(rig, number) } else { Vec::new() };
            let occluders: Vec<Occluder> = operator.iter().copied().chain(housings).collect();
            let (body_from_lidar, origin_m) = fan.body_from_lidar(&sensor.mount);
            let beam = move |column: usize, row: usize| {
                let axes = fan.axes_of_column(&body_from_lidar, column);
                let beam = fan.beam(column, row);
                let (from_m, direction) = (origin_m + axes * beam.origin_m, axes * beam.direction);
                let blocked = occluders.iter().filter_map(|occluder| occluder.distance_m(from_m, direction));
                let most_m = blocked.fold(fan.max_range_m - beam.range_offset_m, f64::min);
                let returns_m = (fan.min_range_m - beam.range_offset_m, most_m);
                BeamAtRest { origin_m: from_m, direction, returns_m }
            };
            let rows = evenly(fan.beams.len(), rows);
            evenly(fan.columns, columns)
                .into_iter()
                .flat_map(|column| rows.iter().map(|row| beam(column, *row)).collect::<Vec<_>>())
                .collect::<Vec<_>>()
        };
        rig.sensors.iter().enumerate().flat_map(of_sensor).collect()
    }

    /// World from body in the middle of so many revolutions of the first unit at most, evenly spread: axes, and origin, m.
    pub(crate) fn places(&self, most: usize) -> Vec<(DMat3, DVec3)> {
        let scans = self.scans();
        let chosen = evenly(scans.count as usize, most).into_iter();
        chosen.map(|scan| scans.middle(&self.site().trajectory, scan as u64)).collect()
    }
}

/// So many of `count` numbers at most, evenly spread.
fn evenly(count: usize, most: usize) -> Vec<usize> {
    let chosen = most.min(count);
    (0..chosen).map(|at| (2 * at + 1) * count / (2 * chosen)).collect()
}
