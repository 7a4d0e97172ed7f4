//! The map of `odometry`: the returns of all sensors along the trajectory.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use super::Args;
use crate::commands::Context;
use crate::recording::export::{Cloud, Export, FileFrame, Format, Source};
use crate::recording::mounted::{Mounts, PlacedFrame, each_frame};
use crate::recording::packet_reader::is_stream;
use crate::recording::registered::{PointFilter, Registration, Target, TimeOffset, VoxelThinning};
use crate::recording::{Recording, sensor_ids};
use crate::world::trajectory::Trajectory;

/// Where the map goes, and in which format; refused before the work.
pub(super) fn map_of<'a>(args: &Args, path: &'a Path) -> anyhow::Result<(&'a Path, Format)> {
    let format = Format::of_path(path).filter(|format| !matches!(format, Format::Mcap | Format::Foxglove));
    let Some(format) = format else {
        refuse!(
            "--map {}: expected a name that ends in .laz, .las, .e57, .ply, .pcd, .csv or .npy",
            path.display()
        );
    };
    if is_stream(&args.recorded.recording) {
        refuse!(
            "--map reads the recording twice, and {} can be read but once: save it as a file first",
            args.recorded.recording.display()
        );
    }
    Ok((path, format))
}

/// Reads the recording again and puts its returns where the trajectory says; how many, and what was lost.
pub(super) fn write_map(
    args: &Args,
    context: Context,
    trajectory: &Trajectory,
    path: &Path,
    format: Format,
) -> anyhow::Result<(u64, Option<String>)> {
    let spec = args.recorded.spec(context);
    let recording = Recording::open(&spec.recording)?;
    let mut mounts = Mounts::of(&recording, spec.mount.as_deref(), &spec.zeros)?;
    let filter = PointFilter { voxels: args.voxel.map(VoxelThinning::new), ..PointFilter::default() };
    let target = Target::World { trajectory: trajectory.clone(), offset: TimeOffset::Fixed(0) };
    let mut registration = Registration::new(target, filter);
    let frame = FileFrame { name: registration.frame_name(), origin: registration.origin(), wkt: None };
    let mut export = Export::create_in(&frame, path, format, true)?;
    let (mut ids, mut clouds) = (Vec::new(), BTreeMap::new());
    each_frame(&recording, &mut mounts, &mut |mounted| {
        let PlacedFrame { at, sensor, model, body_from_sensor, frame, .. } = mounted;
        let cloud = clouds.entry(at).or_insert_with(|| {
            Cloud::new(Arc::new(Source::of(sensor, sensor_ids::next_id(sensor, &mut ids), at)), model)
        });
        cloud.fill(model, frame);
        registration.apply(at, cloud, body_from_sensor);
        export.add(cloud).map_err(anyhow::Error::from)
    })?;
    Ok((export.finish()?.points, registration.losses()))
}
