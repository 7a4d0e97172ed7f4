//! How often a healthy walk is called one that differs, and how often a fault is found, over many simulated walks: minutes, so
//! it runs only when asked for.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::DVec3;
use outrigger::base::rng::Rng;
use outrigger::rig::MountedSensor;
use outrigger::simulate::frames::{Scan, Spin};
use outrigger::verify::compare::{Gate, Healthy, Patches, Replay};
use outrigger::verify::judgement::comparison::{Comparison, Verdict};
use outrigger::verify::judgement::judge::{Inputs, judge};
use outrigger::world::coverage::VoxelGrid;
use outrigger::world::local_origin::LocalOrigin;
use outrigger::world::scene::{Mesh, Scene, VoxelMap};
use outrigger::world::trajectory::{PoseError, Trajectory};
use rayon::prelude::*;
use sensors::Frame;
use sensors::projection::{returns, sample_ray, sample_time_ns};

use super::align::{pair, scene, wander};

const SPIN: Spin = Spin::Angles { columns: 360, rate_hz: 10.0 };
const SECONDS: u64 = 12;
const RANGE_SD_M: f64 = 0.02;
const MAP_VOXEL_M: f64 = 0.1;
/// Ends of rays in a cell of 0.25 m of surface that a walk surely sees.
const LEAST_ENDS: u32 = 5;

/// What is wrong with a recording.
#[derive(Clone, Copy, Debug)]
enum Spoiled {
    Healthy,
    /// The first sensor is tilted by this much more than its mount says, degrees.
    Tilted(f64),
    /// A channel of the first sensor never returns.
    DeadChannel,
    /// This share of the patches of surface that the walk meets was not recorded.
    Hidden(f64),
}

fn walks() -> u64 {
    std::env::var("OUTRIGGER_WALKS").ok().and_then(|count| count.parse().ok()).unwrap_or(50)
}

/// A hall of 30 by 20 by 8 m with pillars and crates.
fn hall() -> Scene {
    let mut boxes = vec![[DVec3::ZERO, DVec3::new(30.0, 20.0, 8.0)]];
    for pillar in 0..8 {
        let low_m = DVec3::new(6.0 + 6.0 * f64::from(pillar % 4), 6.0 + 8.0 * f64::from(pillar / 4), 0.0);
        boxes.push([low_m, low_m + DVec3::new(0.5, 0.5, 8.0)]);
    }
    let mut rng = Rng::new(7, 0);
    for crate_number in 0..14 {
        let along_m = 1.0 + 2.0 * f64::from(crate_number);
        let side_m = if crate_number % 2 == 0 { 0.4 } else { 18.0 };
        let low_m = DVec3::new(along_m, side_m, 0.0);
        let size_m = DVec3::new(rng.between(0.8, 1.8), rng.between(0.6, 1.4), rng.between(0.5, 2.5));
        boxes.push([low_m, low_m + size_m]);
    }
    Scene::Mesh(Arc::new(Mesh::of_boxes(&boxes).unwrap()))
}

/// What the walk's two sensors send, revolution by revolution.
fn each_frame(
    scene: &Scene,
    truth: &Trajectory,
    sensors: &[MountedSensor],
    seed: u64,
    mut take: impl FnMut(usize, Frame),
) {
    let [start_ns, end_ns] = truth.time_span_ns();
    for turn in 0..((end_ns - start_ns) as f64 * 1e-9 * SPIN.rate_hz()) as u32 {
        for (number, sensor) in sensors.iter().enumerate() {
            let body_from_sensor = sensor.mount.body_from_sensor();
            let scan = Scan {
                scene,
                trajectory: truth,
                model: &sensor.model,
                body_from_sensor: &|_| body_from_sensor,
                noise_m: RANGE_SD_M,
                seed: 2 * seed + number as u64,
                range_step_mm: 2,
            };
            take(number, scan.frame(turn, &SPIN.columns(start_ns, turn), SPIN.azimuth_rate_rad_per_ns()));
        }
    }
}

/// The returns of a frame: index, where the sensor was and where the return lies, in the scene, m.
fn placed(frame: &Frame, sensor: &MountedSensor, walk: &Trajectory) -> Vec<(usize, [DVec3; 2])> {
    let model = &sensor.model;
    let mut all = Vec::new();
    for (column, channel, range_mm) in returns(model, frame) {
        let Some(world_from_body) = walk.at(sample_time_ns(model, frame, column, channel)) else { continue };
        let world_from_sensor = world_from_body * sensor.mount.body_from_sensor();
        let ray = sample_ray(model, frame, column, channel);
        let ends = [ray.origin_m, ray.at_range(1e-3 * f64::from(range_mm))];
        all.push((frame.index(column, channel), ends.map(|at| world_from_sensor.transform_point(at))));
    }
    all
}

/// A map of another walk's returns.
fn mapped(scene: &Scene, walk: &Trajectory, sensors: &[MountedSensor], seed: u64) -> Scene {
    let mut map = VoxelMap::new(MAP_VOXEL_M, 1, 300.0).unwrap();
    each_frame(scene, walk, sensors, seed, |number, frame| {
        for (_, [from_m, to_m]) in placed(&frame, &sensors[number], walk) {
            map.add_return(from_m, to_m);
        }
    });
    Scene::Voxels(Arc::new(map))
}

/// The middle and radius of a ball around something seen, which holds this share of the cells of 0.25 m that the walk meets.
fn hidden_ball(
    scene: &Scene,
    truth: &Trajectory,
    sensors: &[MountedSensor],
    share: f64,
    rng: &mut Rng,
) -> (DVec3, f64) {
    let mut cells = BTreeMap::new();
    each_frame(scene, truth, sensors, 0, |number, frame| {
        for (_, [_, end_m]) in placed(&frame, &sensors[number], truth) {
            *cells.entry((4.0 * end_m).floor().as_i64vec3().to_array()).or_insert(0_u32) += 1;
        }
    });
    cells.retain(|_, ends| *ends >= LEAST_ENDS);
    let middles: Vec<DVec3> =
        cells.keys().map(|[x, y, z]| (DVec3::new(*x as f64, *y as f64, *z as f64) + 0.5) / 4.0).collect();
    let about_m = middles[rng.below(middles.len() as u64) as usize];
    let mut distances_m: Vec<f64> = middles.iter().map(|at| at.distance(about_m)).collect();
    distances_m.sort_by(f64::total_cmp);
    (about_m, distances_m[(share * distances_m.len() as f64) as usize])
}

/// A walk that is judged by the scene, or by a map of an earlier walk through it.
fn judged(scene: &Scene, is_mapped: bool, spoiled: Spoiled, seed: u64) -> Comparison {
    let sensors = pair();
    let mut rng = Rng::new(seed, 5);
    let believed = wander(scene, &mut rng, SECONDS);
    let truth = PoseError::default().disturb(&believed, 9000 + seed);
    let known = match is_mapped {
        true => mapped(scene, &believed, &sensors, 500 + seed),
        false => scene.clone(),
    };
    let height_m = 0.1 * DVec3::Z;
    let stations: Vec<DVec3> = believed.stations_m(0.5).into_iter().map(|at| at + height_m).collect();
    let patches = Patches::of_scene(&known, 200_000, 1, &stations);
    let grid = VoxelGrid::centred_on(known.bounds_m(), 0.1);
    let mut replay = Replay::new(&known, &believed, sensors.clone(), &grid, Gate::default());
    if let Some(patches) = &patches {
        replay = replay.with_surface(patches);
    }
    let mut as_built = sensors.clone();
    if let Spoiled::Tilted(tilt_deg) = spoiled {
        as_built[0].mount.pitch_rad += tilt_deg.to_radians();
    }
    let hidden = match spoiled {
        Spoiled::Hidden(share) => hidden_ball(scene, &truth, &as_built, share, &mut rng),
        _ => (DVec3::ZERO, 0.0),
    };
    each_frame(scene, &truth, &as_built, seed, |number, mut frame| {
        if let (Spoiled::DeadChannel, 0) = (spoiled, number) {
            frame.first.range_mm.iter_mut().skip(5).step_by(frame.channels).for_each(|range| *range = 0);
        }
        if let Spoiled::Hidden(_) = spoiled {
            let (middle_m, radius_m) = hidden;
            for (index, [_, end_m]) in placed(&frame, &as_built[number], &truth) {
                if end_m.distance(middle_m) < radius_m {
                    frame.first.range_mm[index] = 0;
                }
            }
        }
        replay.add_frame(number, &frame);
    });
    judge(
        Inputs {
            scene: &known,
            trajectory: &believed,
            origin: LocalOrigin::default(),
            patches: patches.as_ref(),
            planned: None,
            healthy: Healthy { seed: 100 * seed, ..Healthy::default() },
            revolution_ns: 100_000_000,
            is_own_trajectory: false,
            agree_within_m: 0.1,
            faults: Vec::new(),
            report: &|_| {},
        },
        &replay.finish(),
    )
}

/// Verdicts and reasons of so many walks.
fn tally(name: &str, scene: &Scene, is_mapped: bool, spoiled: Spoiled, count: u64) -> [usize; 3] {
    let all: Vec<Comparison> =
        (0..count).into_par_iter().map(|seed| judged(scene, is_mapped, spoiled, seed)).collect();
    let mut reasons = BTreeMap::new();
    for comparison in &all {
        *reasons.entry((format!("{:?}", comparison.verdict), comparison.reason.code)).or_insert(0) += 1;
    }
    println!("{name}, {spoiled:?}: of {count} {reasons:?}");
    for (seed, comparison) in all.iter().enumerate() {
        let null = comparison.prediction.as_ref().unwrap();
        println!(
            "  {seed}: missed {:.4?}, of runs {:.4?}",
            null.missed_share.unwrap_or(-1.0),
            null.missed_share_of_runs.unwrap_or_default()
        );
    }
    for (seed, comparison) in all.iter().enumerate().filter(|(_, all)| all.verdict == Verdict::Differs) {
        if matches!(spoiled, Spoiled::Healthy) {
            println!("  {seed}: {:?}", comparison.reason);
        }
    }
    [Verdict::Matches, Verdict::Differs, Verdict::CannotTell]
        .map(|verdict| all.iter().filter(|comparison| comparison.verdict == verdict).count())
}

/// A healthy walk is called one that differs at most once in twenty, in a house, a hall, corridors, and by a sparse map.
pub fn healthy_walks_are_seldom_called_different() {
    let each = walks();
    let (mut differ, mut all) = (0, 0);
    for (name, scene, is_mapped) in [
        ("house", scene("house"), false),
        ("hall", hall(), false),
        ("corridors", scene("corridors"), false),
        ("sparse map of the house", scene("house"), true),
    ] {
        let [_, differs, _] = tally(name, &scene, is_mapped, Spoiled::Healthy, each);
        differ += differs as u64;
        all += each;
    }
    println!("{differ} of {all} healthy walks differ");
    assert!(20 * differ <= all, "{differ} of {all}");
}

/// Half a degree on one sensor, a dead channel and a twentieth of the surface hidden are found in 19 of 20 walks.
pub fn faults_are_found() {
    let each = walks();
    let mut missed = Vec::new();
    for (name, scene) in [("house", scene("house")), ("hall", hall())] {
        for spoiled in [Spoiled::Tilted(0.5), Spoiled::DeadChannel, Spoiled::Hidden(0.05)] {
            let [_, differs, _] = tally(name, &scene, false, spoiled, each);
            if 20 * differs < 19 * each as usize {
                missed.push(format!("{name}, {spoiled:?}: {differs} of {each}"));
            }
        }
    }
    assert!(missed.is_empty(), "{missed:#?}");
}
