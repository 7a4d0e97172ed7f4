//! What is wrong with a sensor.

use super::List;
use crate::daemon::status::{SensorState, SensorStatus};
use crate::live::clocks::ClockState;

/// All that is wrong with a sensor.
pub(super) fn problems(sensor: &SensorStatus, list: &mut List) {
    let name = sensor.name.as_str();
    let port = sensor.address.map_or(0, |address| address.port());
    match sensor.state {
        SensorState::Ok => {}
        SensorState::Waiting => list.error(
            name,
            "no_packets",
            format!("Nothing has come from {name} yet (port {port})."),
            "Is it powered, is the cable in, and does it send to this computer (udp_dest or host address)?",
        ),
        SensorState::Silent => {
            let age_s = sensor.last_packet_age_s.unwrap_or(0.0);
            list.error(
                name,
                "silent",
                format!("{name} has sent nothing for {age_s:.0} s."),
                "Check its power and its cable. What it sends is recorded again as soon as it comes back.",
            );
        }
        SensorState::NotDecoded => {
            let unassigned = sensor.unclaimed.first();
            let reason = unassigned.map(|entry| entry.reason.clone()).or_else(|| sensor.first_damage.clone());
            let is_metadata = unassigned.is_some_and(|entry| entry.needs_metadata);
            let kind = if is_metadata { "wrong_metadata" } else { "not_decoded" };
            let reason = reason.unwrap_or_else(|| "they are no packets of a known format".into());
            let advice = if is_metadata {
                "The packets are recorded all the same. Save http://SENSOR/api/v1/sensor/metadata as the file that \
                 rig.toml names, and start again."
            } else {
                "The packets are recorded all the same. Does another device send to this port?"
            };
            list.error(name, kind, format!("Packets of {name} come but cannot be read: {reason}."), advice);
        }
    }
    of_losses(sensor, list);
    if sensor.recent_restarts > 0 {
        list.warn(
            name,
            "restarted",
            format!("{name} started again a moment ago."),
            "If you did not restart it, look at its power supply. Recording goes on.",
        );
    }
    if sensor.is_other_model {
        list.warn(
            name,
            "other_model",
            format!("{name} is a {}, but rig.toml says {}.", sensor.product, sensor.model),
            "Correct the model in rig.toml, or the cables: predictions are made for the model that is named.",
        );
    }
    if let Some(why) = &sensor.unseated {
        list.warn(
            name,
            "unseated",
            format!("What {name} sees is drawn as if it sat at the platform's origin: {why}."),
            "Give it one name in rig.toml and in the mount file; a session without cannot be compared.",
        );
    }
    if let Some(clock) = &sensor.clock {
        if sensor.recent_clock_jumps > 0 && clock.replays > 0 {
            list.warn(
                name,
                "replay",
                format!("{name} is a replay: its recording began again."),
                "Nothing is wrong with a clock. What is recorded over the seam cannot be compared.",
            );
        } else if sensor.recent_clock_jumps > 0 && sensor.recent_restarts == 0 {
            let jump_s = clock.jumps.last().map_or(0.0, |jump| jump.change_s);
            list.warn(
                name,
                "clock_jump",
                format!("The clock of {name} jumped by {:.3} s against this computer's.", -jump_s),
                "Its time source came or went. Times before and after do not fit together.",
            );
        }
        if matches!(clock.state, ClockState::SincePowerOn | ClockState::Unsynchronised) {
            list.warn(
                name,
                "clock_not_locked",
                format!("The clock of {name} {}.", clock.text()),
                "Give it PTP, or GPS with a pulse per second; until then only arrival times relate it to the others.",
            );
        }
    }
    if sensor.gps_valid == Some(false) {
        list.warn(
            name,
            "gps_invalid",
            format!("The GPS receiver of {name} has no fix."),
            "Its time is not locked before it sees satellites.",
        );
    }
    for warning in &sensor.warnings {
        list.error(
            name,
            "sensor_warning",
            format!("{name} {warning}."),
            "Give it air and shade, or switch it off for a while.",
        );
    }
    if let Some(warning) = &sensor.buffer_warning {
        list.warn(name, "small_buffer", format!("{warning}."), "Bursts may be lost until that is done.");
    }
}

fn of_losses(sensor: &SensorStatus, list: &mut List) {
    let (name, recent) = (sensor.name.as_str(), &sensor.recent_losses);
    for (count, kind, what, advice) in [
        (
            recent.kernel_dropped,
            "kernel_drops",
            "packets were dropped by the kernel: this computer is too busy to take them",
            "End other programs, or raise net.core.rmem_max and --receive-buffer.",
        ),
        (
            recent.queue_dropped,
            "queue_drops",
            "packets were dropped because the disk did not keep up",
            "Record to a faster disk.",
        ),
        (
            recent.in_network,
            "lost_on_the_way",
            "packets were lost between the sensor and this computer",
            "Look at cable, switch and network card; a link of 100 Mbit/s is too slow for most sensors.",
        ),
        (
            recent.malformed + recent.crc_errors,
            "damaged",
            "packets came damaged",
            "Look at the cable, and whether the metadata in rig.toml is of the present settings.",
        ),
    ] {
        if count > 0 {
            list.error(name, kind, format!("{name}: {count} {what}."), advice);
        }
    }
    if recent.foreign_source > 0 {
        let from = recent.first_foreign_source.map_or("elsewhere".into(), |source| source.to_string());
        list.warn(
            name,
            "foreign_source",
            format!(
                "{name}: {} packets came from another sender ({from}) and were left out.",
                recent.foreign_source
            ),
            "Find out who sends to this port, or correct `source` in rig.toml.",
        );
    }
    if recent.not_its_own > 0 && sensor.state == SensorState::Ok {
        let reason = sensor.unclaimed.first().map_or("of another kind", |entry| entry.reason.as_str());
        list.warn(
            name,
            "foreign_packets",
            format!("{} packets on the port of {name} are not its own: {reason}.", recent.not_its_own),
            "They are recorded too. Give the sensor a `source` in rig.toml to keep others out.",
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kinds(change: impl FnOnce(&mut SensorStatus)) -> Vec<&'static str> {
        let mut sensor =
            SensorStatus { name: "left".into(), state: SensorState::Ok, ..SensorStatus::default() };
        change(&mut sensor);
        let mut list = List::default();
        problems(&sensor, &mut list);
        assert!(list.0.iter().all(|problem| problem.what.contains("left") && !problem.advice.is_empty()));
        list.0.into_iter().map(|problem| problem.kind).collect()
    }

    #[test]
    fn a_healthy_sensor_has_no_problem_and_each_trouble_its_own() {
        assert!(kinds(|_| {}).is_empty());
        assert_eq!(kinds(|sensor| sensor.state = SensorState::Silent), ["silent"]);
        assert_eq!(kinds(|sensor| sensor.state = SensorState::NotDecoded), ["not_decoded"]);
        assert_eq!(kinds(|sensor| sensor.recent_losses.kernel_dropped = 1), ["kernel_drops"]);
        assert_eq!(kinds(|sensor| sensor.recent_losses.crc_errors = 1), ["damaged"]);
        assert_eq!(kinds(|sensor| sensor.losses.kernel_dropped = 1), [""; 0], "long ago");
        assert_eq!(kinds(|sensor| sensor.recent_restarts = 1), ["restarted"]);
        assert_eq!(kinds(|sensor| sensor.warnings.push("left is hot".into())), ["sensor_warning"]);
    }
}
