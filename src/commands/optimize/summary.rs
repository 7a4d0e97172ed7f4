//! What `optimize` says of the mount that it gives, on the screen and in the report.

use super::{Best, Document, Proved, StoppedBy, final_look, refine};
use crate::report::chart::number;

/// The document for people.
pub fn text(document: &Document) -> String {
    let Document { best: Best { evaluation, masters, master_models }, .. } = document;
    let mut text = format!(
        "{}, path {}, {} with seed {}\n\
         J              {:.2}; {}\n\
         voxels seen    {} of {} that can be hit\n\
         overlap        {:.2} %\n",
        document.preset,
        document.path.name(),
        document.method.name(),
        document.seed,
        evaluation.objective,
        search(document),
        evaluation.unique_voxels,
        evaluation.reachable_voxels,
        100.0 * evaluation.overlap_ratio,
    );
    text += "master       x m      y m      z m    pitch     roll  model\n";
    for (index, ([x_m, y_m, z_m, pitch_deg, roll_deg], model)) in
        masters.iter().zip(master_models).enumerate()
    {
        let number = index + 1;
        text += &format!("{number:6} {x_m:9.4}{y_m:9.4}{z_m:9.4}{pitch_deg:9.3}{roll_deg:9.3}  {model}\n");
    }
    for (title, words) in verdicts(document) {
        text += &format!("{title:<15}{words}\n");
    }
    text + &format!(
        "{} rays in {:.3} s: objective {:.3} s, search itself {:.3} s\n",
        document.rays, document.wall_s, document.objective_s, document.search_s
    )
}

/// Where the search found its highest J, and whether that is the J of the mount.
pub fn search(document: &Document) -> String {
    let stopped = match document.stopped_by {
        StoppedBy::Budget => "all used",
        StoppedBy::Converged => "then converged",
        StoppedBy::Interrupted => "then interrupted",
        StoppedBy::Rays => "then the rays were used up",
    };
    let is_looked_at_again = document.final_look.is_some() || document.fidelity.is_some();
    let found = match is_looked_at_again {
        true => "the best of those looked at again (below); the search's own favourite was found",
        false => "the highest, found",
    };
    format!("{found} at evaluation {} of {} ({stopped})", document.best_at, document.evaluations)
}

/// What else was found out about the mount, each with a title; a line that goes on has none.
pub fn verdicts(document: &Document) -> Vec<(&'static str, String)> {
    let evaluation = &document.best.evaluation;
    let mut verdicts: Vec<_> =
        evaluation.violations.iter().map(|violation| ("allowed", format!("no: {violation}"))).collect();
    if let Some(bound) = document.bound {
        let more = bound - evaluation.objective;
        verdicts.push((
            "bound",
            format!("no mount can score above {}, {} more than this one", number(bound, 1), number(more, 1)),
        ));
    }
    if let Some(Proved { certificate, wall_s }) = &document.certificate {
        let words = format!(
            "of one master: {:.1} more at most; {:.1} % of its space closed, {} regions in {wall_s:.1} s",
            certificate.gap,
            100.0 * certificate.closed_share,
            certificate.regions
        );
        verdicts.push(("proved", words));
    }
    verdicts.extend(document.fidelity.iter().flat_map(refine::Refined::verdicts));
    verdicts.extend(document.final_look.iter().flat_map(final_look::Looked::verdicts));
    if let Some(spread) = &document.robust {
        let words = format!(
            "J {:.1} on average, {:.1} at worst, standard deviation {:.1} over {} draws",
            spread.mean, spread.worst, spread.deviation, spread.draws
        );
        verdicts.push(("as built", words));
    }
    verdicts
}
