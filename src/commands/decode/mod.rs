//! `outrigger decode`

mod clouds;
mod document;
mod frames;
mod output;
mod placing;
mod points;

use std::cell::{Cell, RefCell};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::Duration;

use anyhow::{bail, ensure};
use sensors::Decoded;
use sensors::router::Router;

use self::document::Document;
use self::frames::FrameRange;
use self::output::Output;
use self::placing::Placing;
use self::points::PointArgs;
use super::output::{print_json, print_text, say_notice};
use super::recording::Recording;
use super::sensor_args::SensorArgs;
use super::{Context, Outcome, sensor_ids, signals};
use crate::recording::export::{FileFrame, Format};
use crate::recording::registered::Registration;

const EXIT_CODES: &str = "\
Exit codes: 0 when everything that the recording holds of the sensors was decoded; 3 when it was decoded but data is \
missing: the file is cut off or damaged, datagrams lack fragments, or packets of a sensor were lost, late, malformed or \
failed their checksum; 1 when nothing could be decoded. A recording that merely begins or ends in the middle of a \
revolution is whole: its first or last frame says \"complete\": false.";

const INTERRUPTED: &str = "interrupted: whole files stay, unfinished ones are removed";
/// Time after Ctrl-C in which an unfinished file may still be closed.
const TO_END_WITHIN: Duration = Duration::from_secs(5);

/// Arguments of `decode`.
#[derive(clap::Args, Debug)]
#[command(after_help = EXIT_CODES)]
pub struct Args {
    /// Capture (pcap or pcapng; plain, gzip, zstd or lz4), bag (ROS 1, MCAP, db3, or the folder of one), session folder, or -
    /// for standard input.
    capture: PathBuf,
    #[command(flatten)]
    sensors: SensorArgs,
    /// Write points in this format; by default from the extension of --out.
    #[arg(long)]
    format: Option<Format>,
    /// File for all points, or folder (one that is there, or a name that ends in / or has no extension): one file per sensor
    /// and frame, a ROS 2 bag of mcap.
    #[arg(short, long, value_name = "PATH")]
    out: Option<PathBuf>,
    /// Frames of each sensor, counted from 0, end not included: 2..5, 2.., ..5 or 2. Without inertial samples.
    #[arg(long, value_name = "A..B")]
    frames: Option<FrameRange>,
    #[command(flatten)]
    points: PointArgs,
    /// Overwrite files that exist.
    #[arg(long)]
    force: bool,
    /// Print a line for every frame.
    #[arg(short, long)]
    verbose: bool,
}

impl Args {
    /// The format that was asked for: the extension of a typed file name overrides the one of the rig.toml.
    fn format(&self, context: Context) -> Option<Format> {
        let is_stated =
            self.out.as_deref().is_some_and(|out| !out.is_dir() && Format::of_path(out).is_some());
        let is_overridden = is_stated && context.is_typed("out") && !context.is_typed("format");
        self.format.filter(|_| !is_overridden)
    }
}

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    let format = args.format(context);
    let file_format = format.or_else(|| args.out.as_deref().and_then(Format::of_path));
    args.points.check(context, file_format)?;
    let sensors = args.sensors.or_of(context, &args.capture);
    let recording = match args.points.is_read_again() {
        true => Recording::open_to_reread(&args.capture, &sensors)?,
        false => Recording::open(&args.capture, &sensors)?,
    };
    Output::new(args, format, &recording, FileFrame::default())?; // refused before the work, not after
    if recording.holds_clouds_only() {
        return clouds::run(args, context, &recording);
    }
    let mut document = Document::default();
    let mut notices = Vec::new();
    let (mounts, registration) = args.points.registration(&recording, file_format, &mut notices)?;
    let mut placing = Placing { mounts, registration, recording: &recording };
    let mut output = Output::new(args, format, &recording, args.points.file_frame(&placing.registration))?;
    let mut router = recording.router()?;
    let frames = args.points.frames(args.frames);
    let problem: RefCell<Option<anyhow::Error>> = RefCell::new(None);
    let stop = signals::stop_within(TO_END_WITHIN, INTERRUPTED)?;
    let (host_time_ns, first_host_ns) = (Cell::new(0), Cell::new(None));
    let (mut ids, mut wanted) = (Vec::new(), BTreeMap::new());
    let mut take = |at: usize, sensor: &sensors::router::Sensor, decoded: Decoded<'_>| {
        first_host_ns.get().into_iter().for_each(|host_ns| placing.registration.begin(host_ns));
        let is_wanted = *wanted.entry(at).or_insert_with(|| {
            args.points.part.wants(&sensor_ids::next_id(sensor, &mut ids), sensor.serial())
        });
        if is_wanted
            && let Decoded::Frame(frame) = decoded
            && let Some(model) = sensor.model()
            && let number = document.count_frame(at)
            && frames.unwrap_or_default().contains(number)
            && placing.registration.is_wanted(frame.host_time_ns)
        {
            document.add_frame(at, sensor.timestamp_mode(), model, frame);
            if let Some(output) = &mut output
                && problem.borrow().is_none()
            {
                problem.replace(output.add(at, number, sensor, model, frame, &mut placing).err());
            }
        }
        if is_wanted
            && let Decoded::Imu(sample) = decoded
            && frames.is_none()
            && let Some(output) = &mut output
            && problem.borrow().is_none()
        {
            problem.replace(output.add_imu(at, sensor, sample, host_time_ns.get()).err().map(Into::into));
        }
        document.count_other(at, &decoded);
    };
    let go_on = || -> anyhow::Result<()> {
        if stop.load(Ordering::Relaxed) {
            bail!(INTERRUPTED);
        }
        problem.take().map_or(Ok(()), Err)
    };
    let ending = recording.each_packet(&mut |packet| {
        host_time_ns.set(packet.host_time_ns);
        first_host_ns.set(first_host_ns.get().or(Some(packet.host_time_ns)));
        router.push(packet, &mut take);
        go_on()
    })?;
    router.finish(&mut take);
    go_on()?;
    recording.ensure_given_fits(&router)?;
    ensure_met(args, &router)?;
    document.conclude(&recording, &router, &ending, &|id, serial| args.points.part.wants(id, serial));
    document.add_registration(&placing, notices);
    if document.is_empty() {
        if let Some(damage) = ending.damage {
            return Err(damage.into());
        }
        bail!("{}", super::unread::why_nothing(&recording, &router, &ending));
    }
    ensure_points(args, output.as_ref(), &placing.registration)?;
    finish(args, context, document, output)
}

/// Refuses to write a file without points.
fn ensure_points(args: &Args, output: Option<&Output>, registration: &Registration) -> anyhow::Result<()> {
    if output.is_none_or(|output| output.points() > 0) || !args.points.is_selective() {
        return Ok(());
    }
    match registration.losses() {
        Some(loss) => bail!("nothing is written: {loss}"),
        None => bail!(
            "nothing is written: no point is left by what was asked for (frames, times, sensors, ranges, box)"
        ),
    }
}

/// Refuses the name of a sensor that the recording does not hold.
fn ensure_met(args: &Args, router: &Router) -> anyhow::Result<()> {
    let ids = sensor_ids::ids(router);
    for name in &args.points.part.only {
        let is_met = ids.contains(name) || router.sensors().iter().any(|sensor| sensor.serial() == name);
        ensure!(is_met || ids.is_empty(), "--sensor {name}: no packet of it; there are {}", ids.join(", "));
    }
    Ok(())
}

/// Closes the files and prints.
fn finish(
    args: &Args,
    context: Context,
    mut document: Document,
    output: Option<Output>,
) -> anyhow::Result<Outcome> {
    if let Some(frames) = args.points.frames(args.frames) {
        document.ensure_frames(frames)?;
    }
    if let Some(output) = output {
        document.set_files(output.finish()?);
    }
    if context.json {
        print_json(&document)?;
    } else {
        print_text(&document.table(args.verbose))?;
    }
    document.notices().iter().for_each(|notice| say_notice(notice));
    Ok(if document.is_data_lost() { Outcome::DataLost } else { Outcome::Done })
}
