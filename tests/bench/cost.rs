//! What a prediction costs: time with rays and with triangles, memory with the surface; and what a rig costs in the exact view,
//! with each set of instructions.
//!
//! `cargo bench --bench cost` prints tables and writes the same as pictures to `target/cost.html`.

mod hall;
mod support;

use std::sync::Arc;

use glam::DVec3;
use outrigger::base::geometry::Pose;
use outrigger::base::instructions::Instructions;
use outrigger::report::chart::{LineChart, Series};
use outrigger::rig::{Mount, MountedSensor, Rig, Unit};
use outrigger::simulate::view::{CastView, Precision, Sampling, Shades, View as _, ViewSite};
use outrigger::world::coverage::{Coverage, VoxelGrid};
use outrigger::world::scene::{Mesh, Scene};
use outrigger::world::trajectory::Trajectory;
use support::median_cpu_s;

const VOXEL_M: f64 = 0.1;
const STYLE: &str = "body{font:14px sans-serif;max-width:760px;margin:2em auto}text{font-size:12px;fill:#333!important;stroke:none!important}\
    .grid{stroke:#ccc;fill:none}.line{stroke:#1667a8;fill:none;stroke-width:2}.chart path{fill:none}\
    .s0{stroke:#1667a8;fill:none;stroke-width:2}.s1{stroke:#b5481d;fill:none;stroke-width:2}.s2{stroke:#2f7d4f;fill:none;stroke-width:2}";

fn main() {
    let charts = [vec![rays(), triangles(), memory()], views()].concat();
    let pictures: String =
        charts.iter().map(|chart| format!("<h2>{}</h2>{}", chart.title, chart.svg())).collect();
    let page =
        format!("<!doctype html><meta charset=utf-8><title>Cost</title><style>{STYLE}</style>{pictures}");
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/target/cost.html");
    std::fs::write(path, page).expect("target/ is there while its own bench runs");
    println!("pictures: target/cost.html");
}

fn mesh(triangles: usize) -> Mesh {
    let (vertices, faces) = hall::hall(triangles);
    Mesh::new(vertices, faces).expect("a well-formed hall")
}

/// Processor time of so many rays over the sphere, in tiles of neighbours.
fn cast(mesh: &Mesh, rays: usize) -> f64 {
    let at_m = DVec3::new(30.0, 20.5, 1.6);
    let direction = |n: usize| {
        // tiles of 4 by 4 neighbours of a grid over azimuth and elevation
        let side = (rays as f64).sqrt() as usize / 4 * 4;
        let (tile, inside) = (n / 16, n % 16);
        let (row, column) = (tile / (side / 4) * 4 + inside / 4, tile % (side / 4) * 4 + inside % 4);
        let azimuth = std::f64::consts::TAU * column as f64 / side as f64;
        let elevation = 0.7 * ((row as f64 + 0.5) / side as f64 - 0.5);
        DVec3::new(elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin())
    };
    let side = (rays as f64).sqrt() as usize / 4 * 4;
    let directions: Vec<DVec3> = (0..side * side).map(direction).collect();
    let origins = vec![at_m; directions.len()];
    let seconds = median_cpu_s(7, || {
        let mut hits = 0;
        mesh.cast_many(&origins, &directions, |_, hit| hits += usize::from(hit.is_some()));
        std::hint::black_box(hits);
    });
    seconds / directions.len() as f64 * rays as f64
}

fn rays() -> LineChart {
    let mesh = mesh(1_000_000);
    println!("rays through a hall of {} triangles", mesh.triangles());
    let mut points = Vec::new();
    for millions in [0.0625, 0.25, 0.5, 1.0, 2.0, 4.0] {
        let seconds = cast(&mesh, (millions * 1e6) as usize);
        println!(
            "  {millions:7.4} M rays: {:8.1} ms, {:6.1} ns/ray",
            1e3 * seconds,
            1e3 * seconds / millions
        );
        points.push([millions, 1e3 * seconds]);
    }
    chart("Time grows with rays", "rays, million", "processor time, ms", points)
}

/// Where triangles are smaller than what lies between two rays, neighbours no longer meet the same ones: what they share
/// fades, and the curve of few rays bends up sooner than that of many.
fn triangles() -> LineChart {
    const RAYS: [(&str, usize); 2] = [("0.25 M rays", 250_000), ("2 M rays", 2_000_000)];
    println!("rays through halls, ns for {} and for {}", RAYS[0].0, RAYS[1].0);
    let mut series = RAYS.map(|(name, _)| Series { name: name.into(), points: Vec::new() });
    for power in 12..=22 {
        let mesh = mesh(1 << power);
        let ns = RAYS.map(|(_, rays)| cast(&mesh, rays) / rays as f64 * 1e9);
        println!(
            "  {:8} triangles: {:6.1} {:6.1} ns/ray, {:6.1} bytes/triangle",
            mesh.triangles(),
            ns[0],
            ns[1],
            mesh.bytes() as f64 / mesh.triangles() as f64
        );
        for (series, ns) in series.iter_mut().zip(ns) {
            series.points.push([(mesh.triangles() as f64).log2(), ns]);
        }
    }
    LineChart {
        series: series.into(),
        ..chart(
            "Time grows with the logarithm of the triangles",
            "log2 of triangles",
            "ns per ray",
            Vec::new(),
        )
    }
}

/// A yard with a wall around it: every brick of its surface is touched.
fn memory() -> LineChart {
    println!("coverage of a walled yard in voxels of {VOXEL_M} m");
    let mut points = Vec::new();
    for side_m in [50.0, 100.0, 200.0, 400.0, 700.0, 1000.0] {
        let bounds_m = [DVec3::ZERO, DVec3::new(side_m, side_m, 30.0)];
        let mut coverage = Coverage::new(VoxelGrid::centred_on(bounds_m, VOXEL_M), 1);
        // twice as dense as bricks of eight cells
        let step_m = 4.0 * VOXEL_M;
        let (along, up) = ((side_m / step_m) as u32, (30.0 / step_m) as u32);
        for i in 0..=along {
            let u = f64::from(i) * step_m;
            (0..=along).for_each(|j| coverage.add(0, DVec3::new(u, f64::from(j) * step_m, 0.0)));
            for z in (0..=up).map(|k| f64::from(k) * step_m) {
                for point in [[u, 0.0, z], [u, side_m, z], [0.0, u, z], [side_m, u, z]] {
                    coverage.add(0, point.into());
                }
            }
        }
        let surface_m2 = side_m * side_m + 4.0 * 30.0 * side_m;
        let (mib, whole_mib) = (
            coverage.bytes() as f64 / f64::from(1 << 20),
            coverage.grid().len() as f64 / 8.0 / f64::from(1 << 20),
        );
        println!(
            "  {side_m:5.0} m: {mib:8.1} MiB, {:5.1} bytes/m2 of surface (a whole bitmap: {whole_mib:9.1} MiB)",
            coverage.bytes() as f64 / surface_m2
        );
        points.push([surface_m2 / 1e4, mib]);
    }
    chart("Memory grows with the surface", "surface, hectares", "MiB", points)
}

/// A rig in the exact view of a hall.
#[derive(Clone, Copy)]
struct Case {
    triangles: usize,
    walk_m: f64,
    sensors: usize,
    voxel_m: f64,
}

impl Case {
    const USUAL: Self = Self { triangles: 100_000, walk_m: 50.0, sensors: 2, voxel_m: 0.1 };

    /// Rays, and seconds of one thread with each set of instructions.
    fn measure(&self) -> (u64, Vec<f64>) {
        let scene = Scene::Mesh(Arc::new(mesh(self.triangles)));
        let unit = Unit::nominal("os1-64").expect("a model");
        let sensor = |at: usize| {
            let x_m = 0.1 * (at as f64 - 0.5 * (self.sensors - 1) as f64);
            let mount = Mount { x_m, pitch_rad: 4.0 * x_m, ..Mount::default() };
            MountedSensor { name: at.to_string(), model: unit.model.clone(), mount }
        };
        let rig = Rig { sensors: (0..self.sensors).map(sensor).collect() };
        let grid = VoxelGrid::centred_on(scene.bounds_m(), self.voxel_m);
        let site =
            ViewSite { grid, scene, trajectory: back_and_forth(self.walk_m), shades: Shades::default() };
        let sampling = Sampling { is_ideal: true, columns: Some(512), scan_stride: 4, ..Sampling::default() };
        let thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
        let mut rays = 0;
        let seconds = Instructions::available().into_iter().map(|instructions| {
            let view = CastView::new(site.clone(), std::slice::from_ref(&unit), &sampling, Precision::Single);
            let view = view.expect("a view").with_instructions(instructions);
            thread.install(|| median_cpu_s(1, || rays = view.see(std::slice::from_ref(&rig))[0].rays))
        });
        let seconds = seconds.collect();
        (rays, seconds)
    }
}

/// At 1 m/s through the hall, 50 m to and fro.
fn back_and_forth(walk_m: f64) -> Trajectory {
    let legs = (walk_m / 50.0).ceil().max(1.0) as u64;
    let leg_m = walk_m / legs as f64;
    let corner = |at: u64| {
        let at_m = DVec3::new(5.0 + leg_m * (at % 2) as f64, 8.0 + 24.0 * at as f64 / 20.0, 1.6);
        (at * (leg_m * 1e9) as u64, Pose { translation_m: at_m, ..Pose::IDENTITY })
    };
    Trajectory::new((0..=legs).map(corner).collect()).expect("a walk")
}

fn views() -> Vec<LineChart> {
    let usual = Case::USUAL;
    let triangles = [13, 15, 17, 20].map(|power| (f64::from(power), Case { triangles: 1 << power, ..usual }));
    let over = |title: &str, label: &str, cases: Vec<(f64, Case)>| {
        println!("{title}: OS1-64, 512 columns, one revolution in four, one thread");
        // the name of the level alone
        let name = |instructions| {
            let words = format!("{instructions:?}");
            words.trim_start_matches("Instructions(").trim_end_matches(')').to_owned()
        };
        let names = Instructions::available().into_iter().map(name);
        let mut series: Vec<Series> = names.map(|name| Series { name, points: Vec::new() }).collect();
        for (at, case) in cases {
            let (rays, seconds) = case.measure();
            let each: Vec<String> = series
                .iter()
                .zip(&seconds)
                .map(|(series, s)| format!("{} {s:.2} s, {:.1} M rays/s", series.name, rays as f64 / s / 1e6))
                .collect();
            println!("  {at:7} {label}: {:6.1} M rays, {}", rays as f64 / 1e6, each.join("; "));
            series.iter_mut().zip(seconds).for_each(|(series, s)| series.points.push([at, s]));
        }
        LineChart { series, ..chart(title, label, "processor time, s", Vec::new()) }
    };
    vec![
        over("The exact view by triangles", "log2 of triangles", triangles.into()),
        over(
            "The exact view by the walk",
            "m walked",
            [10.0, 50.0, 200.0, 500.0, 1000.0].map(|walk_m| (walk_m, Case { walk_m, ..usual })).into(),
        ),
        over(
            "The exact view by sensors",
            "sensors",
            [1, 2, 4, 8].map(|sensors| (sensors as f64, Case { sensors, ..usual })).into(),
        ),
        over(
            "The exact view by voxels",
            "m edge of a voxel",
            [0.05, 0.1, 0.2, 0.5].map(|voxel_m| (voxel_m, Case { voxel_m, ..usual })).into(),
        ),
    ]
}

fn chart(title: &str, x_label: &str, y_label: &str, points: Vec<[f64; 2]>) -> LineChart {
    LineChart {
        title: title.into(),
        x_label: x_label.into(),
        y_label: y_label.into(),
        series: vec![Series { name: String::new(), points }],
        ..LineChart::default()
    }
}
