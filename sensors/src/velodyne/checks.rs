//! Whether a packet can be one of a model's, and is whole.

use crate::decoder::Rejected;

use super::blocks::{self, BadBlocks};
use super::detect;
use super::product::{Family, Product};
use super::stream::Stream;
use super::wire::{AZIMUTH_COUNTS, BANK_FLAGS, BLOCKS, DATA_PACKET_BYTES, DataPacket, POSITION_PACKET_BYTES};

/// Why a payload of another length is rejected.
pub(super) fn refuse_length(payload: &[u8]) -> Rejected {
    let length = payload.len();
    let begins_with_flag =
        payload.first_chunk().is_some_and(|flag| BANK_FLAGS.contains(&u16::from_le_bytes(*flag)));
    if length < DATA_PACKET_BYTES && begins_with_flag {
        malformed(format!("a data packet cut off after {length} bytes, expected {DATA_PACKET_BYTES}"))
    } else {
        foreign(format!(
            "{length} bytes; data packets have {DATA_PACKET_BYTES}, position packets {POSITION_PACKET_BYTES}"
        ))
    }
}

/// Whether a packet can be one of any product.
pub(super) fn check_unknown(data: DataPacket<'_>) -> Result<(), Rejected> {
    match detect::family(data) {
        None => Err(malformed("block flags of no known bank".to_owned())),
        Some(Family::ThirtyTwo) if detect::is_blank(data) => Err(foreign(BLANK.to_owned())),
        Some(Family::ThirtyTwo) if detect::claimed_product(data.model_byte()).is_none() => {
            let byte = data.model_byte();
            Err(foreign(format!("model byte {byte:#04x} is of no known product")))
        }
        Some(_) => Ok(()),
    }
}

/// Sources: HDL-32E manual 63-9113 ("2 bytes: blank"), VLP-16 manual 63-9243 (factory bytes since firmware 3.0.29.0).
const BLANK: &str = "the two factory bytes behind its time are blank, as old firmware leaves them (of an HDL-32E before \
    2.2.20, of a VLP-16 before 3.0.29.0), and nothing else in a packet says the model: add --model hdl-32e or --model \
    vlp-16";

/// Whether a packet can be one of a stream; says which of its blocks cannot be used.
pub(super) fn check(
    data: DataPacket<'_>,
    stream: &Stream,
    model_byte: Option<u8>,
) -> Result<BadBlocks, Rejected> {
    let product = stream.product();
    if product == Product::Hdl64eS1 {
        return check_by_flags(data);
    }
    let layout = stream.layout(data);
    let bad = BadBlocks::find(0..layout.blocks, |block| {
        data.bank(block) == layout.banks.get(block).map(|bank| usize::from(*bank))
    });
    if let Some(block) = bad.first() {
        if let Some(other) = detect::other_model(data, product) {
            return Err(of_another_model(other, product));
        }
        ensure_few(bad, layout.blocks, || {
            let expected =
                layout.banks.get(block).map_or(BANK_FLAGS[0], |bank| BANK_FLAGS[usize::from(*bank)]);
            let flag = data.flag(block);
            format!("block {block} of a {product} begins with {flag:#06x}, expected {expected:#06x}")
        })?;
    }
    let bad = blocks::with_bad_azimuths(data, layout, bad);
    if let Some(block) = bad.first() {
        ensure_few(bad, layout.blocks, || {
            format!("azimuth {} in block {block}, expected 0 to 36000", data.raw_azimuth(block))
        })?;
    }
    check_factory_bytes(data, product, model_byte)?;
    Ok(bad)
}

/// The same for an HDL-64E S1: its flags say which sequences there are, so that none can be done without.
fn check_by_flags(data: DataPacket<'_>) -> Result<BadBlocks, Rejected> {
    for block in 0..BLOCKS {
        if data.bank(block).is_none_or(|bank| bank > 1) {
            if let Some(other) = detect::other_model(data, Product::Hdl64eS1) {
                return Err(of_another_model(other, Product::Hdl64eS1));
            }
            let flag = data.flag(block);
            return Err(malformed(format!(
                "block {block} begins with {flag:#06x}, expected 0xeeff or 0xddff"
            )));
        }
        let counts = data.raw_azimuth(block);
        if counts > AZIMUTH_COUNTS {
            return Err(malformed(format!("azimuth {counts} in block {block}, expected 0 to 36000")));
        }
    }
    Ok(BadBlocks::default())
}

/// Of a packet with more bad blocks than good ones nothing is believed.
fn ensure_few(bad: BadBlocks, blocks: usize, reason: impl Fn() -> String) -> Result<(), Rejected> {
    if 2 * bad.count() > blocks { Err(malformed(reason())) } else { Ok(()) }
}

fn check_factory_bytes(
    data: DataPacket<'_>,
    product: Product,
    model_byte: Option<u8>,
) -> Result<(), Rejected> {
    if product.model_byte().is_none() {
        return Ok(());
    }
    let found = data.model_byte();
    match (model_byte, detect::claimed_product(found)) {
        (Some(known), _) if known == found => {}
        (Some(_), Some((other, _))) if other != product => {
            return Err(of_another_model(other.name(), product));
        }
        (Some(_), _) => {
            return Err(foreign(format!(
                "model byte {found:#04x}, earlier packets of this {product} had another"
            )));
        }
        // old VLP-16s send the byte of an HDL-32E
        (None, Some((other, _)))
            if !other.sends_as(product) && (other, product) != (Product::Hdl32e, Product::Vlp16) =>
        {
            return Err(foreign(format!("--model says {product}, model byte {found:#04x} is of a {other}")));
        }
        (None, _) => {}
    }
    if detect::mode(data).is_none() && product != Product::Hdl32e && !detect::is_blank(data) {
        return Err(malformed(format!(
            "return mode byte {:#04x}, expected 0x37, 0x38, 0x39 or 0x3b",
            data.mode_byte()
        )));
    }
    Ok(())
}

fn of_another_model(other: &str, product: Product) -> Rejected {
    foreign(format!(
        "a packet of a {other}, and those before from its sender to this port are of a {product}: models behind one address \
         and one port cannot be separated"
    ))
}

pub(super) fn foreign(reason: String) -> Rejected {
    Rejected::Foreign { reason }
}

fn malformed(reason: String) -> Rejected {
    Rejected::Malformed { reason }
}
