//! Recordings that are less than they should be: packets lost, clocks apart, poses off, ranges long.

use glam::DVec3;
use sensors::Frame;

use super::{Case, Measured};
use crate::base::geometry::Pose;
use crate::base::rng::Rng;
use crate::rig::{Mount, MountedSensor};
use crate::simulate::frames::{Scan, Spin};
use crate::study::StudyError;
use crate::verify::calibrate::{self, MountCheck};
use crate::verify::compare::{Gate, Replay, Replayed};
use crate::world::coverage::VoxelGrid;
use crate::world::scene::{BoxScene, Scene};
use crate::world::trajectory::{PoseError, Trajectory};

pub(super) const CASES: &[Case] = &[
    Case {
        name: "packet loss",
        about: "0 to 50 % of the packets of both sensors lost at random",
        measure: packet_loss,
    },
    Case {
        name: "clock offset between sensors",
        about: "the second sensor's clock 0 to 100 ms late",
        measure: clock_offset,
    },
    Case {
        name: "trajectory noise",
        about: "poses of a drifting SLAM: 0 to 10 cm and half a degree per decimetre",
        measure: trajectory_noise,
    },
    Case { name: "trajectory drift", about: "a trajectory that is 0 to 2 % too long", measure: drift },
    Case {
        name: "range bias",
        about: "3 cm added to every range of the first sensor, mounts nominal",
        measure: range_bias,
    },
    Case {
        name: "encoder offset",
        about: "azimuths of the first sensor 0.2 degrees off, mounts nominal",
        measure: encoder_offset,
    },
    Case {
        name: "undeskewed points",
        about: "every column of a revolution bears the time of the first",
        measure: undeskewed,
    },
];

const MODEL: &str = "vlp-16";
const SPIN: Spin = Spin::Angles { columns: 360, rate_hz: 10.0 };
const PITCH_DEG: f64 = 30.0;
const VOXEL_M: f64 = 0.1;
const COLUMNS_OF_A_PACKET: usize = 12;
/// Enough for a mount check: its error is that of the poses.
const KEEP_RAYS: usize = 60_000;

/// A room in which everything is observable.
pub(super) fn room() -> Scene {
    Scene::Box(BoxScene::closed(DVec3::new(-6.0, -4.0, 0.0), DVec3::new(6.0, 4.0, 3.0)))
}

/// A walk with a corner.
pub(super) fn walk() -> Result<Trajectory, StudyError> {
    let corners_m = [[-3.0, -1.0], [1.0, -1.0], [1.0, 1.0]].map(|[x, y]| DVec3::new(x, y, 1.5));
    Trajectory::polyline(&corners_m, 1.2, 1.5, 1_000_000_000).map_err(StudyError::of)
}

/// A walk straight ahead.
pub(super) fn straight() -> Trajectory {
    Trajectory::straight(DVec3::new(-3.0, 0.0, 1.5), DVec3::new(3.0, 0.0, 1.5), 1.2, 1_000_000_000)
}

/// What is recorded, and how it is read.
pub(super) struct Recording<'a> {
    scene: &'a Scene,
    /// The true trajectory, and the assumed one.
    gone: &'a Trajectory,
    believed: Trajectory,
    sensors: Vec<MountedSensor>,
    /// Pitch error of the first sensor.
    pub tilt_error_deg: f64,
    range_bias_m: f64,
    azimuth_error_deg: f64,
    lost: f64,
    late_ns: u64,
    undeskewed: bool,
}

impl<'a> Recording<'a> {
    /// Two nominal sensors, nothing lost.
    pub(crate) fn healthy(scene: &'a Scene, gone: &'a Trajectory) -> Result<Self, StudyError> {
        let model = sensors::catalogue::nominal(MODEL).map_err(StudyError::of)?;
        let sensors = [("left", -1.0), ("right", 1.0)].map(|(name, side)| MountedSensor {
            name: name.into(),
            model: model.clone(),
            mount: Mount { x_m: 0.08 * side, pitch_rad: (PITCH_DEG * side).to_radians(), ..Mount::default() },
        });
        Ok(Self {
            scene,
            gone,
            believed: gone.clone(),
            sensors: sensors.into(),
            tilt_error_deg: 0.0,
            range_bias_m: 0.0,
            azimuth_error_deg: 0.0,
            lost: 0.0,
            late_ns: 0,
            undeskewed: false,
        })
    }

    /// Simulates, spoils and replays it.
    pub(super) fn replayed(&self) -> Replayed {
        let grid = VoxelGrid::centred_on(room().bounds_m(), VOXEL_M);
        let gate = Gate { keep_rays: KEEP_RAYS, ..Gate::default() };
        let mut replay = Replay::new(self.scene, &self.believed, self.sensors.clone(), &grid, gate);
        let [start_ns, end_ns] = self.gone.time_span_ns();
        let revolutions = ((end_ns - start_ns) as f64 * 1e-9 * SPIN.rate_hz()).ceil() as u32;
        for revolution in 0..revolutions {
            for sensor in 0..self.sensors.len() {
                replay.add_frame(sensor, &self.frame(sensor, revolution, start_ns));
            }
        }
        replay.finish()
    }

    fn frame(&self, sensor: usize, revolution: u32, start_ns: u64) -> Frame {
        let mounted = &self.sensors[sensor];
        let mut mount = mounted.mount;
        if sensor == 0 {
            mount.pitch_rad += self.tilt_error_deg.to_radians();
        }
        let body_from_sensor = |_| -> Pose { mount.body_from_sensor() };
        let scan = Scan {
            scene: self.scene,
            trajectory: self.gone,
            model: &mounted.model,
            body_from_sensor: &body_from_sensor,
            noise_m: 0.02,
            seed: 1 + sensor as u64,
            range_step_mm: 2,
        };
        let columns = SPIN.columns(start_ns, revolution);
        let mut frame = scan.frame(revolution, &columns, SPIN.azimuth_rate_rad_per_ns());
        if sensor == 0 {
            let bias_mm = (1e3 * self.range_bias_m).round() as u32;
            frame.first.range_mm.iter_mut().filter(|range| **range > 0).for_each(|range| *range += bias_mm);
            let off_rad = self.azimuth_error_deg.to_radians();
            frame.column_azimuth_rad.iter_mut().for_each(|azimuth_rad| *azimuth_rad += off_rad);
        } else {
            frame.column_time_ns.iter_mut().for_each(|time_ns| *time_ns += self.late_ns);
        }
        if self.undeskewed {
            let first_ns = frame.column_time_ns[0];
            frame.column_time_ns.fill(first_ns);
        }
        let mut rng = Rng::new(9, u64::from(revolution) << 8 | sensor as u64);
        for packet in frame.column_valid.chunks_mut(COLUMNS_OF_A_PACKET) {
            if rng.between(0.0, 1.0) < self.lost {
                packet.fill(false);
            }
        }
        frame
    }

    pub(crate) fn checked(&self) -> (Replayed, MountCheck) {
        let replayed = self.replayed();
        let field = calibrate::Field {
            scene: self.scene,
            trajectory: &self.believed,
            sensors: &replayed.sensors,
            rays: &replayed.sampled,
        };
        let check = calibrate::check(&field, &calibrate::Settings::default());
        (replayed, check)
    }
}

/// Share of the rays of the worse sensor that agree with the prediction, %.
fn agree(replayed: &Replayed) -> f64 {
    let shares = replayed.rays.iter().map(|classes| classes.agree_share().unwrap_or(0.0));
    100.0 * shares.fold(1.0, f64::min)
}

/// Cells snapped to the prediction.
fn cells(replayed: &Replayed) -> f64 {
    replayed.recorded.union_count() as f64
}

/// Whether every step goes at most a little in the other direction.
fn falls(values: &[f64], by: f64) -> bool {
    values.windows(2).all(|pair| pair[1] <= pair[0] + by)
}

fn packet_loss(quick: bool) -> Result<Measured, StudyError> {
    let (scene, walk) = (room(), walk()?);
    let shares: &[f64] = if quick { &[0.0, 0.1, 0.5] } else { &[0.0, 0.01, 0.05, 0.1, 0.2, 0.35, 0.5] };
    let mut left = Vec::new();
    for lost in shares {
        let recording = Recording { lost: *lost, ..Recording::healthy(&scene, &walk)? };
        left.push(cells(&recording.replayed()));
    }
    let matched: Vec<f64> = left.iter().map(|count| 100.0 * count / left[0]).collect();
    let worst = 100.0 - matched[matched.len() - 1];
    Ok(Measured::judge(
        worst,
        "% of the cells lost with half of the packets",
        5.0,
        "revolutions overlap: a few packets should cost next to nothing",
    )
    .happens(format!(
        "a tenth of the packets costs {:.1} % of the cells",
        100.0 - matched[shares.iter().position(|share| *share == 0.1).unwrap_or(0)]
    ))
    .says(None)
    .gracefully(falls(&matched, 0.1) && worst < 50.0)
    .line(
        "packets lost, %",
        "cells left, %",
        shares.iter().zip(&matched).map(|(x, y)| [100.0 * x, *y]).collect(),
    ))
}

/// Rows of one recording per value: agreement falls step by step, or something is reported.
fn sweep<'a>(
    scene: &'a Scene,
    walk: &'a Trajectory,
    values: &[f64],
    spoil: impl Fn(&mut Recording<'a>, f64),
) -> Result<(Vec<f64>, Vec<f64>), StudyError> {
    let (mut shares, mut counts) = (Vec::new(), Vec::new());
    for value in values {
        let mut recording = Recording::healthy(scene, walk)?;
        spoil(&mut recording, *value);
        let replayed = recording.replayed();
        shares.push(agree(&replayed));
        counts.push(cells(&replayed));
    }
    Ok((shares, counts))
}

fn rays_agree(share: f64) -> Option<String> {
    Some(format!("compare: {share:.1} % of the rays agree with the prediction"))
}

fn clock_offset(quick: bool) -> Result<Measured, StudyError> {
    let (scene, walk) = (room(), walk()?);
    let late_ms: &[f64] = if quick { &[0.0, 10.0, 100.0] } else { &[0.0, 1.0, 3.0, 10.0, 30.0, 100.0] };
    let (shares, counts) =
        sweep(&scene, &walk, late_ms, |recording, ms| recording.late_ns = (ms * 1e6) as u64)?;
    let last = shares[shares.len() - 1];
    Ok(Measured::judge(
        shares[0] - last,
        "points of agreeing rays lost at 100 ms",
        2.0,
        "what noise alone moves between runs",
    )
    .happens(format!(
        "at 10 ms {:.1} % of the rays agree, at 100 ms {last:.1} %; coverage falls by {:.1} %",
        shares[late_ms.iter().position(|ms| *ms == 10.0).unwrap_or(0)],
        100.0 * (1.0 - counts[counts.len() - 1] / counts[0])
    ))
    .says(rays_agree(last))
    .gracefully(falls(&shares, 0.5))
    .line("late, ms", "rays that agree, %", late_ms.iter().zip(&shares).map(|(x, y)| [*x, *y]).collect()))
}

fn trajectory_noise(quick: bool) -> Result<Measured, StudyError> {
    let (scene, walk) = (room(), walk()?);
    let noise_cm: &[f64] = if quick { &[0.0, 2.0, 10.0] } else { &[0.0, 1.0, 2.0, 3.0, 5.0, 10.0] };
    let (shares, counts) = sweep(&scene, &walk, noise_cm, |recording, cm| {
        let error = PoseError {
            position_sd_m: 0.01 * cm,
            rotation_sd_rad: (0.05 * cm).to_radians(),
            ..PoseError::default()
        };
        recording.believed = error.disturb(recording.gone, 5);
    })?;
    let last = shares[shares.len() - 1];
    Ok(Measured::judge(
        100.0 * (1.0 - counts[counts.len() - 1] / counts[0]),
        "% of the cells lost at 10 cm",
        5.0,
        "snapped to the prediction, errors may only lower the coverage, and little",
    )
    .happens(format!(
        "at 2 cm {:.1} % of the rays agree, at 10 cm {last:.1} %",
        shares[noise_cm.iter().position(|cm| *cm == 2.0).unwrap_or(0)]
    ))
    .says(rays_agree(last))
    .gracefully(falls(&shares, 0.5) && falls(&counts, 20.0))
    .line(
        "noise of the poses, cm",
        "rays that agree, %",
        noise_cm.iter().zip(&shares).map(|(x, y)| [*x, *y]).collect(),
    ))
}

fn drift(quick: bool) -> Result<Measured, StudyError> {
    let (scene, walk) = (room(), walk()?);
    let percent: &[f64] = if quick { &[0.0, 1.0, 2.0] } else { &[0.0, 0.25, 0.5, 1.0, 1.5, 2.0] };
    let (shares, _) = sweep(&scene, &walk, percent, |recording, percent| {
        let origin = recording.gone.stamped().next().map_or(DVec3::ZERO, |(_, pose)| pose.translation_m);
        let stretched = recording.gone.stamped().map(|(time_ns, pose)| {
            let off_m = (pose.translation_m - origin) * (1.0 + 0.01 * percent);
            (time_ns, Pose::new(pose.rotation, origin + off_m))
        });
        recording.believed = Trajectory::new(stretched.collect()).unwrap_or_else(|_| recording.gone.clone());
    })?;
    let last = shares[shares.len() - 1];
    Ok(Measured::judge(
        shares[0] - last,
        "points of agreeing rays lost at 2 %",
        2.0,
        "what noise alone moves between runs",
    )
    .happens(format!("{last:.1} % of the rays agree where the trajectory is 2 % too long, 12 cm after 6 m"))
    .says(rays_agree(last))
    .gracefully(falls(&shares, 0.5))
    .line(
        "too long, %",
        "rays that agree, %",
        percent.iter().zip(&shares).map(|(x, y)| [*x, *y]).collect(),
    ))
}

fn range_bias(_quick: bool) -> Result<Measured, StudyError> {
    let (scene, walk) = (room(), walk()?);
    let recording = Recording { range_bias_m: 0.03, ..Recording::healthy(&scene, &walk)? };
    let (_, check) = recording.checked();
    let sensor = &check.mount[0];
    let offset_mm = sensor.range_offset_mm.map_or(f64::NAN, |offset| offset.value);
    Ok(Measured::judge(
        sensor.tilt_error_deg.map_or(0.0, f64::abs),
        "degrees of tilt that the bias fakes",
        0.02,
        "a regression without a range offset fakes 0.2 to 0.5 degrees",
    )
    .happens(format!("the check finds a range offset of {offset_mm:.1} mm with it"))
    .says(Some(format!("range offset {offset_mm:.1} mm"))))
}

fn encoder_offset(_quick: bool) -> Result<Measured, StudyError> {
    let (scene, walk) = (room(), walk()?);
    let recording = Recording { azimuth_error_deg: 0.2, ..Recording::healthy(&scene, &walk)? };
    let (_, check) = recording.checked();
    let sensor = &check.mount[0];
    let turns: Vec<String> = ["roll", "tilt", "yaw"]
        .iter()
        .zip(&sensor.rotation_deg)
        .filter_map(|(name, turn)| {
            turn.map(|turn| format!("{name} {:.3} ± {:.3} degrees", turn.value, turn.u95))
        })
        .collect();
    Ok(Measured::judge(
        sensor.tilt_error_deg.map_or(0.0, f64::abs),
        "degrees of tilt that the offset fakes",
        sensor.u95_deg.unwrap_or(0.0).max(0.02),
        "its own 95 % interval, or 0.02 degrees",
    )
    .happens("a turn about the spin axis of a sensor that is tilted by 30 degrees is a turn about two axes of the body")
    .says(Some(turns.join(", "))))
}

fn undeskewed(_quick: bool) -> Result<Measured, StudyError> {
    let (scene, walk) = (room(), walk()?);
    let healthy = Recording::healthy(&scene, &walk)?.replayed();
    let spoiled = Recording { undeskewed: true, ..Recording::healthy(&scene, &walk)? }.replayed();
    let (before, after) = (agree(&healthy), agree(&spoiled));
    Ok(Measured::judge(
        100.0 * (cells(&spoiled) - cells(&healthy)).max(0.0) / cells(&healthy),
        "% more cells than with the right times",
        0.1,
        "an error must not look like more coverage: points as placed would gain some",
    )
    .happens(format!(
        "agreeing rays fall from {before:.1} to {after:.1} %; cells of the points as placed {:+.1} %, snapped {:+.1} %",
        100.0 * (spoiled.placed.union_count() as f64 / healthy.placed.union_count() as f64 - 1.0),
        100.0 * (cells(&spoiled) / cells(&healthy) - 1.0)
    ))
    .says(rays_agree(after)))
}
