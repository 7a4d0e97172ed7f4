//! What the mount check claims about its own certainty, over many simulated walks through the furnished house: minutes,
//! so it runs only when asked for.

use std::sync::Arc;

use glam::{DQuat, DVec3};
use outrigger::base::geometry::Pose;
use outrigger::base::rng::Rng;
use outrigger::recording::FramePitch;
use outrigger::rig::{Mount, MountedSensor};
use outrigger::simulate::frames::{Scan, Spin};
use outrigger::verify::calibrate::{self, MountCheck, Settings};
use outrigger::verify::compare::{Gate, Patches, RecordedRay, Replay, Thinning};
use outrigger::world::coverage::VoxelGrid;
use outrigger::world::scene::{Scene, load_mesh};
use outrigger::world::trajectory::{PoseError, Trajectory};
use sensors::catalogue;

use crate::support::{shared, shared_folder};

/// Revolutions of each walk: every second of the 391.
const EVERY: u64 = 2;
const REVOLUTION_NS: u64 = 100_000_000;
/// Rays of one sensor and revolution, for walks of which many are made, and for those that are looked at closely.
const FEW: u64 = 160;
const MANY: u64 = 3000;

/// Whether the statistics were asked for, and have their data.
pub fn are_wanted() -> bool {
    std::env::var_os("OUTRIGGER_STATISTICS").is_some() && shared_folder().is_some()
}

/// What a trajectory is off by.
#[derive(Clone, Copy)]
enum Off {
    /// Drifts all the time, as [`PoseError`] has it.
    Drifting,
    /// By as much, anew for each revolution and the same all through it: a scan that was matched as a whole.
    ByRevolution,
}

impl Off {
    fn truth(self, trajectory: &Trajectory, seed: u64) -> Trajectory {
        let error = PoseError::default();
        match self {
            Self::Drifting => error.disturb(trajectory, seed),
            Self::ByRevolution => Self::of_size(trajectory, seed, error.position_sd_m, error.rotation_sd_rad),
        }
    }

    /// Anew for each revolution, with these standard deviations.
    fn of_size(trajectory: &Trajectory, seed: u64, position_sd_m: f64, rotation_sd_rad: f64) -> Trajectory {
        let [start_ns, end_ns] = trajectory.time_span_ns();
        let mut stamped = Vec::new();
        for from_ns in (start_ns..end_ns).step_by(REVOLUTION_NS as usize) {
            let mut rng = Rng::new(seed, from_ns);
            let mut draw = || DVec3::new(rng.normal(), rng.normal(), rng.normal());
            let (off_m, turn) = (position_sd_m * draw(), rotation_sd_rad * draw());
            let off = Pose::new(DQuat::from_scaled_axis(turn), off_m);
            let to_ns = (from_ns + REVOLUTION_NS).min(end_ns + 1);
            let between =
                trajectory.stamped().map(|(time_ns, _)| time_ns).filter(|at| (from_ns..to_ns).contains(at));
            let mut times_ns: Vec<u64> = [from_ns, to_ns - 1].into_iter().chain(between).collect();
            times_ns.sort_unstable();
            times_ns.dedup();
            stamped.extend(times_ns.into_iter().filter_map(|at| Some((at, trajectory.at(at)? * off))));
        }
        Trajectory::new(stamped).unwrap()
    }
}

/// Two sensors, tilted outward by so much.
fn pair(model: &str, pitch_deg: f64) -> Vec<MountedSensor> {
    let model = catalogue::nominal(model).unwrap();
    let mounted = |name: &str, side: f64| MountedSensor {
        name: name.into(),
        model: model.clone(),
        mount: Mount {
            x_m: 0.05 * side,
            z_m: 0.1,
            pitch_rad: (pitch_deg * side).to_radians(),
            ..Mount::default()
        },
    };
    vec![mounted("right", 1.0), mounted("left", -1.0)]
}

struct House {
    scene: Scene,
    trajectory: Trajectory,
    nominal: Vec<MountedSensor>,
}

impl House {
    fn read() -> Self {
        let mesh = load_mesh(&shared("scenes/house.ply"), None, None).unwrap().mesh;
        let walk = std::fs::read(shared("reference/validation/house_trajectory.tum")).unwrap();
        Self {
            scene: Scene::Mesh(Arc::new(mesh)),
            trajectory: Trajectory::read(&walk, None).unwrap().trajectory,
            nominal: pair("os1-64", 32.7),
        }
    }

    /// One walk: the first sensor tilted by this much above nominal, all ranges too long by a bias.
    fn walk(&self, off: Off, seed: u64, tilt_deg: f64, bias_m: f64, rays_per_turn: u64) -> MountCheck {
        let truth = off.truth(&self.trajectory, seed);
        let mut rng = Rng::new(seed, 77);
        let mut rays = Vec::new();
        let [start_ns, end_ns] = self.trajectory.time_span_ns();
        for revolution_ns in (start_ns..end_ns - REVOLUTION_NS).step_by((EVERY * REVOLUTION_NS) as usize) {
            for number in 0..rays_per_turn {
                let time_ns = revolution_ns + number * REVOLUTION_NS / rays_per_turn;
                let world_from_body = truth.at(time_ns).unwrap();
                for (sensor, mounted) in self.nominal.iter().enumerate() {
                    let mut mount = mounted.mount;
                    mount.pitch_rad += if sensor == 0 { tilt_deg.to_radians() } else { 0.0 };
                    let mut ray = RecordedRay {
                        sensor,
                        channel: rng.below(64) as usize,
                        time_ns,
                        azimuth_rad: std::f64::consts::TAU * number as f64 / rays_per_turn as f64,
                        pitch_rad: mounted.mount.pitch_rad,
                        range_m: None,
                    };
                    let noise_m = 0.02 * rng.normal();
                    let placed = ray.place(&self.nominal, &(world_from_body * mount.body_from_sensor()));
                    let met = placed.cast(&self.scene, mounted);
                    ray.range_m = met.map(|(range_m, _)| range_m + noise_m + bias_m);
                    rays.push(ray);
                }
            }
        }
        let field = calibrate::Field {
            scene: &self.scene,
            trajectory: &self.trajectory,
            sensors: &self.nominal,
            rays: &rays,
        };
        calibrate::check(&field, &Settings::default())
    }
}

fn relative_deg(found: &MountCheck) -> f64 {
    found.relative_tilt.as_ref().unwrap().error_deg
}

/// Largest distance of the p-values' distribution from the uniform one (Kolmogorov and Smirnov).
fn distance_from_uniform(p_values: &mut [f64]) -> f64 {
    p_values.sort_by(f64::total_cmp);
    let count = p_values.len() as f64;
    let apart = |(place, p): (usize, &f64)| {
        f64::max((p - place as f64 / count).abs(), ((place + 1) as f64 / count - p).abs())
    };
    p_values.iter().enumerate().map(apart).fold(0.0, f64::max)
}

/// Sets of p-values of 99 healthy walks: right, left, and one against the other.
pub fn healthy_walks_raise_few_alarms() {
    let house = House::read();
    let mut p_values = [const { Vec::new() }; 3];
    let mut z_squares = [0.0; 3];
    for seed in 0..99 {
        let found = house.walk(Off::Drifting, 1000 + seed, 0.0, 0.0, FEW);
        let relative = found.relative_tilt.as_ref().unwrap();
        let z = |value: f64, sd: f64| (value / sd).powi(2);
        for (place, check) in found.mount.iter().enumerate() {
            p_values[place].push(check.p_value.unwrap());
            z_squares[place] += z(check.tilt_error_deg.unwrap(), check.sd_deg.unwrap()) / 99.0;
        }
        p_values[2].push(relative.p_value);
        z_squares[2] += z(relative.error_deg, relative.sd_deg) / 99.0;
        if seed == 0 {
            println!("{} rounds, converged {}, {relative:?}", found.rounds, found.converged);
        }
    }
    for (what, (p_values, z_square)) in
        ["right", "left", "relative"].iter().zip(p_values.iter_mut().zip(z_squares))
    {
        let alarms = p_values.iter().filter(|p| **p < 0.05).count();
        let distance = distance_from_uniform(p_values);
        println!("{what}: KS {distance:.3}, {alarms} of 99 below 0.05, rms z {:.3}", z_square.sqrt());
        // 1 % points of the Kolmogorov distribution for 99 values
        assert!(distance < 1.63 / 99f64.sqrt(), "{what}: {distance}");
        assert!((2..=9).contains(&alarms), "{what}: {alarms} of 99");
    }
}

/// Known tilts come back, and a quarter of a degree is not missed.
pub fn known_tilts_are_recovered() {
    let house = House::read();
    for off in [Off::ByRevolution, Off::Drifting] {
        for (seed, tilt_deg) in [0.05, 0.1, 1.0, 5.0].into_iter().enumerate() {
            let found = house.walk(off, seed as u64, tilt_deg, 0.0, MANY);
            let relative = found.relative_tilt.as_ref().unwrap();
            println!("{tilt_deg} deg: {relative:?}, {} rounds, converged {}", found.rounds, found.converged);
            let slack_deg = f64::max(0.1 * tilt_deg, 0.005);
            assert!((relative.error_deg - tilt_deg).abs() < slack_deg, "{tilt_deg}: {relative:?}");
        }
    }
    let [plain, biased] = [0.0, 0.03].map(|bias_m| house.walk(Off::Drifting, 50, 0.0, bias_m, MANY));
    let faked_deg = relative_deg(&biased) - relative_deg(&plain);
    println!("3 cm of range fake {faked_deg:.5} deg; {:?}", biased.mount[0].range_offset_mm);
    assert!(faked_deg.abs() < 0.02);
    let walks = 20;
    let sure = (0..walks)
        .filter(|seed| {
            let found = house.walk(Off::Drifting, 200 + seed, 0.25, 0.0, FEW);
            let relative = found.relative_tilt.as_ref().unwrap();
            relative.p_value < 0.003 && relative.error_deg > f64::max(0.1, relative.u95_deg)
        })
        .count();
    println!("0.25 deg found in {sure} of {walks} walks");
    assert!(sure as f64 >= 0.95 * walks as f64, "{sure} of {walks}");
}

/// Both sensors' frames of the whole walk, the first tilted by this much above nominal, and what they tell of each other.
fn without_scene(house: &House, off: Off, seed: u64, tilt_deg: f64) -> calibrate::RelativeMount {
    let truth = off.truth(&house.trajectory, seed);
    let [start_ns, end_ns] = house.trajectory.time_span_ns();
    let spin = Spin::Angles { columns: 512, rate_hz: 10.0 };
    let mut rays = Thinning::new(1 << 22);
    for (number, sensor) in house.nominal.iter().enumerate() {
        let mut mount = sensor.mount;
        mount.pitch_rad += if number == 0 { tilt_deg.to_radians() } else { 0.0 };
        let seat = mount.body_from_sensor();
        let scan = Scan {
            scene: &house.scene,
            trajectory: &truth,
            model: &sensor.model,
            body_from_sensor: &|_| seat,
            noise_m: 0.01,
            seed: 1000 * seed + number as u64,
            range_step_mm: 1,
        };
        for turn in 0..((end_ns - start_ns) / REVOLUTION_NS) as u32 {
            let frame = scan.frame(turn, &spin.columns(start_ns, turn), spin.azimuth_rate_rad_per_ns());
            rays.add_frame(number, &sensor.model, &FramePitch::constant(sensor.mount.pitch_rad), 0, &frame);
        }
    }
    let rays = Thinning::joined([rays]);
    let pair = calibrate::Pair {
        trajectory: &house.trajectory,
        sensors: &house.nominal,
        first: 0,
        second: 1,
        rays: &rays,
        revolution_ns: REVOLUTION_NS,
    };
    calibrate::relative_mount(&pair, &PoseError::default())
}

/// Within 10 % or 0.005 degrees of the truth in the furnished house, whichever is more, as the known scene allows; 0.02 where
/// the pose drifts within revolutions, which has a standard deviation of 0.005 to 0.007 degrees.
pub fn relative_tilts_need_no_scene() {
    let house = House::read();
    let mut beyond = Vec::new();
    for (off, slack_deg) in [(Off::ByRevolution, 0.005), (Off::Drifting, 0.02)] {
        for (seed, tilt_deg) in [(1, 0.0), (2, 0.05), (3, 0.1), (4, 1.0), (5, 5.0)] {
            let found = without_scene(&house, off, seed, tilt_deg);
            let Some(tilt) = &found.tilt else {
                beyond.push(format!("{tilt_deg}: {found:?}"));
                continue;
            };
            println!(
                "{tilt_deg}: {:.4} +- {:.4} deg, p {:.3}, {} pairs in {} windows, {} rounds",
                tilt.error_deg, tilt.u95_deg, tilt.p_value, found.pairs, found.windows, found.rounds
            );
            if (tilt.error_deg - tilt_deg).abs() > f64::max(0.1 * tilt_deg, slack_deg) {
                beyond.push(format!("{tilt_deg}: {tilt:?}"));
            }
        }
    }
    assert!(beyond.is_empty(), "{beyond:#?}");
}

/// How a recording goes wrong.
#[derive(Clone, Copy, Default)]
struct Spoiled {
    noise_m: f64,
    pose_m: f64,
    undeskewed: bool,
    tilt_deg: f64,
    dropped: f64,
}

/// Share of the house's surface that two VLP-16 at +-37.6 degrees recorded, snapped to the prediction, %, and as measured.
fn covered(scene: &Scene, trajectory: &Trajectory, spoiled: Spoiled) -> [f64; 2] {
    let nominal = pair("vlp-16", 37.6);
    let truth = match spoiled.pose_m > 0.0 {
        true => Off::of_size(trajectory, 3, spoiled.pose_m, (10.0 * spoiled.pose_m).to_radians()),
        false => trajectory.clone(),
    };
    let stations: Vec<DVec3> = trajectory.stations_m(0.5).into_iter().map(|at| at + 0.1 * DVec3::Z).collect();
    let patches = Patches::of_scene(scene, 100_000, 1, &stations).unwrap();
    let grid = VoxelGrid::centred_on(scene.bounds_m(), 0.5);
    let mut replay =
        Replay::new(scene, trajectory, nominal.clone(), &grid, Gate::default()).with_surface(&patches);
    let spin = Spin::Angles { columns: 180, rate_hz: 10.0 };
    let [start_ns, end_ns] = trajectory.time_span_ns();
    let mut rng = Rng::new(5, 5);
    for turn in 0..((end_ns - start_ns) / REVOLUTION_NS) as u32 {
        for (number, sensor) in nominal.iter().enumerate() {
            let mut mount = sensor.mount;
            mount.pitch_rad += if number == 0 { spoiled.tilt_deg.to_radians() } else { 0.0 };
            let seat = mount.body_from_sensor();
            let scan = Scan {
                scene,
                trajectory: &truth,
                model: &sensor.model,
                body_from_sensor: &|_| seat,
                noise_m: spoiled.noise_m,
                seed: number as u64,
                range_step_mm: 1,
            };
            let mut frame = scan.frame(turn, &spin.columns(start_ns, turn), spin.azimuth_rate_rad_per_ns());
            if spoiled.undeskewed {
                let first_ns = frame.column_time_ns[0];
                frame.column_time_ns.fill(first_ns);
            }
            for range_mm in &mut frame.first.range_mm {
                if rng.uniform() < spoiled.dropped {
                    *range_mm = 0;
                }
            }
            replay.add_frame(number, &frame);
        }
    }
    let surface = replay.finish().surface.unwrap();
    [surface.recorded, surface.placed].map(|share| 100.0 * share.of_all)
}

/// What errors take from the coverage that is snapped to the prediction: the published table's differences from a clean
/// recording, points, for two VLP-16 in the furnished house.
pub fn errors_take_from_coverage_what_the_table_says() {
    let House { scene, trajectory, .. } = House::read();
    let none = Spoiled::default();
    let [clean, measured] = covered(&scene, &trajectory, none);
    println!("clean: {clean:.2} %, as measured {measured:.2} %");
    let table = [
        ("noise of 1 cm", Spoiled { noise_m: 0.01, ..none }, 0.0, 0.1),
        ("noise of 3 cm", Spoiled { noise_m: 0.03, ..none }, 0.0, 0.1),
        ("poses off by 2 cm", Spoiled { pose_m: 0.02, ..none }, -0.60, 0.5),
        ("poses off by 5 cm", Spoiled { pose_m: 0.05, ..none }, -1.46, 0.7),
        ("not deskewed", Spoiled { undeskewed: true, ..none }, -2.53, 1.0),
        ("tilted by 1 degree", Spoiled { tilt_deg: 1.0, ..none }, -0.92, 0.5),
        ("tilted by 5 degrees", Spoiled { tilt_deg: 5.0, ..none }, -2.77, 1.0),
        ("20 % dropped", Spoiled { dropped: 0.2, ..none }, -0.42, 0.3),
    ];
    let mut beyond = Vec::new();
    for (what, spoiled, published, slack) in table {
        let [recorded, measured] = covered(&scene, &trajectory, spoiled);
        let change = recorded - clean;
        println!(
            "{what}: {change:+.2} points ({published:+.2} published), as measured {:+.2}",
            measured - clean
        );
        if change > 0.0 || (change - published).abs() > slack {
            beyond.push(format!("{what}: {change:+.2}, published {published:+.2}"));
        }
    }
    assert!(beyond.is_empty(), "{beyond:?}");
}
