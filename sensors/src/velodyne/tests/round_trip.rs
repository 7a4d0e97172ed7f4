//! Encode, then decode: the same ranges, reflectivities, azimuths and times.

use proptest::prelude::*;

use super::*;
use crate::velodyne::Cut;

const START_NS: u64 = 1_700_000_123_456_789_000;

/// Steady spin with random samples.
fn random_firings(
    product: Product,
    dual: bool,
    packets: usize,
    first_counts: u16,
    block_step: u16,
    seed: u64,
) -> Vec<Firing> {
    let mut state = seed | 1;
    let mut random = move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state
    };
    let per_block = if product.lasers() == 16 { 2 } else { 1 };
    let mut sample = move |not: Option<(u32, u8)>| loop {
        let bits = random();
        let range_mm = if bits % 4 == 0 { 0 } else { (bits >> 8) as u16 as u32 * product.distance_unit_mm() };
        // a range of 0 in the second layer means that the first is repeated: it has no level of its own
        let level = if range_mm == 0 { 0 } else { (bits >> 32) as u8 };
        if range_mm == 0 || not != Some((range_mm, level)) {
            return (range_mm, level);
        }
    };
    (0..packets * product.sequences_per_packet(dual))
        .map(|number| {
            let first: Vec<_> = (0..product.lasers()).map(|_| sample(None)).collect();
            let second = dual.then(|| first.iter().map(|first| sample(Some(*first))).collect());
            let (block, half) = (number / per_block, number % per_block);
            let counts = f64::from(first_counts) + block as f64 * f64::from(block_step);
            let counts = counts + half as f64 * f64::from(block_step) / per_block as f64;
            Firing {
                time_ns: START_NS + (number as f64 * product.cycle_ns()).round() as u64,
                azimuth_counts: counts.rem_euclid(36_000.0),
                first,
                second,
            }
        })
        .collect()
}

fn check(product: Product, mode: ReturnMode, sent: &[Firing], cut: Cut) -> Result<(), TestCaseError> {
    let packets = encode(product, mode, sent);
    let known = (product != Product::Vls128).then_some(product);
    let options = Options { product: known, cut, ..Options::default() };
    let outcome = decode(packets.iter().map(|(time_ns, payload)| (*time_ns, &payload[..])), options);
    prop_assert_eq!(outcome.product, Some(product));
    prop_assert!(outcome.rejected.is_empty(), "{:?}", outcome.rejected);
    prop_assert_eq!(outcome.stats.packets, packets.len() as u64);
    prop_assert_eq!(outcome.stats.lost_packets + outcome.stats.duplicated + outcome.stats.reordered, 0);
    let came = firings(&outcome.frames);
    prop_assert_eq!(came.len(), sent.len());
    for (number, (came, sent)) in came.iter().zip(sent).enumerate() {
        prop_assert_eq!(&came.first, &sent.first, "first layer of firing {}", number);
        prop_assert_eq!(&came.second, &sent.second, "second layer of firing {}", number);
        // stamps are whole microseconds; the cycle of a VLS-128 is measured from them
        let tolerance_ns = if product == Product::Vls128 { 2000 } else { 1000 };
        prop_assert!(
            came.time_ns.abs_diff(sent.time_ns) <= tolerance_ns,
            "{} {}",
            came.time_ns,
            sent.time_ns
        );
        let off = (came.azimuth_counts - sent.azimuth_counts + 18_000.0).rem_euclid(36_000.0) - 18_000.0;
        prop_assert!(off.abs() < 0.01, "firing {}: {} {}", number, came.azimuth_counts, sent.azimuth_counts);
    }
    for frame in &outcome.frames {
        prop_assert!(
            frame.complete || frame.frame_id == 0 || frame.frame_id as usize + 1 == outcome.frames.len()
        );
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn frames_come_back(
        product in proptest::sample::select(&Product::ALL[..]),
        mode in proptest::sample::select(&[ReturnMode::Strongest, ReturnMode::Last, ReturnMode::Dual][..]),
        packets in 25_usize..90,
        first_counts in 0_u16..36_000,
        step in 4_u16..60,
        seed: u64,
        by_azimuth: bool,
    ) {
        // only an S3 of the HDL-64E sends two returns
        let hdl_64e = product.lasers() == 64 && product != Product::Hdl64eS3;
        let mode = if hdl_64e && mode == ReturnMode::Dual { ReturnMode::Last } else { mode };
        let cut = if by_azimuth { Cut::Azimuth(1.0) } else { Cut::Packets };
        // fast enough for several turns in few packets
        let per_packet = product.sequences_per_packet(mode == ReturnMode::Dual) / if product.lasers() == 16 { 2 } else { 1 };
        let step = step * (12 / per_packet as u16).max(1);
        let sent = random_firings(product, mode == ReturnMode::Dual, packets, first_counts, step, seed);
        check(product, mode, &sent, cut)?;
    }

    #[test]
    fn any_bytes_are_survived(
        payloads in proptest::collection::vec(
            (proptest::collection::vec(any::<u8>(), 1206), 0_u8..4, any::<bool>()), 1..60),
        product in proptest::option::of(proptest::sample::select(&Product::ALL[..])),
    ) {
        let payloads: Vec<Vec<u8>> = payloads.into_iter().map(|(mut bytes, flags, valid_azimuths)| {
            for block in 0..12 {
                let at = block * 100;
                let bank = match flags { 0 => 0, 1 => block % 2, 2 => block % 4, _ => continue };
                bytes[at..at + 2].copy_from_slice(&super::super::wire::BANK_FLAGS[bank].to_le_bytes());
                if valid_azimuths {
                    bytes[at + 3] %= 0x8C;
                }
            }
            bytes[1204] = 0x37 + bytes[1204] % 3;
            if flags == 0 { bytes[1205] = [0x21, 0x22, 0x23, 0x28][usize::from(bytes[1205] % 4)]; }
            if flags == 2 { bytes[1205] = 0xA1; }
            bytes
        }).collect();
        let options = Options { product, ..Options::default() };
        let outcome = decode(payloads.iter().map(|payload| (0, &payload[..])), options);
        let counted = &outcome.stats;
        let all = counted.packets + counted.malformed + counted.foreign + counted.duplicated + counted.late;
        prop_assert_eq!(all, payloads.len() as u64, "every packet is counted once");
    }
}

#[test]
fn the_azimuth_cut_divides_where_it_says() {
    let sent = random_firings(Product::Vlp32c, false, 80, 35_000, 90, 7);
    let packets = encode(Product::Vlp32c, ReturnMode::Strongest, &sent);
    let options = Options { cut: Cut::Azimuth(std::f64::consts::FRAC_PI_2), ..Options::default() };
    let outcome = decode(packets.iter().map(|(time_ns, payload)| (*time_ns, &payload[..])), options);
    // 80 packets are 2.4 turns, which pass 90 degrees three times
    assert_eq!(outcome.frames.len(), 4);
    for frame in &outcome.frames[1..] {
        let first_counts = frame.column_azimuth_rad[0].to_degrees() * 100.0;
        assert!((9000.0..9090.0).contains(&first_counts), "{first_counts}");
    }
    let complete: Vec<_> = outcome.frames.iter().map(|frame| frame.complete).collect();
    assert_eq!(complete, [false, true, true, false]);
}

/// An HDL-64E whose stamps lie closer than the firings of a packet take: its columns stay as they were sent.
#[test]
fn packets_that_overlap_in_time_do_not_interleave() {
    let mut sent = random_firings(Product::Hdl64eS2, false, 600, 77, 17, 5);
    for (number, firing) in sent.iter_mut().enumerate() {
        firing.time_ns = START_NS + number as u64 * 27_500;
    }
    let packets = encode(Product::Hdl64eS2, ReturnMode::Strongest, &sent);
    let options = Options { product: Some(Product::Hdl64eS2), ..Options::default() };
    let outcome = decode(packets.iter().map(|(time_ns, payload)| (*time_ns, &payload[..])), options);
    let came = firings(&outcome.frames);
    assert_eq!(came.len(), sent.len());
    for (number, (came, sent)) in came.iter().zip(&sent).enumerate() {
        assert_eq!(came.first, sent.first, "firing {number}");
        assert!((came.azimuth_counts - sent.azimuth_counts).abs() < 0.01, "firing {number}");
    }
    for frame in &outcome.frames {
        let [first_ns, last_ns] = frame.time_span_ns().unwrap();
        assert!(frame.column_time_ns.iter().all(|time_ns| (first_ns..=last_ns).contains(time_ns)));
    }
}
