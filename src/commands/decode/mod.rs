//! `outrigger decode`

mod document;
mod frames;
mod output;

use std::path::PathBuf;

use anyhow::bail;
use sensors::Decoded;

use self::document::Document;
use self::frames::FrameRange;
use self::output::Output;
use super::output::{print_json, print_text, say_notice};
use super::recording::Recording;
use super::{Context, Outcome};
use crate::export::Format;

/// Arguments of `decode`.
///
/// Exit codes: 0 when everything that the recording holds of the sensors was decoded, 3 when it was decoded but data
/// is missing: the file is cut off or damaged, datagrams lack fragments, or packets of a sensor were lost, late,
/// malformed or failed their checksum. A recording that merely begins or ends in the middle of a revolution is
/// whole: its first or last frame says `"complete": false`. Exit code 1 when nothing could be decoded.
#[derive(clap::Args, Debug)]
#[command(verbatim_doc_comment)]
pub struct Args {
    /// Capture (pcap or pcapng, plain or gzip), session folder, or - for standard input.
    capture: PathBuf,
    /// Metadata of an Ouster sensor; once per sensor. Velodyne sensors need none.
    #[arg(long = "meta", value_name = "META.json")]
    meta: Vec<PathBuf>,
    /// Write points in this format; taken from the extension of --out where that says it.
    #[arg(long)]
    format: Option<Format>,
    /// File for all points, or folder for one file per sensor and frame.
    #[arg(long, value_name = "PATH")]
    out: Option<PathBuf>,
    /// Frames of each sensor, counted from 0, end not included: 2..5, 2.., ..5 or 2.
    #[arg(long, value_name = "A..B")]
    frames: Option<FrameRange>,
    /// Overwrite files that exist.
    #[arg(long)]
    force: bool,
}

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    let recording = Recording::open(&args.capture, &args.meta)?;
    let mut output = Output::new(args, &recording)?;
    let mut router = recording.router()?;
    let frames = args.frames.unwrap_or_default();
    let mut document = Document::default();
    let mut problem = None;
    let mut take = |at: usize, sensor: &sensors::router::Sensor, decoded: Decoded<'_>| {
        if let Decoded::Frame(frame) = decoded
            && let Some(model) = sensor.model()
            && let number = document.count_frame(at)
            && frames.contains(number)
        {
            document.add_frame(at, model, frame);
            if let Some(output) = &mut output
                && problem.is_none()
            {
                problem = output.add(at, number, sensor, model, frame).err();
            }
        }
        document.count_other(at, &decoded);
    };
    let ending = recording.each_packet(&mut |packet| {
        router.push(packet, &mut take);
        Ok(())
    })?;
    router.finish(&mut take);
    if let Some(problem) = problem {
        return Err(problem.into());
    }
    document.conclude(&recording, &router, &ending);
    if document.is_empty() {
        if let Some(damage) = ending.damage {
            return Err(damage.into());
        }
        bail!("{}", super::unread::why_nothing(&recording, &router, &ending));
    }
    if let Some(output) = output {
        document.set_files(output.finish()?);
    }
    if context.json {
        print_json(&document)?;
    } else {
        print_text(&document.table())?;
    }
    for notice in document.notices() {
        say_notice(notice);
    }
    Ok(if document.is_data_lost() { Outcome::DataLost } else { Outcome::Done })
}
