//! What the fuzz targets do with bytes. The project's tests drive the same functions with stored regressions and with
//! random bytes; whatever the bytes are, nothing may panic, and what comes out must agree with itself.

use std::net::SocketAddr;

use sensors::capture::{CaptureReader, PcapngWriter};
use sensors::ouster::{Metadata, OusterDecoder, Profile, Synthetic};
use sensors::router::Router;
use sensors::velodyne::{Calibration, Options, Product, VelodyneDecoder};
use sensors::{Decoded, Decoder, Packet};

/// A target's name and what it does with bytes.
pub type Target = (&'static str, fn(&[u8]));

/// Every target.
pub const TARGETS: [Target; 6] = [
    ("capture", capture),
    ("ouster_metadata", ouster_metadata),
    ("ouster_packets", ouster_packets),
    ("velodyne_packets", velodyne_packets),
    ("calibration", calibration),
    ("router", router),
];

/// Any file: what is read is written again, and must be read the same.
pub fn capture(bytes: &[u8]) {
    let Ok(mut reader) = CaptureReader::new(std::io::Cursor::new(bytes.to_vec()), "fuzz") else { return };
    let mut writer = PcapngWriter::new(Vec::new()).expect("a Vec takes everything");
    let interface = writer.add_interface("fuzz").expect("a Vec takes everything");
    let mut written = Vec::new();
    while let Ok(Some(packet)) = reader.next() {
        if writer.write(interface, &packet).is_ok() {
            written.push((packet.host_time_ns, packet.source, packet.payload.to_vec()));
        }
    }
    let counters = reader.counters();
    assert!(counters.datagrams <= counters.frames);
    assert!(reader.position() <= bytes.len() as u64);
    let again = writer.close(&[]).expect("a Vec takes everything");
    let mut reader = CaptureReader::new(std::io::Cursor::new(again), "again").expect("as written");
    for (host_time_ns, source, payload) in written {
        let packet = reader.next().expect("as written").expect("as many as written");
        assert_eq!((packet.host_time_ns, packet.payload), (host_time_ns, payload.as_slice()));
        // an address mapped into IPv6 comes back as what it is
        assert_eq!(packet.source.ip().to_canonical(), source.ip().to_canonical());
    }
}

/// Any text: metadata that is read must survive being written and read again.
pub fn ouster_metadata(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let Ok(metadata) = Metadata::parse(text, "fuzz") else { return };
    let again = Metadata::parse(&metadata.to_json(), "again").expect("what is written is read");
    assert_eq!(metadata.packet_format(), again.packet_format());
    assert_eq!(metadata.serial_number(), again.serial_number());
    drop(OusterDecoder::new(metadata));
}

/// The first byte picks profile, pixels and header; the rest are packets.
pub fn ouster_packets(bytes: &[u8]) {
    let Some((&choice, rest)) = bytes.split_first() else { return };
    let profiles: Vec<Profile> = Profile::all().collect();
    let profile = profiles[usize::from(choice) % profiles.len()];
    let name = ["os1-16", "os0-32", "os1-64", "os2-128"][usize::from(choice >> 6)];
    let wanted = Synthetic::new(name, 122_201_000_998, profile).columns(512, 16);
    let Ok(metadata) = Metadata::synthetic(&wanted) else { return };
    let length = metadata.packet_format().packet_bytes();
    let mut decoder = OusterDecoder::new(metadata);
    drive(&mut decoder, rest, length);
}

/// The first byte picks the product (or none); the rest are packets.
pub fn velodyne_packets(bytes: &[u8]) {
    let Some((&choice, rest)) = bytes.split_first() else { return };
    let product = Product::ALL.get(usize::from(choice) % (Product::ALL.len() + 1)).copied();
    let mut decoder = VelodyneDecoder::new(Options { product, ..Options::default() });
    drive(&mut decoder, rest, 1206);
}

/// Any file.
pub fn calibration(bytes: &[u8]) {
    let _ = Calibration::from_bytes(bytes);
}

/// Packets of any length from several senders: the first bytes of each say length, sender and port.
pub fn router(bytes: &[u8]) {
    let mut router = Router::new();
    for (name, profile) in [("os1-64", Profile::Legacy), ("os1-128", Profile::Rng15Rfl8Nir8)] {
        let wanted = Synthetic::new(name, 122_201_000_998, profile);
        if let Ok(metadata) = Metadata::synthetic(&wanted) {
            router.add_ouster(metadata, name);
        }
    }
    let mut rest = bytes;
    let (mut given, mut time_ns) = (0_u64, 1_700_000_000_000_000_000);
    while let Some((&[low, high, who], after)) = rest.split_first_chunk() {
        let length = usize::from(u16::from_le_bytes([low, high])).min(after.len());
        let (payload, next) = after.split_at(length);
        rest = next;
        time_ns += 1_000_000;
        let source = SocketAddr::from(([10, 0, 0, who & 3], 7502));
        let destination = SocketAddr::from(([10, 0, 0, 9], 2368 + u16::from(who >> 2)));
        let packet = Packet { host_time_ns: time_ns, source, destination, link: Default::default(), payload };
        router.learn(&packet);
        router.push(&packet, &mut |_, _, _| {});
        // a payload may be that of several datagrams, of which inertial ones are the shortest
        given += (length / 48).max(1) as u64;
    }
    router.finish(&mut |_, _, _| {});
    let unclaimed: u64 = router.unclaimed().map(|entry| entry.packets).sum();
    assert!(unclaimed <= given);
}

/// Cuts bytes into packets of about the right length; one more byte each shifts the cut, another damages time.
fn drive(decoder: &mut dyn Decoder, bytes: &[u8], length: usize) {
    let address = SocketAddr::from(([10, 0, 0, 1], 7502));
    let mut host_time_ns = 1_700_000_000_000_000_000;
    let mut frames = 0_u64;
    let mut check = |decoded: Decoded<'_>| {
        if let Decoded::Frame(frame) = decoded {
            let samples = frame.columns() * frame.channels;
            assert_eq!(frame.first.range_mm.len(), samples);
            assert_eq!(frame.column_azimuth_rad.len(), frame.columns());
            assert!(frame.column_azimuth_rad.iter().all(|azimuth_rad| azimuth_rad.is_finite()));
            frames += 1;
        }
    };
    let mut rest = bytes;
    while !rest.is_empty() {
        let shift = usize::from(rest[0] == 0xA5);
        let (payload, next) = rest.split_at((length + shift).clamp(1, rest.len()));
        // a fuzzer finds long packets slowly: short input is filled up with itself
        let mut whole;
        let payload = if payload.len() < length && shift == 0 {
            whole = payload.to_vec();
            whole.resize(length, payload[payload.len() - 1]);
            whole.as_slice()
        } else {
            payload
        };
        rest = next;
        host_time_ns += 1_000_000;
        let packet =
            Packet { host_time_ns, source: address, destination: address, link: Default::default(), payload };
        let _ = decoder.push(&packet, &mut check);
    }
    decoder.finish(&mut check);
    assert_eq!(decoder.stats().frames, frames);
}
