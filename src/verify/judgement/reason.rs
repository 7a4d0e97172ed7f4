//! One test decides, and is named with its figure.

use super::comparison::{Comparison, PART_SHARE, Reason, Verdict};
use super::mounts::off;
use super::{LEAST_RAYS, MATCH_AGREE_SHARE, MATCH_IOU, RARE};

/// Trajectory and scene lie in different frames below this share of agreeing rays: even of another place a tenth agrees.
const NO_FRAME_SHARE: f64 = 0.05;

/// Whether hardly any ray ends where the scene is.
pub(super) fn is_in_another_frame(comparison: &Comparison) -> bool {
    let rays: u64 = comparison.rays.values().map(|sensor| sensor.classes.informative()).sum();
    rays >= LEAST_RAYS && comparison.agree_share().is_some_and(|share| share < NO_FRAME_SHARE)
}

/// The verdict, and the test that decides it. One sensor that says nothing is enough not to call it a match. `cell_m`: edge of a
/// cell where the scene is a map of such.
pub(crate) fn decide(comparison: &Comparison, cell_m: Option<f64>) -> (Verdict, Reason) {
    let (verdict, reason) = decided(comparison);
    let is_of_map = ["rays_disagree", "surface_missing"].contains(&reason.code);
    let free_share = least_free_share(comparison);
    if let Some(cell_m) = cell_m
        && is_of_map
        && free_share >= Some(MATCH_AGREE_SHARE)
    {
        let values = [
            ("agree_share", least_agree_share(comparison)),
            ("needed_agree_share", Some(MATCH_AGREE_SHARE)),
            ("through_free_share", free_share),
            ("cell_m", Some(cell_m)),
        ];
        return (Verdict::CannotTell, Reason::new("map_too_coarse").with(values));
    }
    (verdict, reason)
}

/// Of the worse sensor.
fn least_agree_share(comparison: &Comparison) -> Option<f64> {
    comparison.rays.values().filter_map(|sensor| sensor.agree_share).reduce(f64::min)
}

/// Of the returns that end as predicted or early, the share that ends as predicted, of the worse sensor. A ray that goes on
/// past the edge of a cell, or meets what no ray of the map met, tells nothing about the recording; one that ends in a cell through
/// which the map's own rays went does.
fn least_free_share(comparison: &Comparison) -> Option<f64> {
    let shares = comparison.rays.values().filter_map(|sensor| {
        let all = sensor.classes.agree + sensor.classes.short;
        (all > 0).then(|| sensor.classes.agree as f64 / all as f64)
    });
    shares.reduce(f64::min)
}

fn decided(comparison: &Comparison) -> (Verdict, Reason) {
    if let Some(fault) = comparison.faults.first() {
        let shares = [("agree_share", fault.agree_share), ("explained_share", fault.explained_share)];
        return (Verdict::Differs, Reason::new(fault.name).with(shares));
    }
    let share = comparison.agree_share();
    if is_in_another_frame(comparison) {
        let values = [("agree_share", share), ("least_agree_share", Some(NO_FRAME_SHARE))];
        return (Verdict::Differs, Reason::new("another_frame").with(values));
    }
    let part = comparison.unplaced_share();
    let poorest = comparison.rays.values().map(|sensor| sensor.classes.informative()).min().unwrap_or(0);
    let rays = comparison.rays.values().map(|sensor| sensor.classes.informative()).max().unwrap_or(0);
    if rays < LEAST_RAYS {
        let code = if part >= PART_SHARE { "trajectory_covers_part" } else { "too_few_rays" };
        let values = [
            ("rays", Some(rays as f64)),
            ("needed_rays", Some(LEAST_RAYS as f64)),
            ("unplaced_share", Some(part)),
        ];
        return (Verdict::CannotTell, Reason::new(code).with(values));
    }
    if poorest < LEAST_RAYS {
        let values = [("rays", Some(poorest as f64)), ("needed_rays", Some(LEAST_RAYS as f64))];
        return (Verdict::Differs, Reason::new("sensor_with_few_rays").with(values));
    }
    if !off(comparison).is_empty() {
        return (Verdict::Differs, mount_reason(comparison));
    }
    let null = comparison.prediction.as_ref();
    // too few runs tell nothing: the least p value among them is above RARE
    let can_tell = null.is_some_and(|null| null.healthy.least_p_value() <= RARE);
    let as_healthy = |p_value: Option<f64>| can_tell && p_value.is_some_and(|p| p > RARE);
    let runs = null.map(|null| null.healthy.runs as f64);
    let rays_p = null.and_then(|null| null.agree_p_value);
    let of_healthy = |of_runs: Option<[f64; 2]>, extreme: &'static str| {
        let [mean, worst] = [0, 1].map(|at| of_runs.map(|runs| runs[at]));
        [("null_runs", runs), ("null_mean", mean), (extreme, worst)]
    };
    let worst = least_agree_share(comparison);
    if worst < Some(MATCH_AGREE_SHARE) && !as_healthy(rays_p) {
        let values = [("agree_share", worst), ("needed_agree_share", Some(MATCH_AGREE_SHARE))];
        let of_runs = of_healthy(null.and_then(|null| null.agree_share_of_runs), "null_least");
        let reason = Reason::new("rays_disagree").with(values).with(of_runs);
        return (Verdict::Differs, Reason { p_value: rays_p, ..reason });
    }
    if let Some(null) = null
        && can_tell
        && null.missed_share > Some(1.0 - MATCH_IOU)
        && null.missed_p_value <= Some(RARE)
    {
        let values = [("missed_share", null.missed_share), ("most_missed_share", Some(1.0 - MATCH_IOU))];
        let of_runs = of_healthy(null.missed_share_of_runs, "null_most");
        let reason = Reason::new("surface_missing").with(values).with(of_runs);
        return (Verdict::Differs, Reason { p_value: null.missed_p_value, ..reason });
    }
    let agreement = comparison.agreement.as_ref();
    let iou = agreement.and_then(|agreement| agreement.patches.agreement.iou);
    let patches_p = agreement.and_then(|agreement| agreement.p_value);
    if agreement.is_some() && iou < Some(MATCH_IOU) && !as_healthy(patches_p) {
        let values = [("iou", iou), ("needed_iou", Some(MATCH_IOU))];
        let of_runs = of_healthy(null.and_then(|null| null.iou_of_runs), "null_least");
        let reason = Reason::new("surface_missing").with(values).with(of_runs);
        return (Verdict::Differs, Reason { p_value: patches_p, ..reason });
    }
    if part >= PART_SHARE {
        let values = [("unplaced_share", Some(part)), ("most_unplaced_share", Some(PART_SHARE))];
        return (Verdict::CannotTell, Reason::new("trajectory_covers_part").with(values));
    }
    let missed_p = null.and_then(|null| null.missed_p_value);
    let least_p = [rays_p, patches_p, missed_p].into_iter().flatten().reduce(f64::min);
    let values = [("agree_share", worst), ("iou", iou), ("null_runs", runs)];
    (Verdict::Matches, Reason { p_value: least_p, ..Reason::new("as_predicted").with(values) })
}

/// The surest of what is off of the mounts.
fn mount_reason(comparison: &Comparison) -> Reason {
    let mut tests: Vec<(f64, f64, f64)> = Vec::new();
    for check in &comparison.mount {
        tests.extend(
            check.p_value.zip(check.tilt_error_deg).zip(check.u95_deg).map(|((p, tilt), u95)| (p, tilt, u95)),
        );
    }
    tests.extend(comparison.relative_tilt.as_ref().map(|tilt| (tilt.p_value, tilt.error_deg, tilt.u95_deg)));
    let surest = tests.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
    let values = [("tilt_error_deg", surest.map(|test| test.1)), ("u95_deg", surest.map(|test| test.2))];
    Reason { p_value: surest.map(|test| test.0), ..Reason::new("mount_off").with(values) }
}
