//! Whether a mount can be meant: millimetres read as metres, another origin, a sensor under the ground.

/// A rig is what one platform carries: nothing sits farther from its origin, m.
const FARTHEST_M: f64 = 20.0;
/// Beyond this a position is worth a question, m.
const FAR_M: f64 = 5.0;
/// No platform's origin is higher above the ground than this, m: what hangs deeper sits below the floor.
const DEEPEST_M: f64 = 3.0;
/// Below this a sensor is under the floor wherever the platform's origin is at the height of a hand or lower, m.
const LOW_M: f64 = 1.0;
/// An angle of more than a turn is no angle of a mount, degrees.
const TURN_DEG: f64 = 360.0;

/// What is doubted of a sensor.
pub(super) struct Doubted<'a> {
    pub name: &'a str,
    /// By the names of their fields.
    pub position_m: [(&'static str, f64); 3],
    pub angles_deg: [(&'static str, f64); 3],
    pub angle_tolerance_deg: Option<f64>,
}

/// Refuses a sensor that no rig can carry so.
///
/// # Errors
/// The field, what was found, what was expected and what to do, in words.
pub(super) fn ensure_plausible(index: usize, sensor: &Doubted<'_>) -> Result<(), String> {
    let name = sensor.name;
    for (field, value) in sensor.position_m {
        if value.abs() > FARTHEST_M {
            let as_millimetres = value / 1000.0;
            return Err(format!(
                "sensors[{index}].{field} is {value}: {name} would sit {:.0} m from the platform's origin, expected at most \
                 {FARTHEST_M} m; positions are metres from the platform's own origin: write {as_millimetres} where {value} \
                 is millimetres, and subtract the platform's place where it is a place in the world",
                value.abs()
            ));
        }
    }
    let [_, _, (_, z_m)] = sensor.position_m;
    if z_m < -DEEPEST_M {
        return Err(format!(
            "sensors[{index}].z_m is {z_m}: {name} would hang below the floor, expected at least -{DEEPEST_M}; z points up from \
             the platform's origin"
        ));
    }
    for (field, angle_deg) in sensor.angles_deg {
        if angle_deg.abs() > TURN_DEG {
            return Err(format!(
                "sensors[{index}].{field} is {angle_deg}: expected degrees from -{TURN_DEG} to {TURN_DEG}"
            ));
        }
    }
    match sensor.angle_tolerance_deg {
        Some(tolerance_deg) if !(tolerance_deg > 0.0 && tolerance_deg <= 90.0) => Err(format!(
            "sensors[{index}].angle_tolerance_deg is {tolerance_deg}: expected degrees above 0, at most 90"
        )),
        _ => Ok(()),
    }
}

/// What can be meant and seldom is, a line each.
pub(super) fn of_rig(sensors: &[Doubted<'_>]) -> Vec<String> {
    let mut doubts = Vec::new();
    for sensor in sensors {
        let name = sensor.name;
        for (field, value) in sensor.position_m.into_iter().filter(|(_, value)| value.abs() > FAR_M) {
            doubts.push(format!(
                "{name}: {field} is {value} m, more than {FAR_M} m from the platform's origin; where that is millimetres, \
                 write {}",
                value / 1000.0
            ));
        }
        let [_, _, (_, z_m)] = sensor.position_m;
        if z_m < -LOW_M {
            doubts.push(format!(
                "{name}: z_m is {z_m} m: below the floor unless the platform's origin is carried higher than that"
            ));
        }
        for (field, angle_deg) in
            sensor.angles_deg.into_iter().filter(|(_, angle_deg)| angle_deg.abs() > 180.0)
        {
            doubts.push(format!("{name}: {field} is {angle_deg}, more than half a turn"));
        }
    }
    let angles = sensors.iter().flat_map(|sensor| sensor.angles_deg.map(|angle| (sensor.name, angle)));
    let are_small = angles.clone().all(|(_, (_, angle_deg))| angle_deg.abs() <= std::f64::consts::PI);
    // no one sets a servo to a thousandth of a degree
    let is_odd = |angle_deg: f64| (100.0 * angle_deg - (100.0 * angle_deg).round()).abs() > 1e-6;
    let mut odd = angles.filter(|(_, (_, angle_deg))| angle_deg.abs() > 0.15 && is_odd(*angle_deg));
    if let Some((name, (field, angle_deg))) = odd.next().filter(|_| are_small) {
        doubts.push(format!(
            "no angle is greater than pi, and {field} of {name} is {angle_deg}: angles are degrees; {angle_deg} radians would be \
             {:.1} degrees",
            angle_deg.to_degrees()
        ));
    }
    doubts
}

#[cfg(test)]
mod tests {
    use super::*;

    fn doubted(x_m: f64, z_m: f64, pitch_deg: f64) -> Doubted<'static> {
        Doubted {
            name: "left",
            position_m: [("x_m", x_m), ("y_m", 0.0), ("z_m", z_m)],
            angles_deg: [("pitch_deg", pitch_deg), ("roll_deg", 0.0), ("yaw_deg", 0.0)],
            angle_tolerance_deg: None,
        }
    }

    #[test]
    fn positions_that_no_platform_has_are_refused_with_the_value_and_the_remedy() {
        for (sensor, words) in [
            (doubted(74.0, 119.0, 32.7), &["x_m is 74", "0.074", "millimetres"][..]),
            (doubted(0.06, -100.0, 25.0), &["z_m is -100", "100 m"]),
            (doubted(0.06, -3.5, 25.0), &["z_m is -3.5", "floor"]),
            (doubted(0.06, 0.1, 1000.0), &["pitch_deg is 1000", "360"]),
        ] {
            let refusal = ensure_plausible(0, &sensor).unwrap_err();
            assert!(words.iter().all(|word| refusal.contains(word)), "{refusal}");
        }
        assert_eq!(ensure_plausible(0, &doubted(-12.0, 3.0, -90.0)), Ok(()));
    }

    #[test]
    fn odd_mounts_are_noted_and_usual_ones_are_not() {
        let doubts = |sensor| of_rig(&[sensor]);
        assert_eq!(doubts(doubted(0.074, 0.119, 32.7)), Vec::<String>::new());
        assert_eq!(doubts(doubted(0.074, 0.119, 2.51)), Vec::<String>::new());
        for (sensor, words) in [
            (doubted(7.4, 0.1, 32.7), "0.0074"),
            (doubted(0.1, -1.2, 32.7), "below the floor"),
            (doubted(0.1, 0.1, 190.0), "half a turn"),
            (doubted(0.1, 0.1, 0.5707), "32.7 degrees"),
        ] {
            let found = doubts(sensor);
            assert!(found.len() == 1 && found[0].contains(words), "{found:?}");
        }
    }
}
