//! Flags as a NumPy file.

use std::path::Path;

use anyhow::Context as _;

/// NumPy array file of bytes, version 1.0, whole or not at all.
pub fn write_flags(path: &Path, flags: &[bool]) -> anyhow::Result<()> {
    let packed: Vec<u8> = flags
        .chunks(8)
        .map(|eight| {
            eight.iter().enumerate().fold(0, |byte, (bit, flag)| byte | u8::from(*flag) << (7 - bit))
        })
        .collect();
    let mut header = format!("{{'descr': '|u1', 'fortran_order': False, 'shape': ({},), }}", packed.len());
    // the data begin at a multiple of 64
    let padding = 63 - (10 + header.len()) % 64;
    header.push_str(&" ".repeat(padding));
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(packed);
    crate::base::files::write_whole(path, &bytes).with_context(|| path.display().to_string())
}
