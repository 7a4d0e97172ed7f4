//! `outrigger init`: a commented `rig.toml` to begin with.

use std::path::PathBuf;

use anyhow::{Context as _, bail};

use super::{Outcome, output};
use crate::files;

const TEMPLATE: &str = include_str!("init/rig.toml");

/// Arguments of `init`.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Folder of the new file; made where it is absent.
    #[arg(default_value = ".", value_name = "DIR")]
    dir: PathBuf,
    /// Overwrite a file that exists.
    #[arg(long)]
    force: bool,
}

/// Runs the verb.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    std::fs::create_dir_all(&args.dir).with_context(|| format!("cannot make {}", args.dir.display()))?;
    let path = args.dir.join("rig.toml");
    if path.exists() && !args.force {
        bail!("{} exists already; --force overwrites it", path.display());
    }
    files::write_whole(&path, TEMPLATE.as_bytes())
        .with_context(|| format!("cannot write {}", path.display()))?;
    output::print_text(&format!("{}\n", path.display()))?;
    Ok(Outcome::Done)
}
