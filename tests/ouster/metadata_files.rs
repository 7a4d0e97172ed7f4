//! Metadata files of firmware 1.12 to 3.2, whole and broken.

use sensors::ouster::{Metadata, Profile, Synthetic, TimestampMode};

use super::metadata;
use crate::support::shared;

pub fn metadata_of_every_age_is_read() {
    let mut read = 0;
    for entry in std::fs::read_dir(shared("captures/metadata")).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            continue;
        }
        let name = path.file_name().unwrap().to_str().unwrap();
        let metadata = metadata(&format!("captures/metadata/{name}"));
        let text = metadata.to_json();
        let again = Metadata::parse(&text, name).unwrap();
        assert_eq!(again.to_json(), text, "{name}");
        assert_eq!(again.column_window, metadata.column_window, "{name}");
        assert_eq!(metadata.model.channels(), metadata.pixels_per_column, "{name}");
        if let Some(serial) = name.split('-').nth(1).filter(|_| name.contains("_os")) {
            assert_eq!(metadata.serial, serial, "{name}");
        }
        read += 1;
    }
    assert!(read >= 26, "{read} files");

    let of = |name: &str| metadata(&format!("captures/metadata/{name}.json"));
    // what old firmware leaves out
    let gen1 = of("1_12_os1-991913000010-64");
    assert_eq!((gen1.profile, gen1.columns_per_frame, gen1.columns_per_packet), (Profile::Legacy, 1024, 16));
    assert_eq!(gen1.pixel_shift_by_row[..8], [18, 12, 6, 0, 18, 12, 6, 0]);
    assert_eq!((gen1.lidar_port, gen1.imu_port), (Some(60823), Some(60023)));
    // the first ones do not state their product: beams say it
    let unnamed = metadata("captures/ouster/ouster_example.json");
    assert_eq!((unnamed.product_line.as_str(), unnamed.model.name.as_str()), ("", "os1-64-gen1"));
    assert_eq!(unnamed.model.max_range_m, 120.0);
    let reduced = of("ouster-studio-reduced-config-v1");
    assert_eq!(reduced.columns_per_frame, 2048);
    assert_eq!(reduced.pixel_shift_by_row[..4], [36, 24, 12, 0]);
    assert!((reduced.model.beams()[0].range_offset_m - 0.012_163).abs() < 1e-15);
    // gen-1 sensors with 16 or 32 beams sent 64 pixels before firmware 1.14
    assert_eq!(of("1_12_os1-991937000062-16A0_legacy").pixels_per_column, 64);
    assert_eq!(of("1_14_beta_os1-991937000062-16A0_legacy").pixels_per_column, 16);
    let synchronised = of("2_4_0_os-992146000760-128");
    assert_eq!(synchronised.timestamp_mode, Some(TimestampMode::SyncPulseIn));
    assert_eq!(synchronised.init_id, 2_573_180);
    let windowed = of("2_0_0_os1-992008000494-128_col_win_legacy");
    assert_eq!((windowed.column_window, windowed.packets_per_frame()), ([2014, 2036], 3));
    let dual = of("3_0_1_os-122246000293-128");
    assert_eq!(dual.profile, Profile::Rng19Rfl8Sig16Nir16Dual);
    assert_eq!(dual.model.max_range_m, 170.0, "limits come from the catalogue");
}

pub fn malformed_metadata_is_named() {
    let result = |name: &str| {
        let path = format!("captures/metadata/malformed/{name}.json");
        Metadata::parse(&std::fs::read_to_string(shared(&path)).unwrap(), name)
            .map_err(|error| error.to_string())
    };
    for (name, words) in [
        ("garbled_legacy_and_nonlegacy", vec!["config_params", "sensor_info", "flat shape"]),
        ("incomplete_no_calref_nonlegacy", vec!["calibration_status"]),
        ("incomplete_no_sensor_info_nonlegacy", vec!["sensor_info"]),
        ("incorrect_nbeam_angles_legacy_113", vec!["beam_azimuth_angles", "63", "64"]),
        ("legacy_with_calibration_status", vec!["beam_intrinsics", "flat shape"]),
    ] {
        let error = result(name).unwrap_err();
        assert!(error.starts_with(name), "{error}");
        assert!(words.iter().all(|word| error.contains(word)), "{error}");
    }
    for (name, profile) in [
        ("complete_but_all_zeros_legacy", Profile::Legacy),
        ("incomplete_data_format_legacy", Profile::Rng19Rfl8Sig16Nir16),
        ("incomplete_data_format_nonlegacy", Profile::Rng19Rfl8Sig16Nir16),
    ] {
        let metadata = result(name).unwrap();
        assert_eq!((metadata.profile, metadata.columns_per_frame), (profile, 1024), "{name}");
    }
    for (text, words) in [
        ("", "line 1, column 0: not JSON"),
        ("[1]", "document: expected an object"),
        ("{\"lidar_mode\": 5}", "lidar_mode: expected a string, found 5"),
        ("{\"lidar_mode\": \"1024\"}", "lidar_mode"),
        ("{}", "beam_altitude_angles: expected a list of angles in degrees, found nothing"),
        ("{\"beam_altitude_angles\": [1, \"x\"]}", "beam_altitude_angles[1]: expected a number, found \"x\""),
        ("{\"beam_altitude_angles\": [400], \"beam_azimuth_angles\": [0]}", "beam_altitude_angles[0]"),
    ] {
        let error = Metadata::parse(text, "file").unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    }
}

pub fn synthetic_metadata_survives_its_file() {
    for profile in Profile::all() {
        let metadata = Metadata::synthetic(&Synthetic::new("os0-32", 5, profile).columns(2048, 16)).unwrap();
        let again = Metadata::parse(&metadata.to_json(), "again").unwrap();
        assert_eq!((again.profile, again.header), (profile, metadata.header));
        assert_eq!(again.packet_format(), metadata.packet_format());
        assert_eq!(again.lidar_port, metadata.lidar_port);
        for channel in 0..32 {
            let [ray, same] =
                [&metadata.model, &again.model].map(|model| model.ray(channel, 1.0).at_range(10.0));
            assert!((ray - same).length() < 1e-10);
        }
    }
    let refuse = |wanted: Synthetic<'_>| Metadata::synthetic(&wanted).unwrap_err().to_string();
    assert!(refuse(Synthetic::new("vlp-16", 5, Profile::Legacy)).contains("an Ouster"));
    assert!(refuse(Synthetic::new("os9-1", 5, Profile::Legacy)).contains("os1-64"));
    assert!(refuse(Synthetic::new("os1-64", 5, Profile::Legacy).columns(1000, 16)).contains("multiple"));
}
