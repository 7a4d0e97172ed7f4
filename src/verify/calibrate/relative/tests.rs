use std::sync::Arc;

use glam::DVec3;

use super::*;
use crate::recording::FramePitch;
use crate::rig::Mount;
use crate::simulate::frames::{Scan, Spin};
use crate::verify::compare::Thinning;
use crate::world::scene::{BoxScene, Mesh, Scene};

const TURN_NS: u64 = 100_000_000;

/// A rig on its way: what is really there.
struct Walk {
    scene: Scene,
    model: &'static str,
    nominal_pitch_deg: f64,
    path: Trajectory,
    error: Option<PoseError>,
    tilt_deg: f64,
    bias_m: f64,
    seed: u64,
}

impl Walk {
    fn through(scene: Scene) -> Self {
        let [from, to] = [DVec3::new(-2.2, 0.3, 1.4), DVec3::new(2.0, -0.4, 1.4)];
        Self {
            scene,
            model: "os1-64",
            nominal_pitch_deg: 32.7,
            path: Trajectory::straight(from, to, 1.0, 1_000_000_000),
            error: Some(PoseError::default()),
            tilt_deg: 0.0,
            bias_m: 0.0,
            seed: 1,
        }
    }

    fn nominal(&self) -> Vec<MountedSensor> {
        let model = sensors::catalogue::nominal(self.model).unwrap();
        let mounted = |name: &str, side: f64| MountedSensor {
            name: name.into(),
            model: model.clone(),
            mount: Mount {
                x_m: 0.06 * side,
                z_m: 0.1,
                pitch_rad: (self.nominal_pitch_deg * side).to_radians(),
                ..Mount::default()
            },
        };
        vec![mounted("right", 1.0), mounted("left", -1.0)]
    }

    fn found(&self) -> RelativeMount {
        let nominal = self.nominal();
        let truth =
            self.error.map_or_else(|| self.path.clone(), |error| error.disturb(&self.path, self.seed));
        let [start_ns, end_ns] = self.path.time_span_ns();
        let spin = Spin::Angles { columns: 512, rate_hz: 10.0 };
        let mut rays = Thinning::new(600_000);
        for (number, sensor) in nominal.iter().enumerate() {
            let mut mount = sensor.mount;
            mount.pitch_rad += if number == 0 { self.tilt_deg.to_radians() } else { 0.0 };
            let body_from_sensor = mount.body_from_sensor();
            let scan = Scan {
                scene: &self.scene,
                trajectory: &truth,
                model: &sensor.model,
                body_from_sensor: &|_| body_from_sensor,
                noise_m: 0.01,
                seed: 100 * self.seed + number as u64,
                range_step_mm: 1,
            };
            for turn in 0..((end_ns - start_ns) / TURN_NS) as u32 {
                let columns = spin.columns(start_ns, turn);
                let mut frame = scan.frame(turn, &columns, spin.azimuth_rate_rad_per_ns());
                for range_mm in frame.first.range_mm.iter_mut().filter(|range_mm| **range_mm > 0) {
                    *range_mm += (1e3 * self.bias_m).round() as u32;
                }
                rays.add_frame(
                    number,
                    &sensor.model,
                    &FramePitch::constant(sensor.mount.pitch_rad),
                    0,
                    &frame,
                );
            }
        }
        let rays = Thinning::joined([rays]);
        let pair = Pair {
            trajectory: &self.path,
            sensors: &nominal,
            first: 0,
            second: 1,
            rays: &rays,
            revolution_ns: TURN_NS,
        };
        relative_mount(&pair, &PoseError::default())
    }
}

/// A room with a table, cupboards and boxes in it.
fn furnished() -> Scene {
    let mut vertices_m = Vec::new();
    let mut triangles = Vec::new();
    for [low, high] in [
        [[-4.0, -3.0, 0.0], [5.0, 3.5, 2.7]],
        [[-3.9, 1.5, 0.0], [-3.2, 3.3, 1.9]],
        [[2.4, 2.4, 0.0], [4.4, 3.4, 0.8]],
        [[3.6, -2.9, 0.0], [4.8, -2.0, 2.2]],
        [[-1.0, 2.6, 0.0], [0.6, 3.4, 1.1]],
        [[-2.0, -2.8, 0.0], [-0.6, -1.9, 0.75]],
        [[1.0, -2.9, 1.2], [2.2, -2.5, 1.9]],
    ] {
        let first = vertices_m.len() as u32;
        for corner in 0..8 {
            let pick = |axis: usize| if corner >> axis & 1 == 1 { high[axis] } else { low[axis] };
            vertices_m.push(DVec3::new(pick(0), pick(1), pick(2)));
        }
        for [a, b, c, d] in
            [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]]
        {
            triangles.push([first + a, first + b, first + c]);
            triangles.push([first + a, first + c, first + d]);
        }
    }
    Scene::Mesh(Arc::new(Mesh::new(vertices_m, triangles).unwrap()))
}

/// A wall beside the rig, of which each sensor sees another height.
fn wall() -> Scene {
    let corners = [(-1.0, -5.0), (1.0, -5.0), (1.0, 9.0), (-1.0, 9.0)];
    let vertices_m = corners.map(|(x, z)| DVec3::new(x, 2.5, z)).to_vec();
    Scene::Mesh(Arc::new(Mesh::new(vertices_m, vec![[0, 1, 2], [0, 2, 3]]).unwrap()))
}

#[test]
fn a_relative_tilt_is_recovered_without_a_scene() {
    for (seed, tilt_deg, bias_m) in [(2, 0.0, 0.0), (2, 1.0, 0.03), (5, 5.0, 0.0)] {
        let found = Walk { tilt_deg, seed, bias_m, ..Walk::through(furnished()) }.found();
        let tilt = found.tilt.clone().unwrap_or_else(|| panic!("{found:?}"));
        // what rooms leave as a bias, see the module
        assert!((tilt.error_deg - tilt_deg).abs() < 0.06, "{tilt_deg}: {tilt:?}");
        assert!(tilt.u95_deg < 0.04, "{tilt:?}");
        assert_eq!(found.observable, super::super::UNKNOWNS);
        assert!(found.converged && found.cannot_tell.is_none() && found.condition_number.is_some());
    }
}

#[test]
fn what_both_do_not_see_is_not_observable() {
    let [low, high] = [DVec3::new(-300.0, -300.0, 0.0), DVec3::new(300.0, 300.0, 60.0)];
    let mut nothing = BoxScene::closed(low, high);
    nothing.faces = [[false; 2]; 3];
    let mut floor = nothing.clone();
    floor.faces[2][0] = true;
    let short = |scene: Scene, model: &'static str| {
        let path =
            Trajectory::straight(DVec3::new(-0.8, 0.0, 1.4), DVec3::new(0.8, 0.0, 1.4), 1.0, 1_000_000_000);
        Walk { path, model, ..Walk::through(scene) }.found()
    };
    for found in [short(Scene::Box(nothing), "os1-64"), short(wall(), "vlp-16")] {
        let words = found.cannot_tell.clone().unwrap_or_default();
        assert!(found.tilt.is_none() && words.contains("hardly any surface"), "{found:?}");
    }
    // a floor says nothing of what happens along it
    let found = short(Scene::Box(floor), "os1-64");
    for unseen in ["x", "y", "yaw"] {
        assert!(!found.observable.contains(&unseen), "{found:?}");
    }
    assert!(found.condition_number.is_none() && found.translation_mm[0].is_none(), "{found:?}");
}

#[test]
fn the_same_on_any_number_of_threads() {
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let path = Trajectory::straight(DVec3::new(-0.3, 0.0, 1.4), DVec3::new(0.3, 0.0, 1.4), 1.0, 0);
        pool.install(|| Walk { path, model: "os1-32", ..Walk::through(furnished()) }.found())
    };
    assert_eq!(on(1), on(3));
}
