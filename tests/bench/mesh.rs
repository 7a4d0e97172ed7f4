//! Rays per second through a mesh: `cargo bench --bench mesh -- FILE [X Y Z]`, one thread, median of several passes
//! over the fan of a 64 x 1024 sensor standing at a point, level and tilted; and the time to build the tree.

use std::time::Instant;

use glam::{DMat3, DVec3};
use outrigger::scene::{Mesh, load_mesh};

const PASSES: usize = 11;

fn main() {
    let words: Vec<String> = std::env::args().skip(1).filter(|word| word != "--bench").collect();
    let mesh = match words.first().map(String::as_str) {
        None | Some("hall") => hall(1_000_000),
        Some(path) => load_mesh(path.as_ref(), None, None).expect("a mesh file").mesh,
    };
    let centre_m = 0.5 * (mesh.bounds_m()[0] + mesh.bounds_m()[1]);
    let number = |index: usize| words.get(index).and_then(|word| word.parse::<f64>().ok());
    let at_m = match (number(1), number(2), number(3)) {
        (Some(x), Some(y), Some(z)) => DVec3::new(x, y, z),
        _ => centre_m,
    };
    println!("{} triangles, {:.1} MiB, from {at_m}", mesh.triangles(), mesh.bytes() as f64 / 1048576.0);
    for pitch_deg in [0.0_f64, 25.23] {
        let (origins, directions) = fan(at_m, pitch_deg.to_radians());
        let rays = directions.len() as f64;
        let mut single: Vec<f64> = Vec::new();
        let mut packets: Vec<f64> = Vec::new();
        let mut sums = [0.0, 0.0];
        for _ in 0..PASSES {
            let start = Instant::now();
            sums[0] = 0.0;
            for (origin, direction) in origins.iter().zip(&directions) {
                sums[0] += mesh.cast(*origin, *direction).map_or(0.0, |hit| hit.distance_m);
            }
            single.push(start.elapsed().as_secs_f64());
            let start = Instant::now();
            sums[1] = 0.0;
            mesh.cast_many(&origins, &directions, |_, hit| {
                sums[1] += hit.map_or(0.0, |hit| hit.distance_m);
            });
            packets.push(start.elapsed().as_secs_f64());
        }
        let nanoseconds = |times: &mut Vec<f64>| {
            times.sort_by(f64::total_cmp);
            times[PASSES / 2] / rays * 1e9
        };
        println!(
            "pitch {pitch_deg:5.2} deg: one by one {:6.1} ns/ray, in packets {:6.1} ns/ray (mean range {:.6} and {:.6} m)",
            nanoseconds(&mut single),
            nanoseconds(&mut packets),
            sums[0] / rays,
            sums[1] / rays
        );
    }
}

/// Tiles of 4 beams by 4 columns, as the scanners order them.
fn fan(at_m: DVec3, pitch_rad: f64) -> (Vec<DVec3>, Vec<DVec3>) {
    let (beams, columns) = (64_usize, 1024_usize);
    let turn = DMat3::from_rotation_y(pitch_rad);
    let mut directions = Vec::new();
    for column in (0..columns).step_by(4) {
        for beam in (0..beams).step_by(4) {
            for tile in 0..16 {
                let elevation = (-21.2 + 42.4 * (beam + tile % 4) as f64 / (beams - 1) as f64).to_radians();
                let azimuth = std::f64::consts::TAU * (column + tile / 4) as f64 / columns as f64;
                let (sin, cos) = azimuth.sin_cos();
                directions
                    .push(turn * DVec3::new(cos * elevation.cos(), sin * elevation.cos(), elevation.sin()));
            }
        }
    }
    (vec![at_m; directions.len()], directions)
}

/// A hall of bumpy floor, walls and ceiling and a forest of round pillars.
fn hall(triangles: usize) -> Mesh {
    let side = ((triangles as f64 / 2.0 / 14.0).sqrt()) as u32;
    let (mut vertices, mut faces) = (Vec::new(), Vec::new());
    let mut patch = |point: &dyn Fn(f64, f64) -> DVec3, nu: u32, nv: u32| {
        let first = vertices.len() as u32;
        for v in 0..=nv {
            for u in 0..=nu {
                vertices.push(point(f64::from(u) / f64::from(nu), f64::from(v) / f64::from(nv)));
            }
        }
        for v in 0..nv {
            for u in 0..nu {
                let corner = first + v * (nu + 1) + u;
                faces.push([corner, corner + 1, corner + nu + 2]);
                faces.push([corner, corner + nu + 2, corner + nu + 1]);
            }
        }
    };
    let bump = |u: f64, v: f64| 0.02 * (60.0 * u).sin() * (50.0 * v).cos();
    let size = DVec3::new(40.0, 20.0, 5.0);
    patch(&|u, v| DVec3::new(size.x * u, size.y * v, bump(u, v)), 2 * side, side);
    patch(&|u, v| DVec3::new(size.x * u, size.y * v, size.z + bump(v, u)), 2 * side, side);
    patch(&|u, v| DVec3::new(size.x * u, bump(u, v), size.z * v), 2 * side, side / 2);
    patch(&|u, v| DVec3::new(size.x * u, size.y + bump(u, v), size.z * v), 2 * side, side / 2);
    patch(&|u, v| DVec3::new(bump(u, v), size.y * u, size.z * v), side, side);
    patch(&|u, v| DVec3::new(size.x + bump(u, v), size.y * u, size.z * v), side, side);
    for pillar in 0..24 {
        let centre = DVec3::new(3.0 + 6.0 * f64::from(pillar % 6), 3.0 + 4.5 * f64::from(pillar / 6), 0.0);
        patch(
            &|u, v| {
                let (sin, cos) = (std::f64::consts::TAU * u).sin_cos();
                centre + DVec3::new(0.3 * cos, 0.3 * sin, size.z * v)
            },
            side / 2,
            side / 2,
        );
    }
    Mesh::new(vertices, faces).expect("a well-formed hall")
}
