//! `outrigger completions` and `outrigger man`: the command line described by itself.

use anyhow::Context as _;
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

/// Arguments of `man`.
#[derive(clap::Args, Debug)]
pub struct ManualArgs {
    /// The verb whose page it is; without one the page of the program.
    verb: Option<String>,
}

/// Prints a manual page in roff: outrigger(1), or outrigger-VERB(1).
pub fn manual(args: &ManualArgs) -> anyhow::Result<Outcome> {
    let mut program = Cli::command();
    program.build(); // names verbs as they are called
    let page = match &args.verb {
        None => program,
        Some(verb) => {
            let verbs: Vec<&str> = program.get_subcommands().map(clap::Command::get_name).collect();
            let found = program.find_subcommand(verb);
            found.with_context(|| format!("no verb {verb:?}: there are {}", verbs.join(", ")))?.clone()
        }
    };
    clap_mangen::Man::new(page).render(&mut std::io::stdout())?;
    Ok(Outcome::Done)
}
