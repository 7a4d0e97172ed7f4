//! One self-contained HTML page and one JSON document per run: no outside request, readable in light and dark.

use std::fmt::Write as _;
use std::path::Path;

use crate::report::chart::{CellClass, CellMap, cell_map_svg, escape};

mod above;
mod blind_spots;
pub mod chart;
pub(crate) mod comparison;
pub(crate) mod completeness;
pub(crate) mod figures;
mod headlines;
pub(crate) mod orbit;
pub(crate) mod prediction;
pub(crate) mod score;
pub(crate) mod scene_search;
pub(crate) mod search;
pub(crate) mod seen;
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

/// A page, built from top to bottom.
#[derive(Clone, Debug)]
pub struct Report {
    title: String,
    body: String,
    /// Command that makes every figure again.
    made_by: String,
    has_orbit: bool,
    is_in_fold: bool,
}

/// A number at the head of a page.
struct Headline {
    label: String,
    /// With its unit and uncertainty.
    value: String,
    note: String,
}

impl Report {
    /// An empty page; `summary` is the one sentence a reader takes away, `made_by` the command that makes it again.
    pub(crate) fn new(title: &str, summary: &str, made_by: &str) -> Self {
        let body = format!("<h1>{}</h1><p class=\"summary\">{}</p>", escape(title), escape(summary));
        Self {
            title: title.to_owned(),
            body,
            made_by: made_by.to_owned(),
            has_orbit: false,
            is_in_fold: false,
        }
    }

    /// A page that opens with a verdict: a badge of a class of colour, its numbers, and what to do.
    fn with_verdict(
        title: &str,
        (badge, css): (&str, &str),
        headlines: &[Headline],
        advice: &str,
        made_by: &str,
    ) -> Self {
        let mut report = Self::new(title, advice, made_by);
        let mut body = format!(
            "<h1>{} <span class=\"badge {css}\">{}</span></h1><dl class=\"headlines\">",
            escape(title),
            escape(badge)
        );
        for Headline { label, value, note } in headlines {
            let _ = write!(
                body,
                "<div><dt>{}</dt><dd>{}</dd><dd class=\"note\">{}</dd></div>",
                escape(label),
                escape(value),
                escape(note)
            );
        }
        let _ = write!(body, "</dl><p class=\"summary\">{}</p>", escape(advice));
        report.body = body;
        report
    }

    /// A section; ends a fold.
    pub(crate) fn heading(&mut self, text: &str) {
        self.end_fold();
        let _ = write!(self.body, "<h2>{}</h2>", escape(text));
    }

    /// A section that a reader opens: details, or what is as it should be. `note` stands next to the heading.
    pub(crate) fn fold(&mut self, heading: &str, note: &str) {
        self.end_fold();
        let _ = write!(
            self.body,
            "<details><summary><h2>{}</h2> <span class=\"note\">{}</span></summary>",
            escape(heading),
            escape(note)
        );
        self.is_in_fold = true;
    }

    fn end_fold(&mut self) {
        if std::mem::take(&mut self.is_in_fold) {
            self.body.push_str("</details>");
        }
    }

    /// Findings, the gravest first.
    pub(crate) fn findings<'a>(&mut self, findings: impl Iterator<Item = &'a str>) {
        let items: String = findings.map(|finding| format!("<li>{}</li>", escape(finding))).collect();
        if !items.is_empty() {
            let _ = write!(self.body, "<ol class=\"findings\">{items}</ol>");
        }
    }

    /// A 3-D picture.
    pub(crate) fn orbit(&mut self, orbit: orbit::Orbit, caption: &str) {
        self.has_orbit = true;
        self.body += &orbit.html();
        self.close_figure(caption);
    }

    pub(crate) fn paragraph(&mut self, text: &str) {
        let _ = write!(self.body, "<p>{}</p>", escape(text));
    }

    /// A table; the first column is text, numbers stand right.
    pub(crate) fn table(&mut self, header: &[&str], rows: &[Vec<String>]) {
        self.body.push_str("<div class=\"scroll table\"><table><thead><tr>");
        let classes: Vec<&str> = (0..header.len())
            .map(|column| if is_of_numbers(rows, column) { "" } else { " class=\"words\"" })
            .collect();
        for (cell, class) in header.iter().zip(&classes) {
            let _ = write!(self.body, "<th{class}>{}</th>", escape(cell));
        }
        self.body.push_str("</tr></thead><tbody>");
        for row in rows {
            self.body.push_str("<tr>");
            for (column, cell) in row.iter().enumerate() {
                let class = classes.get(column).unwrap_or(&"");
                let _ = write!(self.body, "<td{class}>{}</td>", escape(cell));
            }
            self.body.push_str("</tr>");
        }
        self.body.push_str("</tbody></table></div>");
    }

    /// A chart made by [`crate::report::chart`], with its caption.
    pub(crate) fn figure(&mut self, svg: &str, caption: &str) {
        let _ = write!(self.body, "<figure><div class=\"scroll\">{svg}</div>");
        self.close_figure(caption);
    }

    /// Maps side by side, as many as fit the page, with a legend of the classes and a caption.
    pub(crate) fn maps(&mut self, label: &str, maps: &[CellMap], classes: &[CellClass], caption: &str) {
        self.body.push_str("<figure><div class=\"maps\">");
        for map in &maps.iter().map(|map| map.coarse(MAX_SQUARES)).collect::<Vec<_>>() {
            let _ = write!(
                self.body,
                "<div style=\"max-width:{}px\"><p>{}</p>{}</div>",
                map.width_px(),
                escape(&map.title),
                cell_map_svg(label, map, classes)
            );
        }
        self.body.push_str("</div><p class=\"legend\">");
        let used = |place: usize| maps.iter().any(|map| map.cells.contains(&Some(place)));
        for class in classes.iter().enumerate().filter(|(place, _)| used(*place)).map(|(_, class)| class) {
            let _ = write!(
                self.body,
                "<span><svg width=\"12\" height=\"12\" aria-hidden=\"true\"><rect class=\"{}\" width=\"12\" \
                 height=\"12\"/></svg> {}</span>",
                class.css,
                escape(&class.name)
            );
        }
        if maps.iter().any(|map| map.plan.as_ref().is_some_and(|plan| plan.track_m.len() > 1)) {
            self.body += TRACK_LEGEND;
        }
        self.body.push_str("</p>");
        self.close_figure(caption);
    }

    fn close_figure(&mut self, caption: &str) {
        let _ = write!(self.body, "<figcaption>{}</figcaption></figure>", escape(caption));
    }

    /// The whole page; at its foot version, day and command.
    pub(crate) fn html(&self) -> String {
        let fold = if self.is_in_fold { "</details>" } else { "" };
        let viewer: String = match self.has_orbit {
            true => {
                [viewer::CLOUD, viewer::ORBIT].map(|script| format!("<script>{script}</script>")).concat()
            }
            false => String::new(),
        };
        let time = crate::base::times::rfc3339(crate::live::receive::now_ns());
        format!(
            "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\
             <title>{}</title><style>{STYLE}</style></head><body><main>{}{fold}</main>\
             <footer><p>Outrigger {}, {}. Made by <code id=\"command\">{}</code> \
             <button type=\"button\" id=\"copy\">Copy</button></p></footer>{viewer}<script>{SCRIPT}</script></body></html>\n",
            escape(&self.title),
            self.body,
            env!("CARGO_PKG_VERSION"),
            time.get(..10).unwrap_or_default(),
            escape(&self.made_by)
        )
    }

    /// Writes the page; it appears under its name only when whole.
    pub(crate) fn write(&self, path: &Path) -> std::io::Result<()> {
        crate::base::files::write_whole(path, self.html().as_bytes())
    }
}

/// Squares along the longer side of a map; more cannot be distinguished.
const MAX_SQUARES: usize = 220;

const TRACK_LEGEND: &str = "<span><svg width=\"18\" height=\"12\" aria-hidden=\"true\"><path class=\"track\" \
     d=\"M0 6H18\"/></svg> trajectory; the dots are the sensors where it begins</span>";
const STYLE: &str = include_str!("report.css");
const SCRIPT: &str = include_str!("report.js");

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
