//! What the model gets wrong, as a function of the mounts and of its own score: a ridge fit of exact minus model, and a step in
//! height where one is seen.

use super::ridge::{RidgeFit, dot};
use crate::rig::Mount;

/// Weight of a term of size one against the data, in observations: of few terms, and of those that bend as well, which have to be
/// free to follow what the model gets wrong in a large scene.
const RIDGE: [f64; 2] = [0.05, 0.01];
/// Lengths and angles over which the terms are of size one.
const LENGTH_M: f64 = 0.15;
const PITCH_RAD: f64 = 0.5;
/// From so far below a shelf to so far above it what is seen changes, m.
const STEP_M: f64 = 0.02;
/// Fewer exact evaluations show the mean error only.
const ENOUGH: usize = 8;
/// Scores that differ by this share are a term of size one.
const SCORE_SHARE: f64 = 0.01;
/// A step has to leave less than this share of the error, terms that bend less than this.
const STEP_LEAVES: f64 = 0.7;
const BENDS_LEAVE: f64 = 0.85;

/// A rig that the model looked at.
#[derive(Clone, Debug)]
pub(super) struct Modelled {
    pub masters: Vec<Mount>,
    /// J by the model.
    pub score: f64,
    /// What of it is no estimate: the term of the angle.
    pub angular: f64,
}

impl Modelled {
    fn estimated(&self) -> f64 {
        self.score - self.angular
    }
}

/// A rig of which both scores are known.
#[derive(Clone, Debug)]
pub(super) struct Observed {
    pub model: Modelled,
    /// J of the rays.
    pub exact: f64,
}

impl Observed {
    fn error(&self) -> f64 {
        self.exact - self.model.score
    }
}

/// The fitted error of a model.
#[derive(Clone, Debug, Default)]
pub(super) struct Correction {
    basis: Basis,
    constant: f64,
    weights: Vec<f64>,
    error: Option<ModelError>,
}

/// How far the corrected model is off mounts that it was not fitted to.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub(crate) struct ModelError {
    /// Exact minus corrected, each mount left out in turn: mean, voxels.
    pub mean: f64,
    /// Standard deviation, voxels.
    pub sd: f64,
    /// Mounts evaluated exactly.
    pub n: usize,
    /// Exact minus model before the correction, mean, voxels.
    pub uncorrected_mean: f64,
    /// Height in the frame of the body at which a shelf or table top lets voxels appear or vanish, m.
    pub step_z_m: Option<f64>,
}

/// What the terms of a fit are.
#[derive(Clone, Copy, Debug, Default)]
struct Basis {
    /// Mean of the model's scores, and a difference that makes a term of size one.
    scores: (f64, f64),
    /// With terms that bend.
    bends: bool,
    step_z_m: Option<f64>,
}

impl Basis {
    /// Inward tilts (x and pitch of opposite sign) are under-rated. Heights are stored in layers, between which the error bends.
    /// A sensor far ahead or behind sees around corners what the middle does not. Of what the model misses, a good mount sees
    /// another share than a bad one.
    fn terms(&self, model: &Modelled) -> Vec<f64> {
        let of_master = |mount: &Mount| {
            let (x, y, z) = (mount.x_m / LENGTH_M, mount.y_m / LENGTH_M, mount.z_m / LENGTH_M);
            let pitch = mount.pitch_rad / PITCH_RAD;
            let side = if pitch < 0.0 { -1.0 } else { 1.0 };
            let few = [pitch.abs(), x * side, x * pitch, z, z * z, y * y];
            let bending = [y, x * x, z * pitch, pitch * pitch];
            few.into_iter().chain(bending.into_iter().filter(|_| self.bends))
        };
        let mut terms: Vec<f64> = model.masters.iter().flat_map(of_master).collect();
        let (mean, unit) = self.scores;
        terms.push((model.estimated() - mean) / unit);
        terms.extend(self.step_z_m.map(|step_z_m| {
            let above = model.masters.iter().map(|mount| ((mount.z_m - step_z_m) / STEP_M).clamp(-1.0, 1.0));
            above.sum::<f64>() / model.masters.len().max(1) as f64
        }));
        terms
    }
}

impl Correction {
    /// Fits to exactly evaluated rigs, by terms that bend where these leave less.
    pub(crate) fn fit(observed: &[Observed]) -> Self {
        if observed.len() < ENOUGH {
            let constant = observed.iter().map(Observed::error).sum::<f64>() / observed.len().max(1) as f64;
            return Self { constant, ..Self::default() };
        }
        let mean = observed.iter().map(|rig| rig.model.estimated()).sum::<f64>() / observed.len() as f64;
        let scores = (mean, (SCORE_SHARE * mean.abs()).max(1.0));
        let few = Self::of_basis(Basis { scores, bends: false, step_z_m: None }, observed);
        let bent = Self::of_basis(Basis { scores, bends: true, step_z_m: None }, observed);
        if bent.sd() < BENDS_LEAVE * few.sd() { bent } else { few }
    }

    fn sd(&self) -> f64 {
        self.error.map_or(f64::INFINITY, |error| error.sd)
    }

    /// With the step in height that leaves least, if one leaves much less than none does.
    fn of_basis(basis: Basis, observed: &[Observed]) -> Self {
        let smooth = Self::with(basis, observed);
        let mut heights_m: Vec<f64> =
            observed.iter().flat_map(|rig| rig.model.masters.iter().map(|mount| mount.z_m)).collect();
        heights_m.sort_by(f64::total_cmp);
        // two mounts at least on each side
        let between = heights_m.windows(2).skip(1).take(heights_m.len().saturating_sub(3));
        let stepped = between
            .map(|pair| Self::with(Basis { step_z_m: Some(0.5 * (pair[0] + pair[1])), ..basis }, observed));
        let best = stepped.reduce(|best, next| if next.sd() < best.sd() { next } else { best });
        best.filter(|best| best.sd() < STEP_LEAVES * smooth.sd()).unwrap_or(smooth)
    }

    /// Of two rigs or more.
    fn with(basis: Basis, observed: &[Observed]) -> Self {
        let mut rows: Vec<Vec<f64>> = observed.iter().map(|rig| basis.terms(&rig.model)).collect();
        let n = rows.len();
        let mean = observed.iter().map(Observed::error).sum::<f64>() / n as f64;
        let middle: Vec<f64> =
            (0..rows[0].len()).map(|at| rows.iter().map(|row| row[at]).sum::<f64>() / n as f64).collect();
        let centre =
            |row: &mut Vec<f64>| row.iter_mut().zip(&middle).for_each(|(term, middle)| *term -= middle);
        rows.iter_mut().for_each(centre);
        let targets: Vec<f64> = observed.iter().map(|rig| rig.error() - mean).collect();
        let ridge = RIDGE[usize::from(basis.bends)];
        let Some(fit) = RidgeFit::new(&rows, &targets, |_| ridge * (0.1 * n as f64 + 1.0)) else {
            return Self { constant: mean, ..Self::default() };
        };
        // each left out in turn, without fitting again (Hastie, Tibshirani, Friedman 2009, equation 7.64)
        let left_out: Vec<f64> = rows
            .iter()
            .zip(&targets)
            .map(|(row, target)| {
                (target - fit.value(row)) / (1.0 - fit.leverage(row) - 1.0 / n as f64).max(1e-3)
            })
            .collect();
        let left_mean = left_out.iter().sum::<f64>() / n as f64;
        let square = left_out.iter().map(|error| (error - left_mean).powi(2)).sum::<f64>();
        let sd = (square / (n - 1) as f64).sqrt();
        let constant = mean - fit.value(&middle);
        let error = ModelError { mean: left_mean, sd, n, uncorrected_mean: mean, step_z_m: basis.step_z_m };
        Self { basis, constant, weights: fit.weights, error: Some(error) }
    }

    /// J of a rig as rays would find it.
    pub(crate) fn corrected(&self, model: &Modelled) -> f64 {
        model.score + self.constant + dot(&self.weights, &self.basis.terms(model))
    }

    pub(crate) fn error(&self) -> Option<ModelError> {
        self.error
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::Rng;

    /// Rigs with an error that is smooth, a share of their score and `step` voxels more above z = 3 cm.
    fn observe(rng: &mut Rng, count: usize, step: f64, noise: f64) -> Vec<Observed> {
        let mut rig = || {
            let mount = Mount {
                x_m: rng.between(0.0, 0.15),
                y_m: rng.between(-0.25, 0.25),
                z_m: rng.between(-0.15, 0.15),
                pitch_rad: rng.between(-1.0, 1.0),
                ..Mount::default()
            };
            let score = rng.between(60_000.0, 61_000.0);
            let smooth = 400.0 + 300.0 * mount.x_m * mount.pitch_rad / 0.075 - 200.0 * mount.z_m / 0.15;
            let stretched = 0.25 * (score - 60_500.0);
            let above = if mount.z_m > 0.03 { step } else { 0.0 };
            let exact = score + smooth + stretched + above + noise * rng.normal();
            Observed { model: Modelled { masters: vec![mount], score, angular: 0.0 }, exact }
        };
        (0..count).map(|_| rig()).collect()
    }

    fn rms(correction: &Correction, rigs: &[Observed]) -> f64 {
        let off = |rig: &Observed| correction.corrected(&rig.model) - rig.exact;
        (rigs.iter().map(|rig| off(rig).powi(2)).sum::<f64>() / rigs.len() as f64).sqrt()
    }

    #[test]
    fn a_smooth_error_is_found_and_the_rest_is_reported() {
        let mut rng = Rng::new(3, 0);
        let correction = Correction::fit(&observe(&mut rng, 30, 0.0, 20.0));
        let error = correction.error().unwrap();
        assert!((10.0..45.0).contains(&error.sd) && error.n == 30 && error.step_z_m.is_none(), "{error:?}");
        let off = rms(&correction, &observe(&mut rng, 200, 0.0, 0.0));
        assert!(off < 40.0, "{off}");
        let level = Modelled { masters: vec![Mount::default()], score: 7.0, angular: 0.0 };
        assert_eq!(Correction::fit(&[]).corrected(&level), 7.0);
    }

    #[test]
    fn an_error_that_bends_is_followed() {
        let mut rng = Rng::new(5, 0);
        let bend = |rig: &mut Observed| {
            let mount = &rig.model.masters[0];
            rig.exact += 4000.0 * mount.y_m - 1500.0 * mount.pitch_rad.powi(2);
        };
        let [mut seen, mut others] = [24, 200].map(|count| observe(&mut rng, count, 0.0, 20.0));
        seen.iter_mut().chain(&mut others).for_each(bend);
        let off = rms(&Correction::fit(&seen), &others);
        // by the few terms some 400 are left
        assert!(off < 100.0, "{off}");
    }

    #[test]
    fn a_shelf_is_a_step_in_height() {
        let mut rest: Vec<f64> = (0..12)
            .map(|seed| {
                let mut rng = Rng::new(seed, 0);
                let correction = Correction::fit(&observe(&mut rng, 24, -2500.0, 20.0));
                let step_z_m = correction.error().unwrap().step_z_m.unwrap();
                assert!((step_z_m - 0.03).abs() < 0.02, "{seed}: {step_z_m}");
                // all but the mounts within the ramp
                let mut others = observe(&mut rng, 200, -2500.0, 0.0);
                others.retain(|rig| (rig.model.masters[0].z_m - 0.03).abs() > 2.0 * STEP_M);
                rms(&correction, &others)
            })
            .collect();
        rest.sort_by(f64::total_cmp);
        // without a step some 500 are left
        assert!(rest[6] < 200.0, "{rest:?}");
    }
}
