//! Receive, record, reopen: nothing lost in silence.

#[path = "session/crash.rs"]
mod crash;
#[path = "session/doubted.rs"]
mod doubted;
#[path = "session/limits.rs"]
mod limits;
#[path = "session/program.rs"]
mod program;
#[path = "session/receive.rs"]
mod receive;
#[path = "session/round_trip.rs"]
mod round_trip;
#[path = "session/taken_away.rs"]
mod taken_away;

use std::net::{SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

use crate::support::{Case, case, with_machine};

pub const CASES: &[Case] = &[
    case("every_byte_sent_is_in_the_session", round_trip::every_byte_sent_is_in_the_session),
    case("servo_reports_and_events_come_back", round_trip::servo_reports_and_events_come_back),
    case("a_session_needs_a_folder_of_its_own", round_trip::a_session_needs_a_folder_of_its_own),
    case("a_changed_file_is_named", round_trip::a_changed_file_is_named),
    case("long_and_empty_datagrams_are_whole", receive::long_and_empty_datagrams_are_whole),
    case("what_the_kernel_drops_is_counted", receive::what_the_kernel_drops_is_counted),
    case("what_the_queue_drops_is_counted", receive::what_the_queue_drops_is_counted),
    case("what_waits_is_bounded_in_bytes", receive::what_waits_is_bounded_in_bytes),
    case(
        "sensors_on_one_port_are_distinguished_by_source",
        receive::sensors_on_one_port_are_distinguished_by_source,
    ),
    case("sockets_that_cannot_be_had_are_named", receive::sockets_that_cannot_be_had_are_named),
    case("a_recording_cut_at_any_byte_opens", crash::a_recording_cut_at_any_byte_opens),
    case(
        "a_killed_recorder_leaves_a_session_that_opens",
        crash::a_killed_recorder_leaves_a_session_that_opens,
    ),
    with_machine(
        "a_full_disk_ends_the_session_in_order",
        "no small file system can be mounted here (unshare, mount)",
        crash::can_mount,
        crash::a_full_disk_ends_the_session_in_order,
    ),
    case(
        "a_folder_moved_while_recording_is_closed_there_and_recording_goes_on",
        taken_away::a_folder_moved_while_recording_is_closed_there_and_recording_goes_on,
    ),
    case(
        "a_folder_deleted_while_recording_is_counted_and_recording_goes_on",
        taken_away::a_folder_deleted_while_recording_is_counted_and_recording_goes_on,
    ),
    case(
        "a_link_in_place_of_the_folder_is_not_followed",
        taken_away::a_link_in_place_of_the_folder_is_not_followed,
    ),
    case(
        "a_file_removed_from_a_session_is_named_and_its_packets_counted",
        taken_away::a_file_removed_from_a_session_is_named_and_its_packets_counted,
    ),
    case("what_is_left_of_a_cut_file_is_counted", taken_away::what_is_left_of_a_cut_file_is_counted),
    with_machine(
        "an_unmounted_disk_is_closed_through_what_is_open",
        "no small file system can be mounted here (unshare, mount)",
        crash::can_mount,
        taken_away::an_unmounted_disk_is_closed_through_what_is_open,
    ),
    case(
        "a_file_that_may_not_grow_ends_the_session_in_order",
        limits::a_file_that_may_not_grow_ends_the_session_in_order,
    ),
    case(
        "what_cannot_be_written_is_an_error_of_every_verb",
        limits::what_cannot_be_written_is_an_error_of_every_verb,
    ),
    case(
        "a_sensor_that_was_silent_all_along_is_named_when_read",
        doubted::a_sensor_that_was_silent_all_along_is_named_when_read,
    ),
    case(
        "counters_that_contradict_the_packets_are_named_with_both_values",
        doubted::counters_that_contradict_the_packets_are_named_with_both_values,
    ),
    case("files_that_no_digest_covers_are_named", doubted::files_that_no_digest_covers_are_named),
    case("a_manifest_leads_nowhere_out_of_its_folder", doubted::a_manifest_leads_nowhere_out_of_its_folder),
    case(
        "what_is_no_file_in_a_session_is_named_and_not_waited_for",
        doubted::what_is_no_file_in_a_session_is_named_and_not_waited_for,
    ),
    case("a_pipe_without_a_writer_is_refused_at_once", doubted::a_pipe_without_a_writer_is_refused_at_once),
    case("buffers_of_a_gltf_lie_beside_it", doubted::buffers_of_a_gltf_lie_beside_it),
    case("too_few_files_are_an_error_and_no_panic", limits::too_few_files_are_an_error_and_no_panic),
    case(
        "ctrl_c_completes_the_session_and_replay_repeats_it",
        program::ctrl_c_completes_the_session_and_replay_repeats_it,
    ),
    case(
        "a_mock_sensor_ends_in_order_when_interrupted",
        program::a_mock_sensor_ends_in_order_when_interrupted,
    ),
    case("replay_says_what_it_does_not_send", program::replay_says_what_it_does_not_send),
    case("a_looped_replay_ends_with_its_count", program::a_looped_replay_ends_with_its_count),
    case("sensors_are_called_as_they_were_recorded", program::sensors_are_called_as_they_were_recorded),
    case("a_silent_sensor_is_named", program::a_silent_sensor_is_named),
    case("two_mock_sensors_are_recorded_and_decoded", program::two_mock_sensors_are_recorded_and_decoded),
    case("what_record_keeps_is_enough_to_compare", program::what_record_keeps_is_enough_to_compare),
    with_machine(
        "tshark_reads_a_session",
        "tshark is not installed",
        program::has_tshark,
        program::tshark_reads_a_session,
    ),
];

/// Waits for something another thread or process is about to do.
fn wait_until(what: &str, mut done: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !done() {
        assert!(begun.elapsed() < Duration::from_secs(30), "waited in vain until {what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

fn any_port() -> SocketAddr {
    "127.0.0.1:0".parse().unwrap()
}

fn sender() -> UdpSocket {
    UdpSocket::bind(any_port()).unwrap()
}

/// Payloads of sensor-like lengths, each different.
fn payloads(count: usize, seed: u64) -> Vec<Vec<u8>> {
    let mut rng = outrigger::base::rng::Rng::new(seed, 0);
    (0..count)
        .map(|number| {
            let length = [1206, 8448, 12_608, 24_896, 48, 512][rng.below(6) as usize];
            let mut payload = vec![rng.bits() as u8; length];
            payload[..8].copy_from_slice(&(number as u64).to_le_bytes());
            payload
        })
        .collect()
}
