//! `outrigger demo`: the whole loop on mock devices. Optimize, tilt the mock rig, walk while two mock sensors send UDP,
//! record, open the recording again, decode, compare with the prediction, report.

mod conclude;
mod folder;
mod progress;

use std::path::PathBuf;

use anyhow::Context as _;

use super::{Context, Outcome, signals};
use crate::base::files::write_json;
use crate::mock::demo::{self, DemoFault, Document, FORMAT, Walk};
use crate::recording::Session;
use crate::world::coverage::VoxelGrid;
use crate::world::trajectory::Gait;

use folder::{REPORT_HTML, REPORT_JSON, SESSION, prepare_folder};
use progress::Progress;

/// Arguments of `demo`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Leaves in its folder: report.html, report.json, mount.json and the recorded session.\n\
                        Exit codes: 0 recorded what was predicted, 1 failed, 3 finished but data was lost or differs."
)]
pub struct Args {
    /// Folder for everything the demo makes; it must be absent, empty, or left by an earlier demo.
    #[arg(long, value_name = "DIR", default_value = "demo", env = "OUTRIGGER_OUT")]
    out: PathBuf,
    /// The experiment that gives sensors and hall: paper-os1-64 or paper-vlp-16.
    #[arg(long, default_value = "paper-os1-64")]
    preset: String,
    /// Evaluations of the search.
    #[arg(long, value_name = "N", default_value_t = 400, value_parser = clap::value_parser!(u32).range(1..=20_000))]
    evals: u32,
    /// Seed of the search and of the mock rig.
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,
    /// Walking speed, m/s.
    #[arg(long, value_name = "M_PER_S", default_value_t = 2.0, value_parser = crate::commands::ranges::within(0.05, 50.0))]
    speed: f64,
    /// How many times faster than life the walk runs.
    #[arg(long, value_name = "FACTOR", default_value_t = 4.0, value_parser = crate::commands::ranges::within(0.01, 1000.0))]
    rate: f64,
    /// Break something in the middle of the walk, to see what happens.
    #[arg(long, value_enum)]
    fault: Option<DemoFault>,
}

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    let stop = signals::stop_flag()?;
    prepare_folder(&args.out)?;
    let mut progress = Progress::new();

    progress.stage("optimize", "1/5 searching the best pitches");
    let plan = demo::search(&args.preset, args.evals as usize, args.seed, &progress.bar.progress())?;
    plan.mount.write(&args.out.join("mount.json"))?;
    let scene = plan.hall();
    let path = plan.straight_path(args.speed);
    let trajectory = Gait::default().walk(&path);
    let grid = VoxelGrid::centred_on(scene.bounds_m(), plan.voxel_m());
    let walk = Walk {
        scene: &scene,
        planned: &path,
        trajectory: &trajectory,
        rig: &plan.rig,
        mount: &plan.mount,
        rate: args.rate,
        fault: args.fault,
        stop: &stop,
    };
    let planned = demo::predict(&walk, &grid)?;

    progress.stage("tilt", "2/5 driving the mock rig");
    let tilted = demo::drive(&plan.rig, args.seed)?;

    progress.stage("record", "3/5 walking and recording");
    let session_dir = args.out.join(SESSION);
    let walked = demo::record(&walk, tilted, &session_dir, &progress.bar.progress())?;
    if let Some(failure) = walked.failure {
        let dir = session_dir.display();
        let words = format!("the walk ended early; what was recorded until then is in {dir}");
        return Err(anyhow::Error::from(failure).context(words));
    }

    progress.stage("compare", "4/5 replaying and comparing");
    let session = Session::open(&session_dir)?;
    let bar = &progress.bar;
    let mut replayed = demo::compare(&session, &plan.rig, &scene, &planned, &bar.progress(), &bar.judging())?;
    let problems = demo::problems(&session_dir, &session, &walk, &walked, &mut replayed.sensors);

    progress.stage("report", "5/5 writing the report");
    let mut document = Document {
        format: FORMAT,
        command: again(args),
        optimize: plan.summary,
        rig: replayed.rig,
        recording: replayed.sensors,
        compare: replayed.compare,
        problems,
        wall_s: Default::default(),
    };
    let report = demo::report(&document, &replayed.replayed, &scene, &trajectory);
    let (html, json) = (args.out.join(REPORT_HTML), args.out.join(REPORT_JSON));
    report.write(&html, &document.command).with_context(|| format!("cannot write {}", html.display()))?;
    document.wall_s = progress.finish();
    write_json(&json, &document).with_context(|| format!("cannot write {}", json.display()))?;
    conclude::conclude(&args.out, context, (&document, report))
}

fn again(args: &Args) -> String {
    let fault = match args.fault {
        None => "",
        Some(DemoFault::CutCable) => " --fault cut-cable",
        Some(DemoFault::KillSensor) => " --fault kill-sensor",
    };
    format!(
        "outrigger demo --preset {} --evals {} --seed {} --speed {} --rate {}{fault}",
        args.preset, args.evals, args.seed, args.speed, args.rate
    )
}
