//! What a comparison comes to, and how to say it to somebody who builds rigs.

pub mod comparison;
pub mod judge;
mod mounts;
mod reason;
mod silent;
pub(crate) mod zero_offer;

use std::collections::BTreeMap;

use glam::DVec3;

use crate::base::numbers::number;
use crate::verify::compare::{Conflicts, Patches, RayClasses, Replayed, SECTORS};
use crate::world::local_origin::LocalOrigin;
use comparison::Comparison;
use mounts::{off, off_in_range, off_its_slot};
pub(crate) use reason::decide;

/// Share of the patches that must be recorded as predicted, by area. Healthy simulated recordings keep above it; where
/// the trajectory is worse, healthy runs of that trajectory decide.
const MATCH_IOU: f64 = 0.99;
/// Share of informative rays that must end where predicted. Undisturbed recordings keep above 0.95; a tilt of one degree
/// over ranges of ten metres leaves about 0.94 (measured in a simulated house).
const MATCH_AGREE_SHARE: f64 = 0.95;
/// What healthy runs do more often than this is healthy.
const RARE: f64 = 0.05;
/// Fewer rays than one revolution of the smallest sensor say nothing.
const LEAST_RAYS: u64 = 5_000;
/// Rays that the trajectory does not reach are worth a word from this share, per cent: first and last columns lie where it ends.
const UNPLACED_PERCENT: f64 = 0.1;
/// Contradicting cells are worth a word from this share of the cells that both know.
const CONFLICTS_MATTER: f64 = 0.02;

/// What is missing, where, and why most likely; `cell_m` is the edge of a cell where the scene is a map of such.
pub(crate) fn words(
    comparison: &Comparison,
    replayed: &Replayed,
    patches: Option<&Patches>,
    origin: LocalOrigin,
    cell_m: Option<f64>,
) -> Vec<String> {
    let mut words: Vec<String> = comparison.faults.iter().map(|fault| fault.words.clone()).collect();
    let is_in_another_frame = comparison.faults.is_empty() && reason::is_in_another_frame(comparison);
    if is_in_another_frame {
        words.push(format!(
            "trajectory and scene lie in different frames ({:.0} % of the rays agree): a SLAM or odometry trajectory begins at its \
             own origin; try --align",
            100.0 * comparison.agree_share().unwrap_or(0.0)
        ));
    }
    words.extend(off(comparison));
    for check in &comparison.mount {
        if let Some(why) = &check.cannot_tell {
            words.push(format!("pitch of {}: {why}", check.sensor));
        }
    }
    words.extend(comparison.mount.iter().filter_map(off_in_range));
    // what ends elsewhere in another scene says nothing about people, glass or dark surfaces
    let is_misread = comparison.faults.iter().any(|fault| fault.explained_share.is_some());
    let is_another = !is_misread && comparison.mount.iter().any(|check| check.is_of_another_scene);
    for (sensor, breakdown) in replayed.sensors.iter().zip(&replayed.breakdown) {
        let mut checks = comparison.mount.iter().filter(|check| check.sensor == sensor.name);
        let cause = match is_another {
            true => Some(ANOTHER_SCENE),
            false => checks.any(|check| !off_its_slot(check).is_empty()).then_some(ANOTHER_SLOT),
        };
        words.extend(of_rays(&sensor.name, &breakdown.total(), breakdown.strip.as_slice(), cause));
        if !is_another {
            words.extend(missing_returns(&sensor.name, &breakdown.total(), cell_m));
        }
    }
    if let Some((patches, surface)) = patches.zip(replayed.surface.as_ref()) {
        words.extend(missing(patches, origin, &surface.as_driven_patches, &surface.recorded_patches));
    }
    if comparison.faults.is_empty() && off(comparison).is_empty() && !is_another {
        words.extend(comparison.conflicts.iter().flat_map(contradictions));
    }
    words
}

/// Where recording and scene contradict each other, unless a sensor or its mount explains it.
fn contradictions(conflicts: &Conflicts) -> Vec<String> {
    let mut words = Vec::new();
    let known = (conflicts.agree + conflicts.gone.cells + conflicts.unforeseen.cells) as f64;
    for (found, what) in [
        (
            conflicts.gone,
            "which the scene fills, the recording looks through: something was removed, a door stood open, or the scene is wrong",
        ),
        (
            conflicts.unforeseen,
            "where the scene is empty, the recording hit something: furniture, people, or a scene that is not this one",
        ),
    ] {
        if let Some([x, y, z]) = found.around_m
            && found.cells as f64 > CONFLICTS_MATTER * known
        {
            words.push(format!(
                "{} cells of {} m, most around ({x:.0}, {y:.0}, {z:.0}), {what}",
                found.cells, conflicts.cell_m
            ));
        }
    }
    words
}

/// Returns that the scene promises and that never came.
fn missing_returns(name: &str, total: &RayClasses, cell_m: Option<f64>) -> Option<String> {
    let percent = 100.0 * total.drop as f64 / total.informative().max(1) as f64;
    (percent > 2.0).then(|| {
        let map = cell_m.map_or(String::new(), |cell_m| {
            format!(", or rays past the edge of something that fills a part of its cell of {cell_m} m (--map-voxel)")
        });
        format!(
            "{name}: {percent:.1} % of the predicted returns are missing: dark, wet or grazing surfaces, lost packets{map}"
        )
    })
}

/// Likeliest causes of all that ends elsewhere, where they are known.
const ANOTHER_SLOT: &str = "it sits elsewhere than its nominal mount; compare again with the mount that --corrected-mount writes (of a \
                            sensor with a measuring axis: with --axis-zero)";
const ANOTHER_SCENE: &str = "the scene is of another size, or another place";

/// What one sensor's rays hint at; where the likeliest cause of all that ends elsewhere is known, no other is named.
fn of_rays(name: &str, total: &RayClasses, strip: &[RayClasses], cause: Option<&str>) -> Vec<String> {
    let all = total.informative();
    let mut words = Vec::new();
    let share = 100.0 * total.unplaced as f64 / (all + total.nothing + total.unplaced).max(1) as f64;
    if share >= UNPLACED_PERCENT {
        words.push(format!(
            "{name}: {share:.1} % of the rays lie outside the trajectory's time (if the clocks differ, --time-offset search finds by how much)"
        ));
    }
    if all == 0 {
        return words;
    }
    let percent = |count: u64| 100.0 * count as f64 / all as f64;
    match cause {
        None => words.extend(ends_elsewhere(name, total, strip)),
        Some(cause) if percent(total.short + total.long) > 2.0 => words.push(format!(
            "{name}: {:.1} % of the rays end early and {:.1} % late: most likely because {cause}",
            percent(total.short),
            percent(total.long)
        )),
        Some(_) => {}
    }
    if percent(total.extra) > 2.0 {
        words.push(format!(
            "{name}: {:.1} % of the returns come where the scene has nothing: it has holes, or the place is another one",
            percent(total.extra)
        ));
    }
    words
}

/// Why rays of a sensor at its nominal mount end early or late.
fn ends_elsewhere(name: &str, total: &RayClasses, strip: &[RayClasses]) -> Vec<String> {
    let mut words = Vec::new();
    let percent = |count: u64| 100.0 * count as f64 / total.informative() as f64;
    // directions in which nearly every ray ends early: something that travels along
    let (mut blocked, mut sectors) = (0, [false; SECTORS]);
    for (place, cell) in strip.iter().enumerate() {
        if cell.informative() >= 20 && cell.short * 5 >= cell.informative() * 4 {
            blocked += cell.short;
            sectors[place % SECTORS] = true;
        }
    }
    if percent(blocked) > 0.5 {
        words.push(format!(
            "{name}: {:.1} % of the rays always end early in {}: the operator, a housing or something else that travels along",
            percent(blocked),
            sector_words(&sectors)
        ));
    }
    let short = total.short.saturating_sub(blocked);
    if percent(short) > 2.0 {
        words.push(format!(
            "{name}: {:.1} % of the rays end early: people, things that are not in the scene, or a wrong pose",
            percent(short)
        ));
    }
    if percent(total.long) > 2.0 {
        let cause = if total.long as f64 > 0.5 * short as f64 && short as f64 > 0.5 * total.long as f64 {
            "as many as end early, so the pose or the mount is off rather than the scene"
        } else {
            "glass, an opened door, or a scene that is not up to date"
        };
        words.push(format!("{name}: {:.1} % of the rays end late: {cause}", percent(total.long)));
    }
    words
}

fn sector_words(sectors: &[bool; SECTORS]) -> String {
    let width_deg = 360 / SECTORS;
    let marked = sectors.iter().filter(|marked| **marked).count();
    let first = (0..SECTORS).find(|at| sectors[*at] && !sectors[(*at + SECTORS - 1) % SECTORS]);
    let Some(first) = first else { return "all directions".into() };
    let mut last = first;
    while sectors[(last + 1) % SECTORS] && last - first + 1 < SECTORS {
        last += 1;
    }
    let rest = if marked > last - first + 1 { " and elsewhere" } else { "" };
    format!("encoder azimuths {} to {} degrees{rest}", first * width_deg, (last + 1) % SECTORS * width_deg)
}

/// Edge of a place that is worth naming, m.
const PLACE_M: f64 = 2.0;

/// Where something is missing.
#[derive(Default)]
struct Place {
    weight: u64,
    patches: Vec<usize>,
}

impl Place {
    /// The middle of the missing patch that lies most in the middle of all: their mean may lie off every surface.
    fn middle_m(&self, patches: &Patches) -> DVec3 {
        let weighted = |patch: &usize| f64::from(patches.weight(*patch)) * patches.middle_m(*patch);
        let mean_m = self.patches.iter().map(weighted).sum::<DVec3>() / self.weight.max(1) as f64;
        let middles_m = self.patches.iter().map(|patch| patches.middle_m(*patch));
        let nearest = middles_m.min_by(|a, b| a.distance(mean_m).total_cmp(&b.distance(mean_m)));
        nearest.unwrap_or(mean_m)
    }
}

/// The places where most is missing.
fn missing(patches: &Patches, origin: LocalOrigin, predicted: &[bool], recorded: &[bool]) -> Vec<String> {
    let mut places: BTreeMap<[i64; 3], Place> = Default::default();
    let (mut all, mut missed) = (0, 0);
    for patch in (0..patches.len()).filter(|patch| predicted[*patch] && patches.weight(*patch) > 0) {
        let weight = u64::from(patches.weight(patch));
        all += weight;
        if recorded[patch] {
            continue;
        }
        missed += weight;
        let place = places.entry(patches.block_of(patches.middle_m(patch), PLACE_M)).or_default();
        place.weight += weight;
        place.patches.push(patch);
    }
    if all == 0 || missed == 0 {
        return Vec::new();
    }
    let mut places: Vec<Place> = places.into_values().collect();
    places.sort_by_key(|place| std::cmp::Reverse(place.weight));
    let named: Vec<String> = places
        .iter()
        .take(3)
        .map(|place| {
            let at = origin.world(place.middle_m(patches));
            format!(
                "{:.0} % near ({:.1}, {:.1}, {:.1}) m",
                100.0 * place.weight as f64 / missed as f64,
                at.x,
                at.y,
                at.z
            )
        })
        .collect();
    let share = 100.0 * missed as f64 / all as f64;
    vec![format!("{} % of the predicted surface was not recorded: {}", number(share, 2), named.join(", "))]
}
