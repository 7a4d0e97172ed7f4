//! Packets held against metadata before they are decoded: what contradicts is corrected and reported.

use super::decoder::OusterDecoder;
use super::evidence::{Break, Correction, Evidence, Mode, Seen};
use super::profile::Profile;
use super::stream::Stream;
use super::wire::{Header, PacketKind, check_crc};

/// What sensors can be set to.
const COLUMNS_PER_PACKET: [usize; 5] = [16, 8, 4, 2, 1];

impl OusterDecoder {
    /// What packets and metadata do not agree on.
    pub fn corrections(&self) -> &[Correction] {
        &self.corrections
    }

    /// Looks at a packet before any is decoded.
    pub(crate) fn learn(&mut self, bytes: &[u8]) {
        self.doubt_layout(bytes);
        if let Some((init_id, seen)) = self.sight(bytes) {
            self.has_learned |= self.broken(bytes, init_id, &seen) == Some(Break::Segment);
            if self.has_learned {
                return; // the sensor may be set otherwise from here on
            }
            self.look(bytes, init_id, seen);
        }
        self.doubt_window();
    }

    /// What was learned holds for the first packets, which come again.
    pub(crate) fn end_learning(&mut self) {
        self.evidence = Evidence::default();
    }

    /// Until a packet of the sensor was looked at: its header may be laid out otherwise, and its columns be fewer.
    pub(super) fn doubt_layout(&mut self, bytes: &[u8]) {
        if self.metadata.profile.has_packet_header() && !self.is_met {
            let header = self.header_kind(bytes);
            if header != self.metadata.header {
                self.metadata.header = header;
                self.stream = Stream::new(&self.metadata);
            }
            self.doubt_columns_per_packet(bytes);
        }
    }

    /// Holds a lidar packet against the metadata; what contradicts is corrected before it is decoded.
    pub(super) fn look(&mut self, bytes: &[u8], init_id: u32, seen: Seen) {
        if !self.evidence.is_open_to(init_id) {
            self.evidence.follow(seen);
            return;
        }
        if self.is_damaged(bytes) {
            return;
        }
        if !std::mem::replace(&mut self.is_met, true) && self.metadata.init_id != 0 && init_id != 0 {
            let stated = self.metadata.init_id;
            self.correct("initialization_id", stated.to_string(), init_id.to_string(), None);
        }
        self.evidence.take(&self.metadata.packet_format(), seen, init_id, bytes);
        self.stream.is_settled = self.evidence.has_turned();
        if let Some(mode) = self.evidence.other_mode(&self.metadata, Mode::of(&self.given)) {
            self.set_mode(mode, None);
        }
        if let Some(window) = self.evidence.wider_window(&self.metadata) {
            self.set_window(window, None);
        }
    }

    /// Where a lidar packet of this sensor begins, and its initialization id.
    pub(super) fn sight(&self, bytes: &[u8]) -> Option<(u32, Seen)> {
        if bytes.len() != self.lidar_bytes || self.lidar_bytes == 0 {
            return None;
        }
        let format = self.metadata.packet_format();
        let (frame_id, init_id) = match self.metadata.profile {
            Profile::Legacy => (format.legacy_frame_id(format.column(bytes, 0)), 0),
            _ => match Header::read(self.metadata.header, bytes) {
                Some(Header { kind: PacketKind::Lidar, frame_id, init_id, serial, .. })
                    if self.serial.is_none_or(|own| own == serial) =>
                {
                    (frame_id, init_id)
                }
                _ => return None,
            },
        };
        Some((init_id, Seen::of(&format, frame_id, bytes)))
    }

    pub(super) fn is_damaged(&self, bytes: &[u8]) -> bool {
        let has_crc = self.metadata.profile != Profile::Legacy;
        self.ensure_columns(bytes).is_err() || (has_crc && check_crc(bytes).is_err())
    }

    /// How a whole lidar packet does not continue what came before it.
    pub(super) fn broken(&self, bytes: &[u8], init_id: u32, seen: &Seen) -> Option<Break> {
        let broken = self.evidence.broken(&self.metadata, init_id, seen)?;
        (!self.is_damaged(bytes)).then_some(broken)
    }

    pub(super) fn set_mode(&mut self, mode: Mode, since_ns: Option<u64>) {
        let before = self.metadata.mode();
        self.metadata.set_mode(&self.given, mode.columns, mode.rate_hz);
        self.correct("lidar_mode", before, self.metadata.mode(), since_ns);
        self.stream.follow(&self.metadata);
    }

    /// A window that is narrower than that of the metadata shows after some revolutions only.
    fn doubt_window(&mut self) {
        if let Some(window) = self.evidence.other_window(&self.metadata) {
            self.set_window(window, None);
        }
    }

    pub(super) fn set_window(&mut self, window: [usize; 2], since_ns: Option<u64>) {
        let before = std::mem::replace(&mut self.metadata.column_window, window);
        self.correct("column_window", format!("{before:?}"), format!("{window:?}"), since_ns);
        self.stream.follow(&self.metadata);
    }

    /// Packets of fewer columns, as newer firmware can be set to send them.
    fn doubt_columns_per_packet(&mut self, bytes: &[u8]) {
        let own = self.metadata.packet_format();
        let is_lidar = Header::read(own.header, bytes)
            .is_some_and(|header| header.kind == PacketKind::Lidar && self.serial == Some(header.serial));
        if !is_lidar || bytes.len() == self.lidar_bytes || own.profile == Profile::Off {
            return;
        }
        let stated = own.columns_per_packet;
        for columns_per_packet in COLUMNS_PER_PACKET {
            self.metadata.columns_per_packet = columns_per_packet;
            let format = self.metadata.packet_format();
            if format.packet_bytes() == bytes.len() && self.ensure_columns(bytes).is_ok() {
                self.lidar_bytes = bytes.len();
                self.stream = Stream::new(&self.metadata);
                self.correct("columns_per_packet", stated.to_string(), columns_per_packet.to_string(), None);
                return;
            }
        }
        self.metadata.columns_per_packet = stated;
    }

    /// Notes a setting that changed, from the first packet on or from a later one.
    fn correct(&mut self, setting: &'static str, before: String, found: String, since_ns: Option<u64>) {
        if before == found {
            return;
        }
        let known = self.corrections.iter_mut().rfind(|known| known.setting == setting);
        match known {
            // what only the first packets seemed to show
            Some(known) if since_ns.is_none() => known.found = found,
            _ => self.corrections.push(Correction { setting, stated: before, found, since_ns }),
        }
        self.corrections.retain(|known| known.stated != known.found);
    }
}
