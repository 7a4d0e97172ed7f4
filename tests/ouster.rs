//! Ouster: captures against the digests of ouster-sdk, byte-exact encoding, losses counted as they were made,
//! metadata of every age, several sensors on one port.

mod captures;
mod golden;
mod losses;
mod metadata_files;
mod shared_port;

use sensors::ouster::{ImuSample, Metadata, OusterDecoder, ZoneReport};
use sensors::{DecodeStats, Decoded, Decoder, Frame};

use crate::support::datagram::{Datagram, datagrams};
use crate::support::{Case, case, shared, with_shared};

pub const CASES: &[Case] = &[
    with_shared("captures_match_their_digests", captures::captures_match_their_digests),
    with_shared("encoding_gives_the_captured_bytes", golden::encoding_gives_the_captured_bytes),
    with_shared("imu_packets_are_in_si_units", golden::imu_packets_are_in_si_units),
    with_shared(
        "imu_and_zone_packets_come_back_to_the_byte",
        golden::imu_and_zone_packets_come_back_to_the_byte,
    ),
    with_shared("every_loss_is_counted_once", losses::every_loss_is_counted_once),
    with_shared("a_bad_line_never_splits_or_merges_frames", losses::a_bad_line_never_splits_or_merges_frames),
    with_shared("whole_frames_that_are_missing_are_lost", losses::whole_frames_that_are_missing_are_lost),
    with_shared("a_restarted_sensor_goes_on", losses::a_restarted_sensor_goes_on),
    case("the_frame_counter_wraps", losses::the_frame_counter_wraps),
    case("a_window_through_column_zero", losses::a_window_through_column_zero),
    with_shared("metadata_of_every_age_is_read", metadata_files::metadata_of_every_age_is_read),
    with_shared("malformed_metadata_is_named", metadata_files::malformed_metadata_is_named),
    case("synthetic_metadata_survives_its_file", metadata_files::synthetic_metadata_survives_its_file),
    with_shared("two_sensors_share_a_port", shared_port::two_sensors_share_a_port),
    with_shared("a_velodyne_look_alike_is_foreign", shared_port::a_velodyne_look_alike_is_foreign),
];

/// Everything a decoder made of a list of datagrams.
#[derive(Default)]
struct Decoding {
    frames: Vec<Frame>,
    imu: Vec<ImuSample>,
    zones: Vec<ZoneReport>,
    stats: DecodeStats,
}

fn metadata(path: &str) -> Metadata {
    let text = std::fs::read_to_string(shared(path)).unwrap();
    Metadata::parse(&text, path).unwrap()
}

fn decode<'a>(metadata: &Metadata, datagrams: impl IntoIterator<Item = &'a Datagram>) -> Decoding {
    let mut decoder = OusterDecoder::new(metadata.clone());
    let mut decoding = Decoding::default();
    let mut take = |decoded: Decoded<'_>| match decoded {
        Decoded::Frame(frame) => decoding.frames.push(frame.clone()),
        Decoded::Imu(sample) => decoding.imu.push(sample.clone()),
        Decoded::Zones(report) => decoding.zones.push(report.clone()),
        other => panic!("{other:?} from an Ouster"),
    };
    for datagram in datagrams {
        let _ = decoder.push(&datagram.packet(), &mut take); // refusals are counted, and the counters compared
    }
    decoder.finish(&mut take);
    decoding.stats = decoder.stats().clone();
    decoding
}
