//! How fast one core decodes an Ouster capture: `decode_speed CAPTURE METADATA [REPEATS]`. Best of all repeats, in
//! million pixels per second; a dual return counts once.

use std::path::Path;
use std::time::{Duration, Instant};

use sensors::capture::CaptureReader;
use sensors::ouster::{Metadata, OusterDecoder};
use sensors::projection::Projector;
use sensors::{Decoded, Decoder, Frame, Packet};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let (Some(capture), Some(metadata)) = (arguments.next(), arguments.next()) else {
        return Err("usage: decode_speed CAPTURE METADATA [REPEATS]".into());
    };
    let repeats: usize = arguments.next().map_or(Ok(200), |text| text.parse())?;
    let metadata = Metadata::parse(&std::fs::read_to_string(&metadata)?, &metadata)?;
    let bytes: std::sync::Arc<[u8]> = std::fs::read(&capture)?.into();

    let mut packets = Vec::new();
    let mut reader = CaptureReader::open(Path::new(&capture))?;
    while let Some(packet) = reader.next()? {
        packets.push((packet.host_time_ns, packet.source, packet.destination, packet.payload.to_vec()));
    }
    let mut frames: Vec<Frame> = Vec::new();
    let mut keep = |decoded: Decoded<'_>| {
        if let Decoded::Frame(frame) = decoded {
            frames.push(frame.clone());
        }
    };
    let mut decoder = OusterDecoder::new(metadata.clone());
    for (host_time_ns, source, destination, payload) in &packets {
        let packet =
            Packet { host_time_ns: *host_time_ns, source: *source, destination: *destination, payload };
        decoder.push(&packet, &mut keep)?;
    }
    decoder.finish(&mut keep);
    let pixels: usize = frames.iter().map(|frame| frame.valid_columns() * frame.channels).sum();
    println!("{} frames, {pixels} pixels, {}", frames.len(), metadata.profile.name());

    let mut decoder = OusterDecoder::new(metadata.clone());
    report("capture bytes to frames", pixels, repeats, || {
        let read = std::io::Cursor::new(bytes.clone());
        let mut reader = CaptureReader::new(read, "memory").map_err(|error| error.to_string())?;
        while let Some(packet) = reader.next().map_err(|error| error.to_string())? {
            decoder.push(&packet, &mut consume).map_err(|error| error.to_string())?;
        }
        decoder.finish(&mut consume);
        Ok(())
    })?;
    report("packets to frames", pixels, repeats, || {
        for (host_time_ns, source, destination, payload) in &packets {
            let packet =
                Packet { host_time_ns: *host_time_ns, source: *source, destination: *destination, payload };
            decoder.push(&packet, &mut consume).map_err(|error| error.to_string())?;
        }
        decoder.finish(&mut consume);
        Ok(())
    })?;
    let mut projector = Projector::new(&metadata.model);
    let mut points = Vec::new();
    report("frames to points, f32", pixels, repeats, || {
        for frame in &frames {
            projector.points_f32(frame, &frame.first, &mut points);
            std::hint::black_box(&points);
        }
        Ok(())
    })?;
    report("capture bytes to points, f32", pixels, repeats, || {
        let mut reader = CaptureReader::new(std::io::Cursor::new(bytes.clone()), "memory")
            .map_err(|error| error.to_string())?;
        let mut project = |decoded: Decoded<'_>| {
            if let Decoded::Frame(frame) = decoded {
                projector.points_f32(frame, &frame.first, &mut points);
                std::hint::black_box(&points);
            }
        };
        while let Some(packet) = reader.next().map_err(|error| error.to_string())? {
            decoder.push(&packet, &mut project).map_err(|error| error.to_string())?;
        }
        decoder.finish(&mut project);
        Ok(())
    })?;
    let mut points = Vec::new();
    report("frames to points, f64", pixels, repeats, || {
        for frame in &frames {
            projector.points_f64(frame, &frame.first, &mut points);
            std::hint::black_box(&points);
        }
        Ok(())
    })?;
    Ok(())
}

fn consume(decoded: Decoded<'_>) {
    std::hint::black_box(decoded);
}

fn report(
    what: &str,
    pixels: usize,
    repeats: usize,
    mut run: impl FnMut() -> Result<(), String>,
) -> Result<(), String> {
    let mut best = Duration::MAX;
    for _ in 0..repeats {
        let start = Instant::now();
        run()?;
        best = best.min(start.elapsed());
    }
    println!("{what}: {:.0} Mpx/s", pixels as f64 / best.as_secs_f64() / 1e6);
    Ok(())
}
