//! Metadata as the nested JSON document of the sensor's HTTP interface.

use glam::DAffine3;
use serde_json::{Map, Value, json};

use super::{Metadata, Profile};

pub(super) fn to_json(metadata: &Metadata) -> String {
    let document = json!({
        "beam_intrinsics": beam_intrinsics(metadata),
        "calibration_status": {},
        "config_params": config_params(metadata),
        "imu_data_format": {
            "imu_measurements_per_packet": metadata.imu_samples_per_packet,
            "imu_packets_per_frame": metadata.imu_packets_per_frame,
        },
        "imu_intrinsics": { "imu_to_sensor_transform": matrix_mm(metadata.sensor_from_imu) },
        "lidar_data_format": {
            "column_window": metadata.column_window,
            "columns_per_frame": metadata.columns_per_frame,
            "columns_per_packet": metadata.columns_per_packet,
            "fps": rounded(metadata.frame_rate_hz),
            "header_type": metadata.header.name(),
            "pixel_shift_by_row": metadata.pixel_shift_by_row,
            "pixels_per_column": metadata.pixels_per_column,
            "udp_profile_imu": metadata.imu_profile.name(),
            "udp_profile_lidar": metadata.profile.name(),
        },
        "lidar_intrinsics": { "lidar_to_sensor_transform": matrix_mm(metadata.model.sensor_from_lidar()) },
        "sensor_info": {
            "build_date": "",
            "build_rev": "",
            "image_rev": metadata.firmware,
            "initialization_id": metadata.init_id,
            "prod_line": metadata.product_line,
            "prod_pn": "",
            "prod_sn": metadata.serial,
            "status": "RUNNING",
        },
        "user_data": "",
    });
    format!("{document:#}\n")
}

fn beam_intrinsics(metadata: &Metadata) -> Value {
    let beams = metadata.model.beams();
    let degrees = |angles: Vec<f64>| -> Vec<f64> {
        angles.into_iter().map(|angle: f64| round_to(angle.to_degrees(), 1e9)).collect()
    };
    let (radial_mm, z_mm) =
        beams.first().map_or((0.0, 0.0), |beam| (beam.origin_radial_m * 1e3, beam.origin_z_m * 1e3));
    let (radial_mm, z_mm) = (round_to(radial_mm, 1e9), round_to(z_mm, 1e9));
    json!({
        "beam_altitude_angles": degrees(beams.iter().map(|beam| beam.elevation_rad).collect()),
        "beam_azimuth_angles": degrees(beams.iter().map(|beam| beam.azimuth_offset_rad).collect()),
        "beam_to_lidar_transform":
            [1.0, 0.0, 0.0, radial_mm, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, z_mm, 0.0, 0.0, 0.0, 1.0],
        "lidar_origin_to_beam_origin_mm": radial_mm,
    })
}

fn config_params(metadata: &Metadata) -> Value {
    let mut config = Map::new();
    let mode = format!("{}x{}", metadata.columns_per_frame, rounded(metadata.frame_rate_hz));
    config.insert("lidar_mode".into(), mode.into());
    config.insert("columns_per_packet".into(), metadata.columns_per_packet.into());
    config.insert("operating_mode".into(), "NORMAL".into());
    config.insert("udp_profile_lidar".into(), metadata.profile.name().into());
    config.insert("udp_profile_imu".into(), metadata.imu_profile.name().into());
    let lidar_port = if metadata.profile == Profile::Off { Some(0) } else { metadata.lidar_port };
    for (key, port) in [
        ("udp_port_lidar", lidar_port),
        ("udp_port_imu", metadata.imu_port),
        ("udp_port_zm", metadata.zone_port),
    ] {
        if let Some(port) = port {
            config.insert(key.into(), port.into());
        }
    }
    if let Some(destination) = &metadata.destination {
        config.insert("udp_dest".into(), destination.clone().into());
    }
    if let Some(mode) = metadata.timestamp_mode {
        config.insert("timestamp_mode".into(), mode.name().into());
    }
    Value::Object(config)
}

/// 16 numbers row by row, translation in mm.
fn matrix_mm(transform: DAffine3) -> [f64; 16] {
    let rows = transform.matrix3.transpose();
    let t = transform.translation * 1e3;
    let (x, y, z) = (rows.x_axis, rows.y_axis, rows.z_axis);
    let matrix = [x.x, x.y, x.z, t.x, y.x, y.y, y.z, t.y, z.x, z.y, z.z, t.z, 0.0, 0.0, 0.0, 1.0];
    matrix.map(|number| round_to(number, 1e9))
}

fn round_to(number: f64, steps_per_unit: f64) -> f64 {
    let rounded = (number * steps_per_unit).round() / steps_per_unit;
    if rounded == 0.0 { 0.0 } else { rounded }
}

/// A whole number as such, because clients read rates as integers.
fn rounded(rate: f64) -> Value {
    if rate.fract() == 0.0 && rate < 1e6 { Value::from(rate as u64) } else { Value::from(rate) }
}
