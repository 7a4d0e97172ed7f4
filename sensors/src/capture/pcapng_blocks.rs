//! What pcapng blocks say. `pcap-parser` takes them apart; here is what it leaves out: lengths that are checked
//! before anything is parsed, options in the section's byte order up to the end mark, clocks of any resolution, and
//! the obsolete packet block. Source: IETF draft-ietf-opsawg-pcapng, sections 3.5 (options) and 4 (blocks).

use std::ops::Range;

use pcap_parser::pcapng::{
    Block, EPB_MAGIC, IDB_MAGIC, ISB_MAGIC, InterfaceDescriptionBlock, PcapNGOption, SHB_MAGIC, SPB_MAGIC,
    parse_block_be, parse_block_le,
};

use super::clock::Clock;

/// The packet block that the enhanced one replaced; `pcap-parser` does not know it.
const OLD_PACKET: u32 = 2;

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
    matches!(kind, SHB_MAGIC | IDB_MAGIC | OLD_PACKET | SPB_MAGIC | ISB_MAGIC | EPB_MAGIC)
}

/// Reads a whole block; its two lengths must agree with that of the slice. The error says what was found and what was
/// expected. Packets without options cost no allocation; `pcap-parser` collects options in a vector, which grows
/// with the bytes that are there.
pub(super) fn parse(kind: u32, order: Bytes, whole: &[u8]) -> Result<Body, (String, String)> {
    let body = &whole[8..whole.len() - 4];
    let fixed = match kind {
        IDB_MAGIC => 8,
        SPB_MAGIC => 4,
        ISB_MAGIC => 12,
        OLD_PACKET | EPB_MAGIC => 20,
        SHB_MAGIC if body.len() < 16 => return Ok(Body::Other), // its byte order is known; the rest is not needed
        _ => 0,
    };
    if body.len() < fixed {
        return Err((
            format!("a block of type {kind} with {} bytes of body", body.len()),
            format!("at least {fixed}"),
        ));
    }
    if matches!(kind, OLD_PACKET | EPB_MAGIC) {
        let (captured, room) = (order.u32(body, 12), body.len() - 20);
        if captured as usize > room {
            let found = format!("a packet of {captured} bytes in a block with room for {room}");
            return Err((found, "less".into()));
        }
    }
    let parsed = match order {
        Bytes::Little => parse_block_le(whole),
        Bytes::Big => parse_block_be(whole),
    };
    let (_, block) = parsed.map_err(|_| {
        (format!("a block of type {kind} that contradicts itself"), "one as pcapng lays it out".to_owned())
    })?;
    Ok(match block {
        Block::InterfaceDescription(block) => Body::Interface(description(order, &block)?),
        Block::EnhancedPacket(block) => {
            let mut dropped = 0;
            for (code, value) in options(&block.options) {
                if code == 4 && value.len() == 8 {
                    dropped = order.u64(value, 0); // epb_dropcount
                }
            }
            Body::Packet(PacketBlock {
                interface: block.if_id,
                ticks: Some(u64::from(block.ts_high) << 32 | u64::from(block.ts_low)),
                original_length: block.origlen,
                data: 20..20 + block.caplen as usize,
                dropped,
            })
        }
        Block::SimplePacket(block) => {
            let captured = block.data.len().min(block.origlen as usize);
            Body::Packet(PacketBlock {
                interface: 0,
                ticks: None,
                original_length: block.origlen,
                data: 4..4 + captured,
                dropped: 0,
            })
        }
        Block::InterfaceStatistics(block) => {
            let mut dropped = 0_u64;
            for (code, value) in options(&block.options) {
                if matches!(code, 5 | 7) && value.len() == 8 {
                    dropped = dropped.saturating_add(order.u64(value, 0)); // isb_ifdrop, isb_osdrop
                }
            }
            Body::Statistics { interface: block.if_id, dropped }
        }
        Block::Unknown(block) if kind == OLD_PACKET => Body::Packet(old_packet(order, block.data)),
        _ => Body::Other,
    })
}

/// The caller has made sure that the body holds what it claims.
fn old_packet(order: Bytes, body: &[u8]) -> PacketBlock {
    let dropped = order.u16(body, 2);
    PacketBlock {
        interface: u32::from(order.u16(body, 0)),
        ticks: Some(u64::from(order.u32(body, 4)) << 32 | u64::from(order.u32(body, 8))),
        original_length: order.u32(body, 16),
        data: 20..20 + order.u32(body, 12) as usize,
        dropped: if dropped == u16::MAX { 0 } else { u64::from(dropped) }, // all ones: not known
    }
}

/// `pcap-parser` reads `if_tsoffset` as little-endian in every section and knows no resolution of base 2.
fn description(order: Bytes, block: &InterfaceDescriptionBlock<'_>) -> Result<Description, (String, String)> {
    let mut name = None;
    let mut clock = Clock::default();
    for (code, value) in options(&block.options) {
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
    Ok(Description { name, link_type: block.linktype.0 as u16, clock }) // 16 bits in the block
}

/// Code and value, without padding, of each option before the end mark; `pcap-parser` reads on behind it.
fn options<'a>(options: &'a [PcapNGOption<'a>]) -> impl Iterator<Item = (u16, &'a [u8])> {
    options
        .iter()
        .map_while(|option| (option.code.0 != 0).then_some((option.code.0, option.as_bytes().ok()?)))
}
