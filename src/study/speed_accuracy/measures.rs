//! What a model gets wrong, and the table, charts and claims made of it.

use super::cases::Case;
use super::instructions;
use super::models::{AUTO_BUDGET, AUTO_TOLERANCE, Model};
use super::ranges::runs;
use super::truth::Truth;
use crate::base::statistics::{index_of_max, mean_and_deviation, rank_correlation, sorted};
use crate::report::chart::{self, NamedPoint, ScatterChart};
use crate::study::rows::{Row, list, number, text};
use crate::study::{Claim, Figure, Table, Verdict};

/// A model against the converged one.
#[derive(Clone, Debug)]
pub(super) struct Measures {
    model: String,
    rays: f64,
    wall_ms: f64,
    /// Instructions per mount, where they were counted.
    instructions: Option<f64>,
    /// Mean and standard deviation of its errors.
    bias: f64,
    spread: f64,
    /// Standard deviation among the best quarter of mounts, share of the best score.
    best_quarter_spread: f64,
    rank: Option<f64>,
    best_quarter_rank: Option<f64>,
    /// Score lost by choosing with it, share of the best.
    regret: f64,
    pitch_deg: f64,
    pitch_error_deg: f64,
    /// Score lost by choosing the pitch with it, share of the best.
    pitch_regret: f64,
    /// Pitches that are as good: those that the model says, those within [`ALIKE`] of the best for the converged one.
    alike_deg: Vec<f64>,
    /// The same loss by the worst of them, and whether the best pitch, or one of those, is among them.
    alike_regret: f64,
    is_best_alike: bool,
    /// Share of the mounts with a stated error that holds.
    bounds_hold: Option<f64>,
    is_reference: bool,
}

/// Share of the best score by which pitches may differ and be called as good.
const ALIKE: f64 = 1e-3;

impl Measures {
    /// Of every model of a case that scored all mounts.
    pub(crate) fn of_all(rows: &[&Row], truth: &Truth) -> Vec<Self> {
        let is_complete = |row: &&&Row| list(row, "scores").len() == truth.scores.len();
        let of = |row: &&Row| Self {
            instructions: instructions::of(rows, text(row, "model")),
            ..Self::of(row, truth)
        };
        rows.iter().filter(is_complete).map(of).collect()
    }

    fn of(row: &Row, truth: &Truth) -> Self {
        let (scores, true_scores) = (list(row, "scores"), &truth.scores);
        let best = true_scores[index_of_max(true_scores)];
        let errors: Vec<f64> = scores.iter().zip(true_scores).map(|(score, truth)| score - truth).collect();
        let (bias, spread) = mean_and_deviation(&errors);
        let mut order: Vec<usize> = (0..scores.len()).collect();
        order.sort_by(|a, b| true_scores[*b].total_cmp(&true_scores[*a]));
        order.truncate(scores.len().div_ceil(4));
        let quarter = |values: &[f64]| -> Vec<f64> { order.iter().map(|index| values[*index]).collect() };
        let pitches_deg = &truth.pitches_deg;
        let at = |name: &str, row: &Row| number(row, name).unwrap_or(0.0) as usize;
        let pitch = at("chosen_pitch", row);
        let is_reference = text(row, "model") == truth.model;
        let alike: Vec<usize> = match is_reference {
            true => (0..pitches_deg.len()).filter(|pitch| truth.loss(*pitch) <= ALIKE).collect(),
            false => list(row, "pitches_alike").into_iter().map(|pitch| pitch as usize).collect(),
        };
        let bounds = list(row, "bounds");
        let held = errors.iter().zip(&bounds).filter(|(error, bound)| error.abs() <= **bound).count();
        Self {
            model: text(row, "model").into(),
            rays: number(row, "rays_per_mount").unwrap_or(0.0),
            wall_ms: number(row, "wall_ms_per_mount").unwrap_or(f64::NAN),
            instructions: None,
            bias,
            spread,
            best_quarter_spread: mean_and_deviation(&quarter(&errors)).1 / best,
            rank: rank_correlation(&scores, true_scores),
            best_quarter_rank: rank_correlation(&quarter(&scores), &quarter(true_scores)),
            regret: (best - true_scores[at("chosen", row)]) / best,
            pitch_deg: pitches_deg[pitch],
            pitch_error_deg: truth.pitch_error_deg(pitch),
            pitch_regret: truth.loss(pitch),
            alike_deg: sorted(alike.iter().map(|pitch| pitches_deg[*pitch])),
            alike_regret: alike.iter().map(|pitch| truth.loss(*pitch)).fold(0.0, f64::max),
            is_best_alike: alike.iter().any(|pitch| truth.best.contains(pitch)),
            bounds_hold: (!bounds.is_empty()).then(|| held as f64 / bounds.len() as f64),
            is_reference,
        }
    }
}

fn percent(share: f64, decimals: usize) -> String {
    chart::number(100.0 * share, decimals)
}

pub(super) fn table(case: &Case, measures: &[Measures], truth: &Truth) -> Table {
    let note = format!(
        "Error: score less the converged one, mean and standard deviation over the random mounts. Best quarter: of the mounts \
         by the converged model. Regret: what the mount chosen with the model loses. As good: pitches that adaptive \
         fidelity judges to lose at most {} %; of the converged model those within {} % of the best. Instructions: per mount, \
         counted under valgrind (AVX2, one thread); - where none were counted, as without --count-instructions. Times are in \
         times.csv. {}",
        percent(AUTO_TOLERANCE, 2),
        percent(ALIKE, 1),
        truth.words()
    );
    let mut table = Table::new(
        case.name,
        &format!("Models against the converged one: {}", case.about),
        note.trim_end(),
        &[
            "model",
            "rays per mount",
            "instructions",
            "error",
            "sd",
            "sd, best quarter %",
            "rank correlation",
            "best quarter",
            "regret %",
            "best pitch",
            "pitch error",
            "pitch regret %",
            "as good",
            "bounds hold %",
        ],
    );
    let rank = |rank: Option<f64>| rank.map_or("-".into(), |rank| chart::number(rank, 3));
    table.rows = measures
        .iter()
        .map(|m| {
            vec![
                m.model.clone(),
                chart::number(m.rays, 0),
                m.instructions.map_or("-".into(), |count| chart::number(count, 0)),
                chart::number(m.bias, 1),
                chart::number(m.spread, 1),
                percent(m.best_quarter_spread, 3),
                rank(m.rank),
                rank(m.best_quarter_rank),
                percent(m.regret, 3),
                chart::number(m.pitch_deg, 0),
                chart::number(m.pitch_error_deg, 0),
                percent(m.pitch_regret, 3),
                runs(&m.alike_deg),
                m.bounds_hold.map_or("-".into(), |share| percent(share, 1)),
            ]
        })
        .collect();
    table
}

/// Error against rays and against time.
pub(super) fn charts(case: &Case, measures: &[Measures]) -> Vec<Figure> {
    let one = |what: &str, x_label: &str, cost: &dyn Fn(&Measures) -> f64| {
        let shown = measures.iter().filter(|m| !m.is_reference && cost(m).is_finite());
        let chart = ScatterChart {
            title: format!("Error against {what}: {}", case.about),
            x_label: x_label.into(),
            y_label: "sd of the error, best quarter of mounts, %".into(),
            points: shown
                .map(|m| NamedPoint {
                    name: m.model.clone(),
                    at: [cost(m), 100.0 * m.best_quarter_spread],
                    group: Model::group(&m.model),
                })
                .collect(),
        };
        Figure {
            svg: chart.svg(),
            caption: format!(
                "{}. Each point is a method to compute coverage; filled ones lie on the front: none costs less and errs less.",
                case.about
            ),
        }
    };
    let mut figures = vec![
        one("rays", "rays per mount", &|m| m.rays),
        one("time", "time per mount on one thread, ms", &|m| m.wall_ms),
    ];
    if measures.iter().any(|m| m.instructions.is_some()) {
        let count = |m: &Measures| m.instructions.unwrap_or(f64::NAN);
        figures.push(one("instructions", "instructions per mount", &count));
    }
    figures
}

/// What adaptive fidelity promises.
pub(super) fn claims(case: &Case, measures: &[Measures], truth: &Truth) -> Vec<Claim> {
    let Some(auto) = measures.iter().find(|m| m.model == "auto") else { return Vec::new() };
    let Some(published) = measures.iter().find(|m| m.model == "180 x 1 locked") else { return Vec::new() };
    let claim = |what: &str, holds: bool, because: String| Claim {
        claim: format!("{}: {what}", case.name),
        verdict: if holds { Verdict::Stands } else { Verdict::DoesNotStand },
        because,
    };
    let held = auto.bounds_hold.unwrap_or(0.0);
    vec![
        claim(
            "adaptive fidelity loses less than 0.1 % of J",
            auto.regret < 1e-3 && auto.pitch_regret < 1e-3,
            format!(
                "{} % over random mounts, {} % over pitches",
                percent(auto.regret, 3),
                percent(auto.pitch_regret, 3)
            ),
        ),
        claim(
            "its best pitch is within 1 degree",
            auto.pitch_error_deg <= 1.0,
            format!(
                "{} degrees, {} off{}",
                chart::number(auto.pitch_deg, 0),
                chart::number(auto.pitch_error_deg, 0),
                match truth.slack > 0.0 {
                    true => format!(" the nearest of {}. {}", truth.best_words(), truth.words()),
                    false => format!(". {}", truth.words()),
                }
            )
            .trim_end_matches(". ")
            .to_owned(),
        ),
        claim(
            "the best pitch is among those that it says are as good, and these are, within 0.1 %",
            auto.is_best_alike && auto.alike_regret <= ALIKE + truth.slack,
            format!(
                "as good by its word: {}, where the worst loses {} % and the best is{} among them{}",
                runs(&auto.alike_deg),
                percent(auto.alike_regret, 3),
                if auto.is_best_alike { "" } else { " not" },
                match truth.slack > 0.0 {
                    true => format!("; the converged model itself is sure to {} %", percent(truth.slack, 3)),
                    false => String::new(),
                }
            ),
        ),
        claim(
            "it costs at most 10 times the published sampling",
            auto.rays <= AUTO_BUDGET * published.rays,
            format!("{} times", chart::number(auto.rays / published.rays, 1)),
        ),
        claim(
            "its stated errors hold for at least 95 % of mounts",
            held >= 0.95,
            format!("for {} %", percent(held, 1)),
        ),
    ]
}
