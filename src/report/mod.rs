//! Results as data, rendered as text for a terminal and as a page; their JSON documents are what serde makes of them.

use std::path::Path;

use crate::report::chart::{CellClass, CellMap};

mod above;
mod blind_spots;
pub mod chart;
pub(crate) mod comparison;
pub(crate) mod completeness;
mod counted;
pub(crate) mod decoding;
pub(crate) mod figures;
mod headlines;
mod html;
pub(crate) mod inspection;
pub(crate) mod mount;
pub(crate) mod orbit;
pub(crate) mod prediction;
pub(crate) mod readiness;
pub(crate) mod score;
pub(crate) mod scene_search;
pub(crate) mod search;
pub(crate) mod seen;
mod text;
mod unfold;
pub(crate) mod values;
pub(crate) mod viewer;

pub use above::FromAbove;
pub use blind_spots::BlindSpot;
pub(crate) use blind_spots::blind_spots;
pub(crate) use headlines::compared;
pub(crate) use unfold::{unfold_box, unfold_mount_box};

/// Blind spots that a document lists, the largest first.
pub(crate) const MAX_BLIND_SPOTS: usize = 10;

/// A result as data: a sentence and sections of figures, tables, notes, findings and pictures. Rendered as text for a
/// terminal ([`Report::text`]) and as a page ([`Report::html`]).
#[derive(Clone, Debug)]
pub(crate) struct Report {
    title: String,
    verdict: Option<Verdict>,
    /// What a reader takes away.
    summary: String,
    /// The first has no heading.
    sections: Vec<Section>,
}

/// Pass or not, and the figures that stand next to it on a page.
#[derive(Clone, Debug)]
struct Verdict {
    label: &'static str,
    /// Class of the label's colour.
    css: &'static str,
    headlines: [Headline; 3],
}

/// A number at the head of a page.
#[derive(Clone, Debug)]
struct Headline {
    label: String,
    /// With its unit and uncertainty.
    value: String,
    note: String,
}

#[derive(Clone, Debug)]
struct Section {
    heading: String,
    depth: Depth,
    blocks: Vec<Block>,
}

/// Who sees a section.
#[derive(Clone, Debug)]
enum Depth {
    Main,
    /// On a page; on a terminal with --verbose.
    Detail,
    /// The same; on a page it is folded behind its heading and this note.
    Folded(String),
}

#[derive(Clone, Debug)]
enum Block {
    /// Labels and values.
    Figures(Vec<(String, String)>),
    Table {
        header: Vec<String>,
        rows: Vec<Vec<String>>,
    },
    Note(String),
    /// The gravest first.
    Findings(Vec<String>),
    /// Findings of a page; a terminal has them as notices.
    Notices(Vec<String>),
    /// HTML without its caption and its end; for pages only.
    Picture {
        html: String,
        caption: String,
    },
}

impl Report {
    pub(crate) fn new(title: &str, summary: &str) -> Self {
        let opening = Section { heading: String::new(), depth: Depth::Main, blocks: Vec::new() };
        Self { title: title.into(), verdict: None, summary: summary.into(), sections: vec![opening] }
    }

    /// Begins a section.
    pub(crate) fn heading(&mut self, text: &str) {
        self.begin(text, Depth::Main);
    }

    /// Begins a section that a terminal shows with --verbose only.
    pub(crate) fn detail(&mut self, heading: &str) {
        self.begin(heading, Depth::Detail);
    }

    /// Begins a section that a page folds and a terminal shows with --verbose only. `note` stands next to the heading.
    pub(crate) fn fold(&mut self, heading: &str, note: &str) {
        self.begin(heading, Depth::Folded(note.into()));
    }

    fn begin(&mut self, heading: &str, depth: Depth) {
        self.sections.push(Section { heading: heading.into(), depth, blocks: Vec::new() });
    }

    fn push(&mut self, block: Block) {
        if let Some(section) = self.sections.last_mut() {
            section.blocks.push(block);
        }
    }

    /// A label and its value with unit and uncertainty; an empty label continues the figure before it.
    pub(crate) fn figure(&mut self, label: &str, value: impl Into<String>) {
        let figure = (label.to_owned(), value.into());
        let last = self.sections.last_mut().and_then(|section| section.blocks.last_mut());
        match last {
            Some(Block::Figures(figures)) => figures.push(figure),
            _ => self.push(Block::Figures(vec![figure])),
        }
    }

    /// The same for several.
    pub(crate) fn figures<L: AsRef<str>>(&mut self, figures: impl IntoIterator<Item = (L, String)>) {
        figures.into_iter().for_each(|(label, value)| self.figure(label.as_ref(), value));
    }

    /// Columns of numbers are set flush right; nothing without rows.
    pub(crate) fn table(&mut self, header: &[&str], rows: Vec<Vec<String>>) {
        if !rows.is_empty() {
            let header = header.iter().map(|cell| (*cell).to_owned()).collect();
            self.push(Block::Table { header, rows });
        }
    }

    pub(crate) fn note(&mut self, text: impl Into<String>) {
        self.push(Block::Note(text.into()));
    }

    /// The gravest first.
    pub(crate) fn findings(&mut self, findings: &[String]) {
        self.extend(findings, Block::Findings);
    }

    /// What is odd or was lost, which a terminal has as notices.
    pub(crate) fn notices(&mut self, notices: &[String]) {
        self.extend(notices, Block::Notices);
    }

    fn extend(&mut self, texts: &[String], block: fn(Vec<String>) -> Block) {
        if !texts.is_empty() {
            self.push(block(texts.to_vec()));
        }
    }

    /// A 3-D picture.
    pub(crate) fn orbit(&mut self, orbit: orbit::Orbit, caption: &str) {
        self.picture(orbit.html(), caption);
    }

    /// A chart made by [`crate::report::chart`], with its caption.
    pub(crate) fn chart(&mut self, svg: &str, caption: &str) {
        self.picture(format!("<figure><div class=\"scroll\">{svg}</div>"), caption);
    }

    /// Maps side by side, as many as fit the page, with a legend of the classes and a caption.
    pub(crate) fn maps(&mut self, label: &str, maps: &[CellMap], classes: &[CellClass], caption: &str) {
        self.picture(html::maps(label, maps, classes), caption);
    }

    fn picture(&mut self, html: String, caption: &str) {
        self.push(Block::Picture { html, caption: caption.into() });
    }

    /// Writes the page; it appears under its name only when whole. `made_by` is the command that makes it again.
    pub(crate) fn write(&self, path: &Path, made_by: &str) -> std::io::Result<()> {
        crate::base::files::write_whole(path, self.html(made_by).as_bytes())
    }
}

/// Longest cell that is still a number with its range and unit.
const LONGEST_NUMBER: usize = 32;

/// Whether a column holds numbers, which are set flush right.
fn is_of_numbers(rows: &[Vec<String>], column: usize) -> bool {
    rows.iter().filter_map(|row| row.get(column)).all(|cell| {
        let starts =
            cell.is_empty() || cell.starts_with(|c: char| c.is_ascii_digit() || c == '-' || c == '+');
        starts && cell.chars().count() <= LONGEST_NUMBER
    })
}
