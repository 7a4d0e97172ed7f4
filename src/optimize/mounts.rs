//! Mounts as a search space: how many masters, and where and how tilted each is.

use serde::{Deserialize, Serialize};

use super::{Mirror, Space, SpaceError, Variable};
use crate::rig::Mount;

/// Greatest number of masters of the published space.
pub const PUBLISHED_MASTERS_MAX: u32 = 5;

/// Published bounds: where a master may sit, m, and how far it may tilt, degrees.
const BOUNDS: [(&str, f64, f64); 5] = [
    ("x_m", -0.10, 0.15),
    ("y_m", -0.25, 0.25),
    ("z_m", -0.15, 0.15),
    ("pitch_deg", -90.0, 90.0),
    ("roll_deg", -90.0, 90.0),
];

/// A mount before mirroring: `[x_m, y_m, z_m, pitch_deg, roll_deg]`. Degrees, so that what is printed is what was scored.
pub type Master = [f64; 5];

/// What about the mounts is searched.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MountSearch {
    /// One master up to this many; each is mirrored.
    pub masters_max: u32,
    /// Roll of every master in degrees; searched when `None`.
    pub fixed_roll_deg: Option<f64>,
    /// Whether scene and path look the same from both ends of the platform (y and roll change sign).
    pub fore_aft_symmetry: bool,
}

impl MountSearch {
    /// The space: the number of masters, then x, y, z, pitch and, if it is free, roll of each. A master beyond the
    /// number is inactive. Symmetries: a master and its mirror image may change places, and so may masters.
    pub fn space(&self) -> Result<Space, SpaceError> {
        let count = f64::from(self.masters_max);
        let mut variables = vec![Variable {
            name: "masters".into(),
            low: 1.0,
            high: count,
            integer: true,
            active_from: None,
            role: 0,
        }];
        let mut blocks = Vec::new();
        let mut mirrors = Vec::new();
        let per_master = self.per_master();
        for master in 1..=self.masters_max {
            let first = variables.len();
            for (role, (name, low, high)) in BOUNDS.iter().take(per_master).enumerate() {
                variables.push(Variable {
                    name: format!("master {master} {name}"),
                    low: *low,
                    high: *high,
                    integer: false,
                    active_from: (master > 1).then_some(master),
                    role: role + 1,
                });
            }
            mirrors.push(Mirror { key: first, negated: vec![first, first + 3] });
            blocks.push((first..first + per_master).collect::<Vec<usize>>());
        }
        if self.fore_aft_symmetry && self.fixed_roll_deg.is_none_or(|roll| roll == 0.0) {
            let negated = blocks.iter().flat_map(|block| {
                let roll = self.fixed_roll_deg.is_none().then_some(block[0] + 4);
                [Some(block[0] + 1), roll].into_iter().flatten()
            });
            let negated = negated.collect();
            mirrors.push(Mirror { key: 2, negated });
        }
        Space::new(variables)?.with_symmetries(mirrors, blocks)
    }

    /// The masters of a point of that space.
    pub fn masters(&self, values: &[f64]) -> Vec<Master> {
        let per_master = self.per_master();
        let roll_deg = self.fixed_roll_deg.unwrap_or(0.0);
        values[1..]
            .chunks_exact(per_master)
            .take(values[0] as usize)
            .map(|v| [v[0], v[1], v[2], v[3], v.get(4).copied().unwrap_or(roll_deg)])
            .collect()
    }

    fn per_master(&self) -> usize {
        if self.fixed_roll_deg.is_some() { 4 } else { 5 }
    }
}

/// A master as a mount, in radians.
pub fn mount(master: Master) -> Mount {
    let [x_m, y_m, z_m, pitch_deg, roll_deg] = master;
    Mount { x_m, y_m, z_m, pitch_rad: pitch_deg.to_radians(), roll_rad: roll_deg.to_radians() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_published_space_has_one_integer_and_25_continuous_variables() {
        let search = MountSearch { masters_max: 5, fixed_roll_deg: None, fore_aft_symmetry: true };
        let space = search.space().unwrap();
        assert_eq!(space.len(), 26);
        assert_eq!(space.variables().iter().filter(|v| v.integer).count(), 1);
        let mut values = vec![0.0; 26];
        values[0] = 2.0;
        values[1..11].copy_from_slice(&[0.1, 0.2, -0.1, 30.0, 5.0, -0.05, 0.0, 0.0, -40.0, 0.0]);
        assert_eq!(search.masters(&values), [[0.1, 0.2, -0.1, 30.0, 5.0], [-0.05, 0.0, 0.0, -40.0, 0.0]]);
    }

    #[test]
    fn equal_rigs_have_one_canonical_point() {
        let search = MountSearch { masters_max: 1, fixed_roll_deg: None, fore_aft_symmetry: true };
        let space = search.space().unwrap();
        let one = space.canonical(&[1.0, 0.1, 0.2, 0.05, 30.0, 5.0]);
        assert_eq!(one, space.canonical(&[1.0, -0.1, 0.2, 0.05, -30.0, 5.0]));
        assert_eq!(one, space.canonical(&[1.0, -0.1, -0.2, 0.05, -30.0, -5.0]));
        assert_ne!(one, space.canonical(&[1.0, 0.1, 0.2, 0.05, -30.0, 5.0]));
    }

    #[test]
    fn a_tilt_fixed_off_zero_has_no_fore_aft_symmetry() {
        let search = MountSearch { masters_max: 1, fixed_roll_deg: Some(5.0), fore_aft_symmetry: true };
        let space = search.space().unwrap();
        assert_eq!(space.canonical(&[1.0, 0.1, -0.2, 0.0, 30.0])[2], -0.2);
        assert_eq!(search.masters(&[1.0, 0.1, -0.2, 0.0, 30.0]), [[0.1, -0.2, 0.0, 30.0, 5.0]]);
    }
}
