//! `outrigger demo`: the whole loop on mock devices. Optimize, tilt the mock rig, walk while two mock sensors send UDP,
//! record, open the recording again, decode, compare with the prediction, report.

mod document;
mod page;
mod plan;
mod progress;
mod replay;
mod tilt;
mod walk;

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use glam::DVec3;

use super::{Context, Outcome, output, signals};
use crate::base::files::write_json;
use crate::commands::recorded::feed::SensorSummary;
use crate::live::receive::now_ns;
use crate::recording::Session;
use crate::verify::judgement::comparison::Verdict;
use crate::world::coverage::VoxelGrid;
use crate::world::scene::{BoxScene, Scene};
use crate::world::trajectory::{Gait, Trajectory};

use document::{Document, FORMAT};
use progress::Progress;
use walk::{Walk, Walked};

/// Files the demo leaves in its folder.
const REPORT_JSON: &str = "report.json";
const REPORT_HTML: &str = "report.html";
const SESSION: &str = "session";
/// Marks a folder as made by the demo, from its first moment on.
const MARK: &str = ".outrigger-demo";

/// Arguments of `demo`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Leaves in its folder: report.html, report.json, mount.json and the recorded session.\n\
                        Exit codes: 0 recorded what was promised, 1 failed, 3 finished but data was lost or differs."
)]
pub struct Args {
    /// Folder for everything the demo makes; it must be absent, empty, or left by an earlier demo.
    #[arg(long, value_name = "DIR", default_value = "demo", env = "OUTRIGGER_OUT")]
    out: PathBuf,
    /// The experiment whose sensors and hall are used: paper-os1-64 or paper-vlp-16.
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
    /// Break something half way, to see what happens.
    #[arg(long, value_enum)]
    fault: Option<Fault>,
}

/// What can be broken half way.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// The rig's cable: its pty closes.
    CutCable,
    /// The first sensor dies.
    KillSensor,
}

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    let stop = signals::stop_flag()?;
    prepare_folder(&args.out)?;
    let mut progress = Progress::new();

    progress.stage("optimize", "1/5 searching the best pitches");
    let plan = plan::search(&args.preset, args.evals as usize, args.seed, &progress.bar)?;
    plan.mount.write(&args.out.join("mount.json"))?;
    let scene = Scene::Box(BoxScene::closed(plan.preset.box_min_m.into(), plan.preset.box_max_m.into()));
    let way = straight_way(plan.preset, args.speed);
    let trajectory = Gait::default().walk(&way);
    let grid = VoxelGrid::centred_on(scene.bounds_m(), plan.preset.voxel_m);
    let walk = Walk {
        scene: &scene,
        planned: &way,
        trajectory: &trajectory,
        rig: &plan.rig,
        mount: &plan.mount,
        rate: args.rate,
        fault: args.fault,
        stop: &stop,
    };
    let planned = walk::promise(&walk, &grid)?;

    progress.stage("tilt", "2/5 driving the mock rig");
    let tilted = tilt::drive(&plan.rig, args.seed)?;

    progress.stage("record", "3/5 walking and recording");
    let session_dir = args.out.join(SESSION);
    let walked = walk::record(&walk, tilted, &session_dir, &progress.bar)?;
    if let Some(failure) = walked.failure {
        return Err(failure.context(format!(
            "the walk ended early; what was recorded until then is in {}",
            session_dir.display()
        )));
    }

    progress.stage("compare", "4/5 replaying and comparing");
    let session = Session::open(&session_dir)?;
    let mut replayed = replay::compare(&session, &plan.rig, &scene, &planned, &progress.bar)?;
    let problems = problems(args, &session, &walk, &walked, &mut replayed.sensors);

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
    let page = page::page(&document, &replayed.replayed);
    let html = args.out.join(REPORT_HTML);
    page.write(&html).with_context(|| format!("cannot write {}", html.display()))?;
    document.wall_s = progress.finish();
    let json = args.out.join(REPORT_JSON);
    write_json(&json, &document).with_context(|| format!("cannot write {}", json.display()))?;
    conclude(args, context, &document)
}

/// The demo's folder: made, or cleared of an earlier demo; anybody else's files stay and are an error.
fn prepare_folder(out: &Path) -> anyhow::Result<()> {
    let mark = out.join(MARK);
    let cannot = || format!("cannot use the folder {}", out.display());
    std::fs::create_dir_all(out).with_context(cannot)?;
    let is_empty = std::fs::read_dir(out).with_context(cannot)?.next().is_none();
    if !is_empty && !mark.is_file() {
        bail!("{} holds files that no demo made: give another folder with --out", out.display());
    }
    for name in [REPORT_HTML, REPORT_JSON] {
        match std::fs::remove_file(out.join(name)) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                return Err(error).with_context(cannot);
            }
            _ => {}
        }
    }
    match std::fs::remove_dir_all(out.join(SESSION)) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => return Err(error).with_context(cannot),
        _ => {}
    }
    std::fs::write(mark, "made by outrigger demo, which may clear this folder\n").with_context(cannot)
}

/// Along the platform's own forward axis through the middle of the hall.
fn straight_way(preset: &crate::simulate::published::Preset, speed_m_s: f64) -> Trajectory {
    let half_m = preset.path_length_m / 2.0;
    let at = |x_m: f64| DVec3::new(x_m, 0.0, preset.platform_height_m);
    Trajectory::straight(at(-half_m), at(half_m), speed_m_s, now_ns())
}

/// Everything that was lost or fell silent, in words.
fn problems(
    args: &Args,
    session: &Session,
    walk: &Walk<'_>,
    walked: &Walked,
    sensors: &mut [SensorSummary],
) -> Vec<String> {
    let mut problems = session.problems().to_vec();
    let [start_ns, end_ns] = walk.trajectory.time_span_ns();
    let most_frames = sensors.iter().map(|sensor| sensor.frames).max().unwrap_or(0);
    for (sensor, sent) in sensors.iter_mut().zip(&walked.packets_sent) {
        sensor.packets_sent = *sent;
        if sensor.lost > 0 {
            problems.push(format!("sensor {} lost {} packets", sensor.sensor, sensor.lost));
        }
        // the first and the last revolution may be cut short
        if sensor.frames + 2 < most_frames {
            let seconds = (end_ns - start_ns) as f64 * 1e-9;
            problems.push(format!(
                "sensor {} fell silent: {} revolutions in a walk of {seconds:.1} s, the other has {most_frames}",
                sensor.sensor, sensor.frames
            ));
        }
    }
    if walked.manifest.complete && sensors.iter().all(|sensor| sensor.frames == 0) {
        problems.push(format!("nothing was recorded into {}", args.out.join(SESSION).display()));
    }
    problems
}

fn again(args: &Args) -> String {
    let fault = match args.fault {
        None => "",
        Some(Fault::CutCable) => " --fault cut-cable",
        Some(Fault::KillSensor) => " --fault kill-sensor",
    };
    format!(
        "outrigger demo --preset {} --evals {} --seed {} --speed {} --rate {}{fault}",
        args.preset, args.evals, args.seed, args.speed, args.rate
    )
}

fn conclude(args: &Args, context: Context, document: &Document) -> anyhow::Result<Outcome> {
    let counts = &document.compare.coverage;
    let iou = |iou: Option<f64>| iou.map_or("no IoU".into(), |iou| format!("IoU {iou:.5}"));
    let cells = iou(document.compare.model.iou);
    let patches = document.compare.agreement.as_ref().and_then(|agreement| agreement.patches.agreement.iou);
    if context.json {
        output::print_json(document)?;
    } else {
        output::print_text(&format!(
            "planned {}, as driven {}, recorded {} cells ({cells}); patches of surface as driven against recorded {}: {}\n{}\n",
            counts.planned,
            counts.as_driven,
            counts.recorded,
            iou(patches),
            match document.compare.verdict {
                Verdict::Matches => "matches",
                Verdict::Differs => "differs",
                Verdict::CannotTell => "cannot tell",
            },
            args.out.join(REPORT_HTML).display()
        ))?;
    }
    for problem in &document.problems {
        output::say_notice(problem);
    }
    let fine = document.problems.is_empty() && document.compare.verdict == Verdict::Matches;
    Ok(if fine { Outcome::Done } else { Outcome::DataLost })
}
