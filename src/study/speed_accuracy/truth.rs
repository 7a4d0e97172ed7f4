//! Assumed worth of mounts: the converged model's, and how far that can be trusted.

use super::models::AGAIN;
use super::ranges::runs;
use crate::base::statistics::{index_of_max, mean_and_deviation, sorted};
use crate::report::chart;
use crate::study::rows::{Row, list, number, text};

/// Scores of the converged model.
#[derive(Clone, Debug)]
pub(super) struct Truth {
    /// Its name.
    pub model: String,
    /// Of the random mounts.
    pub scores: Vec<f64>,
    /// Of the line of pitches: where the best moves, the mean of both.
    pub pitch_scores: Vec<f64>,
    pub pitches_deg: Vec<f64>,
    /// Numbers of the best pitches: one, or where that moves all that it cannot tell from the best.
    pub best: Vec<usize>,
    /// Share of the best score by which the difference of two pitches may be wrong; zero where the best stays.
    pub slack: f64,
    /// The best pitches of the converged model and of the second one, degrees.
    bests_deg: Vec<f64>,
}

/// A best pitch that moves by more than this from one converged model to another is none that can be asked for.
const STAYS_DEG: f64 = 1.0;

impl Truth {
    /// The plain model with the most rays; none without models.
    pub(crate) fn of(rows: &[&Row]) -> Option<Self> {
        let rays = |row: &Row| number(row, "rays_per_mount").unwrap_or(0.0);
        let is_again = |row: &Row| text(row, "model").starts_with(AGAIN);
        let plain = rows
            .iter()
            .filter(|row| row.contains_key("scores") && text(row, "model") != "auto" && !is_again(row));
        let reference = plain.max_by(|a, b| rays(a).total_cmp(&rays(b)))?;
        let again = rows.iter().find(|row| is_again(row)).map(|row| list(row, "pitch_scores"));
        let pitches = list(reference, "pitch_scores");
        let pitches_deg = list(reference, "pitches_deg");
        let best = index_of_max(&pitches);
        let mut truth = Self {
            model: text(reference, "model").into(),
            scores: list(reference, "scores"),
            best: vec![best],
            slack: 0.0,
            bests_deg: vec![pitches_deg[best]],
            pitch_scores: pitches,
            pitches_deg,
        };
        if let Some(again) = again.filter(|again| again.len() == truth.pitch_scores.len()) {
            truth.compare_with(&again);
        }
        Some(truth)
    }

    /// Reckons with the line of pitches of another model that is as fine.
    fn compare_with(&mut self, again: &[f64]) {
        let other = self.pitches_deg[index_of_max(again)];
        self.bests_deg.push(other);
        if (other - self.bests_deg[0]).abs() <= STAYS_DEG {
            return;
        }
        let differences: Vec<f64> = self.pitch_scores.iter().zip(again).map(|(a, b)| a - b).collect();
        // the mean of two errs half as much as their difference, the difference of two such means more by the root of two
        let error = mean_and_deviation(&differences).1 / std::f64::consts::SQRT_2;
        self.pitch_scores.iter_mut().zip(again).for_each(|(score, again)| *score = 0.5 * (*score + again));
        let most = self.pitch_scores[index_of_max(&self.pitch_scores)];
        self.slack = 2.0 * error / most;
        let is_best = |pitch: &usize| self.pitch_scores[*pitch] >= most - 2.0 * error;
        self.best = (0..self.pitch_scores.len()).filter(is_best).collect();
    }

    /// Score that a pitch loses, share of the best.
    pub(crate) fn loss(&self, pitch: usize) -> f64 {
        let most = self.pitch_scores[index_of_max(&self.pitch_scores)];
        (most - self.pitch_scores[pitch]) / most
    }

    /// Degrees from a pitch to the nearest best one.
    pub(crate) fn pitch_error_deg(&self, pitch: usize) -> f64 {
        let off = |best: &usize| (self.pitches_deg[pitch] - self.pitches_deg[*best]).abs();
        self.best.iter().map(off).fold(f64::INFINITY, f64::min)
    }

    /// How sure it is, as a sentence; empty without a second model.
    pub(crate) fn words(&self) -> String {
        let [first, second] = self.bests_deg[..] else { return String::new() };
        let (first, second) = (chart::number(first, 0), chart::number(second, 0));
        if self.slack == 0.0 {
            return format!(
                "The converged model's best pitch is {first}, and {second} with its phase started elsewhere."
            );
        }
        format!(
            "The converged model's best pitch is {first}, but {second} with its phase started elsewhere: pitches are measured \
             against the mean of both, which tells two apart by {} % (two standard deviations); best within that are {}.",
            chart::number(100.0 * self.slack, 3),
            self.best_words()
        )
    }

    /// The best pitches.
    pub(crate) fn best_words(&self) -> String {
        runs(&sorted(self.best.iter().map(|pitch| self.pitches_deg[*pitch])))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn row(model: &str, rays: u32, pitch_scores: &[f64]) -> Row {
        let scores: &[f64] = if model.starts_with(AGAIN) { &[] } else { &[5.0, 7.0] };
        let row = json!({
            "model": model, "rays_per_mount": rays, "scores": scores, "pitch_scores": pitch_scores,
            "pitches_deg": [10.0, 11.0, 12.0, 13.0, 14.0],
        });
        row.as_object().cloned().unwrap()
    }

    fn truth(again: &[f64]) -> Truth {
        let rows = [
            row("180 x 1 locked", 1, &[9.0; 5]),
            row("reference 1800 x 8 free", 9, &[1000.0, 1010.0, 1002.0, 1009.0, 990.0]),
            row(&format!("{AGAIN} 1800 x 8 free"), 9, again),
            row("auto", 10, &[1.0; 5]),
        ];
        Truth::of(&rows.iter().collect::<Vec<_>>()).unwrap()
    }

    #[test]
    fn a_best_pitch_that_stays_is_the_one() {
        let truth = truth(&[1000.0, 1008.0, 1009.0, 1007.0, 990.0]);
        assert_eq!(
            (&truth.model[..], &truth.best[..], truth.slack),
            ("reference 1800 x 8 free", &[1][..], 0.0)
        );
        assert!((truth.loss(3) - 1.0 / 1010.0).abs() < 1e-12);
        assert_eq!((truth.pitch_error_deg(1), truth.pitch_error_deg(4)), (0.0, 3.0));
        assert!(truth.words().contains("is 11, and 12 with"), "{}", truth.words());
    }

    #[test]
    fn one_that_moves_is_a_set() {
        let truth = truth(&[1000.0, 1009.0, 1002.0, 1010.0, 990.0]);
        // differences 0, 1, 0, -1, 0: their deviation is 0.707, twice that over the root of two is 1
        assert!((truth.slack - 1.0 / 1009.5).abs() < 1e-12, "{}", truth.slack);
        assert_eq!(truth.best, [1, 3]);
        assert_eq!((truth.pitch_error_deg(3), truth.pitch_error_deg(0)), (0.0, 1.0));
        let words = truth.words();
        assert!(words.contains("is 11, but 13") && words.contains("best within that are 11, 13"), "{words}");
    }

    #[test]
    fn without_a_second_model_there_is_no_sentence() {
        let alone = row("720 x 8 free", 3, &[1.0, 2.0, 3.0, 2.0, 1.0]);
        let truth = Truth::of(&[&alone]).unwrap();
        assert_eq!((&truth.best[..], truth.words()), (&[2][..], String::new()));
        assert!(Truth::of(&[]).is_none());
    }
}
