//! Datagrams that outlive the capture they came from: to be dropped, swapped and damaged.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};

use sensors::Packet;
use sensors::capture::{CaptureReader, PcapngWriter};

/// A datagram that owns its bytes.
#[derive(Clone, Debug, PartialEq)]
pub struct Datagram {
    pub host_time_ns: u64,
    pub source: SocketAddr,
    pub destination: SocketAddr,
    pub payload: Vec<u8>,
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

/// Every UDP datagram of a capture.
pub fn datagrams(path: &Path) -> Vec<Datagram> {
    let mut reader = CaptureReader::open(path).unwrap();
    let mut all = Vec::new();
    while let Some(packet) = reader.next().unwrap() {
        all.push(Datagram {
            host_time_ns: packet.host_time_ns,
            source: packet.source,
            destination: packet.destination,
            payload: packet.payload.to_vec(),
        });
    }
    all
}

/// A pcapng file of these datagrams.
pub fn write_capture(path: &Path, datagrams: &[Datagram]) -> PathBuf {
    let mut writer = PcapngWriter::new(Vec::new()).unwrap();
    let interface = writer.add_interface("again").unwrap();
    for datagram in datagrams {
        writer.write(interface, &datagram.packet()).unwrap();
    }
    std::fs::write(path, writer.close(&[]).unwrap()).unwrap();
    path.to_owned()
}
