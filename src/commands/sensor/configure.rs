//! `outrigger sensor configure`: new settings, read back.

use std::time::Duration;

use serde_json::Value;

use super::info;
use super::settings::{parse_destination, parse_setting, twice};
use crate::commands::{Context, Outcome, ensure_consistent, output};
use crate::live::setup::{Configured, Sensor, Wanted};
use crate::report::Report;

/// Arguments of `sensor configure`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Settings have the names of the sensor's own interface, as `sensor info --json` shows them: \
                        lidar_mode=1024x10, timestamp_mode=TIME_FROM_PTP_1588, azimuth_window=[90000,270000] of an Ouster; \
                        rpm=600, returns=Dual, laser=on, fov_start=0, fov_end=359, phaselock=on, phaselock_offset=9000 \
                        (hundredths of a degree) of a Velodyne. Exit codes: 0 set as asked; 1 the sensor refused, and says why; 3 it agreed and a setting is \
                        another one when read back."
)]
pub struct Args {
    /// The sensor's address.
    #[arg(value_name = "HOST[:PORT]")]
    host: String,
    /// Where it is to send its packets: an address of this host, or `auto` (Ouster): this host, as the sensor sees it.
    #[arg(long, value_name = "ADDRESS|auto", value_parser = parse_destination)]
    dest: Option<String>,
    /// UDP port of lidar packets.
    #[arg(long, value_name = "PORT", value_parser = clap::value_parser!(u16).range(1..))]
    lidar_port: Option<u16>,
    /// UDP port of IMU (Ouster) or position packets (Velodyne).
    #[arg(long, value_name = "PORT", value_parser = clap::value_parser!(u16).range(1..))]
    aside_port: Option<u16>,
    /// Another setting; once for each.
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = parse_setting)]
    settings: Vec<(String, Value)>,
    /// Keep all this without power.
    #[arg(long)]
    save: bool,
    /// How long the sensor may take until it runs again, seconds.
    #[arg(long, value_name = "S", default_value_t = 60.0, value_parser = info::parse_seconds)]
    within: f64,
}

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    let wanted = Wanted {
        host: args.dest.clone(),
        port: args.lidar_port,
        auxiliary_port: args.aside_port,
        settings: args.settings.clone(),
        save: args.save,
        within: Duration::from_secs_f64(args.within),
    };
    let given = [("udp_dest", wanted.host.is_some()), ("udp_ip", wanted.host.is_some())];
    let given = given.into_iter().chain([
        ("udp_port_lidar", wanted.port.is_some()),
        ("udp_port_imu", wanted.auxiliary_port.is_some()),
    ]);
    let mut given = given.filter(|(_, is_given)| *is_given);
    let known = given.find(|(key, _)| wanted.settings.iter().any(|(other, _)| other == key));
    let (known, twice) = (known.map(|(key, _)| key), twice(&wanted.settings));
    let (key, other) = (known.unwrap_or_default(), twice.unwrap_or_default());
    ensure_consistent([
        (
            wanted.is_empty(),
            "nothing to set: give --dest, --lidar-port, --aside-port, --set KEY=VALUE or --save".into(),
        ),
        (
            known.is_some(),
            format!("--set {key}: --dest, --lidar-port or --aside-port set that already; give one of them"),
        ),
        (twice.is_some(), format!("--set {other} is given twice")),
    ])?;
    let configured = Sensor::at(&args.host)?.configure(&wanted)?;
    output::print_result(context.json, &configured, &report(&configured), &[])?;
    for change in configured.refused() {
        output::say_notice(&format!(
            "{}: wanted {}, the sensor has {}{}",
            change.key,
            change.wanted,
            change.after,
            if args.save { "; nothing was saved" } else { "" }
        ));
    }
    let refused = configured.refused().next().is_some();
    Ok(if refused { Outcome::DataLost } else { Outcome::Done })
}

fn report(configured: &Configured) -> Report {
    let sentence = if configured.saved { "saved" } else { "not saved: lost when it is switched off" };
    let mut report = Report::new("Settings of a sensor", sentence);
    for change in &configured.changes {
        let refused = if change.is_accepted { "" } else { "   REFUSED" };
        report.figure(&change.key, format!("{} -> {}{refused}", change.before, change.after));
    }
    info::append_to(&mut report, &configured.state);
    report
}
