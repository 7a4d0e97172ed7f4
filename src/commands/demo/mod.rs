//! `outrigger demo`

use super::{Context, Outcome};

/// Arguments of `demo`.
#[derive(clap::Args, Debug)]
pub struct Args {}

/// Runs the verb.
pub fn run(_args: &Args, _context: Context) -> anyhow::Result<Outcome> {
    anyhow::bail!("not built yet")
}
