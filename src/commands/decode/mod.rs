//! `outrigger decode`

mod clouds;
mod document;
mod frames;
mod output;

use std::cell::{Cell, RefCell};
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::Duration;

use anyhow::bail;
use sensors::Decoded;

use self::document::Document;
use self::frames::{FrameRange, OutputFrame};
use self::output::Output;
use super::given::SensorArgs;
use super::output::{print_json, print_text, say_notice};
use super::recording::Recording;
use super::{Context, Outcome, signals};
use crate::recording::export::Format;

const EXIT_CODES: &str = "\
Exit codes: 0 when everything that the recording holds of the sensors was decoded; 3 when it was decoded but data is \
missing: the file is cut off or damaged, datagrams lack fragments, or packets of a sensor were lost, late, malformed or \
failed their checksum; 1 when nothing could be decoded. A recording that merely begins or ends in the middle of a \
revolution is whole: its first or last frame says \"complete\": false.";

const INTERRUPTED: &str = "interrupted: files that were whole are kept, others are not";
/// Time after Ctrl-C in which a file under way may still be closed.
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
    /// Write points in this format; taken from the extension of --out where that says it.
    #[arg(long)]
    format: Option<Format>,
    /// File for all points, or folder (one that is there, or a name that ends in / or has no extension): one file per sensor
    /// and frame, a ROS 2 bag of mcap.
    #[arg(long, value_name = "PATH")]
    out: Option<PathBuf>,
    /// Frames of each sensor, counted from 0, end not included: 2..5, 2.., ..5 or 2. Without inertial samples.
    #[arg(long, value_name = "A..B")]
    frames: Option<FrameRange>,
    /// Frame of the points: each sensor's own, or the world's, where a bag of clouds holds static transforms and a trajectory.
    #[arg(long, value_enum, default_value_t)]
    frame: OutputFrame,
    /// Overwrite files that exist.
    #[arg(long)]
    force: bool,
}

impl Args {
    /// The format that was asked for: one of the rig.toml gives way to one that the typed name of a file says.
    fn format(&self, context: Context) -> Option<Format> {
        let is_said = self.out.as_deref().is_some_and(|out| !out.is_dir() && Format::of_path(out).is_some());
        let gives_way = is_said && context.is_typed("out") && !context.is_typed("format");
        self.format.filter(|_| !gives_way)
    }
}

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    let recording = Recording::open(&args.capture, &args.sensors.or_of(context, &args.capture))?;
    if recording.holds_clouds_only() {
        return clouds::run(args, context, &recording);
    }
    if args.frame == OutputFrame::World {
        bail!(
            "--frame world: {} holds packets, and only clouds of a bag are placed by its own trajectory; expected a bag with \
             clouds, static transforms and odometry, poses or transforms",
            recording.name()
        );
    }
    let mut output = Output::new(args, args.format(context), &recording)?;
    let mut router = recording.router()?;
    let frames = args.frames.unwrap_or_default();
    let mut document = Document::default();
    let problem = RefCell::new(None);
    let stop = signals::stop_within(TO_END_WITHIN, INTERRUPTED)?;
    let host_time_ns = Cell::new(0);
    let mut take = |at: usize, sensor: &sensors::router::Sensor, decoded: Decoded<'_>| {
        if let Decoded::Frame(frame) = decoded
            && let Some(model) = sensor.model()
            && let number = document.count_frame(at)
            && frames.contains(number)
        {
            document.add_frame(at, sensor.timestamp_mode(), model, frame);
            if let Some(output) = &mut output
                && problem.borrow().is_none()
            {
                problem.replace(output.add(at, number, sensor, model, frame).err());
            }
        }
        if let Decoded::Imu(sample) = decoded
            && args.frames.is_none()
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
        problem.take().map_or(Ok(()), |problem| Err(problem.into()))
    };
    let ending = recording.each_packet(&mut |packet| {
        host_time_ns.set(packet.host_time_ns);
        router.push(packet, &mut take);
        go_on()
    })?;
    router.finish(&mut take);
    go_on()?;
    recording.ensure_given_fits(&router)?;
    document.conclude(&recording, &router, &ending);
    if document.is_empty() {
        if let Some(damage) = ending.damage {
            return Err(damage.into());
        }
        bail!("{}", super::unread::why_nothing(&recording, &router, &ending));
    }
    finish(args, context, document, output)
}

/// Closes the files and prints.
fn finish(
    args: &Args,
    context: Context,
    mut document: Document,
    output: Option<Output>,
) -> anyhow::Result<Outcome> {
    if let Some(frames) = args.frames {
        document.ensure_frames(frames)?;
    }
    if let Some(output) = output {
        document.set_files(output.finish()?);
    }
    if context.json {
        print_json(&document)?;
    } else {
        print_text(&document.table())?;
    }
    document.notices().iter().for_each(|notice| say_notice(notice));
    Ok(if document.is_data_lost() { Outcome::DataLost } else { Outcome::Done })
}
