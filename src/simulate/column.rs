//! One column of a sensor: its beams, and what they meet.

use std::f64::consts::TAU;

use glam::DVec3;
use sensors::SensorModel;

use crate::base::geometry::Pose;
use crate::world::scene::{Hit, Scene};

/// Casts columns of one sensor model, all beams of a column together.
pub struct ColumnCaster<'a> {
    model: &'a SensorModel,
    /// Channels from the lowest beam to the highest.
    order: Vec<usize>,
}

impl<'a> ColumnCaster<'a> {
    /// For a model.
    pub(crate) fn new(model: &'a SensorModel) -> Self {
        Self { model, order: by_elevation(model) }
    }

    /// Ranges of one column as the sensor reports them, m, by channel; none where nothing is hit within the model's
    /// limits. `azimuth_rad` is the encoder's at the column's time stamp, `spin_rad_s` moves it on for channels that
    /// fire later.
    pub(crate) fn cast(
        &self,
        scene: &Scene,
        world_from_sensor: Pose,
        azimuth_rad: f64,
        spin_rad_s: f64,
    ) -> Vec<Option<f64>> {
        let model = self.model;
        let beams: Vec<FiredBeam> = self
            .order
            .iter()
            .map(|channel| beam_at(model, *channel, azimuth_rad, spin_rad_s, &world_from_sensor))
            .collect();
        let origins_m: Vec<DVec3> = beams.iter().map(|beam| beam.origin_m).collect();
        let directions: Vec<DVec3> = beams.iter().map(|beam| beam.direction).collect();
        let mut ranges_m = vec![None; model.channels()];
        scene.cast_many(&origins_m, &directions, |ray, hit| {
            ranges_m[self.order[ray]] = hit
                .map(|hit| hit.distance_m + beams[ray].range_offset_m)
                .filter(|range_m| *range_m >= model.min_range_m && *range_m <= model.max_range_m);
        });
        ranges_m
    }
}

/// Channels from the lowest beam to the highest: neighbours in this order see neighbouring surfaces, which is what makes
/// casting them together fast.
pub(super) fn by_elevation(model: &SensorModel) -> Vec<usize> {
    let mut order: Vec<usize> = (0..model.channels()).collect();
    order.sort_by(|a, b| model.beams()[*a].elevation_rad.total_cmp(&model.beams()[*b].elevation_rad));
    order
}

/// Rays around a beam's central one, at half the half-angle of its cone.
pub(super) fn ring(direction: DVec3, divergence_rad: f64, rays: u32) -> impl Iterator<Item = DVec3> {
    let spread = if rays > 0 { (0.25 * divergence_rad).tan() } else { 0.0 };
    let (u, v) = direction.any_orthonormal_pair();
    (0..rays).map(move |index| {
        let (sin, cos) = (TAU * f64::from(index) / f64::from(rays)).sin_cos();
        (direction + spread * (cos * u + sin * v)).normalize()
    })
}

/// What a beam reports of what its rays met: the hit of median distance; nothing if half of the light or more is lost.
pub(super) fn median(met: &[Option<Hit>]) -> Option<Hit> {
    if let [only] = met {
        return *only; // nothing to sort, and by far the most frequent
    }
    let mut hits: Vec<_> = met.iter().flatten().collect();
    if hits.len() * 2 < met.len() {
        return None;
    }
    hits.sort_by(|a, b| a.distance_m.total_cmp(&b.distance_m));
    hits.get(hits.len() / 2).map(|hit| **hit)
}

/// A channel's ray where the sensor frame was placed.
#[derive(Clone, Copy)]
pub(super) struct FiredBeam {
    pub origin_m: DVec3,
    pub direction: DVec3,
    pub range_offset_m: f64,
    pub azimuth_rad: f64,
}

pub(super) fn beam_at(
    model: &SensorModel,
    channel: usize,
    column_azimuth_rad: f64,
    spin_rad_s: f64,
    target_from_sensor: &Pose,
) -> FiredBeam {
    let azimuth_rad = column_azimuth_rad + spin_rad_s * model.beams()[channel].fire_offset_ns * 1e-9;
    let ray = model.ray(channel, azimuth_rad);
    FiredBeam {
        origin_m: target_from_sensor.transform_point(ray.origin_m),
        direction: target_from_sensor.rotate(ray.direction),
        range_offset_m: ray.range_offset_m,
        azimuth_rad,
    }
}
