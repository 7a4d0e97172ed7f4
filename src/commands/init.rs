//! `outrigger init`: a commented `rig.toml` to begin with.

use std::path::PathBuf;

use anyhow::{Context as _, bail};

use super::{Context, Outcome, output};
use crate::base::files;

const TEMPLATE: &str = include_str!("init/rig.toml");

/// Arguments of `init`.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Folder of the new file, made where it is absent, or the file itself (*.toml).
    #[arg(default_value = ".", value_name = "DIR")]
    place: PathBuf,
    /// Overwrite a file that exists.
    #[arg(long)]
    force: bool,
}

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    let is_file = files::ending(&args.place) == "toml" && !args.place.is_dir();
    let path = if is_file { args.place.clone() } else { args.place.join("rig.toml") };
    let folder = files::folder_of(&path);
    std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    if path.exists() && !args.force {
        bail!("{} exists already; --force overwrites it", path.display());
    }
    files::write_whole(&path, TEMPLATE.as_bytes())
        .with_context(|| format!("cannot write {}", path.display()))?;
    if context.json {
        output::print_json(&serde_json::json!({ "written": path }))?;
    } else {
        output::print_text(&format!("{}\n", path.display()))?;
    }
    Ok(Outcome::Done)
}
