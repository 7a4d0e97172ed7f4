//! J in any scene: the published weights, as they are or as shares of what can be seen.

use crate::design::objective::{Terms, Weights, angle_deg, score};
use crate::design::registration::RegistrationQuality;
use crate::design::robustness::Criterion;
use crate::rig::Rig;
use crate::simulate::view::Seen;

/// Voxels that can be hit in the published room, for which the published weights were made.
const PUBLISHED_REACHABLE: f64 = 35_048.0;

/// How the published weights are scaled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub(crate) enum WeightRule {
    /// As the same shares of the voxels that can be seen here.
    #[default]
    Shares,
    /// As they are, whatever the scene.
    Published,
}

/// The coefficients of J in one scene, or over several sites.
#[derive(Clone, Debug)]
pub(crate) struct SceneWeights {
    rule: WeightRule,
    pub weights: Weights,
    /// Voxels that can be seen, by site.
    pub by_site: Vec<u64>,
    /// Which J of several sites counts.
    pub criterion: Criterion,
}

impl SceneWeights {
    pub(crate) fn new(rule: WeightRule, observable: u64) -> Self {
        Self::of_sites(rule, vec![observable], Criterion::Expected)
    }

    /// Over sites with so many voxels that can be seen.
    pub(crate) fn of_sites(rule: WeightRule, by_site: Vec<u64>, criterion: Criterion) -> Self {
        let published = Weights::default();
        let scale = match rule {
            WeightRule::Published => 1.0,
            WeightRule::Shares => mean(&by_site) / PUBLISHED_REACHABLE,
        };
        let weights = Weights {
            sensor_cost: scale * published.sensor_cost,
            overlap_reward: scale * published.overlap_reward,
            overlap_too_little: scale * published.overlap_too_little,
            overlap_too_much: scale * published.overlap_too_much,
            angle_reward: scale * published.angle_reward,
            angle_penalty: scale * published.angle_penalty,
            ..published
        };
        Self { rule, weights, by_site, criterion }
    }

    /// The same with this weight of registration strength, in J, and this least conditioning; of one site.
    pub(crate) fn with_registration(mut self, (weight, least_conditioning): (f64, f64)) -> Self {
        (self.weights.registration, self.weights.least_conditioning) = (weight, least_conditioning);
        self
    }

    /// What a voxel of each site counts: by shares, a large site counts no more than a small one.
    pub(crate) fn scales(&self) -> Vec<f64> {
        let mean = mean(&self.by_site);
        let scale = |observable: &u64| match self.rule {
            WeightRule::Published => 1.0,
            WeightRule::Shares => mean / (*observable).max(1) as f64,
        };
        self.by_site.iter().map(scale).collect()
    }

    /// The terms of J of a rig: over several sites their mean, or those of the worst. `quality` where registration counts.
    pub(crate) fn terms(&self, rig: &Rig, seen: &Seen, quality: Option<&RegistrationQuality>) -> Terms {
        if seen.by_site.is_empty() {
            let registration = quality.map_or(0.0, |quality| self.weights.registration_term(quality));
            return Terms { registration, ..self.scaled_terms(rig, seen, 1.0) };
        }
        let sites = seen.by_site.iter().zip(self.scales());
        let terms: Vec<Terms> = sites.map(|(seen, scale)| self.scaled_terms(rig, seen, scale)).collect();
        if self.criterion == Criterion::Worst {
            let worst = terms.into_iter().min_by(|a, b| a.objective().total_cmp(&b.objective()));
            return worst.unwrap_or_else(|| self.scaled_terms(rig, seen, 1.0));
        }
        let mean = |term: fn(&Terms) -> f64| terms.iter().map(term).sum::<f64>() / terms.len() as f64;
        Terms {
            coverage: mean(|terms| terms.coverage),
            overlap: mean(|terms| terms.overlap),
            angular: mean(|terms| terms.angular),
            cost: mean(|terms| terms.cost),
            registration: 0.0,
        }
    }

    /// What the angles between the spin axes of a rig add to J.
    pub(crate) fn angular(&self, rig: &Rig) -> f64 {
        self.weights.angular_term(angle_deg(rig))
    }

    /// J of a rig at one of several sites, as a search of that site alone scores it.
    pub(crate) fn objective_at(&self, site: usize, rig: &Rig, seen: &Seen) -> f64 {
        Self::new(self.rule, self.by_site[site]).terms(rig, seen, None).objective()
    }

    fn scaled_terms(&self, rig: &Rig, seen: &Seen, scale: f64) -> Terms {
        let price = self.weights.sensor_cost * rig.sensors.len() as f64;
        let terms = score(&self.weights, seen, angle_deg(rig), price);
        Terms { coverage: scale * terms.coverage, ..terms }
    }
}

/// By site the voxels that can be seen: those that are `known`, and no fewer than a rig sees.
pub(crate) fn no_fewer_than_seen<'a>(mut known: Vec<u64>, seen: impl Iterator<Item = &'a Seen>) -> Vec<u64> {
    for seen in seen {
        for (known, seen) in known.iter_mut().zip(sites_of(seen)) {
            *known = (*known).max(seen.union as u64);
        }
    }
    known
}

/// Share of what can be seen that a rig sees; the mean over several sites. `observable` is by site.
pub(crate) fn share_of(seen: &Seen, observable: &[u64]) -> f64 {
    let sites = sites_of(seen);
    let share = |(seen, all): (&Seen, &u64)| seen.union / (*all).max(1) as f64;
    sites.iter().zip(observable).map(share).sum::<f64>() / sites.len() as f64
}

fn sites_of(seen: &Seen) -> &[Seen] {
    if seen.by_site.is_empty() { std::slice::from_ref(seen) } else { &seen.by_site }
}

fn mean(counts: &[u64]) -> f64 {
    counts.iter().sum::<u64>() as f64 / counts.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_of_the_published_room_are_the_published_weights() {
        assert_eq!(SceneWeights::new(WeightRule::Shares, 35_048).weights, Weights::default());
        let small = SceneWeights::new(WeightRule::Shares, 3_505).weights;
        assert!((small.sensor_cost - 200.0).abs() < 0.1 && small.overlap_max == 0.10);
        assert_eq!(SceneWeights::new(WeightRule::Published, 3_505).weights, Weights::default());
    }

    #[test]
    fn a_large_site_counts_as_much_as_a_small_one() {
        let seen = |union: f64, by_site: Vec<Seen>| Seen {
            per_sensor: vec![union],
            union,
            overlap: 0.0,
            sd_voxels: None,
            rays: 0,
            by_site,
        };
        let rig = Rig { sensors: Vec::new() };
        let sites = |unions: [f64; 2]| seen(0.0, unions.map(|union| seen(union, Vec::new())).to_vec());
        let of = |rule, criterion| SceneWeights::of_sites(rule, vec![1_000, 9_000], criterion);
        let coverage = |weights: &SceneWeights, unions| weights.terms(&rig, &sites(unions), None).coverage;
        let shares = of(WeightRule::Shares, Criterion::Expected);
        assert!((coverage(&shares, [600.0, 1_800.0]) - 0.4 * 5_000.0).abs() < 1e-9);
        assert!(
            (coverage(&of(WeightRule::Shares, Criterion::Worst), [600.0, 1_800.0]) - 1_000.0).abs() < 1e-9
        );
        assert_eq!(coverage(&of(WeightRule::Published, Criterion::Expected), [600.0, 1_800.0]), 1_200.0);
        assert!((share_of(&sites([600.0, 1_800.0]), &[1_000, 9_000]) - 0.4).abs() < 1e-12);
        // of one site J is that of the site
        let alone =
            SceneWeights::new(WeightRule::Shares, 9_000).terms(&rig, &seen(1_800.0, Vec::new()), None);
        let of_site = shares.objective_at(1, &rig, &sites([600.0, 1_800.0]).by_site[1]);
        assert_eq!(of_site, alone.objective());
    }
}
