//! The answer for the best rig: its score, what others see, how sure that is, how flat it lies.

use serde::Serialize;

use super::built::{AsBuilt, ToleranceLoss};
use super::exact::{Exact, tilt_rad};
use super::search::SceneSearch;
use super::weights::{no_fewer_than_seen, share_of};
use crate::base::numbers::number;
use crate::design::objective::{Terms, angle_deg};
use crate::design::registration::RegistrationQuality;
use crate::rig::{Mount, Rig, SensorEntry};
use crate::simulate::baselines::{SCAN_PITCHES_DEG, level_mount};
use crate::simulate::view::Seen;
use crate::world::coverage::Coverage;

/// Loss of J that a flat range allows, as a share of the voxels seen.
pub(crate) const FLAT_LOSS: f64 = 0.001;
/// Starts of the revolutions, in columns, at which the winner is judged again.
const PHASES: [f64; 2] = [1.0 / 3.0, 2.0 / 3.0];
/// Of equals the least tilted wins: equal is what differs by this share of the deviation over starts of the revolutions. More would
/// cost as much as the search may lose.
const EQUAL_SHARE: f64 = 0.25;
/// How far from the winner a coordinate is tried, in sixtieths of its range.
const TRIED: [f64; 10] = [1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 18.0, 27.0, 40.0, 60.0];

/// A rig with every beam cast.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Judged {
    pub objective: f64,
    pub unique_voxels: u64,
    /// Of `Answer::observable_voxels`.
    pub observable_share: f64,
    pub overlap_ratio: f64,
    pub min_angle_deg: Option<f64>,
    pub per_sensor_voxels: Vec<u64>,
    pub terms: Terms,
    /// Where it counts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub registration: Option<RegistrationQuality>,
    pub sensors: Vec<SensorEntry>,
    /// Of several sites; what stands above is their mean, each scaled to the mean number of voxels that can be seen where the
    /// weights are shares.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub by_site: Vec<JudgedAtSite>,
}

/// The same rig at one of several sites, as a search of that site alone scores it.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct JudgedAtSite {
    pub objective: f64,
    pub unique_voxels: u64,
    pub observable_share: f64,
    pub overlap_ratio: f64,
}

/// Where one coordinate of the winner may be, the others staying, by the corrected model.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct FlatRange {
    pub coordinate: String,
    pub low: f64,
    pub high: f64,
}

/// A single sensor's pitch is chosen by every so many voxels.
const SPARSE_SINGLE: usize = 4;

/// What is seen of a site, voxel by voxel.
#[derive(Clone, Debug)]
pub(crate) struct CoveredSite {
    /// By the winner.
    pub coverage: Coverage,
    /// What can be seen from the trajectory, ascending: by the model, the winner, one sensor alone or the present rig.
    pub observable: Vec<usize>,
}

/// Everything about the winner.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Answer {
    /// By site the voxels that can be seen: how many are in `covered`, and no fewer than a rig that was cast sees.
    #[serde(skip)]
    pub observable_voxels: Vec<u64>,
    #[serde(skip)]
    pub covered: Vec<CoveredSite>,
    #[serde(skip)]
    pub best: Judged,
    /// The same sensors at the winner's positions, none tilted.
    pub level: Judged,
    /// The rig that is there now, where one was given.
    pub present: Option<Judged>,
    /// One of the sensors, level, in the middle of the winner's.
    pub level_single: Judged,
    /// The same at the pitch that is best by the model.
    pub best_single: Judged,
    /// Standard deviation of the winner's count over three starts of the revolutions, voxels.
    pub phase_sd_voxels: f64,
    /// Rigs that were judged and lie within two such deviations of the winner (of a difference).
    pub indistinguishable: Vec<Judged>,
    pub flat: Vec<FlatRange>,
    pub tolerance: ToleranceLoss,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub as_built: Option<AsBuilt>,
    /// Beams cast for all this.
    #[serde(skip)]
    pub rays: u64,
}

/// Angles between spin axes at which the published rule decides, not coverage, degrees.
const AT_THE_RULE_DEG: std::ops::Range<f64> = 29.0..31.5;

impl Answer {
    /// What the user should know before drilling.
    pub(crate) fn doubts(&self) -> Vec<String> {
        let mut doubts = Vec::new();
        let best = &self.best;
        let single = self.best_single.objective.max(self.level_single.objective);
        if best.sensors.len() > 1 && single > best.objective {
            doubts.push(format!(
                "one sensor alone scores J {}, more than the best of {} sensors (J {}): by these weights further sensors do not \
                 pay here",
                number(single, 1),
                best.sensors.len(),
                number(best.objective, 1)
            ));
        }
        if best.min_angle_deg.is_some_and(|angle_deg| AT_THE_RULE_DEG.contains(&angle_deg)) {
            doubts.push(
                "the best mount leans on the rule that spin axes be 30 degrees apart, not on coverage: smaller tilts cost J and \
                 hardly a voxel"
                    .into(),
            );
        }
        doubts.extend(self.tolerance.doubt(self.as_built.is_some()));
        doubts
    }
}

impl SceneSearch<'_> {
    /// The score of a rig that was cast.
    fn judged(
        &self,
        rig: &Rig,
        seen: &Seen,
        (terms, registration): (Terms, Option<RegistrationQuality>),
        observable: &[u64],
    ) -> Judged {
        let at_site = |(site, seen): (usize, &Seen)| JudgedAtSite {
            objective: self.weights.objective_at(site, rig, seen),
            unique_voxels: seen.union as u64,
            observable_share: share_of(seen, &observable[site..=site]),
            overlap_ratio: seen.overlap_ratio(),
        };
        Judged {
            objective: terms.objective(),
            unique_voxels: seen.union as u64,
            observable_share: share_of(seen, observable),
            overlap_ratio: seen.overlap_ratio(),
            min_angle_deg: angle_deg(rig),
            per_sensor_voxels: seen.per_sensor.iter().map(|count| *count as u64).collect(),
            terms,
            registration,
            sensors: rig.sensors.iter().map(SensorEntry::of).collect(),
            by_site: seen.by_site.iter().enumerate().map(at_site).collect(),
        }
    }

    /// What a rig sees at other starts of the revolutions. By thinned beams, where those searched, the counts scatter a little
    /// more than by all.
    fn phases(&self, rig: &Rig) -> Vec<Seen> {
        let cast = self.judges.while_searching();
        let see = |phase: &f64| cast.at_phase(*phase).see(std::slice::from_ref(rig));
        PHASES.iter().flat_map(see).collect()
    }

    /// Casts what the winner is compared with. Of rigs that the starts of the revolutions cannot tell from it the least tilted
    /// one takes its place, among them the same positions level.
    pub(crate) fn answer(&self, exact: &mut Vec<Exact>, present: Option<&Rig>) -> Option<Answer> {
        let cast = &self.judges.cast;
        let first = exact.first()?;
        let phases = self.phases(&first.rig);
        let searched = first.seen_thinned.as_ref().unwrap_or(&first.seen);
        let counts: Vec<f64> = phases.iter().chain([searched]).map(|seen| seen.union).collect();
        let mean = counts.iter().sum::<f64>() / counts.len() as f64;
        let square = counts.iter().map(|count| (count - mean).powi(2)).sum::<f64>();
        let phase_sd_voxels = (square / (counts.len() - 1) as f64).sqrt();
        let level_values = self.rigs.level(&first.values);
        let level_rig = self.rigs.rig(&level_values);
        let level_seen = cast.see(std::slice::from_ref(&level_rig)).pop()?;
        let level_scores = self.scores(std::slice::from_ref(&level_rig), 1);
        let level_exact =
            self.exact((vec![level_values], &level_scores), vec![level_rig], vec![level_seen]).pop()?;
        let level = level_exact.clone();
        if tilt_rad(&first.rig) > 0.0 {
            exact.push(level_exact);
        }
        prefer_least_tilted(exact, EQUAL_SHARE * phase_sd_voxels);
        let built_rays = self.build(&mut exact[0]);
        let winner_coverage = exact[0].coverage.take();
        let winner = &exact[0];
        let single = self.single(&winner.rig);
        let tilted = self.best_single(&single);
        let mut rigs = vec![single];
        rigs.extend(tilted);
        rigs.extend(present.cloned());
        let (seen, others): (Vec<Seen>, Vec<_>) = rigs.iter().map(|rig| cast.cover(rig)).unzip();
        let (winner_rays, of_winner) = match winner_coverage {
            Some(coverage) => (0, coverage),
            None => {
                let (seen, coverage) = cast.cover(&winner.rig);
                (seen.rays, coverage)
            }
        };
        let covered: Vec<CoveredSite> = of_winner
            .into_iter()
            .enumerate()
            .map(|(site, coverage)| {
                let others = others.iter().map(|other| &other[site]);
                let mut observable: Vec<usize> = self.model.views()[site].observable_cells().collect();
                others.chain([&coverage]).for_each(|coverage| observable.extend(coverage.union_cells()));
                observable.sort_unstable();
                observable.dedup();
                CoveredSite { coverage, observable }
            })
            .collect();
        let known = covered.iter().map(|site| site.observable.len() as u64).collect();
        let observable = no_fewer_than_seen(known, exact.iter().map(|exact| &exact.seen).chain(&seen));
        let judged_of = |exact: &Exact| {
            let scored = (exact.terms, exact.registration.clone());
            self.judged(&exact.rig, &exact.seen, scored, &observable)
        };
        let judged = |(rig, seen)| self.judged(rig, seen, self.terms(rig, seen), &observable);
        let mut judged: Vec<Judged> = rigs.iter().zip(&seen).map(judged).collect();
        let present = present.and_then(|_| judged.pop());
        let best_single = judged.pop()?;
        let level_single = judged.pop().unwrap_or_else(|| best_single.clone());
        // of a difference of two counts
        let near = 2.0 * std::f64::consts::SQRT_2 * phase_sd_voxels;
        let is_near = |other: &&Exact| {
            (winner.score() - other.score()).abs() <= near && other.violation <= winner.violation
        };
        let rays: u64 = seen.iter().chain(&phases).chain([&level.seen]).map(|seen| seen.rays).sum();
        Some(Answer {
            best: judged_of(winner),
            level: judged_of(&level),
            present,
            level_single,
            best_single,
            phase_sd_voxels,
            indistinguishable: exact[1..].iter().filter(is_near).map(judged_of).collect(),
            flat: self.flat_ranges(winner),
            tolerance: self.tolerance_loss(winner),
            observable_voxels: observable,
            covered,
            as_built: self.as_built(winner),
            rays: rays + winner_rays + built_rays,
        })
    }

    /// The strongest sensor of a rig alone, level, in its middle.
    fn single(&self, rig: &Rig) -> Rig {
        let mounts: Vec<Mount> = rig.sensors.iter().map(|sensor| sensor.mount).collect();
        let strongest = crate::simulate::baselines::strongest(rig);
        let mut sensor = rig.sensors[strongest].clone();
        sensor.mount = level_mount(&mounts);
        Rig { sensors: vec![sensor] }
    }

    /// The same at the pitch that is best by the model; none where that is level.
    fn best_single(&self, level: &Rig) -> Option<Rig> {
        let tilted = |pitch_deg: &f64| {
            let mut rig = level.clone();
            rig.sensors.iter_mut().for_each(|sensor| sensor.mount.pitch_rad = pitch_deg.to_radians());
            rig
        };
        let rigs: Vec<Rig> = SCAN_PITCHES_DEG.iter().map(tilted).collect();
        let seen = self.model.see_sparsely(&rigs, SPARSE_SINGLE);
        let better = |best: usize, next: usize| if seen[next].union > seen[best].union { next } else { best };
        let best = (0..rigs.len()).reduce(better)?;
        (SCAN_PITCHES_DEG[best] != 0.0).then(|| rigs[best].clone())
    }

    /// Each coordinate alone, by the model: step by step outward, as long as little is lost.
    fn flat_ranges(&self, winner: &Exact) -> Vec<FlatRange> {
        let variables = self.space().variables();
        let least = self.look_at(std::slice::from_ref(&winner.values))[0] - FLAT_LOSS * winner.seen.union;
        let mut flat: Vec<FlatRange> = variables
            .iter()
            .zip(&winner.values)
            .map(|(variable, value)| FlatRange {
                coordinate: variable.name.clone(),
                low: *value,
                high: *value,
            })
            .collect();
        let mut open: Vec<(usize, bool)> =
            (0..variables.len()).flat_map(|at| [(at, false), (at, true)]).collect();
        for sixtieths in TRIED {
            let value = |(at, is_up): (usize, bool)| {
                let step = sixtieths / 60.0 * (variables[at].high - variables[at].low);
                winner.values[at] + if is_up { step } else { -step }
            };
            open.retain(|end| (variables[end.0].low..=variables[end.0].high).contains(&value(*end)));
            let point = |end: &(usize, bool)| {
                let mut point = winner.values.clone();
                point[end.0] = value(*end);
                point
            };
            let mut scores = self.look_at(&open.iter().map(point).collect::<Vec<_>>()).into_iter();
            open.retain(|_| scores.next().is_some_and(|score| score >= least));
            for end in &open {
                let FlatRange { low, high, .. } = &mut flat[end.0];
                *if end.1 { high } else { low } = value(*end);
            }
        }
        flat
    }
}

/// The least tilted of the rigs that keep their distance and score within `near` of the first takes its place.
fn prefer_least_tilted(exact: &mut [Exact], near: f64) {
    let best = exact[0].score();
    let is_equal = |other: &Exact| best - other.score() <= near && other.violation == 0.0;
    let equals = (0..exact.len()).filter(|at| *at == 0 || is_equal(&exact[*at]));
    let least = equals.min_by(|a, b| tilt_rad(&exact[*a].rig).total_cmp(&tilt_rad(&exact[*b].rig)));
    exact[..=least.unwrap_or(0)].rotate_right(1);
}
