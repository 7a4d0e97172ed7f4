//! Captures made long: the same packets again and again, counters and stamps moved on, so that a frame ends where one
//! did and none is met twice.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::net::{IpAddr, SocketAddr};
use std::path::{Path, PathBuf};

use sensors::Packet;
use sensors::capture::{CaptureReader, PcapWriter};
use sensors::ouster::wire::{Header, NO_CRC, write_crc};
use sensors::ouster::{Metadata, Profile};

/// What the bench decodes.
pub struct Recording {
    pub name: String,
    /// Packets go as IPv4 fragments of 1500 bytes, as over a plain network.
    pub fragmented: bool,
    pub capture: PathBuf,
    pub sensor: Sensor,
}

#[derive(Clone)]
pub enum Sensor {
    Ouster {
        meta: PathBuf,
        metadata: Box<Metadata>,
    },
    /// The model's name to the peer.
    Velodyne(&'static str),
}

pub struct Datagram {
    host_time_ns: u64,
    source: SocketAddr,
    destination: SocketAddr,
    payload: Vec<u8>,
}

impl Datagram {
    pub fn packet(&self) -> Packet<'_> {
        let Self { host_time_ns, source, destination, payload } = self;
        Packet {
            host_time_ns: *host_time_ns,
            source: *source,
            destination: *destination,
            link: Default::default(),
            payload,
        }
    }
}

pub fn datagrams(path: &Path) -> Vec<Datagram> {
    let mut reader = CaptureReader::open(path).expect("a capture");
    let mut all = Vec::new();
    while let Some(packet) = reader.next().expect("a whole capture") {
        let Packet { host_time_ns, source, destination, payload, .. } = packet;
        all.push(Datagram { host_time_ns, source, destination, payload: payload.to_vec() });
    }
    all
}

impl Recording {
    /// Writes the capture's packets over and over to a file of at least this length.
    pub fn write_long(&self, path: &Path, least_bytes: usize) {
        let mut packets = datagrams(&self.capture);
        if let Sensor::Velodyne("VLP16") = self.sensor {
            // a VLP-16 of 2014 calls itself an HDL-32E, and the peer believes it
            packets
                .iter_mut()
                .filter(|packet| packet.payload.len() == 1206)
                .for_each(|p| p.payload[1205] = 0x22);
        }
        let step = self.step(&packets);
        let mut file = BufWriter::with_capacity(1 << 20, File::create(path).expect("room for a file"));
        let mut bytes = 0;
        if self.fragmented {
            file.write_all(&PCAP_HEADER).expect("room for a file");
            for number in 0_u16.. {
                for packet in &packets {
                    bytes += write_fragments(&mut file, packet, number);
                }
                if bytes >= least_bytes {
                    break;
                }
                packets.iter_mut().for_each(|packet| self.move_on(packet, step));
            }
        } else {
            let mut writer = PcapWriter::new(file).expect("room for a file");
            while bytes < least_bytes {
                for packet in &packets {
                    writer.write(&packet.packet()).expect("room for a file");
                    bytes += packet.payload.len();
                }
                packets.iter_mut().for_each(|packet| self.move_on(packet, step));
            }
            writer.close().expect("room for a file");
        }
    }

    /// Frames and time from one round to the next.
    fn step(&self, packets: &[Datagram]) -> (u32, u64) {
        match &self.sensor {
            Sensor::Ouster { metadata, .. } => {
                let format = metadata.packet_format();
                let ids = packets.iter().filter(|packet| packet.payload.len() == format.packet_bytes()).map(
                    |packet| {
                        if metadata.profile == Profile::Legacy {
                            format.legacy_frame_id(format.column(&packet.payload, 0))
                        } else {
                            Header::read(metadata.header, &packet.payload).map_or(0, |header| header.frame_id)
                        }
                    },
                );
                let (first, last) = ids.fold((u32::MAX, 0), |(low, high), id| (low.min(id), high.max(id)));
                let frames = last - first + 1;
                (frames, (f64::from(frames) * 1e9 / metadata.frame_rate_hz).round() as u64)
            }
            Sensor::Velodyne(_) => {
                let stamps: Vec<u32> = packets
                    .iter()
                    .filter(|p| p.payload.len() == 1206)
                    .map(|p| stamp_us(&p.payload))
                    .collect();
                let (first, last) = (stamps[0], stamps[stamps.len() - 1]);
                let took_us = (last + HOUR_US - first) % HOUR_US;
                (0, u64::from(took_us + took_us / (stamps.len() as u32 - 1)) * 1000)
            }
        }
    }

    fn move_on(&self, packet: &mut Datagram, (frames, time_ns): (u32, u64)) {
        packet.host_time_ns += time_ns;
        let bytes = &mut packet.payload[..];
        match &self.sensor {
            Sensor::Velodyne(_) => {
                let at = if bytes.len() == 1206 { 1200 } else { 198 };
                if let Some(stamp) = bytes.get_mut(at..at + 4) {
                    let moved = u32::from_le_bytes([stamp[0], stamp[1], stamp[2], stamp[3]])
                        + (time_ns / 1000) as u32;
                    stamp.copy_from_slice(&(moved % HOUR_US).to_le_bytes());
                }
            }
            Sensor::Ouster { metadata, .. } => move_on_ouster(metadata, bytes, frames, time_ns),
        }
    }
}

fn move_on_ouster(metadata: &Metadata, bytes: &mut [u8], frames: u32, time_ns: u64) {
    let format = metadata.packet_format();
    let is_legacy = metadata.profile == Profile::Legacy;
    if bytes.len() == 48 || is_legacy && bytes.len() != format.packet_bytes() {
        return;
    }
    let is_lidar = bytes.len() == format.packet_bytes();
    let mut frame_id = 0;
    let stored = bytes.last_chunk().map_or(0, |bytes| u64::from_le_bytes(*bytes));
    let has_crc = !is_legacy && stored != 0 && stored != NO_CRC;
    if !is_legacy {
        let Some(mut header) = Header::read(metadata.header, bytes) else { return };
        header.frame_id =
            (u64::from(header.frame_id) + u64::from(frames)).rem_euclid(metadata.header.frame_ids()) as u32;
        header.write(metadata.header, bytes);
    }
    if is_lidar {
        for index in 0..format.columns_per_packet {
            let column = format.column_mut(bytes, index);
            let mut header = format.read_column(column);
            header.time_ns += time_ns;
            if is_legacy {
                frame_id = (format.legacy_frame_id(column) + frames) & 0xFFFF;
            }
            format.write_column(column, header, frame_id, metadata.columns_per_frame);
        }
    }
    if has_crc {
        write_crc(bytes);
    }
}

const HOUR_US: u32 = 3_600_000_000;

fn stamp_us(payload: &[u8]) -> u32 {
    u32::from_le_bytes([payload[1200], payload[1201], payload[1202], payload[1203]])
}

/// Classic pcap of Ethernet frames, stamps in microseconds.
const PCAP_HEADER: [u8; 24] =
    [0xd4, 0xc3, 0xb2, 0xa1, 2, 0, 4, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 4, 0, 1, 0, 0, 0];

/// Payload of a fragment: 1500 bytes less the IP header, in steps of 8.
const FRAGMENT_BYTES: usize = 1480;

/// One datagram in IPv4 fragments; returns how many bytes were written.
fn write_fragments(file: &mut impl Write, packet: &Datagram, round: u16) -> usize {
    let (IpAddr::V4(source), IpAddr::V4(destination)) = (packet.source.ip(), packet.destination.ip()) else {
        panic!("captures that are fragmented use IPv4");
    };
    let mut datagram = Vec::with_capacity(packet.payload.len() + 8);
    for field in [packet.source.port(), packet.destination.port(), packet.payload.len() as u16 + 8, 0] {
        datagram.extend_from_slice(&field.to_be_bytes());
    }
    datagram.extend_from_slice(&packet.payload);
    let identification = round.wrapping_mul(251) ^ (packet.host_time_ns / 1000) as u16;
    let mut written = 0;
    for (index, part) in datagram.chunks(FRAGMENT_BYTES).enumerate() {
        let more = (index + 1) * FRAGMENT_BYTES < datagram.len();
        let offset = (index * FRAGMENT_BYTES / 8) as u16 | if more { 0x2000 } else { 0 };
        let mut ip = [0x45, 0, 0, 0, 0, 0, 0, 0, 64, 17, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0];
        ip[2..4].copy_from_slice(&(20 + part.len() as u16).to_be_bytes());
        ip[4..6].copy_from_slice(&identification.to_be_bytes());
        ip[6..8].copy_from_slice(&offset.to_be_bytes());
        ip[12..16].copy_from_slice(&source.octets());
        ip[16..20].copy_from_slice(&destination.octets());
        let sum: u32 = ip.chunks(2).map(|word| u32::from(u16::from_be_bytes([word[0], word[1]]))).sum();
        let checksum = !((sum & 0xFFFF) + (sum >> 16)) as u16;
        ip[10..12].copy_from_slice(&checksum.to_be_bytes());
        let length = (14 + 20 + part.len()) as u32;
        let mut record = Vec::with_capacity(16 + length as usize);
        record.extend_from_slice(&((packet.host_time_ns / 1_000_000_000) as u32).to_le_bytes());
        record.extend_from_slice(&((packet.host_time_ns / 1000 % 1_000_000) as u32).to_le_bytes());
        record.extend_from_slice(&length.to_le_bytes());
        record.extend_from_slice(&length.to_le_bytes());
        record.extend_from_slice(&[2, 0, 0, 0, 0, 1, 2, 0, 0, 0, 0, 2, 8, 0]);
        record.extend_from_slice(&ip);
        record.extend_from_slice(part);
        file.write_all(&record).expect("room for a file");
        written += record.len();
    }
    written
}
