//! Packets of sensors that see the same everywhere: for tests of programs that read packets.

use crate::ouster::{Metadata, OusterEncoder};
use crate::velodyne::{Column, Product, ReturnMode, VelodyneEncoder};
use crate::{Frame, Layer};

/// Lidar packets of a revolution that begins at this time, every return from 4 m.
pub fn ouster_revolution(metadata: &Metadata, frame_id: u32, start_ns: u64) -> Vec<Vec<u8>> {
    let (columns, channels) = (metadata.columns_per_frame, metadata.pixels_per_column);
    let column_ns = 1e9 / (metadata.frame_rate_hz * columns as f64);
    let frame = Frame {
        frame_id,
        channels,
        column_time_ns: (0..columns).map(|column| start_ns + (column as f64 * column_ns) as u64).collect(),
        column_azimuth_rad: vec![0.0; columns],
        column_valid: vec![true; columns],
        first: Layer {
            range_mm: vec![4000; columns * channels],
            reflectivity: vec![5; columns * channels],
            ..Layer::default()
        },
        ..Frame::default()
    };
    let mut packets = Vec::new();
    OusterEncoder::new(metadata.clone()).frame(&frame, &mut |packet| packets.push(packet.to_vec()));
    packets
}

/// Data packets of so many firing cycles, every return from half a metre.
pub fn velodyne_columns(product: Product, columns: u64) -> Vec<Vec<u8>> {
    let mut encoder = VelodyneEncoder::new(product, ReturnMode::Strongest);
    let (ranges, levels) = (vec![500; product.lasers()], vec![9; product.lasers()]);
    let mut packets = Vec::new();
    for column in 0..columns {
        let column = Column {
            time_ns: 1_000_000_000 + column * product.cycle_ns() as u64,
            azimuth_rad: column as f64 * 0.003,
            range_mm: &ranges,
            reflectivity: &levels,
            second: None,
        };
        encoder.push_column(column, &mut |_, packet| packets.push(packet.to_vec()));
    }
    packets
}
