//! Capture files: pcap and pcapng, plain or gzipped, read as UDP datagrams with IPv4 fragments put together, and
//! written.

mod buffer;
mod clock;
mod dissect;
mod error;
mod framing;
mod headers;
mod identify;
mod pcap_writer;
mod pcapng_blocks;
mod pcapng_writer;
mod reader;
mod reassembly;
#[cfg(test)]
mod tests;

pub use error::{CaptureCounters, CaptureError, Truncated, ZeroTail};
pub use framing::Interface;
pub use pcap_writer::PcapWriter;
pub use pcapng_writer::PcapngWriter;
pub use reader::CaptureReader;
