//! Recorded frames laid against the scene, ray by ray.

use rayon::prelude::*;
use sensors::Frame;
use sensors::projection::sample_azimuth_rad;
use serde::Serialize;

use crate::coverage::{Coverage, VoxelGrid};
use crate::rig::MountedSensor;
use crate::scene::Scene;
use crate::trajectory::Trajectory;

/// A recorded and a predicted range agree within this, m. Source: the gate max(3 sigma, 0.10 m) for a range sd of at
/// most 3 cm.
const AGREE_WITHIN_M: f64 = 0.10;

/// What became of one sensor's rays.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct RayClasses {
    /// Recorded where predicted.
    pub agree: u64,
    /// Recorded nearer: something stood in the way.
    pub short: u64,
    /// Recorded farther: glass, an opened door, a wrong scene.
    pub long: u64,
    /// Predicted, nothing recorded.
    pub drop: u64,
    /// Recorded, nothing predicted.
    pub extra: u64,
    /// Neither predicted nor recorded.
    pub nothing: u64,
    /// Taken outside the trajectory's time: cannot be placed.
    pub unplaced: u64,
}

impl RayClasses {
    /// Rays for which the scene or the sensor reported a surface.
    pub fn informative(&self) -> u64 {
        self.agree + self.short + self.long + self.drop + self.extra
    }

    fn plus(mut self, other: Self) -> Self {
        self.agree += other.agree;
        self.short += other.short;
        self.long += other.long;
        self.drop += other.drop;
        self.extra += other.extra;
        self.nothing += other.nothing;
        self.unplaced += other.unplaced;
        self
    }
}

/// Recorded frames go in, the coverage as driven and as recorded comes out.
pub struct Replay<'a> {
    scene: &'a Scene,
    trajectory: &'a Trajectory,
    sensors: Vec<MountedSensor>,
    /// What the scene promises for the rays that were recorded.
    pub as_driven: Coverage,
    /// What the packets say.
    pub recorded: Coverage,
    /// Per sensor.
    pub rays: Vec<RayClasses>,
}

/// One ray laid against the scene: where it should and where it did end.
struct Outcome {
    predicted_m: Option<glam::DVec3>,
    recorded_m: Option<glam::DVec3>,
    classes: RayClasses,
}

impl<'a> Replay<'a> {
    /// Nothing replayed yet.
    pub fn new(
        scene: &'a Scene,
        trajectory: &'a Trajectory,
        sensors: Vec<MountedSensor>,
        grid: &VoxelGrid,
    ) -> Self {
        let count = sensors.len();
        Self {
            scene,
            trajectory,
            sensors,
            as_driven: Coverage::new(grid.clone(), count),
            recorded: Coverage::new(grid.clone(), count),
            rays: vec![RayClasses::default(); count],
        }
    }

    /// Says how far a sensor is tilted from the next frame on: the angle its axis measured.
    pub fn set_pitch(&mut self, sensor: usize, pitch_rad: f64) {
        self.sensors[sensor].mount.pitch_rad = pitch_rad;
    }

    /// Lays one frame of a sensor against the scene. Columns that never came are neither predicted nor recorded: their
    /// loss is the receiver's to report.
    pub fn add_frame(&mut self, sensor: usize, frame: &Frame) {
        let placed = &self.sensors[sensor];
        let (scene, trajectory) = (self.scene, self.trajectory);
        let outcomes: Vec<Outcome> = (0..frame.columns())
            .into_par_iter()
            .filter(|column| frame.column_valid[*column])
            .flat_map_iter(|column| {
                let channels = frame.channels.min(placed.model.channels());
                (0..channels).map(move |channel| lay(scene, trajectory, placed, frame, column, channel))
            })
            .collect();
        for outcome in outcomes {
            if let Some(point) = outcome.predicted_m {
                self.as_driven.add(sensor, point);
            }
            if let Some(point) = outcome.recorded_m {
                self.recorded.add(sensor, point);
            }
            self.rays[sensor] = self.rays[sensor].plus(outcome.classes);
        }
    }
}

fn lay(
    scene: &Scene,
    trajectory: &Trajectory,
    placed: &MountedSensor,
    frame: &Frame,
    column: usize,
    channel: usize,
) -> Outcome {
    let mut classes = RayClasses::default();
    let model = &placed.model;
    let fire_offset_ns = model.beams()[channel].fire_offset_ns;
    let time_ns = frame.column_time_ns[column] + fire_offset_ns.round() as u64;
    let Some(world_from_body) = trajectory.at(time_ns) else {
        classes.unplaced = 1;
        return Outcome { predicted_m: None, recorded_m: None, classes };
    };
    let azimuth_rad = sample_azimuth_rad(model, frame, column, channel);
    let ray = model.ray(channel, azimuth_rad);
    let world_from_sensor = world_from_body * placed.mount.body_from_sensor();
    let origin_m = world_from_sensor.transform_point(ray.origin_m);
    let direction = world_from_sensor.rotate(ray.direction);
    let predicted_range_m = scene
        .cast(origin_m, direction)
        .map(|hit| hit.distance_m + ray.range_offset_m)
        .filter(|range_m| (model.min_range_m..=model.max_range_m).contains(range_m));
    let raw_mm = frame.first.range_mm[frame.index(column, channel)];
    let recorded_range_m = (raw_mm > 0).then(|| f64::from(raw_mm) * 1e-3);
    match (predicted_range_m, recorded_range_m) {
        (None, None) => classes.nothing = 1,
        (Some(_), None) => classes.drop = 1,
        (None, Some(_)) => classes.extra = 1,
        (Some(predicted), Some(recorded)) if (recorded - predicted).abs() <= AGREE_WITHIN_M => {
            classes.agree = 1
        }
        (Some(predicted), Some(recorded)) if recorded < predicted => classes.short = 1,
        (Some(_), Some(_)) => classes.long = 1,
    }
    let predicted = |range_m: f64| origin_m + (range_m - ray.range_offset_m) * direction;
    // a calibrated HDL-64E does not place near points on a straight ray
    let recorded =
        |range_m: f64| world_from_sensor.transform_point(model.point(channel, azimuth_rad, range_m));
    Outcome {
        predicted_m: predicted_range_m.map(predicted),
        recorded_m: recorded_range_m.map(recorded),
        classes,
    }
}
