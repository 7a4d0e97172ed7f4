//! `outrigger cut`: packets to packets.

use std::path::PathBuf;

use anyhow::ensure;

use super::part::PartArgs;
use super::sensor_args::SensorArgs;
use super::{Context, Outcome, output};
use crate::recording::cutting::{Cutting, CuttingSpec, Document};
use crate::recording::packet_writer::PacketFormat;
use crate::report::Report;

/// Arguments of `cut`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Payloads stay as they are, bit for bit, and times to the nanosecond. A bag has no addresses: each sensor gets \
                  the topics of its name (/NAME/lidar_packets, /NAME/imu_packets, /NAME/velodyne_packets, \
                  /NAME/position_packets) and, for an Ouster, /NAME/metadata. Packets from a bag get made-up addresses \
                  (192.0.2.0/24) in a capture.\n\
                  Exit codes: 0 done, 1 failed, 3 done, but some of the recording is missing or could not be assigned to a \
                  sensor."
)]
pub struct Args {
    /// Captures, bags or session folders; several are joined in this order.
    #[arg(required = true, value_name = "RECORDING")]
    recordings: Vec<PathBuf>,
    #[command(flatten)]
    sensors: SensorArgs,
    /// File to write: .pcap, .pcapng, .bag (ROS 1) or .mcap (ROS 2).
    #[arg(short, long, value_name = "FILE")]
    out: PathBuf,
    #[command(flatten)]
    part: PartArgs,
    /// Where the sensors sit: written to a bag as static transforms. Without it a session's own, or those of the bag that is read.
    #[arg(long, value_name = "FILE")]
    mount: Option<PathBuf>,
    /// Where the rig was: written to a bag as moving transforms. Without it a session's own, or that of the bag that is read.
    #[arg(long, value_name = "FILE")]
    trajectory: Option<PathBuf>,
    /// Overwrite a file that exists.
    #[arg(long)]
    force: bool,
}

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    let Some(format) = PacketFormat::of_path(&args.out) else {
        refuse!("--out {}: expected a name that ends in .pcap, .pcapng, .bag or .mcap", args.out.display());
    };
    ensure!(args.force || !args.out.exists(), "{} exists already; --force overwrites it", args.out.display());
    let spec = CuttingSpec {
        out: args.out.clone(),
        format,
        part: args.part.part(),
        mount: args.mount.clone(),
        trajectory: args.trajectory.clone(),
    };
    let mut cutting = Cutting::new(&spec);
    for path in &args.recordings {
        cutting.add(args.sensors.or_of(context, path))?;
    }
    let document = cutting.finish()?;
    output::print_result(context.json, &document, &report(&document), &document.losses)?;
    Ok(if document.losses.is_empty() { Outcome::Done } else { Outcome::DataLost })
}

fn report(document: &Document) -> Report {
    let Document { out, packets, sensors, left_out, .. } = document;
    let mut report = Report::new("Packets cut out", &format!("{out}: {packets} packets"));
    report.figures(sensors.iter().map(|(sensor, packets)| (sensor, packets.to_string())));
    if *left_out > 0 {
        report.note(format!("{left_out} packets of other times or sensors left out"));
    }
    report
}
