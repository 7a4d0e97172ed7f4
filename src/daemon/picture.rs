//! What the page draws, as bytes. All numbers are little-endian; every message begins with 32 bytes:
//!
//! ```text
//! 0  u8   kind: 1 points, 2 cells
//! 1  u8   points: sensor, in the order of the configuration
//! 2  u16  1, the version of this layout
//! 4  u32  how many points or cells follow
//! 8  u64  points: kernel's stamp of the last packet in them, UTC ns; cells: when they were counted
//! 16 f32  origin x, y, z, m (world: x forward, y left, z up)
//! 28 f32  m in one count; of cells, the edge of a cell
//! ```
//!
//! A point is `i16 x, y, z` in counts from the origin, `u8` reflectivity, `u8` channel (255 and above: 255). A cell is `u16 i, j, k`, then
//! `u8` 0 predicted and unseen, 1 predicted and seen, 2 seen and not predicted, then `u8` 0.

use glam::DVec3;

/// First byte of a message of points.
pub const POINTS_KIND: u8 = 1;
/// First byte of a message of cells.
pub const COVERAGE_KIND: u8 = 2;
/// Bytes before the first point or cell.
#[cfg(test)]
pub(super) const HEADER_BYTES: usize = 32;
/// Metres in one count of a point: 327 m around the platform.
const COUNT_M: f64 = 0.01;

/// Points of a sensor with their reflectivities and channels; what is too far from the origin is left out.
pub(super) fn points(sensor: usize, time_ns: u64, origin_m: DVec3, points_m: &[(DVec3, [u8; 2])]) -> Vec<u8> {
    let mut bytes = header(POINTS_KIND, sensor as u8, time_ns, origin_m, COUNT_M);
    let mut count = 0u32;
    for (point_m, shown) in points_m {
        let counts = ((*point_m - origin_m) / COUNT_M).round();
        if counts.abs().max_element() > f64::from(i16::MAX) {
            continue;
        }
        count += 1;
        for value in counts.to_array() {
            bytes.extend_from_slice(&(value as i16).to_le_bytes());
        }
        bytes.extend_from_slice(shown);
    }
    bytes[4..8].copy_from_slice(&count.to_le_bytes());
    bytes
}

/// Cells with how they are drawn.
pub(super) fn cells(time_ns: u64, origin_m: DVec3, edge_m: f64, cells: &[([u16; 3], u8)]) -> Vec<u8> {
    let mut bytes = header(COVERAGE_KIND, 0, time_ns, origin_m, edge_m);
    for (place, state) in cells {
        place.iter().for_each(|at| bytes.extend_from_slice(&at.to_le_bytes()));
        bytes.extend_from_slice(&[*state, 0]);
    }
    bytes[4..8].copy_from_slice(&(cells.len() as u32).to_le_bytes());
    bytes
}

fn header(kind: u8, sensor: u8, time_ns: u64, origin_m: DVec3, count_m: f64) -> Vec<u8> {
    let mut bytes = vec![kind, sensor, 1, 0, 0, 0, 0, 0];
    bytes.extend_from_slice(&time_ns.to_le_bytes());
    for value in origin_m.to_array().into_iter().chain([count_m]) {
        bytes.extend_from_slice(&(value as f32).to_le_bytes());
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_stand_where_the_layout_says() {
        let near = DVec3::new(101.0, -2.345, 0.5);
        let far = DVec3::new(-400.0, 0.0, 0.0);
        let bytes =
            points(3, 0x0102_0304_0506_0708, DVec3::new(100.0, 0.0, 0.0), &[(near, [200, 7]), (far, [1, 0])]);
        assert_eq!(bytes.len(), HEADER_BYTES + 8);
        assert_eq!((bytes[0], bytes[1], bytes[2], bytes[4], bytes[8]), (POINTS_KIND, 3, 1, 1, 8));
        assert_eq!(f32::from_le_bytes(bytes[16..20].try_into().unwrap()), 100.0);
        let counts: Vec<i16> =
            bytes[32..38].chunks(2).map(|two| i16::from_le_bytes([two[0], two[1]])).collect();
        assert_eq!((counts, &bytes[38..]), (vec![100, -235, 50], &[200, 7][..])); // -234.5 rounds away from zero
    }
}
