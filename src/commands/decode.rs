//! `outrigger decode`

mod points;

use std::path::PathBuf;
use std::time::Duration;

use super::sensor_args::SensorArgs;
use super::{Context, Outcome, output, signals};
use crate::recording::decoding::{
    DecodingSpec, FrameRange, INTERRUPTED, decode, decode_clouds, ensure_output,
};
use crate::recording::export::Format;
use crate::recording::{Recording, RecordingSpec};
use crate::report::decoding;
use crate::verify::walk::registration;
use points::PointArgs;

const EXIT_CODES: &str = "\
Exit codes: 0 when everything that the recording holds of the sensors was decoded; 3 when it was decoded but data is \
missing: the file is cut off or damaged, datagrams lack fragments, or packets of a sensor were lost, late, malformed or \
failed their checksum; 1 when nothing could be decoded, or --out would hold no point. A recording that merely begins or \
ends in the middle of a revolution is whole: its first or last frame says \"complete\": false.";

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
    args.points.check(context, format.or_else(|| args.out.as_deref().and_then(Format::of_path)))?;
    let (out, is_forced, frames) = (args.out.clone(), args.force, args.frames);
    let spec = DecodingSpec { format, out, is_forced, frames, ..args.points.spec() };
    let of = args.sensors.or_of(context, &args.capture);
    let recording = Recording::open(&RecordingSpec { is_read_again: spec.is_read_again(), ..of })?;
    ensure_output(&spec, &recording)?; // refused before the work, not after
    let document = if recording.holds_clouds_only() {
        context.ensure_not_typed(
            &["mount"],
            "is for packets: clouds of a bag sit as its static transforms say",
        )?;
        if !spec.is_moved() {
            let words = "needs --frame world: the bag holds clouds";
            context.ensure_not_typed(&["trajectory", "time_offset"], words)?;
        }
        decode_clouds(&spec, &recording)?
    } else {
        let mut notices = Vec::new();
        let placing = registration(&spec, &recording, &mut notices)?;
        let stop = signals::stop_within(TO_END_WITHIN, INTERRUPTED)?;
        decode(&spec, &recording, placing, notices, &stop)?
    };
    output::print_result(context.json, &document, &decoding::report(&document), document.notices())?;
    Ok(if document.is_data_lost() { Outcome::DataLost } else { Outcome::Done })
}
