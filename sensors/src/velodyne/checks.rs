//! Whether a packet can be one of a model's, and is whole.

use crate::decoder::Rejected;

use super::detect;
use super::product::{Family, Product};
use super::stream::Stream;
use super::wire::{AZIMUTH_COUNTS, BANK_FLAGS, BLOCKS, DATA_PACKET_BYTES, DataPacket, POSITION_PACKET_BYTES};

/// Blocks that every packet uses; the rest may be filler.
const LEAST_BLOCKS: usize = 8;

/// Why a payload of another length is not taken.
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
        None => return Err(malformed("block flags of no known bank".to_owned())),
        Some(Family::ThirtyTwo) if detect::claimed_product(data.model_byte()).is_none() => {
            let byte = data.model_byte();
            return Err(foreign(format!("model byte {byte:#04x} is of no known product")));
        }
        Some(_) => {}
    }
    check_azimuths(data, LEAST_BLOCKS)
}

/// Whether a packet can be one of a stream.
pub(super) fn check(data: DataPacket<'_>, stream: &Stream, model_byte: Option<u8>) -> Result<(), Rejected> {
    let product = stream.product();
    let layout = stream.layout(data);
    for (block, bank) in layout.banks.iter().enumerate() {
        if data.bank(block) != Some(usize::from(*bank)) {
            if let Some(other) = detect::other_model(data, product) {
                return Err(of_another_model(other, product));
            }
            let expected = BANK_FLAGS[usize::from(*bank)];
            return Err(malformed(format!(
                "block {block} of a {product} begins with {:#06x}, expected {expected:#06x}",
                data.flag(block)
            )));
        }
    }
    if product == Product::Hdl64eS1
        && let Some(block) = (0..BLOCKS).find(|block| data.bank(*block).is_none_or(|bank| bank > 1))
    {
        let flag = data.flag(block);
        return Err(malformed(format!("block {block} begins with {flag:#06x}, expected 0xeeff or 0xddff")));
    }
    let blocks = if product == Product::Hdl64eS1 { BLOCKS } else { layout.blocks };
    check_azimuths(data, blocks)?;
    if product.model_byte().is_some() {
        if model_byte.is_some_and(|known| known != data.model_byte()) {
            let found = data.model_byte();
            return Err(match detect::claimed_product(found) {
                Some((other, _)) if other != product => of_another_model(other.name(), product),
                _ => {
                    foreign(format!("model byte {found:#04x}, earlier packets of this {product} had another"))
                }
            });
        }
        if detect::mode(data).is_none() && product != Product::Hdl32e {
            return Err(malformed(format!(
                "return mode byte {:#04x}, expected 0x37, 0x38 or 0x39",
                data.mode_byte()
            )));
        }
    }
    Ok(())
}

fn of_another_model(other: &str, product: Product) -> Rejected {
    foreign(format!(
        "a packet of a {other}, and those before from its sender to this port are of a {product}: models behind one address \
         and one port are not told apart"
    ))
}

fn check_azimuths(data: DataPacket<'_>, blocks: usize) -> Result<(), Rejected> {
    match (0..blocks).find(|block| data.azimuth(*block) >= AZIMUTH_COUNTS) {
        Some(block) => Err(malformed(format!(
            "azimuth {} in block {block}, expected less than {AZIMUTH_COUNTS}",
            data.azimuth(block)
        ))),
        None => Ok(()),
    }
}

pub(super) fn foreign(reason: String) -> Rejected {
    Rejected::Foreign { reason }
}

fn malformed(reason: String) -> Rejected {
    Rejected::Malformed { reason }
}
