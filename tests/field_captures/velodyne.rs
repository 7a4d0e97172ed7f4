//! Velodynes: two with one address, clocks that jump, what packets do not state.

use serde_json::{Value, json};

use super::{ensure_nothing_is_missing, field, inspect, of_frames};
use crate::decode::{decode, path};
use crate::support::datagram::{Datagram, datagrams, write_capture};
use crate::support::shared;

pub fn two_sensors_with_one_address_are_two() {
    let capture = field("two_vlp16_one_address.pcapng");
    let ensure_two = |document: &Value, stderr: &str| {
        let sensors = document["sensors"].as_array().unwrap();
        assert_eq!(sensors.len(), 2, "{stderr}");
        for sensor in sensors {
            assert_eq!(of_frames(sensor, "packets"), [77, 23], "{stderr}");
            assert_eq!(of_frames(sensor, "points"), [18_790, 7001]);
        }
        ensure_nothing_is_missing(document);
    };
    let (code, document, stderr) = decode(&capture, &[], &[]);
    assert_eq!(code, 0, "{stderr}");
    ensure_two(&document, &stderr);
    let links: Vec<&Value> = document["sensors"].as_array().unwrap().iter().map(|s| &s["link"]).collect();
    assert_ne!(links[0], links[1]);
    // nothing but the source port tells them apart
    let folder = tempfile::tempdir().unwrap();
    let mut all = datagrams(std::path::Path::new(&capture));
    for datagram in &mut all {
        let stamp_us = u32::from_le_bytes(datagram.payload[1200..1204].try_into().unwrap());
        datagram.source.set_port(if is_first(stamp_us, &datagrams(std::path::Path::new(&capture))) {
            2368
        } else {
            2369
        });
    }
    let ports = write_capture(&folder.path().join("ports.pcap"), &all);
    let (code, document, stderr) = decode(ports.to_str().unwrap(), &[], &[]);
    assert_eq!(code, 0, "{stderr}");
    ensure_two(&document, &stderr);
}

/// Whether a stamp is of the sensor that sent first: the clock of the other is 400 s away.
fn is_first(stamp_us: u32, all: &[Datagram]) -> bool {
    let first_us = u32::from_le_bytes(all[0].payload[1200..1204].try_into().unwrap());
    first_us.abs_diff(stamp_us) < 100_000_000
}

/// Where the recording says nothing of the way, their clocks do.
pub fn two_sensors_on_one_way_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let all = datagrams(&shared("field/captures/two_vlp16_one_address.pcapng"));
    let capture = write_capture(&folder.path().join("mixed.pcap"), &all);
    let capture = capture.to_str().unwrap();
    let (code, document, stderr) = decode(capture, &[], &[]);
    assert!(
        code == 3 && stderr.contains("two sensors send as one") && stderr.contains("two clocks"),
        "{stderr}"
    );
    let sensors = document["sensors"].as_array().unwrap();
    assert_eq!(sensors.len(), 2);
    let packets = |sensor: &Value| sensor["counters"]["packets"].as_u64().unwrap();
    assert!(packets(&sensors[0]) <= 108 && packets(&sensors[1]) >= 92, "{stderr}");
    let (code, document) = inspect(&[capture]);
    assert!(code == 3 && document["losses"].to_string().contains("two sensors send as one"));
    // two clocks that agree: one sensor's packets come twice as often as it can send
    let one = datagrams(&shared("captures/velodyne/mrpt_vlp16_gps.pcap"));
    let data: Vec<Datagram> = one.into_iter().filter(|datagram| datagram.payload.len() == 1206).collect();
    let mut both = Vec::new();
    for datagram in &data {
        let mut other = datagram.clone();
        let stamp_us = u32::from_le_bytes(other.payload[1200..1204].try_into().unwrap()) + 500;
        other.payload[1200..1204].copy_from_slice(&stamp_us.to_le_bytes());
        other.host_time_ns += 500_000;
        for block in 0..12 {
            let azimuth = &mut other.payload[100 * block + 2..][..2];
            let turned = (u16::from_le_bytes([azimuth[0], azimuth[1]]) + 13_000) % 36_000;
            azimuth.copy_from_slice(&turned.to_le_bytes());
        }
        both.extend([datagram.clone(), other]);
    }
    let capture = write_capture(&folder.path().join("double.pcap"), &both);
    let (code, _, stderr) = decode(capture.to_str().unwrap(), &[], &[]);
    assert!(code == 3 && stderr.contains("twice the rate"), "{stderr}");
}

/// A capture of a bridge shows each packet twice.
pub fn packets_that_come_by_two_ways() {
    let folder = tempfile::tempdir().unwrap();
    let one = shared("captures/velodyne/mrpt_vlp16_gps.pcap");
    let mut writer = sensors::capture::PcapngWriter::new(Vec::new()).unwrap();
    let interfaces = ["eth0", "br0"].map(|name| writer.add_interface(name).unwrap());
    for datagram in datagrams(&one) {
        for interface in interfaces {
            writer.write(interface, &datagram.packet()).unwrap();
        }
    }
    let capture = folder.path().join("bridge.pcapng");
    std::fs::write(&capture, writer.close(&[]).unwrap()).unwrap();
    let (_, right, _) = decode(one.to_str().unwrap(), &[], &[]);
    let (code, document, stderr) = decode(capture.to_str().unwrap(), &[], &[]);
    assert_eq!(code, 0, "{stderr}");
    assert_eq!(document["sensors"].as_array().unwrap().len(), 1);
    assert_eq!(document["sensors"][0]["frames"], right["sensors"][0]["frames"]);
    assert_eq!(document["sensors"][0]["counters"]["duplicated"], 293);
}

pub fn one_odd_stamp_splits_no_revolution() {
    let capture = field("vlp16_one_stray_stamp.pcap");
    let (code, document, stderr) = decode(&capture, &[], &[]);
    assert_eq!(code, 0, "{stderr}");
    let sensor = &document["sensors"][0];
    assert_eq!(of_frames(sensor, "packets"), [77, 76, 7]);
    assert_eq!(of_frames(sensor, "points"), [18_790, 18_701, 2172]);
    ensure_nothing_is_missing(&document);
    assert_eq!(sensor["counters"]["odd_stamps"], 1);
    let first_ns = of_frames(sensor, "first_time_ns");
    let last_ns = of_frames(sensor, "last_time_ns");
    assert!(last_ns[0] - first_ns[0] < 110_000_000 && first_ns[1] - last_ns[0] < 1_000_000, "not 48 s ahead");
    assert!(stderr.contains("time stamp that contradicts"), "{stderr}");
}

pub fn snapshots_an_hour_apart_are_dated_right() {
    let (code, document, stderr) = decode(&field("vlp16_three_snapshots_an_hour_apart.pcap"), &[], &[]);
    assert_eq!(code, 0, "{stderr}");
    let begin_us: Vec<u64> =
        of_frames(&document["sensors"][0], "first_time_ns").iter().map(|time_ns| time_ns / 1000).collect();
    assert_eq!(begin_us, [1_699_999_200_100_000, 1_700_002_800_600_000, 1_700_006_401_300_000]);
    ensure_nothing_is_missing(&document);
    assert_eq!(document["sensors"][0]["counters"]["pauses"], 2);
    let (code, document) = inspect(&[&field("vlp16_three_snapshots_an_hour_apart.pcap")]);
    assert_eq!((code, &document["losses"]), (0, &json!([])));
    assert_eq!(document["sensors"][0]["clock"]["state"], "utc");
    // a day apart, and the last first
    let folder = tempfile::tempdir().unwrap();
    let all = datagrams(&shared("field/captures/vlp16_three_snapshots_an_hour_apart.pcap"));
    let day_ns = 23 * 3_600_000_000_000;
    let mut days = all.clone();
    days[60..].iter_mut().for_each(|datagram| datagram.host_time_ns += day_ns);
    let reversed: Vec<Datagram> = [&all[120..], &all[60..120], &all[..60]].concat();
    for (name, packets, expected_s) in [
        ("days", days, [1_699_999_200.1, 1_700_085_600.6, 1_700_089_201.3]),
        ("reversed", reversed, [1_700_006_401.3, 1_700_002_800.6, 1_699_999_200.1]),
    ] {
        let capture = write_capture(&folder.path().join("joined.pcap"), &packets);
        let (code, document, stderr) = decode(capture.to_str().unwrap(), &[], &[]);
        assert_eq!(code, 0, "{name}: {stderr}");
        ensure_nothing_is_missing(&document);
        let begin_ns = of_frames(&document["sensors"][0], "first_time_ns");
        assert_eq!(begin_ns.len(), 3, "{name}");
        for (begin_ns, expected_s) in begin_ns.iter().zip(expected_s) {
            assert!((*begin_ns as f64 * 1e-9 - expected_s).abs() < 1e-3, "{name}: {begin_ns} {expected_s}");
        }
    }
}

pub fn a_tail_of_zeros_is_no_record() {
    let capture = field("vlp16_zero_filled_tail.pcap");
    let (code, document, stderr) = decode(&capture, &[], &[]);
    assert_eq!(code, 3, "{stderr}");
    assert!(
        stderr
            .contains("at byte 75864 is empty, and from byte 75880 on nothing but zeros follows (4096 bytes"),
        "{stderr}"
    );
    assert_eq!(document["sensors"][0]["totals"]["points"], 17_066);
    let (code, document) = inspect(&[&capture]);
    assert_eq!(code, 3);
    assert_eq!(document["capture_counters"]["zero_tail"], json!({"offset": 75_864, "bytes": 4096}));
    assert_eq!(
        (&document["capture_counters"]["malformed"], &document["capture_counters"]["frames"]),
        (&json!(0), &json!(60))
    );
    // the same behind a pcapng; and zeros with something behind them are damage
    let folder = tempfile::tempdir().unwrap();
    let whole = datagrams(std::path::Path::new(&capture));
    let pcapng = write_capture(&folder.path().join("tail.pcapng"), &whole);
    let mut bytes = std::fs::read(&pcapng).unwrap();
    let end = bytes.len();
    bytes.resize(end + 5000, 0);
    std::fs::write(&pcapng, &bytes).unwrap();
    let (code, document, stderr) = decode(pcapng.to_str().unwrap(), &[], &[]);
    assert!(code == 3 && stderr.contains(&format!("at byte {end} is empty")), "{stderr}");
    assert_eq!(document["sensors"][0]["totals"]["points"], 17_066);
    let mut bytes = std::fs::read(&capture).unwrap();
    bytes.push(7);
    std::fs::write(&pcapng, &bytes).unwrap();
    let (code, _, stderr) = decode(pcapng.to_str().unwrap(), &[], &[]);
    assert!(code == 3 && stderr.contains("damaged at byte 75864: found 4096 zero bytes"), "{stderr}");
}

pub fn blank_factory_bytes_need_a_model() {
    let capture = field("hdl32e_blank_factory_bytes.pcap");
    let (code, _, stderr) = decode(&capture, &[], &[]);
    let words = ["factory bytes", "blank", "--model hdl-32e", "vlp-16"];
    assert!(code == 1 && words.iter().all(|words| stderr.contains(words)), "{stderr}");
    for model in ["hdl-32e", ":2368=HDL-32E"] {
        let (code, document, stderr) = decode(&capture, &[], &["--model", model]);
        assert_eq!(code, 0, "{stderr}");
        let sensor = &document["sensors"][0];
        assert_eq!(sensor["model"], "hdl-32e");
        assert_eq!(of_frames(sensor, "valid_columns").iter().sum::<u64>(), 1092);
        assert_eq!(sensor["totals"]["points"], 30_596);
    }
    // what the packets say themselves counts against it
    let vlp_16 = path("captures/velodyne/mrpt_vlp16_gps.pcap");
    let (code, _, stderr) = decode(&vlp_16, &[], &["--model", "vlp-32c"]);
    assert!(code == 1 && stderr.contains("vlp-32c") && stderr.contains("vlp-16"), "{stderr}");
    let (code, document, stderr) = decode(&vlp_16, &[], &["--model", "puck-lite"]);
    assert!(code == 0 && document["sensors"][0]["model"] == "puck-lite", "{stderr}");
    let (code, _, stderr) = decode(&vlp_16, &[], &["--model", "os1-64"]);
    assert!(code == 2 && stderr.contains("no Velodyne model"), "{stderr}");
}

pub fn position_packets_alone() {
    let capture = field("vlp16_one_position_packet.pcap");
    let (code, _, stderr) = decode(&capture, &[], &[]);
    let words = ["1 position packet from", "no data packets", "lasers are off", "filtered away"];
    assert!(code == 1 && words.iter().all(|words| stderr.contains(words)), "{stderr}");
    let (_, document) = inspect(&[&capture]);
    let advice = document["advice"].to_string();
    assert!(
        words.iter().all(|words| advice.contains(words)) && !advice.contains("fits no packet"),
        "{advice}"
    );
}

pub fn a_beam_that_never_returns_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let mut all = datagrams(&shared("captures/velodyne/mrpt_vlp16_gps.pcap"));
    for datagram in all.iter_mut().filter(|datagram| datagram.payload.len() == 1206) {
        for firing in 0..24 {
            // laser 5 is the eleventh from below
            let at = 100 * (firing / 2) + 4 + 3 * (16 * (firing % 2) + 5);
            datagram.payload[at..at + 2].fill(0);
        }
    }
    let capture = write_capture(&folder.path().join("dead.pcap"), &all);
    let (_, document) = inspect(&[capture.to_str().unwrap()]);
    assert_eq!(document["sensors"][0]["silent_beams"], json!([10]));
    let (_, document) = inspect(&[&path("captures/velodyne/mrpt_vlp16_gps.pcap")]);
    assert_eq!(document["sensors"][0]["silent_beams"], json!([]));
}

pub fn a_sensor_that_does_not_turn() {
    let folder = tempfile::tempdir().unwrap();
    let mut all = datagrams(&shared("captures/velodyne/mrpt_vlp16_gps.pcap"));
    for datagram in all.iter_mut().filter(|datagram| datagram.payload.len() == 1206) {
        for block in 0..12 {
            datagram.payload[100 * block + 2..][..2].copy_from_slice(&12_345_u16.to_le_bytes());
        }
    }
    let capture = write_capture(&folder.path().join("still.pcap"), &all);
    let (_, document, stderr) = decode(capture.to_str().unwrap(), &[], &[]);
    assert!(stderr.contains("does not turn: its azimuth stays at 123.45°"), "{stderr}");
    ensure_nothing_is_missing(&document);
    let (_, document) = inspect(&[capture.to_str().unwrap()]);
    assert!(document["notes"].to_string().contains("does not turn"), "{}", document["notes"]);
}
