//! The published experiment as a view of rigs. Rigs are in radians, the experiment in degrees: both are the same to the bit.

use super::PublishedBox;
use crate::rig::{Mount, MountDeg, MountedSensor, Rig};
use crate::simulate::view::{Seen, View};
use crate::world::coverage::Counts;

impl View for PublishedBox {
    fn observable(&self) -> u64 {
        self.reachable()
    }

    /// A rig that [`PublishedBox::cover`] refuses sees nothing.
    fn see(&self, rigs: &[Rig]) -> Vec<Seen> {
        let see = |rig: &Rig| {
            let nothing = || Counts::of_bitmaps(&vec![&[] as &[u64]; rig.sensors.len()]);
            let sensors = self.sensors(rig);
            let counts = self.count(&sensors).unwrap_or_else(|_| nothing());
            Seen::exact(&counts, self.experiment.rays(&sensors))
        };
        rigs.iter().map(see).collect()
    }
}

impl PublishedBox {
    /// The sensors of a rig in the experiment's terms. A model that it does not have makes a type that it does not have.
    pub(crate) fn sensors(&self, rig: &Rig) -> Vec<MountDeg> {
        let models = self.experiment.models();
        let sensor = |MountedSensor { model, mount, .. }: &MountedSensor| {
            let sensor_type = models.iter().position(|known| model.name == *known).unwrap_or(models.len());
            MountDeg { sensor_type, ..in_degrees(mount) }
        };
        rig.sensors.iter().map(sensor).collect()
    }

    /// Rays of a rig over the whole walk.
    pub(crate) fn rays(&self, rig: &Rig) -> u64 {
        self.experiment.rays(&self.sensors(rig))
    }
}

fn in_degrees(mount: &Mount) -> MountDeg {
    let Mount { x_m, y_m, z_m, pitch_rad, roll_rad, .. } = *mount;
    [x_m, y_m, z_m, degrees_of(pitch_rad), degrees_of(roll_rad)].into()
}

/// Degrees that are these radians to the bit, where there are any, or else the nearest.
fn degrees_of(angle_rad: f64) -> f64 {
    let near_deg = angle_rad.to_degrees();
    let [up_deg, down_deg] = [near_deg.next_up(), near_deg.next_down()];
    let candidates_deg = [near_deg, up_deg, down_deg, up_deg.next_up(), down_deg.next_down()];
    candidates_deg.into_iter().find(|angle_deg| angle_deg.to_radians() == angle_rad).unwrap_or(near_deg)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::Rng;
    use crate::simulate::published::{Experiment, Preset};

    #[test]
    fn radians_of_degrees_are_degrees_again() {
        let mut rng = Rng::new(1, 0);
        let random_deg = (0..1_000_000).map(|_| rng.between(-360.0, 360.0));
        let steps_deg = (-3600..=3600).map(|tenth| f64::from(tenth) / 10.0);
        for angle_deg in random_deg.chain(steps_deg).chain([1e-300, 5e-324, -0.0]) {
            let angle_rad = angle_deg.to_radians();
            assert_eq!(degrees_of(angle_rad).to_radians().to_bits(), angle_rad.to_bits(), "{angle_deg}");
        }
        assert_eq!(
            [90.0_f64, 180.0, -270.0].map(|turn_deg| degrees_of(turn_deg.to_radians())),
            [90.0, 180.0, -270.0]
        );
    }

    #[test]
    fn a_rig_sees_what_its_sensors_see_and_nothing_where_it_cannot_be() {
        let presets = ["paper-os1-64", "paper-vlp-16"].map(|name| Preset::named(name).unwrap());
        let view = PublishedBox::new(&Experiment::mixed(&presets).unwrap()).unwrap();
        let mut rng = Rng::new(2, 0);
        let sensor = |model: &str, mount: MountDeg| MountedSensor {
            name: model.into(),
            model: sensors::catalogue::nominal(model).unwrap(),
            mount: mount.mount(),
        };
        for pitch_deg in [-90.0, 0.0, 15.0, 90.0, 33.3, rng.between(-90.0, 90.0)] {
            let one = MountDeg::from([0.1, rng.between(-0.2, 0.2), 0.0, pitch_deg, rng.between(-20.0, 20.0)]);
            let other = MountDeg { sensor_type: 1, ..one.mirrored() };
            let rig = Rig { sensors: vec![sensor("os1-64", one), sensor("vlp-16", other)] };
            let counts = view.count(&[one, other]).unwrap();
            let expected = Seen::exact(&counts, view.experiment().rays(&[one, other]));
            assert_eq!(View::see(&view, &[rig.clone(), rig]), [expected.clone(), expected], "{pitch_deg}");
        }
        let outside = sensor("os1-64", MountDeg { x_m: 30.0, ..MountDeg::default() });
        let unknown = sensor("os0-128", MountDeg::default());
        for sensors in [vec![outside.clone(), outside], vec![unknown], Vec::new()] {
            let seen = View::see(&view, &[Rig { sensors: sensors.clone() }]).swap_remove(0);
            assert_eq!((seen.union, seen.per_sensor), (0.0, vec![0.0; sensors.len()]));
        }
    }
}
