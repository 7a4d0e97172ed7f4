//! What is made of a decoded revolution: points for pages, coverage, messages for Foxglove clients.

use std::sync::Arc;

use glam::DVec3;
use sensors::projection::{Projector, sample_azimuth_rad};
use sensors::router::Sensor;
use sensors::{Frame, SensorModel};

use super::picture;
use super::surroundings::Surroundings;
use super::survey::RAYS;
use crate::base::geometry::Pose;
use crate::recording::export::{Cloud, Source, foxglove};

/// Points drawn of one revolution.
const POINTS: usize = 6000;
/// Points of one revolution in a Foxglove message: 2 MB.
const MAX_POINTS: usize = 1 << 16;

/// Points of a frame for the page, and all of them for coverage.
pub(super) struct Painter {
    sensor: usize,
    axis: Option<usize>,
    around: Surroundings,
    projector: Option<Projector>,
    frames: u64,
    points_m: Vec<[f64; 3]>,
    placed_m: Vec<DVec3>,
    /// Sensor and point of those that are mapped.
    rays_m: Vec<[DVec3; 2]>,
    /// For Foxglove clients, while there are any.
    cloud: Option<Cloud>,
}

impl Painter {
    /// Of a sensor by number and name.
    pub(crate) fn new(sensor: usize, name: &str, around: Surroundings) -> Self {
        let axis = around.site.mounted(name).map(|(axis, _)| axis);
        Self {
            sensor,
            axis,
            around,
            projector: None,
            frames: 0,
            points_m: Vec::new(),
            placed_m: Vec::new(),
            rays_m: Vec::new(),
            cloud: None,
        }
    }

    /// Takes a whole revolution.
    pub(crate) fn draw(&mut self, sensor: &Sensor, model: &SensorModel, frame: &Frame) {
        self.frames += 1;
        let Surroundings { site, motion, .. } = &self.around;
        let mount = self.axis.and_then(|axis| Some((axis, site.rig.sensors.get(axis)?)));
        let body_from_sensor =
            mount.map_or(Pose::IDENTITY, |(axis, sensor)| motion.body_from_sensor(axis, &sensor.mount));
        if self.around.pages.receiver_count() > 0 {
            self.paint(model, frame, &body_from_sensor);
        }
        self.cover(model, frame, &body_from_sensor);
        self.pour(sensor, model, frame);
    }

    /// Points as `decode` exports them, in the sensor frame, for those who asked for them.
    fn pour(&mut self, sensor: &Sensor, model: &SensorModel, frame: &Frame) {
        let hub = &self.around.hub;
        if !hub.is_wanted(self.sensor) {
            self.cloud = None;
            return;
        }
        let source = || Source {
            id: hub.name(self.sensor).to_owned(),
            number: self.sensor as u16,
            vendor: sensor.vendor().into(),
            model: sensor.product(),
            serial: sensor.serial().into(),
            timestamp_mode: sensor.timestamp_mode(),
        };
        let cloud = self.cloud.get_or_insert_with(|| Cloud::new(Arc::new(source()), model));
        cloud.fill(model, frame);
        // others each time, as on the page
        let stride = cloud.points.len().div_ceil(MAX_POINTS);
        let mut at = self.frames as usize;
        cloud.points.retain(|_| {
            at += 1;
            at.is_multiple_of(stride)
        });
        if let Ok(message) = foxglove::points(cloud) {
            hub.put(self.sensor, frame.host_time_ns[1], message); // a date after 2106 has no message
        }
    }

    /// A few points of the frame, others each time.
    fn paint(&self, model: &SensorModel, frame: &Frame, body_from_sensor: &Pose) {
        let Surroundings { site, motion, pages, .. } = &self.around;
        let samples = frame.first.range_mm.len();
        // odd, so that it shares no factor with the number of channels
        let stride = samples.div_ceil(POINTS) | 1;
        let time_ns = frame.host_time_ns[1];
        let world_from_body =
            motion.world_from_body(site.trajectory.as_ref(), time_ns).unwrap_or(Pose::IDENTITY);
        let world_from_sensor = world_from_body * *body_from_sensor;
        let mut points_m = Vec::with_capacity(POINTS);
        for index in (self.frames as usize % stride..samples).step_by(stride) {
            let range_mm = frame.first.range_mm[index];
            if range_mm == 0 {
                continue;
            }
            let (column, channel) = (index / frame.channels, index % frame.channels);
            let azimuth_rad = sample_azimuth_rad(model, frame, column, channel);
            let in_sensor_m = model.point(channel, azimuth_rad, f64::from(range_mm) * 1e-3);
            let reflectivity = frame.first.reflectivity.get(index).copied().unwrap_or(128);
            let ring = channel.min(usize::from(u8::MAX)) as u8;
            points_m.push((world_from_sensor.transform_point(in_sensor_m), [reflectivity, ring]));
        }
        let message = picture::points(self.sensor, time_ns, world_from_body.translation_m, &points_m);
        let _ = pages.send(message.into()); // the last page may just have gone
    }

    /// Every point of the frame, each where the platform was when it was measured.
    fn cover(&mut self, model: &SensorModel, frame: &Frame, body_from_sensor: &Pose) {
        let Surroundings { site, motion, coverage, survey, .. } = &self.around;
        let projector = self.projector.get_or_insert_with(|| Projector::new(model));
        projector.follow(model);
        let Some([first_ns, _]) = frame.time_span_ns() else { return };
        let begun_ns = frame.host_time_ns[0];
        let mut without_pose = 0;
        self.placed_m.clear();
        self.rays_m.clear();
        let mut last_pose = None;
        let is_mapped = survey.is_open();
        let lidar_m = model.sensor_from_lidar().translation;
        let layers = 1 + usize::from(frame.second.is_some());
        // odd, so that it shares no factor with the number of channels; others each time
        let stride = (layers * frame.first.range_mm.len()).div_ceil(RAYS) | 1;
        let mut number = self.frames as usize;
        for layer in std::iter::once(&frame.first).chain(&frame.second) {
            projector.points_f64(frame, layer, &mut self.points_m);
            for column in (0..frame.columns()).filter(|column| frame.column_valid[*column]) {
                let samples = frame.index(column, 0)..frame.index(column + 1, 0);
                let hits = layer.range_mm[samples.clone()].iter().zip(&self.points_m[samples]);
                let hits = hits.filter(|(range_mm, _)| **range_mm > 0);
                let since_ns = frame.column_time_ns[column].saturating_sub(first_ns);
                match motion.world_from_body(site.trajectory.as_ref(), begun_ns + since_ns) {
                    Some(world_from_body) => {
                        let world_from_sensor = world_from_body * *body_from_sensor;
                        let origin_m = world_from_sensor.transform_point(lidar_m);
                        last_pose = Some(world_from_body);
                        for (_, point_m) in hits {
                            let point_m = world_from_sensor.transform_point(DVec3::from(*point_m));
                            self.placed_m.push(point_m);
                            number += 1;
                            if is_mapped && number.is_multiple_of(stride) {
                                self.rays_m.push([origin_m, point_m]);
                            }
                        }
                    }
                    None => without_pose += hits.count() as u64,
                }
            }
        }
        coverage.add(self.sensor, &self.placed_m, without_pose);
        if let Some(world_from_body) = last_pose {
            survey.add(&self.rays_m, &world_from_body);
        }
    }
}
