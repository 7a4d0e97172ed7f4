//! How far the mounts are off, from the recorded ranges: a joint regression of all sensors' ray residuals.
//!
//! A ray's residual across the surface it meets, `e = (d.n)(r - r^)`, is to first order `-n.dt - (L x n).dth + (d.n) b`
//! for a mount that is off by `dt`, `dth` about the sensor's origin with lever `L = r d`, and a range offset `b`. The
//! body's own pose error has the same form about the body's origin; it is one unknown of six numbers per revolution,
//! with a prior, and eliminated there (Schur complement). What all sensors share is the trajectory's error; what sets
//! two of them apart is the mount's. Rays are cast again from the corrected mounts
//! and poses until nothing moves.
//!
//! The covariance is not the formal one, which is ten times too small: revolutions vary as they are seen to vary, and
//! what is left of a drifting pose is followed through the estimator from its own model ([`PoseError`]).

mod covariance;
mod gather;
mod holds;
mod observed;
mod relative;
mod solve;
mod stand;
mod stand_faults;

use glam::DVec3;

use crate::rig::{Mount, MountedSensor};
use crate::verify::compare::RecordedRay;
use crate::world::scene::Scene;
use crate::world::trajectory::{PoseError, Trajectory};

pub(crate) use holds::{Hold, SHORTEST_HOLD_S, holds};
pub use observed::UNKNOWNS;
pub use relative::{Pair, RelativeMount, relative_mount};
pub(crate) use stand::stand_test;
pub use stand::{FoundSetting, Reached, Setting, StandTest};

/// What is assumed and how long is tried.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Error of the trajectory.
    pub pose: PoseError,
    /// Duration of a revolution, ns.
    pub revolution_ns: u64,
    /// Parts of a revolution with a pose error of their own. More parts follow a drift within the revolution, but with few
    /// rays in each the standard deviations come out too small (measured: by 1.4 for 40 rays per sensor and part).
    pub parts: u64,
    /// Casts at most.
    pub rounds: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Self { pose: PoseError::default(), revolution_ns: 100_000_000, parts: 1, rounds: 12 }
    }
}

/// What is regressed on.
#[derive(Clone, Copy)]
pub struct Field<'a> {
    /// A mesh or a box; cells of a map have no normals to speak of.
    pub scene: &'a Scene,
    /// As recorded.
    pub trajectory: &'a Trajectory,
    /// Nominal, with the models of their packets.
    pub sensors: &'a [MountedSensor],
    /// In order of time.
    pub rays: &'a [RecordedRay],
}

/// One number with what is known about it.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Estimate {
    /// Best value.
    pub value: f64,
    /// Standard deviation.
    pub sd: f64,
    /// Half of the 95 % interval.
    pub u95: f64,
    /// Chance of a value this far from zero if it were zero.
    pub p_value: f64,
}

impl Estimate {
    fn new(value: f64, sd: f64) -> Self {
        let p_value = libm::erfc(value.abs() / sd / std::f64::consts::SQRT_2);
        Self { value, sd, u95: 1.96 * sd, p_value }
    }

    fn scaled(self, by: f64) -> Self {
        Self { value: self.value * by, sd: self.sd * by, u95: self.u95 * by, p_value: self.p_value }
    }
}

/// One sensor's mount.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct SensorCheck {
    /// Name.
    pub sensor: String,
    /// Servo axis: pitch above nominal, degrees; none where it is not observable.
    pub tilt_error_deg: Option<f64>,
    /// Its standard deviation, degrees.
    pub sd_deg: Option<f64>,
    /// Half of its 95 % interval, degrees.
    pub u95_deg: Option<f64>,
    /// Chance of such a pitch error if there were none.
    pub p_value: Option<f64>,
    /// Observable unknowns: of `x, y, z, roll, tilt, yaw, range`.
    pub observable: Vec<&'static str>,
    /// Of the normalised unknowns; none where some direction is not observable at all.
    pub condition_number: Option<f64>,
    /// Turns about the mount frame's axes (x right: roll, y forward: tilt, z up: yaw), degrees, in the order x, y, z.
    pub rotation_deg: [Option<Estimate>; 3],
    /// Shifts along the mount frame's axes, mm.
    pub translation_mm: [Option<Estimate>; 3],
    /// What is added to every range, mm.
    pub range_offset_mm: Option<Estimate>,
    /// Rays used.
    pub rays: u64,
    /// Why the pitch is not observable here.
    pub cannot_tell: Option<String>,
    /// Whether that is because the scene is another one, or of another size.
    #[serde(skip)]
    pub is_of_another_scene: bool,
    /// Mount with every observable correction; yaw, which a mount has not, left out.
    #[serde(skip)]
    pub corrected: Mount,
}

impl SensorCheck {
    /// Nothing is known of a sensor, and its mount is nominal.
    pub(crate) fn undetermined(sensor: &str, mount: Mount) -> Self {
        Self {
            sensor: sensor.to_owned(),
            tilt_error_deg: None,
            sd_deg: None,
            u95_deg: None,
            p_value: None,
            observable: Vec::new(),
            condition_number: None,
            rotation_deg: [None; 3],
            translation_mm: [None; 3],
            range_offset_mm: None,
            rays: 0,
            cannot_tell: None,
            is_of_another_scene: false,
            corrected: mount,
        }
    }
}

/// Tilt of the first sensor against that of the second.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct RelativeTilt {
    /// The two.
    pub sensors: [String; 2],
    /// Tilt error of the first less that of the second, degrees.
    pub error_deg: f64,
    /// Standard deviation, degrees.
    pub sd_deg: f64,
    /// Half of the 95 % interval, degrees.
    pub u95_deg: f64,
    /// Chance of such a value if both were nominal.
    pub p_value: f64,
}

/// What the recording says about its mounts.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct MountCheck {
    /// By sensor.
    pub mount: Vec<SensorCheck>,
    /// Of the first two sensors, where both pitches are observable.
    pub relative_tilt: Option<RelativeTilt>,
    /// Times the rays were cast.
    pub rounds: usize,
    /// Whether the last round moved nothing.
    pub converged: bool,
    /// Standard deviation of a residual across the surface, robust, mm.
    pub residual_sd_mm: f64,
    /// Revolutions.
    pub scans: usize,
}

/// A step of no consequence, in formal standard deviations, which are far below the real ones.
const SMALL_STEP: f64 = 0.05;

/// Least of revolutions and rays per sensor to say anything.
const LEAST_RAYS: u64 = 500;

/// Minimum share of the returns that end near the surface on their ray. In the place that was recorded all but
/// people and furniture do, and seven in ten where its ceiling is wrong; of a hall in a house or in other rooms 0 to 28 %
/// do, which fit some mount to a tenth of a degree.
const LEAST_NEAR: f64 = 0.5;

/// No sensor's ranges are off by more, m: what fits only so is another scene.
const MOST_RANGE_ERROR_M: f64 = 0.3;

/// Checks the mounts of a rig against a scene.
pub fn check(field: &Field<'_>, settings: &Settings) -> MountCheck {
    let sensors = field.sensors.len();
    if matches!(field.scene, Scene::Voxels(_)) {
        return nothing(field, "the scene is a map of voxels: its surfaces have no exact direction");
    }
    let scans = gather::scans(field, settings.revolution_ns / settings.parts.max(1));
    let mut offsets = vec![gather::Offset::default(); sensors];
    let (mut rounds, mut converged) = (0, false);
    let mut last = None;
    let mut poses = vec![[0.0; 6]; scans.len()];
    while rounds < settings.rounds {
        let gate_m = gather::gate_m(rounds);
        let rows = gather::rows(field, &scans, &offsets, &poses, gate_m);
        let Some(solution) = solve::solve(&rows, sensors, &settings.pose, &poses) else { break };
        rounds += 1;
        let step_size = solution.step_size;
        for (sensor, offset) in offsets.iter_mut().enumerate() {
            offset.add(&solution.step[7 * sensor..7 * sensor + 7]);
        }
        for (pose, more) in poses.iter_mut().zip(&solution.poses) {
            *pose = std::array::from_fn(|place| pose[place] + more[place]);
        }
        last = Some((rows, solution));
        // at edges of a mesh single rays go on changing sides
        converged = step_size < SMALL_STEP && gate_m <= gather::LAST_GATE_M;
        if converged {
            break;
        }
    }
    let Some((rows, solution)) = last else {
        return nothing(field, "too few rays meet a surface within 0.3 m of where it is expected");
    };
    let covariance = covariance::covariance(&rows, &solution, &settings.pose);
    let mount: Vec<SensorCheck> = (0..sensors)
        .map(|sensor| report(field, sensor, &offsets[sensor], &solution, &covariance, &rows))
        .collect();
    let relative_tilt = relative(field, &mount, &offsets, &covariance);
    let residual_sd_mm = 1e3 * solution.scale_m;
    MountCheck { mount, relative_tilt, rounds, converged, residual_sd_mm, scans: rows.len() }
}

fn nothing(field: &Field<'_>, why: &str) -> MountCheck {
    let silent = |sensor: &MountedSensor| SensorCheck {
        cannot_tell: Some(why.to_owned()),
        ..SensorCheck::undetermined(&sensor.name, sensor.mount)
    };
    MountCheck {
        mount: field.sensors.iter().map(silent).collect(),
        relative_tilt: None,
        rounds: 0,
        converged: false,
        residual_sd_mm: 0.0,
        scans: 0,
    }
}

/// Direction of the servo's axis in the mount frame: the pitch turns about y, after the roll about x.
fn tilt_axis(mount: &Mount) -> DVec3 {
    glam::DMat3::from_rotation_x(mount.roll_rad) * DVec3::Y
}

fn report(
    field: &Field<'_>,
    sensor: usize,
    offset: &gather::Offset,
    solution: &solve::Solution,
    covariance: &nalgebra::DMatrix<f64>,
    rows: &[gather::Scan],
) -> SensorCheck {
    let MountedSensor { name, mount, .. } = &field.sensors[sensor];
    let seen = &solution.observed[sensor];
    let rays = rows.iter().flat_map(|scan| &scan.rows).filter(|row| row.sensor == sensor).count() as u64;
    let met: u64 = rows.iter().map(|scan| scan.met[sensor]).sum();
    let near_share = rays as f64 / met.max(1) as f64;
    let (many, near) = (rays >= LEAST_RAYS, near_share >= LEAST_NEAR);
    let is_likely = offset.range_m.abs() <= MOST_RANGE_ERROR_M;
    let enough = many && near && is_likely;
    let at = 7 * sensor;
    let estimate = |weights: [f64; 7], value: f64| {
        let weights = nalgebra::DVector::from_row_slice(&weights);
        let variance = (weights.transpose() * covariance.view((at, at), (7, 7)) * &weights)[(0, 0)];
        Estimate::new(value, variance.max(1e-24).sqrt())
    };
    let unit = |place: usize| std::array::from_fn(|other| f64::from(u8::from(other == place)));
    let single = |place: usize, value: f64, by: f64| {
        (enough && seen.is_observable[place]).then(|| estimate(unit(place), value).scaled(by))
    };
    let turn = offset.rotation.to_scaled_axis();
    let axis = tilt_axis(mount);
    let along = [0.0, 0.0, 0.0, axis.x, axis.y, axis.z, 0.0];
    let is_observable = enough && seen.tells(&along);
    let tilt = is_observable.then(|| estimate(along, turn.dot(axis)).scaled(1f64.to_degrees()));
    let cannot_tell = match (many, near, is_observable) {
        (true, true, _) if !is_likely => Some(format!(
            "cannot tell here: the scene fits best with ranges {:.2} m too {}, and no sensor errs so far: is the scene of another \
             size, or another place?",
            offset.range_m.abs(),
            if offset.range_m > 0.0 { "long" } else { "short" }
        )),
        (true, true, true) => None,
        (true, true, false) => Some("cannot tell here: the surfaces it saw leave the pitch open".to_owned()),
        (true, false, _) => Some(format!(
            "cannot tell here: only {:.0} % of the returns end within {} m of where the scene has a surface, from the best mount, \
             too: is the scene another place, or the trajectory in another frame?",
            100.0 * near_share,
            gather::LAST_GATE_M
        )),
        (false, ..) => Some(format!("cannot tell here: {rays} usable rays")),
    };
    let degrees = 1f64.to_degrees();
    SensorCheck {
        sensor: name.clone(),
        tilt_error_deg: tilt.map(|tilt| tilt.value),
        sd_deg: tilt.map(|tilt| tilt.sd),
        u95_deg: tilt.map(|tilt| tilt.u95),
        p_value: tilt.map(|tilt| tilt.p_value),
        observable: if enough { seen.names() } else { Vec::new() },
        condition_number: seen.condition_number.filter(|_| near),
        rotation_deg: [0, 1, 2].map(|axis| single(3 + axis, turn[axis], degrees)),
        translation_mm: [0, 1, 2].map(|axis| single(axis, offset.translation_m[axis], 1e3)),
        range_offset_mm: single(6, offset.range_m, 1e3),
        rays,
        cannot_tell,
        is_of_another_scene: many && !(near && is_likely),
        corrected: if near && is_likely { offset.corrected(mount, &seen.is_observable) } else { *mount },
    }
}

fn relative(
    field: &Field<'_>,
    mount: &[SensorCheck],
    offsets: &[gather::Offset],
    covariance: &nalgebra::DMatrix<f64>,
) -> Option<RelativeTilt> {
    let [first, second] = [mount.first()?, mount.get(1)?];
    let (_, _) = (first.tilt_error_deg?, second.tilt_error_deg?);
    let mut weights = nalgebra::DVector::zeros(covariance.nrows());
    let mut value = 0.0;
    for (sensor, sign) in [(0, 1.0), (1, -1.0)] {
        let axis = tilt_axis(&field.sensors[sensor].mount);
        value += sign * offsets[sensor].rotation.to_scaled_axis().dot(axis);
        for component in 0..3 {
            weights[7 * sensor + 3 + component] = sign * axis[component];
        }
    }
    let variance = (weights.transpose() * covariance * &weights)[(0, 0)];
    let estimate = Estimate::new(value, variance.max(1e-24).sqrt()).scaled(1f64.to_degrees());
    Some(RelativeTilt {
        sensors: [first.sensor.clone(), second.sensor.clone()],
        error_deg: estimate.value,
        sd_deg: estimate.sd,
        u95_deg: estimate.u95,
        p_value: estimate.p_value,
    })
}
