//! The scene behind `--scene`: a mesh, or a map of cells made of a recording or of a point cloud.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context as _, anyhow, bail, ensure};
use glam::DVec3;
use sensors::projection::{returns, sample_azimuth_rad, sample_time_ns};
use serde::Serialize;

use super::compare::axes::{AxisZeros, tilts};
use super::compare::feed::{self, Seated, Taken};
use super::ground::{MeshArgs, MeshTaken};
use super::stage::Stage;
use super::{Context, wrong_usage};
use crate::recording::Session;
use crate::rig::Rig;
use crate::world::scene::{
    CLOUD_ENDINGS, CloudPoint, MESH_ENDINGS, Mesh, MeshFileError, Scene, Strays, VoxelMap, is_cloud,
    read_cloud,
};
use crate::world::trajectory::Trajectory;

/// Rays longer than this are not believed, m.
const LONGEST_RAY_M: f64 = 300.0;

/// How a recording or a cloud becomes a map.
#[derive(clap::Args, Debug, Clone)]
pub struct MapArgs {
    /// Edge of a cell of a map that is made of a recording or a cloud.
    #[arg(long, value_name = "M", default_value_t = 0.1, value_parser = crate::commands::ranges::within(1e-3, 1000.0))]
    map_voxel: f64,
    /// Points that make a cell of such a map occupied.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..))]
    map_hits: u8,
    /// Way of the sensor that recorded the cloud behind --scene (TUM, by the clock of the cloud's times): what lies
    /// between it and the points is free. Not needed where the points have vp_x, vp_y, vp_z. Of a recorded session the way
    /// of the rig, where the session does not hold it itself.
    #[arg(long, value_name = "FILE")]
    map_path: Option<PathBuf>,
}

/// A scene as read.
pub struct ReadScene {
    pub scene: Scene,
    /// Of the scene, where it is one.
    pub mesh: Option<(Arc<Mesh>, MeshTaken)>,
    pub map: Option<MapTaken>,
    pub warnings: Vec<String>,
}

/// What a map was made of.
#[derive(Clone, Debug, Serialize)]
pub struct MapTaken {
    made_of: &'static str,
    voxel_m: f64,
    points: u64,
    occupied_cells: u64,
    free_cells: u64,
    /// Points of which nobody knows where they were seen from: no cell before them is known to be free.
    points_from_nowhere: u64,
}

impl MapTaken {
    /// One line of a summary.
    pub fn line(&self) -> String {
        format!(
            "map            {} occupied and {} free cells of {} m, made of {} points of a {}\n",
            self.occupied_cells, self.free_cells, self.voxel_m, self.points, self.made_of
        )
    }

    /// Whether it tells free cells from unknown ones.
    pub fn knows_free(&self) -> bool {
        self.free_cells > 0
    }
}

/// Arguments about a mesh, and about a map.
const OF_A_MESH: [&str; 2] = ["mesh_unit", "up"];
const OF_A_MAP: [&str; 3] = ["map_voxel", "map_hits", "map_path"];

/// Refuses what was typed about a mesh or a map where the scene is neither; `what` it is, in words.
pub fn ensure_none_typed(context: Context, what: &str) -> anyhow::Result<()> {
    context.ensure_not_typed(&OF_A_MESH, format!("is about the mesh behind --scene, and {what}"))?;
    context.ensure_not_typed(
        &OF_A_MAP,
        format!("is about a map that is made of a recording or a cloud, and {what}"),
    )
}

/// Refuses what was typed about a scene behind `--scene` where the map is made of frames of the recording itself.
pub fn ensure_of_frames(context: Context) -> anyhow::Result<()> {
    let of_another = ["mesh_unit", "up", "map_path"];
    context.ensure_not_typed(
        &of_another,
        "is about what lies behind --scene, and the map is made of --map-frames",
    )
}

/// Reads whatever the path names.
pub fn read(
    path: &Path,
    mesh_args: &MeshArgs,
    map_args: &MapArgs,
    context: Context,
) -> anyhow::Result<ReadScene> {
    let is_session = Session::is_session(path);
    if path.is_dir() && !is_session {
        bail!("{}: a folder that is no session; expected a session, a mesh or a cloud", path.display());
    }
    if !is_session && !is_cloud(path) {
        context.ensure_not_typed(
            &OF_A_MAP,
            format!("is about a map that is made of a session or a cloud, and {} is neither", path.display()),
        )?;
        let read = mesh_args.read(path).map_err(|error| match error.downcast_ref() {
            Some(MeshFileError::UnknownFormat { .. }) => anyhow!(
                "{}: its name has no ending that is known; expected a session, a mesh ({MESH_ENDINGS}) or a cloud \
                 ({CLOUD_ENDINGS})",
                path.display()
            ),
            _ => error,
        })?;
        let mesh = Arc::new(read.mesh);
        let scene = Scene::Mesh(mesh.clone());
        return Ok(ReadScene { scene, mesh: Some((mesh, read.taken)), map: None, warnings: read.warnings });
    }
    context.ensure_not_typed(
        &OF_A_MESH,
        format!("is about a mesh, and {} is none: maps are in metres, z up", path.display()),
    )?;
    let mut making = Making::new(map_args)?;
    let mut warnings = Vec::new();
    let way =
        map_args.map_path.as_deref().map(|path| Ok::<_, anyhow::Error>((path, way(path)?))).transpose()?;
    if is_session {
        warnings.extend(making.of_session(path, way.map(|(_, way)| way))?);
    } else {
        making.of_cloud(path, way)?;
    }
    let (map, taken) = making.finish(path, if is_session { "recording" } else { "cloud" }, &mut warnings)?;
    Ok(ReadScene { scene: Scene::Voxels(Arc::new(map)), mesh: None, map: Some(taken), warnings })
}

fn way(path: &Path) -> anyhow::Result<Trajectory> {
    let name = path.display().to_string();
    let text = crate::base::files::read_text(path).with_context(|| name.clone())?;
    Trajectory::from_tum(&text).context(name)
}

/// A map under way.
pub struct Making {
    map: VoxelMap,
    least_hits: u8,
    points: u64,
    /// Points without a place.
    blind: u64,
    from_nowhere: u64,
}

impl Making {
    /// Nothing known yet.
    pub fn new(args: &MapArgs) -> anyhow::Result<Self> {
        let map = VoxelMap::new(args.map_voxel, args.map_hits, LONGEST_RAY_M)
            .map_err(|error| wrong_usage(format!("--map-voxel: {error}")))?;
        Ok(Self { map, least_hits: args.map_hits, points: 0, blind: 0, from_nowhere: 0 })
    }

    /// Adds the returns of a recorded frame that fall into the trajectory's time.
    pub fn add_frame(&mut self, rig: &Rig, trajectory: &Trajectory, time_offset_ns: i64, taken: &Taken<'_>) {
        let mut mount = rig.sensors[taken.sensor].mount;
        mount.pitch_rad = taken.pitch_rad.unwrap_or(mount.pitch_rad);
        let body_from_sensor = mount.body_from_sensor();
        let (model, frame) = (taken.model, taken.frame);
        for (column, channel, range_mm) in returns(model, frame) {
            let time_ns = sample_time_ns(model, frame, column, channel).saturating_add_signed(time_offset_ns);
            let Some(world_from_body) = trajectory.at(time_ns) else { continue };
            let world_from_sensor = world_from_body * body_from_sensor;
            let azimuth_rad = sample_azimuth_rad(model, frame, column, channel);
            let origin_m = world_from_sensor.transform_point(model.ray(channel, azimuth_rad).origin_m);
            let point = model.point(channel, azimuth_rad, f64::from(range_mm) * 1e-3);
            self.map.add_return(origin_m, world_from_sensor.transform_point(point));
            self.points += 1;
        }
    }

    /// Every frame of a session, by its own mount and the way given, or its own; what the session lost.
    fn of_session(&mut self, path: &Path, way: Option<Trajectory>) -> anyhow::Result<Vec<String>> {
        let session = Session::open(path)?;
        let lacks =
            |what: &str| format!("{}: the session holds no {what}, and a map needs one", path.display());
        let file = session.mount()?.with_context(|| lacks("mount file"))?;
        let own_or_given = match way {
            Some(way) => Some(way),
            None => session.trajectory()?,
        };
        let trajectory =
            own_or_given.with_context(|| format!("{}: give it with --map-path", lacks("trajectory")))?;
        let rig = file.rig()?;
        let (tilts, _) = tilts(&session, &rig, &AxisZeros::default())?;
        let mut take = |taken: Taken<'_>| self.add_frame(&rig, &trajectory, 0, &taken);
        let seated = Seated { session: &session, rig: &rig, tilts: &tilts, calibrations: &[] };
        let stage = Stage::begin("making a map of the session");
        let fed = feed::session(&seated, &stage, &mut take)?;
        Ok(fed.losses.iter().map(|loss| format!("{}: {loss}", path.display())).collect())
    }

    /// Every point of a cloud, seen from where it says or from where the way was at its time.
    fn of_cloud(&mut self, path: &Path, way: Option<(&Path, Trajectory)>) -> anyhow::Result<()> {
        let (mut timed, mut span_s) = (0_u64, [f64::INFINITY, f64::NEG_INFINITY]);
        read_cloud(path, |CloudPoint { position_m, seen_from_m, time_s }| {
            if !position_m.is_finite() {
                self.blind += 1;
                return;
            }
            self.points += 1;
            if let Some(time_s) = time_s {
                timed += 1;
                span_s = [span_s[0].min(time_s), span_s[1].max(time_s)];
            }
            let at = |(_, way): &(&Path, Trajectory)| {
                let time_ns = time_s.filter(|time_s| *time_s >= 0.0)? * 1e9;
                way.at(time_ns.round() as u64).map(|pose| pose.translation_m)
            };
            match seen_from_m.or_else(|| way.as_ref().and_then(at)) {
                Some(origin_m) => self.map.add_return(origin_m, position_m),
                None => {
                    self.from_nowhere += 1;
                    self.map.add_point(position_m);
                }
            }
        })?;
        let Some((way_path, way)) = way else { return Ok(()) };
        if self.from_nowhere < self.points || self.points == 0 {
            return Ok(());
        }
        let [start_s, end_s] = way.time_span_ns().map(|time_ns| time_ns as f64 * 1e-9);
        if timed == 0 {
            bail!(
                "{}: its points have no time (timestamp, time or gps_time), so that --map-path cannot say where they were seen from",
                path.display()
            );
        }
        bail!(
            "{}: its points are of {:.3} to {:.3} s, {} goes from {start_s:.3} to {end_s:.3} s: no point falls into the way's time",
            path.display(),
            span_s[0],
            span_s[1],
            way_path.display()
        );
    }

    /// The map, with what deserves a second look.
    pub fn finish(
        mut self,
        path: &Path,
        made_of: &'static str,
        warnings: &mut Vec<String>,
    ) -> anyhow::Result<(VoxelMap, MapTaken)> {
        let name = path.display();
        ensure!(
            !self.map.is_full(),
            "{name}: a map of it takes more than 4 GiB in cells of {} m: give a larger --map-voxel",
            self.map.voxel_m()
        );
        if let Some(Strays { cells, at_m }) = self.map.drop_strays(LONGEST_RAY_M) {
            warnings.push(format!(
                "{name}: {cells} cells further than {LONGEST_RAY_M} m from all the rest are left out, one at ({:.0}, {:.0}, \
                 {:.0}) m: stray points?",
                at_m.x, at_m.y, at_m.z
            ));
        }
        let [free_cells, occupied_cells] = self.map.counts();
        ensure!(
            occupied_cells > 0,
            "{name}: no cell of {} m holds {} points or more, so there is nothing to hit",
            self.map.voxel_m(),
            self.least_hits
        );
        if self.blind > 0 {
            warnings.push(format!("{name}: {} points without a place are left out", self.blind));
        }
        if self.map.rejected() > 0 {
            warnings.push(format!(
                "{name}: {} points further than {LONGEST_RAY_M} m from the sensor, or out of all reach, are left out",
                self.map.rejected()
            ));
        }
        if self.from_nowhere > 0 {
            warnings.push(format!(
                "{name}: {} of {} points do not say where they were seen from (vp_x, vp_y, vp_z, or their time with --map-path): what is free before them is unknown",
                self.from_nowhere, self.points
            ));
        }
        let taken = MapTaken {
            made_of,
            voxel_m: self.map.voxel_m(),
            points: self.points,
            occupied_cells,
            free_cells,
            points_from_nowhere: self.from_nowhere,
        };
        Ok((self.map, taken))
    }

    /// The map alone, of frames that a caller chose.
    pub fn into_map(self) -> VoxelMap {
        self.map
    }
}

/// The grid of a map's own cells, or of others from its least corner on.
pub fn map_grid(map: &VoxelMap, voxel_m: f64) -> crate::world::coverage::VoxelGrid {
    let [low, high] = map.bounds_m();
    let cells = ((high - low) / voxel_m - 1e-6).ceil().max(DVec3::ONE);
    let cells = [cells.x, cells.y, cells.z].map(|count| count as usize);
    crate::world::coverage::VoxelGrid { origin_m: low, voxel_m, cells }
}
