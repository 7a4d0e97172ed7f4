//! What a file is by its first bytes, for the message that it is no capture.

/// Says what a file looks like that is neither pcap nor pcapng.
pub(super) fn looks_like(start: &[u8]) -> String {
    const KNOWN: &[(&[u8], &str)] = &[
        (b"#ROSBAG V", "a ROS 1 bag within gzip (unpack it first)"),
        (b"\x89MCAP0\r\n", "an MCAP file within gzip (unpack it first)"),
        (b"SQLite format 3", "an SQLite database within gzip, perhaps a ROS 2 bag (unpack it first)"),
        (b"snoop\0\0\0", "a Solaris snoop capture (convert it: editcap -F pcapng)"),
        (b"GMBU", "a Microsoft Network Monitor capture (convert it: editcap -F pcapng)"),
        (b"\xa1\xb2\xcd\x34", "Kuznetzov's modified pcap (convert it: editcap -F pcapng)"),
        (b"\x34\xcd\xb2\xa1", "Kuznetzov's modified pcap (convert it: editcap -F pcapng)"),
        (b"PK\x03\x04", "a zip archive (unpack it first)"),
        (b"\x28\xb5\x2f\xfd", "a zstd-compressed file (unpack it first)"),
        (b"\xfd7zXZ\0", "an xz-compressed file (unpack it first)"),
        (b"BZh", "a bzip2-compressed file (unpack it first)"),
        (b"\x04\x22\x4d\x18", "an lz4-compressed file (unpack it first)"),
        (b"ply", "a PLY point cloud or mesh"),
        (b"LASF", "a LAS point cloud"),
        (b"ASTM-E57", "an E57 point cloud"),
        (b"# .PCD", "a PCD point cloud"),
        (b"\x7fELF", "a program"),
    ];
    if start.is_empty() {
        return "an empty file".into();
    }
    if let Some((_, name)) = KNOWN.iter().find(|(magic, _)| start.starts_with(magic)) {
        return (*name).into();
    }
    // a flatbuffer's length, its root, and its identifier
    if start.get(8..12) == Some(b"OSF$")
        || [4..8, 8..12].iter().any(|at| start.get(at.clone()) == Some(b"OSF!"))
    {
        return "an Ouster OSF recording (convert it: ouster-cli source FILE save out.pcap)".into();
    }
    let text = start.iter().all(|byte| matches!(byte, b'\t' | b'\n' | b'\r' | 0x20..=0x7e));
    let shown = &start[..start.len().min(16)];
    match start.iter().find(|byte| !byte.is_ascii_whitespace()) {
        Some(b'{') if text => "JSON (sensor metadata goes behind --meta)".into(),
        _ if text => format!("text that starts with {:?}", String::from_utf8_lossy(shown)),
        _ => format!("bytes {}", shown.iter().map(|b| format!("{b:02x}")).collect::<Vec<_>>().join(" ")),
    }
}

#[cfg(test)]
mod tests {
    use super::looks_like;

    #[test]
    fn names_what_people_hand_in_by_mistake() {
        assert!(looks_like(b"").contains("empty"));
        assert!(looks_like(b"#ROSBAG V2.0\n").contains("ROS 1"));
        assert!(looks_like(b"  {\"prod_line\": 1}").contains("JSON"));
        assert!(looks_like(b"hello world").contains("hello world"));
        assert!(looks_like(&[0, 1, 2, 255]).contains("00 01 02 ff"));
    }
}
