//! `outrigger sensor configure`: new settings, read back.

use std::net::IpAddr;
use std::time::Duration;

use serde_json::Value;

use super::info;
use crate::commands::{Context, Outcome, output};
use crate::live::setup::{Configured, Sensor, Wanted};

/// Arguments of `sensor configure`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Settings have the names of the sensor's own interface, as `sensor info --json` shows them: \
                        lidar_mode=1024x10, timestamp_mode=TIME_FROM_PTP_1588, azimuth_window=[90000,270000] of an Ouster; \
                        rpm=600, returns=Dual, laser=on, fov_start=0, fov_end=359, phaselock=on, phaselock_offset=9000 \
                        (hundredths of a degree) of a Velodyne. Exit codes: 0 set as asked; 1 the sensor refused, and says why; 3 it said yes and a setting is \
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
        aside_port: args.aside_port,
        settings: args.settings.clone(),
        save: args.save,
        within: Duration::from_secs_f64(args.within),
    };
    if wanted.is_empty() {
        refuse!("nothing to set: give --dest, --lidar-port, --aside-port, --set KEY=VALUE or --save");
    }
    let given = [("udp_dest", wanted.host.is_some()), ("udp_ip", wanted.host.is_some())];
    let given = given
        .into_iter()
        .chain([("udp_port_lidar", wanted.port.is_some()), ("udp_port_imu", wanted.aside_port.is_some())]);
    let mut given = given.filter(|(_, is_given)| *is_given);
    if let Some((key, _)) = given.find(|(key, _)| wanted.settings.iter().any(|(other, _)| other == key)) {
        refuse!("--set {key}: --dest, --lidar-port or --aside-port say that already; give one of them");
    }
    if let Some(key) = twice(&wanted.settings) {
        refuse!("--set {key} is given twice");
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

/// A setting that is named more than once.
fn twice(settings: &[(String, Value)]) -> Option<&str> {
    let again = |at: usize, key: &str| settings[..at].iter().any(|(other, _)| other == key);
    settings.iter().enumerate().find_map(|(at, (key, _))| again(at, key).then_some(key.as_str()))
}

/// An address, a name, or `auto`.
fn parse_destination(text: &str) -> Result<String, String> {
    let is_name = text
        .split('.')
        .all(|part| !part.is_empty() && part.chars().all(|c| c.is_ascii_alphanumeric() || "-_".contains(c)));
    // 300.1.1.1 is no name: the last part of one has letters in it
    let is_number = text.rsplit('.').next().is_some_and(|last| last.chars().all(|c| c.is_ascii_digit()));
    if text.parse::<IpAddr>().is_ok() || (is_name && !is_number) {
        return Ok(text.to_owned());
    }
    Err(format!("{text:?}: expected an address (192.168.1.10), a host's name, or auto"))
}

/// `KEY=VALUE`, the value as JSON or, if it is none, as text.
fn parse_setting(text: &str) -> Result<(String, Value), String> {
    let (key, value) = text.split_once('=').ok_or_else(|| format!("{text:?}: expected KEY=VALUE"))?;
    let key = key.trim();
    if key.is_empty() || !key.chars().all(|c| c.is_ascii_alphanumeric() || c == '_') {
        return Err(format!("{key:?}: expected the name of a setting"));
    }
    match serde_json::from_str(value) {
        Ok(value) => Ok((key.to_owned(), value)),
        // what begins as JSON is meant as such
        Err(error) if value.trim_start().starts_with(['[', '{', '"']) => {
            Err(format!("{key}: {value}: no JSON value: {error}"))
        }
        Err(_) => Ok((key.to_owned(), Value::from(value))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn destinations_and_settings_as_typed() {
        for good in ["auto", "192.168.1.10", "::1", "rover.lan", "rover-2"] {
            assert_eq!(parse_destination(good).as_deref(), Ok(good));
        }
        for wrong in ["300.1.1.1", "", "a b", "10.0.0", "rover..lan", "1.2.3.4:7502"] {
            assert!(
                parse_destination(wrong).is_err_and(|error| error.contains("expected an address")),
                "{wrong}"
            );
        }
        let window = parse_setting("azimuth_window=[90000,270000]").unwrap();
        assert_eq!(window, ("azimuth_window".to_owned(), serde_json::json!([90000, 270_000])));
        assert_eq!(parse_setting("lidar_mode=1024x10").unwrap().1, "1024x10");
        assert!(parse_setting("azimuth_window=[90000,").is_err_and(|error| error.contains("no JSON value")));
        let settings = ["rpm=600", "laser=on", "rpm=300"].map(|text| parse_setting(text).unwrap());
        assert_eq!((twice(&settings), twice(&settings[..2])), (Some("rpm"), None));
    }
}
