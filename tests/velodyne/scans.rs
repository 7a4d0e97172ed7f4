//! One scan each of another driver, and what happens at the edges of a field-of-view window.

use glam::DVec3;

use super::decode_capture;
use crate::support::shared;

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

pub fn nebula_vlp32_scan() {
    let one_by_one_ns = |channel: usize| channel as f64 * 2304.0;
    let off_deg = azimuths_off_deg("nebula_vlp32", "nebula_vlp32_1713492677464078412", one_by_one_ns);
    check_azimuths_off(&off_deg, 31.0 * 2304e-9 * 3600.0 + 0.011);
}

pub fn nebula_vlp16_scan() {
    let fire_offset_ns = |channel: usize| channel as f64 * 2304.0;
    let off_deg = azimuths_off_deg("nebula_vlp16", "nebula_vlp16_1673400472138016708", fire_offset_ns);
    check_azimuths_off(&off_deg, 2.0 * 55_296e-9 * 3600.0 + 0.011);
}

/// Behind the dark sector time goes on where the next packet says, and the spin is as steady as elsewhere.
pub fn field_of_view_gap() {
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
