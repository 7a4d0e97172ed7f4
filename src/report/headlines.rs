//! The head of a page about a comparison: verdict, three numbers, what to do.

use super::{Headline, Report, Verdict};
use crate::report::chart::{decimals_of, number};
use crate::verify::compare::SurfaceShare;
use crate::verify::judgement::comparison::{self, Comparison};

/// A page that opens with what a comparison comes to.
pub(crate) fn compared(title: &str, comparison: &Comparison, problems: &[String]) -> Report {
    let css = match comparison.verdict {
        comparison::Verdict::Matches => "pass",
        comparison::Verdict::Differs => "differs",
        comparison::Verdict::CannotTell => "open",
    };
    let advice = match (comparison.verdict, problems) {
        (comparison::Verdict::Matches, [_, ..]) => "Something is odd or was lost: read the findings first.",
        _ => comparison.advice(),
    };
    let sentence = format!("{}. {advice}", comparison.headline());
    let verdict = Verdict { label: comparison.verdict.label(), css, headlines: headlines(comparison) };
    Report { verdict: Some(verdict), ..Report::new(title, &sentence) }
}

/// Predicted and recorded share of the surface, and how far the worst mount is off.
fn headlines(comparison: &Comparison) -> [Headline; 3] {
    let share = |label: &str, share: Option<&SurfaceShare>| Headline {
        label: label.to_owned(),
        value: share
            .and_then(|share| Some(with_u95(100.0 * share.of_observable?, 100.0 * share.u95?, " %")))
            .unwrap_or_else(|| "unknown".into()),
        note: "of the surface that is visible from the path".into(),
    };
    let surface = comparison.surface.as_ref();
    let errors =
        comparison.mount.iter().filter_map(|check| Some((check, check.tilt_error_deg?, check.u95_deg?)));
    let worst = errors.max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
    [
        share("Predicted", surface.map(|surface| &surface.as_driven)),
        share("Recorded", surface.map(|surface| &surface.recorded)),
        Headline {
            label: "Largest mount error".into(),
            value: worst.map_or("unknown".into(), |(_, error, u95)| with_u95(error, u95, "°")),
            note: worst.map_or("no pitch is observable here".into(), |(check, ..)| {
                format!("pitch of {}", check.sensor)
            }),
        },
    ]
}

/// A value with half of its 95 % interval, in the digits that this leaves.
fn with_u95(value: f64, u95: f64, unit: &str) -> String {
    let digits = decimals_of(u95);
    format!("{} ± {u95:.digits$}{unit}", number(value, digits))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_follow_the_uncertainty() {
        assert_eq!(with_u95(81.912_34, 1.4, " %"), "81.9 ± 1.4 %");
        assert_eq!(with_u95(1.987_65, 0.123, "°"), "1.99 ± 0.12°");
        assert_eq!(with_u95(63.04, 22.0, " %"), "63 ± 22 %");
        assert_eq!(with_u95(100.0, 0.0, " %"), "100.00 ± 0.00 %");
    }
}
