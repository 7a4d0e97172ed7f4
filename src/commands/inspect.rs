//! `outrigger inspect`

use std::path::PathBuf;

use super::sensor_args::SensorArgs;
use super::{Context, Outcome, output};
use crate::recording::Recording;
use crate::recording::inspection::inspect;
use crate::report::inspection::report;

const EXIT_CODES: &str = "\
Works without metadata too: Ouster formats are then guessed from packet sizes and contents. Exit codes: 0 when the \
recording is whole; 3 when data is missing (cut off or damaged file, lost, late or malformed packets, fragments that \
never came, a sensor that was silent all along, a session with a manifest that contradicts its packets); 1 when the file cannot be read, or a calibration does not fit its sensor. Ctrl-C ends it by the signal (a \
shell says 130): nothing is half written.";

/// Arguments of `inspect`.
#[derive(clap::Args, Debug)]
#[command(after_help = EXIT_CODES)]
pub struct Args {
    /// Capture (pcap or pcapng; plain, gzip, zstd or lz4), bag (ROS 1, MCAP, db3, or the folder of one), session folder, or -
    /// for standard input.
    capture: PathBuf,
    #[command(flatten)]
    sensors: SensorArgs,
}

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    let recording = Recording::open(&args.sensors.or_of(context, &args.capture))?;
    let document = inspect(&recording)?;
    output::print_result(context.json, &document, &report(&document), &[])?;
    Ok(if document.is_whole() { Outcome::Done } else { Outcome::DataLost })
}
