//! `outrigger sensor configure`: new settings, read back.

use std::time::Duration;

use anyhow::bail;
use serde_json::Value;

use super::info;
use crate::commands::{Context, Outcome, output};
use crate::setup::{Configured, Sensor, Wanted};

/// Arguments of `sensor configure`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Settings have the names of the sensor's own interface, as `sensor info --json` shows them: \
                        lidar_mode=1024x10, timestamp_mode=TIME_FROM_PTP_1588, azimuth_window=[90000,270000] of an Ouster; \
                        rpm=600, returns=Dual, laser=on, fov_start=0, fov_end=359, phaselock=on, phaselock_offset=9000 \
                        (hundredths of a degree) of a Velodyne. Exit code 3: the sensor did not take a setting."
)]
pub struct Args {
    /// The sensor's address.
    #[arg(value_name = "HOST[:PORT]")]
    host: String,
    /// Where it is to send its packets: an address of this host, or `auto` (Ouster): this host, as the sensor sees it.
    #[arg(long, value_name = "ADDRESS|auto")]
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
        aside_port: args.aside_port,
        settings: args.settings.clone(),
        save: args.save,
        within: Duration::from_secs_f64(args.within),
    };
    if wanted.is_empty() {
        bail!("nothing to set: give --dest, --lidar-port, --aside-port, --set KEY=VALUE or --save");
    }
    let configured = Sensor::at(&args.host)?.configure(&wanted)?;
    if context.json {
        output::print_json(&configured)?;
    } else {
        output::print_text(&text(&configured))?;
    }
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

fn text(configured: &Configured) -> String {
    let mut text = String::new();
    for change in &configured.changes {
        let taken = if change.taken { "" } else { "   NOT TAKEN" };
        text += &format!("{}: {} -> {}{taken}\n", change.key, change.before, change.after);
    }
    text += if configured.saved { "saved\n" } else { "not saved: lost when it is switched off\n" };
    text + &info::text(&configured.state)
}

/// `KEY=VALUE`, the value as JSON or, if it is none, as text.
fn parse_setting(text: &str) -> Result<(String, Value), String> {
    let (key, value) = text.split_once('=').ok_or_else(|| format!("{text:?}: expected KEY=VALUE"))?;
    let key = key.trim();
    if key.is_empty() || !key.chars().all(|c| c.is_ascii_alphanumeric() || c == '_') {
        return Err(format!("{key:?}: expected the name of a setting"));
    }
    let value = serde_json::from_str(value).unwrap_or_else(|_| Value::from(value));
    Ok((key.to_owned(), value))
}
