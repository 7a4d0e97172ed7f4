//! What `decode` and `inspect` share: opening a capture or session, the sensors' metadata, and one pass over the packets.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail, ensure};
use sensors::Packet;
use sensors::capture::{CaptureCounters, CaptureError, CaptureReader, Interface};
use sensors::ouster::Metadata;
use sensors::router::{GivenCalibration, Named, Router, Tie};
use sensors::velodyne::Calibration;
use tempfile::NamedTempFile;

use super::tied_file::TiedFile;
use crate::config::Config;
use crate::record::{Manifest, SensorEntry, Session, aside_of};

/// Packets looked at before decoding, where several sensors have to be told apart by their senders, or where an HDL-64E
/// has not said yet how it is calibrated.
const LEARN_PACKETS: usize = 20_000;

/// Packets within which every sensor of a recording has sent something.
const MEET_PACKETS: usize = 1000;

/// Refuses a folder that is no session.
pub fn ensure_recording(path: &Path) -> anyhow::Result<()> {
    ensure!(
        !path.is_dir() || Session::is_session(path),
        "{}: a folder without {}; expected a capture file, or a session that `record` or the daemon wrote",
        path.display(),
        crate::record::file::MANIFEST
    );
    Ok(())
}

/// Looks at packets before any is decoded: `look` learns from one and says whether nothing is left to learn; none at the
/// end of the packets.
pub fn look_first(mut look: impl FnMut() -> Option<bool>) {
    for looked_at in 1..=LEARN_PACKETS {
        match look() {
            Some(is_all) if !is_all || looked_at < MEET_PACKETS => {}
            _ => return,
        }
    }
}

/// Metadata files looked at when none was given.
const MOST_FILES_BESIDE: usize = 200;
const MOST_METADATA_BYTES: u64 = 1 << 20;

/// A capture with the metadata that belongs to it.
pub struct Recording {
    /// What messages call it.
    name: String,
    path: PathBuf,
    metadata: Vec<Given>,
    calibrations: Vec<GivenCalibration>,
    /// The session that it is, and what that says of itself.
    session: Option<(PathBuf, Manifest)>,
    /// What can be read but once, where it is read more than once.
    /// Its metadata are those of the session, each of what came to its sensor's port.
    is_tied_by_session: bool,
    spooled: Option<NamedTempFile>,
}

/// Metadata of an Ouster.
struct Given {
    metadata: Metadata,
    /// What messages call them.
    name: String,
    /// Which unit's they are, where somebody says.
    tie: Option<Tie>,
}

/// Which sensors a recording is about: the options that `decode` and `inspect` share.
#[derive(clap::Args, Clone, Debug, Default)]
pub struct SensorArgs {
    /// Metadata of an Ouster sensor; once per sensor. Velodyne sensors need none. Where packets bear no serial number
    /// (LEGACY), several units of one model are told apart by who sends, 192.168.1.10=front.json, by the port of the lidar
    /// packets, :7502=front.json, or by both, 192.168.1.10:7502=front.json.
    #[arg(long = "meta", value_name = "[[ADDRESS][:PORT]=]META.json", value_parser = TiedFile::parser())]
    pub meta: Vec<TiedFile>,
    /// Calibration of a Velodyne (db.xml or YAML); with several, name each by its address: 192.168.1.201=left.xml.
    #[arg(long, value_name = "[ADDRESS=]FILE", value_parser = TiedFile::parser())]
    pub calibration: Vec<TiedFile>,
}

impl SensorArgs {
    /// With the metadata of the rig.toml's sensors, where none are typed and the capture is no session, which has its own.
    pub fn or_of(&self, config: Option<&Config>, capture: &Path) -> Self {
        let mut sensors = self.clone();
        if sensors.meta.is_empty() && !Session::is_session(capture) {
            let named = config.into_iter().flat_map(|config| &config.sensors);
            let files = named.filter_map(|sensor| sensor.metadata.clone());
            sensors.meta.extend(files.map(|path| TiedFile { tie: None, path }));
        }
        sensors
    }

    /// The calibrations, read.
    pub fn calibrations(&self) -> anyhow::Result<Vec<GivenCalibration>> {
        self.calibration.iter().map(calibration).collect()
    }
}

/// How a pass over the packets ended.
pub struct Ending {
    /// What the file holds beside datagrams.
    pub counters: CaptureCounters,
    /// Why reading stopped before the end.
    pub damage: Option<CaptureError>,
    /// Interfaces of the last section.
    pub interfaces: Vec<Interface>,
    missing: Vec<String>,
}

impl Recording {
    /// Finds the packets (a session folder names them, and brings its metadata along) and reads the metadata.
    /// `-` is standard input.
    pub fn open(capture: &Path, sensors: &SensorArgs) -> anyhow::Result<Self> {
        let mut paths = sensors.meta.clone();
        let mut path = capture.to_owned();
        ensure_recording(capture)?;
        let (mut session, mut is_tied_by_session) = (None, false);
        if capture.is_dir() {
            let manifest = Manifest::read(capture)?;
            path = capture.join(crate::record::file::PACKETS);
            if paths.is_empty() {
                let files = json_files(&capture.join(crate::record::file::METADATA))?;
                // units whose packets do not say whose they are were recorded from ports of their own
                let tied = |path: PathBuf| TiedFile { tie: recorded_from(&manifest, capture, &path), path };
                paths = files.into_iter().map(tied).collect();
                is_tied_by_session = true;
            }
            session = Some((capture.to_owned(), manifest));
        }
        let name = match path.as_os_str() == "-" {
            true => "standard input".into(),
            false => path.display().to_string(),
        };
        Ok(Self {
            name,
            path,
            metadata: metadata_of(&paths)?,
            calibrations: sensors.calibrations()?,
            session,
            is_tied_by_session,
            spooled: None,
        })
    }

    /// The same for who reads it more than once: standard input and pipes are kept in a temporary file.
    pub fn open_to_reread(capture: &Path, sensors: &SensorArgs) -> anyhow::Result<Self> {
        let mut recording = Self::open(capture, sensors)?;
        recording.spooled = spool(&recording.path)?;
        if let Some(file) = &recording.spooled {
            recording.path = file.path().to_owned();
        }
        Ok(recording)
    }

    /// What of a session's files is not as its manifest says. Reads all of them.
    pub fn problems_of_session(&self) -> Vec<String> {
        let session = self.session.clone();
        session.map_or_else(Vec::new, |(dir, manifest)| Session::of(&dir, manifest).problems().to_vec())
    }

    /// The file that is read.
    pub fn name(&self) -> String {
        self.name.clone()
    }

    /// Whether this is the file that is read.
    pub fn is_read_from(&self, path: &Path) -> bool {
        crate::files::is_same(path, &self.path)
    }

    /// The session that the file was taken out of, without what belongs to it.
    pub fn session_around(&self) -> Option<&Path> {
        let folder = self.path.parent().filter(|folder| Session::is_session(folder));
        let has_metadata = |folder: &&Path| {
            json_files(&folder.join(crate::record::file::METADATA)).is_ok_and(|files| !files.is_empty())
        };
        folder.filter(|_| self.metadata.is_empty()).filter(has_metadata)
    }

    /// Metadata files in the folder of the capture that describe one of these sensors, or that bear its name; with packets
    /// of one of these lengths, where any is known, and not among those given.
    pub fn metadata_beside(&self, serials: &[u64], packet_bytes: &[usize]) -> Vec<PathBuf> {
        let Some(stem) = self.path.file_stem().and_then(|stem| stem.to_str()) else { return Vec::new() };
        let folder = self.path.parent().filter(|folder| !folder.as_os_str().is_empty());
        let Ok(files) = json_files(folder.unwrap_or(Path::new("."))) else { return Vec::new() };
        let named = |path: &PathBuf| {
            let name = path.file_stem().and_then(|name| name.to_str()).unwrap_or_default();
            name.strip_prefix(stem).is_some_and(|rest| ["", "_0", ".0", "_1", ".1", ".2"].contains(&rest))
        };
        let describes = |path: &PathBuf| {
            if self.metadata.iter().any(|given| crate::files::is_same(path, Path::new(&given.name))) {
                return false;
            }
            let small = std::fs::metadata(path).is_ok_and(|file| file.len() < MOST_METADATA_BYTES);
            let text = if small { std::fs::read_to_string(path).unwrap_or_default() } else { String::new() };
            // what does not read as metadata is not what is looked for
            Metadata::parse(&text, "").is_ok_and(|metadata| {
                let length = metadata.packet_format().packet_bytes();
                (packet_bytes.is_empty() || packet_bytes.contains(&length))
                    && (metadata.serial_number().is_some_and(|serial| serials.contains(&serial))
                        || named(path))
            })
        };
        files.into_iter().take(MOST_FILES_BESIDE).filter(describes).collect()
    }

    /// A router that knows the sensors of the metadata, and where they send from if that is needed.
    pub fn router(&self) -> anyhow::Result<Router> {
        let mut router = Router::new();
        router.set_names(self.names());
        for Given { metadata, name, tie } in &self.metadata {
            router.add_tied_ouster(metadata.clone(), name.clone(), *tie);
        }
        for calibration in &self.calibrations {
            router.add_calibration(calibration.clone());
        }
        // a pipe can be read but once
        if self.path.is_file() {
            let mut reader = CaptureReader::open(&self.path)?;
            // damage is found again, and reported, when the packets are decoded
            look_first(|| Some(router.learn(&reader.next().ok()??)));
            router.end_learning();
        }
        Ok(router)
    }

    /// Refuses a calibration that does not fit the sensor that it was given for, and metadata tied to who sends nothing.
    pub fn ensure_given_fits(&self, router: &Router) -> anyhow::Result<()> {
        for sensor in router.sensors() {
            if let Some((name, error)) = sensor.calibration_error() {
                let source = sensor.source().map_or(String::new(), |source| format!(" from {source}"));
                bail!("{name}, given for the {}{source}: {error}", sensor.product());
            }
            let (Some(tie), Some(name)) = (sensor.tie(), &sensor.metadata_name) else { continue };
            let (is_found, whence) = match tie {
                Tie::Sender(address) => (sensor.stats().packets > 0, format!("comes from {address}")),
                Tie::Port(port) => (sensor.data_port().is_some(), format!("goes to port {port}")),
                Tie::Stream(stream) => {
                    let (address, port) = (stream.ip(), stream.port());
                    (sensor.data_port().is_some(), format!("comes from {address} and goes to port {port}"))
                }
            };
            if let Some(reason) = sensor.one_of_several().filter(|_| !self.is_tied_by_session) {
                bail!("--meta {tie}={name}: {reason}");
            }
            ensure!(
                is_found || self.is_tied_by_session, // a session's sensor may have been silent
                "--meta {tie}={name}: no packet that fits it, and no other --meta as well, {whence}; `outrigger inspect` lists \
                 who sends what where"
            );
        }
        Ok(())
    }

    /// How a session calls its sensors.
    fn names(&self) -> Vec<Named> {
        let Some((dir, manifest)) = &self.session else { return Vec::new() };
        let entries = manifest.sensors.iter().filter(|entry| !manifest.is_aside(entry));
        let port = |entry: &SensorEntry| entry.address.map(|address| address.port());
        let named = |entry: &SensorEntry| Named {
            name: entry.name.clone(),
            metadata: entry.metadata.as_ref().map(|relative| dir.join(relative).display().to_string()),
            source: entry.source,
            port: port(entry),
            aside_port: manifest
                .sensors
                .iter()
                .find(|other| other.name == aside_of(&entry.name))
                .and_then(port),
        };
        entries.map(named).collect()
    }

    /// Hands every datagram to `take`. A file that is cut off or damaged ends the pass early; the [`Ending`] says so.
    pub fn each_packet(
        &self,
        take: &mut dyn FnMut(&Packet<'_>) -> anyhow::Result<()>,
    ) -> anyhow::Result<Ending> {
        let mut reader = match self.path.as_os_str() == "-" {
            true => CaptureReader::new(std::io::stdin(), "standard input")?,
            false => CaptureReader::open(&self.path)?,
        };
        let bar = progress_bar(&self.path);
        let mut packets = 0_u64;
        let damage = loop {
            match reader.next() {
                Ok(Some(packet)) => take(&packet)?,
                Ok(None) => break None,
                Err(error) => break Some(error),
            }
            packets += 1;
            if packets.is_multiple_of(1024) {
                bar.set_position(reader.position());
            }
        };
        bar.finish_and_clear();
        Ok(Ending {
            counters: reader.counters().clone(),
            damage,
            interfaces: reader.interfaces().to_vec(),
            missing: self.session.as_ref().map_or_else(Vec::new, |(_, manifest)| manifest.missing()),
        })
    }
}

impl Ending {
    /// Data that is missing because of the file or its recorder, in words.
    pub fn losses(&self) -> Vec<String> {
        let mut losses = self.missing.clone();
        losses.extend(self.damage.as_ref().map(ToString::to_string));
        losses.extend(capture_losses(&self.counters));
        losses
    }
}

/// Data that a capture lacks, in words.
pub fn capture_losses(counters: &CaptureCounters) -> Vec<String> {
    let counted = [
        (counters.fragments_incomplete, "datagrams lack a fragment"),
        (
            counters.cut_by_snap_length,
            "frames were cut short by the recorder's snap length (record with -s 0)",
        ),
        (counters.dropped_by_recorder, "packets were dropped by the recorder, by its own account"),
    ];
    let counted =
        counted.iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{count} {what}"));
    counters.truncated.iter().map(ToString::to_string).chain(counted).collect()
}

/// What can be read but once (standard input as `-`, a pipe), kept in a temporary file; none of another file.
pub fn spool(path: &Path) -> anyhow::Result<Option<NamedTempFile>> {
    let is_standard_input = path.as_os_str() == "-";
    let is_pipe = std::fs::metadata(path).is_ok_and(|file| !file.is_file() && !file.is_dir());
    if !is_standard_input && !is_pipe {
        return Ok(None);
    }
    let keep = || {
        let mut file = NamedTempFile::new()?;
        match is_standard_input {
            true => std::io::copy(&mut std::io::stdin(), &mut file)?,
            false => std::io::copy(&mut std::fs::File::open(path)?, &mut file)?,
        };
        Ok::<_, std::io::Error>(file)
    };
    let name = if is_standard_input { "standard input".into() } else { path.display().to_string() };
    keep().map(Some).with_context(|| format!("{name} cannot be kept in a temporary file (TMPDIR)"))
}

/// The port that the sensor of a metadata file of a session was recorded from.
fn recorded_from(manifest: &Manifest, dir: &Path, file: &Path) -> Option<Tie> {
    let is_of =
        |entry: &&SensorEntry| entry.metadata.as_ref().is_some_and(|relative| dir.join(relative) == file);
    let mut entries = manifest.sensors.iter().filter(|entry| !manifest.is_aside(entry)).filter(is_of);
    match (entries.next(), entries.next()) {
        (Some(entry), None) => entry.address.map(|address| Tie::Port(address.port())),
        _ => None,
    }
}

/// The metadata in some files; what describes a unit as another file does counts once.
fn metadata_of(files: &[TiedFile]) -> anyhow::Result<Vec<Given>> {
    let mut known: Vec<Given> = Vec::with_capacity(files.len());
    for TiedFile { tie, path } in files {
        let name = path.display().to_string();
        if let (Some(tie), "") = (tie, name.as_str()) {
            bail!("--meta {tie}=: no file is named behind the equals sign");
        }
        let text = crate::files::read_text(path).with_context(|| name.clone())?;
        let metadata = Metadata::parse(&text, &name)?;
        let same_unit = |other: &&Given| {
            let serial = metadata.serial_number();
            let is_one = serial.is_some_and(|serial| other.metadata.serial_number() == Some(serial));
            is_one && other.tie == *tie && other.metadata.packet_format() == metadata.packet_format()
        };
        match known.iter().find(same_unit) {
            Some(other) if as_decoded(&other.metadata) == as_decoded(&metadata) => {}
            Some(other) => bail!(
                "{} and {name}: both of sensor {}, with packets of the same format, and they differ: give the one of the \
                 time of the recording",
                other.name,
                metadata.serial
            ),
            None => known.push(Given { metadata, name, tie: *tie }),
        }
    }
    Ok(known)
}

/// What decoding takes from metadata: not when it was switched on, what it runs and where it sends.
fn as_decoded(metadata: &Metadata) -> Metadata {
    let firmware = String::new();
    let (lidar_port, imu_port, zone_port, destination) = (None, None, None, None);
    Metadata { init_id: 0, firmware, lidar_port, imu_port, zone_port, destination, ..metadata.clone() }
}

fn calibration(file: &TiedFile) -> anyhow::Result<GivenCalibration> {
    let name = file.path.display().to_string();
    let source = match file.tie {
        None => None,
        Some(Tie::Sender(address)) => Some(address),
        Some(tie @ (Tie::Port(_) | Tie::Stream(_))) => {
            bail!(
                "--calibration {tie}={name}: expected the address that the Velodyne sends from, ADDRESS=FILE"
            )
        }
    };
    let bytes = std::fs::read(&file.path).with_context(|| name.clone())?;
    let calibration = Calibration::from_bytes(&bytes).with_context(|| name.clone())?;
    Ok(GivenCalibration { source, name, calibration })
}

fn json_files(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).with_context(|| folder.display().to_string())? {
        let path = entry.with_context(|| folder.display().to_string())?.path();
        if path.extension().is_some_and(|extension| extension == "json") {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

/// Drawn on stderr, and only on a terminal.
fn progress_bar(path: &Path) -> indicatif::ProgressBar {
    let bytes = std::fs::metadata(path).map(|metadata| metadata.len()).unwrap_or(0);
    let bar = indicatif::ProgressBar::new(bytes);
    if let Ok(style) = indicatif::ProgressStyle::with_template("{bar:40} {bytes}/{total_bytes} {eta}") {
        bar.set_style(style);
    }
    bar
}
