//! How the demo ends.

use std::path::Path;

use super::folder::REPORT_HTML;
use crate::commands::{Context, Outcome, output};
use crate::mock::demo::Document;
use crate::report::Report;
use crate::verify::judgement::comparison::Verdict;

pub(super) fn conclude(
    out: &Path,
    context: Context,
    (document, mut report): (&Document, Report),
) -> anyhow::Result<Outcome> {
    report.heading("");
    report.note(out.join(REPORT_HTML).display().to_string());
    output::print_result(context.json, document, &report, &document.problems)?;
    let fine = document.problems.is_empty() && document.compare.verdict == Verdict::Matches;
    Ok(if fine { Outcome::Done } else { Outcome::DataLost })
}
