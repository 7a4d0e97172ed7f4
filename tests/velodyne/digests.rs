//! Counts, sums, sample points and times of velodyne_decoder 3.1.0.

use glam::DVec3;
use sensors::{Frame, SensorModel};

use super::{Decoding, decode_capture};
use crate::support::shared;

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

pub fn mrpt_vlp16_gps() {
    let decoding = decode_capture("mrpt_vlp16_gps");
    assert_eq!(decoding.model.name, "vlp-16");
    compare("mrpt_vlp16_gps", &decoding, CLOSE);
    assert_eq!(
        (decoding.stats.packets, decoding.stats.lost_packets, decoding.stats.complete_frames),
        (293, 0, 3)
    );
}

pub fn nebula_vlp16() {
    compare("nebula_vlp16", &decode_capture("nebula_vlp16"), CLOSE);
}

pub fn nebula_vlp32() {
    let decoding = decode_capture("nebula_vlp32");
    compare("nebula_vlp32", &decoding, CLOSE);
    assert_eq!(
        (decoding.stats.packets, decoding.stats.lost_packets, decoding.stats.complete_frames),
        (379, 0, 4)
    );
}

/// The peer takes the firing cycle and the stamp's place from two other firmwares' tables (2.7 us a slot, two idle
/// slots after the eighth, stamp 7 us late), we from the measured packet period: up to three slots apart.
pub fn nebula_vls128() {
    let decoding = decode_capture("nebula_vls128");
    compare("nebula_vls128", &decoding, Tolerance { time_ns: 8500, azimuth_deg: 0.04 });
    assert_eq!((decoding.stats.packets, decoding.stats.lost_packets), (2193, 0));
}

/// A VLP-16 that says it is an HDL-32E.
pub fn rustlidar_vlp16() {
    let decoding = decode_capture("rustlidar_vlp16");
    assert_eq!(decoding.model.name, "vlp-16");
    compare("rustlidar_vlp16", &decoding, CLOSE);
}

/// An HDL-32E in a file that says it is a VLP-32.
pub fn rustlidar_hdl32e() {
    let decoding = decode_capture("rustlidar_hdl32e_named_vlp32");
    assert_eq!(decoding.model.name, "hdl-32e");
    compare("rustlidar_hdl32e_named_vlp32", &decoding, CLOSE);
}

pub fn synthetic_hdl32e_dual() {
    compare("synthetic/syn_hdl32e_dual", &decode_capture("synthetic/syn_hdl32e_dual"), CLOSE);
}

pub fn synthetic_vlp32c_dual() {
    compare("synthetic/syn_vlp32c_dual", &decode_capture("synthetic/syn_vlp32c_dual"), CLOSE);
}

/// The unit's calibration comes along in the packets.
pub fn synthetic_hdl64e_s2() {
    let name = "synthetic/syn_hdl64e_S2_single_with_calib";
    let decoding = decode_capture(name);
    assert_eq!(decoding.model.name, "hdl-64e-s2");
    assert_eq!(decoding.model.corrections().len(), 64);
    compare(name, &decoding, CLOSE);
}
