//! Writes pcapng: one interface per sensor, nanosecond stamps, drop counts at the end.
//!
//! Source of the block layouts: IETF draft-ietf-opsawg-pcapng, sections 4.1 to 4.6.

use std::io::{self, Write};

use super::headers::{MAX_FRAME, append_frame};
use crate::Packet;

const SECTION_HEADER: u32 = 0x0a0d_0d0a;
const INTERFACE_DESCRIPTION: u32 = 1;
const INTERFACE_STATISTICS: u32 = 5;
const ENHANCED_PACKET: u32 = 6;
const LINKTYPE_ETHERNET: u16 = 1;
/// Option `if_tsresol`: stamps count 10^-9 s.
const NANOSECONDS: u8 = 9;

/// Writes UDP packets as pcapng. Every block reaches the sink in one `write_all`, so that a crash can cut off at most
/// the last block and everything before it stays readable; a `BufWriter` around the sink keeps that (it flushes
/// between two writes). No allocation per packet.
pub struct PcapngWriter<W: Write> {
    sink: W,
    block: Vec<u8>,
    interfaces: Vec<Interface>,
    identification: u16,
}

#[derive(Clone, Copy, Default)]
struct Interface {
    packets: u64,
    first_time_ns: u64,
    last_time_ns: u64,
}

impl<W: Write> PcapngWriter<W> {
    /// Starts a file: writes the section header.
    pub fn new(sink: W) -> io::Result<Self> {
        let mut writer = Self {
            sink,
            block: Vec::with_capacity(MAX_FRAME + 64),
            interfaces: Vec::new(),
            identification: 0,
        };
        writer.begin(SECTION_HEADER);
        writer.block.extend_from_slice(&0x1a2b_3c4d_u32.to_le_bytes()); // byte-order magic
        writer.block.extend_from_slice(&1_u16.to_le_bytes()); // version 1.0
        writer.block.extend_from_slice(&0_u16.to_le_bytes());
        writer.block.extend_from_slice(&u64::MAX.to_le_bytes()); // section length not given
        writer.option(4, concat!("outrigger ", env!("CARGO_PKG_VERSION")).as_bytes()); // shb_userappl
        writer.end_of_options();
        writer.finish_block()?;
        Ok(writer)
    }

    /// Writes the description of one more interface and returns its number. A sensor's name belongs here: readers
    /// show it (`if_name`). At most 65535 bytes of it are written.
    pub fn add_interface(&mut self, name: &str) -> io::Result<u32> {
        let number = u32::try_from(self.interfaces.len()).map_err(io::Error::other)?;
        self.begin(INTERFACE_DESCRIPTION);
        self.block.extend_from_slice(&LINKTYPE_ETHERNET.to_le_bytes());
        self.block.extend_from_slice(&0_u16.to_le_bytes());
        self.block.extend_from_slice(&0_u32.to_le_bytes()); // no snap length: frames are whole
        let end = name.floor_char_boundary(usize::from(u16::MAX));
        self.option(2, &name.as_bytes()[..end]); // if_name
        self.option(9, &[NANOSECONDS]); // if_tsresol
        self.end_of_options();
        self.finish_block()?;
        self.interfaces.push(Interface::default());
        Ok(number)
    }

    /// Writes one packet, received on the given interface, behind Ethernet, IP and UDP headers made from its
    /// addresses. The error kind `InvalidInput` says that the packet cannot be written (unknown interface, payload
    /// longer than UDP allows, mixed address families); nothing is written then.
    pub fn write(&mut self, interface: u32, packet: &Packet<'_>) -> io::Result<()> {
        let known = self.interfaces.len();
        let Some(entry) = self.interfaces.get(interface as usize) else {
            let reason = format!("interface {interface} of a capture with {known} interfaces");
            return Err(io::Error::new(io::ErrorKind::InvalidInput, reason));
        };
        let first = entry.packets == 0;
        self.begin(ENHANCED_PACKET);
        self.block.extend_from_slice(&interface.to_le_bytes());
        self.time(packet.host_time_ns);
        let lengths_at = self.block.len();
        self.block.extend_from_slice(&[0; 8]);
        append_frame(packet, self.identification, &mut self.block)?;
        let length = (self.block.len() - lengths_at - 8) as u32; // at most MAX_FRAME
        self.block[lengths_at..lengths_at + 4].copy_from_slice(&length.to_le_bytes());
        self.block[lengths_at + 4..lengths_at + 8].copy_from_slice(&length.to_le_bytes());
        self.pad();
        self.finish_block()?;
        self.identification = self.identification.wrapping_add(1);
        let entry = &mut self.interfaces[interface as usize]; // found above
        if first {
            entry.first_time_ns = packet.host_time_ns;
        }
        entry.packets += 1;
        entry.last_time_ns = entry.last_time_ns.max(packet.host_time_ns);
        Ok(())
    }

    /// Packets written so far on an interface.
    pub fn packets(&self, interface: u32) -> u64 {
        self.interfaces.get(interface as usize).map_or(0, |entry| entry.packets)
    }

    /// Hands what the sink buffers to the system.
    pub fn flush(&mut self) -> io::Result<()> {
        self.sink.flush()
    }

    /// The sink, for instance to ask a file to reach the disk.
    pub fn get_ref(&self) -> &W {
        &self.sink
    }

    /// The sink, to be asked about. Writing to it directly breaks the file.
    pub fn get_mut(&mut self) -> &mut W {
        &mut self.sink
    }

    /// The sink as it is.
    pub fn into_sink(self) -> W {
        self.sink
    }

    /// Writes each interface's statistics and returns the flushed sink.
    pub fn close(mut self, drops: &[u64]) -> io::Result<W> {
        self.write_statistics(drops)?;
        Ok(self.sink)
    }

    /// Writes each interface's statistics (packets received and, from `drops`, packets the system dropped before
    /// they could be written; interfaces beyond the slice had none) and flushes the sink. No packet may follow.
    pub fn write_statistics(&mut self, drops: &[u64]) -> io::Result<()> {
        for number in 0..self.interfaces.len() {
            let interface = self.interfaces[number];
            let dropped = drops.get(number).copied().unwrap_or(0);
            self.begin(INTERFACE_STATISTICS);
            self.block.extend_from_slice(&(number as u32).to_le_bytes()); // numbered by add_interface
            self.time(interface.last_time_ns);
            if interface.packets > 0 {
                for (code, time_ns) in [(2, interface.first_time_ns), (3, interface.last_time_ns)] {
                    let halves = [(time_ns >> 32) as u32, time_ns as u32].map(u32::to_le_bytes);
                    self.option(code, halves.as_flattened()); // isb_starttime, isb_endtime
                }
            }
            self.option(4, &(interface.packets + dropped).to_le_bytes()); // isb_ifrecv
            self.option(5, &0_u64.to_le_bytes()); // isb_ifdrop
            self.option(7, &dropped.to_le_bytes()); // isb_osdrop
            self.option(8, &interface.packets.to_le_bytes()); // isb_usrdeliv
            self.end_of_options();
            self.finish_block()?;
        }
        self.sink.flush()
    }

    fn begin(&mut self, block_type: u32) {
        self.block.clear();
        self.block.extend_from_slice(&block_type.to_le_bytes());
        self.block.extend_from_slice(&[0; 4]); // the length, known at the end
    }

    /// A 64-bit stamp as pcapng has it: high half first.
    fn time(&mut self, time_ns: u64) {
        self.block.extend_from_slice(&((time_ns >> 32) as u32).to_le_bytes());
        self.block.extend_from_slice(&(time_ns as u32).to_le_bytes());
    }

    fn option(&mut self, code: u16, value: &[u8]) {
        self.block.extend_from_slice(&code.to_le_bytes());
        self.block.extend_from_slice(&(value.len() as u16).to_le_bytes()); // callers keep to 65535 bytes
        self.block.extend_from_slice(value);
        self.pad();
    }

    fn end_of_options(&mut self) {
        self.block.extend_from_slice(&[0; 4]);
    }

    fn pad(&mut self) {
        self.block.resize(self.block.len().next_multiple_of(4), 0);
    }

    fn finish_block(&mut self) -> io::Result<()> {
        let length = (self.block.len() + 4) as u32; // blocks are shorter than 2 * 65535 bytes
        self.block[4..8].copy_from_slice(&length.to_le_bytes());
        self.block.extend_from_slice(&length.to_le_bytes());
        self.sink.write_all(&self.block)
    }
}

#[cfg(test)]
mod tests {
    use pcap_parser::{Block, PcapBlockOwned, PcapError, PcapNGReader, traits::PcapReaderIterator};

    use super::*;

    fn packet(payload: &[u8]) -> Packet<'_> {
        Packet {
            host_time_ns: 1_697_084_088_551_168_123,
            source: "10.0.0.1:7502".parse().unwrap(),
            destination: "10.0.0.2:7503".parse().unwrap(),
            link: Default::default(),
            payload,
        }
    }

    #[test]
    fn another_reader_finds_every_block_and_the_drop_counts() {
        let mut writer = PcapngWriter::new(Vec::new()).unwrap();
        let left = writer.add_interface("left").unwrap();
        let right = writer.add_interface("right").unwrap();
        writer.write(left, &packet(&[7; 24896])).unwrap();
        writer.write(right, &packet(b"odd")).unwrap();
        let bytes = writer.close(&[0, 3]).unwrap();
        let mut reader = PcapNGReader::new(1 << 20, bytes.as_slice()).unwrap();
        let (mut names, mut lengths, mut drops) = (Vec::new(), Vec::new(), Vec::new());
        loop {
            match reader.next() {
                Ok((offset, PcapBlockOwned::NG(block))) => {
                    match block {
                        Block::InterfaceDescription(block) => {
                            assert_eq!(block.ts_resolution(), Some(1_000_000_000));
                            names.push(block.if_name().unwrap().unwrap().to_owned());
                        }
                        Block::EnhancedPacket(block) => {
                            assert_eq!(block.decode_ts(0, 1_000_000_000), (1_697_084_088, 551_168_123));
                            lengths.push((block.if_id, block.caplen));
                        }
                        Block::InterfaceStatistics(block) => {
                            drops.push(block.isb_osdrop().unwrap().unwrap());
                        }
                        Block::SectionHeader(_) => {}
                        other => panic!("{other:?}"),
                    }
                    reader.consume(offset);
                }
                Err(PcapError::Eof) => break,
                Err(PcapError::Incomplete(_)) => reader.refill().unwrap(),
                Ok(_) => panic!("a pcapng reader yields pcapng blocks"),
                Err(error) => panic!("{error:?}"),
            }
        }
        assert_eq!(names, ["left", "right"]);
        assert_eq!(lengths, [(0, 42 + 24896), (1, 42 + 3)]);
        assert_eq!(drops, [0, 3]);
    }

    #[test]
    fn what_cannot_be_written_leaves_no_trace() {
        let mut writer = PcapngWriter::new(Vec::new()).unwrap();
        let interface = writer.add_interface("one").unwrap();
        let before = writer.get_ref().len();
        let too_long = vec![0; 65508];
        for refused in [
            writer.write(interface, &packet(&too_long)),
            writer.write(interface + 1, &packet(b"x")),
            writer.write(interface, &Packet { source: "[fe80::1]:1".parse().unwrap(), ..packet(b"x") }),
        ] {
            assert_eq!(refused.unwrap_err().kind(), io::ErrorKind::InvalidInput);
        }
        assert_eq!(writer.get_ref().len(), before);
        writer.write(interface, &packet(&too_long[1..])).unwrap();
        assert_eq!(writer.packets(interface), 1);
    }
}
