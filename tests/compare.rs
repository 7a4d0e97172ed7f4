//! `outrigger compare` on simulated recordings through real packets, as a process, and on real captures.

mod align;
mod alone;
mod clock;
mod recordings;
mod rig_faults;
mod stand;
mod statistics;
mod verdicts;
mod units;

use glam::DVec3;
use outrigger::base::rng::Rng;
use outrigger::rig::{Mount, MountedSensor};
use outrigger::verify::calibrate;
use outrigger::verify::compare::RecordedRay;
use outrigger::world::scene::{BoxScene, Scene};
use outrigger::world::trajectory::Trajectory;
use sensors::catalogue;

use crate::support::{Case, case, with_machine, with_shared};

/// What the long statistics wait for.
const ASKED: &str = "statistics of minutes: set OUTRIGGER_STATISTICS=1 (and OUTRIGGER_SHARED)";

pub const CASES: &[Case] = &[
    case("a_faithful_recording_matches", rig_faults::a_faithful_recording_matches),
    case("another_place_says_nothing_about_the_mounts", another_place_says_nothing_about_the_mounts),
    case(
        "a_scene_of_another_size_says_nothing_about_the_mounts",
        a_scene_of_another_size_says_nothing_about_the_mounts,
    ),
    case("a_room_of_another_size_is_told_as_such", rig_faults::a_room_of_another_size_is_told_as_such),
    case("a_match_says_what_it_cannot_tell", rig_faults::a_match_says_what_it_cannot_tell),
    case("a_tilted_sensor_is_found_and_corrected", rig_faults::a_tilted_sensor_is_found_and_corrected),
    case("a_rolled_or_shifted_sensor_is_named", rig_faults::a_rolled_or_shifted_sensor_is_named),
    case("errors_only_lower_coverage", rig_faults::errors_only_lower_coverage),
    case("each_fault_has_its_name", rig_faults::each_fault_has_its_name),
    case("a_mesh_in_millimetres_is_named", rig_faults::a_mesh_in_millimetres_is_named),
    case("what_is_wrong_with_the_input_is_said", rig_faults::what_is_wrong_with_the_input_is_said),
    case("a_walk_is_found_by_odometry", rig_faults::a_walk_is_found_by_odometry),
    case("sensors_are_held_against_each_other", rig_faults::sensors_are_held_against_each_other),
    case(
        "a_walk_is_compared_without_a_trajectory_in_the_scene_s_frame",
        align::a_walk_is_compared_without_a_trajectory_in_the_scene_s_frame,
    ),
    case("odometry_is_written_in_the_scene_s_frame", align::odometry_is_written_in_the_scene_s_frame),
    with_machine(
        "walks_are_placed_in_the_house",
        ASKED,
        statistics::are_wanted,
        align::walks_are_placed_in_the_house,
    ),
    with_machine(
        "walks_are_placed_in_the_bookstore",
        ASKED,
        statistics::are_wanted,
        align::walks_are_placed_in_the_bookstore,
    ),
    with_machine(
        "walks_are_placed_in_the_warehouse",
        ASKED,
        statistics::are_wanted,
        align::walks_are_placed_in_the_warehouse,
    ),
    with_machine(
        "walks_are_placed_in_the_office_floor",
        ASKED,
        statistics::are_wanted,
        align::walks_are_placed_in_the_office_floor,
    ),
    with_machine(
        "walks_in_another_building_are_refused",
        ASKED,
        statistics::are_wanted,
        align::walks_in_another_building_are_refused,
    ),
    with_machine(
        "a_recording_alone_says_what_its_true_trajectory_says",
        ASKED,
        statistics::are_wanted,
        alone::a_recording_alone_says_what_its_true_trajectory_says,
    ),
    case("a_servo_s_scale_and_play_are_found", stand::a_servo_s_scale_and_play_are_found),
    case("an_axis_that_is_not_homed_measures_nothing", stand::an_axis_that_is_not_homed_measures_nothing),
    case("an_honest_servo_does_as_it_measures", stand::an_honest_servo_does_as_it_measures),
    case(
        "the_zero_that_is_offered_is_the_one_that_fits",
        stand::the_zero_that_is_offered_is_the_one_that_fits,
    ),
    case("a_calibration_counts_wherever_it_is_named", units::a_calibration_counts_wherever_it_is_named),
    case("a_second_unit_under_one_name_is_told_of", units::a_second_unit_under_one_name_is_told_of),
    case("one_way_needs_one_clock", units::one_way_needs_one_clock),
    case("another_sensor_than_the_mount_says_is_named", units::another_sensor_than_the_mount_says_is_named),
    case("an_axis_counts_as_it_was_at_each_packet", clock::an_axis_counts_as_it_was_at_each_packet),
    case(
        "a_step_of_the_host_s_clock_is_undone_and_named",
        clock::a_step_of_the_host_s_clock_is_undone_and_named,
    ),
    case("a_step_in_an_old_session_is_inferred", clock::a_step_in_an_old_session_is_inferred),
    case("months_between_two_packets_take_no_memory", clock::months_between_two_packets_take_no_memory),
    case("clocks_apart_are_put_together", rig_faults::clocks_apart_are_put_together),
    case("degenerate_scenes_say_what_they_cannot_tell", degenerate_scenes_say_what_they_cannot_tell),
    case("a_range_bias_is_no_tilt", a_range_bias_is_no_tilt),
    with_machine(
        "healthy_walks_are_seldom_called_different",
        ASKED,
        statistics::are_wanted,
        verdicts::healthy_walks_are_seldom_called_different,
    ),
    with_machine("faults_are_found", ASKED, statistics::are_wanted, verdicts::faults_are_found),
    with_machine(
        "healthy_walks_raise_few_alarms",
        ASKED,
        statistics::are_wanted,
        statistics::healthy_walks_raise_few_alarms,
    ),
    with_machine(
        "known_tilts_are_recovered",
        ASKED,
        statistics::are_wanted,
        statistics::known_tilts_are_recovered,
    ),
    with_machine(
        "relative_tilts_need_no_scene",
        ASKED,
        statistics::are_wanted,
        statistics::relative_tilts_need_no_scene,
    ),
    with_machine(
        "errors_take_from_coverage_what_the_table_says",
        ASKED,
        statistics::are_wanted,
        statistics::errors_take_from_coverage_what_the_table_says,
    ),
    with_shared(
        "a_session_of_an_hdl_64e_has_its_beams_from_the_first_frame_on",
        units::a_session_of_an_hdl_64e_has_its_beams_from_the_first_frame_on,
    ),
    with_shared("two_frames_of_a_vehicle_predict_the_third", recordings::two_frames_predict_the_third),
    with_shared(
        "an_ouster_without_a_product_is_known_by_its_beams",
        recordings::an_ouster_without_a_product_is_known_by_its_beams,
    ),
    with_shared("odometry_agrees_with_the_poses_of_a_vehicle", recordings::odometry_agrees_with_the_poses),
    with_shared(
        "a_still_velodyne_agrees_with_its_own_map",
        recordings::a_still_velodyne_agrees_with_its_own_map,
    ),
];

/// Two level-headed sensors, tilted outward.
fn pair(model: &str) -> Vec<MountedSensor> {
    let model = catalogue::nominal(model).unwrap();
    let mounted = |name: &str, side: f64| MountedSensor {
        name: name.into(),
        model: model.clone(),
        mount: Mount { x_m: 0.12 * side, z_m: 0.1, pitch_rad: 0.44 * side, ..Mount::default() },
    };
    vec![mounted("right", 1.0), mounted("left", -1.0)]
}

/// An even share of the rays of some revolutions, measured from the true mounts.
fn measured(
    scene: &Scene,
    walk: &Trajectory,
    said: &[MountedSensor],
    truth: &[Mount],
    bias_m: f64,
) -> Vec<RecordedRay> {
    let [start_ns, end_ns] = walk.time_span_ns();
    let mut rays = Vec::new();
    let mut rng = Rng::new(7, 0);
    for time_ns in (start_ns..end_ns).step_by(400_000) {
        for (sensor, mounted) in said.iter().enumerate() {
            let channel = rng.below(mounted.model.channels() as u64) as usize;
            let azimuth_rad = rng.between(0.0, std::f64::consts::TAU);
            let pitch_rad = mounted.mount.pitch_rad;
            let mut ray = RecordedRay { sensor, channel, time_ns, azimuth_rad, pitch_rad, range_m: None };
            let world_from_sensor = walk.at(time_ns).unwrap() * truth[sensor].body_from_sensor();
            let met = ray.place(said, &world_from_sensor).cast(scene, mounted);
            ray.range_m = met.map(|(range_m, _)| range_m + bias_m + 0.01 * rng.normal());
            rays.push(ray);
        }
    }
    rays
}

fn check(scene: &BoxScene, model: &str, tilt_deg: f64, bias_m: f64) -> calibrate::MountCheck {
    check_against(scene, scene, model, tilt_deg, bias_m)
}

/// Recorded in one scene, held against another.
fn check_against(
    recorded: &BoxScene,
    scene: &BoxScene,
    model: &str,
    tilt_deg: f64,
    bias_m: f64,
) -> calibrate::MountCheck {
    let [recorded, scene] = [recorded, scene].map(|scene| Scene::Box(scene.clone()));
    let walk = Trajectory::straight(DVec3::new(-1.5, 0.3, 1.4), DVec3::new(1.7, 0.1, 1.4), 0.8, 0);
    let said = pair(model);
    let mut truth: Vec<Mount> = said.iter().map(|sensor| sensor.mount).collect();
    truth[0].pitch_rad += tilt_deg.to_radians();
    let rays = measured(&recorded, &walk, &said, &truth, bias_m);
    let field = calibrate::Field { scene: &scene, trajectory: &walk, sensors: &said, rays: &rays };
    calibrate::check(&field, &calibrate::Settings::default())
}

/// In a room that is a metre larger all round, ranges that are a metre too short fit, and with them some mount.
fn a_scene_of_another_size_says_nothing_about_the_mounts() {
    let BoxScene { min_m, max_m, .. } = room();
    let larger = BoxScene::closed(min_m - DVec3::ONE, max_m + DVec3::ONE);
    let found = check_against(&room(), &larger, "os1-64", 0.0, 0.0);
    for (sensor, said) in found.mount.iter().zip(pair("os1-64")) {
        assert!(sensor.is_of_another_scene && sensor.cannot_tell.is_some(), "{sensor:?}");
        assert!(sensor.tilt_error_deg.is_none() && sensor.range_offset_mm.is_none(), "{sensor:?}");
        assert_eq!(sensor.corrected, said.mount);
    }
    assert!(found.relative_tilt.is_none());
}

/// A recording of another place fits some mount as well as any; nothing is made of that.
fn another_place_says_nothing_about_the_mounts() {
    // only its floor is where the room's is
    let elsewhere = BoxScene::closed(DVec3::new(-20.0, -20.0, 0.0), DVec3::new(20.0, 20.0, 10.0));
    let found = check_against(&room(), &elsewhere, "os1-64", 0.0, 0.0);
    for (sensor, said) in found.mount.iter().zip(pair("os1-64")) {
        let words = sensor.cannot_tell.clone().unwrap_or_default();
        assert!(words.contains("another place"), "{sensor:?}");
        assert!(sensor.tilt_error_deg.is_none() && sensor.translation_mm.iter().all(Option::is_none));
        assert_eq!(sensor.corrected, said.mount);
    }
    assert!(found.relative_tilt.is_none());
}

fn room() -> BoxScene {
    BoxScene::closed(DVec3::new(-4.0, -3.0, 0.0), DVec3::new(5.0, 3.5, 3.0))
}

/// What planes leave open, from an independent analysis: the floor alone shifts along it and yaw; a corridor the shift
/// along it.
fn degenerate_scenes_say_what_they_cannot_tell() {
    let [large_low, large_high] = [DVec3::new(-300.0, -300.0, 0.0), DVec3::new(300.0, 300.0, 60.0)];
    let mut nothing = BoxScene::closed(large_low, large_high);
    nothing.faces = [[false; 2]; 3];
    let mut floor = nothing.clone();
    floor.faces[2][0] = true;
    let mut corridor = BoxScene::closed(DVec3::new(-300.0, -1.5, 0.0), DVec3::new(300.0, 1.5, 3.0));
    corridor.faces[0] = [false; 2];
    for (what, scene, told, condition) in [
        ("open field", &nothing, "", false),
        ("floor only", &floor, "z roll tilt range", false),
        ("corridor", &corridor, "x z roll tilt yaw range", false),
        ("room", &room(), "x y z roll tilt yaw range", true),
    ] {
        let found = check(scene, "os1-64", 0.0, 0.0);
        for sensor in &found.mount {
            assert_eq!(sensor.observable.join(" "), told, "{what}: {sensor:?}");
            assert_eq!(sensor.condition_number.is_some(), condition, "{what}: {sensor:?}");
            assert_eq!(sensor.tilt_error_deg.is_some(), told.contains("tilt"), "{what}: {sensor:?}");
            assert_eq!(sensor.cannot_tell.is_none(), told.contains("tilt"), "{what}: {sensor:?}");
        }
    }
}

fn a_range_bias_is_no_tilt() {
    let plain = check(&room(), "vlp-16", 0.5, 0.0);
    let biased = check(&room(), "vlp-16", 0.5, 0.03);
    for (found, bias_mm) in [(&plain, 0.0), (&biased, 30.0)] {
        assert!(found.converged, "{found:?}");
        let relative = found.relative_tilt.as_ref().unwrap();
        assert!((relative.error_deg - 0.5).abs() < 0.02, "{relative:?}");
        for sensor in &found.mount {
            let offset = sensor.range_offset_mm.unwrap();
            assert!((offset.value - bias_mm).abs() < 2.0, "{offset:?}");
        }
    }
}
