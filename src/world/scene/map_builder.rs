//! Making a map of returns: those of recorded frames, or the points of a cloud.

use std::path::{Path, PathBuf};

use sensors::projection::{returns, sample_azimuth_rad, sample_time_ns};
use sensors::{Frame, SensorModel};
use serde::Serialize;

use super::{CloudFileError, CloudPoint, Strays, VoxelMap, VoxelMapError, read_cloud};
use crate::base::geometry::Pose;
use crate::world::local_origin::LocalOrigin;
use crate::world::trajectory::Trajectory;

/// Returns beyond this range are rejected, m.
const MAX_RANGE_M: f64 = 300.0;

/// What a map was made of.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct MapSummary {
    made_of: &'static str,
    voxel_m: f64,
    points: u64,
    occupied_cells: u64,
    free_cells: u64,
    /// Points with an unknown sensor position: no voxel before them is known to be free.
    points_from_nowhere: u64,
    /// Where the frame of the computation begins in that of the points.
    local_origin_m: [f64; 3],
}

impl MapSummary {
    /// In words.
    pub(crate) fn words(&self) -> String {
        format!(
            "{} occupied and {} free cells of {} m, made of {} points of a {}",
            self.occupied_cells, self.free_cells, self.voxel_m, self.points, self.made_of
        )
    }

    /// Whether the map knows free voxels from unknown ones.
    pub(crate) fn knows_free(&self) -> bool {
        self.free_cells > 0
    }
}

/// A map with where it begins.
pub(crate) struct MadeMap {
    /// In the local frame.
    pub map: VoxelMap,
    pub origin: LocalOrigin,
    pub summary: MapSummary,
    pub warnings: Vec<String>,
}

/// Why a map cannot be made.
#[derive(Debug, thiserror::Error)]
pub(crate) enum MapError {
    #[error(transparent)]
    Cloud(#[from] CloudFileError),
    #[error("{name}: a map of it takes more than 4 GiB in cells of {voxel_m} m: give a larger --map-voxel")]
    TooLarge { name: String, voxel_m: f64 },
    #[error("{name}: no cell of {voxel_m} m holds {min_hits} points or more, so there is nothing to hit")]
    Empty { name: String, voxel_m: f64, min_hits: u8 },
    #[error(
        "{name}: its points have no time (timestamp, time or gps_time), so that --map-path cannot say where they were seen from"
    )]
    NoTime { name: String },
    #[error(
        "{name}: its points are of {:.3} to {:.3} s, {} goes from {:.3} to {:.3} s: no point falls into the trajectory's time",
        .points_s[0], .points_s[1], .trajectory.display(), .trajectory_s[0], .trajectory_s[1]
    )]
    OtherTime { name: String, points_s: [f64; 2], trajectory: PathBuf, trajectory_s: [f64; 2] },
}

/// A map that is being made.
pub(crate) struct MapBuilder {
    map: VoxelMap,
    /// Near what came first; the map begins there.
    origin: Option<LocalOrigin>,
    notes: Vec<String>,
    min_hits: u8,
    points: u64,
    /// Points without a finite position.
    without_position: u64,
    without_origin: u64,
}

impl MapBuilder {
    /// `min_hits` points make a voxel occupied.
    pub(crate) fn new(voxel_m: f64, min_hits: u8) -> Result<Self, VoxelMapError> {
        let map = VoxelMap::new(voxel_m, min_hits, MAX_RANGE_M)?;
        Ok(Self {
            map,
            origin: None,
            notes: Vec::new(),
            min_hits,
            points: 0,
            without_position: 0,
            without_origin: 0,
        })
    }

    /// Adds the returns of a frame that fall into the trajectory's time; `body_from_sensor` at a time of the sensor's clock, ns.
    pub(crate) fn add_frame(
        &mut self,
        model: &SensorModel,
        body_from_sensor: &dyn Fn(u64) -> Pose,
        trajectory: &Trajectory,
        time_offset_ns: i64,
        frame: &Frame,
    ) {
        let origin = *self.origin.get_or_insert_with(|| LocalOrigin::near(trajectory.bounds_m()[0]));
        for (column, channel, range_mm) in returns(model, frame) {
            let device_ns = sample_time_ns(model, frame, column, channel);
            let time_ns = device_ns.saturating_add_signed(time_offset_ns);
            let Some(world_from_body) = trajectory.at(time_ns) else { continue };
            let world_from_sensor = world_from_body * body_from_sensor(frame.column_time_ns[column]);
            let azimuth_rad = sample_azimuth_rad(model, frame, column, channel);
            let origin_m = world_from_sensor.transform_point(model.ray(channel, azimuth_rad).origin_m);
            let point = model.point(channel, azimuth_rad, f64::from(range_mm) * 1e-3);
            let point_m = world_from_sensor.transform_point(point);
            self.map.add_return(origin.local(origin_m), origin.local(point_m));
            self.points += 1;
        }
    }

    /// Adds every point of a cloud, seen from where the cloud says or from where the trajectory was at its time.
    pub(crate) fn add_cloud(
        &mut self,
        path: &Path,
        trajectory: Option<(&Path, Trajectory)>,
    ) -> Result<(), MapError> {
        let (mut timed, mut span_s) = (0_u64, [f64::INFINITY, f64::NEG_INFINITY]);
        let notes = read_cloud(path, |CloudPoint { position_m, seen_from_m, time_s }| {
            if !position_m.is_finite() {
                self.without_position += 1;
                return;
            }
            self.points += 1;
            let origin = *self.origin.get_or_insert_with(|| LocalOrigin::near(position_m));
            if let Some(time_s) = time_s {
                timed += 1;
                span_s = [span_s[0].min(time_s), span_s[1].max(time_s)];
            }
            let at = |(_, trajectory): &(&Path, Trajectory)| {
                let time_ns = time_s.filter(|time_s| *time_s >= 0.0)? * 1e9;
                trajectory.at(time_ns.round() as u64).map(|pose| pose.translation_m)
            };
            match seen_from_m.or_else(|| trajectory.as_ref().and_then(at)) {
                Some(from_m) => self.map.add_return(origin.local(from_m), origin.local(position_m)),
                None => {
                    self.without_origin += 1;
                    self.map.add_point(origin.local(position_m));
                }
            }
        })?;
        self.notes.extend(notes);
        let Some((trajectory_path, trajectory)) = trajectory else { return Ok(()) };
        if self.without_origin < self.points || self.points == 0 {
            return Ok(());
        }
        let name = path.display().to_string();
        if timed == 0 {
            return Err(MapError::NoTime { name });
        }
        let trajectory_s = trajectory.time_span_ns().map(|time_ns| time_ns as f64 * 1e-9);
        Err(MapError::OtherTime { name, points_s: span_s, trajectory: trajectory_path.into(), trajectory_s })
    }

    /// The map, around its local origin.
    pub(crate) fn finish(mut self, path: &Path, made_of: &'static str) -> Result<MadeMap, MapError> {
        let name = path.display();
        let origin = self.origin.unwrap_or_default();
        let voxel_m = self.map.voxel_m();
        if self.map.is_full() {
            return Err(MapError::TooLarge { name: name.to_string(), voxel_m });
        }
        let strays = self.map.drop_strays(MAX_RANGE_M);
        let [free_cells, occupied_cells] = self.map.counts();
        if occupied_cells == 0 {
            return Err(MapError::Empty { name: name.to_string(), voxel_m, min_hits: self.min_hits });
        }
        let mut warnings = std::mem::take(&mut self.notes);
        if let Some(Strays { cells, at_m }) = strays {
            let at_m = origin.world(at_m);
            warnings.push(format!(
                "{name}: {cells} cells further than {MAX_RANGE_M} m from all the rest are left out, one at ({:.0}, {:.0}, \
                 {:.0}) m: stray points?",
                at_m.x, at_m.y, at_m.z
            ));
        }
        if self.without_position > 0 {
            warnings.push(format!("{name}: {} points without a place are left out", self.without_position));
        }
        if self.map.rejected() > 0 {
            warnings.push(format!(
                "{name}: {} points further than {MAX_RANGE_M} m from the sensor, or out of all reach, are left out",
                self.map.rejected()
            ));
        }
        if self.without_origin > 0 {
            warnings.push(format!(
                "{name}: {} of {} points do not say where they were seen from (vp_x, vp_y, vp_z, or their time with --map-path): what is free before them is unknown",
                self.without_origin, self.points
            ));
        }
        let summary = MapSummary {
            made_of,
            voxel_m,
            points: self.points,
            occupied_cells,
            free_cells,
            points_from_nowhere: self.without_origin,
            local_origin_m: origin.world_m().to_array(),
        };
        Ok(MadeMap { map: self.map, origin, summary, warnings })
    }

    /// The map alone, of frames that a caller chose.
    pub(crate) fn into_map(self) -> VoxelMap {
        self.map
    }
}
