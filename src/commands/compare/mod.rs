//! `outrigger compare`: does a recording cover what was predicted, and are the mounts as specified.

mod document;
mod files;
mod place;

use std::path::PathBuf;

use anyhow::Context as _;

use super::recorded_args::RecordedArgs;
use super::scene_args::PoseErrorArgs;
use super::stage::Stage;
use super::{Context, Outcome};
use crate::base::files::check_folder;
use crate::recording::mounted::{MountedRecording, data_gaps};
use crate::report::comparison;
use crate::verify::compare::{Gate, Healthy, Replaying, grid_over, seen_patches};
use crate::verify::judgement::judge::{Inputs, judge};
use crate::verify::walk::WalkSite;
use document::Document;
use files::{conclude, unplaced, write};
use place::PlaceArgs;

/// Samples of the surface, and the distance between the points of the path from which lines of sight are drawn, m.
const SAMPLES: usize = 200_000;
const STATION_STEP_M: f64 = 0.5;

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

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    let start = std::time::Instant::now();
    let error = args.pose_error.error();
    check(args, context)?;
    let recorded = MountedRecording::open(&args.recorded.spec(context))?;
    let place = WalkSite::find(args.place.spec(context)?, &recorded)?;
    if let Some(alignment) = place.alignment.as_ref().filter(|alignment| alignment.placed().is_none()) {
        let problems = recorded.notices.iter().chain(&place.notices).cloned().collect();
        return unplaced(args, context, alignment, problems, start.elapsed().as_secs_f64());
    }
    let rig = &recorded.rig;
    let (scene, trajectory) = (&place.scene, &place.trajectory);
    let grid = grid_over(scene, args.voxel)?;
    let sampling = (SAMPLES, STATION_STEP_M, args.seed);
    let patches = seen_patches(scene, rig.mean_height_m(), trajectory, sampling);
    let gate = Gate { agree_within_m: args.gate, time_offset_ns: place.time_offset_ns, ..Gate::default() };
    let (patches, mapped) = (patches.as_ref(), place.mapped.clone());
    let replaying = Replaying { scene, trajectory, rig, grid: &grid, gate, patches, mapped };
    let (replayed, mut pass) = replaying.run(|take| recorded.feed(take))?;
    let trajectory_ns =
        trajectory.time_span_ns().map(|time_ns| time_ns.saturating_add_signed(-place.time_offset_ns));
    pass.faults.extend(data_gaps(rig, &pass.data_spans, trajectory_ns));
    let planned = place::planned(args.planned.as_deref(), &place, &recorded.rig, &grid)?;
    let stage = Stage::begin("looking for a better reading of the recording");
    let comparison = judge(
        Inputs {
            is_own_trajectory: place.is_odometry,
            scene,
            trajectory,
            origin: place.origin,
            patches,
            planned: planned.as_ref(),
            healthy: Healthy { pose: error, runs: args.nulls.into(), seed: args.seed, ..Healthy::default() },
            revolution_ns: pass.revolution_ns,
            agree_within_m: args.gate,
            faults: std::mem::take(&mut pass.faults),
            report: &stage.judging(),
        },
        &replayed,
    );
    drop(stage);
    let document = Document::new(&recorded, &place, &pass, comparison, start.elapsed().as_secs_f64());
    let pictures = comparison::Pictures {
        replayed: &replayed,
        scene,
        trajectory,
        agree_within_m: args.gate,
        origin: place.origin,
    };
    let report = document.report(args.out.as_ref().map(|_| &pictures));
    let written = write(args, (&document, &report), recorded.mount);
    // a disk that is full by now takes the files, not what was found
    let outcome =
        conclude(args, context, (&document, report), pass.losses.is_empty() && !place.is_misplaced)?;
    Ok(if written? { outcome } else { Outcome::DataLost })
}

fn check(args: &Args, context: Context) -> anyhow::Result<()> {
    place::check(&args.place, context)?;
    if let Some(out) = &args.out {
        check_folder(out).with_context(|| format!("cannot use the folder {}", out.display()))?;
    }
    args.recorded.check_places([&args.corrected_mount])
}
