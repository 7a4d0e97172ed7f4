//! A report as text for a terminal.

use super::{Block, Depth, Report, Section, is_of_numbers};

impl Report {
    /// Pictures and notices are left out, details unless `is_verbose`.
    pub(crate) fn text(&self, is_verbose: bool) -> String {
        let mut text = match &self.verdict {
            Some(verdict) => format!("{}: {}\n", verdict.label, self.summary),
            None if self.summary.is_empty() => String::new(),
            None => format!("{}\n", self.summary),
        };
        let is_shown = |section: &&Section| is_verbose || matches!(section.depth, Depth::Main);
        for section in self.sections.iter().filter(is_shown) {
            let blocks: String = section.blocks.iter().map(Block::text).collect();
            if blocks.is_empty() {
                continue;
            }
            if !section.heading.is_empty() {
                let gap = if text.is_empty() { "" } else { "\n" };
                text += &format!("{gap}{}\n", section.heading);
            }
            text += &blocks;
        }
        text
    }
}

impl Block {
    fn text(&self) -> String {
        match self {
            Self::Figures(figures) => {
                let width = figures.iter().map(|(label, _)| label.chars().count()).max().unwrap_or(0);
                figures.iter().map(|(label, value)| format!("{label:width$}  {value}\n")).collect()
            }
            Self::Table { header, rows } => table(header, rows),
            Self::Note(text) => format!("{text}\n"),
            Self::Findings(findings) => findings.iter().map(|text| format!("- {text}\n")).collect(),
            Self::Notices(_) | Self::Picture { .. } => String::new(),
        }
    }
}

/// Numbers flush right, everything else flush left.
fn table(header: &[String], rows: &[Vec<String>]) -> String {
    let lines = || std::iter::once(header).chain(rows.iter().map(Vec::as_slice));
    let width = |column: usize| {
        lines().filter_map(|line| line.get(column)).map(|cell| cell.chars().count()).max().unwrap_or(0)
    };
    let columns: Vec<(usize, bool)> =
        (0..header.len()).map(|column| (width(column), column > 0 && is_of_numbers(rows, column))).collect();
    let line = |cells: &[String]| {
        let cells = cells.iter().zip(&columns).map(|(cell, (width, is_right))| match is_right {
            true => format!("{cell:>width$}"),
            false => format!("{cell:width$}"),
        });
        format!("{}\n", cells.collect::<Vec<_>>().join("  ").trim_end())
    };
    lines().map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report() -> Report {
        let mut report = Report::new("Title", "Two sensors see 9 of 10 voxels.");
        report.figure("trajectory", "16.2 m");
        report.figure("J", "1,234.5");
        report.notices(&["for pages".into()]);
        report.heading("The sensors");
        let row = |name: &str, voxels: &str| vec![name.to_owned(), voxels.to_owned(), String::new()];
        report.table(&["sensor", "voxels", "note"], vec![row("right", "12"), row("l", "1,200")]);
        report.table(&["nothing"], Vec::new());
        report.fold("Details", "what few need");
        report.note("few need this");
        report
    }

    #[test]
    fn columns_line_up_and_numbers_stand_right() {
        let text = "Two sensors see 9 of 10 voxels.\ntrajectory  16.2 m\nJ           1,234.5\n\nThe sensors\n\
                    sensor  voxels  note\nright       12\nl        1,200\n";
        assert_eq!(report().text(false), text);
        assert_eq!(report().text(true), format!("{text}\nDetails\nfew need this\n"));
    }

    #[test]
    fn a_page_has_everything_and_escapes_it() {
        let mut report = report();
        report.findings(&["a < b".into()]);
        let html = report.html("outrigger predict --room '<b>'");
        for part in ["for pages", "few need this", "a &lt; b", "'&lt;b&gt;'", "<td>1,200</td>", "<dt>J</dt>"]
        {
            assert!(html.contains(part), "{part}: {html}");
        }
    }
}
