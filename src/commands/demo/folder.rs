//! The demo's folder.

use std::path::Path;

use anyhow::{Context as _, bail};

/// Files the demo leaves in its folder.
pub(super) const REPORT_JSON: &str = "report.json";
pub(super) const REPORT_HTML: &str = "report.html";
pub(super) const SESSION: &str = "session";
/// Marks a folder as made by the demo, from its first moment on.
const MARK: &str = ".outrigger-demo";

/// The demo's folder: made, or cleared of an earlier demo; anybody else's files stay and are an error.
pub(super) fn prepare_folder(out: &Path) -> anyhow::Result<()> {
    let mark = out.join(MARK);
    let cannot = || format!("cannot use the folder {}", out.display());
    std::fs::create_dir_all(out).with_context(cannot)?;
    let is_empty = std::fs::read_dir(out).with_context(cannot)?.next().is_none();
    if !is_empty && !mark.is_file() {
        bail!("{} holds files that no demo made: give another folder with --out", out.display());
    }
    for name in [REPORT_HTML, REPORT_JSON] {
        match std::fs::remove_file(out.join(name)) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                return Err(error).with_context(cannot);
            }
            _ => {}
        }
    }
    match std::fs::remove_dir_all(out.join(SESSION)) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => return Err(error).with_context(cannot),
        _ => {}
    }
    std::fs::write(mark, "made by outrigger demo, which may clear this folder\n").with_context(cannot)
}
