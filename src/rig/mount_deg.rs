//! Where a sensor sits, in the published decision vector's terms.

use crate::rig::{Mount, SensorEntry};

/// One sensor of the published decision vector; angles in degrees, because the published rotations are exact at
/// multiples of 90 degrees.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct MountDeg {
    /// Right of the platform's origin, m.
    pub x_m: f64,
    /// Ahead of it, m.
    pub y_m: f64,
    /// Above it, m.
    pub z_m: f64,
    /// About the forward axis, degrees.
    pub pitch_deg: f64,
    /// About the lateral axis, degrees.
    pub roll_deg: f64,
    /// Which of the experiment's sensor types it is, counted from 0 (`Experiment::types`).
    pub sensor_type: usize,
}

impl MountDeg {
    /// The mirror image across the platform's plane of symmetry (YZ): a sensor of the same type.
    pub(crate) fn mirrored(&self) -> Self {
        Self { x_m: -self.x_m, pitch_deg: -self.pitch_deg, ..*self }
    }

    /// The same in radians.
    pub(crate) fn mount(&self) -> Mount {
        Mount {
            x_m: self.x_m,
            y_m: self.y_m,
            z_m: self.z_m,
            pitch_rad: self.pitch_deg.to_radians(),
            roll_rad: self.roll_deg.to_radians(),
            yaw_rad: 0.0,
        }
    }

    /// The sensor of a mount file that sits here.
    pub(crate) fn entry(&self, name: String, model: &str) -> SensorEntry {
        SensorEntry {
            name,
            model: model.into(),
            x_m: self.x_m,
            y_m: self.y_m,
            z_m: self.z_m,
            pitch_deg: self.pitch_deg,
            roll_deg: self.roll_deg,
            ..SensorEntry::default()
        }
    }

    /// `Rx(roll) * Ry(pitch)`, row by row, in the published order of operations.
    pub(crate) fn rotation_rows(&self) -> [[f64; 3]; 3] {
        let (sp, cp) = sin_cos_deg(self.pitch_deg);
        let (sr, cr) = sin_cos_deg(self.roll_deg);
        [[cp, 0.0, sp], [sr * sp, cr, -sr * cp], [-cr * sp, sr, cr * cp]]
    }
}

impl From<[f64; 5]> for MountDeg {
    /// From `[x_m, y_m, z_m, pitch_deg, roll_deg]`, of the experiment's first sensor type.
    fn from([x_m, y_m, z_m, pitch_deg, roll_deg]: [f64; 5]) -> Self {
        Self { x_m, y_m, z_m, pitch_deg, roll_deg, sensor_type: 0 }
    }
}

impl From<MountDeg> for [f64; 5] {
    fn from(mount: MountDeg) -> Self {
        [mount.x_m, mount.y_m, mount.z_m, mount.pitch_deg, mount.roll_deg]
    }
}

/// All mounts between two corners, component by component.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MountRegion {
    /// Least components.
    pub low: MountDeg,
    /// Maximum components.
    pub high: MountDeg,
}

impl MountRegion {
    /// The mirror images of its mounts across the platform's plane of symmetry.
    pub(crate) fn mirrored(&self) -> Self {
        let (low, high) = (self.high.mirrored(), self.low.mirrored());
        let corner =
            |from: MountDeg, other: MountDeg| MountDeg { x_m: from.x_m, pitch_deg: from.pitch_deg, ..other };
        Self { low: corner(low, self.low), high: corner(high, self.high) }
    }

    /// Of every component, minimum and maximum.
    pub(crate) fn intervals(&self) -> [[f64; 2]; 5] {
        let (low, high) = (<[f64; 5]>::from(self.low), <[f64; 5]>::from(self.high));
        std::array::from_fn(|at| [low[at], high[at]])
    }
}

/// Sine and cosine of an angle in degrees, exact at multiples of 90.
fn sin_cos_deg(angle_deg: f64) -> (f64, f64) {
    if angle_deg % 90.0 == 0.0 {
        match (angle_deg / 90.0).rem_euclid(4.0) as u8 {
            0 => (0.0, 1.0),
            1 => (1.0, 0.0),
            2 => (0.0, -1.0),
            _ => (-1.0, 0.0),
        }
    } else {
        angle_deg.to_radians().sin_cos()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quarter_turns_are_exact() {
        for (angle_deg, expected) in [
            (0.0, (0.0, 1.0)),
            (90.0, (1.0, 0.0)),
            (180.0, (0.0, -1.0)),
            (-90.0, (-1.0, 0.0)),
            (450.0, (1.0, 0.0)),
        ] {
            assert_eq!(sin_cos_deg(angle_deg), expected, "{angle_deg}");
        }
    }
}
