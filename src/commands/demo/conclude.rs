//! How the demo ends.

use std::path::Path;

use super::folder::REPORT_HTML;
use crate::commands::{Context, Outcome, output};
use crate::mock::demo::Document;
use crate::verify::judgement::comparison::Verdict;

pub(super) fn conclude(out: &Path, context: Context, document: &Document) -> anyhow::Result<Outcome> {
    let counts = &document.compare.coverage;
    let iou = |iou: Option<f64>| iou.map_or("no IoU".into(), |iou| format!("IoU {iou:.5}"));
    let cells = iou(document.compare.model.iou);
    let patches = document.compare.agreement.as_ref().and_then(|agreement| agreement.patches.agreement.iou);
    if context.json {
        output::print_json(document)?;
    } else {
        output::print_text(&format!(
            "planned {}, as driven {}, recorded {} cells ({cells}); patches of surface as driven against recorded {}: {}\n{}\n",
            counts.planned,
            counts.as_driven,
            counts.recorded,
            iou(patches),
            match document.compare.verdict {
                Verdict::Matches => "matches",
                Verdict::Differs => "differs",
                Verdict::CannotTell => "cannot tell",
            },
            out.join(REPORT_HTML).display()
        ))?;
    }
    for problem in &document.problems {
        output::say_notice(problem);
    }
    let fine = document.problems.is_empty() && document.compare.verdict == Verdict::Matches;
    Ok(if fine { Outcome::Done } else { Outcome::DataLost })
}
