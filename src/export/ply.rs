//! PLY 1.0, binary little-endian. Source: G. Turk, "The PLY Polygon File Format", 1994.

use std::fs::File;
use std::io::{BufWriter, Seek, SeekFrom, Write};

use super::record::{FIELDS, bytes};
use super::{Cause, Cloud, CloudWriter, flush};

pub(super) struct PlyWriter {
    file: BufWriter<File>,
    points: u64,
}

impl PlyWriter {
    pub(super) fn new(file: File) -> Result<Self, Cause> {
        let mut file = BufWriter::new(file);
        file.write_all(header(0).as_bytes())?;
        Ok(Self { file, points: 0 })
    }
}

impl CloudWriter for PlyWriter {
    fn add(&mut self, cloud: &Cloud) -> Result<(), Cause> {
        for point in &cloud.points {
            self.file.write_all(&bytes(cloud, point))?;
        }
        self.points += cloud.points.len() as u64;
        Ok(())
    }

    fn close(self: Box<Self>) -> Result<(), Cause> {
        let mut file = flush(self.file)?;
        file.seek(SeekFrom::Start(0))?;
        Ok(file.write_all(header(self.points).as_bytes())?)
    }
}

/// The header has the same length whatever the count: a comment fills it up.
fn header(points: u64) -> String {
    let fill = "-".repeat(20 - points.to_string().len());
    let properties: String =
        FIELDS.iter().map(|(name, _, _, kind)| format!("property {kind} {name}\n")).collect();
    format!(
        "ply\nformat binary_little_endian 1.0\ncomment outrigger; t: ns since the frame's start; timestamp: s {fill}\n\
         element vertex {points}\n{properties}end_header\n"
    )
}
