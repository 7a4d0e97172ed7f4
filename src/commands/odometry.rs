//! `outrigger odometry`: where the rig went, from its own recording.

use std::fmt::Write as _;
use std::path::PathBuf;

use anyhow::{Context as _, bail, ensure};
use sensors::Decoded;
use serde::Serialize;

use super::compare::hearing;
use super::compare::recorded::{Recorded, RecordedArgs};
use super::ground::suspicions;
use super::recording::Recording;
use super::{Context, Outcome, output, unread};
use crate::base::files::write_whole;
use crate::base::geometry::Pose;
use crate::design::registration::RegistrationQuality;
use crate::verify::odometry::{Limits, Odometry, Settings, Step, Sweeps, Walked};
use crate::world::trajectory::Trajectory;

/// Arguments of `odometry`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "The world is the body at the first return. A recording of several sensors needs their mounts; with one \
                  sensor and no mount, the body is the sensor. Sweeps of one revolution are laid against a map of those \
                  before (iterated closest points, each return at its own time). Where the surfaces leave a direction \
                  open, as a straight corridor does, the last velocity is kept along it and that is said: such a way is \
                  no measurement there.\n\
                  Exit codes: 0 done, 1 failed, 3 done, but data was lost."
)]
pub struct Args {
    #[command(flatten)]
    recorded: RecordedArgs,
    #[command(flatten)]
    settings: OdometryArgs,
    /// Write the way in TUM format: poses at the middle of every revolution and at both ends, on the recording's clock.
    #[arg(short, long, value_name = "FILE.tum")]
    out: Option<PathBuf>,
    /// Write the pose at which every revolution of the first sensor began, in KITTI format.
    #[arg(long, value_name = "FILE")]
    kitti: Option<PathBuf>,
}

/// How the way is looked for.
#[derive(clap::Args, Debug)]
pub struct OdometryArgs {
    /// Edge of a cell of odometry's map; by default a fifteenth of the median range, between 0.1 and 1 m.
    #[arg(long = "odometry-voxel", id = "odometry_voxel", value_name = "M", value_parser = crate::commands::ranges::within(0.01, 100.0))]
    voxel_m: Option<f64>,
    /// Returns nearer than this are not used by odometry: whoever carries the rig moves with it.
    #[arg(long = "odometry-min-range", id = "odometry_min_range", value_name = "M", default_value_t = 0.5, value_parser = crate::commands::ranges::within(0.0, 10_000.0))]
    nearest_m: f64,
    /// Returns farther than this are not used by odometry.
    #[arg(long = "odometry-max-range", id = "odometry_max_range", value_name = "M", default_value_t = 100.0, value_parser = crate::commands::ranges::within(1e-3, 10_000.0))]
    farthest_m: f64,
}

impl OdometryArgs {
    /// Refuses what was typed about odometry where the way is not found by it.
    pub fn ensure_not_typed(context: Context) -> anyhow::Result<()> {
        context.ensure_not_typed(
            &["odometry_voxel", "odometry_min_range", "odometry_max_range"],
            "is about --trajectory odometry, which is not asked for",
        )
    }

    fn check(&self) -> anyhow::Result<()> {
        if !(0.0..self.farthest_m).contains(&self.nearest_m) {
            refuse!("--odometry-min-range {}, expected from 0 to the greatest range", self.nearest_m);
        }
        Ok(())
    }
}

/// The document that `odometry` prints.
#[derive(Debug, Serialize)]
struct Document {
    format: &'static str,
    sensors: Vec<String>,
    sweeps: usize,
    duration_s: f64,
    length_m: f64,
    voxel_m: f64,
    registration: Option<RegistrationQuality>,
    /// Sweeps along which a direction was a guess.
    loose_sweeps: usize,
    steps: Vec<Step>,
    /// What is odd or was lost.
    problems: Vec<String>,
    files: Vec<String>,
    wall_s: f64,
}

/// A way with what was lost on it.
pub struct Way {
    pub walked: Walked,
    pub sensors: Vec<String>,
    /// Begin of every revolution of the first sensor, ns.
    pub revolutions_ns: Vec<u64>,
    pub losses: Vec<String>,
    /// What else is odd about its recording.
    pub notices: Vec<String>,
}

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    let start = std::time::Instant::now();
    args.settings.check()?;
    args.recorded.check_places([&args.out, &args.kitti])?;
    let mut notices = Vec::new();
    let way = match Recorded::open_if_seated(&args.recorded, context)? {
        Some(recorded) => {
            notices.clone_from(&recorded.notices);
            of_rig(&recorded, &args.settings)?
        }
        None => {
            let RecordedArgs { recording, sensors, .. } = &args.recorded;
            of_one(&Recording::open(recording, &sensors.of(context, recording))?, &args.settings)?
        }
    };
    let trajectory = &way.walked.trajectory;
    let mut files = Vec::new();
    let mut problems = notices;
    problems.extend(way.notices.iter().cloned());
    problems.extend(remarks(&way));
    let mut write = |path: &PathBuf, text: String| {
        files.push(path.display().to_string());
        write_whole(path, text.as_bytes()).with_context(|| format!("cannot write {}", path.display()))
    };
    if let Some(path) = &args.out {
        write(path, trajectory.to_tum())?;
    }
    if let Some(path) = &args.kitti {
        let placed = way.revolutions_ns.iter().filter_map(|at| Some((*at, trajectory.at(*at)?)));
        let begun: Vec<(u64, Pose)> = placed.collect();
        let missing = way.revolutions_ns.len() - begun.len();
        if missing > 0 {
            problems.push(format!("{missing} revolutions have no pose in the KITTI file"));
        }
        write(path, Trajectory::new(begun)?.to_kitti())?;
    }
    let [first_ns, last_ns] = trajectory.time_span_ns();
    let document = Document {
        format: "outrigger-odometry/1",
        sensors: way.sensors,
        sweeps: way.walked.steps.len(),
        duration_s: (last_ns - first_ns) as f64 * 1e-9,
        length_m: trajectory.length_m(),
        voxel_m: way.walked.voxel_m,
        loose_sweeps: way.walked.steps.iter().filter(|step| step.is_loose()).count(),
        registration: way.walked.quality,
        steps: way.walked.steps,
        problems,
        files,
        wall_s: start.elapsed().as_secs_f64(),
    };
    output::print_result(context.json, &document, || text(&document), &document.problems)?;
    Ok(if way.losses.is_empty() { Outcome::Done } else { Outcome::DataLost })
}

/// Where a rig of known mounts went.
pub fn of_rig(recorded: &Recorded, args: &OdometryArgs) -> anyhow::Result<Way> {
    args.check()?;
    let rig = &recorded.rig;
    let mut walk = Walk::new(rig.sensors.len(), args);
    let fed = recorded.feed(&mut |taken| {
        let mut mount = rig.sensors[taken.sensor].mount;
        mount.pitch_rad = taken.pitch_rad.unwrap_or(mount.pitch_rad);
        walk.add(taken.sensor, taken.model, &mount.body_from_sensor(), taken.frame);
    })?;
    if let Some(([first, second], apart_s)) = hearing::apart(rig, &fed.heard) {
        bail!(
            "{second} begins {apart_s:.3} s after {first} has ended, by their clocks: one way needs sensors that were recorded \
             at once, on one clock (PTP, or GPS)"
        );
    }
    let way = walk.finish(rig.sensors.iter().map(|sensor| sensor.name.clone()).collect(), fed.losses)?;
    Ok(Way { notices: fed.faults.into_iter().map(|fault| fault.words).collect(), ..way })
}

/// Where the only sensor of a recording went.
fn of_one(recording: &Recording, args: &OdometryArgs) -> anyhow::Result<Way> {
    let mut router = recording.router()?;
    let mut walk = Walk::new(1, args);
    let mut sensors = 0;
    let mut hand = |at: usize, sensor: &sensors::router::Sensor, decoded: Decoded<'_>| {
        let (Decoded::Frame(frame), Some(model)) = (decoded, sensor.model()) else { return };
        sensors = sensors.max(at + 1);
        if at == 0 {
            walk.add(0, model, &Pose::IDENTITY, frame);
        }
    };
    let ending = recording.each_packet(&mut |packet| {
        router.push(packet, &mut hand);
        Ok(())
    })?;
    router.finish(&mut hand);
    ensure!(sensors > 0, "{}", unread::why_nothing(recording, &router, &ending));
    ensure!(sensors == 1, "{} holds {sensors} sensors: --mount says where they sit", recording.name());
    recording.ensure_given_fits(&router)?;
    let mut losses = ending.losses();
    let names: Vec<String> = router.sensors().iter().map(|sensor| sensor.product().to_string()).collect();
    for (sensor, name) in router.sensors().iter().zip(&names) {
        losses.extend(unread::sensor_losses(name, sensor.stats()));
    }
    let way = walk.finish(names, losses)?;
    let notices = unread::strangers(&router).chain(unread::beam_notices(&router)).collect();
    Ok(Way { notices, ..way })
}

/// Odometry over a stream of frames.
struct Walk {
    sweeps: Sweeps,
    odometry: Odometry,
    revolutions_ns: Vec<u64>,
}

impl Walk {
    fn new(sensors: usize, args: &OdometryArgs) -> Self {
        let limits = Limits { nearest_m: args.nearest_m, farthest_m: args.farthest_m };
        let settings = Settings { voxel_m: args.voxel_m, reach_m: 1.5 * args.farthest_m };
        Self {
            sweeps: Sweeps::new(sensors, limits),
            odometry: Odometry::new(settings),
            revolutions_ns: Vec::new(),
        }
    }

    fn add(&mut self, sensor: usize, model: &sensors::SensorModel, seat: &Pose, frame: &sensors::Frame) {
        if let Some([first_ns, _]) = frame.time_span_ns().filter(|_| sensor == 0) {
            self.revolutions_ns.push(first_ns);
        }
        self.sweeps.add_frame(sensor, model, seat, frame);
        while let Some(sweep) = self.sweeps.next_whole() {
            self.odometry.add(sweep);
        }
    }

    fn finish(mut self, sensors: Vec<String>, mut losses: Vec<String>) -> anyhow::Result<Way> {
        while let Some(sweep) = self.sweeps.next_rest() {
            self.odometry.add(sweep);
        }
        let late = self.sweeps.late();
        if late > 0 {
            losses.push(format!(
                "{late} returns bear times before those already used (clocks of the sensors apart, or a clock set back): \
                 they were left out"
            ));
        }
        let walked = self.odometry.finish()?;
        let notices = Vec::new();
        Ok(Way { walked, sensors, revolutions_ns: self.revolutions_ns, losses, notices })
    }
}

/// What is odd about a way, in words.
pub fn remarks(way: &Way) -> Vec<String> {
    let walked = &way.walked;
    let mut remarks = way.losses.clone();
    remarks.extend(walked.problems.iter().cloned());
    let start_ns = walked.trajectory.time_span_ns()[0];
    let loose: Vec<&Step> = walked.steps.iter().filter(|step| step.is_loose()).collect();
    if let (Some(first), Some(last)) = (loose.first(), loose.last()) {
        let seconds = |step: &Step| step.time_ns.saturating_sub(start_ns) as f64 * 1e-9;
        let worst = loose.iter().filter_map(|step| Some((step.least_translation?, step.weakest_direction?)));
        let along = worst
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map_or(String::new(), |(_, [x, y, z])| format!(" along ({x:.2}, {y:.2}, {z:.2})"));
        remarks.push(format!(
            "cannot tell the way{along} in {} of {} revolutions, between {:.1} and {:.1} s: the surfaces leave it open, the \
             last velocity was kept",
            loose.len(),
            walked.steps.len(),
            seconds(first),
            seconds(last)
        ));
    }
    remarks.extend(suspicions(&walked.trajectory, "way found"));
    remarks
}

fn text(document: &Document) -> String {
    let mut text = format!(
        "{} of {} in {:.1} s: {:.3} m of way, map of {:.2} m cells\n",
        output::counted(document.sweeps as u64, "revolution"),
        document.sensors.join(", "),
        document.duration_s,
        document.length_m,
        document.voxel_m
    );
    if let Some(quality) = &document.registration {
        text.push_str(&quality.line());
    }
    for file in &document.files {
        let _ = writeln!(text, "{file}");
    }
    text
}
