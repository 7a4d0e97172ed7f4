//! `outrigger completions` and `outrigger man`: the command line described by itself.

use clap::CommandFactory;

use super::{Cli, Outcome};

/// Arguments of `completions`.
#[derive(clap::Args, Debug)]
pub struct CompletionsArgs {
    /// Which shell.
    shell: clap_complete::Shell,
}

/// Prints a completion script.
pub fn completions(args: &CompletionsArgs) -> anyhow::Result<Outcome> {
    clap_complete::generate(args.shell, &mut Cli::command(), "outrigger", &mut std::io::stdout());
    Ok(Outcome::Done)
}

/// Prints the manual page in roff.
pub fn manual() -> anyhow::Result<Outcome> {
    clap_mangen::Man::new(Cli::command()).render(&mut std::io::stdout())?;
    Ok(Outcome::Done)
}
