//! Registration strength: how well scans determine the body's pose, by the information matrix of the hits.
//!
//! Point-to-plane registration of hits p with normals n has the information H = sum of J'J with J = [n, p x n], p from
//! the body's place (its noise variance times the inverse of H is the covariance of the pose; Bonnabel et al.,
//! arXiv 1410.7632). Translation and rotation are looked at by their Schur complements, so that neither masks the other
//! (arXiv 2509.06285): eigenvalues per hit, the least of them with its direction.
//!
//! Simulated normals are exact: in a recording, normals with an error of 2 degrees add about 1e-3 to an eigenvalue of
//! zero, so that [`DEGENERATE`] and not zero divides what is observable from what is not.

mod along_path;
pub(crate) mod surroundings;

pub(crate) use along_path::PathRegistration;

use glam::DVec3;
use nalgebra::{Matrix3, Matrix6, SymmetricEigen, Vector6};

/// Least eigenvalue of translation per hit below which a direction is degenerate.
pub const DEGENERATE: f64 = 3e-3;

/// Sums over hits.
#[derive(Clone, Debug, PartialEq)]
pub struct Information {
    sum: Matrix6<f64>,
    hits: u64,
}

impl Default for Information {
    fn default() -> Self {
        Self { sum: Matrix6::zeros(), hits: 0 }
    }
}

impl Information {
    /// Adds a hit: place relative to the body, m, and unit normal, both in axes that stay the same over the hits.
    pub(crate) fn add(&mut self, from_body_m: DVec3, normal: DVec3) {
        let turn = from_body_m.cross(normal);
        let row = Vector6::new(normal.x, normal.y, normal.z, turn.x, turn.y, turn.z);
        self.sum.syger(1.0, &row, &row, 1.0);
        self.hits += 1;
    }

    /// Adds the hits of another sum in the same axes.
    pub(crate) fn join(&mut self, other: &Self) {
        self.sum += other.sum;
        self.hits += other.hits;
    }

    /// Number of hits.
    pub(crate) fn hits(&self) -> u64 {
        self.hits
    }

    /// The conditioning of the hits; none without hits.
    pub(crate) fn conditioning(&self) -> Option<Conditioning> {
        if self.hits == 0 {
            return None;
        }
        // only one triangle was summed
        let mut whole = self.sum;
        whole.fill_upper_triangle_with_lower_triangle();
        let whole = whole / self.hits as f64;
        let block = |row: usize, column: usize| Matrix3::from(whole.fixed_view::<3, 3>(row, column));
        let (translation, rotation, cross) = (block(0, 0), block(3, 3), block(0, 3));
        Some(Conditioning {
            translation: Axes::of(schur(&translation, &cross, &rotation)),
            rotation_m2: Axes::of(schur(&rotation, &cross.transpose(), &translation)),
        })
    }
}

/// Information per hit about translation and rotation, each with the other unknown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Conditioning {
    /// Between 0 and 1.
    pub translation: Axes,
    /// m^2.
    pub rotation_m2: Axes,
}

/// Eigenvalues, ascending, and the direction that belongs to the first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axes {
    /// Ascending; not below 0.
    pub eigenvalues: [f64; 3],
    /// The least known direction, unit.
    pub weakest: DVec3,
}

impl Axes {
    fn of(matrix: Matrix3<f64>) -> Self {
        let eigen = SymmetricEigen::new(matrix);
        let mut order = [0, 1, 2];
        order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
        let weakest = eigen.eigenvectors.column(order[0]);
        Self {
            eigenvalues: order.map(|axis| eigen.eigenvalues[axis].max(0.0)),
            weakest: DVec3::new(weakest[0], weakest[1], weakest[2]),
        }
    }

    /// The least eigenvalue.
    pub(crate) fn least(&self) -> f64 {
        self.eigenvalues[0]
    }
}

/// `own - cross * inverse(other) * cross'`; directions of `other` that nothing ties down take nothing away.
fn schur(own: &Matrix3<f64>, cross: &Matrix3<f64>, other: &Matrix3<f64>) -> Matrix3<f64> {
    let eigen = SymmetricEigen::new(*other);
    let largest = eigen.eigenvalues.max();
    let mut reduced = *own;
    for axis in 0..3 {
        let value = eigen.eigenvalues[axis];
        if value > 1e-12 * largest {
            let along = cross * eigen.eigenvectors.column(axis);
            reduced -= along * along.transpose() / value;
        }
    }
    // symmetric to the last bit, as the eigenvalue solver expects
    (reduced + reduced.transpose()) * 0.5
}

/// Registration strength of the scans along a path.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct RegistrationQuality {
    /// Scans looked at.
    pub scans: usize,
    /// Median over the scans of the least translation eigenvalue per hit.
    pub translation_median: f64,
    /// The same, 5th percentile.
    pub translation_p5: f64,
    /// Median over the scans of the least rotation eigenvalue per hit, m^2.
    pub rotation_median_m2: f64,
    /// The same, 5th percentile, m^2.
    pub rotation_p5_m2: f64,
    /// Share of scans with a degenerate direction of translation ([`DEGENERATE`]), or without a hit.
    pub degenerate_share: f64,
    /// Weakest direction of translation of the worst scan, world.
    pub weakest_direction: Option<[f64; 3]>,
}

/// Least eigenvalues per hit of translation and of rotation (m^2), scan by scan; 0 for a scan without hits.
pub(crate) fn least_along(scans: &[Information]) -> Vec<[f64; 2]> {
    let least = |scan: Conditioning| [scan.translation.least(), scan.rotation_m2.least()];
    scans.iter().map(|scan| scan.conditioning().map_or([0.0; 2], least)).collect()
}

impl RegistrationQuality {
    /// From one sum of hits per scan. None without scans.
    pub(crate) fn of_scans(scans: &[Information]) -> Option<Self> {
        if scans.is_empty() {
            return None;
        }
        let judged: Vec<_> = scans.iter().map(Information::conditioning).collect();
        let sorted = |value: &dyn Fn(&Conditioning) -> f64| {
            let mut values: Vec<_> = judged.iter().map(|scan| scan.as_ref().map_or(0.0, value)).collect();
            values.sort_by(f64::total_cmp);
            values
        };
        let translation = sorted(&|scan| scan.translation.least());
        let rotation = sorted(&|scan| scan.rotation_m2.least());
        let at = |values: &[f64], share: f64| values[((values.len() - 1) as f64 * share).round() as usize];
        let worst =
            judged.iter().flatten().min_by(|a, b| a.translation.least().total_cmp(&b.translation.least()));
        let degenerate = translation.iter().filter(|value| **value < DEGENERATE).count();
        Some(Self {
            scans: scans.len(),
            translation_median: at(&translation, 0.5),
            translation_p5: at(&translation, 0.05),
            rotation_median_m2: at(&rotation, 0.5),
            rotation_p5_m2: at(&rotation, 0.05),
            degenerate_share: degenerate as f64 / scans.len() as f64,
            weakest_direction: worst.map(|scan| scan.translation.weakest.to_array()),
        })
    }

    /// Of translation, in words.
    pub(crate) fn words(&self) -> String {
        format!(
            "{:.4} (5th percentile {:.4}; {DEGENERATE} is degenerate, 0.333 the maximum); {:.0} of {} scans degenerate",
            self.translation_median,
            self.translation_p5,
            self.degenerate_share * self.scans as f64,
            self.scans
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::{Mount, MountedSensor, Rig};
    use crate::simulate::scan::{Scanner, Spin};
    use crate::world::scene::{BoxScene, Scene};
    use crate::world::trajectory::Trajectory;

    /// One revolution of sensors at the given pitches in the middle of a box, 1.5 m above its floor.
    fn look(model: &str, pitches_deg: &[f64], scene: BoxScene) -> Conditioning {
        let model = sensors::catalogue::nominal(model).unwrap();
        let mounted = |pitch_deg: &f64| MountedSensor {
            name: pitch_deg.to_string(),
            model: model.clone(),
            mount: Mount { pitch_rad: pitch_deg.to_radians(), ..Mount::default() },
        };
        let rig = Rig { sensors: pitches_deg.iter().map(mounted).collect() };
        let scene = Scene::Box(scene);
        let here = DVec3::new(0.0, 0.0, 1.5);
        let trajectory = Trajectory::straight(here, here + 1e-9 * DVec3::X, 1e-8, 0);
        let mut scanner = Scanner::new(&scene, &trajectory, &rig, Spin { columns: 512, ..Spin::default() });
        scanner.occluders.iter_mut().for_each(Vec::clear);
        let mut information = Information::default();
        scanner.for_each_column(|_, column| {
            for back in &column.returns {
                information.add(back.point_m - here, back.normal);
            }
        });
        information.conditioning().unwrap()
    }

    fn room() -> BoxScene {
        BoxScene::closed(DVec3::new(-2.5, -3.0, 0.0), DVec3::new(2.5, 3.0, 3.0))
    }

    /// Figures from an independent program (one scan in a room 6 m wide, 5 m long, 3 m high): VLP-16 level exactly 0,
    /// tilted pair 6.9e-2; OS1-64 tilted pair 2.3e-1.
    #[test]
    fn tilt_ties_the_height_down() {
        let level = look("vlp-16", &[0.0], room());
        assert!(level.translation.least() < 1e-12, "{level:?}");
        assert!(level.translation.weakest.z.abs() > 0.999_999);
        let tilted = look("vlp-16", &[38.0, -38.0], room()).translation.least();
        assert!((tilted - 0.069).abs() < 0.002, "{tilted}");
        let level = look("os1-64", &[0.0], room()).translation;
        assert!(level.least() < 0.02 && level.weakest.z.abs() > 0.99, "{level:?}");
        let tilted = look("os1-64", &[25.0, -25.0], room()).translation.least();
        assert!((tilted - 0.23).abs() < 0.01, "{tilted}");
    }

    #[test]
    fn a_corridor_is_degenerate_along() {
        let mut corridor = BoxScene::closed(DVec3::new(-500.0, -1.5, 0.0), DVec3::new(500.0, 1.5, 3.0));
        corridor.faces[0] = [false; 2];
        let seen = look("os1-64", &[25.0, -25.0], corridor);
        assert!(seen.translation.least() < 1e-12 && seen.translation.weakest.x.abs() > 0.999_999, "{seen:?}");
        assert!(seen.translation.eigenvalues[1] > 0.1 && seen.rotation_m2.least() > 0.1, "{seen:?}");
    }

    #[test]
    fn scans_without_hits_are_degenerate() {
        let quality = RegistrationQuality::of_scans(&[Information::default()]).unwrap();
        assert_eq!((quality.degenerate_share, quality.translation_p5), (1.0, 0.0));
        assert_eq!(RegistrationQuality::of_scans(&[]), None);
    }
}
