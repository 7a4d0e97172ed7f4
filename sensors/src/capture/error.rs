//! What can be wrong with a capture file, and what was counted while it was read.

/// Why a capture cannot be read, or not further. Everything before the place named was delivered.
#[derive(Debug, thiserror::Error)]
pub enum CaptureError {
    /// The file does not open.
    #[error("{name}: {source}")]
    Open {
        /// The file.
        name: String,
        /// What the system says.
        source: std::io::Error,
    },
    /// Reading stopped.
    #[error("{name}: reading stops at byte {offset}: {source}")]
    Read {
        /// The file.
        name: String,
        /// Where, in the unpacked stream.
        offset: u64,
        /// What the system or the unpacker says.
        source: std::io::Error,
    },
    /// Neither pcap nor pcapng.
    #[error("{name} is no capture: expected pcap or pcapng (plain or gzip), found {looks_like}")]
    NotACapture {
        /// The file.
        name: String,
        /// What the first bytes are.
        looks_like: String,
    },
    /// The framing contradicts itself; nothing after it can be found.
    #[error("{name}: damaged at byte {offset}: found {found}, expected {expected}")]
    Damaged {
        /// The file.
        name: String,
        /// Start of the record or block, in the unpacked stream.
        offset: u64,
        /// What stands there.
        found: String,
        /// What should.
        expected: String,
    },
}

/// The file ends inside a record: a recording that was cut off or is still being written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Truncated {
    /// Start of the cut record, in the unpacked stream; all before it was delivered.
    pub offset: u64,
    /// Bytes of it that are there.
    pub found_bytes: u64,
    /// Bytes it needs, as far as its own header says.
    pub expected_bytes: u64,
}

impl std::fmt::Display for Truncated {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { offset, found_bytes, expected_bytes } = self;
        write!(
            out,
            "the file ends inside the record at byte {offset}: {found_bytes} of {expected_bytes} bytes are there"
        )
    }
}

/// Zeros from a record's place to the end of the file: a recorder that lost its power leaves room that it never wrote.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct ZeroTail {
    /// Where they begin, in the unpacked stream; all before it was delivered.
    pub offset: u64,
    /// How many there are.
    pub bytes: u64,
    /// Of these, those of a record's header.
    #[serde(skip)]
    pub(super) header_bytes: u64,
}

impl std::fmt::Display for ZeroTail {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { offset, bytes, header_bytes } = self;
        write!(
            out,
            "the record header at byte {offset} is empty, and from byte {} on nothing but zeros follows ({bytes} bytes in \
             all): the recorder was cut off, by a loss of power perhaps, before it wrote them",
            offset + header_bytes
        )
    }
}

/// Counts of everything in the capture that was not delivered as a UDP packet.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[non_exhaustive]
pub struct CaptureCounters {
    /// Link-layer frames in the file.
    pub frames: u64,
    /// UDP datagrams delivered.
    pub datagrams: u64,
    /// Frames that carry neither IPv4 nor IPv6 (ARP, LLDP, ...).
    pub not_ip: u64,
    /// IP packets that carry something else than UDP.
    pub not_udp: u64,
    /// Frames of a link type that is not supported.
    pub other_link_type: u64,
    /// Frames cut short by the recorder's snap length: their payload is useless.
    pub cut_by_snap_length: u64,
    /// Frames with contradictory Ethernet, IP or UDP headers.
    pub malformed: u64,
    /// IP fragments.
    pub fragments: u64,
    /// Fragments that came twice.
    pub fragments_duplicated: u64,
    /// Datagrams of which a fragment never came.
    pub fragments_incomplete: u64,
    /// Packets the recorder says it dropped (pcapng statistics blocks and packet options).
    pub dropped_by_recorder: u64,
    /// The file ends inside a record.
    pub truncated: Option<Truncated>,
    /// Nothing but zeros follows the last record.
    pub zero_tail: Option<ZeroTail>,
}
