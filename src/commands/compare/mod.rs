//! `outrigger compare`: does a recording cover what was predicted, and are the mounts as specified.

pub mod page;
pub mod place;

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use serde::Serialize;

use super::scene_args::{PoseErrorArgs, read_trajectory};
use super::stage::Stage;
use super::{Context, Outcome, output};
use crate::base::files::{check_folder, write_json};
use crate::report::chart::signed;
use crate::rig::{MountFile, Rig};
use crate::simulate::scan::{Scanner, Spin};
use crate::verify::align::Alignment;
use crate::verify::calibrate::SensorCheck;
use crate::verify::compare::{Gate, Healthy, Patches, Replay, Replayed, TimeOffset};
use crate::world::coverage::{Coverage, VoxelGrid};
use crate::world::local_origin::LocalOrigin;
use crate::world::scene::Scene;
use crate::world::trajectory::Trajectory;

use super::recorded::axes::AxisSummary;
use super::recorded::feed::{PassSummary, SensorSummary};
use super::recorded::judge::{self, Inputs};
use super::recorded::{Recorded, RecordedArgs, data_gaps};
use crate::verify::judgement::comparison::{Comparison, Reason, Verdict};
use place::PlaceArgs;

/// Samples of the surface.
const SAMPLES: usize = 200_000;
/// Distance between the points of the path from which lines of sight are drawn, m.
const STATION_STEP_M: f64 = 0.5;
/// Most frames after which what was found is dropped from the search.
const SETTLE_EVERY: u64 = 16;

/// Arguments of `compare`.
#[derive(clap::Args, Debug)]
#[command(
    group = clap::ArgGroup::new("place").required(true),
    after_help = "Every recorded ray is cast into the scene from the nominal mount (as measured, where a session holds what \
                  its axes measured) and the trajectory: it agrees, ends short or long, is dropped or extra. Coverage counts \
                  the predicted ends of the rays that agree, so that noise and wrong poses can only lower it.\n\
                  A trajectory in a frame of its own is placed in the scene with --align; without one, odometry finds one and it \
                  is placed.\n\
                  Exit codes: 0 the recording covers what was predicted (a pitch that is not observable is no failure, \
                  and is named separately), 1 failed, 3 it does not, too little was recorded to tell, or data was lost."
)]
pub struct Args {
    #[command(flatten)]
    recorded: RecordedArgs,
    #[command(flatten)]
    place: PlaceArgs,
    /// The planned trajectory (TUM): its coverage with nominal mounts is compared with that of the driven one.
    #[arg(long, value_name = "FILE")]
    planned: Option<PathBuf>,
    /// Edge of a voxel.
    #[arg(long, value_name = "M", default_value_t = 0.1, value_parser = crate::commands::ranges::within(1e-3, 1000.0))]
    voxel: f64,
    /// A recorded and a predicted range agree within this.
    #[arg(long, value_name = "M", default_value_t = 0.1, value_parser = crate::commands::ranges::within(1e-3, 1000.0))]
    gate: f64,
    /// Healthy runs that are simulated as the reference of the recording: where it stands no worse than 1 in 20 of them, it is healthy,
    /// which fewer than 19 cannot tell.
    #[arg(long, value_name = "N", default_value_t = 19, value_parser = clap::value_parser!(u16).range(0..=999))]
    nulls: u16,
    #[command(flatten)]
    pose_error: PoseErrorArgs,
    /// Of samples and simulated runs.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Folder for report.html and report.json.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Write a mount file with the tilts and positions that were found; nothing else is changed.
    #[arg(long, value_name = "FILE")]
    corrected_mount: Option<PathBuf>,
}

/// The document that `compare` prints.
#[derive(Debug, Serialize)]
pub struct Document {
    pub format: &'static str,
    #[serde(flatten)]
    pub comparison: Comparison,
    pub recording: Vec<SensorSummary>,
    /// What the axes measured, where the session holds it.
    pub rig: Vec<AxisSummary>,
    /// Zeros of servo axes that would make their readings true; never applied.
    pub servo_zero: Vec<ZeroOffer>,
    /// What is odd or was lost.
    pub problems: Vec<String>,
    /// Where the trajectory lies in the scene; null where its frame is the scene's.
    pub alignment: Option<Alignment>,
    pub time_offset_s: f64,
    /// With how sure it is, where it was looked for.
    pub time_offset: Option<TimeOffset>,
    pub wall_s: f64,
}

/// What to add to what an axis measures so that it is its sensor's tilt.
#[derive(Debug, Serialize)]
pub struct ZeroOffer {
    pub sensor: String,
    /// Mean of what the axis measured, degrees.
    pub measured_deg: f64,
    /// What was typed to be added, degrees.
    pub typed_deg: f64,
    /// Found less measured, degrees; what was typed as its zero is part of it.
    pub add_deg: f64,
    /// Half of its 95 % interval, degrees.
    pub u95_deg: f64,
}

impl ZeroOffer {
    /// For every sensor on a measured axis with an observable pitch.
    fn of(axes: &[AxisSummary], mount: &[SensorCheck]) -> Vec<Self> {
        let offer = |axis: &AxisSummary| {
            let check = mount.iter().find(|check| check.sensor == axis.sensor)?;
            Some(Self {
                sensor: axis.sensor.clone(),
                measured_deg: axis.measured_pitch_deg,
                typed_deg: axis.zero_deg,
                add_deg: axis.zero_deg + check.tilt_error_deg?,
                u95_deg: check.u95_deg?,
            })
        };
        axes.iter().filter_map(offer).collect()
    }

    /// In words.
    pub(crate) fn words(&self) -> String {
        let (sensor, measured) = (&self.sensor, signed(self.measured_deg, 3));
        if (self.add_deg - self.typed_deg).abs() <= self.u95_deg {
            let typed = match self.typed_deg == 0.0 {
                true => String::new(),
                false => format!(" with {} deg added to it", signed(self.typed_deg, 3)),
            };
            return format!(
                "the axis of {sensor} measured {measured} deg, and{typed} the sensor sat there: its zero is right within \
                 {:.3} deg",
                self.u95_deg
            );
        }
        format!(
            "the axis of {sensor} measured {measured} deg and the sensor sat at {}: its zero wants {} +- {:.3} deg (offered, not \
             applied: --axis-zero {}={} compares with it)",
            signed(self.measured_deg + self.add_deg, 3),
            signed(self.add_deg, 3),
            self.u95_deg,
            sensor,
            signed(self.add_deg, 3)
        )
    }
}

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    let start = std::time::Instant::now();
    let error = args.pose_error.error();
    check(args, context)?;
    let recorded = Recorded::open(&args.recorded, context)?;
    let place = place::read(&args.place, &recorded, context)?;
    if let Some(alignment) = place.alignment.as_ref().filter(|alignment| alignment.placed().is_none()) {
        let problems = recorded.notices.iter().chain(&place.notices).cloned().collect();
        return unplaced(args, context, alignment, problems, start.elapsed().as_secs_f64());
    }
    let rig = &recorded.rig;
    let (scene, trajectory) = (&place.scene, &place.trajectory);
    let grid = grid(args, scene)?;
    let height_m = rig.sensors.iter().map(|s| s.mount.z_m).sum::<f64>() / rig.sensors.len() as f64;
    let stations: Vec<_> =
        trajectory.stations_m(STATION_STEP_M).into_iter().map(|at| at + height_m * glam::DVec3::Z).collect();
    let patches = Patches::of_scene(scene, SAMPLES, args.seed, &stations);
    let gate = Gate { agree_within_m: args.gate, time_offset_ns: place.time_offset_ns, ..Gate::default() };
    let mut replay = Replay::new(scene, trajectory, rig.sensors.clone(), &grid, gate);
    if let Some(patches) = &patches {
        replay = replay.with_surface(patches);
    }
    let (replayed, mut pass) = replayed(&recorded, replay, &place.mapped)?;
    let trajectory_ns =
        trajectory.time_span_ns().map(|time_ns| time_ns.saturating_add_signed(-place.time_offset_ns));
    pass.faults.extend(data_gaps::data_gaps(rig, &pass.data_spans, trajectory_ns));
    let planned = planned(args, scene, rig, &grid, place.origin)?;
    let stage = Stage::begin("looking for a better reading of the recording");
    let comparison = judge::judge(
        Inputs {
            is_own_trajectory: place.is_odometry,
            scene,
            trajectory,
            origin: place.origin,
            patches: patches.as_ref(),
            planned: planned.as_ref(),
            healthy: Healthy { pose: error, runs: args.nulls.into(), seed: args.seed, ..Healthy::default() },
            revolution_ns: pass.revolution_ns,
            agree_within_m: args.gate,
            faults: std::mem::take(&mut pass.faults),
            stage: &stage,
        },
        &replayed,
    );
    drop(stage);
    let axes = recorded.axes(&pass);
    let mut problems = recorded.notices.clone();
    problems.extend(recorded.contradicted(&pass));
    problems.extend(place.notices);
    problems.extend(pass.losses.iter().cloned());
    let document = Document {
        format: "outrigger-compare/1",
        recording: pass.sensors,
        servo_zero: ZeroOffer::of(&axes, &comparison.mount),
        rig: axes,
        problems,
        alignment: place.alignment,
        time_offset_s: place.time_offset_ns as f64 * 1e-9,
        time_offset: place.time_offset,
        wall_s: start.elapsed().as_secs_f64(),
        comparison,
    };
    let written = write(args, &document, &replayed, (scene, place.origin), trajectory, recorded.mount);
    // a disk that is full by now takes the files, not what was found
    let outcome = conclude(args, context, &document, pass.losses.is_empty() && !place.is_misplaced)?;
    Ok(if written? { outcome } else { Outcome::DataLost })
}

/// The document where no place of the trajectory in the scene is sure: nothing is compared.
#[derive(Serialize)]
struct Unplaced<'a> {
    format: &'static str,
    verdict: Verdict,
    reason: Reason,
    words: [String; 1],
    alignment: &'a Alignment,
    problems: Vec<String>,
    wall_s: f64,
}

fn unplaced(
    args: &Args,
    context: Context,
    alignment: &Alignment,
    problems: Vec<String>,
    wall_s: f64,
) -> anyhow::Result<Outcome> {
    let document = Unplaced {
        format: "outrigger-compare/1",
        verdict: Verdict::CannotTell,
        reason: Reason::of_placement(alignment),
        words: [alignment.words()],
        alignment,
        problems,
        wall_s,
    };
    if let Some(out) = &args.out {
        std::fs::create_dir_all(out).with_context(|| format!("cannot use the folder {}", out.display()))?;
        let json = out.join("report.json");
        write_json(&json, &document).with_context(|| format!("cannot write {}", json.display()))?;
    }
    let text = || format!("{} {}\n", Verdict::CannotTell.label(), document.words[0]);
    output::print_result(context.json, &document, text, &document.problems)?;
    Ok(Outcome::DataLost)
}

fn check(args: &Args, context: Context) -> anyhow::Result<()> {
    place::check(&args.place, context)?;
    if let Some(out) = &args.out {
        check_folder(out).with_context(|| format!("cannot use the folder {}", out.display()))?;
    }
    args.recorded.check_places([&args.corrected_mount])
}

/// Most cells of a comparison, each of which is a bit of several bitmaps (2 GiB each).
const MOST_CELLS: f64 = 17_179_869_184.0;

fn grid(args: &Args, scene: &Scene) -> anyhow::Result<VoxelGrid> {
    let bounds_m = scene.bounds_m();
    let cells = (bounds_m[1] - bounds_m[0]) / args.voxel + 2.0;
    if cells.max_element() > f64::from(1 << 23) || cells.element_product() > MOST_CELLS {
        bail!(
            "--voxel {} makes {cells:.0} cells of this scene, expected {MOST_CELLS:.0} in all at most; is the mesh in metres?",
            args.voxel
        );
    }
    Ok(VoxelGrid::centred_on(bounds_m, args.voxel))
}

/// Replays all frames but those that made the map.
fn replayed(
    recorded: &Recorded,
    mut replay: Replay<'_>,
    mapped: &std::ops::Range<u64>,
) -> anyhow::Result<(Replayed, PassSummary)> {
    let mut frames = 0_u64;
    let pass = recorded.feed(&mut |mounted_frame| {
        if mapped.contains(&mounted_frame.number) {
            return;
        }
        replay.set_model(mounted_frame.sensor, mounted_frame.model);
        let pitch = mounted_frame.pitch_or(&recorded.rig.sensors[mounted_frame.sensor].mount);
        replay.add_pitched_frame(mounted_frame.sensor, &pitch, mounted_frame.frame);
        frames += 1;
        // often at first, when most is found
        if frames.is_power_of_two() || frames.is_multiple_of(SETTLE_EVERY * 8) {
            replay.settle();
        }
    })?;
    // silent because nothing of it was left, not because it is dead
    let used_up = pass.sensors.iter().find(|s| s.frames > 0 && mapped.start == 0 && s.frames <= mapped.end);
    if let Some(SensorSummary { sensor, frames, .. }) = used_up {
        bail!(
            "--map-frames 0..{} leaves nothing to compare: {sensor} recorded {frames} revolutions",
            mapped.end
        );
    }
    Ok((replay.finish(), pass))
}

/// What the nominal mounts cover on the planned trajectory.
fn planned(
    args: &Args,
    scene: &Scene,
    rig: &Rig,
    grid: &VoxelGrid,
    origin: LocalOrigin,
) -> anyhow::Result<Option<Coverage>> {
    let Some(path) = &args.planned else { return Ok(None) };
    let (trajectory, notes) = read_trajectory(path, None)?;
    notes.iter().for_each(|note| output::say_notice(note));
    let trajectory = origin.local_trajectory(trajectory);
    let mut scanner = Scanner::new(scene, &trajectory, rig, Spin::default());
    // a replay lets beams pass through the other sensors too
    scanner.occluders.iter_mut().for_each(Vec::clear);
    let mut coverage = Coverage::new(grid.clone(), rig.sensors.len());
    scanner.cover(&mut coverage);
    Ok(Some(coverage))
}

/// The files; false where one that was asked for has nothing to say.
fn write(
    args: &Args,
    document: &Document,
    replayed: &Replayed,
    (scene, origin): (&Scene, LocalOrigin),
    trajectory: &Trajectory,
    mut file: MountFile,
) -> anyhow::Result<bool> {
    if let Some(out) = &args.out {
        let cannot = |path: &Path| format!("cannot write {}", path.display());
        std::fs::create_dir_all(out).with_context(|| format!("cannot use the folder {}", out.display()))?;
        let json = out.join("report.json");
        write_json(&json, document).with_context(|| cannot(&json))?;
        let html = out.join("report.html");
        let page = page::page(document, replayed, scene, trajectory, (args.gate, origin));
        page.write(&html).with_context(|| cannot(&html))?;
    }
    if let Some(path) = &args.corrected_mount {
        let found_offset = document.comparison.mount.iter().any(|check| check.tilt_error_deg.is_some());
        if !found_offset {
            output::say_notice("no corrected mount is written: the pitch of no sensor is observable");
            return Ok(false);
        }
        for (entry, check) in file.sensors.iter_mut().zip(&document.comparison.mount) {
            entry.x_m = check.corrected.x_m;
            entry.y_m = check.corrected.y_m;
            entry.z_m = check.corrected.z_m;
            entry.pitch_deg = check.corrected.pitch_rad.to_degrees();
            entry.roll_deg = check.corrected.roll_rad.to_degrees();
        }
        file.masters = None;
        file.master_models = None;
        file.objective = None;
        file.write(path)?;
    }
    Ok(true)
}

fn conclude(args: &Args, context: Context, document: &Document, whole: bool) -> anyhow::Result<Outcome> {
    if context.json {
        output::print_json(document)?;
    } else {
        output::print_text(&page::text(document))?;
        if let Some(out) = &args.out {
            output::print_text(&format!("{}\n", out.join("report.html").display()))?;
        }
    }
    for problem in &document.problems {
        output::say_notice(problem);
    }
    let matches = document.comparison.verdict == Verdict::Matches;
    Ok(if matches && whole { Outcome::Done } else { Outcome::DataLost })
}
