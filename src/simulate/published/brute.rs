//! The definition, ray by ray: the reference for every faster method.

use super::{BoxPose, PublishedBox};

/// Bitmap of what a sensor sees from poses, and the number of rays that the quirk lost.
pub(super) fn see(simulator: &PublishedBox, poses: &[BoxPose]) -> (Vec<u64>, u64) {
    let words = simulator.cells.iter().product::<usize>().div_ceil(64);
    let mut bitmap = vec![0u64; words];
    let mut lost = 0;
    for pose in poses {
        for azimuth in 0..simulator.experiment.azimuths {
            let sin_cos = azimuth_rad(simulator, pose.turn, azimuth).sin_cos();
            for beam in 0..simulator.elevations.len() {
                let direction = direction_at(simulator, pose, sin_cos, beam);
                match voxel(simulator, pose.origin_m, direction) {
                    Some(index) => bitmap[index / 64] |= 1 << (index % 64),
                    None => lost += 1,
                }
            }
        }
    }
    (bitmap, lost)
}

/// Number of rays that the quirk loses at a pose.
pub(super) fn lost_rays(simulator: &PublishedBox, pose: &BoxPose) -> u64 {
    if !simulator.loses() {
        return 0;
    }
    let mut lost = 0;
    for azimuth in 0..simulator.experiment.azimuths {
        let sin_cos = azimuth_rad(simulator, pose.turn, azimuth).sin_cos();
        for beam in 0..simulator.elevations.len() {
            lost += u64::from(direction_at(simulator, pose, sin_cos, beam).contains(&0.0));
        }
    }
    lost
}

/// Azimuth of a column of a pattern that has turned by so many steps, rad.
pub(super) fn azimuth_rad(simulator: &PublishedBox, turn: f64, azimuth: usize) -> f64 {
    let azimuths = simulator.experiment.azimuths as f64;
    ((azimuth as f64 + turn) * 360.0 / azimuths).to_radians()
}

/// World direction of a beam.
pub(super) fn direction(simulator: &PublishedBox, pose: &BoxPose, azimuth: usize, beam: usize) -> [f64; 3] {
    direction_at(simulator, pose, azimuth_rad(simulator, pose.turn, azimuth).sin_cos(), beam)
}

/// The same, from the sine and cosine of the azimuth.
pub(super) fn direction_at(
    simulator: &PublishedBox,
    pose: &BoxPose,
    azimuth: (f64, f64),
    beam: usize,
) -> [f64; 3] {
    let [sin_elevation, cos_elevation] = simulator.elevations[beam];
    let (sin_azimuth, cos_azimuth) = azimuth;
    let local = [cos_elevation * cos_azimuth, cos_elevation * sin_azimuth, sin_elevation];
    let along = |row: &[f64; 3]| row[0] * local[0] + row[1] * local[1] + row[2] * local[2];
    [along(&pose.rows[0]), along(&pose.rows[1]), along(&pose.rows[2])]
}

/// Linear index of the voxel that a ray hits; none where the quirk loses the ray.
pub(super) fn voxel(simulator: &PublishedBox, origin_m: [f64; 3], direction: [f64; 3]) -> Option<usize> {
    let preset = &simulator.experiment.preset;
    let mut exit_m = f64::INFINITY;
    for axis in 0..3 {
        if direction[axis] == 0.0 {
            if simulator.loses() {
                return None;
            }
            continue;
        }
        let inverse = 1.0 / direction[axis].abs().max(1e-12) * direction[axis].signum();
        let near = (preset.box_min_m[axis] - origin_m[axis]) * inverse;
        let far = (preset.box_max_m[axis] - origin_m[axis]) * inverse;
        exit_m = exit_m.min(near.max(far));
    }
    let cell: [usize; 3] =
        std::array::from_fn(|axis| cell(simulator, axis, origin_m[axis] + exit_m * direction[axis]));
    Some(cell[0] + simulator.cells[0] * (cell[1] + simulator.cells[1] * cell[2]))
}

/// Cell of a hit along one axis: a quarter voxel inside at the walls.
pub(super) fn cell(simulator: &PublishedBox, axis: usize, hit_m: f64) -> usize {
    let (preset, voxel_m) = (&simulator.experiment.preset, simulator.experiment.voxel_m);
    let low_m = preset.box_min_m[axis] + 0.25 * voxel_m;
    let high_m = preset.box_max_m[axis] - 0.25 * voxel_m;
    ((hit_m.max(low_m).min(high_m) / voxel_m).floor() - simulator.base[axis]) as usize
}
