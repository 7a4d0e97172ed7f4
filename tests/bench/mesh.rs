//! Rays through a mesh with their voxels counted, beside Open3D (Embree) with numpy; what a pair in a house takes the exact
//! view of a search; and the surface completeness of that house.
//!
//! `cargo bench --bench mesh` prints processor time per ray of this program and of Open3D on one thread each, all from
//! one run, and the median of the ratios. Open3D is asked through the interpreter that `PYTHON` names (`python3`
//! otherwise); without it its columns say none. The house lies in the folder that `OUTRIGGER_SHARED` names (default
//! `../shared`); without it what needs it is named as left out.

mod hall;
mod support;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use glam::{DMat3, DVec3};
use outrigger::base::instructions::Instructions;
use outrigger::rig::{Mount, MountedSensor, Rig, Unit};
use outrigger::simulate::fan::BeamFan;
use outrigger::simulate::view::{CastView, Precision, Sampling, Shades, View as _, ViewSite};
use outrigger::world::coverage::{Coverage, VoxelGrid};
use outrigger::world::scene::{Mesh, Scene, load_mesh};
use outrigger::world::surface::{Completeness, SurfaceSamples, THRESHOLDS_M};
use outrigger::world::trajectory::Trajectory;
use support::{median, median_cpu_s};

const BEAMS: usize = 64;
const COLUMNS: usize = 1024;
const VOXEL_M: f64 = 0.1;

fn main() {
    println!("64 x 1024 rays from a point, voxels of {VOXEL_M} m counted; processor time on one thread");
    let (vertices, faces) = hall::hall(1_000_000);
    // no stand lies in a plane of the mesh: through a shared edge Embree's rays may leak
    let stands = [[30.03, 20.02, 1.61], [12.04, 5.53, 1.62], [50.02, 33.03, 1.23]];
    compare("hall of a million", vertices, faces, &stands);
    let shared = PathBuf::from(std::env::var_os("OUTRIGGER_SHARED").unwrap_or("../shared".into()));
    let house = shared.join("scenes/house.ply");
    if !house.exists() {
        println!("LEFT OUT: the house (no {})", house.display());
        return;
    }
    let (vertices, faces) = read_ply(&house);
    let cast_ns =
        compare("house", vertices, faces, &[[0.03, 0.02, 1.51], [2.04, 1.03, 1.62], [-3.02, 0.53, 1.23]]);
    let walk = std::fs::read(shared.join("reference/validation/house_trajectory.tum")).expect("its walk");
    let walk = Trajectory::read(&walk, None).expect("a trajectory").trajectory;
    let mesh = load_mesh(&house, None, None).expect("the house").mesh;
    cast_view(&mesh, &walk, cast_ns);
    completeness(mesh, &walk);
}

/// A pair in the house as a search casts it, on one thread; `peer_ns` is what a ray took Open3D, voxels not counted.
fn cast_view(mesh: &Mesh, walk: &Trajectory, peer_ns: Option<f64>) {
    let scene = Scene::Mesh(Arc::new(mesh.clone()));
    let grid = VoxelGrid::centred_on(scene.bounds_m(), VOXEL_M);
    let site = ViewSite { grid, scene, trajectory: walk.clone(), shades: Shades::default() };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    for model in ["vlp-16", "os1-64"] {
        let unit = Unit::nominal(model).expect("a model");
        for (columns, scan_stride) in [(512, 4), (1024, 1)] {
            let sampling = Sampling {
                is_ideal: true,
                columns: Some(columns),
                scan_stride,
                min_range_m: Some(0.3),
                ..Sampling::default()
            };
            let view = CastView::new(site.clone(), std::slice::from_ref(&unit), &sampling, Precision::Single)
                .expect("a view");
            let sensor =
                |name: &str, mount| MountedSensor { name: name.into(), model: unit.model.clone(), mount };
            let rig =
                Rig { sensors: vec![sensor("master", master()), sensor("mirrored", master().mirrored())] };
            let mut seen = Vec::new();
            let seconds = pool.install(|| median_cpu_s(3, || seen = view.see(std::slice::from_ref(&rig))));
            let (rays, union) = (seen[0].rays, seen[0].union);
            let ns = seconds / rays as f64 * 1e9;
            print!(
                "CastView, two {model}, {columns} columns, one revolution in {scan_stride}: {rays} rays, {union} voxels, {seconds:.2} \
                 s, {:.1} million rays/s",
                1e3 / ns
            );
            match peer_ns {
                Some(peer_ns) => println!(", ratio to Open3D's casting {:.2}", peer_ns / ns),
                None => println!(),
            }
        }
    }
}

/// Open3D's nanoseconds per ray, the median over the stands; none without it.
fn compare(name: &str, vertices: Vec<DVec3>, faces: Vec<[u32; 3]>, stands: &[[f64; 3]]) -> Option<f64> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("mesh.bin");
    std::fs::write(&file, as_bytes(&vertices, &faces)).expect("a file in it");
    let start = Instant::now();
    let mesh = Mesh::new(vertices, faces).expect("a well-formed mesh");
    println!(
        "{name}: {} triangles, {:.0} MiB, tree built in {:.1} s",
        mesh.triangles(),
        mesh.bytes() as f64 / f64::from(1 << 20),
        start.elapsed().as_secs_f64()
    );
    let (mut ratios, mut peer_ns) = (Vec::new(), Vec::new());
    for at in stands {
        for pitch_deg in [0.0_f64, 25.23] {
            let (origins, directions) = fan(DVec3::from(*at), pitch_deg.to_radians());
            let (ns, voxels, mean_m) = ours(&mesh, &origins, &directions);
            let words = [at[0], at[1], at[2], pitch_deg].map(|number| number.to_string());
            let mut arguments = vec![file.display().to_string(), VOXEL_M.to_string()];
            arguments.extend(words);
            let peer = support::python("mesh_open3d.py", &arguments).map(|text| {
                let n: Vec<f64> = text.split_whitespace().filter_map(|word| word.parse().ok()).collect();
                assert!(
                    (n[3] - mean_m).abs() < 1e-3,
                    "Open3D's rays end after {} m, ours after {mean_m}",
                    n[3]
                );
                let more = (n[2] - voxels as f64).abs() / n[2];
                assert!(more < 1e-3, "Open3D's rays hit {} voxels, ours {voxels}", n[2]);
                [n[0], n[1]]
            });
            print!("  from {at:?} m, pitch {pitch_deg:5.2} deg: {ns:6.1} ns/ray");
            match peer {
                Some([cast_ns, all_ns]) => {
                    println!(
                        ", Open3D {cast_ns:.1} + {:.1} to count, ratio {:.2} without counting its voxels, {:.2} with",
                        all_ns - cast_ns,
                        cast_ns / ns,
                        all_ns / ns
                    );
                    ratios.push([cast_ns / ns, all_ns / ns]);
                    peer_ns.push(cast_ns);
                }
                None => println!(", Open3D none"),
            }
        }
    }
    if !ratios.is_empty() {
        let of = |at: usize| median(ratios.iter().map(|ratio| ratio[at]).collect());
        println!("  median ratio: {:.2}, with numpy's counting {:.2}", of(0), of(1));
    }
    (!peer_ns.is_empty()).then(|| median(peer_ns))
}

/// Nanoseconds per ray with its voxel, voxels, and mean range.
fn ours(mesh: &Mesh, origins: &[DVec3], directions: &[DVec3]) -> (f64, u64, f64) {
    let grid = VoxelGrid::centred_on(mesh.bounds_m(), VOXEL_M);
    let mut coverage = Coverage::new(grid, 1);
    let (mut sum_m, mut hits) = (0.0, 0);
    let mut cast = || {
        (sum_m, hits) = (0.0, 0);
        mesh.cast_many_with(Instructions::best(), origins, directions, |ray, hit| {
            if let Some(hit) = hit {
                sum_m += hit.distance_m;
                hits += 1;
                coverage.add(0, origins[ray] + hit.distance_m * directions[ray]);
            }
        });
    };
    let seconds = median_cpu_s(11, &mut cast);
    (seconds / origins.len() as f64 * 1e9, coverage.union_count(), sum_m / f64::from(hits))
}

/// Tiles of 4 beams by 4 columns, as the scanners order them.
fn fan(at_m: DVec3, pitch_rad: f64) -> (Vec<DVec3>, Vec<DVec3>) {
    let turn = DMat3::from_rotation_y(pitch_rad);
    let mut directions = Vec::new();
    for column in (0..COLUMNS).step_by(4) {
        for beam in (0..BEAMS).step_by(4) {
            for tile in 0..16 {
                let elevation = (-21.2 + 42.4 * (beam + tile % 4) as f64 / (BEAMS - 1) as f64).to_radians();
                let azimuth = std::f64::consts::TAU * (column + tile / 4) as f64 / COLUMNS as f64;
                let (sin, cos) = azimuth.sin_cos();
                directions
                    .push(turn * DVec3::new(cos * elevation.cos(), sin * elevation.cos(), elevation.sin()));
            }
        }
    }
    (vec![at_m; directions.len()], directions)
}

/// Two counts (u64), vertices (f32), triangles (u32), little-endian.
fn as_bytes(vertices: &[DVec3], faces: &[[u32; 3]]) -> Vec<u8> {
    let mut bytes = Vec::new();
    bytes.extend([vertices.len() as u64, faces.len() as u64].iter().flat_map(|n| n.to_le_bytes()));
    bytes.extend(vertices.iter().flat_map(|v| v.as_vec3().to_array()).flat_map(f32::to_le_bytes));
    bytes.extend(faces.iter().flatten().flat_map(|index| index.to_le_bytes()));
    bytes
}

/// The house's own layout: binary, three floats a vertex, a count byte and three indices a face.
fn read_ply(path: &Path) -> hall::Soup {
    let ply = std::fs::read(path).expect("a readable file");
    let header_end = ply.windows(11).position(|window| window == b"end_header\n").expect("a PLY header") + 11;
    let header = String::from_utf8_lossy(&ply[..header_end]).into_owned();
    let count = |name: &str| -> usize {
        let line = header.lines().find_map(|line| line.strip_prefix(&format!("element {name} ")));
        line.and_then(|number| number.trim().parse().ok()).expect("a count in the header")
    };
    let (vertices, faces) = (count("vertex"), count("face"));
    let word = |at: usize| [ply[at], ply[at + 1], ply[at + 2], ply[at + 3]];
    let vertex = |v: usize| {
        DVec3::from([0, 4, 8].map(|byte| f64::from(f32::from_le_bytes(word(header_end + 12 * v + byte)))))
    };
    let faces_at = header_end + 12 * vertices;
    let face = |f: usize| [1, 5, 9].map(|byte| u32::from_le_bytes(word(faces_at + 13 * f + byte)));
    ((0..vertices).map(vertex).collect(), (0..faces).map(face).collect())
}

/// One sensor of the pair.
fn master() -> Mount {
    Mount { x_m: 0.05, z_m: 0.1, pitch_rad: 25.23_f64.to_radians(), ..Mount::default() }
}

/// Two OS1-64 carried through the house: 51 million rays against a million samples, on two threads.
fn completeness(mesh: Mesh, walk: &Trajectory) {
    let samples = SurfaceSamples::of_mesh(&mesh, 1_000_000, 0);
    let scene = Scene::Mesh(Arc::new(mesh));
    let mut fan = BeamFan::nominal(&sensors::catalogue::nominal("os1-64").expect("a model"), COLUMNS, 10.0);
    fan.min_range_m = 0.3;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("two threads");
    let (mut wall_s, mut cpu_s, mut found) = (Vec::new(), Vec::new(), (0, 0.0));
    for _ in 0..3 {
        let (wall, cpu) = (Instant::now(), support::process_cpu_s());
        pool.install(|| {
            let mut completeness = Completeness::new(&samples, &THRESHOLDS_M);
            let rays = fan.cover(&scene, walk, &[master(), master().mirrored()], 1, &mut completeness);
            found = (rays, completeness.shares()[1]);
        });
        wall_s.push(wall.elapsed().as_secs_f64());
        cpu_s.push(support::process_cpu_s() - cpu);
    }
    println!(
        "completeness of the house at 5 cm: {:.4} with {} rays, {:.1} s on two threads, {:.1} s of processor time (medians of 3)",
        found.1,
        found.0,
        median(wall_s),
        median(cpu_s)
    );
}
