//! `outrigger sensor discover`: Ousters by mDNS, Velodynes by what they send.

use std::net::{IpAddr, Ipv4Addr};
use std::time::Duration;

use anyhow::Context as _;
use serde_json::json;

use crate::commands::{Context, Outcome, output};
use crate::live::setup::discover::{Found, ousters, velodynes};
use crate::report::Report;

/// Arguments of `sensor discover`.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// How long to wait for answers, seconds.
    #[arg(long = "for", value_name = "S", default_value_t = 3.0, value_parser = super::info::parse_seconds)]
    seconds: f64,
    /// Ask on the interface with this address only.
    #[arg(long, value_name = "ADDRESS")]
    interface: Option<IpAddr>,
    /// UDP port on which packets of Velodynes are listened for; 0 for none. A port that another program has is left alone.
    #[arg(long, value_name = "PORT", default_value_t = 2368)]
    velodyne_port: u16,
}

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    let within = Duration::from_secs_f64(args.seconds);
    let (interface, port) = (args.interface, args.velodyne_port);
    let listen = move || {
        let address = interface.unwrap_or(IpAddr::V4(Ipv4Addr::UNSPECIFIED));
        if port == 0 { Ok(Vec::new()) } else { velodynes(within, address, port) }
    };
    let listener =
        std::thread::Builder::new().spawn(listen).context("no thread for listening can be started")?;
    let mut found = ousters(within, interface)?;
    let mut remarks = Vec::new();
    match listener.join() {
        Ok(Ok(more)) => found.extend(more),
        Ok(Err(error)) => remarks.push(format!("no Velodynes were looked for: {error}")),
        Err(_) => remarks.push("no Velodynes were looked for: the listening thread ended".to_owned()),
    }
    remarks.iter().for_each(|remark| output::say_notice(remark));
    let document = json!({ "sensors": found, "remarks": remarks });
    output::print_result(context.json, &document, &report(&found, args.seconds), &[])?;
    Ok(Outcome::Done)
}

fn report(found: &[Found], seconds: f64) -> Report {
    let mut report = Report::new("Sensors on the network", "");
    if found.is_empty() {
        report.note(format!(
            "no sensor answered within {seconds} s: is it powered, on this network segment, and past its start of about half a minute?"
        ));
    }
    for sensor in found {
        let at = |address: &IpAddr| match sensor.port {
            80 => address.to_string(),
            port => std::net::SocketAddr::new(*address, port).to_string(),
        };
        let addresses: Vec<String> = sensor.addresses.iter().map(at).collect();
        let vendor = format!("{:?}", sensor.vendor).to_lowercase();
        let properties = [("serial ", &sensor.serial), ("part ", &sensor.part), ("", &sensor.firmware)];
        let properties: Vec<String> = properties
            .iter()
            .filter(|(_, value)| !value.is_empty())
            .map(|(key, value)| format!("{key}{value}"))
            .collect();
        let [name, addresses, properties] = [&sensor.name, &addresses.join(" "), &properties.join(", ")];
        report.note(format!("{vendor} {name} {addresses} {properties}"));
    }
    report
}
