use super::MountFile;

impl MountFile {
    /// What no servo sets of each sensor, in words: everything besides its pitch.
    pub(crate) fn set_by_hand(&self) -> impl Iterator<Item = Option<String>> {
        self.sensors.iter().map(|sensor| {
            let degrees = [("roll", sensor.roll_deg, 2, "degrees")];
            let metres = [("x", sensor.x_m, 3, "m"), ("y", sensor.y_m, 3, "m"), ("z", sensor.z_m, 3, "m")];
            let parts: Vec<String> = degrees
                .into_iter()
                .chain(metres)
                .filter(|(_, value, ..)| *value != 0.0)
                .map(|(name, value, digits, unit)| format!("{name} {value:+.digits$} {unit}"))
                .collect();
            (!parts.is_empty()).then(|| {
                format!(
                    "{}: the rig sets its pitch alone; no servo sets {}: see that it is screwed on so",
                    sensor.name,
                    parts.join(", ")
                )
            })
        })
    }
}
