//! One self-contained HTML page and one JSON document per run: no outside request, readable in light and dark.

use std::fmt::Write as _;
use std::path::Path;

use crate::chart::{CellClass, escape};

mod unfold;

pub use unfold::unfold_box;

/// A page, built from top to bottom.
#[derive(Clone, Debug)]
pub struct Report {
    title: String,
    body: String,
}

impl Report {
    /// An empty page; `summary` is the one sentence a reader takes away.
    pub fn new(title: &str, summary: &str) -> Self {
        let body = format!("<h1>{}</h1><p class=\"summary\">{}</p>", escape(title), escape(summary));
        Self { title: title.to_owned(), body }
    }

    /// A heading.
    pub fn heading(&mut self, text: &str) {
        let _ = write!(self.body, "<h2>{}</h2>", escape(text));
    }

    /// A paragraph.
    pub fn paragraph(&mut self, text: &str) {
        let _ = write!(self.body, "<p>{}</p>", escape(text));
    }

    /// A command the reader can run again.
    pub fn command(&mut self, text: &str) {
        let _ = write!(self.body, "<pre>{}</pre>", escape(text));
    }

    /// A table; the first column is text, numbers stand right.
    pub fn table(&mut self, header: &[&str], rows: &[Vec<String>]) {
        self.body.push_str("<div class=\"scroll\"><table><thead><tr>");
        for cell in header {
            let _ = write!(self.body, "<th>{}</th>", escape(cell));
        }
        self.body.push_str("</tr></thead><tbody>");
        for row in rows {
            self.body.push_str("<tr>");
            for cell in row {
                let is_number = cell.starts_with(|c: char| c.is_ascii_digit() || c == '-');
                let class = if is_number { "" } else { " class=\"words\"" };
                let _ = write!(self.body, "<td{class}>{}</td>", escape(cell));
            }
            self.body.push_str("</tr>");
        }
        self.body.push_str("</tbody></table></div>");
    }

    /// A picture made by [`crate::chart`], with its caption and a legend of the classes it uses.
    pub fn figure(&mut self, svg: &str, caption: &str, legend: &[CellClass]) {
        let _ = write!(self.body, "<figure>{svg}");
        if !legend.is_empty() {
            self.body.push_str("<p class=\"legend\">");
            for class in legend {
                let _ = write!(
                    self.body,
                    "<span><svg width=\"12\" height=\"12\"><rect class=\"{}\" width=\"12\" height=\"12\"/></svg> \
                     {}</span>",
                    class.css,
                    escape(&class.name)
                );
            }
            self.body.push_str("</p>");
        }
        let _ = write!(self.body, "<figcaption>{}</figcaption></figure>", escape(caption));
    }

    /// The whole page.
    pub fn html(&self) -> String {
        format!(
            "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\
             <title>{}</title><style>{STYLE}</style></head><body><main>{}</main></body></html>\n",
            escape(&self.title),
            self.body
        )
    }

    /// Writes the page; it appears under its name only when whole.
    pub fn write(&self, path: &Path) -> std::io::Result<()> {
        crate::files::write_whole(path, self.html().as_bytes())
    }
}

const STYLE: &str = include_str!("report.css");
