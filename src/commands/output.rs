//! What every verb prints alike: the JSON document on stdout, errors on stderr, the command to run again.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::Context as _;

use crate::base::files::check_place;
use crate::report::Report;

/// Prints one JSON document on stdout. A reader that went away (a closed pipe) is not an error.
pub(crate) fn print_json(document: &impl serde::Serialize) -> anyhow::Result<()> {
    let text = serde_json::to_string_pretty(document).context("the result does not fit JSON")?;
    print_text(&format!("{text}\n"))
}

/// Prints text on stdout. A reader that went away (a closed pipe) is not an error.
pub(crate) fn print_text(text: &str) -> anyhow::Result<()> {
    let mut stdout = std::io::stdout();
    match stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(error).context("stdout does not take the result")
        }
        _ => Ok(()),
    }
}

/// Prints a result: the document where JSON is asked for, otherwise its report; then what is odd or was lost.
pub(crate) fn print_result(
    is_json: bool,
    document: &impl serde::Serialize,
    report: &Report,
    problems: &[String],
) -> anyhow::Result<()> {
    if is_json {
        print_json(document)?;
    } else {
        print_text(&report.text(VERBOSE.load(Ordering::Relaxed)))?;
    }
    problems.iter().for_each(|problem| say_notice(problem));
    Ok(())
}

/// Writes a report as a page, where that was asked for.
pub(crate) fn write_page(path: Option<&Path>, report: &Report) -> anyhow::Result<()> {
    let Some(path) = path else { return Ok(()) };
    report.write(path, &again()).with_context(|| format!("cannot write the page {}", path.display()))
}

/// Looks, before the work is done, whether the files that were asked for could be written.
pub(crate) fn check_places<'a>(paths: impl IntoIterator<Item = &'a Option<PathBuf>>) -> anyhow::Result<()> {
    let mut asked = paths.into_iter().flatten();
    asked.try_for_each(|path| check_place(path).with_context(|| format!("cannot write {}", path.display())))
}

/// Whether notes and progress are shown, and whether each step is.
static QUIET: AtomicBool = AtomicBool::new(false);
static VERBOSE: AtomicBool = AtomicBool::new(false);

/// Sets once, as the program begins, what is shown on stderr.
pub(crate) fn set_loudness(verbose: bool, quiet: bool) {
    VERBOSE.store(verbose, Ordering::Relaxed);
    QUIET.store(quiet, Ordering::Relaxed);
}

pub(crate) fn is_quiet() -> bool {
    QUIET.load(Ordering::Relaxed)
}

/// Prints a step on stderr where that was asked for.
pub(crate) fn say_step(step: &str) {
    if VERBOSE.load(Ordering::Relaxed) {
        let _ = writeln!(std::io::stderr(), "outrigger: {step}");
    }
}

/// Prints a notice on stderr: done as asked, with something the user may not expect.
pub(crate) fn say_notice(notice: &str) {
    if !is_quiet() {
        let _ = writeln!(std::io::stderr(), "outrigger: note: {notice}");
    }
}

/// Prints an error and its causes on stderr.
pub(crate) fn say_error(error: &anyhow::Error) {
    let _ = writeln!(std::io::stderr(), "outrigger: {}", without_repetition(error));
}

/// An error and its causes, without those that an error before them contains already.
fn without_repetition(error: &anyhow::Error) -> String {
    let mut text = String::new();
    for cause in error.chain().map(ToString::to_string) {
        if !text.contains(&cause) {
            let separator = if text.is_empty() { "" } else { ": " };
            text = text + separator + &cause;
        }
    }
    text
}

/// The command line of this run, for a shell, with the environment that speaks into it.
pub(crate) fn again() -> String {
    const ABOUT_THE_RUN: [&str; 3] = ["OUTRIGGER_JSON", "OUTRIGGER_SHARED", "OUTRIGGER_STATISTICS"];
    let environment = std::env::vars_os().filter_map(|(name, value)| {
        let name = name.into_string().ok().filter(|name| name.starts_with("OUTRIGGER_"))?;
        let is_needed = !ABOUT_THE_RUN.contains(&name.as_str());
        is_needed.then(|| format!("{name}={}", quoted(&value.to_string_lossy())))
    });
    let arguments = std::env::args_os().skip(1).map(|argument| quoted(&argument.to_string_lossy()));
    environment.chain(["outrigger".into()]).chain(arguments).collect::<Vec<_>>().join(" ")
}

/// A word of a command line, for a shell.
pub(crate) fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./:=,+@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', "'\\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cause_is_printed_once() {
        let missing = || std::io::Error::new(std::io::ErrorKind::NotFound, "no such file");
        let twice = anyhow::Error::new(missing()).context("walk.tum: cannot be read: no such file");
        assert_eq!(without_repetition(&twice), "walk.tum: cannot be read: no such file");
        let once = anyhow::Error::new(missing()).context("walk.tum");
        assert_eq!(without_repetition(&once), "walk.tum: no such file");
    }

    #[test]
    fn words_of_a_command_survive_a_shell() {
        assert_eq!(quoted("0.1,0,0,25,0"), "0.1,0,0,25,0");
        assert_eq!(quoted("0,0,0,0,0;1,0,0,0,0"), "'0,0,0,0,0;1,0,0,0,0'");
        assert_eq!(quoted("it's"), "'it'\\''s'");
        assert_eq!(quoted(""), "''");
    }
}
