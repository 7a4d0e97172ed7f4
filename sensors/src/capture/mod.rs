//! Capture files: pcap and pcapng, plain or gzipped, read as UDP datagrams with IPv4 fragments put together, and
//! written.
