//! A procedural hall: displaced floor, walls and ceiling, round columns, shelves of uneven goods.

use std::f64::consts::TAU;

use glam::DVec3;

/// Vertices and triangles.
pub type Soup = (Vec<DVec3>, Vec<[u32; 3]>);

/// Of about so many triangles, 60 x 40 x 8 m.
pub fn hall(triangles: usize) -> Soup {
    let mut soup = (Vec::new(), Vec::new());
    // what is built below from n: 56 n^2 triangles
    let n = ((triangles as f64 / 56.0).sqrt().ceil() as u32).max(8);
    let bump = |u: f64, v: f64| 0.02 * (61.0 * u).sin() * (53.0 * v).cos();
    let size = DVec3::new(60.0, 40.0, 8.0);
    patch(&mut soup, 3 * n, 2 * n, |u, v| DVec3::new(size.x * u, size.y * v, bump(u, v)));
    patch(&mut soup, 2 * n, n, |u, v| DVec3::new(size.x * u, size.y * v, size.z + bump(v, u)));
    for y in [0.0, size.y] {
        patch(&mut soup, 2 * n, n / 2, |u, v| DVec3::new(size.x * u, y + bump(u, v), size.z * v));
    }
    for x in [0.0, size.x] {
        patch(&mut soup, 2 * n, n / 2, |u, v| DVec3::new(x + bump(u, v), size.y * u, size.z * v));
    }
    for column in 0..24 {
        let (i, j) = (f64::from(column % 6), f64::from(column / 6));
        let foot = DVec3::new(5.0 + 10.0 * i, 5.0 + 10.0 * j, 0.0);
        patch(&mut soup, n / 2, n / 2, |u, v| {
            let (sin, cos) = (TAU * u).sin_cos();
            foot + DVec3::new(0.3 * cos, 0.3 * sin, size.z * v)
        });
    }
    for shelf in 0..40 {
        let (row, board) = (f64::from(shelf / 5), f64::from(shelf % 5));
        patch(&mut soup, n, n / 4, |u, v| {
            let goods = 0.15 * (1.0 + (90.0 * u + row).sin() * (9.0 * v).sin());
            DVec3::new(8.0 + 44.0 * u, 2.0 + 5.0 * row + v, 0.4 + 0.9 * board + goods)
        });
    }
    soup
}

fn patch((vertices, faces): &mut Soup, columns: u32, rows: u32, point: impl Fn(f64, f64) -> DVec3) {
    let first = vertices.len() as u32;
    for row in 0..=rows {
        for column in 0..=columns {
            let share = |at: u32, of: u32| f64::from(at) / f64::from(of);
            vertices.push(point(share(column, columns), share(row, rows)));
        }
    }
    for row in 0..rows {
        for column in 0..columns {
            let corner = first + row * (columns + 1) + column;
            let above = corner + columns + 1;
            faces.push([corner, corner + 1, above + 1]);
            faces.push([corner, above + 1, above]);
        }
    }
}
