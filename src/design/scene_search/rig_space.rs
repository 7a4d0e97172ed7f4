//! Rigs as a search space: where each master sits and how it is tilted.

use std::collections::BTreeMap;
use std::path::PathBuf;

use crate::design::optimize::{KeepApart, Mirror, MountBounds, Space, SpaceError, Variable};
use crate::rig::{Mount, MountedSensor, Rig, Unit};

/// A sensor that is searched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Master {
    /// Its place in the list of units.
    pub unit: usize,
    /// Whether its mirror image is a sensor, too.
    pub is_mirrored: bool,
}

/// Fewer channels leave gaps that many revolutions have to fill.
const FEW_CHANNELS: usize = 32;

/// Whether some sensor of a rig leaves such gaps.
pub(crate) fn is_of_few_channels(rig: &Rig) -> bool {
    rig.sensors.iter().any(|sensor| sensor.model.channels() < FEW_CHANNELS)
}

/// The rigs among which is searched.
#[derive(Clone, Debug)]
pub(crate) struct RigSpace {
    pub units: Vec<Unit>,
    /// The file of each that the user brought.
    pub files: Vec<Option<PathBuf>>,
    pub masters: Vec<Master>,
    pub bounds: MountBounds,
    /// Roll of every master, degrees; searched where none.
    pub fixed_roll_deg: Option<f64>,
    /// Pitch and roll are whole multiples of this, degrees.
    pub tilt_step_deg: Option<f64>,
    pub keep_apart: KeepApart,
}

impl RigSpace {
    /// Masters of a list of units: two of a kind are a mirrored pair, unless `is_mirrored` is false.
    pub(crate) fn masters_of(units: &[usize], is_mirrored: bool) -> Vec<Master> {
        let mut masters: Vec<Master> = Vec::new();
        let mut single: Vec<usize> = Vec::new();
        for unit in units {
            match single.iter().position(|other| is_mirrored && other == unit) {
                Some(at) => {
                    single.remove(at);
                    masters.push(Master { unit: *unit, is_mirrored: true });
                }
                None => single.push(*unit),
            }
        }
        masters.extend(single.into_iter().map(|unit| Master { unit, is_mirrored: false }));
        masters
    }

    /// The same with so many sensors, all of the first unit.
    pub(crate) fn with_sensors(&self, count: usize, is_mirrored: bool) -> Self {
        Self { masters: Self::masters_of(&vec![0; count], is_mirrored), ..self.clone() }
    }

    /// Variables of a master.
    fn coordinates(&self) -> usize {
        if self.fixed_roll_deg.is_some() { 4 } else { 5 }
    }

    /// x, y, z, pitch and, where it is free, roll of each master. Of a mirrored pair the half in which x is not negative.
    ///
    /// # Errors
    /// Bounds out of order.
    pub(crate) fn space(&self) -> Result<Space, SpaceError> {
        let MountBounds { x_m, y_m, z_m, pitch_deg, roll_deg } = self.bounds;
        let named =
            [("x_m", x_m), ("y_m", y_m), ("z_m", z_m), ("pitch_deg", pitch_deg), ("roll_deg", roll_deg)];
        let (mut variables, mut mirrors) = (Vec::new(), Vec::new());
        for (number, master) in self.masters.iter().enumerate() {
            let first = variables.len();
            for (role, (name, (low, high))) in named.into_iter().take(self.coordinates()).enumerate() {
                variables.push(Variable {
                    name: format!("master {} {name}", number + 1),
                    low,
                    high,
                    integer: false,
                    active_from: None,
                    role,
                });
            }
            let is_even = pitch_deg.0 == -pitch_deg.1 && x_m.0 <= 0.0 && x_m.1 >= -x_m.0;
            if master.is_mirrored && is_even {
                mirrors.push(Mirror { key: first, negated: vec![first, first + 3] });
            }
        }
        Ok(Space::new(variables)?.with_symmetries(mirrors, Vec::new())?.folded())
    }

    /// The mounts of the masters of a point.
    pub(crate) fn mounts(&self, values: &[f64]) -> Vec<Mount> {
        let stepped = |angle_deg: f64, (low, high): (f64, f64)| match self.tilt_step_deg {
            Some(step_deg) => {
                let least = (low / step_deg).ceil();
                (angle_deg / step_deg).round().clamp(least, (high / step_deg).floor().max(least)) * step_deg
            }
            None => angle_deg,
        };
        let mount = |v: &[f64]| {
            let roll_deg = v.get(4).map(|free_deg| stepped(*free_deg, self.bounds.roll_deg));
            Mount {
                x_m: v[0],
                y_m: v[1],
                z_m: v[2],
                pitch_rad: stepped(v[3], self.bounds.pitch_deg).to_radians(),
                roll_rad: roll_deg.or(self.fixed_roll_deg).unwrap_or(0.0).to_radians(),
                ..Mount::default()
            }
        };
        values.chunks_exact(self.coordinates()).map(mount).collect()
    }

    /// The rig of a point.
    pub(crate) fn rig(&self, values: &[f64]) -> Rig {
        self.rig_of(&self.mounts(values))
    }

    /// The same point with every tilt as near to none as the limits allow.
    pub(crate) fn level(&self, values: &[f64]) -> Vec<f64> {
        let mut level = values.to_vec();
        for master in level.chunks_exact_mut(self.coordinates()) {
            let limits = [self.bounds.pitch_deg, self.bounds.roll_deg];
            for (tilt_deg, (low, high)) in master[3..].iter_mut().zip(limits) {
                *tilt_deg = 0.0_f64.clamp(low, high);
            }
        }
        level
    }

    /// One of the rigs.
    pub(crate) fn any(&self) -> Rig {
        self.rig_of(&vec![Mount::default(); self.masters.len()])
    }

    /// The rig of these masters.
    pub(crate) fn rig_of(&self, mounts: &[Mount]) -> Rig {
        let mut sensors = Vec::new();
        for (number, (master, mount)) in self.masters.iter().zip(mounts).enumerate() {
            let number = if self.masters.len() > 1 { format!("-{}", number + 1) } else { String::new() };
            let mut add = |name: &str, mount: Mount| {
                let model = self.units[master.unit].model.clone();
                sensors.push(MountedSensor { name: format!("{name}{number}"), model, mount });
            };
            add("master", *mount);
            if master.is_mirrored {
                add("mirrored", mount.mirrored());
            }
        }
        Rig { sensors }
    }

    /// By sensor of a rig the file that the user brought; none where there is none.
    pub(crate) fn calibrations(&self, rig: &Rig) -> Option<BTreeMap<String, PathBuf>> {
        let file = |sensor: &MountedSensor| {
            let unit = self.units.iter().position(|unit| unit.model == sensor.model)?;
            Some((sensor.name.clone(), self.files[unit].clone()?))
        };
        let files: BTreeMap<String, PathBuf> = rig.sensors.iter().filter_map(file).collect();
        (!files.is_empty()).then_some(files)
    }

    /// The coordinates of a point that lie at their limits, in words.
    pub(crate) fn limits_of(&self, values: &[f64]) -> Vec<String> {
        let Ok(space) = self.space() else { return Vec::new() };
        let at_limit = |(variable, value): (&Variable, &f64)| {
            let near = 1e-3 * (variable.high - variable.low);
            // the middle of a mirrored pair is no limit
            let is_fold = variable.low == 0.0 && variable.name.ends_with("x_m");
            let is_low = value - variable.low < near && !is_fold;
            let flag = if variable.name.ends_with("_deg") {
                "the limits of pitch and roll set"
            } else {
                "--space sets"
            };
            (near > 0.0 && (is_low || variable.high - value < near)).then(|| {
                format!("{} of the best mount lies at its limit ({value:.3}): {flag} it", variable.name)
            })
        };
        space.variables().iter().zip(values).filter_map(at_limit).collect()
    }

    /// By how much sensors are too close to each other, m.
    pub(crate) fn violation_m(&self, rig: &Rig) -> f64 {
        let least_m = match self.keep_apart {
            KeepApart::None => return 0.0,
            KeepApart::Housings => 0.0,
            KeepApart::Distance(least_m) => {
                let short = |pair: crate::rig::Clearance| (least_m - pair.distance_m).max(0.0);
                return rig.clearances(0.0).into_iter().map(short).sum();
            }
        };
        let short = |pair: crate::rig::Clearance| (pair.needed_m - pair.distance_m).max(0.0);
        rig.clearances(least_m).into_iter().map(short).sum::<f64>() + rig.housing_shortfall_m()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pair() -> RigSpace {
        RigSpace {
            units: vec![Unit::nominal("os1-64").unwrap()],
            files: vec![None],
            masters: RigSpace::masters_of(&[0, 0], true),
            bounds: MountBounds::default(),
            fixed_roll_deg: Some(0.0),
            tilt_step_deg: Some(0.5),
            keep_apart: KeepApart::Housings,
        }
    }

    #[test]
    fn two_of_a_kind_are_a_pair_and_others_are_not() {
        let mirrored = |unit| Master { unit, is_mirrored: true };
        let single = |unit| Master { unit, is_mirrored: false };
        assert_eq!(RigSpace::masters_of(&[0, 0], true), [mirrored(0)]);
        assert_eq!(RigSpace::masters_of(&[0, 0], false), [single(0), single(0)]);
        assert_eq!(RigSpace::masters_of(&[0, 1, 0, 0], true), [mirrored(0), single(1), single(0)]);
    }

    #[test]
    fn a_pair_is_searched_in_the_half_with_positive_x() {
        let space = pair().space().unwrap();
        assert_eq!((space.len(), space.variables()[0].low, space.variables()[0].high), (4, 0.0, 0.15));
        let rig = pair().rig(&[0.1, 0.2, -0.1, 20.2]);
        let pitches: Vec<f64> =
            rig.sensors.iter().map(|sensor| sensor.mount.pitch_rad.to_degrees()).collect();
        assert!((pitches[0] - 20.0).abs() < 1e-12 && pitches[1] == -pitches[0], "{pitches:?}");
        assert_eq!(pair().violation_m(&rig), 0.0);
        assert!(pair().violation_m(&pair().rig(&[0.01, 0.0, 0.0, 0.0])) > 0.06);
    }
}
