//! Bodies of pcapng blocks. Source: IETF draft-ietf-opsawg-pcapng, sections 3.5 (options) and 4 (blocks).

use std::ops::Range;

use super::framing::Clock;

/// Section header; reads the same in either byte order.
pub(super) const SECTION_HEADER: u32 = 0x0a0d_0d0a;
const INTERFACE_DESCRIPTION: u32 = 1;
const OLD_PACKET: u32 = 2;
const SIMPLE_PACKET: u32 = 3;
const INTERFACE_STATISTICS: u32 = 5;
const ENHANCED_PACKET: u32 = 6;

/// Byte order of a file or section.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Bytes {
    Little,
    Big,
}

impl Bytes {
    /// The caller has made sure that the bytes are there.
    pub(super) fn u32(self, bytes: &[u8], at: usize) -> u32 {
        let four = [bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]];
        match self {
            Self::Little => u32::from_le_bytes(four),
            Self::Big => u32::from_be_bytes(four),
        }
    }

    fn u16(self, bytes: &[u8], at: usize) -> u16 {
        let two = [bytes[at], bytes[at + 1]];
        match self {
            Self::Little => u16::from_le_bytes(two),
            Self::Big => u16::from_be_bytes(two),
        }
    }

    fn u64(self, bytes: &[u8], at: usize) -> u64 {
        let (first, second) = (u64::from(self.u32(bytes, at)), u64::from(self.u32(bytes, at + 4)));
        match self {
            Self::Little => second << 32 | first,
            Self::Big => first << 32 | second,
        }
    }
}

/// What a block says.
pub(super) enum Body {
    Interface(Description),
    Packet(PacketBlock),
    Statistics { interface: u32, dropped: u64 },
    Other,
}

pub(super) struct Description {
    pub(super) name: Option<String>,
    pub(super) link_type: u16,
    pub(super) clock: Clock,
}

pub(super) struct PacketBlock {
    pub(super) interface: u32,
    /// In units of the interface's clock; simple packets have none.
    pub(super) ticks: Option<u64>,
    pub(super) original_length: u32,
    /// Within the body.
    pub(super) data: Range<usize>,
    /// Packets lost since the one before, says the recorder.
    pub(super) dropped: u64,
}

/// Whether blocks of this type are read; others are passed over.
pub(super) fn is_read(kind: u32) -> bool {
    matches!(
        kind,
        SECTION_HEADER
            | INTERFACE_DESCRIPTION
            | OLD_PACKET
            | SIMPLE_PACKET
            | INTERFACE_STATISTICS
            | ENHANCED_PACKET
    )
}

/// Reads a block's body (between its two lengths). The error says what was found and what was expected.
pub(super) fn parse(kind: u32, order: Bytes, body: &[u8]) -> Result<Body, (String, String)> {
    let fixed = match kind {
        INTERFACE_DESCRIPTION => 8,
        SIMPLE_PACKET | INTERFACE_STATISTICS => [4, 12][usize::from(kind == INTERFACE_STATISTICS)],
        OLD_PACKET | ENHANCED_PACKET => 20,
        _ => 0,
    };
    if body.len() < fixed {
        return Err((
            format!("a block of type {kind} with {} bytes of body", body.len()),
            format!("at least {fixed}"),
        ));
    }
    match kind {
        INTERFACE_DESCRIPTION => description(order, body).map(Body::Interface),
        ENHANCED_PACKET => packet(order, body, order.u32(body, 0), Some(2)).map(Body::Packet),
        OLD_PACKET => packet(order, body, u32::from(order.u16(body, 0)), None).map(Body::Packet),
        SIMPLE_PACKET => {
            let original_length = order.u32(body, 0);
            let captured = (body.len() - 4).min(original_length as usize);
            let data = 4..4 + captured;
            Ok(Body::Packet(PacketBlock { interface: 0, ticks: None, original_length, data, dropped: 0 }))
        }
        INTERFACE_STATISTICS => {
            let mut dropped = 0_u64;
            for (code, value) in options(order, &body[12..]) {
                if matches!(code, 5 | 7) && value.len() == 8 {
                    dropped = dropped.saturating_add(order.u64(value, 0)); // isb_ifdrop, isb_osdrop
                }
            }
            Ok(Body::Statistics { interface: order.u32(body, 0), dropped })
        }
        _ => Ok(Body::Other),
    }
}

fn packet(
    order: Bytes,
    body: &[u8],
    interface: u32,
    enhanced: Option<u32>,
) -> Result<PacketBlock, (String, String)> {
    let ticks = u64::from(order.u32(body, 4)) << 32 | u64::from(order.u32(body, 8));
    let (captured, original_length) = (order.u32(body, 12), order.u32(body, 16));
    let room = body.len() - 20;
    if captured as usize > room {
        return Err((format!("a packet of {captured} bytes in a block with room for {room}"), "less".into()));
    }
    let end = 20 + captured as usize;
    let mut dropped = 0;
    if enhanced.is_some() {
        let after = body.get(end.next_multiple_of(4)..).unwrap_or_default();
        for (code, value) in options(order, after) {
            if code == 4 && value.len() == 8 {
                dropped = order.u64(value, 0); // epb_dropcount
            }
        }
    } else if order.u16(body, 2) != u16::MAX {
        dropped = u64::from(order.u16(body, 2));
    }
    Ok(PacketBlock { interface, ticks: Some(ticks), original_length, data: 20..end, dropped })
}

fn description(order: Bytes, body: &[u8]) -> Result<Description, (String, String)> {
    let mut name = None;
    let mut clock = Clock::default();
    for (code, value) in options(order, &body[8..]) {
        match (code, value.len()) {
            (2, _) => name = Some(String::from_utf8_lossy(value).trim_end_matches('\0').to_owned()),
            (9, 1) => {
                let exponent = u32::from(value[0] & 0x7f);
                let binary = value[0] & 0x80 != 0;
                let ticks = if binary { 1_u128.checked_shl(exponent) } else { 10_u128.checked_pow(exponent) };
                clock.ticks_per_second = ticks.ok_or_else(|| {
                    let base = if binary { 2 } else { 10 };
                    (format!("a clock of {base}^-{exponent} s"), "one that a number can hold".into())
                })?;
            }
            (14, 8) => clock.offset_s = order.u64(value, 0) as i64, // if_tsoffset, signed
            _ => {}
        }
    }
    Ok(Description { name, link_type: order.u16(body, 0), clock })
}

/// Code and value of each option; stops at the end mark and at what does not fit.
fn options(order: Bytes, mut rest: &[u8]) -> impl Iterator<Item = (u16, &[u8])> {
    std::iter::from_fn(move || {
        if rest.len() < 4 {
            return None;
        }
        let (code, length) = (order.u16(rest, 0), usize::from(order.u16(rest, 2)));
        let value = rest.get(4..4 + length)?;
        rest = rest.get(4 + length.next_multiple_of(4)..).unwrap_or_default();
        (code != 0).then_some((code, value))
    })
}
