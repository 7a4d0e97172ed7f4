//! A report as one self-contained HTML page: no outside request, readable in light and dark.

use std::fmt::Write as _;

use super::{Block, Depth, Headline, Report, Section, Verdict, is_of_numbers, viewer};
use crate::report::chart::{CellClass, CellMap, cell_map_svg, escape};

/// Squares along the longer side of a map; more cannot be distinguished.
const MAX_SQUARES: usize = 220;

const TRACK_LEGEND: &str = "<span><svg width=\"18\" height=\"12\" aria-hidden=\"true\"><path class=\"track\" \
     d=\"M0 6H18\"/></svg> trajectory; the dots are the sensors where it begins</span>";
const STYLE: &str = include_str!("report.css");
const SCRIPT: &str = include_str!("report.js");

impl Report {
    /// The whole page; at its foot version, day and the command that makes it again.
    pub(crate) fn html(&self, made_by: &str) -> String {
        let Self { title, verdict, summary, sections } = self;
        let (title, summary) = (escape(title), escape(summary));
        let opening = match verdict {
            Some(verdict) => verdict.html(&title),
            None => format!("<h1>{title}</h1>"),
        };
        let label = verdict.as_ref().map_or(String::new(), |verdict| format!("{}: ", verdict.label));
        let body: String = sections.iter().map(Section::html).collect();
        let viewer = match body.contains("<figure class=\"orbit\">") {
            true => {
                [viewer::CLOUD, viewer::ORBIT].map(|script| format!("<script>{script}</script>")).concat()
            }
            false => String::new(),
        };
        let time = crate::base::times::rfc3339(crate::live::receive::now_ns());
        format!(
            "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\
             <title>{title}</title><style>{STYLE}</style></head><body><main>{opening}<p class=\"summary\">{label}{summary}</p>{body}\
             </main><footer><p>Outrigger {}, {}. Made by <code id=\"command\">{}</code> \
             <button type=\"button\" id=\"copy\">Copy</button></p></footer>{viewer}<script>{SCRIPT}</script></body></html>\n",
            env!("CARGO_PKG_VERSION"),
            time.get(..10).unwrap_or_default(),
            escape(made_by)
        )
    }
}

impl Verdict {
    fn html(&self, title: &str) -> String {
        let Self { label, css, headlines } = self;
        let headline = |Headline { label, value, note }: &Headline| {
            let [label, value, note] = [label, value, note].map(|text| escape(text));
            format!("<div><dt>{label}</dt><dd>{value}</dd><dd class=\"note\">{note}</dd></div>")
        };
        let headlines: String = headlines.iter().map(headline).collect();
        let label = escape(label);
        format!(
            "<h1>{title} <span class=\"badge {css}\">{label}</span></h1><dl class=\"headlines\">{headlines}</dl>"
        )
    }
}

impl Section {
    fn html(&self) -> String {
        let heading = match self.heading.as_str() {
            "" => String::new(),
            heading => format!("<h2>{}</h2>", escape(heading)),
        };
        let blocks: String = self.blocks.iter().map(Block::html).collect();
        if blocks.is_empty() {
            return blocks;
        }
        match &self.depth {
            Depth::Folded(note) => format!(
                "<details><summary>{heading} <span class=\"note\">{}</span></summary>{blocks}</details>",
                escape(note)
            ),
            Depth::Main | Depth::Detail => heading + &blocks,
        }
    }
}

impl Block {
    fn html(&self) -> String {
        match self {
            Self::Figures(figures) => {
                let row = |(label, value): &(String, String)| {
                    format!("<div><dt>{}</dt><dd>{}</dd></div>", escape(label), escape(value))
                };
                format!("<dl class=\"figures\">{}</dl>", figures.iter().map(row).collect::<String>())
            }
            Self::Table { header, rows } => table(header, rows),
            Self::Note(text) => format!("<p>{}</p>", escape(text)),
            Self::Findings(findings) | Self::Notices(findings) => {
                let items: String =
                    findings.iter().map(|text| format!("<li>{}</li>", escape(text))).collect();
                format!("<ol class=\"findings\">{items}</ol>")
            }
            Self::Picture { html, caption } => {
                format!("{html}<figcaption>{}</figcaption></figure>", escape(caption))
            }
        }
    }
}

fn table(header: &[String], rows: &[Vec<String>]) -> String {
    let class = |column: usize| if is_of_numbers(rows, column) { "" } else { " class=\"words\"" };
    let classes: Vec<&str> = (0..header.len()).map(class).collect();
    let line = |kind: &str, cells: &[String]| {
        let cells = cells.iter().zip(&classes);
        let cells: String =
            cells.map(|(cell, class)| format!("<{kind}{class}>{}</{kind}>", escape(cell))).collect();
        format!("<tr>{cells}</tr>")
    };
    let body: String = rows.iter().map(|row| line("td", row)).collect();
    let head = line("th", header);
    format!("<div class=\"scroll table\"><table><thead>{head}</thead><tbody>{body}</tbody></table></div>")
}

/// A figure without its caption.
pub(super) fn maps(label: &str, maps: &[CellMap], classes: &[CellClass]) -> String {
    let mut html = String::from("<figure><div class=\"maps\">");
    for map in &maps.iter().map(|map| map.coarse(MAX_SQUARES)).collect::<Vec<_>>() {
        let _ = write!(
            html,
            "<div style=\"max-width:{}px\"><p>{}</p>{}</div>",
            map.width_px(),
            escape(&map.title),
            cell_map_svg(label, map, classes)
        );
    }
    html.push_str("</div><p class=\"legend\">");
    let used = |place: usize| maps.iter().any(|map| map.cells.contains(&Some(place)));
    for class in classes.iter().enumerate().filter(|(place, _)| used(*place)).map(|(_, class)| class) {
        let _ = write!(
            html,
            "<span><svg width=\"12\" height=\"12\" aria-hidden=\"true\"><rect class=\"{}\" width=\"12\" \
             height=\"12\"/></svg> {}</span>",
            class.css,
            escape(&class.name)
        );
    }
    if maps.iter().any(|map| map.plan.as_ref().is_some_and(|plan| plan.track_m.len() > 1)) {
        html += TRACK_LEGEND;
    }
    html + "</p>"
}
