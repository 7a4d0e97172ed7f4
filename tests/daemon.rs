//! The daemon as its users meet it: the program, its requests, and everything that goes wrong around it.

#[path = "daemon/crowd.rs"]
mod crowd;
#[path = "daemon/crowds.rs"]
mod crowds;
#[path = "daemon/endurance.rs"]
mod endurance;
#[path = "daemon/faults.rs"]
mod faults;
#[path = "daemon/foxglove.rs"]
mod foxglove;
#[path = "daemon/program.rs"]
mod program;
#[path = "daemon/reconfiguration.rs"]
mod reconfiguration;
#[path = "daemon/rig.rs"]
mod rig;
#[path = "daemon/security.rs"]
mod security;
#[path = "daemon/sensor.rs"]
mod sensor;
#[path = "daemon/storage.rs"]
mod storage;
#[path = "daemon/walk.rs"]
mod walk;

use crate::support::{Case, case, with_machine};

pub const CASES: &[Case] = &[
    case("two_sensors_and_a_rig_are_recorded_and_shown", walk::two_sensors_and_a_rig_are_recorded_and_shown),
    case(
        "a_recording_is_cut_into_sessions_without_a_gap",
        walk::a_recording_is_cut_into_sessions_without_a_gap,
    ),
    case("the_service_manager_is_notified_of_the_end", walk::the_service_manager_is_notified_of_the_end),
    case("a_sensor_is_unplugged_and_comes_back", faults::a_sensor_is_unplugged_and_comes_back),
    case("a_sensor_starts_again", faults::a_sensor_starts_again),
    case("a_sensor_comes_back_in_another_mode", faults::a_sensor_comes_back_in_another_mode),
    case("a_clock_jumps", faults::a_clock_jumps),
    case("metadata_of_another_sensor", faults::metadata_of_another_sensor),
    case(
        "packets_of_other_sensors_and_a_storm_of_garbage",
        faults::packets_of_other_sensors_and_a_storm_of_garbage,
    ),
    case("a_second_daemon_says_why_it_cannot_start", faults::a_second_daemon_says_why_it_cannot_start),
    case("a_killed_daemon_leaves_a_session_that_opens", storage::a_killed_daemon_leaves_a_session_that_opens),
    case("a_stop_signal_sent_twice_closes_the_session", storage::a_stop_signal_sent_twice_closes_the_session),
    case(
        "a_session_that_is_removed_goes_on_in_another",
        storage::a_session_that_is_removed_goes_on_in_another,
    ),
    case("a_slow_disk_is_named_and_its_losses_counted", storage::a_slow_disk_is_named_and_its_losses_counted),
    case(
        "a_flood_fills_memory_to_its_bound_and_no_further",
        storage::a_flood_fills_memory_to_its_bound_and_no_further,
    ),
    with_machine(
        "a_disk_that_fills_up_ends_the_recording_in_order",
        "no small file system can be mounted here (unshare, mount)",
        storage::can_mount,
        storage::a_disk_that_fills_up_ends_the_recording_in_order,
    ),
    with_machine(
        "a_full_disk_keeps_what_was_recorded",
        "no small file system can be mounted here (unshare, mount)",
        storage::can_mount,
        storage::a_full_disk_keeps_what_was_recorded,
    ),
    case("the_rig_moves_when_armed_and_stops_on_command", rig::the_rig_moves_when_armed_and_stops_on_command),
    case(
        "better_pitches_are_proposed_and_driven_to_when_agreed",
        reconfiguration::better_pitches_are_proposed_and_driven_to_when_agreed,
    ),
    case("points_without_a_pose_are_named", reconfiguration::points_without_a_pose_are_named),
    case("axes_turn_the_sensors_that_are_named_for_them", rig::axes_turn_the_sensors_that_are_named_for_them),
    case("a_sensor_without_a_slot_is_reported", rig::a_sensor_without_a_slot_is_reported),
    case("a_rig_that_is_not_homed_is_recorded_as_such", rig::a_rig_that_is_not_homed_is_recorded_as_such),
    case("the_rig_is_unplugged_and_comes_back", rig::the_rig_is_unplugged_and_comes_back),
    case("foxglove_sees_points_cells_frames_and_axes", foxglove::foxglove_sees_points_cells_frames_and_axes),
    case("wrong_foxglove_requests_get_an_error", foxglove::wrong_foxglove_requests_get_an_error),
    case("unknown_hosts_and_origins_are_refused", security::unknown_hosts_and_origins_are_refused),
    case("a_token_opens_the_daemon_to_others", security::a_token_opens_the_daemon_to_others),
    case("nonsense_does_no_harm", security::nonsense_does_no_harm),
    case("a_stop_comes_through_a_crowd_of_one_address", crowds::a_stop_comes_through_a_crowd_of_one_address),
    case(
        "a_stop_comes_through_crowds_of_four_addresses",
        crowds::a_stop_comes_through_crowds_of_four_addresses,
    ),
    case("a_body_is_short_and_comes_in_time", crowds::a_body_is_short_and_comes_in_time),
    case("a_log_without_a_reader_holds_up_nothing", endurance::a_log_without_a_reader_holds_up_nothing),
    case("a_stdout_without_a_reader_holds_up_nothing", endurance::a_stdout_without_a_reader_holds_up_nothing),
    case(
        "a_part_that_is_needed_ends_the_daemon_in_order",
        endurance::a_part_that_is_needed_ends_the_daemon_in_order,
    ),
    case("a_part_that_is_not_needed_is_reported_dead", endurance::a_part_that_is_not_needed_is_reported_dead),
];
