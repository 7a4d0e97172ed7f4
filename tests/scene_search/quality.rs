//! Range, angle of incidence and number of returns: views against a count by hand, and the verbs that take them.

use std::collections::HashMap;
use std::sync::Arc;

use glam::DVec3;
use outrigger::rig::{Rig, Unit};
use outrigger::simulate::fan::BeamFan;
use outrigger::simulate::view::{
    CastView, CellView, Fineness, Precision, Quality, Sampling, Shades, View as _, ViewSite,
};
use outrigger::world::coverage::VoxelGrid;
use outrigger::world::scene::{Mesh, Scene};
use outrigger::world::trajectory::Trajectory;

use crate::optimize::command::{json, outrigger};

const LOW_M: DVec3 = DVec3::new(-6.0, -4.0, 0.0);
const HIGH_M: DVec3 = DVec3::new(6.0, 4.0, 3.0);
const EYE_M: DVec3 = DVec3::new(0.0, 0.0, 1.5);
const COLUMNS: u32 = 120;

/// A closed room, and a rig that stands in its middle for ten revolutions.
fn room() -> ViewSite {
    let scene = Scene::Mesh(Arc::new(Mesh::of_boxes(&[[LOW_M, HIGH_M]]).unwrap()));
    ViewSite {
        grid: VoxelGrid::centred_on(scene.bounds_m(), 0.2),
        scene,
        trajectory: Trajectory::read("0 0 0 1.5 0 0 0 1\n1 0 0 1.5 0 0 0 1\n".as_bytes(), None)
            .unwrap()
            .trajectory,
        shades: Shades::default(),
    }
}

fn sampling(quality: Quality) -> Sampling {
    Sampling {
        is_ideal: true,
        columns: Some(COLUMNS),
        min_range_m: Some(0.3),
        quality,
        ..Sampling::default()
    }
}

fn pair(model: &str) -> Rig {
    super::rig(model, &[0.1, 0.05, -0.1, 25.0, 5.0], 2)
}

/// Voxels that count, from the points that every beam meets.
fn by_hand(site: &ViewSite, rig: &Rig, quality: Quality) -> Vec<usize> {
    let mut hits: HashMap<usize, u32> = HashMap::new();
    for sensor in &rig.sensors {
        let mut fan = BeamFan::nominal(&sensor.model, COLUMNS as usize, 10.0);
        fan.min_range_m = 0.3;
        fan.max_range_m = quality.max_range_m.unwrap_or(fan.max_range_m);
        let mount = sensor.mount;
        // x right, y forward
        let eye_m = EYE_M + DVec3::new(mount.y_m, -mount.x_m, mount.z_m);
        for scan in 0..fan.scans(&site.trajectory) {
            fan.cast_scan(&site.scene, &site.trajectory, &mount, scan, |hit_m| {
                let wall = (0..3)
                    .min_by(|a, b| {
                        let off_m = |axis: &usize| {
                            (hit_m[*axis] - LOW_M[*axis]).abs().min((hit_m[*axis] - HIGH_M[*axis]).abs())
                        };
                        off_m(a).total_cmp(&off_m(b))
                    })
                    .unwrap();
                let angle_deg = (hit_m - eye_m).normalize()[wall].abs().acos().to_degrees();
                if quality.max_incidence_deg.is_none_or(|limit_deg| angle_deg <= limit_deg) {
                    let cell = (hit_m - site.grid.origin_m) / site.grid.voxel_m;
                    let [nx, ny, _] = site.grid.cells;
                    *hits
                        .entry(cell.x as usize + nx * (cell.y as usize + ny * cell.z as usize))
                        .or_default() += 1;
                }
            });
        }
    }
    let enough = |(cell, count): (usize, u32)| (count >= u32::from(quality.min_hits)).then_some(cell);
    hits.into_iter().filter_map(enough).collect()
}

fn qualities() -> [Quality; 5] {
    let any = Quality::default();
    [
        any,
        Quality { max_range_m: Some(5.0), ..any },
        Quality { max_incidence_deg: Some(50.0), ..any },
        Quality { min_hits: 25, ..any },
        Quality { max_range_m: Some(4.5), max_incidence_deg: Some(65.0), min_hits: 11 },
    ]
}

pub fn views_count_as_by_hand() {
    let site = room();
    for model in ["vlp-16", "os0-32"] {
        let rig = pair(model);
        for quality in qualities() {
            let expected = by_hand(&site, &rig, quality);
            let mut seen = Vec::new();
            for (precision, may_differ) in [(Precision::Double, 0), (Precision::Single, 12)] {
                let units = [Unit::nominal(model).unwrap()];
                let view = CastView::new(site.clone(), &units, &sampling(quality), precision).unwrap();
                let coverage = view.cover(&rig);
                let is_seen = |cell: &usize| coverage.contains(0, *cell) || coverage.contains(1, *cell);
                let missing = expected.iter().filter(|cell| !is_seen(cell)).count();
                let more = coverage.union_count() as usize + missing - expected.len();
                assert!(
                    missing + more <= may_differ,
                    "{model} {quality:?} {precision:?}: {missing} missing, {more} too many of {}",
                    expected.len()
                );
                seen.push(coverage.union_count());
            }
            assert!(expected.len() > 20, "{quality:?}: {}", expected.len());
        }
    }
}

/// Walls that are farther than the limit are not seen, and the floor only where it is met squarely enough.
pub fn limits_cut_where_they_should() {
    let site = room();
    let units = [Unit::nominal("os0-128").unwrap()];
    let level = super::rig("os0-128", &[0.0, 0.0, 0.0, 0.0, 0.0], 1);
    let places_m = |quality: Quality| -> Vec<DVec3> {
        let view = CastView::new(site.clone(), &units, &sampling(quality), Precision::Single).unwrap();
        let coverage = view.cover(&level);
        let [nx, ny, nz] = site.grid.cells;
        let cells = (0..nx * ny * nz).filter(|cell| coverage.contains(0, *cell));
        cells
            .map(|cell| {
                let at = [cell % nx, cell / nx % ny, cell / (nx * ny)].map(|at| at as f64 + 0.5);
                site.grid.origin_m + site.grid.voxel_m * DVec3::from(at)
            })
            .collect()
    };
    let at_the_end = |places_m: &[DVec3]| places_m.iter().filter(|at_m| at_m.x > 5.95).count();
    let near = Quality { max_range_m: Some(5.5), ..Quality::default() };
    assert!(at_the_end(&places_m(Quality::default())) > 100);
    assert_eq!(at_the_end(&places_m(near)), 0, "the wall at 6 m is beyond 5.5 m");
    for limit_deg in [55.0_f64, 62.0] {
        let limited = Quality { max_incidence_deg: Some(limit_deg), ..Quality::default() };
        // no walls
        let on_the_floor = |at_m: &&DVec3| at_m.z < 0.05 && at_m.x.abs() < 5.85 && at_m.y.abs() < 3.85;
        let out_m = |at_m: &DVec3| at_m.x.hypot(at_m.y);
        let farthest_m = places_m(limited).iter().filter(on_the_floor).map(out_m).fold(0.0, f64::max);
        let expected_m = 1.5 * limit_deg.to_radians().tan();
        assert!((farthest_m - expected_m).abs() < 0.15, "{limit_deg}: {farthest_m} m, not {expected_m} m");
    }
}

/// What the model says of limits before it is corrected, of a rig that walks: it takes revolutions to start anywhere.
pub fn the_model_knows_the_limits() {
    let walk =
        Trajectory::read("0 -3 -1 1.5 0 0 0 1\n8 3 1 1.5 0 0 0 1\n".as_bytes(), None).unwrap().trajectory;
    let site = ViewSite { trajectory: walk, ..room() };
    let units = [Unit::nominal("os0-32").unwrap()];
    let rig = pair("os0-32");
    let mut all = None;
    for quality in qualities() {
        let sampling = sampling(quality);
        let model = CellView::new(&site, &units, &sampling, &Fineness::between((-0.15, 0.15))).unwrap();
        let exact = CastView::new(site.clone(), &units, &sampling, Precision::Single).unwrap();
        let rigs = std::slice::from_ref(&rig);
        let (expected, seen) = (exact.see(rigs).remove(0), model.see(rigs).remove(0));
        let off = seen.union / expected.union - 1.0;
        assert!(off.abs() < 0.1, "{quality:?}: {} by the model, {} exactly", seen.union, expected.union);
        // what can be seen has the same limits of range and angle
        let observable = [model.observable(), exact.observable()];
        let all = *all.get_or_insert(observable);
        let is_limited = (quality.max_range_m, quality.max_incidence_deg) != (None, None);
        for (found, all) in observable.into_iter().zip(all) {
            assert!(found as f64 > 0.97 * expected.union, "{quality:?} {found} {}", expected.union);
            assert_eq!(found < all, is_limited, "{quality:?} {found} {all}");
        }
    }
}

const PLACE: [&str; 7] =
    ["--room=-6,-4,0,6,4,3", "--trajectory", "-3,0 3,0 3,2", "--voxel", "0.5", "--azimuths", "120"];
const LIMITS: [&str; 6] = ["--max-range", "5", "--max-incidence", "60", "--min-hits", "4"];

pub fn the_search_and_the_prediction_count_alike() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (mount, state, page) = (path("mount.json"), path("state.json"), path("page.html"));
    let flags = ["--ideal", "--scan-stride", "3"];
    let search = ["optimize", "--sensors", "vlp-16,vlp-16", "--evals", "60", "--resume", &state];
    let files = ["--json", "-o", &mount, "--report", &page];
    let found = json(&[&search[..], &PLACE, &flags, &LIMITS, &files].concat());
    let quality = serde_json::json!({ "max_range_m": 5.0, "max_incidence_deg": 60.0, "min_hits": 4 });
    assert_eq!(found["sampling"]["quality"], quality);
    assert!(std::fs::read_to_string(&page).unwrap().contains("4 returns, at 60°"));
    let again = json(&[&["predict", "--json", "--mount", &mount][..], &PLACE, &flags, &LIMITS].concat());
    assert_eq!(again["quality"], quality);
    assert_eq!(again["unique_voxels"], found["best"]["unique_voxels"]);
    let all = json(&[&["predict", "--json", "--mount", &mount][..], &PLACE, &flags].concat());
    assert!(all["unique_voxels"].as_u64() > again["unique_voxels"].as_u64());
    assert!(all["reachable_voxels"].as_u64() > again["reachable_voxels"].as_u64());
    assert_eq!(all.get("quality"), None);
    // another question is another search
    let output = outrigger(&[&search[..], &PLACE, &flags, &LIMITS[..4]].concat());
    let words = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(2) && words.contains("quality"), "{words}");
    // real sensors are counted the same way
    let real = |more: &[&str]| {
        let flags = ["predict", "--json", "--fidelity", "given", "--mount", &mount];
        json(&[&flags[..], &PLACE, more].concat())["unique_voxels"].as_u64().unwrap()
    };
    assert!(real(&LIMITS) < real(&LIMITS[..4]) && real(&LIMITS[..4]) < real(&[]));
}

pub fn a_map_has_no_normals() {
    let folder = tempfile::tempdir().unwrap();
    let cloud = folder.path().join("cloud.xyz");
    let points = (0..400).map(|n| format!("{} {} 0\n", 0.1 * f64::from(n % 20), 0.1 * f64::from(n / 20)));
    std::fs::write(&cloud, points.collect::<String>()).unwrap();
    let place =
        ["--scene", cloud.to_str().unwrap(), "--trajectory", "0.5,0.5,1 1,1,1", "--sensors", "vlp-16"];
    for verb in ["optimize", "predict"] {
        let output = outrigger(&[&[verb, "--max-incidence", "60"][..], &place].concat());
        let words = String::from_utf8_lossy(&output.stderr);
        assert!(
            output.status.code() == Some(2) && words.contains("--max-incidence") && words.contains("mesh"),
            "{verb}: {words}"
        );
    }
}
