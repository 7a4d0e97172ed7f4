//! CSV with a header line (RFC 4180).

use std::fs::File;
use std::io::{BufWriter, Write};

use super::{Cause, Cloud, CloudWriter, flush};

pub(super) struct CsvWriter {
    file: BufWriter<File>,
}

impl CsvWriter {
    pub(super) fn new(file: File) -> Result<Self, Cause> {
        let mut file = BufWriter::new(file);
        file.write_all(
            b"sensor,frame_id,column,ring,return_number,time_ns,t,x_m,y_m,z_m,range_mm,intensity,reflectivity,near_ir\n",
        )?;
        Ok(Self { file })
    }
}

impl CloudWriter for CsvWriter {
    fn add(&mut self, cloud: &Cloud) -> Result<(), Cause> {
        let sensor = quoted(&cloud.source.id);
        for point in &cloud.points {
            let position = point.position_m;
            writeln!(
                self.file,
                "{sensor},{},{},{},{},{},{},{:.6},{:.6},{:.6},{},{},{},{}",
                cloud.frame_id,
                point.column,
                point.ring,
                point.return_number,
                point.time_ns,
                cloud.since_start_ns(point),
                position.x,
                position.y,
                position.z,
                point.range_mm,
                point.intensity,
                point.reflectivity,
                point.near_ir.map_or(String::new(), |level| level.to_string()),
            )?;
        }
        Ok(())
    }

    fn close(self: Box<Self>) -> Result<(), Cause> {
        flush(self.file).map(drop)
    }
}

fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}
