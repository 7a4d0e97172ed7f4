//! `outrigger record`: live packets into a session folder.

use std::io::Write as _;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context as _, bail};
use indicatif::{HumanBytes, HumanCount, ProgressBar, ProgressStyle};
use sensors::ouster::Metadata;

use super::rig::by_axis;
use super::sensor_metadata::{first_look, read_metadata};
use super::signals::{self, Wishes};
use super::{Context, Outcome, output};
use crate::live::config::{SensorConfig, Stream};
use crate::live::receive::{Listen, Monitor, Options, Receiver, Silence, now_ns};
use crate::live::receive::{aside_of, is_aside};
use crate::live::setup::{Sensor, warnings};
use crate::live::watch::FirstLooks;
use crate::recording::{Losses, Manifest, Recording, SensorInfo, SessionError, SessionWriter};
use crate::rig::{CalibrationFile, MountFile, Rig};

/// How often counters are looked at.
const LOOK: Duration = Duration::from_millis(100);

/// Arguments of `record`.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// A sensor: name, local port (or address and port), metadata file of an Ouster, or the address of the sensor, which is
    /// asked for them. Once per sensor; those of the rig.toml when not given.
    #[arg(long = "listen", value_name = "NAME=[ADDRESS:]PORT[:METADATA.json|:http://HOST]", value_parser = parse_listen)]
    listen: Vec<Stream>,
    /// Take a sensor's packets only from this address; tells sensors on one port apart.
    #[arg(long = "source", value_name = "NAME=ADDRESS", value_parser = parse_source)]
    source: Vec<(String, IpAddr)>,
    /// Where the sensors sit: kept with the session, which compare, boresight, stand and odometry then know it from. That of
    /// [daemon] or [predict] where [record] names none.
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
    let seats = args.mount.as_deref().map(|mount| seats(mount, &[])).transpose()?;
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
        text.iter().filter_map(|text| unheard_imu(listen, text, &listens)).for_each(|note| say(&note));
    }
    let infos: Vec<SensorInfo> = listens
        .iter()
        .zip(metadata)
        .enumerate()
        .map(|(sensor, (listen, metadata))| SensorInfo::of(listen, receiver.address(sensor), metadata))
        .collect();
    let dir = args.out.clone().unwrap_or_else(|| PathBuf::from(crate::recording::folder_name_now()));
    let mut parts = Parts::new(dir, infos, seats);
    let session = parts.begin()?;
    if let Some(Seats { rig, .. }) = &parts.seats {
        warn_unseated(rig, &listens);
    }
    let shown = looks.clone();
    let mut recording = Recording::start_beside(receiver, session, move |batch| {
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
    conclude(&manifest, &monitor, &parts, warnings, context)
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

/// Where the sensors sit, and the calibrations that go with it.
pub(super) struct Seats {
    pub(super) mount: MountFile,
    pub(super) rig: Rig,
    pub(super) calibrations: Vec<CalibrationFile>,
}

/// Reads a mount file; `axes` are the sensors that axis 0, 1, ... turn, where that is said.
pub(super) fn seats(path: &Path, axes: &[String]) -> anyhow::Result<Seats> {
    let mount = by_axis(MountFile::read(path)?, path, axes)?;
    Ok(Seats { rig: mount.rig()?, calibrations: mount.calibration_files()?, mount })
}

/// Inertial packets that go where nobody listens.
fn unheard_imu(listen: &Listen, metadata: &str, listens: &[Listen]) -> Option<String> {
    let port = Metadata::parse(metadata, &listen.name).ok()?.imu_port?;
    let is_heard = listens.iter().any(|other| other.address.port() == port);
    (!is_heard).then(|| {
        let (name, aside) = (&listen.name, aside_of(&listen.name));
        format!("note: {name}: inertial packets go to port {port} and are not recorded (--listen {aside}={port}, or listen_aside)")
    })
}

/// What nobody knows the seat of is recorded all the same.
fn warn_unseated(rig: &Rig, listens: &[Listen]) {
    let names = || listens.iter().map(|listen| listen.name.as_str());
    for error in names().filter(|name| !is_aside(name, names())).filter_map(|name| rig.seat(name).err()) {
        say(&format!("warning: {error}"));
    }
}

fn unreadable(listens: &[Listen], (sensor, words): &(usize, String)) -> String {
    format!("{}: {words}", listens[*sensor].name)
}

/// The sessions of a recording: one, and another for each that is taken away meanwhile.
struct Parts {
    /// The folder that was asked for; a path that holds whatever becomes of the folder that the program runs in.
    asked: PathBuf,
    /// The folder that is written to.
    dir: PathBuf,
    infos: Vec<SensorInfo>,
    seats: Option<Seats>,
    /// What was lost in those that were closed, as their manifests have it.
    losses: Losses,
    /// What became of them.
    displaced: Vec<String>,
}

impl Parts {
    fn new(dir: PathBuf, infos: Vec<SensorInfo>, seats: Option<Seats>) -> Self {
        let asked = std::path::absolute(&dir).unwrap_or_else(|_| dir.clone());
        Self { asked, dir, infos, seats, losses: Losses::default(), displaced: Vec::new() }
    }

    fn begin(&self) -> anyhow::Result<SessionWriter> {
        let session = SessionWriter::create(&self.dir, &self.infos)?;
        if let Some(Seats { mount, calibrations, .. }) = &self.seats {
            session.put_mount(mount, calibrations)?;
        }
        Ok(session)
    }

    /// Goes on in a new session: under the same name where that is free, as programs read that.
    fn go_on(&mut self, recording: &mut Recording, words: &str) -> anyhow::Result<()> {
        let numbered = (2..).map(|number| {
            let mut name = self.asked.clone().into_os_string();
            name.push(format!("-{number}"));
            PathBuf::from(name)
        });
        let is_free = |path: &PathBuf| path.symlink_metadata().is_err();
        self.dir = std::iter::once(self.asked.clone()).chain(numbered).find(is_free).unwrap_or_default();
        let next = self.begin().with_context(|| format!("{words}, and recording cannot go on"))?;
        let event = serde_json::json!({"time_ns": now_ns(), "event": "session_displaced", "words": words});
        next.write_event(&event)?;
        self.displaced.push(words.to_owned());
        match recording.go_on_in(next) {
            Ok(manifest) => self.losses.add(&manifest.losses),
            Err(SessionError::Displaced { manifest, is_kept: true, .. }) => self.losses.add(&manifest.losses),
            Err(SessionError::Displaced { is_kept: false, .. }) => {} // the session that goes on has them
            Err(error) => self.displaced.push(error.to_string()),
        }
        Ok(())
    }
}

/// Shows what arrives until the time is up, a signal comes or recording ends by itself. What is wrong with the packets is
/// said at once, and returned.
async fn watch(
    recording: &mut Recording,
    parts: &mut Parts,
    listens: &[Listen],
    looks: &FirstLooks,
    duration: Option<Duration>,
) -> anyhow::Result<Vec<String>> {
    let mut wishes = Wishes::new().context("signals cannot be caught")?;
    let mut tick = tokio::time::interval(LOOK);
    let begun = Instant::now();
    let bar = ProgressBar::new_spinner();
    if let Ok(style) = ProgressStyle::with_template("{spinner} {elapsed} {wide_msg}") {
        bar.set_style(style);
    }
    let mut silence = Silence::new(listens.len(), begun);
    let mut said_low_disk = false;
    let mut clock_steps = 0;
    let mut unread = Vec::new();
    while duration.is_none_or(|duration| begun.elapsed() < duration) && !recording.has_ended() {
        tokio::select! {
            () = wishes.next() => break,
            _ = tick.tick() => {}
        }
        bar.set_message(status_line(recording, listens));
        if let Some(displaced) = recording.session().displaced() {
            parts.go_on(recording, &displaced.words)?;
            let (words, dir) = (&displaced.words, parts.dir.display());
            bar.suspend(|| say(&format!("warning: {words}; recording goes on in {dir}")));
        }
        for news in silence.look(recording.monitor(), Instant::now()) {
            let name = &listens[news.sensor].name;
            bar.suspend(|| say(&format!("{name}: {}", news.words)));
            let event = serde_json::json!({"time_ns": now_ns(), "event": news.event, "sensor": name});
            recording.session().write_event(&event)?;
        }
        for news in looks.news() {
            let words = unreadable(listens, &news);
            bar.suspend(|| say(&format!("warning: {words}")));
            let (name, text) = (&listens[news.0].name, &news.1);
            let event = serde_json::json!({"time_ns": now_ns(), "event": "not_decoded", "sensor": name, "text": text});
            recording.session().write_event(&event)?;
            unread.push(words);
        }
        for words in recording.session().clock_steps().into_iter().skip(clock_steps) {
            clock_steps += 1;
            bar.suspend(|| say(&format!("note: {words}; the session goes on as if it had not been")));
        }
        if let (Some(low), false) = (recording.session().low_disk(), said_low_disk) {
            said_low_disk = true;
            let left =
                low.seconds_left.map_or(String::new(), |left| format!(", about {left:.0} s at this rate"));
            bar.suspend(|| say(&format!("warning: {} left on the disk{left}", HumanBytes(low.free_bytes))));
        }
    }
    bar.finish_and_clear();
    Ok(unread)
}

fn status_line(recording: &Recording, listens: &[Listen]) -> String {
    let monitor = recording.monitor();
    let lost: u64 = monitor.kernel_drops().iter().sum::<u64>()
        + monitor.sensors().iter().map(|sensor| sensor.queue_dropped).sum::<u64>();
    let sensors: Vec<String> = monitor
        .sensors()
        .iter()
        .zip(listens)
        .map(|(counters, listen)| format!("{} {}", listen.name, HumanCount(counters.packets)))
        .collect();
    format!("{} packets, {}, lost {lost}", sensors.join(", "), HumanBytes(recording.session().packet_bytes()))
}

fn conclude(
    manifest: &Manifest,
    monitor: &Monitor,
    parts: &Parts,
    mut warnings: Vec<String>,
    context: Context,
) -> anyhow::Result<Outcome> {
    warnings.extend(parts.displaced.iter().cloned());
    let dir = &parts.dir;
    for socket in monitor.sockets() {
        if let (foreign @ 1.., Some(first)) =
            (socket.counters.foreign_source, socket.counters.first_foreign_source)
        {
            let named = socket.sensors.join(", ");
            warnings.push(format!(
                "{foreign} packets on {} came from others than {named}, first {first}",
                socket.address
            ));
        }
    }
    let came = monitor.sensors().into_iter().map(|counters| counters.packets);
    let silent = manifest.sensors.iter().zip(came).filter(|(_, came)| *came == 0);
    let silent: Vec<String> =
        silent.map(|(sensor, _)| format!("{}: not one packet came", sensor.name)).collect();
    let mut losses = manifest.losses;
    losses.add(&parts.losses);
    let lost = losses.total() > 0 || !silent.is_empty() || !parts.displaced.is_empty();
    warnings.extend(silent);
    if context.json {
        output::print_json(&serde_json::json!({
            "session": dir, "complete": manifest.complete, "sensors": manifest.sensors, "sockets": manifest.sockets,
            "losses": losses, "files": manifest.files, "warnings": warnings,
        }))?;
    } else {
        for sensor in &manifest.sensors {
            say(&format!("{}: {} packets, {} lost", sensor.name, sensor.packets, sensor.losses.total()));
        }
        for warning in &warnings {
            say(&format!("warning: {warning}"));
        }
        if losses.total() > 0 {
            let (kernel, queue) = (losses.kernel_dropped, losses.queue_dropped);
            let deleted = match losses.deleted {
                0 => String::new(),
                deleted => format!(", {deleted} whose file was taken away"),
            };
            say(&format!("lost: {kernel} in the kernel's buffer, {queue} in the queue to the disk{deleted}"));
        }
        output::print_text(&format!("{}\n", dir.display()))?;
    }
    Ok(if lost { Outcome::DataLost } else { Outcome::Done })
}

fn say(message: &str) {
    let _ = writeln!(std::io::stderr(), "outrigger: {message}");
}

/// Metadata of a sensor: from its file, else from itself. What the sensor says of itself is said again, and where it is not
/// what the file says.
pub(super) fn metadata_of(sensor: &Stream) -> anyhow::Result<Option<String>> {
    let name = &sensor.listen.name;
    let file = sensor.metadata.as_deref().map(read_metadata).transpose().with_context(|| name.clone())?;
    let Some(host) = &sensor.host else { return Ok(file) };
    let mut state = match Sensor::at(host).and_then(|found| found.read()) {
        Ok(state) => state,
        // what lies on the disk will do
        Err(error) if file.is_some() => {
            say(&format!("warning: {name}: {error}; its metadata file is used unseen"));
            return Ok(file);
        }
        Err(error) => return Err(error).with_context(|| format!("{name}: metadata")),
    };
    if let (Some(theirs), Some(ours)) = (&state.metadata, &file) {
        state.warnings.extend(warnings::of_metadata(theirs, ours)?);
    }
    for warning in &state.warnings {
        say(&format!("warning: {name}: {}", warning.text));
    }
    if let (Some(theirs), None) = (&state.metadata, &file) {
        Metadata::parse(theirs, host)?;
    }
    Ok(file.or(state.metadata))
}

fn parse_listen(text: &str) -> Result<Stream, String> {
    const FORM: &str = "expected NAME=PORT, NAME=ADDRESS:PORT or either with :METADATA.json behind";
    let (name, rest) = text.split_once('=').ok_or(FORM)?;
    let (ip, rest) = match rest.strip_prefix('[') {
        Some(v6) => {
            let (ip, rest) = v6.split_once("]:").ok_or(FORM)?;
            (ip.parse::<IpAddr>().map_err(|error| format!("{ip}: {error}"))?, rest)
        }
        None => match rest.split_once(':') {
            Some((ip, behind)) if ip.contains('.') => {
                (IpAddr::V4(ip.parse().map_err(|error| format!("{ip}: {error}"))?), behind)
            }
            _ => (IpAddr::V4(Ipv4Addr::UNSPECIFIED), rest),
        },
    };
    let (port, metadata) = match rest.split_once(':') {
        Some((port, path)) if !path.is_empty() => (port, Some(PathBuf::from(path))),
        _ => (rest, None),
    };
    let (host, metadata) = match metadata.as_ref().and_then(|path| path.to_str()?.strip_prefix("http://")) {
        Some(host) => (Some(host.to_owned()), None),
        None => (None, metadata),
    };
    let port = port.parse::<u16>().map_err(|_| format!("{port:?} is no port (0 to 65535); {FORM}"))?;
    Ok(Stream {
        listen: Listen { name: name.into(), address: SocketAddr::new(ip, port), source: None },
        model: None,
        metadata,
        host,
    })
}

fn parse_source(text: &str) -> Result<(String, IpAddr), String> {
    let (name, address) = text.split_once('=').ok_or("expected NAME=ADDRESS")?;
    Ok((name.into(), address.parse().map_err(|error| format!("{address}: {error}"))?))
}

fn parse_seconds(text: &str) -> Result<Duration, String> {
    super::ranges::within(0.0, 1e9)(text).map(Duration::from_secs_f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn listens_as_typed() {
        let parsed = |text: &str| {
            let arg = parse_listen(text).unwrap();
            (arg.listen.address.to_string(), arg.metadata.map(|path| path.display().to_string()))
        };
        assert_eq!(parsed("left=7502"), ("0.0.0.0:7502".into(), None));
        assert_eq!(parsed("left=7502:a:b.json"), ("0.0.0.0:7502".into(), Some("a:b.json".into())));
        assert_eq!(parsed("l=127.0.0.1:7502:m.json"), ("127.0.0.1:7502".into(), Some("m.json".into())));
        assert_eq!(parsed("l=[::1]:2368"), ("[::1]:2368".into(), None));
        for (wrong, words) in
            [("7502", "NAME=PORT"), ("a=70000", "70000"), ("a=1.2.3:4", "1.2.3"), ("a=", "no port")]
        {
            assert!(parse_listen(wrong).unwrap_err().contains(words), "{wrong}");
        }
    }
}
