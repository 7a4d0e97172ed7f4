//! What `optimize --scene` writes.

use anyhow::Context as _;

use super::args::Args;
use crate::base::files;
use crate::design::scene_search::RigSpace;
use crate::report::scene_search::{Document, masters};
use crate::rig::MountFile;

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
