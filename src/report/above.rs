//! A scene seen from above, in layers of height: points of classes counted in square columns.

use glam::DVec3;

use crate::report::chart::{CellMap, Plan, PlanAxis, number};
use crate::rig::{MountedSensor, Rig};
use crate::world::local_origin::LocalOrigin;
use crate::world::trajectory::Trajectory;

/// Most columns along the longer side of a map.
const MAX_COLUMNS: f64 = 160.0;
/// Scenes higher than this, m, are shown in layers.
const LAYERED_M: f64 = 1.5;
/// Positions of a path on a plan.
const MAX_POSES: usize = 500;
/// Shares of the height up to which the lower layers reach.
const LAYERS: [f64; 2] = [0.1, 0.9];

/// Counts of points by class, column and layer.
#[derive(Clone, Debug)]
pub struct FromAbove {
    low_m: DVec3,
    column_m: f64,
    /// Columns along x and y.
    size: [usize; 2],
    /// Upper ends of all layers, m.
    tops_m: Vec<f64>,
    /// The local frame in that of the files, m: places are reported in the latter.
    base_m: DVec3,
    /// Where the rig went, and where its sensors are when it begins, in the local frame.
    track_m: Vec<DVec3>,
    sensors: Vec<(String, DVec3)>,
    classes: usize,
    counts: Vec<u32>,
}

impl FromAbove {
    /// The same, of points in the local frame that begins at `origin`.
    pub(crate) fn around(mut self, origin: LocalOrigin) -> Self {
        self.base_m = origin.world_m();
        self
    }

    /// With the path of a rig on it.
    pub(crate) fn with_rig(mut self, trajectory: &Trajectory, rig: &Rig) -> Self {
        (self.track_m, self.sensors) = on_plans(trajectory, rig);
        self
    }

    /// Nothing counted yet, for points within these bounds. Columns are at least `column_m` wide.
    pub(crate) fn new(bounds_m: [DVec3; 2], column_m: f64, classes: usize) -> Self {
        let [low_m, high_m] = bounds_m;
        let extent_m = high_m - low_m;
        let column_m = column_m.max(extent_m.x.max(extent_m.y) / MAX_COLUMNS);
        let size = [extent_m.x, extent_m.y].map(|side_m| (side_m / column_m).ceil().max(1.0) as usize);
        let mut tops_m = Vec::new();
        if extent_m.z > LAYERED_M {
            tops_m.extend(LAYERS.map(|share| low_m.z + share * extent_m.z));
        }
        tops_m.push(high_m.z);
        let counts = vec![0; tops_m.len() * size[0] * size[1] * classes];
        Self {
            low_m,
            column_m,
            size,
            tops_m,
            base_m: DVec3::ZERO,
            track_m: Vec::new(),
            sensors: Vec::new(),
            classes,
            counts,
        }
    }

    /// Counts a point.
    pub(crate) fn add(&mut self, point_m: DVec3, class: usize) {
        let at = (point_m - self.low_m) / self.column_m;
        let within = |value: f64, count: usize| (value.max(0.0) as usize).min(count - 1);
        let (i, j) = (within(at.x, self.size[0]), within(at.y, self.size[1]));
        let layer = self.tops_m.iter().position(|top_m| point_m.z < *top_m).unwrap_or(self.tops_m.len() - 1);
        self.counts[((layer * self.size[0] + i) * self.size[1] + j) * self.classes + class] += 1;
    }

    /// Of each layer the class that most points of each column have; of equals the last, which is the worse.
    pub(crate) fn majority(&self) -> Vec<CellMap> {
        self.maps(&|counts| (0..self.classes).max_by_key(|class| counts[*class]))
    }

    /// Of each layer the share of a class in each column, in `steps` steps of equal width.
    pub(crate) fn share(&self, class: usize, steps: usize) -> Vec<CellMap> {
        self.maps(&|counts| {
            let share = f64::from(counts[class]) / f64::from(counts.iter().sum::<u32>());
            Some(((share * steps as f64) as usize).min(steps - 1))
        })
    }

    fn plan(&self) -> Plan {
        let corner_m = self.base_m + self.low_m;
        let left_m = corner_m.y + self.size[1] as f64 * self.column_m;
        let on_page = |place_m: DVec3| [self.base_m.y + place_m.y, self.base_m.x + place_m.x];
        Plan {
            across: PlanAxis { name: "y", first_m: left_m, step_m: -self.column_m },
            up: PlanAxis { name: "x", first_m: corner_m.x, step_m: self.column_m },
            track_m: self.track_m.iter().map(|place_m| on_page(*place_m)).collect(),
            sensors: self.sensors.iter().map(|(name, place_m)| (name.clone(), on_page(*place_m))).collect(),
        }
    }

    /// World x up the page, y to the left; columns without points stay blank.
    fn maps(&self, cell: &dyn Fn(&[u32]) -> Option<usize>) -> Vec<CellMap> {
        let [nx, ny] = self.size;
        let layer = |(layer, top_m): (usize, &f64)| {
            let bottom_m = if layer == 0 { self.low_m.z } else { self.tops_m[layer - 1] };
            let column = |i: usize, j: usize| {
                let first = ((layer * nx + i) * ny + j) * self.classes;
                &self.counts[first..first + self.classes]
            };
            let of_place = |place: usize| {
                let counts = column(place / ny, ny - 1 - place % ny);
                if counts.iter().all(|count| *count == 0) { None } else { cell(counts) }
            };
            CellMap {
                title: format!(
                    "from {} to {} m high",
                    number(self.base_m.z + bottom_m, 2),
                    number(self.base_m.z + *top_m, 2)
                ),
                width: ny,
                cells: (0..nx * ny).map(of_place).collect(),
                plan: Some(self.plan()),
            }
        };
        self.tops_m.iter().enumerate().map(layer).collect()
    }
}

/// The path of a rig thinned to what a plan shows, and where its sensors are when it begins.
pub(super) fn on_plans(trajectory: &Trajectory, rig: &Rig) -> (Vec<DVec3>, Vec<(String, DVec3)>) {
    let step = trajectory.stamped().count().div_ceil(MAX_POSES).max(1);
    let track_m = trajectory.stamped().step_by(step).map(|(_, pose)| pose.translation_m).collect();
    let start = trajectory.at_offset_ns(0.0);
    let sensor = |sensor: &MountedSensor| {
        (sensor.name.clone(), (start * sensor.mount.body_from_sensor()).translation_m)
    };
    (track_m, rig.sensors.iter().map(sensor).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ahead_is_up_and_left_is_left_and_layers_part() {
        let bounds = [DVec3::new(0.0, 0.0, 0.0), DVec3::new(4.0, 2.0, 3.0)];
        let mut above = FromAbove::new(bounds, 1.0, 3);
        for class in [0, 2, 2] {
            above.add(DVec3::new(3.5, 1.9, 0.1), class);
        }
        above.add(DVec3::new(0.5, 0.5, 3.0), 1);
        let maps = above.majority();
        assert_eq!(maps.len(), 3);
        // the last row is the top of the page
        assert_eq!(maps[0].cells.iter().position(Option::is_some), Some(3 * 2));
        assert_eq!(maps[0].cells[6], Some(2));
        assert!(maps[1].cells.iter().all(Option::is_none));
        assert_eq!(maps[2].cells[1], Some(1));
        assert_eq!(above.share(2, 4)[0].cells[6], Some(2));
        assert_eq!(
            FromAbove::new([DVec3::ZERO, DVec3::ONE], 0.1, 1).majority().len(),
            1,
            "flat scenes have one"
        );
    }
}
