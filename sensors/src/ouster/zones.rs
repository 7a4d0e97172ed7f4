//! Zone-monitor packets (firmware 3.2 on). Source: Ouster firmware user manual, "Zone monitor"; size and checksum
//! checked on a captured packet.

use super::wire::{FOOTER_BYTES, HEADER_BYTES, u32_at, u64_at};

/// Zones one packet reports.
pub const ZONES: usize = 16;
/// Bytes of a packet.
pub const PACKET_BYTES: usize = RECORDS_AT + ZONES * RECORD_BYTES + FOOTER_BYTES;

const HASH_BYTES: usize = 32;
const RECORDS_AT: usize = HEADER_BYTES + 8 + HASH_BYTES;
const RECORD_BYTES: usize = 36;
const RANGE_MASK: u32 = (1 << 19) - 1;

/// One zone-monitor packet.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ZoneReport {
    /// Revolution the report is about.
    pub frame_id: u32,
    /// Device time, ns.
    pub time_ns: u64,
    /// Identifies the set of zones the sensor runs.
    pub zone_set_hash: [u8; HASH_BYTES],
    /// Every slot of the packet, live or not.
    pub zones: [ZoneState; ZONES],
}

/// One zone.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ZoneState {
    /// The slot is in use.
    pub live: bool,
    /// Zone number.
    pub id: u8,
    /// Error bits; 0 is fine.
    pub error_flags: u8,
    /// Kind of trigger, 2 bits.
    pub trigger_type: u8,
    /// Triggered now.
    pub triggered: bool,
    /// Frames in a row the zone has been triggered.
    pub triggered_frames: u32,
    /// Pixels inside the zone.
    pub count: u32,
    /// Pixels that something nearer hides.
    pub occluded_count: u32,
    /// Pixels without a measurement.
    pub invalid_count: u32,
    /// Pixels the zone could have.
    pub max_count: u32,
    /// Nearest range in the zone, mm.
    pub min_range_mm: u32,
    /// Farthest range in the zone, mm.
    pub max_range_mm: u32,
    /// Mean range in the zone, mm.
    pub mean_range_mm: u32,
}

/// Reads a packet (its header is read before).
pub(super) fn read(frame_id: u32, packet: &[u8; PACKET_BYTES], out: &mut ZoneReport) {
    out.frame_id = frame_id;
    out.time_ns = u64_at(packet, HEADER_BYTES);
    out.zone_set_hash.copy_from_slice(&packet[HEADER_BYTES + 8..RECORDS_AT]);
    for (zone, record) in out.zones.iter_mut().zip(packet[RECORDS_AT..].chunks_exact(RECORD_BYTES)) {
        *zone = ZoneState {
            live: record[0] & 1 == 1,
            id: record[1],
            error_flags: record[2],
            trigger_type: record[3] >> 2 & 3,
            triggered: record[3] >> 7 == 1,
            triggered_frames: u32_at(record, 4),
            count: u32_at(record, 8),
            occluded_count: u32_at(record, 12),
            invalid_count: u32_at(record, 16),
            max_count: u32_at(record, 20),
            min_range_mm: u32_at(record, 24) & RANGE_MASK,
            max_range_mm: u32_at(record, 28) & RANGE_MASK,
            mean_range_mm: u32_at(record, 32) & RANGE_MASK,
        };
    }
}

/// Writes everything between header and footer.
pub(super) fn write(report: &ZoneReport, packet: &mut [u8]) {
    packet[HEADER_BYTES..HEADER_BYTES + 8].copy_from_slice(&report.time_ns.to_le_bytes());
    packet[HEADER_BYTES + 8..RECORDS_AT].copy_from_slice(&report.zone_set_hash);
    for (zone, record) in report.zones.iter().zip(packet[RECORDS_AT..].chunks_exact_mut(RECORD_BYTES)) {
        record[0] = u8::from(zone.live);
        record[1] = zone.id;
        record[2] = zone.error_flags;
        record[3] = (zone.trigger_type & 3) << 2 | u8::from(zone.triggered) << 7;
        let words = [
            zone.triggered_frames,
            zone.count,
            zone.occluded_count,
            zone.invalid_count,
            zone.max_count,
            zone.min_range_mm.min(RANGE_MASK),
            zone.max_range_mm.min(RANGE_MASK),
            zone.mean_range_mm.min(RANGE_MASK),
        ];
        for (place, word) in record[4..].chunks_exact_mut(4).zip(words) {
            place.copy_from_slice(&word.to_le_bytes());
        }
    }
}
