//! `outrigger inspect` as a user meets it: what is in a recording, every kind of loss, and why nothing decodes.

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

use crate::support::datagram::{Datagram, datagrams, write_capture};
use crate::support::{Case, shared, with_shared};

pub const CASES: &[Case] = &[
    with_shared("every_loss_is_counted_by_its_kind", every_loss_is_counted_by_its_kind),
    with_shared(
        "a_recording_begins_in_the_middle_of_a_revolution",
        a_recording_begins_in_the_middle_of_a_revolution,
    ),
    with_shared(
        "of_metadata_of_one_unit_the_one_that_fits_counts",
        of_metadata_of_one_unit_the_one_that_fits_counts,
    ),
    with_shared("a_wrong_checksum_is_counted", a_wrong_checksum_is_counted),
    with_shared("a_restarted_sensor_is_noticed", a_restarted_sensor_is_noticed),
    with_shared("fragments_that_never_came_are_counted", fragments_that_never_came_are_counted),
    with_shared("streams_are_named_without_metadata", streams_are_named_without_metadata),
    with_shared("streams_are_those_of_the_metadata", streams_are_those_of_the_metadata),
    with_shared("metadata_of_another_sensor_is_named", metadata_of_another_sensor_is_named),
    with_shared("files_beside_are_proposed_once", files_beside_are_proposed_once),
    with_shared("metadata_of_another_mode_is_named", metadata_of_another_mode_is_named),
    with_shared("another_port_makes_no_difference", another_port_makes_no_difference),
    with_shared("clocks_are_told_apart", clocks_are_told_apart),
];

const OS1: &str = "captures/ouster/OS-1-128_v2.3.0_1024x10_lb_n3.pcap";
const OS1_META: &str = "captures/ouster/OS-1-128_v2.3.0_1024x10.json";

/// Exit code and document.
fn inspect(capture: &Path, metas: &[&Path]) -> (i32, Value) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_outrigger"));
    command.args(["inspect", "--json"]).arg(capture);
    for meta in metas {
        command.arg("--meta").arg(meta);
    }
    let output = command.output().unwrap();
    (output.status.code().unwrap(), crate::support::document(&output.stdout).unwrap())
}

fn lines(document: &Value, of: &str) -> String {
    document[of].as_array().unwrap().iter().map(|line| line.as_str().unwrap()).collect::<Vec<_>>().join("\n")
}

/// The lidar packets of the OS1 recording: 64 per frame, three frames.
fn lidar_packets() -> Vec<Datagram> {
    let mut all = datagrams(&shared(OS1));
    all.retain(|datagram| datagram.payload.len() > 1000);
    assert_eq!(all.len(), 192);
    all
}

fn written(all: &[Datagram]) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = write_capture(&folder.path().join("changed.pcapng"), all);
    (folder, path)
}

fn every_loss_is_counted_by_its_kind() {
    let original = lidar_packets();
    let mut all = original.clone();
    all[10].payload.truncate(4000);
    let mut foreign = original[0].clone();
    foreign.payload = b"not a lidar".to_vec();
    foreign.source.set_port(40_000);
    all.insert(150, foreign);
    all.insert(140, original[139].clone()); // twice
    all.swap(120, 121); // out of order
    let late = all.remove(80); // of the second frame, after the third has begun and gone on
    all.insert(185, late);
    all.drain(70..73); // lost
    let (_folder, path) = written(&all);
    let (code, document) = inspect(&path, &[&shared(OS1_META)]);
    let counters = &document["sensors"][0]["counters"];
    let count = |name: &str| counters[name].as_u64().unwrap();
    assert_eq!(code, 3);
    assert_eq!(
        ["malformed", "duplicated", "reordered", "late"].map(count),
        [1, 1, 1, 1],
        "{}",
        serde_json::to_string_pretty(counters).unwrap()
    );
    assert_eq!(count("lost_packets"), 3, "the damaged and the late one did come");
    assert_eq!((count("frames"), count("complete_frames")), (3, 1));
    assert_eq!(document["unclaimed"][0]["length"], 11);
    assert!(lines(&document, "losses").contains("3 packets never came"), "{document:#}");
}

/// The first revolution is nearly over when the recording begins: it says nothing about how fast the sensor turns, nor how
/// many points it sees.
fn a_recording_begins_in_the_middle_of_a_revolution() {
    let all = lidar_packets();
    let (_whole, path) = written(&all);
    let (_, whole) = inspect(&path, &[&shared(OS1_META)]);
    let (_cut, path) = written(&all[50..170]);
    let (_, cut) = inspect(&path, &[&shared(OS1_META)]);
    let of = |document: &Value, name: &str| document["sensors"][0][name].as_f64().unwrap();
    assert_eq!([of(&cut, "frames"), of(&cut, "complete_frames")], [3.0, 1.0]);
    assert!((of(&cut, "frame_rate_hz") - 10.0).abs() < 0.01, "{}", cut["sensors"][0]["frame_rate_hz"]);
    assert!(of(&cut, "points_per_frame") > 0.9 * of(&whole, "points_per_frame"));
}

/// Metadata of one unit as it was set at two times, in either order, and one file twice.
fn of_metadata_of_one_unit_the_one_that_fits_counts() {
    let capture = shared("captures/ouster/crc_test.pcap");
    let fits = shared("captures/ouster/crc_test.json");
    let folder = tempfile::tempdir().unwrap();
    let other = folder.path().join("other.json");
    let text = std::fs::read_to_string(&fits).unwrap();
    assert!(text.contains("RNG15_RFL8_NIR8"));
    std::fs::write(&other, text.replace("RNG15_RFL8_NIR8", "RNG19_RFL8_SIG16_NIR16")).unwrap();
    let (code, alone) = inspect(&capture, &[&fits]);
    assert_eq!(code, 0);
    for metas in [[&fits, &fits], [&fits, &other], [&other, &fits]] {
        let (_, document) = inspect(&capture, &[metas[0], metas[1]]);
        let frames: u64 = document["sensors"]
            .as_array()
            .unwrap()
            .iter()
            .map(|sensor| sensor["frames"].as_u64().unwrap())
            .sum();
        assert_eq!(frames, alone["sensors"][0]["frames"].as_u64().unwrap(), "{metas:?}: {document:#}");
    }
    let (_, document) = inspect(&capture, &[&other]);
    let advice = lines(&document, "advice");
    assert!(advice.contains("set differently") && advice.contains("crc_test.json lies next to"), "{advice}");
    assert_eq!(advice.matches("lies next to").count(), 1, "only what fits is proposed: {advice}");
    let mode = |text: &str| text.replace("512x10", "1024x10").replace("_frame\": 512", "_frame\": 1024");
    std::fs::write(&other, mode(&text)).unwrap();
    let both = Command::new(env!("CARGO_BIN_EXE_outrigger"))
        .args(["inspect".as_ref(), capture.as_os_str(), "--meta".as_ref(), fits.as_os_str()])
        .arg("--meta")
        .arg(&other)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&both.stderr);
    assert!(both.status.code() == Some(1) && said.contains("and they differ"), "{said}");
}

fn a_wrong_checksum_is_counted() {
    let mut all = datagrams(&shared("captures/ouster/crc_test.pcap"));
    let damaged = all.iter_mut().filter(|datagram| datagram.payload.len() > 1000).nth(20).unwrap();
    damaged.payload[3000] ^= 0x10;
    let (_folder, path) = written(&all);
    let (code, document) = inspect(&path, &[&shared("captures/ouster/crc_test.json")]);
    assert_eq!((code, &document["sensors"][0]["counters"]["crc_errors"]), (3, &1.into()));
    assert!(lines(&document, "losses").contains("1 packets fail their checksum"));
}

fn a_restarted_sensor_is_noticed() {
    let mut all = lidar_packets();
    for datagram in &mut all[100..] {
        datagram.payload[4] ^= 1; // the initialisation id of the header
    }
    let (_folder, path) = written(&all);
    let (code, document) = inspect(&path, &[&shared(OS1_META)]);
    let counters = &document["sensors"][0]["counters"];
    assert_eq!(counters["init_id_changes"], 1);
    // the restart ends its frame and begins another
    assert_eq!((&counters["frames"], &counters["complete_frames"]), (&4.into(), &2.into()), "{code}");
}

fn fragments_that_never_came_are_counted() {
    let name = |extension: &str| shared(&format!("captures/ouster/duplicate_id.{extension}"));
    let (code, document) = inspect(&name("pcap"), &[&name("json")]);
    assert_eq!((code, &document["fragments_incomplete"]), (3, &1.into()));
}

fn streams_are_named_without_metadata() {
    let folder = tempfile::tempdir().unwrap();
    let alone = folder.path().join("alone.pcap");
    std::fs::copy(shared(OS1), &alone).unwrap();
    let (code, document) = inspect(&alone, &[]);
    assert_eq!(code, 0);
    let flows = document["flows"].as_array().unwrap();
    let named: Vec<_> = flows.iter().map(|flow| flow["looks_like"].as_str().unwrap()).collect();
    assert!(
        named[0].contains("RNG15_RFL8_NIR8 x 128") && named[1].contains("IMU packet (LEGACY)"),
        "{named:?}"
    );
    assert_eq!(
        (&flows[0]["serial"], &flows[0]["columns_per_frame"]),
        (&122_201_000_998_u64.into(), &1024.into())
    );
    let advice = lines(&document, "advice");
    assert!(advice.contains("add --meta"), "{advice}");
}

/// A packet of 8448 bytes may be one of eight formats; the metadata know which.
fn streams_are_those_of_the_metadata() {
    let name = |extension: &str| shared(&format!("captures/ouster/OS-0-32-U1_v2.2.0_1024x10.{extension}"));
    let other = shared("captures/ouster/OS-0-128-U1_v2.3.0_1024x10.json");
    let (_, document) = inspect(&name("pcap"), &[&other, &name("json")]);
    let flow = |length: u64| {
        let flows = document["flows"].as_array().unwrap();
        flows.iter().find(|flow| flow["length"] == length).unwrap()
    };
    let lidar = flow(8448);
    assert_eq!(lidar["looks_like"], "Ouster lidar packet (RNG19_RFL8_SIG16_NIR16_DUAL x 32 pixels)");
    assert_eq!(lidar["sensors"], serde_json::json!([document["sensors"][1]["id"]]));
    assert!(lidar["metadata"][0].as_str().unwrap().ends_with("OS-0-32-U1_v2.2.0_1024x10.json"), "{lidar}");
    // nothing says whose the inertial packets are, but one of the two alone is there
    assert_eq!((&flow(48)["sensors"], &flow(48)["unassigned"]), (&lidar["sensors"], &0.into()));
    let (_, document) = inspect(&name("pcap"), &[&other]);
    let flow = &document["flows"][0];
    assert_eq!((&flow["sensors"], &flow["unassigned"]), (&serde_json::json!([]), &flow["packets"]));
}

fn metadata_of_another_sensor_is_named() {
    let (_, document) = inspect(&shared(OS1), &[&shared("captures/ouster/OS-0-32-U1_v2.2.0_1024x10.json")]);
    let advice = lines(&document, "advice");
    assert!(advice.contains("(992137000142): add that of 122201000998"), "{advice}");
}

/// Files beside a recording are proposed for what nobody took, and those that say the same once.
fn files_beside_are_proposed_once() {
    let folder = tempfile::tempdir().unwrap();
    let name = |name: &str| folder.path().join(name);
    let text = std::fs::read_to_string(shared(OS1_META)).unwrap();
    assert!(text.contains("7503"));
    std::fs::write(name("one.json"), &text).unwrap();
    std::fs::write(name("two.json"), text.replace("7503", "7505")).unwrap();
    let other = "captures/ouster/OS-0-128-U1_v2.3.0_1024x10";
    let mut all = datagrams(&shared(OS1));
    write_capture(&name("alone.pcapng"), &all);
    all.extend(datagrams(&shared(&format!("{other}.pcap"))));
    write_capture(&name("both.pcapng"), &all);
    let proposed = |capture: &str, metas: &[&Path]| {
        let (_, document) = inspect(&name(capture), metas);
        lines(&document, "advice").matches("lies next to").count()
    };
    assert_eq!(proposed("alone.pcapng", &[]), 0, "it is used");
    assert_eq!(proposed("alone.pcapng", &[&shared(&format!("{other}.json"))]), 1);
    assert_eq!(proposed("both.pcapng", &[&name("two.json")]), 0, "of this sensor there is one already");
}

fn metadata_of_another_mode_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let meta = folder.path().join("other.json");
    let text = std::fs::read_to_string(shared(OS1_META)).unwrap();
    std::fs::write(&meta, text.replace("RNG15_RFL8_NIR8", "RNG19_RFL8_SIG16_NIR16")).unwrap();
    let expected = "RNG19_RFL8_SIG16_NIR16 x 128 pixels, 16 columns per packet, 24832 bytes: the sensor was set differently";
    let (code, document) = inspect(&shared(OS1), &[&meta]);
    assert_eq!((code, &document["sensors"][0]["counters"]["malformed"]), (3, &192.into()));
    let advice = lines(&document, "advice");
    assert!(advice.contains(expected), "{advice}");
    let decode = Command::new(env!("CARGO_BIN_EXE_outrigger"))
        .args([Path::new("decode"), &shared(OS1), Path::new("--meta"), &meta])
        .output()
        .unwrap();
    assert_eq!(decode.status.code(), Some(1));
    let said = String::from_utf8(decode.stderr).unwrap();
    assert!(said.contains("no LiDAR data was decoded") && said.contains(expected), "{said}");
}

fn another_port_makes_no_difference() {
    let mut all = datagrams(&shared(OS1));
    for datagram in &mut all {
        datagram.destination.set_port(datagram.destination.port() + 1500);
    }
    let (_folder, path) = written(&all);
    let (code, document) = inspect(&path, &[&shared(OS1_META)]);
    let sensor = &document["sensors"][0];
    assert_eq!((code, &sensor["complete_frames"], &sensor["imu_samples"]), (0, &3.into(), &30.into()));
}

fn clocks_are_told_apart() {
    let (_, ouster) = inspect(&shared(OS1), &[&shared(OS1_META)]);
    assert_eq!(ouster["sensors"][0]["clock"]["state"], "since_power_on");
    let (_, velodyne) = inspect(&shared("captures/velodyne/mrpt_vlp16_gps.pcap"), &[]);
    let sensor = &velodyne["sensors"][0];
    assert_eq!((&sensor["clock"]["state"], &sensor["pulse"]), (&"utc".into(), &"locked".into()));
    // a sensor on PTP that nobody told of leap seconds
    let offset_ns = 37_000_000_000;
    let mut all = lidar_packets();
    let host_ns = 1_700_000_000_000_000_000;
    let first_ns = u64::from_le_bytes(all[0].payload[32..40].try_into().unwrap());
    for datagram in &mut all {
        for column in 0..16 {
            let at = 32 + column * (12 + 128 * 4);
            let stamp = &mut datagram.payload[at..at + 8];
            let since_ns = u64::from_le_bytes(stamp.try_into().unwrap()) - first_ns;
            datagram.host_time_ns = host_ns + since_ns;
            stamp.copy_from_slice(&(host_ns + offset_ns + since_ns).to_le_bytes());
        }
    }
    let (_folder, path) = written(&all);
    let (code, document) = inspect(&path, &[&shared(OS1_META)]);
    assert_eq!((code, &document["sensors"][0]["clock"]["state"]), (0, &"tai".into()), "{document:#}");
}
