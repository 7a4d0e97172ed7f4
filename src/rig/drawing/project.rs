//! From the mount frame to the three planes of the drawing, in millimetres.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3};

use crate::base::geometry::BODY_FROM_MOUNT_FRAME;
use crate::rig::FramedSensor;
use crate::rig::frames::bottom_plane_m;

/// The direction of view.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Plane {
    /// From above: right and forward.
    Top,
    /// From behind, looking forward: right and up.
    Front,
    /// From the right: forward and up.
    Side,
}

impl Plane {
    /// A place or direction of the mount frame on the plane.
    pub(super) fn flat(self, point: DVec3) -> DVec2 {
        match self {
            Self::Top => DVec2::new(point.x, point.y),
            Self::Front => DVec2::new(point.x, point.z),
            Self::Side => DVec2::new(point.y, point.z),
        }
    }

    /// Toward whoever looks.
    pub(super) fn toward_viewer(self) -> DVec3 {
        match self {
            Self::Top => DVec3::Z,
            Self::Front => -DVec3::Y,
            Self::Side => DVec3::X,
        }
    }
}

/// A sensor in the mount frame, millimetres.
pub(super) struct Solid<'a> {
    pub sensor: &'a FramedSensor,
    /// The mount's position.
    pub origin: DVec3,
    /// Where the beams meet.
    pub optical: DVec3,
    /// Middle of the bottom plane, and of the top.
    pub bottom: DVec3,
    pub top: DVec3,
    /// The spin axis.
    pub axis: DVec3,
    /// The sensor's +x and its +y.
    pub forward: DVec3,
    pub left: DVec3,
    pub radius_mm: f64,
    pub height_mm: f64,
}

impl<'a> Solid<'a> {
    pub(super) fn of(sensor: &'a FramedSensor) -> Self {
        let mounted = &sensor.mounted;
        let model = &mounted.model;
        let rotation = mounted.mount.rotation();
        let in_sensor = |direction: DVec3| rotation * (BODY_FROM_MOUNT_FRAME.transpose() * direction);
        let origin = 1000.0 * mounted.mount.position_m();
        let axis = mounted.spin_axis();
        let middle_mm = 1000.0 * model.sensor_from_lidar().translation.z;
        let bottom_mm = 1000.0 * bottom_plane_m(model);
        let top_mm = middle_mm + 500.0 * model.housing_height_m;
        Self {
            sensor,
            origin,
            optical: 1000.0 * mounted.lidar_origin_m(),
            bottom: origin + bottom_mm * axis,
            top: origin + top_mm * axis,
            axis,
            forward: in_sensor(DVec3::X),
            left: in_sensor(DVec3::Y),
            radius_mm: 1000.0 * model.housing_radius_m,
            height_mm: top_mm - bottom_mm,
        }
    }

    /// A rim of the housing on a plane: a circle seen from the side is a line, drawn as a flat ellipse.
    pub(super) fn rim(&self, plane: Plane, middle: DVec3) -> Vec<DVec2> {
        let point = |step: usize| {
            let angle = TAU * step as f64 / 72.0;
            plane.flat(middle + self.radius_mm * (angle.cos() * self.forward + angle.sin() * self.left))
        };
        (0..72).map(point).collect()
    }

    /// The two lines between the rims that bound the housing on a plane; none where one looks along its axis.
    pub(super) fn sides(&self, plane: Plane) -> Option<[[DVec2; 2]; 2]> {
        let across = self.axis.cross(plane.toward_viewer());
        let across = (across.length() > 1e-6).then(|| across.normalize() * self.radius_mm)?;
        Some([1.0, -1.0].map(|side| {
            [self.bottom + side * across, self.top + side * across].map(|point| plane.flat(point))
        }))
    }

    /// Corners of a box around the housing.
    pub(super) fn reach(&self) -> [DVec3; 2] {
        let slack = DVec3::splat(self.radius_mm);
        [self.bottom.min(self.top) - slack, self.bottom.max(self.top) + slack]
    }

    /// Lowest and highest beam, rad.
    pub(super) fn elevations_rad(&self) -> [f64; 2] {
        let beams = self.sensor.mounted.model.beams().iter().map(|beam| beam.elevation_rad);
        beams.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], angle| [low.min(angle), high.max(angle)])
    }
}
