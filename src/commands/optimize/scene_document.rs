//! What `optimize --scene` prints and writes.

use anyhow::Context as _;

use super::args::Args;
use crate::base::files;
use crate::commands::output;
use crate::design::scene_search::RigSpace;
use crate::report::scene_search::{Document, SiteSource, masters, page};
use crate::rig::{MountFile, Rig};
use crate::simulate::view::CastSites;

pub(super) fn write(args: &Args, rigs: &RigSpace, document: &Document, values: &[f64]) -> anyhow::Result<()> {
    if let Some(path) = &args.csv {
        files::write_whole(path, document.csv().as_bytes()).with_context(|| path.display().to_string())?;
    }
    let Some(path) = &args.out else { return Ok(()) };
    let mut file = MountFile::new(document.best.judged.sensors.clone());
    file.masters = Some(masters(rigs.mounts(values)));
    file.calibrations = rigs.calibrations(&rigs.rig(values));
    file.objective = Some(document.best.judged.objective);
    file.write(path)?;
    Ok(())
}

/// The page of `--report`.
pub(super) fn write_page(
    args: &Args,
    cast: &CastSites,
    document: &Document,
    best: &Rig,
    sources: &[SiteSource],
) -> anyhow::Result<()> {
    let Some(path) = &args.report else { return Ok(()) };
    page(document, best, cast, sources, &output::again())
        .write(path)
        .with_context(|| path.display().to_string())
}
