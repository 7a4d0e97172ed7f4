//! A sensor may be set otherwise while it is recorded. After a pause, another initialization or another pace of columns its
//! packets are held until a revolution of them shows the mode; then they are decoded in it, and none counts as lost or damaged.

use super::decoder::OusterDecoder;
use super::evidence::{Break, Evidence, Mode, Seen};
use crate::Packet;

/// Revolutions of the largest mode that are held at most.
const MOST_COLUMNS: usize = 2 * 4096;

impl OusterDecoder {
    /// Whether a lidar packet is held until more of them show how the sensor is set.
    pub(super) fn is_held(&mut self, packet: &Packet<'_>, init_id: u32, seen: Seen) -> bool {
        let bytes = packet.payload;
        if self.held.is_empty() {
            match self.broken(bytes, init_id, &seen) {
                None => return false,
                Some(Break::Turn) => {
                    self.evidence.forget_turns();
                    return false;
                }
                Some(Break::Segment) => self.evidence = Evidence::default(),
            }
        }
        self.held.push(packet);
        if !self.is_damaged(bytes) {
            self.evidence.take(&self.metadata.packet_format(), seen, init_id, bytes);
        }
        let most = MOST_COLUMNS / self.metadata.columns_per_packet;
        if self.evidence.is_decided() || self.held.len() >= most {
            self.release();
        }
        true
    }

    /// Decodes the held packets in the mode that they show.
    pub(super) fn release(&mut self) {
        let held = std::mem::take(&mut self.held);
        let Some(first) = held.packets().next() else { return };
        let since_ns = Some(first.host_time_ns);
        if let Some(mode) = self.evidence.other_mode(&self.metadata, Mode::of(&self.given))
            && let Some((init_id, seen)) = self.sight(first.payload)
        {
            let (stream, mut output) = self.stream_and_output();
            stream.end_segment(&mut output, Some(init_id), seen.frame_id);
            self.set_mode(mode, since_ns);
        }
        if let Some(window) = self.evidence.wider_window(&self.metadata) {
            self.set_window(window, since_ns);
        }
        for packet in held.packets() {
            let _ = self.decode(&packet); // counted where it is refused
        }
    }
}
