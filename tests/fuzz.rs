//! The fuzz targets without a fuzzer: stored regressions, random bytes and damaged packets.

#[path = "../sensors/fuzz/src/drive.rs"]
mod drive;

use std::path::PathBuf;

use proptest::prelude::*;
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};
use sensors::ouster::{Metadata, OusterEncoder, Profile, Synthetic};
use sensors::velodyne::{Column, Product, ReturnMode, VelodyneEncoder};
use sensors::{Frame, Layer};

use crate::support::{Case, case};

pub const CASES: &[Case] = &[
    case("regressions_stay_fixed", regressions_stay_fixed),
    case("random_bytes_do_no_harm", random_bytes_do_no_harm),
    case("damaged_ouster_packets_do_no_harm", damaged_ouster_packets_do_no_harm),
    case("damaged_velodyne_packets_do_no_harm", damaged_velodyne_packets_do_no_harm),
    case("damaged_metadata_does_no_harm", damaged_metadata_does_no_harm),
];

/// The same inputs on every run; a failure is made smaller and printed, to become a stored regression.
fn runner(cases: u32) -> TestRunner {
    let config = Config { cases, failure_persistence: None, ..Config::default() };
    TestRunner::new_with_rng(config, TestRng::deterministic_rng(RngAlgorithm::ChaCha))
}

fn regressions_stay_fixed() {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("sensors/fuzz/regressions");
    let mut replayed = 0;
    for (name, target) in drive::TARGETS {
        let Ok(entries) = std::fs::read_dir(folder.join(name)) else { continue };
        for entry in entries {
            let path = entry.unwrap().path();
            println!("{}", path.display());
            target(&std::fs::read(path).unwrap());
            replayed += 1;
        }
    }
    assert!(replayed > 0, "{} holds regressions", folder.display());
}

fn random_bytes_do_no_harm() {
    for (name, target) in drive::TARGETS {
        let bytes = prop::collection::vec(any::<u8>(), 0..3000);
        let outcome = runner(60).run(&bytes, |bytes| {
            target(&bytes);
            Ok(())
        });
        assert!(outcome.is_ok(), "{name}: {}", outcome.unwrap_err());
    }
}

/// Places (as shares of the whole) and values of damaged bytes.
fn damage() -> impl Strategy<Value = Vec<(f64, u8)>> {
    prop::collection::vec((0.0..1.0, any::<u8>()), 0..20)
}

fn damaged(mut bytes: Vec<u8>, damage: &[(f64, u8)]) -> Vec<u8> {
    for (share, value) in damage {
        let at = (share * bytes.len() as f64) as usize;
        bytes[at] = *value;
    }
    bytes
}

fn damaged_ouster_packets_do_no_harm() {
    let profiles: Vec<Profile> = Profile::all().collect();
    for (number, profile) in profiles.iter().enumerate().filter(|(_, profile)| **profile != Profile::Off) {
        let wanted = Synthetic::new("os1-16", 122_201_000_998, *profile).columns(512, 16);
        let metadata = Metadata::synthetic(&wanted).unwrap();
        let mut encoder = OusterEncoder::new(metadata);
        let mut packets = vec![number as u8]; // the target's choice of profile; os1-16 is choice 0
        for frame_id in 5..8 {
            encoder.frame(&frame(frame_id, 512, 16), &mut |packet| packets.extend_from_slice(packet));
        }
        let outcome = runner(6).run(&damage(), |damage| {
            let mut bytes = damaged(packets.clone(), &damage);
            bytes[0] = number as u8;
            drive::ouster_packets(&bytes);
            Ok(())
        });
        assert!(outcome.is_ok(), "{profile:?}: {}", outcome.unwrap_err());
    }
}

fn damaged_velodyne_packets_do_no_harm() {
    for (product, mode) in [
        (Product::Vlp16, ReturnMode::Strongest),
        (Product::Vlp16, ReturnMode::Dual),
        (Product::Hdl32e, ReturnMode::Last),
        (Product::Vlp32c, ReturnMode::Dual),
        (Product::Vls128, ReturnMode::Strongest),
    ] {
        let mut encoder = VelodyneEncoder::new(product, mode);
        let choice = Product::ALL.iter().position(|known| *known == product).unwrap() as u8;
        let mut packets = vec![choice];
        let (ranges, levels) = (vec![500; product.lasers()], vec![9; product.lasers()]);
        for column in 0..3000_u64 {
            let second = (mode == ReturnMode::Dual).then_some((&ranges[..], &levels[..]));
            let column = Column {
                time_ns: 1_000_000_000 + column * product.cycle_ns() as u64,
                azimuth_rad: column as f64 * 0.003 % std::f64::consts::TAU,
                range_mm: &ranges,
                reflectivity: &levels,
                second,
            };
            encoder.push_column(column, &mut |_, packet| packets.extend_from_slice(packet));
        }
        let outcome = runner(8).run(&damage(), |damage| {
            let mut bytes = damaged(packets.clone(), &damage);
            for first in [choice, Product::ALL.len() as u8] {
                bytes[0] = first;
                drive::velodyne_packets(&bytes);
            }
            Ok(())
        });
        assert!(outcome.is_ok(), "{product}: {}", outcome.unwrap_err());
    }
}

fn damaged_metadata_does_no_harm() {
    let wanted = Synthetic::new("os1-64", 122_201_000_998, Profile::Rng15Rfl8Nir8Dual);
    let text = Metadata::synthetic(&wanted).unwrap().to_json().into_bytes();
    let outcome = runner(150).run(&damage(), |damage| {
        drive::ouster_metadata(&damaged(text.clone(), &damage));
        Ok(())
    });
    assert!(outcome.is_ok(), "{}", outcome.unwrap_err());
}

pub fn frame(frame_id: u32, columns: usize, channels: usize) -> Frame {
    let layer = Layer {
        range_mm: (0..columns * channels).map(|at| 800 + at as u32 % 5000).collect(),
        reflectivity: vec![7; columns * channels],
        raw_words: vec![[900, 0x0700_0384, 1, 2, 3]; columns * channels],
        ..Layer::default()
    };
    Frame {
        frame_id,
        channels,
        column_time_ns: (0..columns as u64)
            .map(|c| u64::from(frame_id) * 100_000_000 + c * 190_000)
            .collect(),
        column_azimuth_rad: (0..columns)
            .map(|column| column as f64 / columns as f64 * std::f64::consts::TAU)
            .collect(),
        column_valid: vec![true; columns],
        first: layer,
        ..Frame::default()
    }
}
