//! Where a recording was made: the scene and the trajectory through it, from files or from the recording itself.

use std::ops::Range;
use std::sync::Arc;

use super::clocks::{Offset, search_time_offset, time_offset_ns};
use super::error::WalkError;
use super::found::{Found, find_trajectory, placed};
use super::spec::WalkSiteSpec;
use crate::recording::TrajectorySource;
use crate::recording::mounted::MountedRecording;
use crate::recording::scene::{Making, MapSpec};
use crate::verify::align::Alignment;
use crate::verify::compare::TimeOffset;
use crate::world::local_origin::LocalOrigin;
use crate::world::placement::Placement;
use crate::world::scene::{Scene, VoxelMap};
use crate::world::trajectory::{Trajectory, suspicions};

/// A scene, a trajectory, and what is odd about them.
pub(crate) struct WalkSite {
    pub scene: Scene,
    pub trajectory: Trajectory,
    /// Where the frame of both begins in that of the files.
    pub origin: LocalOrigin,
    /// Whether most of the trajectory lies outside the scene or below its floor.
    pub is_misplaced: bool,
    pub time_offset_ns: i64,
    /// Where it was looked for.
    pub time_offset: Option<TimeOffset>,
    /// Frames that made the map.
    pub mapped: Range<u64>,
    /// Where the trajectory lies in the scene, where that was looked for. One that is not placed is in its own frame still.
    pub alignment: Option<Alignment>,
    /// The trajectory was found from the recording.
    pub is_odometry: bool,
    pub notices: Vec<String>,
}

impl WalkSite {
    /// Finds what is not given.
    pub(crate) fn find(mut spec: WalkSiteSpec, recorded: &MountedRecording) -> Result<Self, WalkError> {
        let mut notices = Vec::new();
        let found = find_trajectory(&spec, recorded, &mut notices)?;
        let is_odometry = matches!(found, Found::Odometry(_));
        let trajectory = found.trajectory();
        let time_offset_ns = time_offset_ns(spec.time_offset, recorded, trajectory)?;
        // a rig that stands has no poses to miss, and odometry has its own remarks
        let is_still = spec.trajectory == Some(TrajectorySource::Still);
        if !is_still && !is_odometry {
            notices.extend(suspicions(trajectory, "trajectory"));
        }
        let mapped = spec.map_of.as_ref().map_or(0..0, |(frames, _)| frames.clone());
        let loaded = spec.scene.take();
        let origin = loaded
            .as_ref()
            .map_or_else(|| LocalOrigin::of_box(trajectory.bounds_m()), |loaded| loaded.origin);
        let is_sought = mapped.is_empty() && (spec.is_aligned || is_odometry);
        // one that is to be placed lies in a frame of its own
        let trajectory = match is_sought {
            true => trajectory.clone(),
            false => origin.local_trajectory(trajectory.clone()),
        };
        let scene = match (loaded, &spec.map_of) {
            (Some(loaded), _) => {
                notices.extend(loaded.warnings);
                loaded.scene
            }
            (None, Some((frames, map))) => {
                Scene::Voxels(Arc::new(map_of(map, recorded, &trajectory, time_offset_ns, frames)?))
            }
            (None, None) => return Err(WalkError::NoScene),
        };
        if spec.near.is_some() && !is_sought {
            return Err(WalkError::NearWithoutAlign { what: recorded.what() });
        }
        let mut place = Self {
            scene,
            trajectory,
            origin,
            is_misplaced: false,
            time_offset_ns,
            time_offset: None,
            mapped,
            alignment: None,
            is_odometry,
            notices,
        };
        if is_sought {
            let placed = placed(&spec, recorded, &found, (&place.scene, origin), time_offset_ns)?;
            place.notices.extend(placed.notices);
            place.alignment = Some(placed.alignment);
            let Some(trajectory) = placed.trajectory else { return Ok(place) };
            place.trajectory = trajectory;
        }
        if matches!(spec.time_offset, Offset::Search) {
            let found = search_time_offset(recorded, &place.scene, &place.trajectory, time_offset_ns)?;
            let words = format!("time offset found: {:.4} s ± {:.4} s (95 %)", found.seconds, found.u95_s);
            place.notices.push(words);
            place.time_offset_ns = (found.seconds * 1e9).round() as i64;
            place.time_offset = Some(found);
        }
        if place.mapped.is_empty() {
            let height_m = recorded.rig.mean_height_m();
            let placement = Placement::new(&place.scene, &place.trajectory, height_m, origin);
            place.notices.extend(placement.doubts);
            place.is_misplaced = placement.is_wrong;
        }
        Ok(place)
    }
}

/// Makes a map of some frames.
fn map_of(
    spec: &MapSpec,
    recorded: &MountedRecording,
    trajectory: &Trajectory,
    time_offset_ns: i64,
    frames: &Range<u64>,
) -> Result<VoxelMap, WalkError> {
    let mut making = Making::new(spec)?;
    recorded.feed(&mut |mounted_frame| {
        if frames.contains(&mounted_frame.number) {
            making.add_frame(&recorded.rig, trajectory, time_offset_ns, &mounted_frame);
        }
    })?;
    let map = making.into_map();
    match map.counts()[1] {
        0 => Err(WalkError::EmptyMap { from: frames.start, end: frames.end }),
        _ => Ok(map),
    }
}
