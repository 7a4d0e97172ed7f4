//! Every capture against what ouster-sdk decoded from it.

use std::path::{Path, PathBuf};

use glam::DVec3;
use sensors::projection::{self, Projector};
use sensors::{Frame, Layer, SensorModel};
use serde_json::Value;
use sha2::{Digest, Sha256};

use super::{datagrams, decode};
use crate::support::shared;
use sensors::ouster::Metadata;

const POINT_TOLERANCE_M: f64 = 1e-9;

pub fn captures_match_their_digests() {
    let mut digests = Vec::new();
    for folder in ["captures/ouster", "captures/ouster/synthetic"] {
        for entry in std::fs::read_dir(shared(folder)).unwrap() {
            let path = entry.unwrap().path();
            if path.to_str().unwrap().ends_with(".digest.json") {
                digests.push(path);
            }
        }
    }
    assert!(digests.len() >= 20, "{digests:?}");
    digests.sort();
    for digest in digests {
        matches_digest(&digest);
    }
}

fn matches_digest(path: &Path) {
    let name = path.file_name().unwrap().to_str().unwrap();
    let digest: Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    let metadata_path = path.with_file_name(digest["metadata"].as_str().unwrap());
    let text = std::fs::read_to_string(&metadata_path).unwrap();
    let metadata = Metadata::parse(&text, name).unwrap();
    assert_eq!(metadata.product_line, digest["prod_line"], "{name}");
    assert_eq!(metadata.profile.name(), digest["profile"], "{name}");
    assert_eq!(metadata.imu_profile.name(), digest["imu_profile"], "{name}");
    assert_eq!(metadata.columns_per_frame, digest["columns_per_frame"], "{name}");
    assert_eq!(metadata.pixels_per_column, digest["pixels_per_column"], "{name}");
    assert_eq!(metadata.columns_per_packet, digest["columns_per_packet"], "{name}");
    assert_eq!(serde_json::json!(metadata.column_window), digest["column_window"], "{name}");

    let capture = PathBuf::from(path.to_str().unwrap().replace(".digest.json", ".pcap"));
    let decoding = decode(&metadata, &datagrams(&capture));
    let frames = digest["frames"].as_array().unwrap();
    let ids: Vec<_> = decoding.frames.iter().map(|frame| frame.frame_id).collect();
    let expected_ids: Vec<_> =
        frames.iter().map(|frame| frame["frame_id"].as_u64().unwrap() as u32).collect();
    assert_eq!(ids, expected_ids, "{name}: {:?}", decoding.stats);
    assert_eq!(decoding.stats.malformed + decoding.stats.crc_errors + decoding.stats.foreign, 0, "{name}");
    for (frame, expected) in decoding.frames.iter().zip(frames) {
        let name = format!("{name}, frame {}", frame.frame_id);
        matches_frame(&name, &metadata.model, frame, expected);
    }
}

fn matches_frame(name: &str, model: &SensorModel, frame: &Frame, expected: &Value) {
    assert_eq!(frame.valid_columns(), expected["valid_columns"], "{name}");
    assert_eq!(frame.complete, expected["complete"], "{name}");
    let span = frame.time_span_ns().map(|span| serde_json::json!(span)).unwrap_or_default();
    assert_eq!(span, expected["column_timestamp_first_last_ns"], "{name}");
    assert_eq!(expected["shot_limiting"], "NORMAL");
    assert_eq!((frame.health.shot_limiting, frame.health.thermal_shutdown), (0, 0), "{name}");
    matches_layer(name, model, frame, &frame.first, expected, "");
    if let Some(second) = &frame.second {
        matches_layer(name, model, frame, second, expected, "2");
    }
    let hashes = expected["sha256"].as_object().unwrap();
    for (field, hash) in hashes {
        let width = expected["dtype"][field].as_str().unwrap();
        assert_eq!(field_sha256(frame, field, width), *hash, "{name}: {field}");
    }
    let samples = expected["samples"].as_array().map(Vec::as_slice).unwrap_or_default();
    for sample in samples {
        let [row, column] = ["row", "column"].map(|key| sample[key].as_u64().unwrap() as usize);
        let at = frame.index(column, row);
        assert_eq!(frame.first.range_mm[at], sample["range_mm"], "{name}: {row}, {column}");
        assert_eq!(frame.first.reflectivity[at], sample["reflectivity"], "{name}: {row}, {column}");
        assert_eq!(frame.column_time_ns[column], sample["timestamp_ns"], "{name}: {row}, {column}");
        let range_m = f64::from(frame.first.range_mm[at]) * 1e-3;
        let point = projection::sample_ray(model, frame, column, row).at_range(range_m);
        let distance = (point - vector(&sample["xyz_m"])).length();
        assert!(distance < POINT_TOLERANCE_M, "{name}: {row}, {column}: {distance} m off");
    }
}

fn matches_layer(
    name: &str,
    model: &SensorModel,
    frame: &Frame,
    layer: &Layer,
    expected: &Value,
    suffix: &str,
) {
    let Some(points) = expected.get(format!("points{suffix}")) else {
        assert_eq!(layer.points(), 0, "{name}: points{suffix}");
        return;
    };
    assert_eq!(layer.points(), *points, "{name}: points{suffix}");
    let range_sum_mm: u64 = layer.range_mm.iter().map(|range| u64::from(*range)).sum();
    assert_eq!(range_sum_mm, expected[format!("range_sum_mm{suffix}")], "{name}: range_sum_mm{suffix}");
    let mut points_m = Vec::new();
    projection::points_f64(model, frame, layer, &mut points_m);
    let mut fast_m = Vec::new();
    Projector::new(model).points_f64(frame, layer, &mut fast_m);
    let farthest = points_m.iter().zip(&fast_m).map(|(exact, fast)| (*exact - DVec3::from(*fast)).length());
    assert!(farthest.fold(0.0, f64::max) < POINT_TOLERANCE_M, "{name}: the fast way{suffix}");
    let sum: DVec3 = points_m.iter().sum();
    let off = (sum - vector(&expected[format!("xyz_sum_m{suffix}")])).length();
    assert!(off < POINT_TOLERANCE_M * layer.points() as f64, "{name}: xyz_sum_m{suffix}: {off} m off");
}

fn vector(value: &Value) -> DVec3 {
    DVec3::from_array([0, 1, 2].map(|axis| value[axis].as_f64().unwrap()))
}

/// Of the field as the peer holds it: row by row, each row in order of measurement id.
fn field_sha256(frame: &Frame, field: &str, width: &str) -> String {
    let (layer, field) = match field.strip_suffix('2') {
        Some(field) => (frame.second.as_ref().unwrap(), field),
        None => (&frame.first, field),
    };
    let value = |at: usize| match field {
        "RANGE" => layer.range_mm[at],
        "REFLECTIVITY" => u32::from(layer.reflectivity[at]),
        "SIGNAL" => u32::from(layer.signal[at]),
        "NEAR_IR" => u32::from(layer.near_ir[at]),
        "FLAGS" => u32::from(layer.flags[at]),
        other => panic!("field {other} is not known here"),
    };
    let bytes = match width {
        "uint8" => 1,
        "uint16" => 2,
        "uint32" => 4,
        other => panic!("width {other} is not known here"),
    };
    let mut hash = Sha256::new();
    for row in 0..frame.channels {
        for column in 0..frame.columns() {
            hash.update(&value(frame.index(column, row)).to_le_bytes()[..bytes]);
        }
    }
    hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}
