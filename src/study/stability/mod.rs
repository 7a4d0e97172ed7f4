//! Where methods fail, what happens there, and what the program says: one row per case, each with a measured figure, a
//! limit with its reason and a verdict. A case that fails without a word is a defect of the program.

mod mounts;
mod placements;
mod recordings;
mod sampling;
mod searches;
mod stand;
mod ties;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::rows::{Row, row_of, text};
use super::{Claim, Figure, Findings, Size, Study, StudyError, Table, Verdict};
use crate::report::chart::{self, LineChart};

/// See the module.
#[derive(Debug)]
pub struct Stability;

/// What becomes of a method in a hard case.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Outcome {
    /// The figure stays within the limit.
    Stable,
    /// It does not, but goes there step by step with the cause.
    DegradesGracefully,
    /// It does not, and the program says so.
    Reported,
    /// It does not, and no output shows it.
    FailsSilently,
}

impl Outcome {
    fn words(self) -> &'static str {
        match self {
            Self::Stable => "stable",
            Self::DegradesGracefully => "degrades gracefully",
            Self::Reported => "detected and reported",
            Self::FailsSilently => "fails silently",
        }
    }
}

/// What was measured in a case.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Measured {
    /// The figure that decides, with what it is and its unit.
    figure: f64,
    what: String,
    /// It should be at most this, and why.
    limit: f64,
    reason: String,
    outcome: Outcome,
    /// What happens, in words with their numbers.
    happens: String,
    /// What the program says about it; empty where it says nothing.
    says: String,
    /// A line to draw: names of the axes, points.
    line: Option<(String, String, Vec<[f64; 2]>)>,
}

impl Measured {
    /// A figure against its limit: stable within it, else reported if the program says something, else a silent failure.
    fn judge(figure: f64, what: &str, limit: f64, reason: &str) -> Self {
        Self {
            figure,
            what: what.into(),
            limit,
            reason: reason.into(),
            outcome: if figure <= limit { Outcome::Stable } else { Outcome::FailsSilently },
            happens: String::new(),
            says: String::new(),
            line: None,
        }
    }

    fn happens(self, happens: impl Into<String>) -> Self {
        Self { happens: happens.into(), ..self }
    }

    /// What the program itself says; none where it says nothing.
    fn says(self, says: Option<String>) -> Self {
        let outcome = match (self.outcome, &says) {
            (Outcome::FailsSilently, Some(_)) => Outcome::Reported,
            (outcome, _) => outcome,
        };
        Self { outcome, says: says.unwrap_or_default(), ..self }
    }

    /// Whether the figure follows the cause step by step, without a cliff.
    fn gracefully(self, is_so: bool) -> Self {
        let outcome = match self.outcome {
            Outcome::FailsSilently if is_so => Outcome::DegradesGracefully,
            outcome => outcome,
        };
        Self { outcome, ..self }
    }

    fn line(self, x: &str, y: &str, points: Vec<[f64; 2]>) -> Self {
        Self { line: Some((x.into(), y.into(), points)), ..self }
    }
}

/// A hard case.
struct Case {
    name: &'static str,
    /// What is hard about it.
    about: &'static str,
    measure: fn(quick: bool) -> Result<Measured, StudyError>,
}

/// Every case, in the order of the table.
fn cases() -> impl Iterator<Item = &'static Case> {
    sampling::CASES
        .iter()
        .chain(ties::CASES)
        .chain(mounts::CASES)
        .chain(searches::CASES)
        .chain(stand::CASES)
        .chain(recordings::CASES)
        .chain(placements::CASES)
}

#[derive(Clone, Debug, Serialize, Deserialize)]
struct Task {
    case: String,
    quick: bool,
}

impl Study for Stability {
    fn name(&self) -> &'static str {
        "stability"
    }

    fn about(&self) -> &'static str {
        "Where do the methods fail, what happens there, and what does the program say?"
    }

    fn tasks(&self, size: &Size) -> Result<Vec<Value>, StudyError> {
        let task = |case: &Case| Value::Object(row_of(&Task { case: case.name.into(), quick: size.quick }));
        Ok(cases().map(task).collect())
    }

    fn run(&self, task: &Value) -> Result<Vec<Row>, StudyError> {
        let task: Task = serde_json::from_value(task.clone()).map_err(StudyError::of)?;
        let case = cases().find(|case| case.name == task.case);
        let case = case.ok_or_else(|| StudyError(format!("the study has no case {:?}", task.case)))?;
        let mut row = row_of(&task);
        row.extend(row_of(&(case.measure)(task.quick)?));
        Ok(vec![row])
    }

    fn rests_on_seeds(&self) -> bool {
        false
    }

    fn findings(&self, rows: &[Row]) -> Findings {
        let mut table = Table::new(
            "cases",
            "Where methods fail",
            "The figure decides against its limit. Reported: the program says so itself, in the words of the last column.",
            &[
                "case",
                "what is hard",
                "figure",
                "limit",
                "why this limit",
                "verdict",
                "what happens",
                "what the program says",
            ],
        );
        let mut findings = Findings::default();
        let mut counts = [0_usize; 4];
        for case in cases() {
            let Some(row) = rows.iter().find(|row| text(row, "case") == case.name) else { continue };
            let Ok(measured) = serde_json::from_value::<Measured>(Value::Object(row.clone())) else {
                continue;
            };
            counts[measured.outcome as usize] += 1;
            table.rows.push(cells(case, &measured));
            findings.figures.extend(figure(case, &measured));
        }
        let [stable, gracefully, reported, silent] = counts;
        findings.claims.push(Claim {
            claim: "No method fails without a word".into(),
            verdict: if silent == 0 { Verdict::Stands } else { Verdict::DoesNotStand },
            because: format!("{silent} of {} cases fail silently", table.rows.len()),
        });
        findings.summary = format!(
            "Of {} cases {stable} are stable, {gracefully} degrade gracefully, {reported} are detected and reported, {silent} fail silently.",
            table.rows.len()
        );
        findings.tables.push(table);
        findings
    }
}

fn cells(case: &Case, measured: &Measured) -> Vec<String> {
    vec![
        case.name.into(),
        case.about.into(),
        format!("{} {}", figure_text(measured.figure), measured.what),
        figure_text(measured.limit),
        measured.reason.clone(),
        measured.outcome.words().into(),
        measured.happens.clone(),
        if measured.says.is_empty() { "-".into() } else { measured.says.clone() },
    ]
}

/// Three significant digits.
fn figure_text(value: f64) -> String {
    let decimals =
        if value == 0.0 { 0 } else { (2.0 - value.abs().log10().floor()).clamp(0.0, 4.0) as usize };
    chart::number(value, decimals)
}

fn figure(case: &Case, measured: &Measured) -> Option<Figure> {
    let (x, y, points) = measured.line.clone()?;
    let chart = LineChart {
        title: case.name.into(),
        x_label: x,
        y_label: y,
        series: vec![chart::Series { name: String::new(), points }],
        ..LineChart::default()
    };
    Some(Figure { svg: chart.svg(), caption: format!("{}: {}.", case.name, case.about) })
}

#[cfg(test)]
mod tests {
    use rayon::prelude::*;

    use super::*;

    /// Of the quick run. A line that changes is a change of behaviour: look at its figure before you change it here.
    const VERDICTS: [&str; 29] = [
        "aliasing: detected and reported",
        "aliasing, few beams: stable",
        "needle optimum: stable",
        "wall on voxel faces: stable",
        "saturation: detected and reported",
        "one pair or two: stable",
        "mounts on their side: stable",
        "two sensors in one place: stable",
        "tolerance, 1 cm and 1 degree: stable",
        "tolerance, 2 cm and 2 degrees: stable",
        "seeds, default method: detected and reported",
        "seeds, particle swarm: detected and reported",
        "level VLP-16 in a room: detected and reported",
        "open field: stable",
        "floor only: stable",
        "corridor: stable",
        "closed room: stable",
        "packet loss: stable",
        "clock offset between sensors: detected and reported",
        "trajectory noise: detected and reported",
        "trajectory drift: stable",
        "range bias: stable",
        "encoder offset: stable",
        "undeskewed points: stable",
        "square room: stable",
        "long corridor: stable",
        "other building: stable",
        "surface missing: stable",
        "furniture moved: stable",
    ];

    #[test]
    fn no_case_fails_without_a_word() {
        let size = Size { seeds: 1, quick: true, ..Size::default() };
        let tasks = Stability.tasks(&size).unwrap();
        let rows: Vec<Row> = tasks.par_iter().flat_map_iter(|task| Stability.run(task).unwrap()).collect();
        let findings = Stability.findings(&rows);
        let [table] = &findings.tables[..] else { panic!() };
        let verdicts: Vec<String> = table.rows.iter().map(|row| format!("{}: {}", row[0], row[5])).collect();
        assert_eq!(verdicts, VERDICTS, "{:#?}", table.rows);
        assert_eq!(findings.claims[0].verdict, Verdict::Stands);
    }
}
