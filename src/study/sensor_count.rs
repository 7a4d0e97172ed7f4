//! How many sensors are worth their price: the best J known for each number, and the prices at which each number wins.

use serde_json::{Value, json};

use super::rows::{chosen, numbers, text};
use super::searches::{self, SearchTask};
use super::{Findings, Row, Size, Study, StudyError, Table, number};
use crate::design::optimize::Kind;
use crate::report::chart;

const EVALUATIONS: usize = 2000;
const QUICK_EVALUATIONS: usize = 60;

/// See the module.
#[derive(Debug)]
pub struct SensorCount;

impl Study for SensorCount {
    fn name(&self) -> &'static str {
        "sensor-count"
    }

    fn about(&self) -> &'static str {
        "How many sensors are best? Mirroring makes two the least in the published search; here one sensor (not mirrored), \
         one pair and two pairs are searched apart, for both sensors, both paths, roll fixed at 0 and free."
    }

    fn tasks(&self, size: &Size) -> Result<Vec<Value>, StudyError> {
        let mut tasks = Vec::new();
        for preset in ["paper-os1-64", "paper-vlp-16"] {
            for path in ["lateral", "forward"] {
                for roll_deg in [Some(0.0), None] {
                    for (part, masters) in [("1 sensor", 1), ("2 sensors", 1), ("4 sensors", 2)] {
                        for seed in 1..=size.seeds {
                            tasks.push(SearchTask {
                                path: path.into(),
                                roll_deg,
                                masters: [masters, masters],
                                evaluations: if size.quick { QUICK_EVALUATIONS } else { EVALUATIONS },
                                as_published: false,
                                mirror: part != "1 sensor",
                                ..SearchTask::published(part, preset, Kind::Staged, seed)
                            });
                        }
                    }
                }
            }
        }
        Ok(searches::values(&tasks))
    }

    fn run(&self, task: &Value) -> Result<Vec<Row>, StudyError> {
        let found = searches::task(task)?.run()?;
        let mut row = found.row;
        // J without its price, so that every price can be judged
        let sensors = number(&row, "sensors").unwrap_or(0.0);
        let worth = number(&row, "j").unwrap_or(0.0) + number(&row, "lambda").unwrap_or(0.0) * sensors;
        row.insert("worth".into(), json!(worth));
        Ok(vec![row])
    }

    fn findings(&self, rows: &[Row]) -> Findings {
        let mut table = Table::new(
            "sensor-count",
            "Best J known by number of sensors, and the prices at which each number wins",
            "J at lambda 2000, best over the seeds. What was found with roll 0 counts among the mounts with free roll. A \
             number wins at the lambdas of its column; where it has none, it never does.",
            &[
                "sensor",
                "path",
                "roll",
                "J, 1",
                "J, 2",
                "J, 4",
                "1 wins above",
                "2 wins between",
                "4 wins below",
                "best at 2000",
            ],
        );
        let mut winners = Vec::new();
        for preset in ["paper-os1-64", "paper-vlp-16"] {
            for path in ["lateral", "forward"] {
                for roll in ["0", "free"] {
                    let here = chosen(rows, &[("preset", preset), ("path", path)]);
                    let is_free = roll == "free";
                    let best = |part: &str| {
                        let of: Vec<&Row> = here
                            .iter()
                            .filter(|row| {
                                text(row, "part") == part && (is_free || number(row, "roll_deg").is_some())
                            })
                            .copied()
                            .collect();
                        numbers(&of, "worth").into_iter().fold(f64::NEG_INFINITY, f64::max)
                    };
                    let worths = [best("1 sensor"), best("2 sensors"), best("4 sensors")];
                    if worths.iter().any(|worth| !worth.is_finite()) {
                        continue;
                    }
                    let at_2000 = winner(worths, 2000.0);
                    winners.push((at_2000, format!("{preset}, path {path}, roll {roll}")));
                    table.rows.push(row_of(preset, path, roll, worths, at_2000));
                }
            }
        }
        let summary = summary(&winners);
        Findings { summary, tables: vec![table], ..Findings::default() }
    }
}

const COUNTS: [f64; 3] = [1.0, 2.0, 4.0];

/// Which number wins in most settings, and where another does.
fn summary(winners: &[(usize, String)]) -> String {
    let settings = |count: usize| winners.iter().filter(move |(winner, _)| *winner == count);
    let counts = COUNTS.map(|count| count as usize);
    let Some(most) = counts.into_iter().max_by_key(|count| settings(*count).count()) else {
        return String::new();
    };
    let others: Vec<String> = counts
        .into_iter()
        .filter(|count| *count != most && settings(*count).next().is_some())
        .map(|count| {
            let places: Vec<&str> = settings(count).map(|(_, place)| place.as_str()).collect();
            format!("{} in {}", named(count), places.join("; "))
        })
        .collect();
    let wins = format!(
        "At the published price {} best in {} of {} settings",
        named(most),
        settings(most).count(),
        winners.len()
    );
    if others.is_empty() { format!("{wins}.") } else { format!("{wins}, {}.", others.join(", ")) }
}

fn named(count: usize) -> &'static str {
    match count {
        1 => "one sensor is",
        2 => "two sensors are",
        _ => "four sensors are",
    }
}

fn winner(worths: [f64; 3], lambda: f64) -> usize {
    let score = |place: &usize| worths[*place] - lambda * COUNTS[*place];
    let best = (0..3).max_by(|a, b| score(a).total_cmp(&score(b))).unwrap_or(0);
    COUNTS[best] as usize
}

fn row_of(preset: &str, path: &str, roll: &str, worths: [f64; 3], at_2000: usize) -> Vec<String> {
    // at this price two numbers of sensors are worth the same
    let equal_price = |few: usize, many: usize| (worths[many] - worths[few]) / (COUNTS[many] - COUNTS[few]);
    let (one_two, two_four, one_four) = (equal_price(0, 1), equal_price(1, 2), equal_price(0, 2));
    let n = |value: f64| chart::number(value, 0);
    let from = |value: f64| n(value.max(0.0)); // no price is below nothing
    let below = |value: f64| if value > 0.0 { n(value) } else { "never".into() };
    let (one, two, four) = if two_four < one_two {
        (from(one_two), format!("{} and {}", from(two_four), from(one_two)), below(two_four))
    } else {
        (from(one_four), "never".into(), below(one_four))
    };
    let j = |place: usize| chart::number(worths[place] - 2000.0 * COUNTS[place], 1);
    vec![preset.into(), path.into(), roll.into(), j(0), j(1), j(2), one, two, four, at_2000.to_string()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prices_at_which_numbers_are_equal() {
        let row = row_of("p", "lateral", "0", [30_000.0, 34_000.0, 35_000.0], 2);
        assert_eq!(row[6..9], ["4,000", "500 and 4,000", "500"]);
        let row = row_of("p", "lateral", "0", [30_000.0, 31_000.0, 36_000.0], 4);
        assert_eq!(row[6..9], ["2,000", "never", "2,000"]);
        let row = row_of("p", "lateral", "0", [30_000.0, 34_000.0, 33_900.0], 2);
        assert_eq!(row[6..9], ["4,000", "0 and 4,000", "never"]);
        assert_eq!(winner([30_000.0, 34_000.0, 35_000.0], 2000.0), 2);
    }

    #[test]
    fn what_was_found_with_roll_0_counts_where_roll_is_free() {
        let row = |part: &str, roll_deg: Option<f64>, worth: f64| {
            let row = json!({ "part": part, "preset": "paper-os1-64", "path": "lateral", "roll_deg": roll_deg, "worth": worth });
            row.as_object().cloned().unwrap_or_default()
        };
        let rows = [
            row("1 sensor", Some(0.0), 30_741.0),
            row("1 sensor", None, 30_657.0),
            row("2 sensors", Some(0.0), 34_737.0),
            row("2 sensors", None, 34_780.0),
            row("4 sensors", Some(0.0), 34_754.0),
            row("4 sensors", None, 34_758.0),
        ];
        let found = SensorCount.findings(&rows);
        let js: Vec<&[String]> = found.tables[0].rows.iter().map(|row| &row[3..6]).collect();
        assert_eq!(js, [["28,741.0", "30,737.0", "26,754.0"], ["28,741.0", "30,780.0", "26,758.0"]]);
        assert_eq!(found.summary, "At the published price two sensors are best in 2 of 2 settings.");
    }

    #[test]
    fn the_summary_says_where_another_number_wins() {
        let winners = [(2, "a"), (4, "b"), (2, "c")].map(|(count, place)| (count, place.to_string()));
        assert_eq!(
            summary(&winners),
            "At the published price two sensors are best in 2 of 3 settings, four sensors are in b."
        );
    }
}
