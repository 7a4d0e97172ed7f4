//! What `predict --ideal` says of a surface, and the files that it writes.

use std::time::Instant;

use anyhow::Context as _;

use super::Args;
use crate::commands::output;
use crate::report::completeness::{SurfaceDocument, Times, page};
use crate::report::seen::Document;
use crate::simulate::ideal::{IdealCoverage, IdealSensors};
use crate::world::local_origin::LocalOrigin;
use crate::world::scene::MeshSummary;
use crate::world::surface::{Completeness, MAIN_RANK, ObservableSurface, write_flags};

/// What is covered of the surface, with the single sensors to compare with, and the flags of its samples.
pub(super) fn surface_document(
    args: &Args,
    sensors: &IdealSensors,
    mesh: MeshSummary,
    surface: &ObservableSurface,
    (shares, flags): (IdealCoverage, Completeness),
    times: Times,
) -> (SurfaceDocument, Completeness) {
    let start = Instant::now();
    let baselines = args.baselines.then(|| sensors.baselines(surface, &shares));
    let times = Times { baselines_s: start.elapsed().as_secs_f64(), ..times };
    (SurfaceDocument::new(sensors, mesh, surface, shares, baselines, times), flags)
}

/// The files that were asked for.
pub(super) fn write(
    args: &Args,
    document: &Document,
    flags: Option<&Completeness>,
    sensors: &IdealSensors,
    surface: Option<&ObservableSurface>,
    origin: LocalOrigin,
) -> anyhow::Result<()> {
    if let (Some(path), Some(flags)) = (&args.ideal.covered_out, flags) {
        let written = write_flags(path, &flags.covered(MAIN_RANK));
        written.with_context(|| path.display().to_string())?;
    }
    if let (Some(path), Some(surface), Some(of_surface)) = (&args.report, surface, &document.surface) {
        let page = page(document, of_surface, sensors, surface, origin, &output::again());
        page.write(path).with_context(|| format!("report {} cannot be written", path.display()))?;
    }
    Ok(())
}
