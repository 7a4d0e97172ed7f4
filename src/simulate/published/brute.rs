//! The definition, ray by ray: what every faster way is compared with.

use super::{Phase, Placement, Simulator};

/// Bitmap of one sensor and the number of rays that the quirk lost.
pub(super) fn see(simulator: &Simulator, sensor: &Placement) -> (Vec<u64>, u64) {
    let words = simulator.cells.iter().product::<usize>().div_ceil(64);
    let mut bitmap = vec![0u64; words];
    let mut lost = 0;
    let azimuths = simulator.experiment.azimuths;
    for (pose, station_m) in simulator.stations_m.iter().enumerate() {
        let origin_m = origin_m(simulator, sensor, *station_m);
        for azimuth in 0..azimuths {
            let azimuth_rad = azimuth_rad(simulator, pose, azimuth);
            for beam in 0..simulator.elevations.len() {
                let direction = direction(simulator, sensor, azimuth_rad, beam);
                match voxel(simulator, origin_m, direction) {
                    Some(index) => bitmap[index / 64] |= 1 << (index % 64),
                    None => lost += 1,
                }
            }
        }
    }
    (bitmap, lost)
}

/// Number of rays that the quirk loses along the whole walk.
pub(super) fn lost_rays(simulator: &Simulator, sensor: &Placement) -> u64 {
    let experiment = &simulator.experiment;
    if !experiment.preset.loses_axis_parallel_rays || experiment.phase != Phase::Locked {
        return 0;
    }
    let mut lost = 0;
    for azimuth in 0..experiment.azimuths {
        let azimuth_rad = azimuth_rad(simulator, 0, azimuth);
        for beam in 0..simulator.elevations.len() {
            lost += u64::from(direction(simulator, sensor, azimuth_rad, beam).contains(&0.0));
        }
    }
    lost * simulator.stations_m.len() as u64
}

/// Where the sensor is at a place of the walk, m.
pub(super) fn origin_m(simulator: &Simulator, sensor: &Placement, station_m: f64) -> [f64; 3] {
    let mut pose_m = [0.0, 0.0, simulator.experiment.preset.platform_height_m];
    pose_m[simulator.experiment.path.axis()] = station_m;
    [pose_m[0] + sensor.x_m, pose_m[1] + sensor.y_m, pose_m[2] + sensor.z_m]
}

/// Azimuth of a column at a pose, rad.
pub(super) fn azimuth_rad(simulator: &Simulator, pose: usize, azimuth: usize) -> f64 {
    /// Fractional part of the golden ratio: successive multiples fill an interval evenly (Weyl 1916).
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    let shift = match simulator.experiment.phase {
        Phase::Locked => 0.0,
        Phase::Free => ((pose + 1) as f64 * GOLDEN + simulator.experiment.phase_shift).fract(),
    };
    let azimuths = simulator.experiment.azimuths as f64;
    ((azimuth as f64 + shift) * 360.0 / azimuths).to_radians()
}

/// World direction of a beam.
pub(super) fn direction(
    simulator: &Simulator,
    sensor: &Placement,
    azimuth_rad: f64,
    beam: usize,
) -> [f64; 3] {
    let [sin_elevation, cos_elevation] = simulator.elevations[beam];
    let (sin_azimuth, cos_azimuth) = azimuth_rad.sin_cos();
    let local = [cos_elevation * cos_azimuth, cos_elevation * sin_azimuth, sin_elevation];
    sensor.rotation_rows().map(|row| row[0] * local[0] + row[1] * local[1] + row[2] * local[2])
}

/// Linear index of the voxel that a ray hits; none where the quirk loses the ray.
pub(super) fn voxel(simulator: &Simulator, origin_m: [f64; 3], direction: [f64; 3]) -> Option<usize> {
    let preset = &simulator.experiment.preset;
    let voxel_m = simulator.experiment.voxel_m;
    let mut exit_m = f64::INFINITY;
    for axis in 0..3 {
        if direction[axis] == 0.0 {
            if preset.loses_axis_parallel_rays && simulator.experiment.phase == Phase::Locked {
                return None;
            }
            continue;
        }
        let inverse = 1.0 / direction[axis].abs().max(1e-12) * direction[axis].signum();
        let near = (preset.box_min_m[axis] - origin_m[axis]) * inverse;
        let far = (preset.box_max_m[axis] - origin_m[axis]) * inverse;
        exit_m = exit_m.min(near.max(far));
    }
    let mut cell = [0; 3];
    for axis in 0..3 {
        let low_m = preset.box_min_m[axis] + 0.25 * voxel_m;
        let high_m = preset.box_max_m[axis] - 0.25 * voxel_m;
        let hit_m = (origin_m[axis] + exit_m * direction[axis]).max(low_m).min(high_m);
        cell[axis] = ((hit_m / voxel_m).floor() - simulator.base[axis]) as usize;
    }
    Some(cell[0] + simulator.cells[0] * (cell[1] + simulator.cells[1] * cell[2]))
}
