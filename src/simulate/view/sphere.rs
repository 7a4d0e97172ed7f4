//! Everything that can be seen from a point: one ray for each pixel of the six faces of a cube.

use glam::{DMat3, DVec3};

use super::Fan;
use crate::base::instructions::Instructions;
use crate::world::scene::{PACKET, RayTile, Scene};

/// Edge of a tile of pixels that are cast together.
const TILE: usize = 4;

/// How far and how obliquely surfaces count.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reach {
    pub max_range_m: f64,
    /// Least cosine between a ray and the normal against it.
    pub min_cosine: f64,
}

impl Reach {
    /// That of the farthest of some sensors.
    pub(crate) fn of<'a>(fans: impl IntoIterator<Item = &'a Fan>) -> Self {
        let nothing = Self { max_range_m: 0.0, min_cosine: 0.0 };
        fans.into_iter().fold(nothing, |reach, fan| Self {
            max_range_m: reach.max_range_m.max(fan.max_range_m),
            min_cosine: fan.min_cosine,
        })
    }
}

/// What a pixel's ray meets.
#[derive(Clone, Copy, Debug)]
pub(super) struct SphereHit {
    /// In the frame of the body, from the eye, m.
    pub from_eye_m: DVec3,
    /// World, m.
    pub point_m: DVec3,
    /// Of the pixel, sr.
    pub solid_angle_sr: f64,
}

/// Directions of the pixels, in the frame of the body, tile by tile.
pub(super) struct SphereMap {
    directions: Vec<DVec3>,
    solid_angles_sr: Vec<f64>,
}

impl SphereMap {
    /// Pixels `step_rad` apart in the middle of a face, where they are widest.
    pub(crate) fn new(step_rad: f64) -> Self {
        let pixels = ((2.0 / step_rad / TILE as f64).ceil() as usize).max(1) * TILE;
        let edge = 2.0 / pixels as f64;
        let (mut directions, mut solid_angles_sr) = (Vec::new(), Vec::new());
        for face in 0..6 {
            for tile in 0..(pixels / TILE).pow(2) {
                let (row, column) = (tile / (pixels / TILE) * TILE, tile % (pixels / TILE) * TILE);
                for pixel in 0..TILE * TILE {
                    let u = (column + pixel % TILE) as f64 * edge + 0.5 * edge - 1.0;
                    let v = (row + pixel / TILE) as f64 * edge + 0.5 * edge - 1.0;
                    let out = if face % 2 == 0 { 1.0 } else { -1.0 };
                    let through = match face / 2 {
                        0 => DVec3::new(out, u, v),
                        1 => DVec3::new(u, out, v),
                        _ => DVec3::new(u, v, out),
                    };
                    directions.push(through.normalize());
                    solid_angles_sr.push(edge * edge * through.length().powi(-3));
                }
            }
        }
        Self { directions, solid_angles_sr }
    }

    /// Rays of one map.
    pub(crate) fn rays(&self) -> u64 {
        self.directions.len() as u64
    }

    /// Everything within reach around an eye in the body frame.
    pub(crate) fn cast(
        &self,
        scene: &Scene,
        world_from_body: &(DMat3, DVec3),
        eye_m: DVec3,
        reach: Reach,
        mut take: impl FnMut(SphereHit),
    ) {
        let (axes, body_m) = world_from_body;
        let origin_m = *body_m + *axes * eye_m;
        let Reach { max_range_m, min_cosine } = reach;
        let mut met = |pixel: usize, distance_m: f64, cosine: f64| {
            if distance_m <= max_range_m && (min_cosine == 0.0 || cosine >= min_cosine) {
                let from_eye_m = distance_m * self.directions[pixel];
                take(SphereHit {
                    from_eye_m,
                    point_m: origin_m + *axes * from_eye_m,
                    solid_angle_sr: self.solid_angles_sr[pixel],
                });
            }
        };
        let Some(mesh) = scene.mesh() else {
            let origins_m = [origin_m; PACKET];
            for (tile, directions) in self.directions.chunks(PACKET).enumerate() {
                let world: Vec<DVec3> = directions.iter().map(|direction| *axes * *direction).collect();
                scene.cast_many(&origins_m[..world.len()], &world, |element, hit| {
                    hit.into_iter().for_each(|hit| {
                        met(tile * PACKET + element, hit.distance_m, -hit.normal.dot(world[element]));
                    });
                });
            }
            return;
        };
        let from_centre_m = (origin_m - mesh.centre_m()).as_vec3();
        let mut rays = RayTile::EMPTY;
        rays.origin_m = from_centre_m.to_array().map(|value| [value; PACKET]);
        for (tile, directions) in self.directions.chunks_exact(PACKET).enumerate() {
            for (element, direction) in directions.iter().enumerate() {
                let world = *axes * *direction;
                for axis in 0..3 {
                    rays.direction[axis][element] = world[axis] as f32;
                }
            }
            let (distances_m, cosines) = if min_cosine > 0.0 {
                mesh.cast_tile_with_cosines(&rays, max_range_m as f32, Instructions::best())
            } else {
                (mesh.cast_tile(&rays, max_range_m as f32, Instructions::best()), [1.0; PACKET])
            };
            for (element, distance_m) in distances_m.into_iter().enumerate() {
                met(tile * PACKET + element, f64::from(distance_m), cosines[element]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_fill_the_sphere() {
        let map = SphereMap::new(0.02);
        let sum_sr: f64 = map.solid_angles_sr.iter().sum();
        assert!((sum_sr - 4.0 * std::f64::consts::PI).abs() < 1e-3, "{sum_sr}");
        assert!(map.directions.iter().sum::<DVec3>().length() < 1e-6);
    }
}
