//! From flags for mounts, scene and trajectory to what the daemon knows of them.

use anyhow::bail;

use super::site::SiteArgs;
use crate::commands::{Context, ensure_consistent, scene_file};
use crate::daemon::Site;
use crate::recording::read_trajectory;
use crate::rig::MountSlots;
use crate::world::local_origin::LocalOrigin;

/// Reads what is named. `axes` are the sensors that axis 0, 1, ... turn, where that is configured: everywhere behind this they
/// come in that order.
pub(crate) fn read_site(args: &SiteArgs, axes: &[String], context: Context) -> anyhow::Result<Site> {
    let mut site = Site { voxel_m: args.cell, ..Site::default() };
    if let Some(path) = &args.mount {
        let slots = MountSlots::read(path, axes)?;
        (site.rig, site.calibrations, site.mount) = (slots.rig, slots.calibrations, Some(slots.mount));
    }
    let is_both = args.scene.is_some() && args.room.is_some();
    ensure_consistent([(is_both, "--scene and --room are both given: which of the two is it?".into())])?;
    let scene = args.scene.as_deref();
    let loaded = scene_file::read_or_room(scene, args.room, &args.mesh, &args.map, context)?;
    match &loaded {
        Some(loaded) => loaded.warnings.iter().for_each(|warning| tracing::warn!("{warning}")),
        None => scene_file::ensure_none_typed(context, "there is none")?,
    }
    let mut origin = loaded.as_ref().map(|loaded| loaded.origin);
    site.scene = loaded.map(|loaded| loaded.scene);
    let cells = site.grid().cells.iter().map(|count| *count as f64).product::<f64>();
    if cells > f64::from(1 << 27) {
        bail!("--cell {} makes {cells:.0} cells of this scene: take larger ones", args.cell);
    }
    if let Some(path) = &args.trajectory {
        let (trajectory, notes) = read_trajectory(path, args.rate)?;
        notes.iter().for_each(|note| tracing::warn!("{note}"));
        let origin = *origin.get_or_insert_with(|| LocalOrigin::of_box(trajectory.bounds_m()));
        site.trajectory = Some(origin.local_trajectory(trajectory));
    }
    site.origin = origin.unwrap_or_default();
    if let Some(words) = site.origin.words() {
        tracing::info!("local origin {words}; what the daemon shows is around it");
    }
    site.doubts().iter().for_each(|doubt| tracing::warn!("{doubt}"));
    let words =
        "--trajectory-starts-with-recording: no trajectory; expected --trajectory, or one in the rig.toml";
    let lacks_trajectory = args.trajectory_starts_with_recording && args.trajectory.is_none();
    ensure_consistent([(lacks_trajectory, words.into())])?;
    site.starts_with_recording = args.trajectory_starts_with_recording;
    Ok(site)
}
