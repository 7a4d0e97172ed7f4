//! Velodyne captures against the digests of velodyne_decoder.

use std::net::SocketAddr;

use glam::DVec3;
use sensors::capture::CaptureReader;
use sensors::ouster::Claim;
use sensors::velodyne::{Options, Product, PulseState, ReturnMode, VelodyneDecoder, VelodyneEncoder};
use sensors::{DecodeStats, Decoded, Decoder, Frame, Packet, Rejected, SensorModel};

use crate::support::{Case, shared, with_shared};

pub const CASES: &[Case] = &[
    with_shared("mrpt_vlp16_gps", mrpt_vlp16_gps),
    with_shared("nebula_vlp16", nebula_vlp16),
    with_shared("nebula_vlp32", nebula_vlp32),
    with_shared("nebula_vls128", nebula_vls128),
    with_shared("rustlidar_vlp16", rustlidar_vlp16),
    with_shared("rustlidar_hdl32e", rustlidar_hdl32e),
    with_shared("synthetic_hdl32e_dual", synthetic_hdl32e_dual),
    with_shared("synthetic_vlp32c_dual", synthetic_vlp32c_dual),
    with_shared("synthetic_hdl64e_s2", synthetic_hdl64e_s2),
    with_shared("nebula_vlp32_scan", nebula_vlp32_scan),
    with_shared("nebula_vlp16_scan", nebula_vlp16_scan),
    with_shared("field_of_view_gap", field_of_view_gap),
    with_shared("position_packets", position_packets),
    with_shared("vli_16_is_refused", vli_16_is_refused),
    with_shared("claims", claims),
    with_shared("recordings_are_encoded_again", recordings_are_encoded_again),
];

#[derive(Clone)]
struct Datagram {
    host_time_ns: u64,
    source: SocketAddr,
    destination: SocketAddr,
    payload: Vec<u8>,
}

impl Datagram {
    fn packet(&self) -> Packet<'_> {
        Packet {
            host_time_ns: self.host_time_ns,
            source: self.source,
            destination: self.destination,
            payload: &self.payload,
        }
    }
}

/// UDP datagrams of a capture.
fn datagrams(path: &str) -> Vec<Datagram> {
    let mut reader = CaptureReader::open(&shared(path)).unwrap();
    let mut all = Vec::new();
    while let Some(packet) = reader.next().unwrap() {
        all.push(Datagram {
            host_time_ns: packet.host_time_ns,
            source: packet.source,
            destination: packet.destination,
            payload: packet.payload.to_vec(),
        });
    }
    all
}

struct Decoding {
    frames: Vec<Frame>,
    model: SensorModel,
    stats: DecodeStats,
}

fn decode(datagrams: &[Datagram], options: Options) -> Decoding {
    let mut decoder = VelodyneDecoder::new(options);
    let mut frames = Vec::new();
    let mut take = |decoded: Decoded<'_>| {
        if let Decoded::Frame(frame) = decoded {
            frames.push(frame.clone());
        }
    };
    for datagram in datagrams {
        decoder.push(&datagram.packet(), &mut take).unwrap();
    }
    decoder.finish(&mut take);
    Decoding { frames, model: decoder.model().unwrap().clone(), stats: decoder.stats().clone() }
}

/// A point as the peer writes it.
struct Point {
    time_ns: u64,
    ring: usize,
    second: bool,
    position_m: DVec3,
    range_m: f64,
    intensity: f64,
}

/// Ranges the peer keeps, m.
const PEER_RANGES_M: std::ops::RangeInclusive<f64> = 0.1..=200.0;

/// All points of a frame that the peer keeps, in the order of columns, channels and layers.
fn points(model: &SensorModel, frame: &Frame) -> Vec<Point> {
    let rings = rings(model);
    let mut points = Vec::new();
    for column in 0..frame.columns() {
        for (channel, beam) in model.beams().iter().enumerate() {
            let index = frame.index(column, channel);
            let azimuth_rad =
                frame.column_azimuth_rad[column] + frame.azimuth_rate_rad_per_ns * beam.fire_offset_ns;
            for (second, layer) in [(false, Some(&frame.first)), (true, frame.second.as_ref())] {
                let Some(layer) = layer.filter(|layer| layer.range_mm[index] > 0) else { continue };
                let range_m = f64::from(layer.range_mm[index]) / 1e3;
                if !PEER_RANGES_M.contains(&(range_m - beam.range_offset_m)) {
                    continue;
                }
                points.push(Point {
                    time_ns: frame.column_time_ns[column] + beam.fire_offset_ns.round() as u64,
                    ring: rings[channel],
                    second,
                    position_m: model.point(channel, azimuth_rad, range_m),
                    range_m,
                    intensity: model.intensity(channel, range_m, layer.reflectivity[index]),
                });
            }
        }
    }
    points
}

/// Channels numbered from the lowest beam up.
fn rings(model: &SensorModel) -> Vec<usize> {
    let mut channels: Vec<usize> = (0..model.channels()).collect();
    channels.sort_by(|a, b| model.beams()[*a].elevation_rad.total_cmp(&model.beams()[*b].elevation_rad));
    let mut rings = vec![0; channels.len()];
    for (ring, channel) in channels.into_iter().enumerate() {
        rings[channel] = ring;
    }
    rings
}

/// How far we may be from the peer.
#[derive(Clone, Copy)]
struct Tolerance {
    time_ns: u64,
    /// The peer rounds azimuths to 0.01 degree.
    azimuth_deg: f64,
}

const CLOSE: Tolerance = Tolerance { time_ns: 1000, azimuth_deg: 0.01 };

/// Compares frames with a digest: counts, sums of intensity, mean position, and every sample point. Within a packet
/// of an azimuth gap the peer interpolates across the gap: there, and only there, samples may be elsewhere.
fn compare(name: &str, decoding: &Decoding, tolerance: Tolerance) {
    let text = std::fs::read_to_string(shared(&format!("captures/velodyne/{name}.digest.json"))).unwrap();
    let digest: serde_json::Value = serde_json::from_str(&text).unwrap();
    let expected = digest["frames"].as_array().unwrap();
    assert_eq!(decoding.frames.len(), expected.len(), "{name}: frames");
    for (number, (frame, expected)) in decoding.frames.iter().zip(expected).enumerate() {
        let name = format!("{name} frame {number}");
        compare_frame(&name, &decoding.model, frame, expected, tolerance);
    }
}

fn compare_frame(
    name: &str,
    model: &SensorModel,
    frame: &Frame,
    expected: &serde_json::Value,
    tolerance: Tolerance,
) {
    let points = points(model, frame);
    assert_eq!(points.len() as u64, expected["points"].as_u64().unwrap(), "{name}: points");
    if frame.second.is_some() {
        let second = points.iter().filter(|point| point.second).count() as u64;
        assert_eq!(second, expected["returns"]["1"].as_u64().unwrap(), "{name}: second returns");
    }
    let intensity: f64 = points.iter().map(|point| point.intensity).sum();
    assert_eq!(intensity, expected["sum"]["intensity"].as_f64().unwrap(), "{name}: intensity");

    let gaps = gaps(frame);
    let azimuth_rad = tolerance.azimuth_deg.to_radians();
    let mean = |value: fn(&Point) -> DVec3| {
        points.iter().fold(DVec3::ZERO, |sum, point| sum + value(point)) / points.len() as f64
    };
    let peer = DVec3::from_array(["x", "y", "z"].map(|axis| expected["sum"][axis].as_f64().unwrap()));
    let mean_off_m = mean(|point| point.position_m).distance(peer / points.len() as f64);
    let mean_range_m = mean(|point| DVec3::splat(point.range_m)).x;
    assert!(
        !gaps.is_empty() || mean_off_m < 0.5 * azimuth_rad * mean_range_m + 2e-5,
        "{name}: {mean_off_m} m"
    );

    let stamp_ns = (expected["device_stamp_s"].as_f64().unwrap() * 1e6).round() as i64 * 1000;
    // only the first frames of a long capture have samples
    for sample in expected["samples"].as_array().into_iter().flatten() {
        let value = |field: &str| sample[field].as_f64().unwrap();
        let time_ns = (stamp_ns + (value("time_s") * 1e9).round() as i64) as u64;
        let is_second = value("return_type") == 1.0 && frame.second.is_some();
        let nearest = points
            .iter()
            .filter(|point| point.ring == value("ring") as usize && point.second == is_second)
            .min_by_key(|point| point.time_ns.abs_diff(time_ns))
            .unwrap();
        let position_m = DVec3::new(value("x"), value("y"), value("z"));
        let off_m = nearest.position_m.distance(position_m);
        let off_ns = nearest.time_ns.abs_diff(time_ns);
        if off_ns > tolerance.time_ns || off_m > azimuth_rad * nearest.range_m + 2e-4 {
            let near_gap =
                gaps.iter().any(|gap| gap.iter().any(|edge_ns| edge_ns.abs_diff(time_ns) < PACKET_NS));
            assert!(near_gap, "{name}: {sample} is {off_m} m and {off_ns} ns from ours");
            continue;
        }
        assert_eq!(nearest.intensity, value("intensity"), "{name}: {sample}");
    }
}

/// Longer than any packet of a sensor with a field-of-view window here.
const PACKET_NS: u64 = 664_000;

/// Times on both sides of each azimuth gap, ns.
fn gaps(frame: &Frame) -> Vec<[u64; 2]> {
    let step_rad = |column: usize| frame.column_azimuth_rad[column + 1] - frame.column_azimuth_rad[column];
    (0..frame.columns() - 1)
        .filter(|column| step_rad(*column).rem_euclid(std::f64::consts::TAU) > 0.05)
        .map(|column| [frame.column_time_ns[column], frame.column_time_ns[column + 1]])
        .collect()
}

fn decode_capture(name: &str) -> Decoding {
    decode(&datagrams(&format!("captures/velodyne/{name}.pcap")), Options::default())
}

fn mrpt_vlp16_gps() {
    let decoding = decode_capture("mrpt_vlp16_gps");
    assert_eq!(decoding.model.name, "vlp-16");
    compare("mrpt_vlp16_gps", &decoding, CLOSE);
    assert_eq!(
        (decoding.stats.packets, decoding.stats.lost_packets, decoding.stats.complete_frames),
        (293, 0, 3)
    );
}

fn nebula_vlp16() {
    compare("nebula_vlp16", &decode_capture("nebula_vlp16"), CLOSE);
}

fn nebula_vlp32() {
    let decoding = decode_capture("nebula_vlp32");
    compare("nebula_vlp32", &decoding, CLOSE);
    assert_eq!(
        (decoding.stats.packets, decoding.stats.lost_packets, decoding.stats.complete_frames),
        (379, 0, 4)
    );
}

/// The peer takes the firing cycle and the stamp's place from two other firmwares' tables (2.7 us a slot, two idle
/// slots after the eighth, stamp 7 us late), we from the measured packet period: up to three slots apart.
fn nebula_vls128() {
    let decoding = decode_capture("nebula_vls128");
    compare("nebula_vls128", &decoding, Tolerance { time_ns: 8500, azimuth_deg: 0.04 });
    assert_eq!((decoding.stats.packets, decoding.stats.lost_packets), (2193, 0));
}

/// A VLP-16 that says it is an HDL-32E.
fn rustlidar_vlp16() {
    let decoding = decode_capture("rustlidar_vlp16");
    assert_eq!(decoding.model.name, "vlp-16");
    compare("rustlidar_vlp16", &decoding, CLOSE);
}

/// An HDL-32E in a file that says it is a VLP-32.
fn rustlidar_hdl32e() {
    let decoding = decode_capture("rustlidar_hdl32e_named_vlp32");
    assert_eq!(decoding.model.name, "hdl-32e");
    compare("rustlidar_hdl32e_named_vlp32", &decoding, CLOSE);
}

fn synthetic_hdl32e_dual() {
    compare("synthetic/syn_hdl32e_dual", &decode_capture("synthetic/syn_hdl32e_dual"), CLOSE);
}

fn synthetic_vlp32c_dual() {
    compare("synthetic/syn_vlp32c_dual", &decode_capture("synthetic/syn_vlp32c_dual"), CLOSE);
}

/// Points of one scan as another driver wrote them; positions at the head of each record.
fn pcd_positions(path: &str) -> Vec<DVec3> {
    let bytes = std::fs::read(shared(path)).unwrap();
    let marker = b"DATA binary\n";
    let data = bytes.windows(marker.len()).position(|window| window == marker).unwrap() + marker.len();
    let header = std::str::from_utf8(&bytes[..data]).unwrap();
    let line = |name: &str| header.lines().find_map(|line| line.strip_prefix(name)).unwrap();
    let numbers = |name: &str| line(name).split_whitespace().map(|word| word.parse::<usize>().unwrap());
    assert!(line("FIELDS").starts_with(" x y z") && line("SIZE").starts_with(" 4 4 4"));
    let count = numbers("POINTS").next().unwrap();
    let stride: usize = numbers("SIZE").sum();
    assert_eq!(bytes.len() - data, count * stride);
    let value = |at: usize| f64::from(f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()));
    (0..count)
        .map(|point| data + point * stride)
        .map(|at| DVec3::new(value(at), value(at + 4), value(at + 8)))
        .collect()
}

/// Compares with a scan of another driver, which leaves out the height of the beams' origins: every point of theirs
/// is one of ours, by channel and range, at the same azimuth; also at the edges of a field-of-view window.
/// Returns how far each is, deg; `fire_offset_ns` is that driver's idea of when a laser fires.
fn azimuths_off_deg(capture: &str, scan: &str, fire_offset_ns: impl Fn(usize) -> f64) -> Vec<f64> {
    let decoding = decode_capture(capture);
    let beams = decoding.model.beams();
    let mut azimuths_by_sample = std::collections::HashMap::<(usize, u32), Vec<f64>>::new();
    for frame in &decoding.frames {
        for index in 0..frame.columns() * frame.channels {
            let (column, channel) = (index / frame.channels, index % frame.channels);
            let travelled_rad = frame.azimuth_rate_rad_per_ns * fire_offset_ns(channel);
            let azimuth_rad =
                frame.column_azimuth_rad[column] + beams[channel].azimuth_offset_rad + travelled_rad;
            for layer in [Some(&frame.first), frame.second.as_ref()].into_iter().flatten() {
                let key = (channel, layer.range_mm[index]);
                azimuths_by_sample.entry(key).or_default().push(azimuth_rad.to_degrees());
            }
        }
    }
    let unit_mm = f64::from(if beams.len() == 16 { 2 } else { 4 });
    let theirs = pcd_positions(&format!("captures/velodyne/{scan}.pcd"));
    assert!(theirs.len() > 10_000);
    let nearest_deg = |position_m: &DVec3| {
        let elevation_rad = (position_m.z / position_m.length()).asin();
        let off_rad = |channel: &usize| (beams[*channel].elevation_rad - elevation_rad).abs();
        let channel = (0..beams.len()).min_by(|a, b| off_rad(a).total_cmp(&off_rad(b))).unwrap();
        let range_mm = (position_m.length() * 1e3 / unit_mm).round() * unit_mm;
        let azimuth_deg = f64::atan2(-position_m.y, position_m.x).to_degrees();
        let off_deg = |ours: &f64| ((ours - azimuth_deg + 180.0).rem_euclid(360.0) - 180.0).abs();
        let samples = azimuths_by_sample.get(&(channel, range_mm as u32));
        samples.into_iter().flatten().map(off_deg).fold(f64::INFINITY, f64::min)
    };
    theirs.iter().map(nearest_deg).collect()
}

/// That driver lets the lasers of a VLP-32 fire one by one (they fire in pairs) and does not interpolate in the last
/// block of a packet; its other azimuths are ours to its rounding.
fn check_azimuths_off(off_deg: &[f64], block_deg: f64) {
    let close = off_deg.iter().filter(|off_deg| **off_deg < 0.011).count();
    assert!(close * 10 > off_deg.len() * 8, "{close} of {}", off_deg.len());
    let worst_deg = off_deg.iter().copied().fold(0.0, f64::max);
    assert!(worst_deg < block_deg, "{worst_deg}");
}

fn nebula_vlp32_scan() {
    let one_by_one_ns = |channel: usize| channel as f64 * 2304.0;
    let off_deg = azimuths_off_deg("nebula_vlp32", "nebula_vlp32_1713492677464078412", one_by_one_ns);
    check_azimuths_off(&off_deg, 31.0 * 2304e-9 * 3600.0 + 0.011);
}

fn nebula_vlp16_scan() {
    let fire_offset_ns = |channel: usize| channel as f64 * 2304.0;
    let off_deg = azimuths_off_deg("nebula_vlp16", "nebula_vlp16_1673400472138016708", fire_offset_ns);
    check_azimuths_off(&off_deg, 2.0 * 55_296e-9 * 3600.0 + 0.011);
}

/// Behind the dark sector time goes on where the next packet says, and the spin is as steady as elsewhere.
fn field_of_view_gap() {
    let decoding = decode_capture("nebula_vlp32");
    let mut gaps = 0;
    for frame in &decoding.frames {
        for column in 1..frame.columns() {
            let step_ns = frame.column_time_ns[column] - frame.column_time_ns[column - 1];
            let step_rad = (frame.column_azimuth_rad[column] - frame.column_azimuth_rad[column - 1])
                .rem_euclid(std::f64::consts::TAU);
            let expected_ns = step_rad / frame.azimuth_rate_rad_per_ns;
            if step_rad > 0.05 {
                gaps += 1;
                assert!((step_ns as f64 - expected_ns).abs() < 2e5, "gap of {step_rad} rad, {step_ns} ns");
                assert!((48_000_000..51_000_000).contains(&step_ns));
            } else {
                assert!(step_ns.abs_diff(55_296) < 1500, "{step_ns}");
            }
        }
    }
    assert_eq!(gaps, 5);
}

/// The unit's calibration comes along in the packets.
fn synthetic_hdl64e_s2() {
    let name = "synthetic/syn_hdl64e_S2_single_with_calib";
    let decoding = decode_capture(name);
    assert_eq!(decoding.model.name, "hdl-64e-s2");
    assert_eq!(decoding.model.corrections().len(), 64);
    compare(name, &decoding, CLOSE);
}

/// The GPS sentence and the pulse of a VLP-16 whose clock is locked, and of an HDL-32E with its inertial units.
fn position_packets() {
    let positions = |name: &str| {
        let mut decoder = VelodyneDecoder::new(Options::default());
        let mut positions = Vec::new();
        for datagram in datagrams(&format!("captures/velodyne/{name}.pcap")) {
            let mut take = |decoded: Decoded<'_>| {
                if let Decoded::Position(position) = decoded {
                    positions.push(position.clone());
                }
            };
            decoder.push(&datagram.packet(), &mut take).unwrap();
            if datagram.payload.len() == 512 {
                let again = positions.last().unwrap().encode();
                let sent = &datagram.payload;
                assert_eq!((&again[14..38], &again[0xBB..0xCE]), (&sent[14..38], &sent[0xBB..0xCE]));
                let text = positions.last().unwrap().sentence.len();
                assert_eq!(again[0xCE..0xCE + text], sent[0xCE..0xCE + text]);
            }
        }
        positions
    };
    let locked = positions("mrpt_vlp16_gps");
    assert_eq!(locked.len(), 57);
    for position in &locked {
        assert_eq!(position.pulse, PulseState::Locked);
        let fix = position.fix().unwrap();
        assert_eq!(fix.date, Some((2016, 1, 21)));
        assert!(fix.valid);
        let utc_ns = position.utc_ns().unwrap();
        assert!(utc_ns.abs_diff(fix.utc_ns().unwrap()) < 2_000_000_000);
        assert!(utc_ns.abs_diff(position.host_time_ns) < 1_000_000_000);
    }
    assert!(locked.windows(2).all(|pair| pair[0].stamp_us < pair[1].stamp_us));
    let hdl_32e = positions("rustlidar_hdl32e_named_vlp32");
    assert_eq!(hdl_32e.len(), 9);
    for position in &hdl_32e {
        for unit in position.inertial.unwrap() {
            assert!((20.0..60.0).contains(&unit.temperature_c), "{unit:?}");
            assert!(unit.rate_rad_s.abs() < 1.0, "{unit:?}");
        }
    }
    assert_eq!(positions("rustlidar_vlp16").len(), 16);
}

/// A look-alike with block flags and six more bytes.
fn vli_16_is_refused() {
    let datagrams = datagrams("captures/ouster/VLI-16-one-packet.pcap");
    assert_eq!(datagrams.len(), 1);
    let mut decoder = VelodyneDecoder::new(Options::default());
    assert_eq!(decoder.claim(&datagrams[0].packet()), Claim::No);
    let rejected = decoder.push(&datagrams[0].packet(), &mut |_| panic!("nothing comes of it")).unwrap_err();
    assert!(matches!(&rejected, Rejected::Foreign { reason } if reason.contains("1212")), "{rejected}");
    decoder.finish(&mut |_| panic!("nothing comes of it"));
    assert_eq!(decoder.stats().foreign, 1);
}

/// Every packet of a capture is claimed, before and after the first, and no other sensor's is.
fn claims() {
    let vlp_16 = datagrams("captures/velodyne/mrpt_vlp16_gps.pcap");
    let hdl_32e = datagrams("captures/velodyne/rustlidar_hdl32e_named_vlp32.pcap");
    let ouster = datagrams("captures/ouster/OS-2-32-U0_v2.0.0_1024x10.pcap");
    let mut decoder = VelodyneDecoder::new(Options::default());
    assert!(vlp_16.iter().all(|datagram| decoder.claim(&datagram.packet()) >= Claim::Possible));
    assert!(ouster.iter().all(|datagram| decoder.claim(&datagram.packet()) == Claim::No));
    for datagram in &vlp_16 {
        decoder.push(&datagram.packet(), &mut |_| {}).unwrap();
        assert_eq!(decoder.claim(&datagram.packet()), Claim::Familiar);
    }
    let data = |datagram: &&Datagram| datagram.payload.len() == 1206;
    assert!(hdl_32e.iter().filter(data).all(|datagram| decoder.claim(&datagram.packet()) == Claim::No));
}

/// Frames that were decoded are encoded and decoded again: the same frames.
fn recordings_are_encoded_again() {
    for (name, mode) in [
        ("mrpt_vlp16_gps", ReturnMode::Strongest),
        ("nebula_vlp16", ReturnMode::Dual),
        ("nebula_vls128", ReturnMode::Strongest),
        ("rustlidar_hdl32e_named_vlp32", ReturnMode::Strongest),
        ("synthetic/syn_vlp32c_dual", ReturnMode::Dual),
    ] {
        let decoding = decode_capture(name);
        let product = Product::from_name(&decoding.model.name).unwrap();
        let mut encoder = VelodyneEncoder::new(product, mode);
        let mut again = Vec::new();
        let original = datagrams(&format!("captures/velodyne/{name}.pcap"));
        let mut take = |_: u64, payload: &[u8; 1206]| {
            again.push(Datagram { payload: payload.to_vec(), ..original[again.len()].clone() });
        };
        for frame in &decoding.frames {
            encoder.push_frame(frame, &mut take);
        }
        encoder.finish(&mut take);
        let second = decode(&again, Options::default());
        assert_eq!(second.frames.len(), decoding.frames.len(), "{name}");
        for (frame, expected) in second.frames.iter().zip(&decoding.frames) {
            assert_eq!((&frame.first, &frame.second), (&expected.first, &expected.second), "{name}");
            for column in 0..frame.columns() {
                let off_rad = frame.column_azimuth_rad[column] - expected.column_azimuth_rad[column];
                assert!(off_rad.abs() < 1e-5, "{name}: column {column} is {off_rad} rad off");
                let off_ns = frame.column_time_ns[column].abs_diff(expected.column_time_ns[column]);
                // stamps are whole microseconds
                assert!(off_ns <= 2000, "{name}: column {column} is {off_ns} ns off");
            }
        }
    }
}
