//! Capture files: pcap and pcapng, plain or gzipped, read as UDP datagrams with IPv4 fragments put together, and
//! written.

mod headers;
mod pcap_writer;
mod pcapng_writer;

pub use pcap_writer::PcapWriter;
pub use pcapng_writer::PcapngWriter;
