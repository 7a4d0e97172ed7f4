//! What a search may vary: bounded real and integer variables, some of them active only from a count upwards, and the
//! exact symmetries of the objective as data.

use serde::{Deserialize, Serialize};

use crate::base::rng::Rng;

/// One decision variable.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Variable {
    /// Name with its unit, for messages.
    pub name: String,
    /// Least value, inclusive.
    pub low: f64,
    /// Maximum, inclusive.
    pub high: f64,
    /// Whole numbers only.
    pub integer: bool,
    /// Active when variable 0 has at least this value; always active when `None`.
    pub active_from: Option<u32>,
    /// Variables of one role mean the same thing (the pitch of master 1 and of master 2): models may share a length
    /// scale among them.
    pub role: usize,
}

/// Changing the sign of these variables together leaves the objective unchanged.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Mirror {
    /// The canonical half is where this variable is not negative.
    pub key: usize,
    /// All variables that change sign, the key among them.
    pub negated: Vec<usize>,
}

/// The variables, and what is known about the objective's symmetries.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Space {
    variables: Vec<Variable>,
    mirrors: Vec<Mirror>,
    /// Interchangeable groups of variables; group g is active as one.
    blocks: Vec<Vec<usize>>,
    /// What no point can exceed, for each value of variable 0 from its least one up; unknown when empty.
    ceilings: Vec<f64>,
}

/// Why a space cannot be searched.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SpaceError {
    /// No variables.
    #[error("a search needs at least one variable")]
    Empty,
    /// Bounds out of order, not finite, or not whole for an integer.
    #[error("variable {name}: bounds {low} to {high} are not finite, ordered and (for an integer) whole")]
    Bounds {
        /// Which variable.
        name: String,
        /// Its least value.
        low: f64,
        /// Its maximum.
        high: f64,
    },
    /// A variable depends on variable 0, which is no count.
    #[error("variable {0} is active from a count, but variable 0 is not an integer that is always active")]
    NoCount(String),
    /// A symmetry with a canonical half outside the bounds, or that names no variable.
    #[error("a symmetry of variable {0} would leave the bounds")]
    Symmetry(usize),
}

impl Space {
    /// A space without symmetries.
    pub fn new(variables: Vec<Variable>) -> Result<Self, SpaceError> {
        let first = variables.first().ok_or(SpaceError::Empty)?;
        let counted = first.integer && first.active_from.is_none();
        for variable in &variables {
            let Variable { name, low, high, integer, active_from, .. } = variable;
            let whole = !integer || (low.fract() == 0.0 && high.fract() == 0.0);
            if !(low.is_finite() && high.is_finite() && low <= high && whole) {
                return Err(SpaceError::Bounds { name: name.clone(), low: *low, high: *high });
            }
            if active_from.is_some() && !counted {
                return Err(SpaceError::NoCount(name.clone()));
            }
        }
        Ok(Self { variables, mirrors: Vec::new(), blocks: Vec::new(), ceilings: Vec::new() })
    }

    /// The same space with known exact symmetries: sign changes, and groups of variables that may change places.
    pub(crate) fn with_symmetries(
        mut self,
        mirrors: Vec<Mirror>,
        blocks: Vec<Vec<usize>>,
    ) -> Result<Self, SpaceError> {
        for mirror in &mirrors {
            for &index in mirror.negated.iter().chain([&mirror.key]) {
                let variable = self.variables.get(index).ok_or(SpaceError::Symmetry(index))?;
                let inside = if index == mirror.key {
                    variable.low <= 0.0 && variable.high >= -variable.low
                } else {
                    variable.low == -variable.high
                };
                if !inside {
                    return Err(SpaceError::Symmetry(index));
                }
            }
        }
        let alike = |a: usize, b: usize| match (self.variables.get(a), self.variables.get(b)) {
            (Some(a), Some(b)) => a.low == b.low && a.high == b.high && a.integer == b.integer,
            _ => false,
        };
        for block in &blocks {
            if block.len() != blocks[0].len() {
                return Err(SpaceError::Symmetry(block.first().copied().unwrap_or(0)));
            }
            if let Some((&odd, _)) = block.iter().zip(&blocks[0]).find(|&(&a, &b)| !alike(a, b)) {
                return Err(SpaceError::Symmetry(odd));
            }
        }
        self.mirrors = mirrors;
        self.blocks = blocks;
        Ok(self)
    }

    /// The same space with scores that no point can exceed, one for each value of variable 0 from its least one up.
    pub fn with_ceilings(mut self, ceilings: Vec<f64>) -> Self {
        self.ceilings = ceilings;
        self
    }

    /// The same space less the top values of variable 0 that cannot exceed `score`, whatever the rest.
    pub(crate) fn that_can_exceed(&self, score: f64) -> Self {
        let mut rest = self.clone();
        if self.ceilings.len() as f64 == self.variables[0].high - self.variables[0].low + 1.0 {
            let worth = self.ceilings.iter().rposition(|ceiling| *ceiling > score).unwrap_or(0);
            rest.variables[0].high = self.variables[0].low + worth as f64;
            rest.ceilings.truncate(worth + 1);
        }
        rest
    }

    /// The values of variable 0 with what no point that has them can exceed, where that is known.
    pub(crate) fn ceilings(&self) -> impl Iterator<Item = (f64, f64)> {
        let least = self.variables[0].low;
        self.ceilings.iter().enumerate().map(move |(place, ceiling)| (least + place as f64, *ceiling))
    }

    /// The part of the space in which variable 0 has this value.
    pub(crate) fn at_count(&self, count: f64) -> Self {
        let mut part = self.clone();
        part.ceilings =
            self.ceilings().filter(|(other, _)| *other == count).map(|(_, ceiling)| ceiling).collect();
        (part.variables[0].low, part.variables[0].high) = (count, count);
        part
    }

    /// What no point of the space can exceed, where that is known.
    pub(crate) fn ceiling(&self) -> Option<f64> {
        self.ceilings.iter().copied().reduce(f64::max)
    }

    /// One representative of each class of equal points: the canonical half of every mirror.
    pub(crate) fn folded(&self) -> Self {
        let mut folded = self.clone();
        for mirror in &self.mirrors {
            folded.variables[mirror.key].low = 0.0;
        }
        folded
    }

    /// The variables in order.
    pub(crate) fn variables(&self) -> &[Variable] {
        &self.variables
    }

    /// How many.
    pub fn len(&self) -> usize {
        self.variables.len()
    }

    /// Never true of a space that was constructed.
    pub fn is_empty(&self) -> bool {
        self.variables.is_empty()
    }

    /// The interchangeable groups of variables that matter at this point.
    pub(crate) fn active_groups(&self, values: &[f64]) -> Vec<&[usize]> {
        self.blocks.iter().filter(|block| self.is_active(values, block[0])).map(Vec::as_slice).collect()
    }

    /// Whether variable `index` matters at this point.
    pub(crate) fn is_active(&self, values: &[f64], index: usize) -> bool {
        self.variables[index].active_from.is_none_or(|from| values[0] >= f64::from(from))
    }

    /// The variables that matter at this point and are free to move.
    pub fn free(&self, values: &[f64]) -> Vec<usize> {
        (0..self.len())
            .filter(|&i| self.variables[i].low < self.variables[i].high && self.is_active(values, i))
            .collect()
    }

    /// Brings every value into its bounds and integers to whole numbers.
    pub(crate) fn clamp(&self, values: &mut [f64]) {
        for (value, variable) in values.iter_mut().zip(&self.variables) {
            let whole = if variable.integer { value.round() } else { *value };
            *value = whole.clamp(variable.low, variable.high);
        }
    }

    /// Point of the unit cube to values; an integer's values share the interval evenly.
    pub(crate) fn values_at(&self, unit: &[f64]) -> Vec<f64> {
        let value = |(&u, v): (&f64, &Variable)| {
            if v.integer {
                (v.low + (u * (v.high - v.low + 1.0)).floor()).clamp(v.low, v.high)
            } else {
                (v.low + u * (v.high - v.low)).clamp(v.low, v.high)
            }
        };
        unit.iter().zip(&self.variables).map(value).collect()
    }

    /// Values to a point of the unit cube; an integer lies in the middle of its interval, a fixed variable at 0.5.
    pub(crate) fn to_unit(&self, values: &[f64]) -> Vec<f64> {
        let unit = |(&x, v): (&f64, &Variable)| {
            if v.integer {
                (x - v.low + 0.5) / (v.high - v.low + 1.0)
            } else if v.high > v.low {
                (x - v.low) / (v.high - v.low)
            } else {
                0.5
            }
        };
        values.iter().zip(&self.variables).map(unit).collect()
    }

    /// The representative of a point's class: mirrors folded, groups sorted (by their last variable, descending),
    /// inactive variables at the middle of their range, so that equal designs are equal vectors.
    pub fn canonical(&self, values: &[f64]) -> Vec<f64> {
        let mut x = values.to_vec();
        for mirror in &self.mirrors {
            if self.is_active(&x, mirror.key) && x[mirror.key] < 0.0 {
                for &index in &mirror.negated {
                    x[index] = -x[index];
                }
            }
        }
        let active = self.active_groups(&x);
        let mut contents: Vec<Vec<f64>> =
            active.iter().map(|block| block.iter().map(|&index| x[index]).collect()).collect();
        contents
            .sort_by(|a, b| b.iter().rev().partial_cmp(a.iter().rev()).unwrap_or(std::cmp::Ordering::Equal));
        for (block, content) in active.iter().zip(contents) {
            for (&index, value) in block.iter().zip(content) {
                x[index] = value;
            }
        }
        for index in 0..self.len() {
            if !self.is_active(&x, index) {
                x[index] = 0.5 * (self.variables[index].low + self.variables[index].high);
            }
        }
        x
    }

    /// Uniform over the space.
    pub fn sample(&self, rng: &mut Rng) -> Vec<f64> {
        let unit: Vec<f64> = (0..self.len()).map(|_| rng.uniform()).collect();
        self.values_at(&unit)
    }

    /// Latin hypercube (McKay, Beckman, Conover 1979, doi:10.1080/00401706.1979.10489755): each variable's range is
    /// cut into `count` strata, each used once.
    pub(crate) fn latin_hypercube(&self, count: usize, rng: &mut Rng) -> Vec<Vec<f64>> {
        let mut points = vec![vec![0.0; self.len()]; count];
        for variable in 0..self.len() {
            let mut strata: Vec<usize> = (0..count).collect();
            for i in (1..count).rev() {
                strata.swap(i, rng.below(i as u64 + 1) as usize);
            }
            for (point, stratum) in points.iter_mut().zip(strata) {
                point[variable] = (stratum as f64 + rng.uniform()) / count as f64;
            }
        }
        points.iter().map(|unit| self.values_at(unit)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn real(name: &str, low: f64, high: f64, active_from: Option<u32>) -> Variable {
        Variable { name: name.into(), low, high, integer: false, active_from, role: 1 }
    }

    fn count(high: f64) -> Variable {
        Variable { name: "count".into(), low: 1.0, high, integer: true, active_from: None, role: 0 }
    }

    #[test]
    fn integers_share_the_unit_interval_evenly_and_come_back() {
        let space = Space::new(vec![count(5.0)]).unwrap();
        let mut seen = [0; 6];
        for i in 0..1000 {
            seen[space.values_at(&[f64::from(i) / 1000.0])[0] as usize] += 1;
        }
        assert_eq!(seen, [0, 200, 200, 200, 200, 200]);
        assert_eq!(space.values_at(&[1.0]), [5.0]);
        for value in 1..=5 {
            assert_eq!(space.values_at(&space.to_unit(&[f64::from(value)])), [f64::from(value)]);
        }
    }

    #[test]
    fn canonical_folds_mirrors_sorts_groups_and_parks_inactive_variables() {
        let variables = vec![
            count(2.0),
            real("x1", -0.1, 0.15, None),
            real("p1", -1.0, 1.0, None),
            real("x2", -0.1, 0.15, Some(2)),
            real("p2", -1.0, 1.0, Some(2)),
        ];
        let mirrors = vec![Mirror { key: 1, negated: vec![1, 2] }, Mirror { key: 3, negated: vec![3, 4] }];
        let space =
            Space::new(variables).unwrap().with_symmetries(mirrors, vec![vec![1, 2], vec![3, 4]]).unwrap();
        assert_eq!(
            space.canonical(&[1.0, -0.05, 0.3, 0.1, 0.9]),
            space.canonical(&[1.0, 0.05, -0.3, -0.1, 0.0])
        );
        assert_eq!(space.canonical(&[2.0, 0.05, 0.3, -0.1, -0.9]), [2.0, 0.1, 0.9, 0.05, 0.3]);
        assert_eq!(space.free(&[1.0, 0.0, 0.0, 0.0, 0.0]), [0, 1, 2]);
        assert_eq!(space.folded().variables()[1].low, 0.0);
    }

    #[test]
    fn counts_that_cannot_win_are_left_out() {
        let space = Space::new(vec![count(3.0)]).unwrap().with_ceilings(vec![30.0, 20.0, 10.0]);
        let most = |score| space.that_can_exceed(score).variables()[0].high;
        assert_eq!([most(5.0), most(10.0), most(19.0), most(25.0), most(99.0)], [3.0, 2.0, 2.0, 1.0, 1.0]);
        assert_eq!(Space::new(vec![count(3.0)]).unwrap().that_can_exceed(99.0).variables()[0].high, 3.0);
        let part = space.at_count(2.0);
        assert_eq!(
            (part.variables()[0].low, part.variables()[0].high, part.ceiling()),
            (2.0, 2.0, Some(20.0))
        );
        assert_eq!(space.ceilings().collect::<Vec<_>>(), [(1.0, 30.0), (2.0, 20.0), (3.0, 10.0)]);
    }

    #[test]
    fn impossible_spaces_are_refused() {
        assert_eq!(Space::new(vec![]), Err(SpaceError::Empty));
        assert!(matches!(Space::new(vec![real("x", 1.0, 0.0, None)]), Err(SpaceError::Bounds { .. })));
        assert!(matches!(Space::new(vec![real("x", f64::NAN, 0.0, None)]), Err(SpaceError::Bounds { .. })));
        assert!(matches!(Space::new(vec![real("x", 0.0, 1.0, Some(2))]), Err(SpaceError::NoCount(_))));
        let space = Space::new(vec![real("x", -1.0, 0.5, None)]).unwrap();
        assert!(space.with_symmetries(vec![Mirror { key: 0, negated: vec![0] }], vec![]).is_err());
    }

    #[test]
    fn a_latin_hypercube_uses_every_stratum_once() {
        let space = Space::new(vec![real("x", 0.0, 8.0, None), real("y", 0.0, 8.0, None)]).unwrap();
        for axis in 0..2 {
            let points = space.latin_hypercube(8, &mut Rng::new(3, 0));
            let mut strata: Vec<usize> = points.iter().map(|p| p[axis] as usize).collect();
            strata.sort_unstable();
            assert_eq!(strata, (0..8).collect::<Vec<_>>());
        }
    }
}
