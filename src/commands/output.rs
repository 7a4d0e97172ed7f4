//! What every verb prints the same way: the JSON document on stdout, errors on stderr.

use std::io::Write;

use anyhow::Context as _;

/// Prints one JSON document on stdout. A reader that went away (a closed pipe) is not an error.
pub fn print_json(document: &impl serde::Serialize) -> anyhow::Result<()> {
    let text = serde_json::to_string_pretty(document).context("the result does not fit JSON")?;
    print_text(&format!("{text}\n"))
}

/// Prints text on stdout. A reader that went away (a closed pipe) is not an error.
pub fn print_text(text: &str) -> anyhow::Result<()> {
    match std::io::stdout().write_all(text.as_bytes()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(error).context("stdout does not take the result")
        }
        _ => Ok(()),
    }
}

/// Prints a notice on stderr: done as asked, with something the user may not expect.
pub fn say_notice(notice: &str) {
    let _ = writeln!(std::io::stderr(), "outrigger: note: {notice}");
}

/// Prints an error and its causes on stderr.
pub fn say_error(error: &anyhow::Error) {
    let _ = writeln!(std::io::stderr(), "outrigger: {error:#}");
}
