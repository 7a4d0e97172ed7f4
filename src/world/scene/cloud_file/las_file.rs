//! LAS and LAZ (ASPRS LAS 1.4 R15; LASzip, "laszip compressed file format"). The crates take memory for what counts in
//! a file say, and index by them: here every count is held against the file's length before they see it.

use std::fs::File;
use std::io::{self, BufReader, Read as _, Seek as _, SeekFrom};

use glam::DVec3;

use super::guard::guarded;
use super::{CloudPoint, Fault};

/// Reads every point.
pub(super) fn read(file: File, take: &mut dyn FnMut(CloudPoint)) -> Result<(), Fault> {
    const AT_ONCE: u64 = 1 << 16;
    let bytes = file.metadata().map_err(|error| Fault::at("LAS", error.to_string()))?.len();
    let mut file = BufReader::new(file);
    Header::read(&mut file, bytes)?.check(&mut file, bytes)?;
    file.rewind().map_err(|error| Fault::at("LAS", error.to_string()))?;
    let mut reader = guarded("LAS", || las::Reader::new(file))?;
    loop {
        let points = guarded("LAS", || reader.read_points(AT_ONCE))?;
        if points.is_empty() {
            return Ok(());
        }
        let mut times = points.gps_time();
        for ((x, y), z) in points.x().zip(points.y()).zip(points.z()) {
            let time_s = times.as_mut().and_then(Iterator::next);
            take(CloudPoint { position_m: DVec3::new(x, y, z), seen_from_m: None, time_s });
        }
    }
}

/// The counts of a file.
struct Header {
    points_at: u64,
    records_at: u64,
    records: u32,
    /// Start and number of the extended records behind the points.
    extended: Option<(u64, u32)>,
    is_compressed: bool,
    point_bytes: u64,
    points: u64,
}

impl Header {
    fn read(file: &mut BufReader<File>, length: u64) -> Result<Self, Fault> {
        let mut head = Vec::new();
        file.by_ref().take(375).read_to_end(&mut head).map_err(|error| ends(0, &error))?;
        if !head.starts_with(b"LASF") {
            return Err(Fault::byte(0, format!("{:02x?}, expected LASF", &head[..head.len().min(4)])));
        }
        let minor = head.get(25).copied().unwrap_or_default();
        let long = minor >= 4;
        if head.len() < if long { 375 } else { 227 } {
            return Err(Fault::byte(head.len(), format!("the file ends in the header of a LAS 1.{minor}")));
        }
        let number = |at: usize, bytes: usize| {
            head[at..at + bytes].iter().rev().fold(0_u64, |value, byte| value << 8 | u64::from(*byte))
        };
        let legacy = number(107, 4);
        let header = Self {
            points_at: number(96, 4),
            records_at: number(94, 2),
            records: number(100, 4) as u32,
            extended: (long && number(243, 4) > 0).then(|| (number(235, 8), number(243, 4) as u32)),
            is_compressed: head[104] & 0xc0 != 0,
            point_bytes: number(105, 2),
            points: if long && legacy == 0 { number(247, 8) } else { legacy },
        };
        if header.points_at > length || header.records_at > header.points_at {
            let reason = format!(
                "a header of {} bytes, points from byte {} on, in a file of {length} bytes",
                header.records_at, header.points_at
            );
            return Err(Fault::byte(94, reason));
        }
        Ok(header)
    }

    fn check(&self, file: &mut BufReader<File>, length: u64) -> Result<(), Fault> {
        if let Some((start, count)) = self.extended {
            let mut at = start;
            for record in 0..count {
                let size = number_at(file, at.saturating_add(20), 8).map_err(|error| ends(at, &error))?;
                at = at.saturating_add(60).saturating_add(size);
                if at > length {
                    let reason =
                        format!("extended record {record} goes up to byte {at}, the file has {length}");
                    return Err(Fault::byte(start as usize, reason));
                }
            }
        }
        let held = length - self.points_at;
        if !self.is_compressed {
            return match self.points.checked_mul(self.point_bytes) {
                Some(bytes) if bytes <= held => Ok(()),
                _ => Err(Fault::byte(
                    107,
                    format!(
                        "{} points of {} bytes, the file holds {held} of them",
                        self.points, self.point_bytes
                    ),
                )),
            };
        }
        let laszip = self.laszip(file)?;
        if laszip.point_bytes() != self.point_bytes || self.point_bytes == 0 {
            let reason = format!(
                "points of {} bytes, the compression is of {} bytes",
                self.point_bytes,
                laszip.point_bytes()
            );
            return Err(Fault::byte(105, reason));
        }
        laszip.check(file, self, length)
    }

    /// The record that says how the points are compressed.
    fn laszip(&self, file: &mut BufReader<File>) -> Result<Laszip, Fault> {
        let mut at = self.records_at;
        for _ in 0..self.records {
            let bytes = bytes_at(file, at, 54).map_err(|error| ends(at, &error))?;
            let size = u64::from(u16::from_le_bytes([bytes[20], bytes[21]]));
            if bytes[2..].starts_with(b"laszip encoded\0") && bytes[18..20] == 22204_u16.to_le_bytes() {
                let bytes = bytes_at(file, at + 54, size).map_err(|error| ends(at, &error))?;
                return Laszip::parse(&bytes)
                    .ok_or_else(|| Fault::byte(at as usize, "a LASzip record that is cut"));
            }
            at += 54 + size;
            if at > self.points_at {
                break;
            }
        }
        Err(Fault::byte(self.records_at as usize, "compressed points, and no record of LASzip before them"))
    }
}

/// How points are compressed.
struct Laszip {
    is_layered: bool,
    /// Points of a chunk, where all but the last have as many.
    chunk_points: Option<u32>,
    /// Kind and size of the parts of a point.
    items: Vec<[u16; 2]>,
}

impl Laszip {
    fn parse(bytes: &[u8]) -> Option<Self> {
        let short = |at: usize| Some(u16::from_le_bytes(*bytes.get(at..)?.first_chunk()?));
        let chunk = u32::from_le_bytes(*bytes.get(12..)?.first_chunk()?);
        let items =
            (0..usize::from(short(32)?)).map(|item| Some([short(34 + 6 * item)?, short(36 + 6 * item)?]));
        Some(Self {
            is_layered: short(0)? == 3,
            chunk_points: Some(chunk).filter(|chunk| *chunk != u32::MAX && short(0) != Some(1)),
            items: items.collect::<Option<_>>()?,
        })
    }

    fn point_bytes(&self) -> u64 {
        self.items.iter().map(|[_, size]| u64::from(*size)).sum()
    }

    /// The number of chunks, and the sizes of layers, against the bytes that are there.
    fn check(&self, file: &mut BufReader<File>, header: &Header, length: u64) -> Result<(), Fault> {
        let start = header.points_at + 8;
        let pointer =
            |file: &mut BufReader<File>, at| number_at(file, at, 8).map_err(|error| ends(at, &error));
        let mut table = pointer(file, header.points_at)?;
        if table as i64 <= header.points_at as i64 {
            table = pointer(file, length - 8)?; // a writer that could not go back has put it there
        }
        if table < start || table.saturating_add(8) > length {
            let reason = format!("a table of chunks at byte {table}, the file has {length}");
            return Err(Fault::byte(header.points_at as usize, reason));
        }
        let chunks = number_at(file, table + 4, 4).map_err(|error| ends(table, &error))?;
        // the first point of a chunk is not compressed
        let most = (table - start) / header.point_bytes;
        if chunks > most {
            let reason = format!("{chunks} chunks of points, {} bytes hold {most} at most", table - start);
            return Err(Fault::byte(table as usize + 4, reason));
        }
        if let Some(points) = self.chunk_points
            && u64::from(points).saturating_mul(chunks) < header.points
        {
            let reason = format!("{} points, {chunks} chunks hold {points} each", header.points);
            return Err(Fault::byte(107, reason));
        }
        if self.is_layered { self.check_layers(file, start, table, header.point_bytes) } else { Ok(()) }
    }

    /// A layered chunk: a point, the number of points, sizes of layers, the layers.
    fn check_layers(
        &self,
        file: &mut BufReader<File>,
        start: u64,
        end: u64,
        point: u64,
    ) -> Result<(), Fault> {
        let layers = self.items.iter().map(|[kind, size]| match kind {
            10 => 9,                // point
            11 | 13 => 1,           // colours, wave packet
            12 => 2,                // colours and near infrared
            14 => u64::from(*size), // bytes of its own
            _ => 0,
        });
        let layers: u64 = layers.sum();
        let mut at = start;
        while at < end {
            let head = point + 4 + 4 * layers;
            let sizes = bytes_at(file, at + point + 4, 4 * layers).map_err(|error| ends(at, &error))?;
            let (sizes, _) = sizes.as_chunks::<4>();
            let all: u64 = sizes.iter().map(|size| u64::from(u32::from_le_bytes(*size))).sum();
            if at + head + all > end {
                let reason = format!("layers of {all} bytes, {} are left", end.saturating_sub(at + head));
                return Err(Fault::byte(at as usize, reason));
            }
            at += head + all;
        }
        Ok(())
    }
}

fn ends(at: u64, error: &io::Error) -> Fault {
    Fault::byte(at as usize, format!("the file ends in what begins here: {error}"))
}

/// `count` comes from fields of 16 bits.
fn bytes_at(file: &mut BufReader<File>, at: u64, count: u64) -> io::Result<Vec<u8>> {
    file.seek(SeekFrom::Start(at))?;
    let mut bytes = vec![0; count as usize];
    file.read_exact(&mut bytes)?;
    Ok(bytes)
}

fn number_at(file: &mut BufReader<File>, at: u64, count: u64) -> io::Result<u64> {
    Ok(bytes_at(file, at, count)?.iter().rev().fold(0, |value, byte| value << 8 | u64::from(*byte)))
}
