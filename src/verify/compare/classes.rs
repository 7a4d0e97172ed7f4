//! What became of recorded rays, counted.

use glam::DVec3;
use serde::Serialize;

use crate::world::scene::Scene;

/// Azimuth sectors of a strip.
pub const SECTORS: usize = 72;
/// Bins of incidence, 10 degrees each.
pub const INCIDENCE_BINS: usize = 9;

/// What became of one ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum RayClass {
    /// Recorded where predicted.
    Agree,
    /// Recorded nearer: something blocked the ray.
    Short,
    /// Recorded farther: glass, an opened door, a wrong scene.
    Long,
    /// Predicted, nothing recorded.
    Drop,
    /// Recorded, nothing predicted.
    Extra,
    /// Neither predicted nor recorded.
    Nothing,
    /// Recorded outside the trajectory's time: cannot be placed.
    Unplaced,
}

impl RayClass {
    /// Of a ray that was predicted and recorded at these ranges, m.
    pub(crate) fn of(predicted_m: Option<f64>, recorded_m: Option<f64>, gate_m: f64) -> Self {
        match (predicted_m, recorded_m) {
            (None, None) => Self::Nothing,
            (Some(_), None) => Self::Drop,
            (None, Some(_)) => Self::Extra,
            (Some(predicted), Some(recorded)) if (recorded - predicted).abs() <= gate_m => Self::Agree,
            (Some(predicted), Some(recorded)) if recorded < predicted => Self::Short,
            (Some(_), Some(_)) => Self::Long,
        }
    }

    /// The same in a scene that may be a map: that knows its surfaces to a cell, and a ray that passes low over a floor
    /// crosses many cells of it before it ends. So what ends where the map has a surface agrees. `end_m` gives the recorded
    /// point in the scene's frame.
    pub(crate) fn in_scene(
        scene: &Scene,
        predicted_m: Option<f64>,
        recorded_m: Option<f64>,
        gate_m: f64,
        end_m: impl FnOnce(f64) -> Option<DVec3>,
    ) -> Self {
        let class = Self::of(predicted_m, recorded_m, gate_m);
        let (Scene::Voxels(map), Self::Short | Self::Long | Self::Extra) = (scene, class) else {
            return class;
        };
        let ends_at_surface = recorded_m.and_then(end_m).is_some_and(|end_m| map.is_at_surface(end_m));
        if ends_at_surface { Self::Agree } else { class }
    }
}

/// Counts of [`RayClass`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct RayClasses {
    /// Recorded where predicted.
    pub agree: u64,
    /// Recorded nearer: something blocked the ray.
    pub short: u64,
    /// Recorded farther: glass, an opened door, a wrong scene.
    pub long: u64,
    /// Predicted, nothing recorded.
    pub drop: u64,
    /// Recorded, nothing predicted.
    pub extra: u64,
    /// Neither predicted nor recorded.
    pub nothing: u64,
    /// Recorded outside the trajectory's time: cannot be placed.
    pub unplaced: u64,
}

impl RayClasses {
    /// Rays for which the scene or the sensor reported a surface.
    pub fn informative(&self) -> u64 {
        self.agree + self.short + self.long + self.drop + self.extra
    }

    /// Share of the informative rays that agree; none without any.
    pub(crate) fn agree_share(&self) -> Option<f64> {
        let all = self.informative();
        (all > 0).then(|| self.agree as f64 / all as f64)
    }

    /// One more ray.
    pub(crate) fn count(&mut self, class: RayClass) {
        *match class {
            RayClass::Agree => &mut self.agree,
            RayClass::Short => &mut self.short,
            RayClass::Long => &mut self.long,
            RayClass::Drop => &mut self.drop,
            RayClass::Extra => &mut self.extra,
            RayClass::Nothing => &mut self.nothing,
            RayClass::Unplaced => &mut self.unplaced,
        } += 1;
    }

    /// All rays of another count too.
    pub(crate) fn join(&mut self, other: &Self) {
        self.agree += other.agree;
        self.short += other.short;
        self.long += other.long;
        self.drop += other.drop;
        self.extra += other.extra;
        self.nothing += other.nothing;
        self.unplaced += other.unplaced;
    }
}

/// One sensor's rays by channel and azimuth sector, and by incidence.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Breakdown {
    /// By `channel * SECTORS + sector`; sector 0 begins at encoder azimuth 0, clockwise.
    pub strip: Vec<RayClasses>,
    /// By angle between ray and normal of the predicted surface, bins of 10 degrees.
    pub by_incidence: [RayClasses; INCIDENCE_BINS],
}

impl Breakdown {
    /// One more ray. `cosine` is that between ray and normal, where a surface was predicted.
    pub(crate) fn count(&mut self, channel: usize, azimuth_rad: f64, cosine: Option<f64>, class: RayClass) {
        let turn = azimuth_rad.rem_euclid(std::f64::consts::TAU) / std::f64::consts::TAU;
        let sector = ((turn * SECTORS as f64) as usize).min(SECTORS - 1);
        let place = channel * SECTORS + sector;
        if place >= self.strip.len() {
            self.strip.resize((channel + 1) * SECTORS, RayClasses::default());
        }
        self.strip[place].count(class);
        if let Some(cosine) = cosine {
            let bin = (cosine.clamp(0.0, 1.0).acos().to_degrees() / 10.0) as usize;
            self.by_incidence[bin.min(INCIDENCE_BINS - 1)].count(class);
        }
    }

    /// All rays of another breakdown too.
    pub(crate) fn join(&mut self, other: &Self) {
        if other.strip.len() > self.strip.len() {
            self.strip.resize(other.strip.len(), RayClasses::default());
        }
        self.strip.iter_mut().zip(&other.strip).for_each(|(own, more)| own.join(more));
        self.by_incidence.iter_mut().zip(&other.by_incidence).for_each(|(own, more)| own.join(more));
    }

    /// Counts of every channel.
    pub(crate) fn by_channel(&self) -> Vec<RayClasses> {
        self.strip.chunks(SECTORS).map(sum).collect()
    }

    /// Counts of every azimuth sector.
    pub(crate) fn by_azimuth(&self) -> Vec<RayClasses> {
        (0..SECTORS)
            .map(|sector| {
                let mut all = RayClasses::default();
                self.strip.iter().skip(sector).step_by(SECTORS).for_each(|cell| all.join(cell));
                all
            })
            .collect()
    }

    /// All rays.
    pub(crate) fn total(&self) -> RayClasses {
        sum(&self.strip)
    }
}

fn sum(cells: &[RayClasses]) -> RayClasses {
    let mut all = RayClasses::default();
    cells.iter().for_each(|cell| all.join(cell));
    all
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::world::scene::VoxelMap;

    #[test]
    fn what_ends_where_a_map_has_a_surface_agrees() {
        let mut map = VoxelMap::new(0.1, 1, 100.0).unwrap();
        for x in 0..100 {
            map.add_point(DVec3::new(0.1 * f64::from(x) + 0.05, 0.05, 0.02));
        }
        let floor = Scene::Voxels(Arc::new(map));
        // low over the floor: 0.3 m above its beginning, and on it after 6 m
        let (origin_m, direction) = (DVec3::new(0.0, 0.05, 0.32), DVec3::new(6.0, 0.0, -0.3).normalize());
        let predicted_m = floor.cast(origin_m, direction).map(|hit| hit.distance_m);
        assert!(predicted_m < Some(5.0), "its cells begin 8 cm higher: {predicted_m:?}");
        let class = |scene: &Scene, recorded_m: f64| {
            let end_m = |range_m| Some(origin_m + range_m * direction);
            RayClass::in_scene(scene, predicted_m, Some(recorded_m), 0.1, end_m)
        };
        let floor_m = 6.0_f64.hypot(0.3);
        assert_eq!(class(&floor, floor_m), RayClass::Agree);
        assert_eq!(class(&floor, 1.5), RayClass::Short);
        assert_eq!(class(&floor, 11.0), RayClass::Long, "half a metre below the floor");
        let exact = Scene::Box(crate::world::scene::BoxScene::closed(DVec3::ZERO, DVec3::splat(9.0)));
        assert_eq!(class(&exact, floor_m), RayClass::Long);
    }

    #[test]
    fn each_count_covers_every_ray() {
        let mut breakdown = Breakdown::default();
        for n in 0..1000_u32 {
            let recorded_m = (n % 3 != 0).then_some(1.02 + f64::from(n % 7) * 0.05);
            let class = RayClass::of(Some(1.1), recorded_m, 0.1);
            breakdown.count(n as usize % 5, f64::from(n) * 0.7, Some(0.5), class);
        }
        let total = breakdown.total();
        assert_eq!(total.informative(), 1000);
        assert!(total.agree > 0 && total.short == 0 && total.long > 0 && total.drop == 334);
        for parts in [breakdown.by_channel(), breakdown.by_azimuth(), breakdown.by_incidence.to_vec()] {
            assert_eq!(sum(&parts), total);
        }
        assert_eq!(breakdown.by_incidence[6].informative(), 1000, "60 degrees");
    }
}
