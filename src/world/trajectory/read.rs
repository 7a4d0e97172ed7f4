//! Trajectory files as people have them: what the columns are follows from the header or from their number, what the times
//! count from the header or from their size, and the frame is doubted by the direction of up.

use glam::{DQuat, DVec3};

use super::columns::{Columns, TimeColumns};
use super::files::{Stamped, check_bounds, line_error, numbers, rotation_of, unit_quaternion};
use super::stamp::TimeUnit;
use super::{Trajectory, TrajectoryError, upright};
use crate::base::geometry::Pose;
use crate::base::numbers::counted;
use crate::base::text;

/// A trajectory as read.
#[derive(Clone, Debug)]
pub struct ReadTrajectory {
    /// World from body, z up.
    pub trajectory: Trajectory,
    /// How it was read where that is not plain, and what is odd.
    pub notes: Vec<String>,
}

/// What a row of the file is.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Layout {
    /// By the names of a header, or by TUM's or EuRoC's order; whether the file names them.
    Poses { columns: Columns, is_named: bool },
    /// Rows of a matrix, behind a time or without one.
    Matrix { is_stamped: bool },
}

struct Row {
    line: usize,
    fields: Vec<String>,
}

/// Poses that are being read.
struct Reader {
    stamped: Vec<Stamped>,
    unit: Option<TimeUnit>,
    /// The time of the last pose as the file writes it, and its line.
    last: (String, usize),
    repeated: usize,
    first_repeated: usize,
}

impl Trajectory {
    /// Reads TUM, EuRoC and any other table of stamped poses with a header, stamped matrices, and KITTI. KITTI poses
    /// have no times: they are `1 / rate_hz` apart, the first at 0.
    ///
    /// # Errors
    /// The line of anything that is not as its format asks for; a rate for poses that have times, or none for those that
    /// have none.
    pub fn read(bytes: &[u8], rate_hz: Option<f64>) -> Result<ReadTrajectory, TrajectoryError> {
        let (header, rows) = table(bytes)?;
        let first = rows.first().ok_or(TrajectoryError::Empty)?;
        let layout = layout(header.as_deref(), first)?;
        match (layout, rate_hz) {
            (Layout::Matrix { is_stamped: false }, None) => {
                return Err(TrajectoryError::Format {
                    reason: format!(
                        "line {}: {} columns, which are poses in KITTI format without times: give --rate, the poses per second",
                        first.line,
                        first.fields.len()
                    ),
                });
            }
            (Layout::Poses { .. } | Layout::Matrix { is_stamped: true }, Some(_)) => {
                return Err(TrajectoryError::Format {
                    reason: format!(
                        "line {}: {} columns, which begin with a time: --rate is for poses in KITTI format (12 or 16 columns), \
                         leave it out",
                        first.line,
                        first.fields.len()
                    ),
                });
            }
            _ => {}
        }
        let mut reader = Reader {
            stamped: Vec::new(),
            unit: None,
            last: (String::new(), 0),
            repeated: 0,
            first_repeated: 0,
        };
        if let Some(rate_hz) = rate_hz {
            super::files::check_rate(rate_hz)?;
        }
        for row in &rows {
            reader.add(row, layout, first.fields.len(), rate_hz)?;
        }
        let mut notes = reader.notes(layout);
        let is_order_stated = !matches!(layout, Layout::Poses { columns: Columns::TUM, is_named: false });
        notes.extend(upright::settle(&mut reader.stamped, is_order_stated));
        Ok(ReadTrajectory { trajectory: Self::new(reader.stamped)?, notes })
    }
}

impl Reader {
    fn add(
        &mut self,
        row: &Row,
        layout: Layout,
        width: usize,
        rate_hz: Option<f64>,
    ) -> Result<(), TrajectoryError> {
        let (line, fields) = (row.line, &row.fields);
        let needed = match layout {
            Layout::Poses { columns, is_named: true } => columns.needed(),
            _ => width,
        };
        let is_whole = if needed == width { fields.len() == needed } else { fields.len() >= needed };
        if !is_whole && (fields.len() < needed || matches!(layout, Layout::Matrix { .. })) {
            return Err(line_error(
                line,
                format!("{} fields, expected {needed}{}", fields.len(), layout.words()),
            ));
        }
        let (stamp, pose) = match layout {
            Layout::Poses { columns, .. } => {
                let of = |places: &[usize]| {
                    let words: Vec<&str> = places.iter().map(|place| fields[*place].as_str()).collect();
                    numbers(&words, line)
                };
                let (p, q) = (of(&columns.position)?, of(&columns.quaternion)?);
                let rotation = unit_quaternion(DQuat::from_xyzw(q[0], q[1], q[2], q[3]), line)?;
                (
                    Some(self.time(columns.time, fields, line)?),
                    Pose::new(rotation, DVec3::new(p[0], p[1], p[2])),
                )
            }
            Layout::Matrix { is_stamped } => {
                let words: Vec<&str> =
                    fields.iter().map(String::as_str).skip(usize::from(is_stamped)).collect();
                let pose = rotation_of(&numbers(&words, line)?, line)?;
                let time = TimeColumns::One { column: 0, unit: None };
                (is_stamped.then(|| self.time(time, fields, line)).transpose()?, pose)
            }
        };
        let (time_ns, text) = match (stamp, rate_hz) {
            (Some(stamp), _) => stamp,
            (None, rate_hz) => {
                let seconds = self.stamped.len() as f64 / rate_hz.unwrap_or(1.0);
                ((seconds * 1e9).round() as u64, format!("{seconds}"))
            }
        };
        if let Some((before_ns, _)) = self.stamped.last() {
            if time_ns == *before_ns {
                self.repeated += 1;
                self.first_repeated = if self.repeated == 1 { line } else { self.first_repeated };
                return Ok(());
            }
            if time_ns < *before_ns {
                let (before, at) = &self.last;
                return Err(line_error(
                    line,
                    format!("time {text} after {before} (line {at}), expected later"),
                ));
            }
        }
        check_bounds(&self.stamped, line, (time_ns, pose))?;
        self.stamped.push((time_ns, pose));
        self.last = (text, line);
        Ok(())
    }

    /// A time in nanoseconds, and as the file writes it. All of a file count the same.
    fn time(
        &mut self,
        columns: TimeColumns,
        fields: &[String],
        line: usize,
    ) -> Result<(u64, String), TrajectoryError> {
        let found = match columns {
            TimeColumns::One { column, unit } => {
                let stamp = &fields[column];
                let unit = *self.unit.get_or_insert_with(|| unit.unwrap_or_else(|| TimeUnit::of_size(stamp)));
                let time = unit.nanoseconds(stamp);
                time.map(|time_ns| (time_ns, stamp.clone())).ok_or((stamp.clone(), unit))
            }
            TimeColumns::Split { seconds, nanoseconds } => {
                let parts = TimeUnit::Second
                    .nanoseconds(&fields[seconds])
                    .zip(TimeUnit::Nanosecond.nanoseconds(&fields[nanoseconds]));
                let text = format!("{} s {} ns", fields[seconds], fields[nanoseconds]);
                let time = parts.and_then(|(whole, rest)| whole.checked_add(rest));
                time.map(|time_ns| (time_ns, text.clone())).ok_or((text, TimeUnit::Second))
            }
        };
        found.map_err(|(stamp, unit)| {
            line_error(line, format!("{stamp:?} where {} are expected", unit.words()))
        })
    }

    fn notes(&self, layout: Layout) -> Vec<String> {
        let mut notes = Vec::new();
        if self.repeated > 0 {
            notes.push(format!(
                "{} with the time of the pose before left out (the first in line {})",
                counted(self.repeated as u64, "pose"),
                self.first_repeated
            ));
        }
        if let Layout::Poses { columns: Columns::EUROC, is_named: false } = layout {
            notes.push(
                "17 columns without a header read as EuRoC's: time, position, quaternion with w first".into(),
            );
        }
        if let Some(unit) = self.unit.filter(|unit| *unit != TimeUnit::Second) {
            notes.push(format!("times read as {}", unit.words()));
        }
        notes
    }
}

impl Layout {
    fn words(self) -> &'static str {
        match self {
            Self::Poses { columns: Columns::TUM, is_named: false } => {
                " with blanks between them: timestamp tx ty tz qx qy qz qw"
            }
            Self::Poses { .. } => ", as in the lines before",
            Self::Matrix { .. } => " of a matrix, as in the lines before",
        }
    }
}

/// The names of the header, where there is one, and the rows.
fn table(bytes: &[u8]) -> Result<(Option<Vec<String>>, Vec<Row>), TrajectoryError> {
    let lines = text::lines(bytes).map_err(|reason| TrajectoryError::Format { reason })?;
    let (mut header, mut rows): (Option<Vec<String>>, Vec<Row>) = (None, Vec::new());
    for (line, text) in lines {
        let trimmed = text.trim();
        let comment = ["#", "%", "//"].iter().find_map(|mark| trimmed.strip_prefix(mark));
        if let Some(comment) = comment {
            let names = split(comment);
            // a comment may be a header, where it names columns
            if rows.is_empty() && names.len() > 6 && Columns::named(&names).is_ok() {
                header = Some(names);
            }
            continue;
        }
        let data = trimmed.split('#').next().unwrap_or_default().trim();
        if data.is_empty() {
            continue;
        }
        let fields = split(data);
        let is_text =
            fields.first().is_some_and(|field| field.starts_with(|letter: char| letter.is_alphabetic()))
                && fields.iter().all(|field| field.parse::<f64>().is_err());
        if rows.is_empty() && header.is_none() && is_text && fields.len() > 1 {
            header = Some(fields);
            continue;
        }
        rows.push(Row { line, fields });
    }
    Ok((header, rows))
}

/// The fields of a line, by the separator that it has.
fn split(line: &str) -> Vec<String> {
    let clean = |field: &str| field.trim().trim_matches('"').to_owned();
    for separator in [';', ','] {
        if line.contains(separator) {
            let line = line.trim_end_matches(separator);
            return line.split(separator).map(clean).collect();
        }
    }
    line.split_whitespace().map(clean).collect()
}

fn layout(header: Option<&[String]>, first: &Row) -> Result<Layout, TrajectoryError> {
    if let Some(names) = header {
        return match Columns::named(names) {
            Ok(columns) => Ok(Layout::Poses { columns, is_named: true }),
            Err(lacking) => Err(TrajectoryError::Format {
                reason: format!("the header names {}; {lacking} is missing", names.join(", ")),
            }),
        };
    }
    let ends_in_row = |from: usize| {
        let row: Vec<f64> = first.fields[from..].iter().filter_map(|field| field.parse().ok()).collect();
        row == [0.0, 0.0, 0.0, 1.0]
    };
    match first.fields.len() {
        8 => Ok(Layout::Poses { columns: Columns::TUM, is_named: false }),
        12 | 16 => Ok(Layout::Matrix { is_stamped: false }),
        13 => Ok(Layout::Matrix { is_stamped: true }),
        17 if ends_in_row(13) => Ok(Layout::Matrix { is_stamped: true }),
        17 => Ok(Layout::Poses { columns: Columns::EUROC, is_named: false }),
        found => Err(line_error(
            first.line,
            format!(
                "{found} fields, expected 8 with blanks between them: timestamp tx ty tz qx qy qz qw (TUM); or a header that \
                 names time, x, y, z, qx, qy, qz, qw; or 12 or 16 numbers of a matrix (KITTI, with --rate)"
            ),
        )),
    }
}

#[cfg(test)]
mod tests;
