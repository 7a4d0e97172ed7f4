//! The published claims, each decided by numbers of the rows.

use super::super::rows::{chosen, number, numbers};
use super::super::{Claim, Row, Spread, Verdict};
use super::data::TABLE_3;
use super::tables::{median_after, of_roll, pitches_deg, spread};
use crate::design::optimize::Kind;
use crate::report::chart;

const PRESETS: [&str; 2] = ["paper-os1-64", "paper-vlp-16"];

pub(crate) fn claims(rows: &[Row]) -> Vec<Claim> {
    let mut claims = Vec::new();
    for row in &TABLE_3 {
        claims.extend(table_3(rows, row.preset, row.method, row.objective));
    }
    for preset in PRESETS {
        claims.extend(similar_values(rows, preset));
        claims.extend(bayesian_is_frugal(rows, preset));
        claims.extend(two_sensors_at_every_price(rows, preset));
        claims.extend(pitch_is_invariant(rows, preset));
        claims.extend(free_roll_is_worse(rows, preset));
        claims.extend(two_is_the_structure(rows, preset));
    }
    claims
}

fn n(value: f64) -> String {
    chart::number(value, 1)
}

fn of_method<'a>(rows: &'a [Row], preset: &str, method: Kind) -> Vec<&'a Row> {
    chosen(rows, &[("part", "table 3"), ("preset", preset), ("method", method.name())])
}

/// A published number among those of our seeds is a number such a run gives.
fn table_3(rows: &[Row], preset: &str, method: Kind, published: f64) -> Option<Claim> {
    let ours = spread(&of_method(rows, preset, method), "j_noisy", 1.0)?;
    let is_inside = (ours.min..=ours.max).contains(&published);
    let verdict = match (is_inside, ours.count) {
        (true, _) => Verdict::Stands,
        (false, count) if count < 5 => Verdict::CannotTell,
        (false, _) => Verdict::DoesNotStand,
    };
    let place = if is_inside { "inside" } else { "outside" };
    Some(Claim {
        claim: format!("Table 3: {} reaches J {} on {preset}", method.name(), n(published)),
        verdict,
        because: format!(
            "{} seeds, scored with noisy rays: median {}, from {} to {}; the published value lies {place}",
            ours.count,
            n(ours.median),
            n(ours.min),
            n(ours.max)
        ),
    })
}

fn similar_values(rows: &[Row], preset: &str) -> Option<Claim> {
    let methods = [Kind::Bayesian, Kind::Genetic, Kind::ParticleSwarm];
    let spreads: Vec<Spread> =
        methods.iter().filter_map(|m| spread(&of_method(rows, preset, *m), "j_noisy", 1.0)).collect();
    if spreads.len() < 3 {
        return None;
    }
    let max = spreads.iter().map(|s| s.median).fold(f64::NEG_INFINITY, f64::max);
    let least = spreads.iter().map(|s| s.median).fold(f64::INFINITY, f64::min);
    let gap = max - least;
    let within = spreads.iter().map(|s| s.high - s.low).fold(0.0, f64::max);
    Some(Claim {
        claim: format!("Table 3: all three methods reach similar final J on {preset}"),
        verdict: if gap < within || gap < 0.005 * max { Verdict::Stands } else { Verdict::DoesNotStand },
        because: format!(
            "medians lie {} apart ({:.2} %); one method's seeds spread over {} (quartiles)",
            n(gap),
            100.0 * gap / max.abs(),
            n(within)
        ),
    })
}

/// At the evaluations that BO was published with, how far GA and PSO are, and when they pass it.
fn bayesian_is_frugal(rows: &[Row], preset: &str) -> Option<Claim> {
    let at = if preset == "paper-os1-64" { 56.0 } else { 80.0 };
    let bayesian = of_method(rows, preset, Kind::Bayesian);
    let final_median = spread(&bayesian, "j", 1.0)?.median;
    let value = median_after(&bayesian, at)?;
    let others = [Kind::Genetic, Kind::ParticleSwarm].map(|m| median_after(&of_method(rows, preset, m), at));
    let [genetic, swarm] = [others[0]?, others[1]?];
    Some(Claim {
        claim: format!(
            "Figure 10: BO is near its best after {at:.0} evaluations on {preset}, GA and PSO need thousands"
        ),
        verdict: if value > genetic.max(swarm) { Verdict::Stands } else { Verdict::DoesNotStand },
        because: format!(
            "medians after {at:.0} evaluations: BO {}, GA {}, PSO {}; BO ends at {}",
            n(value),
            n(genetic),
            n(swarm),
            n(final_median)
        ),
    })
}

fn two_sensors_at_every_price(rows: &[Row], preset: &str) -> Option<Claim> {
    let best = chosen(rows, &[("part", "lambda, converged"), ("preset", preset)]);
    let counts = numbers(&best, "sensors");
    let two = counts.iter().filter(|count| **count == 2.0).count();
    (!counts.is_empty()).then(|| Claim {
        claim: format!("Section 4.4: two sensors are best at lambda 1600, 2000 and 2400 on {preset}"),
        verdict: if two == counts.len() { Verdict::Stands } else { Verdict::DoesNotStand },
        because: format!(
            "{two} of {} converged searches end with two; but mirroring leaves no choice below two (see the study sensor-count)",
            counts.len()
        ),
    })
}

/// The pitch at other prices against that at 2000: with two sensors the price is a constant, so only chance can move it.
fn pitch_is_invariant(rows: &[Row], preset: &str) -> Option<Claim> {
    let all = chosen(rows, &[("part", "lambda"), ("preset", preset)]);
    let pitch = |price: f64| {
        let of: Vec<&Row> = all.iter().filter(|row| number(row, "lambda") == Some(price)).copied().collect();
        Spread::of(&pitches_deg(&of))
    };
    let (low, middle, high) = (pitch(1600.0)?, pitch(2000.0)?, pitch(2400.0)?);
    let moved = (low.median - middle.median).abs().max((high.median - middle.median).abs());
    let by_seed = middle.max - middle.min;
    let verdict = match by_seed {
        spread if middle.count > 1 && spread > 1.0 => Verdict::DoesNotStand,
        _ if middle.count < 2 => Verdict::CannotTell,
        _ => Verdict::Stands,
    };
    Some(Claim {
        claim: format!("Section 4.4: the pitch found on {preset} says how sensitive it is to lambda"),
        verdict,
        because: format!(
            "the median pitch moves by {moved:.2} degrees with the price, but by {by_seed:.2} from seed to seed at one price: with \
             two sensors lambda only shifts J by a constant"
        ),
    })
}

fn free_roll_is_worse(rows: &[Row], preset: &str) -> Option<Claim> {
    let best = |roll| spread(&of_roll(rows, "table 8, converged", preset, roll), "j", 1.0);
    let (fixed, free) = (best(Some(0.0))?, best(None)?);
    let published = |roll| spread(&of_roll(rows, "table 8", preset, roll), "j", 1.0).map(|s| s.median);
    let (bo_fixed, bo_free) = (published(Some(0.0))?, published(None)?);
    // a fixed roll is one point of the free one: free can only be worse where a search has not converged
    Some(Claim {
        claim: format!("Table 8: a free roll lowers J on {preset}"),
        verdict: if free.max >= fixed.max { Verdict::DoesNotStand } else { Verdict::CannotTell },
        because: format!(
            "best known J: roll 0 {}, free {} (medians {} and {}); stopped as published: {} and {}. Roll 0 lies within the free \
             space, so a lower J only says that the search had not converged",
            n(fixed.max),
            n(free.max),
            n(fixed.median),
            n(free.median),
            n(bo_fixed),
            n(bo_free)
        ),
    })
}

/// The structure under the path that the text describes.
fn two_is_the_structure(rows: &[Row], preset: &str) -> Option<Claim> {
    let forward = chosen(rows, &[("part", "path forward"), ("preset", preset)]);
    let best = forward
        .iter()
        .max_by(|a, b| number(a, "j").unwrap_or(0.0).total_cmp(&number(b, "j").unwrap_or(0.0)))?;
    let sensors = number(best, "sensors")?;
    Some(Claim {
        claim: format!(
            "Conclusions: the optimum of {preset} is a dual-sensor configuration (along the path of the text)"
        ),
        verdict: if sensors == 2.0 { Verdict::Stands } else { Verdict::DoesNotStand },
        because: format!(
            "along the platform's forward axis, roll 0, the best of {} searches has {sensors:.0} sensors and J {}",
            forward.len(),
            n(number(best, "j")?)
        ),
    })
}
