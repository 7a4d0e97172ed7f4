//! Which beams a recorded frame was measured along: packets say it, and where they cannot, the mount file does.

use sensors::router::{Family, Sensor};
use sensors::velodyne::Product;
use sensors::{SensorModel, catalogue};

use crate::live::watch::is_model;
use crate::recording::fault::Fault;
use crate::rig::MountedSensor;

/// What a mount file says of the sensor in one place.
#[derive(Clone, Copy)]
pub(crate) struct Slot<'a> {
    mounted: &'a MountedSensor,
    is_calibrated: bool,
}

impl<'a> Slot<'a> {
    /// Of a sensor of the rig; one that differs from the nominal sensor of its name has a calibration.
    pub(crate) fn of(mounted: &'a MountedSensor) -> Self {
        let nominal = catalogue::nominal(&mounted.model.name);
        Self { mounted, is_calibrated: nominal.is_ok_and(|nominal| nominal != mounted.model) }
    }

    /// The beams of what sits here, as its decoder knows it: what was typed for it counts more than what the mount file
    /// names, and of an Ouster its metadata know all.
    pub(crate) fn beams(&self, sensor: &'a Sensor) -> &'a SensorModel {
        let found = sensor.model().unwrap_or(&self.mounted.model);
        let is_open = matches!(sensor.family(), Family::Velodyne(_)) && !sensor.is_calibrated();
        if is_open { self.velodyne_beams(found) } else { found }
    }

    /// The beams of a Velodyne that sends the packets of `found`: as calibrated, where the mount file names a
    /// calibration; of the product that it names, where packets do not distinguish that from `found`; otherwise `found`.
    fn velodyne_beams(&self, found: &'a SensorModel) -> &'a SensorModel {
        let nominal = &self.mounted.model;
        // of its own product the packets know more than the nominal model: their cycle, or the unit's calibration
        let knows_more = self.is_calibrated || nominal.name != found.name;
        let products = Product::from_name(&nominal.name).zip(Product::from_name(&found.name));
        let could_be = products.is_some_and(|(nominal, found)| nominal.sends_as(found));
        if knows_more && could_be { nominal } else { found }
    }

    /// The mount file and the packets name different sensors. `product` is that of metadata or packets.
    pub(crate) fn wrong_model(&self, product: &str, found: &SensorModel) -> Option<Fault> {
        let nominal = &self.mounted.model;
        if is_model(&nominal.name, product, &found.name) {
            return None;
        }
        let name = &self.mounted.name;
        let words = format!(
            "{name} is a {product} of {} channels, the mount file says {} of {}: the prediction was made for another sensor",
            found.channels(),
            nominal.name,
            nominal.channels()
        );
        Some(Fault::new("wrong_model", vec![name.clone()], words))
    }
}

#[cfg(test)]
mod tests {
    use sensors::SensorModel;

    use super::*;

    fn nominal(name: &str) -> SensorModel {
        catalogue::nominal(name).unwrap()
    }

    fn raised(name: &str) -> SensorModel {
        let model = nominal(name);
        let mut beams = model.beams().to_vec();
        beams[0].elevation_rad += 0.01;
        model.with_beams(beams)
    }

    #[test]
    fn packets_know_best_but_where_they_cannot_tell() {
        for (nominal, found, is_nominal, is_wrong) in [
            (nominal("vlp-16"), raised("vlp-16"), false, false), // as the unit reported of itself
            (raised("vlp-16"), nominal("vlp-16"), true, false),  // a calibration was named
            (nominal("puck-lite"), nominal("vlp-16"), true, false),
            (raised("puck-lite"), nominal("vlp-16"), true, false),
            (nominal("vlp-32a"), nominal("vlp-32b"), true, false),
            (nominal("puck-hi-res"), nominal("vlp-16"), false, true),
            (raised("vlp-16"), nominal("puck-hi-res"), false, true),
            (nominal("vlp-16"), nominal("vlp-32c"), false, true),
            (raised("hdl-64e-s2"), nominal("hdl-64e-s2"), true, false),
            (nominal("hdl-64e-s2"), nominal("hdl-64e-s3"), false, true),
        ] {
            let mounted = MountedSensor { name: "front".into(), model: nominal, mount: Default::default() };
            let slot = Slot::of(&mounted);
            let expected = if is_nominal { &mounted.model } else { &found };
            let names = format!("{} {}", mounted.model.name, found.name);
            assert_eq!(slot.velodyne_beams(&found), expected, "{names}");
            assert_eq!(slot.wrong_model(&found.name, &found).is_some(), is_wrong, "{names}");
        }
    }
}
