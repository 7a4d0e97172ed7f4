#![allow(missing_docs)]
use sensors::{Decoded, Decoder, ouster::*};
use std::collections::BTreeMap;
fn main() {
    for path in std::env::args().skip(1) {
        let digest: serde_json::Value =
            serde_json::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap();
        let p = std::path::Path::new(&path);
        let mp = p.with_file_name(digest["metadata"].as_str().unwrap());
        let meta = Metadata::parse(&std::fs::read_to_string(&mp).unwrap(), "m").unwrap();
        let cap = path.replace(".digest.json", ".pcap");
        let mut r = sensors::capture::CaptureReader::open(std::path::Path::new(&cap)).unwrap();
        let mut dec = OusterDecoder::new(meta.clone());
        let mut orig: Vec<Vec<u8>> = vec![];
        let mut frames = vec![];
        while let Some(pk) = r.next().unwrap() {
            if pk.payload.len() == meta.packet_format().packet_bytes() {
                orig.push(pk.payload.to_vec());
            }
            let _ = dec.push(&pk, &mut |d| {
                if let Decoded::Frame(f) = d {
                    frames.push(f.clone())
                }
            });
        }
        dec.finish(&mut |d| {
            if let Decoded::Frame(f) = d {
                frames.push(f.clone())
            }
        });
        let last =
            orig.first().map(|o| u64::from_le_bytes(o[o.len() - 8..].try_into().unwrap())).unwrap_or(0);
        let sum = if last == 0 {
            Checksum::Zero
        } else if last == wire::NO_CRC {
            Checksum::Constant
        } else {
            Checksum::Crc64
        };
        let mut enc = OusterEncoder::new(meta.clone()).with_checksum(sum);
        let mut out = vec![];
        for f in &frames {
            enc.frame(f, &mut |p| out.push(p.to_vec()));
        }
        let mut same = 0;
        let mut diff: BTreeMap<(bool, usize), (usize, u8, u8)> = BTreeMap::new();
        for (a, b) in orig.iter().zip(&out) {
            if a == b {
                same += 1;
                continue;
            }
            for (i, (x, y)) in a.iter().zip(b).enumerate() {
                if x != y {
                    let hb = if meta.profile.has_packet_header() { 32 } else { 0 };
                    let cb = meta.packet_format().column(a, 0).len();
                    let in_cols = i >= hb && i < hb + cb * meta.columns_per_packet;
                    let k = if !in_cols {
                        (false, i)
                    } else {
                        let o = (i - hb) % cb;
                        let ch = if hb == 0 { 16 } else { 12 };
                        let bytes = meta.profile.layout().bytes;
                        if o < ch {
                            (true, o)
                        } else if o - ch >= bytes * meta.pixels_per_column {
                            (true, 9000 + o - ch - bytes * meta.pixels_per_column)
                        } else {
                            (true, 1000 + (o - ch) % bytes)
                        }
                    };
                    let e = diff.entry(k).or_insert((0, *x, *y));
                    e.0 += 1;
                }
            }
        }
        println!(
            "{} {} orig {} out {} same {} {:?} {:?} {:?}",
            p.file_name().unwrap().to_str().unwrap(),
            meta.profile.name(),
            orig.len(),
            out.len(),
            same,
            sum,
            diff,
            dec.stats()
        );
    }
}
