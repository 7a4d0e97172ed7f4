//! PCD 0.7, binary. Source: Point Cloud Library, "The PCD file format".

use std::fs::File;
use std::io::{BufWriter, Seek, SeekFrom, Write};

use super::record::{BYTES, FIELDS, Field, bytes};
use super::{Cause, Cloud, CloudWriter, flush};

pub(super) struct PcdWriter {
    file: BufWriter<File>,
    points: u64,
}

impl PcdWriter {
    pub(super) fn new(file: File) -> Result<Self, Cause> {
        let mut file = BufWriter::new(file);
        file.write_all(header(0).as_bytes())?;
        Ok(Self { file, points: 0 })
    }
}

impl CloudWriter for PcdWriter {
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
    let list = |of: &dyn Fn(&Field) -> String| FIELDS.iter().map(of).collect::<Vec<_>>().join(" ");
    let fill = "-".repeat(2 * (20 - points.to_string().len()));
    debug_assert_eq!(FIELDS.iter().map(|(_, _, size, _)| size).sum::<usize>(), BYTES);
    format!(
        "# .PCD v0.7 - Point Cloud Data file format\n# outrigger; t: ns since the frame's start; timestamp: s {fill}\n\
         VERSION 0.7\nFIELDS {}\nSIZE {}\nTYPE {}\nCOUNT {}\nWIDTH {points}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\n\
         POINTS {points}\nDATA binary\n",
        list(&|field| field.0.to_owned()),
        list(&|field| field.2.to_string()),
        list(&|field| field.1.to_string()),
        list(&|_| "1".to_owned()),
    )
}
