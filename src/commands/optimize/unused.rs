//! What `optimize` refuses where it has no use for it.

use super::args::Args;
use crate::commands::{Context, ensure_consistent};
use crate::design::optimize::Kind;

/// What knows one sensor type only is refused where a rig may have several.
pub(crate) fn refuse_mixed(args: &Args, models: &[&str]) -> anyhow::Result<()> {
    if models.len() == 1 {
        return Ok(());
    }
    let models = models.join(" and ");
    let certify = "--certify bounds rigs of one sensor type, and";
    let export = "--export-published: the published layout has one sensor type, and";
    let words = |what: &str| format!("{what} {models} may be mixed: give one --preset");
    ensure_consistent([
        (args.certify.is_some(), words(certify)),
        (args.export_published.is_some(), words(export)),
    ])
}

/// What was typed for other methods than the one that searches, or for a judgement that is not asked for.
pub(crate) fn refuse_unused(
    args: &Args,
    context: Context,
    kind: Kind,
    [is_judged, is_refined]: [bool; 2],
) -> anyhow::Result<()> {
    if args.robust.is_none() && !is_judged {
        let why = "is about --robust and --final-look, and neither is asked for";
        context.ensure_not_typed(&["tolerance"], why)?;
    }
    if !is_refined {
        context.ensure_not_typed(&["regret"], "is about --fidelity auto, which is not asked for")?;
    }
    type Uses = fn(Kind) -> bool;
    let flags = [
        ("batch", Kind::has_a_model as Uses),
        ("acquisition", Kind::has_a_model),
        ("early_stop", Kind::has_a_rule),
    ];
    for (argument, uses) in flags {
        if !uses(kind) {
            let users: Vec<_> =
                Kind::ALL.iter().filter(|kind| uses(**kind)).map(|kind| kind.name()).collect();
            let (users, searches) = (users.join(", "), kind.name());
            let why = format!("is about --method {users}: {searches} has no use for it");
            context.ensure_not_typed(&[argument], why)?;
        }
    }
    Ok(())
}
