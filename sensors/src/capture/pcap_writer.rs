//! Writes classic pcap with nanosecond stamps, for tools that do not read pcapng.
//!
//! Source of the layout: IETF draft-ietf-opsawg-pcap, sections 4 and 5.

use std::io::{self, Write};

use super::headers::{MAX_FRAME, append_frame};
use crate::Packet;

const MAGIC_NANOSECONDS: u32 = 0xa1b2_3c4d;
const LINKTYPE_ETHERNET: u32 = 1;
const SNAP_LENGTH: u32 = 262_144;

/// Writes UDP packets as classic pcap. Every record reaches the sink in one `write_all`.
pub struct PcapWriter<W: Write> {
    sink: W,
    record: Vec<u8>,
    identification: u16,
}

impl<W: Write> PcapWriter<W> {
    /// Starts a file: writes its header.
    pub fn new(mut sink: W) -> io::Result<Self> {
        let mut header = [0; 24];
        header[..4].copy_from_slice(&MAGIC_NANOSECONDS.to_le_bytes());
        header[4..6].copy_from_slice(&2_u16.to_le_bytes()); // version 2.4
        header[6..8].copy_from_slice(&4_u16.to_le_bytes());
        header[16..20].copy_from_slice(&SNAP_LENGTH.to_le_bytes());
        header[20..24].copy_from_slice(&LINKTYPE_ETHERNET.to_le_bytes());
        sink.write_all(&header)?;
        Ok(Self { sink, record: Vec::with_capacity(MAX_FRAME + 16), identification: 0 })
    }

    /// Writes one packet behind Ethernet, IP and UDP headers made from its addresses. The error kind `InvalidInput`
    /// says that the packet cannot be written (payload longer than UDP allows, mixed address families, a time past
    /// 2106, which the format cannot hold); nothing is written then.
    pub fn write(&mut self, packet: &Packet<'_>) -> io::Result<()> {
        let seconds = u32::try_from(packet.host_time_ns / 1_000_000_000).map_err(|_| {
            io::Error::new(io::ErrorKind::InvalidInput, "classic pcap holds times up to 2106")
        })?;
        let nanoseconds = (packet.host_time_ns % 1_000_000_000) as u32; // below 1e9
        self.record.clear();
        self.record.extend_from_slice(&seconds.to_le_bytes());
        self.record.extend_from_slice(&nanoseconds.to_le_bytes());
        self.record.extend_from_slice(&[0; 8]);
        append_frame(packet, self.identification, &mut self.record)?;
        let length = (self.record.len() - 16) as u32; // at most MAX_FRAME
        self.record[8..12].copy_from_slice(&length.to_le_bytes());
        self.record[12..16].copy_from_slice(&length.to_le_bytes());
        self.sink.write_all(&self.record)?;
        self.identification = self.identification.wrapping_add(1);
        Ok(())
    }

    /// Flushes and returns the sink.
    pub fn close(mut self) -> io::Result<W> {
        self.sink.flush()?;
        Ok(self.sink)
    }
}
