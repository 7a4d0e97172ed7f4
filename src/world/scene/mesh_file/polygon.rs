//! Polygons to triangles. A polygon is read as a fan; where a corner of the fan turns against the polygon, it is cut in ears in
//! the polygon's own plane. The area that must come out is known before: Newell's sum over the edges (Sutherland, Sproull and
//! Schumacker 1974, doi:10.1145/356625.356626).

use earcut::Earcut;
use glam::DVec3;

use super::Soup;

/// Share of a polygon's area by which triangles may turn against it or differ from it: rounding.
const ROUNDING: f64 = 1e-6;

/// Triangles that a polygon was cut into at first: a fan around its first corner.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fan {
    first: usize,
    triangles: usize,
}

/// Polygons with triangles that do not add up to their own area: they cross themselves.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Crossing {
    pub polygons: usize,
    /// By Newell's sum, square units of the file.
    pub area: f64,
    /// Of the triangles read instead.
    pub read: f64,
}

impl Soup {
    /// A polygon as a fan of triangles; one of fewer than three corners is no surface and is counted.
    pub(super) fn push_polygon(&mut self, corners: &[u32]) {
        self.short_faces += usize::from(corners.len() < 3);
        if corners.len() > 3 {
            self.fans.push(Fan { first: self.triangles.len(), triangles: corners.len() - 2 });
        }
        for pair in corners.windows(2).skip(1) {
            self.triangles.push([corners[0], pair[0], pair[1]]);
        }
    }

    /// Cuts concave polygons again, now that every vertex is known. Corners beyond the vertices are left to the mesh.
    pub(super) fn cut_polygons(&mut self) -> Crossing {
        let (mut crossing, mut spare) = (Crossing::default(), Vec::new());
        let mut cutter = Cutter::default();
        for fan in std::mem::take(&mut self.fans) {
            let triangles = &mut self.triangles[fan.first..fan.first + fan.triangles];
            let needed = cutter.cut(&self.vertices, triangles, &mut crossing);
            spare.extend(fan.first + needed..fan.first + fan.triangles);
        }
        let (mut spare, mut number) = (spare.into_iter().peekable(), 0..);
        self.triangles.retain(|_| spare.next_if_eq(&number.next().unwrap_or(0)).is_none());
        crossing
    }
}

#[derive(Default)]
struct Cutter {
    earcut: Earcut<f64>,
    corners: Vec<u32>,
    flat: Vec<[f64; 2]>,
    ears: Vec<u32>,
}

impl Cutter {
    /// Cuts a polygon again where its fan is wrong; how many of the triangles are needed then.
    fn cut(&mut self, vertices: &[DVec3], fan: &mut [[u32; 3]], crossing: &mut Crossing) -> usize {
        let point = |index: u32| vertices.get(index as usize).copied().filter(|point| point.is_finite());
        self.corners.clear();
        self.corners.extend([fan[0][0], fan[0][1]]);
        self.corners.extend(fan.iter().map(|triangle| triangle[2]));
        if self.corners.iter().any(|corner| point(*corner).is_none()) {
            return fan.len();
        }
        let at = |index: u32| vertices[index as usize] - vertices[fan[0][0] as usize];
        let twice: DVec3 = fan.iter().map(|[_, b, c]| at(*b).cross(at(*c))).sum();
        let doubled = twice.length();
        let spread: f64 = fan.iter().map(|[_, b, c]| at(*b).cross(at(*c)).length()).sum();
        if doubled <= 1e-12 * spread || doubled == 0.0 {
            // nothing, or a figure with parts that cancel
            if spread > 0.0 {
                crossing.add(0.5 * doubled, 0.5 * spread);
            }
            return fan.len();
        }
        let normal = twice / doubled;
        let turns_back = |[_, b, c]: &[u32; 3]| at(*b).cross(at(*c)).dot(normal) < -ROUNDING * doubled;
        if !fan.iter().any(turns_back) {
            return fan.len();
        }
        let (right, up) = normal.any_orthonormal_pair();
        self.flat.clear();
        self.flat.extend(self.corners.iter().map(|corner| [at(*corner).dot(right), at(*corner).dot(up)]));
        self.earcut.earcut(self.flat.iter().copied(), &[] as &[u32], &mut self.ears);
        let (ears, _) = self.ears.as_chunks::<3>();
        let read: f64 = ears.iter().map(|ear| doubled_area(ear.map(|n| self.flat[n as usize]))).sum();
        if (read - doubled).abs() > ROUNDING * doubled {
            crossing.add(0.5 * doubled, 0.5 * read);
        }
        // corners on a straight line need no triangle
        for (triangle, ear) in fan.iter_mut().zip(ears) {
            *triangle = ear.map(|n| self.corners[n as usize]);
        }
        ears.len()
    }
}

impl Crossing {
    fn add(&mut self, area: f64, read: f64) {
        self.polygons += 1;
        self.area += area;
        self.read += read;
    }
}

fn doubled_area([a, b, c]: [[f64; 2]; 3]) -> f64 {
    ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])).abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Area of the triangles of one polygon, and whether it crosses itself.
    fn cut(corners: &[[f64; 3]]) -> (f64, Crossing) {
        let mut soup =
            Soup { vertices: corners.iter().map(|at| DVec3::from(*at)).collect(), ..Soup::default() };
        let order: Vec<u32> = (0..corners.len() as u32).collect();
        soup.push_polygon(&order);
        let crossing = soup.cut_polygons();
        let corner = |index: u32| soup.vertices[index as usize];
        let area =
            |t: &[u32; 3]| 0.5 * (corner(t[1]) - corner(t[0])).cross(corner(t[2]) - corner(t[0])).length();
        (soup.triangles.iter().map(area).sum(), crossing)
    }

    #[test]
    fn concave_polygons_keep_their_area_whichever_corner_comes_first() {
        // a wall of 6 x 3 m with a doorway of 1 x 2.1 m, upright and leaning, far from the origin
        let wall = [[0., 0.], [2.5, 0.], [2.5, 2.1], [3.5, 2.1], [3.5, 0.], [6., 0.], [6., 3.], [0., 3.]];
        for first in 0..8 {
            for reversed in [false, true] {
                let mut corners: Vec<[f64; 3]> = (0..8)
                    .map(|n| wall[(first + n) % 8])
                    .map(|[y, z]| [4e5 + 0.6 * z, 5e6 + y, 3e2 + 0.8 * z])
                    .collect();
                if reversed {
                    corners.reverse();
                }
                let (area, crossing) = cut(&corners);
                assert!((area - 15.9).abs() < 1e-6, "from corner {first}: {area}");
                assert_eq!(crossing, Crossing::default());
            }
        }
    }

    #[test]
    fn a_star_a_comb_and_a_hole_on_a_seam() {
        let star: Vec<[f64; 3]> = (0..10)
            .map(|n| {
                let (angle, radius) =
                    (f64::from(n) * 0.2 * std::f64::consts::PI, if n % 2 == 0 { 2.0 } else { 0.8 });
                [radius * angle.cos(), radius * angle.sin(), 1.0]
            })
            .collect();
        let expected = 5.0 * 2.0 * 0.8 * (0.2 * std::f64::consts::PI).sin();
        let (area, crossing) = cut(&star);
        assert!((area - expected).abs() < 1e-9 && crossing.polygons == 0, "{area} {expected}");
        // a square of 4 with a hole of 2, joined by a seam that is gone along twice
        let ring = [
            [0., 0.],
            [4., 0.],
            [4., 4.],
            [0., 4.],
            [0., 0.],
            [1., 1.],
            [1., 3.],
            [3., 3.],
            [3., 1.],
            [1., 1.],
        ];
        let (area, crossing) = cut(&ring.map(|[x, y]| [x, y, 0.0]));
        assert!((area - 12.0).abs() < 1e-9 && crossing.polygons == 0, "{area} {crossing:?}");
    }

    #[test]
    fn what_crosses_itself_is_counted_with_both_areas() {
        let (_, crossing) = cut(&[[0., 0., 0.], [2., 2., 0.], [2., 0., 0.], [0., 2., 0.]]);
        assert_eq!((crossing.polygons, crossing.area), (1, 0.0));
        assert!(crossing.read > 0.0);
        assert_eq!(
            cut(&[[0., 0., 0.], [1., 0., 0.], [2., 0., 0.], [3., 0., 0.]]),
            (0.0, Crossing::default())
        );
    }
}
