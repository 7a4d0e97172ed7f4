//! NumPy's array file: one structured array with the columns of the CSV file
//! (<https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>).

use std::fs::File;
use std::io::{BufWriter, Seek, SeekFrom, Write};

use super::{Cause, Cloud, CloudWriter, Point, flush};

/// Column and NumPy type, packed in this order. `sensor` is the place in the list of `decode --json`, from 0.
const COLUMNS: [(&str, &str); 14] = [
    ("sensor", "<u2"),
    ("frame_id", "<u4"),
    ("column", "<u4"),
    ("ring", "<u2"),
    ("return_number", "|u1"),
    ("time_ns", "<u8"),
    ("t", "<u4"),
    ("x_m", "<f8"),
    ("y_m", "<f8"),
    ("z_m", "<f8"),
    ("range_mm", "<u4"),
    ("intensity", "<f4"),
    ("reflectivity", "|u1"),
    ("near_ir", "<u2"),
];
/// Magic, version, length and text of the header: a multiple of 64 that holds any count of points.
const HEADER_BYTES: usize = 512;
/// What stands before the text: magic, version 1.0, the text's length.
const PREFIX_BYTES: usize = 10;

pub(super) struct NpyWriter {
    file: BufWriter<File>,
    points: u64,
}

impl NpyWriter {
    pub(super) fn new(file: File) -> Result<Self, Cause> {
        let mut file = BufWriter::new(file);
        file.write_all(&header(0))?; // again at the end, with the right count
        Ok(Self { file, points: 0 })
    }
}

impl CloudWriter for NpyWriter {
    fn add(&mut self, cloud: &Cloud) -> Result<(), Cause> {
        for point in &cloud.points {
            write(&mut self.file, cloud, point)?;
        }
        self.points += cloud.points.len() as u64;
        Ok(())
    }

    fn close(self: Box<Self>) -> Result<(), Cause> {
        let mut file = flush(self.file)?;
        file.seek(SeekFrom::Start(0))?;
        Ok(file.write_all(&header(self.points))?)
    }
}

fn header(points: u64) -> Vec<u8> {
    let columns: String = COLUMNS.iter().map(|(name, kind)| format!("('{name}', '{kind}'), ")).collect();
    let text = format!("{{'descr': [{columns}], 'fortran_order': False, 'shape': ({points},), }}");
    let length = HEADER_BYTES - PREFIX_BYTES;
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((length as u16).to_le_bytes());
    bytes.extend(format!("{text:<width$}\n", width = length - 1).into_bytes());
    bytes
}

fn write(file: &mut impl Write, cloud: &Cloud, point: &Point) -> std::io::Result<()> {
    file.write_all(&cloud.source.number.to_le_bytes())?;
    file.write_all(&cloud.frame_id.to_le_bytes())?;
    file.write_all(&point.column.to_le_bytes())?;
    file.write_all(&point.ring.to_le_bytes())?;
    file.write_all(&[point.return_number])?;
    file.write_all(&point.time_ns.to_le_bytes())?;
    file.write_all(&cloud.since_start_ns(point).to_le_bytes())?;
    for coordinate_m in point.position_m.to_array() {
        file.write_all(&coordinate_m.to_le_bytes())?;
    }
    file.write_all(&point.range_mm.to_le_bytes())?;
    file.write_all(&point.intensity.to_le_bytes())?;
    file.write_all(&[point.reflectivity])?;
    file.write_all(&point.near_ir.unwrap_or(0).to_le_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_have_one_length_whatever_the_count() {
        for points in [0, 7, u64::MAX] {
            let bytes = header(points);
            assert_eq!((bytes.len(), bytes.last()), (HEADER_BYTES, Some(&b'\n')), "{points}");
        }
    }
}
