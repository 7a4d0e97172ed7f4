//! `outrigger record`: live packets into a session folder.

mod conclude;
mod metadata;
mod watch;

use std::net::IpAddr;
use std::path::PathBuf;
use std::time::Duration;

use anyhow::{Context as _, bail};
use sensors::ouster::Metadata;

pub(super) use self::metadata::metadata_of;
use self::watch::{say, unreadable, watch};
use super::{Context, Outcome, signals};
use crate::live::config::{SensorConfig, Stream};
use crate::live::receive::{Listen, Options, Receiver, auxiliary_name, is_auxiliary};
use crate::live::watch::{FirstLooks, first_look};
use crate::recording::{LiveRecording, Parts, SensorInfo, SessionError};
use crate::rig::{MountSlots, Rig};

/// Arguments of `record`.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// A sensor: name, local port (or address and port), metadata file of an Ouster, or the address of the sensor, which is
    /// asked for them. Once per sensor; those of the rig.toml when not given.
    #[arg(long = "listen", value_name = "NAME=[ADDRESS:]PORT[:METADATA.json|:http://HOST]")]
    listen: Vec<Stream>,
    /// Take a sensor's packets only from this address; tells sensors on one port apart.
    #[arg(long = "source", value_name = "NAME=ADDRESS", value_parser = parse_source)]
    source: Vec<(String, IpAddr)>,
    /// Where the sensors sit: stored with the session for compare, boresight, rig calibrate and odometry. That of [daemon] or
    /// [predict] where [record] names none.
    #[arg(long, value_name = "FILE")]
    pub(super) mount: Option<PathBuf>,
    /// The session's folder, empty or absent; by default named after the time.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Stop after this many seconds; by default at Ctrl-C.
    #[arg(long, value_name = "S", value_parser = parse_seconds)]
    duration: Option<Duration>,
    /// Kernel receive buffer to ask for, per port, in MiB.
    #[arg(long, value_name = "MIB", default_value_t = 8, value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(super) receive_buffer: u16,
}

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    let wanted = wanted(args, context)?;
    let mut listens: Vec<Listen> = wanted.iter().map(|sensor| sensor.listen.clone()).collect();
    for (name, source) in &args.source {
        let sensor = listens.iter_mut().find(|listen| listen.name == *name);
        sensor.with_context(|| format!("--source {name}: no --listen has that name"))?.source = Some(*source);
    }
    let slots = args.mount.as_deref().map(|mount| MountSlots::read(mount, &[])).transpose()?;
    let metadata: Vec<Option<String>> = wanted.iter().map(metadata_of).collect::<anyhow::Result<_>>()?;
    let looks = FirstLooks::new(
        wanted.iter().zip(&metadata).map(|(w, m)| first_look(w, m.as_deref(), &listens)).collect(),
    );
    let runtime = signals::runtime()?;
    let options =
        Options { receive_buffer_bytes: usize::from(args.receive_buffer) << 20, ..Options::default() };
    let receiver = Receiver::start(&listens, options)?;
    for warning in receiver.monitor().sockets().iter().filter_map(|socket| socket.buffer_warning()) {
        say(&format!("warning: {warning}"));
    }
    for (sensor, listen) in listens.iter().enumerate() {
        say(&format!("{}: listening on {}", listen.name, receiver.address(sensor)));
    }
    for (listen, text) in listens.iter().zip(&metadata) {
        text.iter().filter_map(|text| unrecorded_imu(listen, text, &listens)).for_each(|note| say(&note));
    }
    let infos: Vec<SensorInfo> = listens
        .iter()
        .zip(metadata)
        .enumerate()
        .map(|(sensor, (listen, metadata))| SensorInfo::of(listen, receiver.address(sensor), metadata))
        .collect();
    let dir = args.out.clone().unwrap_or_else(|| PathBuf::from(crate::recording::folder_name_now()));
    let mut parts = Parts::new(dir, infos, slots);
    let session = parts.begin()?;
    if let Some(rig) = parts.rig() {
        warn_without_slot(rig, &listens);
    }
    let shown = looks.clone();
    let mut recording = LiveRecording::start_observed(receiver, session, move |batch| {
        shown.take(batch.iter().map(|datagram| (datagram.sensor, datagram.packet())));
    })?;
    let watched = runtime.block_on(watch(&mut recording, &mut parts, &listens, &looks, args.duration));
    let monitor = recording.monitor().clone();
    let session = recording.session();
    let closed = recording.stop(); // in order, also where watching failed
    let manifest = match closed {
        Err(SessionError::Displaced { manifest, .. }) => *manifest,
        closed => closed?,
    };
    let mut warnings = watched?;
    parts.displaced.extend(session.displaced().map(|displaced| displaced.words.clone()));
    warnings.extend(looks.conclude().into_iter().map(|news| unreadable(&listens, &news)));
    conclude::conclude(&manifest, &monitor, &parts, warnings, context)
}

/// The sensors that were typed; otherwise those of the rig's file.
fn wanted(args: &Args, context: Context) -> anyhow::Result<Vec<Stream>> {
    if !args.listen.is_empty() {
        return Ok(args.listen.clone());
    }
    let Some(config) = context.config else {
        refuse!("which sensors? --listen NAME=PORT for each, or --config RIG.toml that has them");
    };
    let wanted: Vec<Stream> = config.sensors.iter().flat_map(SensorConfig::streams).collect();
    if wanted.is_empty() {
        bail!("{}: no [[sensor]] has a `listen`", config.path.display());
    }
    Ok(wanted)
}

/// Inertial packets that go to an unwatched port.
fn unrecorded_imu(listen: &Listen, metadata: &str, listens: &[Listen]) -> Option<String> {
    let port = Metadata::parse(metadata, &listen.name).ok()?.imu_port?;
    let is_received = listens.iter().any(|other| other.address.port() == port);
    (!is_received).then(|| {
        let (name, auxiliary) = (&listen.name, auxiliary_name(&listen.name));
        format!("note: {name}: inertial packets go to port {port} and are not recorded (--listen {auxiliary}={port}, or listen_aside)")
    })
}

/// Sensors without a slot are recorded all the same.
fn warn_without_slot(rig: &Rig, listens: &[Listen]) {
    let names = || listens.iter().map(|listen| listen.name.as_str());
    for error in names().filter(|name| !is_auxiliary(name, names())).filter_map(|name| rig.slot(name).err()) {
        say(&format!("warning: {error}"));
    }
}

fn parse_source(text: &str) -> Result<(String, IpAddr), String> {
    let (name, address) = text.split_once('=').ok_or("expected NAME=ADDRESS")?;
    Ok((name.into(), address.parse().map_err(|error| format!("{address}: {error}"))?))
}

fn parse_seconds(text: &str) -> Result<Duration, String> {
    super::ranges::within(0.0, 1e9)(text).map(Duration::from_secs_f64)
}
