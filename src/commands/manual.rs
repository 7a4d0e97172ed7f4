//! `outrigger completions` and `outrigger man`: the command line described by itself.

mod keys;

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use clap::Command;

use super::{Outcome, help, output};

/// Arguments of `completions`.
#[derive(clap::Args, Debug)]
pub struct CompletionsArgs {
    /// Which shell.
    shell: clap_complete::Shell,
}

/// Prints a completion script.
pub(crate) fn completions(args: &CompletionsArgs) -> anyhow::Result<Outcome> {
    let mut script = Vec::new(); // what writes to stdout itself panics where its reader went away
    clap_complete::generate(args.shell, &mut help::command(), "outrigger", &mut script);
    output::print_text(&String::from_utf8(script)?)?;
    Ok(Outcome::Done)
}

/// Arguments of `man`.
#[derive(clap::Args, Debug)]
pub struct ManualArgs {
    /// The verb of the page, a verb within a verb behind it (`rig apply`, or `rig-apply`); without one the page of the
    /// program.
    #[arg(value_name = "VERB")]
    verbs: Vec<String>,
    /// Every key of rig.toml instead, as Markdown.
    #[arg(long, conflicts_with = "verbs")]
    keys: bool,
    /// Write every page into this folder instead, one file each, for packages.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["verbs", "keys"])]
    pages: Option<PathBuf>,
}

/// Prints a manual page in roff: outrigger(1), or outrigger-VERB(1).
pub(crate) fn manual(args: &ManualArgs) -> anyhow::Result<Outcome> {
    let mut program = help::command();
    if let Some(folder) = &args.pages {
        return pages(program, folder);
    }
    program.build(); // names verbs as they are called
    if args.keys {
        let page = keys::page(&program);
        output::print_text(&page)?;
        return Ok(Outcome::Done);
    }
    let page = page_of(&program, &args.verbs.join("-").replace(' ', "-"))?.clone();
    let mut text = Vec::new();
    clap_mangen::Man::new(page).render(&mut text)?;
    output::print_text(&String::from_utf8(text)?)?;
    Ok(Outcome::Done)
}

/// The verb of a page; a page names those of the verbs within a verb with a dash: outrigger-rig-apply(1).
fn page_of<'a>(above: &'a Command, name: &str) -> anyhow::Result<&'a Command> {
    if name.is_empty() {
        return Ok(above);
    }
    let within = above.get_subcommands().find_map(|verb| match name.strip_prefix(verb.get_name())? {
        "" => Some((verb, "")),
        rest => Some((verb, rest.strip_prefix('-')?)),
    });
    let (verb, rest) = within.ok_or_else(|| {
        let known: Vec<&str> = above.get_subcommands().map(Command::get_name).collect();
        crate::commands::wrong_usage(match &known[..] {
            [] => format!("no verb {name:?} within {}: it has none", above.get_name()),
            known => format!("no verb {name:?}: there are {}", known.join(", ")),
        })
    })?;
    page_of(verb, rest)
}

/// outrigger.1, outrigger-VERB.1 and so on into a folder.
fn pages(program: Command, folder: &Path) -> anyhow::Result<Outcome> {
    std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    clap_mangen::generate_to(program, folder)
        .with_context(|| format!("cannot write manual pages to {}", folder.display()))?;
    Ok(Outcome::Done)
}
