//! Faults with a name: readings of the recording under which it would agree far better than as specified.

use rayon::prelude::*;

use super::{RayClass, RecordedRay, nulls::Field};
use crate::base::geometry::Pose;
use crate::recording::Fault;
use crate::rig::{Mount, MountedSensor};

/// So many rays are tried under each reading.
const RAYS: usize = 20_000;
/// A recording that agrees as well as this is not doubted.
const FINE: f64 = 0.85;
/// A better reading explains at least this share of the rays, and this much more than the given one.
const EXPLAINS: f64 = 0.6;
const BETTER_BY: f64 = 0.2;

/// Another reading of a recording.
struct Reading {
    fault: Fault,
    /// Which sensor's mount and model the rays of each sensor are cast from.
    slot: Vec<usize>,
    mirrored: Vec<bool>,
    turned: Vec<bool>,
    /// Size of the scene's unit, m.
    unit_m: f64,
}

/// The best other reading, if the given one is bad and another is good.
pub(crate) fn misread(field: &Field<'_>) -> Option<Fault> {
    let step = field.rays.len().div_ceil(RAYS).max(1);
    let rays: Vec<&RecordedRay> = field.rays.iter().step_by(step).collect();
    let given = agree_share(field, &rays, &Reading::given(field.sensors))?;
    if given >= FINE {
        return None;
    }
    let mut best: Option<(f64, Reading)> = None;
    for reading in readings(field.sensors) {
        let Some(share) = agree_share(field, &rays, &reading) else { continue };
        // the first of two that explain as much is the simpler one
        if best.as_ref().is_none_or(|(most, _)| share > most + 0.02) {
            best = Some((share, reading));
        }
    }
    let (share, reading) = best?;
    if share < EXPLAINS || share < given + BETTER_BY {
        return None;
    }
    Some(Fault { agree_share: Some(given), explained_share: Some(share), ..reading.fault })
}

impl Reading {
    fn given(sensors: &[MountedSensor]) -> Self {
        Self {
            fault: Fault::new("none", Vec::new(), String::new()),
            slot: (0..sensors.len()).collect(),
            mirrored: vec![false; sensors.len()],
            turned: vec![false; sensors.len()],
            unit_m: 1.0,
        }
    }

    fn named(sensors: &[MountedSensor], name: &'static str, of: &[usize], words: String) -> Self {
        let mut reading = Self::given(sensors);
        reading.fault.name = name;
        reading.fault.sensors = of.iter().map(|sensor| sensors[*sensor].name.clone()).collect();
        reading.fault.words = words;
        reading
    }
}

fn readings(sensors: &[MountedSensor]) -> Vec<Reading> {
    let mut readings = Vec::new();
    let all: Vec<usize> = (0..sensors.len()).collect();
    for (unit_m, unit) in [(1e-3, "millimetres"), (1e-2, "centimetres"), (0.3048, "feet")] {
        let words = format!("the mesh is in {unit}, not in metres");
        let mut reading = Reading::named(sensors, "mesh_unit", &[], words);
        reading.unit_m = unit_m;
        readings.push(reading);
    }
    for first in 0..sensors.len() {
        for second in first + 1..sensors.len() {
            if sensors[first].model.channels() != sensors[second].model.channels() {
                continue;
            }
            let words = format!(
                "{} and {} are swapped (of a capture the order of --meta says which is which)",
                sensors[first].name, sensors[second].name
            );
            let mut reading = Reading::named(sensors, "swapped_sensors", &[first, second], words);
            reading.slot.swap(first, second);
            readings.push(reading);
        }
    }
    let mut subsets: Vec<Vec<usize>> = all.iter().map(|sensor| vec![*sensor]).collect();
    if sensors.len() > 1 {
        subsets.push(all);
    }
    for of in &subsets {
        let names: Vec<&str> = of.iter().map(|sensor| sensors[*sensor].name.as_str()).collect();
        let names = names.join(" and ");
        let words = format!("{names}: turned by 180 degrees about the spin axis");
        let mut reading = Reading::named(sensors, "yaw_180", of, words);
        of.iter().for_each(|sensor| reading.turned[*sensor] = true);
        readings.push(reading);
        let words = format!("{names}: tilted in the opposite direction, the sign of the pitch is mirrored");
        let mut reading = Reading::named(sensors, "mirrored_sign", of, words);
        of.iter().for_each(|sensor| reading.mirrored[*sensor] = true);
        readings.push(reading);
    }
    readings
}

fn agree_share(field: &Field<'_>, rays: &[&RecordedRay], reading: &Reading) -> Option<f64> {
    let count = |ray: &&RecordedRay| -> [u64; 2] {
        match class(field, ray, reading) {
            RayClass::Nothing | RayClass::Unplaced => [0, 0],
            class => [u64::from(class == RayClass::Agree), 1],
        }
    };
    let [agree, all] = rays.par_iter().map(count).reduce(|| [0, 0], |a, b| [a[0] + b[0], a[1] + b[1]]);
    (all > 0).then(|| agree as f64 / all as f64)
}

fn class(field: &Field<'_>, ray: &RecordedRay, reading: &Reading) -> RayClass {
    let Some(world_from_body) = field.trajectory.at(ray.time_ns) else { return RayClass::Unplaced };
    let slot = &field.sensors[reading.slot[ray.sensor]];
    // a swapped sensor's own axis angle came with the other one
    let own = if reading.slot[ray.sensor] == ray.sensor { ray.pitch_rad } else { slot.mount.pitch_rad };
    let pitch_rad = if reading.mirrored[ray.sensor] { -own } else { own };
    let mut body_from_sensor = Mount { pitch_rad, ..slot.mount }.body_from_sensor();
    if reading.turned[ray.sensor] {
        let half = glam::DQuat::from_rotation_z(std::f64::consts::PI);
        body_from_sensor = body_from_sensor * Pose::new(half, glam::DVec3::ZERO);
    }
    let placed = ray.place(field.sensors, &(world_from_body * body_from_sensor));
    let model = &field.sensors[ray.sensor].model;
    let predicted_m = field
        .scene
        .cast(placed.origin_m / reading.unit_m, placed.direction)
        .map(|hit| hit.distance_m * reading.unit_m + placed.range_offset_m)
        .filter(|range_m| (model.min_range_m..=model.max_range_m).contains(range_m));
    RayClass::in_scene(field.scene, predicted_m, ray.range_m, field.agree_within_m, |range_m| {
        Some(placed.at_range(range_m) / reading.unit_m)
    })
}
