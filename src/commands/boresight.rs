//! `outrigger boresight`: how the sensors of a rig sit to each other, from their recording alone.

mod document;

use anyhow::ensure;

use super::odometry_args::OdometryArgs;
use super::recorded_args::RecordedArgs;
use super::scene_args::PoseErrorArgs;
use super::{Context, Outcome, output};
use crate::recording::mounted::MountedRecording;
use crate::recording::{TrajectorySource, read_trajectory};
use crate::verify::calibrate::{Pair, relative_mount};
use crate::verify::compare::{RaySample, RecordedRay};
use crate::verify::walk::OdometryResult;
use crate::world::trajectory::Trajectory;
use document::{Document, report, verdict, words};

/// Returns that are held, of all sensors together.
const RAYS: usize = 1 << 22;

/// Arguments of `boresight`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Each sensor's points are laid into the planes that the other sensor's points make, a few revolutions at a \
                  time. What is left over is the error of the first's mount relative to the second's; no model \
                  of the scene is needed, and an error of the trajectory that both share cancels. Turns and shifts are those of \
                  the first sensor about the axes of the mount frame (x right, y forward, z up) as the second one sees it: where \
                  the second is the one that is turned, the first seems shifted by as much as that turn moves it. Nothing is changed.\n\
                  Exit codes: 0 the mounts are as specified, 1 failed, 3 they differ, cannot be determined, or data was lost."
)]
pub struct Args {
    #[command(flatten)]
    recorded: RecordedArgs,
    /// Trajectory of the body: TUM format on the recording's clock, `still` for a rig that does not move, or `odometry` for
    /// the one that odometry finds in the recording; without it the recording's own, else odometry.
    #[arg(long, value_name = "FILE")]
    trajectory: Option<TrajectorySource>,
    #[command(flatten)]
    pose_error: PoseErrorArgs,
    #[command(flatten)]
    odometry: OdometryArgs,
}

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    let start = std::time::Instant::now();
    let error = args.pose_error.error();
    if matches!(args.trajectory, Some(TrajectorySource::Still | TrajectorySource::File(_))) {
        OdometryArgs::ensure_not_typed(context)?;
    }
    let recorded = MountedRecording::open(&args.recorded.spec(context))?;
    ensure!(recorded.rig.sensors.len() > 1, "the mount file names one sensor: two can sit to each other");
    let mut problems = recorded.notices.clone();
    let trajectory = trajectory(args, &recorded, &mut problems)?;
    let RaySample { rays, sensors, pass } = RaySample::of(&recorded, RAYS)?;
    problems.extend(recorded.contradicted(&pass));
    let mut relative = Vec::new();
    for first in 0..sensors.len() {
        for second in first + 1..sensors.len() {
            let of_both: Vec<RecordedRay> =
                rays.iter().filter(|ray| [first, second].contains(&ray.sensor)).copied().collect();
            let revolution_ns = if pass.revolution_ns > 0 { pass.revolution_ns } else { 100_000_000 };
            let pair = Pair {
                trajectory: &trajectory,
                sensors: &sensors,
                first,
                second,
                rays: &of_both,
                revolution_ns,
            };
            relative.push(relative_mount(&pair, &error));
        }
    }
    let whole = pass.losses.is_empty() && pass.faults.is_empty();
    problems.extend(pass.losses);
    problems.extend(pass.faults.into_iter().map(|fault| fault.words));
    let document = Document {
        format: "outrigger-boresight/1",
        verdict: verdict(&relative),
        words: relative.iter().map(words).collect(),
        relative,
        problems,
        wall_s: start.elapsed().as_secs_f64(),
    };
    output::print_result(context.json, &document, &report(&document), &document.problems)?;
    Ok(if document.verdict == "matches" && whole { Outcome::Done } else { Outcome::DataLost })
}

fn trajectory(
    args: &Args,
    recorded: &MountedRecording,
    problems: &mut Vec<String>,
) -> anyhow::Result<Trajectory> {
    match &args.trajectory {
        Some(TrajectorySource::Still) => return Ok(recorded.still()?),
        Some(TrajectorySource::Odometry) => {}
        Some(TrajectorySource::File(path)) => {
            let (trajectory, notes) = read_trajectory(path, None)?;
            problems.extend(notes);
            return Ok(trajectory);
        }
        None => {
            // it may lie in any frame
            if let Some(own) = recorded.own_trajectory()?.or(recorded.poses_of_bag()?) {
                problems.extend(own.notes);
                return Ok(own.trajectory);
            }
        }
    }
    let found = OdometryResult::of_rig(recorded, &args.odometry.spec(), false)?;
    problems.extend(found.remarks());
    Ok(found.walked.trajectory)
}
