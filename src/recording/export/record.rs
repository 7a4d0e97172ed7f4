//! Binary point records of PCD and PLY: one list of fields, so that both files say the same.

use std::fs::File;
use std::io::{BufWriter, Seek, SeekFrom, Write};

use super::{Cause, Cloud, CloudWriter, Point, flush};

/// Name, PCD type letter, size in bytes, PLY type.
pub(super) type Field = (&'static str, char, usize, &'static str);

/// What a record holds, in order.
pub(super) const FIELDS: [Field; 9] = [
    ("x", 'F', 4, "float"),
    ("y", 'F', 4, "float"),
    ("z", 'F', 4, "float"),
    ("intensity", 'F', 4, "float"),
    ("t", 'U', 4, "uint"),
    ("timestamp", 'F', 8, "double"),
    ("reflectivity", 'U', 1, "uchar"),
    ("return_number", 'U', 1, "uchar"),
    ("ring", 'U', 2, "ushort"),
];

/// Bytes of one record.
pub(super) const BYTES: usize = 32;
/// Of these, those of the coordinates.
const COORDINATES: usize = 12;

/// One point, in the order of [`FIELDS`], little-endian.
pub(super) fn bytes(cloud: &Cloud, point: &Point) -> [u8; BYTES] {
    let mut record = [0; BYTES];
    let position = point.position_m.as_vec3();
    for (at, value) in [position.x, position.y, position.z, point.intensity].into_iter().enumerate() {
        record[at * 4..at * 4 + 4].copy_from_slice(&value.to_le_bytes());
    }
    record[16..20].copy_from_slice(&cloud.since_start_ns(point).to_le_bytes());
    record[20..28].copy_from_slice(&seconds(point.time_ns).to_le_bytes());
    record[28] = point.reflectivity;
    record[29] = point.return_number;
    record[30..32].copy_from_slice(&point.ring.to_le_bytes());
    record
}

/// Nanoseconds as seconds; a date of today keeps a quarter of a microsecond.
pub(super) fn seconds(time_ns: u64) -> f64 {
    time_ns as f64 * 1e-9
}

/// A file of a text header and packed records. The header is written twice, the second time with the right count: it
/// has the same length whatever the count.
pub(super) struct RecordWriter {
    file: BufWriter<File>,
    header: Header,
    is_wide: bool,
    points: u64,
}

/// The header of a file of so many points, with coordinates of 64 bits or of 32.
type Header = fn(u64, bool) -> String;

impl RecordWriter {
    /// `is_wide`: coordinates of 64 bits, for points far from the origin.
    pub(super) fn new(file: File, header: Header, is_wide: bool) -> Result<Self, Cause> {
        let mut file = BufWriter::new(file);
        file.write_all(header(0, is_wide).as_bytes())?;
        Ok(Self { file, header, is_wide, points: 0 })
    }
}

impl CloudWriter for RecordWriter {
    fn add(&mut self, cloud: &Cloud) -> Result<(), Cause> {
        for point in &cloud.points {
            let record = bytes(cloud, point);
            if !self.is_wide {
                self.file.write_all(&record)?;
                continue;
            }
            for coordinate_m in point.position_m.to_array() {
                self.file.write_all(&coordinate_m.to_le_bytes())?;
            }
            self.file.write_all(&record[COORDINATES..])?;
        }
        self.points += cloud.points.len() as u64;
        Ok(())
    }

    fn close(self: Box<Self>) -> Result<(), Cause> {
        let mut file = flush(self.file)?;
        file.seek(SeekFrom::Start(0))?;
        Ok(file.write_all((self.header)(self.points, self.is_wide).as_bytes())?)
    }
}
