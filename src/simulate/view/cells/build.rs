//! Casting the views of a site, as finely as its voxels and ranges ask for.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::numbering::Numbering;
use super::records::{Block, Layer, Record, WIDTH};
use super::{BuildCost, Fineness};
use crate::simulate::view::sphere::{Reach, SphereMap};
use crate::simulate::view::{Fan, Scans, ViewError, ViewSite};

/// Rays of a pilot view are so far apart, rad.
const PILOT_STEP_RAD: f64 = 0.05;
/// Views that say how far surfaces are.
const PILOTS: u64 = 9;
/// Records of a view for each of its rays, as measured in furnished rooms.
const RECORDS_PER_RAY: f64 = 0.2;
/// Rays are never coarser or finer than this, rad.
const STEPS_RAD: (f64, f64) = (0.002, 0.02);
/// Rays of all views: beyond this they are coarser.
const MOST_RAYS: f64 = 120e6;
/// Along a long walk there are more views than asked for, one in so many metres, while they are no more than this and their
/// rays need not be coarser: what lies between distant views is missed.
const VIEW_GAP_M: f64 = 1.0;
const MOST_VIEWS: u64 = 400;

/// The layers with what they took.
pub(super) struct Built {
    pub layers: Vec<Layer>,
    pub heights_m: Vec<f64>,
    /// By number, ascending.
    pub voxels: Vec<u32>,
    pub cost: BuildCost,
}

/// Casts and packs. `scans` are those of the first fan.
pub(super) fn build(
    site: &ViewSite,
    fans: &[Fan],
    scans: &Scans,
    fineness: &Fineness,
) -> Result<Built, ViewError> {
    let reach = Reach::of(fans);
    let (low_m, high_m) = fineness.heights_m;
    let layers = if high_m > low_m { fineness.layers.max(2) } else { 1 };
    let height = |layer: usize| low_m + (high_m - low_m) * layer as f64 / (layers - 1).max(1) as f64;
    let heights_m: Vec<f64> = (0..layers).map(height).collect();
    let plan = Plan::new(site, scans, fineness, &heights_m, reach)?;
    let map = SphereMap::new(plan.step_rad);
    let places: Vec<(DMat3, DVec3)> = plan.places(site, scans);
    // by height, then by place
    let mut views: Vec<Vec<Record>> = (0..heights_m.len() * places.len())
        .into_par_iter()
        .map_init(Patches::default, |patches, at| {
            let eye_m = DVec3::Z * heights_m[at / places.len()];
            view(site, &map, &places[at % places.len()], eye_m, reach, patches)
        })
        .collect();
    let numbering = Numbering::new(site.grid.len(), views.iter().flatten().map(|record| record.cell));
    if numbering.count() == 0 {
        return Err(nothing_visible(site));
    }
    let by_height: Vec<_> = heights_m.iter().map(|_| views.drain(..places.len()).collect()).collect();
    let layers: Vec<Layer> = by_height.into_par_iter().map(|views| Layer::pack(views, &numbering)).collect();
    let bytes = layers.iter().map(Layer::bytes).sum();
    let cost = BuildCost {
        views: places.len() as u64,
        layers: layers.len(),
        step_rad: plan.step_rad,
        rays: map.rays() * (places.len() * layers.len()) as u64,
        bytes,
        is_bound_by_memory: plan.is_bound_by_memory,
        is_bound_by_rays: plan.is_bound_by_rays,
    };
    Ok(Built { voxels: numbering.cells(), layers, heights_m, cost })
}

fn nothing_visible(site: &ViewSite) -> ViewError {
    let [low, high] = site.scene.bounds_m();
    ViewError::NothingVisible { bounds: format!("{low:.1} to {high:.1} m") }
}

/// How many views, and how fine.
struct Plan {
    /// Every so many scans there is a view.
    scans_per_view: u64,
    step_rad: f64,
    is_bound_by_memory: bool,
    is_bound_by_rays: bool,
}

impl Plan {
    fn new(
        site: &ViewSite,
        scans: &Scans,
        fineness: &Fineness,
        heights_m: &[f64],
        reach: Reach,
    ) -> Result<Self, ViewError> {
        let eye_m = DVec3::Z * heights_m[heights_m.len() / 2];
        let pilot = SphereMap::new(PILOT_STEP_RAD);
        let mut ranges_m: Vec<f64> = Vec::new();
        let pilots = PILOTS.min(scans.count);
        for pilot_number in 0..pilots {
            let place =
                scans.middle(&site.trajectory, pilot_number * (scans.count - 1) / (pilots - 1).max(1));
            pilot.cast(&site.scene, &place, eye_m, reach, |hit| ranges_m.push(hit.from_eye_m.length()));
        }
        if ranges_m.is_empty() {
            return Err(nothing_visible(site));
        }
        ranges_m.sort_by(f64::total_cmp);
        let far_m = ranges_m[(ranges_m.len() - 1) * 95 / 100];
        let wanted_rad = fineness.step_share * site.grid.voxel_m / far_m.max(1e-3);
        let step_rad = wanted_rad.clamp(STEPS_RAD.0, STEPS_RAD.1);
        let records = SphereMap::new(step_rad.max(STEPS_RAD.0)).rays() as f64 * RECORDS_PER_RAY;
        let bytes_of_view = records / WIDTH as f64 * size_of::<Block>() as f64 * heights_m.len() as f64;
        let affordable = (fineness.most_bytes as f64 / bytes_of_view).floor().max(4.0) as u64;
        let rays_of_view = 24.0 / (step_rad * step_rad) * heights_m.len() as f64;
        let along = (site.trajectory.length_m() / VIEW_GAP_M).min(MOST_RAYS / rays_of_view) as u64;
        let wanted = fineness.views.max(along.min(MOST_VIEWS)).min(scans.count);
        let views = wanted.min(affordable).max(1);
        let least_rad = step_rad * (views as f64 * rays_of_view / MOST_RAYS).sqrt();
        Ok(Self {
            scans_per_view: scans.count.div_ceil(views),
            step_rad: step_rad.max(least_rad),
            is_bound_by_memory: affordable < wanted,
            is_bound_by_rays: least_rad > step_rad || wanted_rad < STEPS_RAD.0,
        })
    }

    /// The middle of every n-th scan.
    fn places(&self, site: &ViewSite, scans: &Scans) -> Vec<(DMat3, DVec3)> {
        let first = (self.scans_per_view - 1) / 2;
        let chosen = (first.min(scans.count - 1)..scans.count).step_by(self.scans_per_view as usize);
        chosen.map(|scan| scans.middle(&site.trajectory, scan)).collect()
    }
}

/// Everything that is seen from one place, a record for each voxel.
fn view(
    site: &ViewSite,
    map: &SphereMap,
    place: &(DMat3, DVec3),
    eye_m: DVec3,
    reach: Reach,
    Patches { patches, of_cell }: &mut Patches,
) -> Vec<Record> {
    patches.clear();
    of_cell.clear();
    let mut last = (u32::MAX, 0_u32);
    let is_free = |from_eye_m: DVec3| {
        let range_m = from_eye_m.length();
        let stopped_m =
            site.shades.operator.and_then(|operator| operator.distance_m(eye_m, from_eye_m / range_m));
        stopped_m.is_none_or(|stopped_m| stopped_m > range_m)
    };
    map.cast(&site.scene, place, eye_m, reach, |hit| {
        if !is_free(hit.from_eye_m) {
            return;
        }
        let Some(cell) = site.grid.index(hit.point_m) else { return };
        // neighbouring pixels see one voxel
        if last.0 != cell as u32 {
            let number = *of_cell.entry(cell as u32).or_insert(patches.len() as u32);
            last = (cell as u32, number);
            if number as usize == patches.len() {
                patches.push(Patch { cell: cell as u32, sum_m: DVec3::ZERO, solid_sr: 0.0 });
            }
        }
        let patch = &mut patches[last.1 as usize];
        patch.sum_m += hit.solid_angle_sr * hit.from_eye_m;
        patch.solid_sr += hit.solid_angle_sr;
    });
    let record = |patch: &Patch| {
        let from_eye_m = patch.sum_m / patch.solid_sr;
        Record {
            cell: patch.cell,
            at_m: (eye_m + from_eye_m).as_vec3().to_array(),
            width_m: (patch.solid_sr.sqrt() * from_eye_m.length()) as f32,
        }
    };
    patches.iter().map(record).collect()
}

/// The patches of a view, and the patch of each voxel: memory that a thread's next view takes over.
#[derive(Default)]
struct Patches {
    patches: Vec<Patch>,
    of_cell: HashMap<u32, u32, BuildHasherDefault<CellHasher>>,
}

/// What a view sees of a voxel.
struct Patch {
    cell: u32,
    /// From the eye, weighted by the solid angle of each ray, m.
    sum_m: DVec3,
    solid_sr: f64,
}

/// Numbers of voxels are hashed by one product (Knuth, The Art of Computer Programming 3, 6.4).
#[derive(Default)]
pub(crate) struct CellHasher(u64);

impl Hasher for CellHasher {
    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|byte| self.write_u32(u32::from(*byte)));
    }

    fn write_u32(&mut self, cell: u32) {
        self.write_usize(cell as usize);
    }

    fn write_usize(&mut self, cell: usize) {
        self.0 = (self.0 ^ cell as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15).rotate_left(32);
    }

    fn finish(&self) -> u64 {
        self.0
    }
}

/// Voxels that could be seen from the trajectory by a sensor at the body's origin.
pub(in crate::simulate::view) fn reachable_voxels(site: &ViewSite, fans: &[&Fan], scans: &Scans) -> u64 {
    let reach = Reach::of(fans.iter().copied());
    let fineness = Fineness::between((0.0, 0.0));
    let Ok(plan) = Plan::new(site, scans, &fineness, &[0.0], reach) else { return 0 };
    let map = SphereMap::new(plan.step_rad);
    let places = plan.places(site, scans);
    let views: Vec<Vec<Record>> = places
        .par_iter()
        .map_init(Patches::default, |patches, place| view(site, &map, place, DVec3::ZERO, reach, patches))
        .collect();
    Numbering::new(site.grid.len(), views.iter().flatten().map(|record| record.cell)).count() as u64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::Unit;
    use crate::simulate::view::{Sampling, Shades};
    use crate::world::coverage::VoxelGrid;
    use crate::world::scene::{BoxScene, Scene};
    use crate::world::trajectory::Trajectory;

    /// Views of a walk at 1 m/s through a corridor, where 50 are asked for.
    fn views(walk_m: f64, voxel_m: f64) -> usize {
        let corridor = BoxScene::closed(DVec3::new(-5.0, -3.0, 0.0), DVec3::new(1005.0, 3.0, 3.0));
        let scene = Scene::Box(corridor);
        let [from_m, to_m] = [0.0, walk_m].map(|x_m| DVec3::new(x_m, 0.0, 1.5));
        let trajectory = Trajectory::straight(from_m, to_m, 1.0, 0);
        let grid = VoxelGrid::centred_on(scene.bounds_m(), voxel_m);
        let site = ViewSite { scene, trajectory, grid, shades: Shades::default() };
        let fan = Fan::new(&Unit::nominal("vlp-16").unwrap(), &Sampling::default()).unwrap();
        let scans = Scans::of(&fan, &site.trajectory).unwrap();
        let fineness = Fineness { views: 50, ..Fineness::between((0.0, 0.0)) };
        let plan = Plan::new(&site, &scans, &fineness, &[0.0], Reach::of([&fan])).unwrap();
        plan.places(&site, &scans).len()
    }

    #[test]
    fn long_walks_have_a_view_for_each_metre_while_rays_last() {
        assert!((45..=50).contains(&views(20.0, 0.5)));
        assert!((250..=300).contains(&views(300.0, 0.5)));
        assert!((300..=MOST_VIEWS as usize).contains(&views(900.0, 0.5)));
        // so fine that rays and memory are used up
        assert!((20..=50).contains(&views(300.0, 0.02)));
    }
}
