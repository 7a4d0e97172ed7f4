//! From flags to a sensor, its mount, its surroundings and its walk.

use std::path::Path;

use anyhow::Context as _;
use sensors::ouster::{ImuProfile, Metadata, Synthetic, TimestampMode};
use sensors::velodyne::Product;

use super::Args;
use crate::base::geometry::Pose;
use crate::commands::{Context, output, scene_file};
use crate::live::receive::now_ns;
use crate::mock::sensor::{FaultInjector, Faults, MockSensor};
use crate::rig::{Mount, MountFile};
use crate::world::scene::LoadedScene;
use crate::world::trajectory::Trajectory;

pub(super) fn injector(args: &Args) -> FaultInjector {
    let faults = Faults {
        seed: args.seed,
        drop: args.drop,
        duplicate: args.duplicate,
        reorder: args.reorder,
        corrupt: args.corrupt,
        silent_after_s: args.silent_after,
    };
    FaultInjector::new(faults, args.index)
}

pub(super) fn sensor(args: &Args) -> anyhow::Result<MockSensor> {
    if let Some(product) = Product::from_name(&args.model) {
        let sensor = MockSensor::velodyne(product, args.returns, args.rotation_hz)?;
        return Ok(if args.aside_to.is_some() { sensor.with_auxiliary() } else { sensor });
    }
    let port = args.to.port();
    let serial = args.serial.unwrap_or(992_200_000_000 + u64::from(port));
    let mut wanted = Synthetic::new(&args.model, serial, args.profile).columns(args.columns, 16);
    wanted.frame_rate_hz = args.rotation_hz;
    wanted.lidar_port = port;
    wanted.imu_profile = if args.aside_to.is_some() { args.imu_profile } else { ImuProfile::Off };
    wanted.imu_port = args.aside_to.map_or(0, |to| to.port());
    wanted.timestamp_mode = TimestampMode::SyncPulseIn;
    if args.trajectory.is_none() {
        // a real one has another after each start
        wanted.init_id = (now_ns() / 1_000_000_000 % 0xFF_FFFF + 1) as u32;
    }
    Ok(MockSensor::ouster(Metadata::synthetic(&wanted)?).with_auxiliary())
}

pub(super) fn scene(args: &Args, context: Context) -> anyhow::Result<LoadedScene> {
    if let Some(path) = &args.scene {
        let read = scene_file::read(path, &args.mesh, &args.map, context)?;
        read.warnings.iter().for_each(|warning| output::say_notice(warning));
        return Ok(read);
    }
    scene_file::ensure_none_typed(context, "there is none")?;
    Ok(LoadedScene::of_room(&args.hall.scene()))
}

pub(super) fn mount(args: &Args) -> anyhow::Result<Mount> {
    let mut mount = match (&args.mounts, &args.name) {
        (Some(path), Some(name)) => {
            let file = MountFile::read(path)?;
            let entry = file.sensors.iter().find(|entry| entry.name == *name);
            entry.with_context(|| format!("{}: no sensor is called {name:?}", path.display()))?.mount()
        }
        _ => {
            let [x_m, y_m, z_m, pitch_deg, roll_deg] = args.mount.0;
            let (pitch_rad, roll_rad) = (pitch_deg.to_radians(), roll_deg.to_radians());
            Mount { x_m, y_m, z_m, pitch_rad, roll_rad, yaw_rad: 0.0 }
        }
    };
    if let Some(pitch_deg) = args.actual_pitch_deg {
        mount.pitch_rad = pitch_deg.to_radians();
    }
    Ok(mount)
}

pub(super) fn trajectory(args: &Args) -> anyhow::Result<Trajectory> {
    let whole = match &args.trajectory {
        Some(path) => read_trajectory(path)?,
        None => {
            let start_ns = now_ns();
            let day_ns = 86_400_000_000_000;
            Trajectory::new(vec![(start_ns, Pose::IDENTITY), (start_ns + day_ns, Pose::IDENTITY)])?
        }
    };
    let [start_ns, end_ns] = whole.time_span_ns();
    let wanted_ns = args.duration.map_or(end_ns, |duration_s| start_ns + (duration_s * 1e9) as u64);
    let Some(last) = whole.at(wanted_ns).filter(|_| wanted_ns < end_ns) else { return Ok(whole) };
    let walked = whole.stamped().take_while(|(time_ns, _)| *time_ns < wanted_ns);
    Ok(Trajectory::new(walked.chain([(wanted_ns, last)]).collect())?)
}

fn read_trajectory(path: &Path) -> anyhow::Result<Trajectory> {
    let (trajectory, notes) = crate::recording::read_trajectory(path, None)?;
    notes.iter().for_each(|note| output::say_notice(note));
    Ok(trajectory)
}
