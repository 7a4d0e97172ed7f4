//! Where packets lie in messages, and what a bag does not state: their sensor and port.

use std::ops::Range;

use sensors::router::Guess;

use super::super::Topic;
use super::super::cursor::{Cursor, Encoding};
use super::super::roles::Role;

pub(super) const OUSTER_LIDAR_PORT: u16 = 7502;
pub(super) const OUSTER_IMU_PORT: u16 = 7503;
pub(super) const OUSTER_ZONE_PORT: u16 = 7504;
pub(super) const VELODYNE_PORT: u16 = 2368;
pub(super) const VELODYNE_POSITION_PORT: u16 = 8308;
/// Data of one packet of a Velodyne.
pub(super) const VELODYNE_BYTES: usize = 1206;

/// The name of the sensor of this topic: topics of one Ouster share a namespace.
pub(super) fn sensor_name(topic: &Topic, role: Role) -> String {
    let name = topic.name.trim_matches('/');
    match (name.rsplit_once('/'), role) {
        (Some((namespace, _)), _) => namespace.to_owned(),
        (None, Role::OusterPacket | Role::OusterMetadata) => "ouster".into(),
        (None, _) => name.to_owned(),
    }
}

pub(super) fn ouster_port(topic: &str) -> u16 {
    let last = topic.rsplit('/').next().unwrap_or_default();
    match last {
        last if last.contains("imu") => OUSTER_IMU_PORT,
        last if last.contains("zone") => OUSTER_ZONE_PORT,
        last if last.contains("position") => VELODYNE_POSITION_PORT, // as `cut` writes them
        _ => OUSTER_LIDAR_PORT,
    }
}

/// Ouster's packets have an even length; drivers before July 2023 wrote one zero byte too many behind them.
pub(super) fn without_extra_byte(stored: &[u8]) -> &[u8] {
    match stored.split_last() {
        Some((0, packet)) if packet.len().is_multiple_of(2) && Guess::of(packet).is_ouster() => packet,
        _ => stored,
    }
}

pub(super) fn place_of(whole: &[u8], part: &[u8]) -> Range<usize> {
    let start = part.as_ptr().addr() - whole.as_ptr().addr();
    start..start + part.len()
}

pub(super) fn ouster_packet(encoding: Encoding, message: &[u8]) -> Option<Range<usize>> {
    let packet = Cursor::new(encoding, message)?.bytes()?;
    Some(place_of(message, packet))
}

pub(super) fn velodyne_packet(encoding: Encoding, message: &[u8]) -> Option<(u64, Range<usize>)> {
    let mut cursor = Cursor::new(encoding, message)?;
    let stamp_ns = cursor.time_ns()?;
    Some((stamp_ns, place_of(message, cursor.take(VELODYNE_BYTES)?)))
}

pub(super) fn velodyne_scan(encoding: Encoding, message: &[u8]) -> Option<Vec<(u64, Range<usize>)>> {
    let mut cursor = Cursor::new(encoding, message)?;
    cursor.header()?;
    let count = cursor.count(8 + VELODYNE_BYTES)?;
    let packet = |_| {
        let stamp_ns = cursor.time_ns()?;
        Some((stamp_ns, place_of(message, cursor.take(VELODYNE_BYTES)?)))
    };
    (0..count).map(packet).collect()
}
