//! Which product sends these packets: flags and model byte say so, and the packet period says whether they lie.

use super::product::{Family, Product, ReturnMode};
use super::wire::{BLOCKS, DataPacket};

/// What a look at the first packets gave.
#[derive(Clone, Debug, PartialEq)]
pub struct Identity {
    /// The product.
    pub product: Product,
    /// Firing cycle, ns: the product's, or measured where it differs between firmwares (VLS-128).
    pub cycle_ns: f64,
    /// What is not as the packets claim, or cannot be seen from them; for the log.
    pub remark: Option<String>,
}

/// Packets that settle every question.
pub(crate) const ENOUGH_PACKETS: usize = 24;

/// Identifies a sensor from its first packets, in the order they came. `None`: more are needed (never once there
/// are [`ENOUGH_PACKETS`] or `all` is set, unless no packet is of a known format).
pub(crate) fn identify<'a>(
    packets: impl Iterator<Item = DataPacket<'a>> + Clone,
    all: bool,
) -> Option<Identity> {
    let count = packets.clone().count();
    let settled = |needed: usize| all || count >= needed.min(ENOUGH_PACKETS);
    let first = packets.clone().next()?;
    match family(first)? {
        Family::OneTwentyEight => {
            if !settled(ENOUGH_PACKETS) {
                return None;
            }
            let dual = mode(first) == Some(ReturnMode::Dual);
            let sequences = Product::Vls128.sequences_per_packet(dual) as f64;
            let cycle_ns = measured_period_ns(packets)
                .map(|period_ns| period_ns / sequences)
                .filter(|cycle_ns| (45_000.0..70_000.0).contains(cycle_ns));
            let remark = cycle_ns.is_none().then(|| {
                "VLS-128: the packet period does not give the firing cycle; 55.28 us assumed".to_owned()
            });
            let cycle_ns = cycle_ns.unwrap_or(Product::Vls128.cycle_ns());
            Some(Identity { product: Product::Vls128, cycle_ns, remark })
        }
        Family::SixtyFour => settled(ENOUGH_PACKETS).then(|| identify_hdl_64e(packets)),
        Family::Sixteen | Family::ThirtyTwo => {
            let (claimed, mut remark) = claimed_product(first.model_byte())?;
            let dual = is_dual(first, claimed);
            if claimed != Product::Hdl32e {
                return Some(Identity { product: claimed, cycle_ns: claimed.cycle_ns(), remark });
            }
            if !settled(6) {
                return None;
            }
            let mut product = claimed;
            match measured_period_ns(packets) {
                Some(period_ns) if is_period_of(Product::Vlp16, dual, period_ns) => {
                    product = Product::Vlp16;
                    remark = Some(format!(
                        "model byte 0x21 says HDL-32E, the packet period of {:.0} us says VLP-16, as old VLP-16s do",
                        period_ns / 1e3
                    ));
                }
                Some(period_ns) if is_period_of(Product::Hdl32e, dual, period_ns) => {}
                Some(period_ns) => {
                    let period_us = period_ns / 1e3;
                    remark = Some(format!(
                        "model byte 0x21 says HDL-32E; a packet period of {period_us:.0} us is not usual for one"
                    ));
                }
                None => {
                    remark = Some(
                        "model byte 0x21 read as HDL-32E: too few packets to check the period".to_owned(),
                    );
                }
            }
            Some(Identity { product, cycle_ns: product.cycle_ns(), remark })
        }
    }
}

/// Flags of so many blocks may be damaged, and the others tell the family still.
const MOST_BAD_FLAGS: usize = 2;

/// The family a packet's flags speak of; none when they are of no known format.
pub(crate) fn family(packet: DataPacket<'_>) -> Option<Family> {
    let mut banks = [false; 4];
    let mut unknown = 0;
    // fillers: a dual VLS-128 packet uses eight of its blocks
    for block in 0..8 {
        match packet.bank(block) {
            Some(bank) => banks[bank] = true,
            None => unknown += 1,
        }
    }
    if banks[2] || banks[3] {
        return (unknown <= MOST_BAD_FLAGS).then_some(Family::OneTwentyEight);
    }
    for block in 8..BLOCKS {
        match packet.bank(block) {
            Some(bank) => banks[bank] = true,
            None => unknown += 1,
        }
    }
    match banks {
        _ if unknown > MOST_BAD_FLAGS => None,
        [_, _, true, _] | [_, _, _, true] => None,
        [_, true, ..] => Some(Family::SixtyFour),
        // 16 or 32 lasers: the model byte decides
        _ => Some(Family::ThirtyTwo),
    }
}

/// The model that a packet is of which is none of a product, by the flags of all its blocks and by its model byte.
pub(crate) fn other_model(packet: DataPacket<'_>, product: Product) -> Option<&'static str> {
    let of_flags = family(packet).filter(|family| *family != product.family())?;
    if of_flags == Family::SixtyFour {
        let lower = (0..BLOCKS).filter(|block| packet.bank(*block) == Some(1)).count();
        return (lower == BLOCKS / 2).then_some("hdl-64e");
    }
    let (claimed, _) = claimed_product(packet.model_byte())?;
    let claims = match claimed.family() {
        Family::Sixteen => Family::ThirtyTwo, // their flags are the same
        family => family,
    };
    (claimed != product && claims == of_flags).then(|| claimed.name())
}

/// The type and the value of the byte of its status that a packet of an HDL-64E carries; none of other sensors.
pub(crate) fn status_bytes(payload: &[u8]) -> Option<[u8; 2]> {
    let packet = DataPacket::of(payload.try_into().ok()?);
    (family(packet) == Some(Family::SixtyFour)).then(|| [packet.mode_byte(), packet.model_byte()])
}

/// The product that a model byte names.
pub(crate) fn claimed_product(model_byte: u8) -> Option<(Product, Option<String>)> {
    match model_byte {
        0x23 => Some((
            Product::Vlp32b,
            Some("model byte 0x23 is sent by VLP-32A and VLP-32B alike; VLP-32B assumed".to_owned()),
        )),
        // the VLP-16 manual 63-9243 revision D lists the VLS-128 so
        0x63 => Some((Product::Vls128, None)),
        _ => Product::ALL
            .into_iter()
            .find(|product| product.model_byte() == Some(model_byte))
            .map(|product| (product, None)),
    }
}

/// Whether both factory bytes are blank, as old firmware leaves them.
pub(crate) fn is_blank(packet: DataPacket<'_>) -> bool {
    [packet.mode_byte(), packet.model_byte()] == [0, 0]
}

/// Return mode by the factory byte.
pub(crate) fn mode(packet: DataPacket<'_>) -> Option<ReturnMode> {
    ReturnMode::from_byte(packet.mode_byte())
}

/// Whether a packet carries two returns. Old HDL-32E do not set the byte (firmware before 2.2.20) and HDL-64E have
/// none: two returns show as equal azimuths.
pub(crate) fn is_dual(packet: DataPacket<'_>, product: Product) -> bool {
    match product.family() {
        Family::SixtyFour => {
            let equal = |a, b| packet.azimuth(a) == packet.azimuth(b) && packet.bank(a) == packet.bank(b);
            product != Product::Hdl64eS1
                && (0..BLOCKS).step_by(4).all(|block| equal(block, block + 2))
                && packet.azimuth(0) != packet.azimuth(8)
        }
        _ => match mode(packet) {
            Some(mode) => mode == ReturnMode::Dual,
            None => {
                (0..BLOCKS).step_by(2).all(|block| packet.azimuth(block) == packet.azimuth(block + 1))
                    && packet.azimuth(0) != packet.azimuth(BLOCKS - 2)
            }
        },
    }
}

fn identify_hdl_64e<'a>(packets: impl Iterator<Item = DataPacket<'a>> + Clone) -> Identity {
    let identity = |product: Product, remark| Identity { product, cycle_ns: product.cycle_ns(), remark };
    // an S1 sends a temperature and " DegC" there, and in turn its version, such as "v25c"
    let is_text = |packet: DataPacket<'_>| {
        let [_, text @ ..] = packet.trailer() else { return false };
        text == b" DegC" || packet.trailer().iter().all(|byte| (0x20..0x7F).contains(byte) || *byte == 0)
    };
    if packets.clone().all(is_text) {
        return identity(Product::Hdl64eS1, None);
    }
    let dual = packets.clone().all(|packet| is_dual(packet, Product::Hdl64eS3));
    let warned = packets.clone().any(|packet| packet.mode_byte() == b'W');
    if dual || warned {
        return identity(Product::Hdl64eS3, None);
    }
    match measured_period_ns(packets) {
        Some(period_ns) if is_period_of(Product::Hdl64eS3, false, period_ns) => {
            identity(Product::Hdl64eS3, None)
        }
        Some(period_ns) if is_period_of(Product::Hdl64eS2, false, period_ns) => {
            identity(Product::Hdl64eS2, None)
        }
        period_ns => {
            let found = period_ns.map_or("unknown".to_owned(), |ns| format!("{:.0} us", ns / 1e3));
            let remark = format!(
                "HDL-64E with a packet period ({found}) of neither S2 (288 us) nor S3 (346 us): S2 assumed"
            );
            identity(Product::Hdl64eS2, Some(remark))
        }
    }
}

fn is_period_of(product: Product, dual: bool, period_ns: f64) -> bool {
    let usual_ns = product.sequences_per_packet(dual) as f64 * product.cycle_ns();
    (period_ns / usual_ns - 1.0).abs() < 0.06
}

/// Mean of the steps between stamps that lie near their median; lost packets only make steps wider.
fn measured_period_ns<'a>(packets: impl Iterator<Item = DataPacket<'a>> + Clone) -> Option<f64> {
    let stamps = packets.map(|packet| i64::from(packet.stamp_us()));
    let mut steps: Vec<i64> = stamps
        .clone()
        .zip(stamps.skip(1))
        .map(|(from, to)| (to - from).rem_euclid(3_600_000_000))
        .filter(|step| (1..1_000_000).contains(step))
        .collect();
    steps.sort_unstable();
    let median = *steps.get(steps.len().checked_sub(1)? / 2)? as f64;
    let near = steps.iter().map(|step| *step as f64).filter(|step| (step / median - 1.0).abs() < 0.05);
    Some(1e3 * near.clone().sum::<f64>() / near.count() as f64)
}
