//! The points of a revolution as bytes, each field in a row of its own. All numbers are little-endian:
//!
//! ```text
//! 0  u32  points                     4  u32  sensor, from 0
//! 8  u32  revolution, from 0         12 u32  points without a pose (left out)
//! 16 u64  device time of the first column, ns
//! 24 u64  host arrival of the first packet, ns
//! 32 u32  columns                    36 u32  channels
//! 40 then, each for all points: f32 x, y, z (m); u32 range (mm); u32 time since the first column (ns);
//!    u16 column, u16 ring, u16 intensity, u16 near infrared; u8 reflectivity, u8 return number (1 or 2)
//! ```

use std::collections::HashMap;
use std::sync::Arc;

use glam::DVec3;
use sensors::router::Sensor;
use sensors::{Frame, SensorModel};

use crate::base::geometry::Pose;
use crate::recording::export::{Cloud, Point, Source, place};
use crate::world::trajectory::Trajectory;

/// Where a sensor sits, and where the rig was.
#[derive(Clone, Default)]
pub(crate) struct Placement {
    pub body_from_sensor: Option<Pose>,
    pub world: Option<Arc<World>>,
}

/// A trajectory, and the whole metres that are subtracted from its positions so that 32 bits hold them.
pub(crate) struct World {
    pub trajectory: Trajectory,
    pub origin_m: DVec3,
}

impl Placement {
    pub(crate) fn body_from_sensor_rows(&self) -> Option<[[f64; 4]; 3]> {
        let pose = self.body_from_sensor?;
        let columns = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| pose.rotation * axis);
        let shift = pose.translation_m;
        Some([0, 1, 2].map(|row| [columns[0][row], columns[1][row], columns[2][row], shift[row]]))
    }
}

/// Packs the revolutions of a recording's sensors.
#[derive(Default)]
pub(super) struct Packer {
    clouds: HashMap<usize, Cloud>,
}

impl Packer {
    /// Points in the sensor's frame, or in the world where a placement is given.
    pub(super) fn pack(
        &mut self,
        sensor: &Sensor,
        model: &SensorModel,
        frame: &Frame,
        at: usize,
        number: usize,
        placement: Option<&Placement>,
    ) -> Vec<u8> {
        let cloud = self
            .clouds
            .entry(at)
            .or_insert_with(|| Cloud::new(Arc::new(Source::of(sensor, String::new(), at)), model));
        cloud.fill(model, frame);
        let all = cloud.points.len();
        if let Some(placement) = placement {
            into_world(cloud, placement);
        }
        let points = &cloud.points;
        let mut bytes = Vec::with_capacity(40 + 30 * points.len());
        for value in [points.len() as u32, at as u32, number as u32, (all - points.len()) as u32] {
            bytes.extend_from_slice(&value.to_le_bytes());
        }
        bytes.extend_from_slice(&cloud.start_time_ns.to_le_bytes());
        bytes.extend_from_slice(&cloud.host_time_ns.to_le_bytes());
        bytes.extend_from_slice(&(frame.columns() as u32).to_le_bytes());
        bytes.extend_from_slice(&(frame.channels as u32).to_le_bytes());
        for point in points {
            point
                .position_m
                .as_vec3()
                .to_array()
                .iter()
                .for_each(|value| bytes.extend_from_slice(&value.to_le_bytes()));
        }
        points.iter().for_each(|point| bytes.extend_from_slice(&point.range_mm.to_le_bytes()));
        points.iter().for_each(|point| bytes.extend_from_slice(&cloud.since_start_ns(point).to_le_bytes()));
        let mut words = |value: &dyn Fn(&Point) -> u16| {
            points.iter().for_each(|point| bytes.extend_from_slice(&value(point).to_le_bytes()));
        };
        words(&|point| point.column as u16);
        words(&|point| point.ring);
        words(&|point| point.intensity.clamp(0.0, 65535.0) as u16);
        words(&|point| point.near_ir.unwrap_or(0));
        bytes.extend(points.iter().map(|point| point.reflectivity));
        bytes.extend(points.iter().map(|point| point.return_number));
        bytes
    }
}

/// Moves points into the world; those without a pose are left out.
fn into_world(cloud: &mut Cloud, placement: &Placement) {
    let Some(world) = &placement.world else { return cloud.points.clear() };
    let body_from_sensor = placement.body_from_sensor.unwrap_or(Pose::IDENTITY);
    let [first_ns, last_ns] = world.trajectory.time_span_ns();
    // a sensor that counts from power-on is dated by the host
    let is_dated = (first_ns..=last_ns).contains(&cloud.start_time_ns);
    let shift_ns = if is_dated { 0 } else { cloud.host_time_ns.wrapping_sub(cloud.start_time_ns) };
    let pose = |time_ns: u64| world.trajectory.at(time_ns.wrapping_add(shift_ns));
    place(&mut cloud.points, |time_ns| Some(pose(time_ns)? * body_from_sensor));
    cloud.points.iter_mut().for_each(|point| point.position_m -= world.origin_m);
}
