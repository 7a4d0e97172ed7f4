//! A sensor that is set otherwise while it is recorded: other returns, another rate. Nothing counts as lost or damaged.

use super::*;

const PRODUCTS: [Product; 4] = [Product::Vlp16, Product::Hdl32e, Product::Vlp32c, Product::Vls128];

/// Two revolutions of firings from a time on.
fn firings_at(product: Product, dual: bool, rate_hz: f64, start_ns: u64) -> Vec<Firing> {
    let count = (2e9 / rate_hz / product.cycle_ns()) as usize;
    let per_packet = product.sequences_per_packet(dual);
    let step = rate_hz * product.cycle_ns() * 1e-9 * 36_000.0;
    (0..count / per_packet * per_packet)
        .map(|number| Firing {
            time_ns: start_ns + (number as f64 * product.cycle_ns()) as u64,
            azimuth_counts: (number as f64 * step).rem_euclid(36_000.0),
            first: vec![(4000, 9); product.lasers()],
            second: dual.then(|| vec![(8000, 7); product.lasers()]),
        })
        .collect()
}

#[test]
fn returns_and_rate_that_change_lose_nothing() {
    let settings = [(false, 10.0), (true, 10.0), (false, 20.0), (true, 5.0)];
    for product in PRODUCTS {
        for from in settings {
            for to in settings.into_iter().filter(|to| *to != from) {
                for pause_ns in [0, 6_000_000_000] {
                    let mode = |dual: bool| if dual { ReturnMode::Dual } else { ReturnMode::Strongest };
                    let first = firings_at(product, from.0, from.1, 1_700_000_000_000_000_000);
                    let end_ns = first.last().unwrap().time_ns + product.cycle_ns() as u64;
                    let second = firings_at(product, to.0, to.1, end_ns + pause_ns);
                    let mut packets = encode(product, mode(from.0), &first);
                    packets.extend(encode(product, mode(to.0), &second));
                    let outcome = decode(
                        packets.iter().map(|(time_ns, payload)| (*time_ns, &payload[..])),
                        Options::default(),
                    );
                    let what = format!("{product} {from:?} to {to:?}, pause {pause_ns} ns");
                    let DecodeStats { lost_packets, malformed, late, duplicated, foreign, .. } =
                        outcome.stats;
                    assert_eq!([lost_packets, malformed, late, duplicated, foreign], [0; 5], "{what}");
                    assert_eq!(firings(&outcome.frames).len(), first.len() + second.len(), "{what}");
                }
            }
        }
    }
}
