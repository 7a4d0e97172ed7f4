//! `outrigger mock rig`

use crate::commands::{Context, Outcome};

/// Arguments of `mock rig`.
#[derive(clap::Args, Debug)]
pub struct Args {}

/// Runs the verb.
pub fn run(_args: &Args, _context: Context) -> anyhow::Result<Outcome> {
    anyhow::bail!("not built yet")
}
