//! What `decode` and `inspect` share: opening a capture or session, the sensors' metadata, and one pass over the packets.

mod pass;

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context as _, bail, ensure};
use sensors::ouster::Metadata;
use sensors::router::{GivenCalibration, GivenModel, Named, Router, SourceFilter};
use tempfile::NamedTempFile;

pub use pass::Ending;
pub(crate) use pass::capture_losses;

use super::assigned_file::AssignedFile;
use super::found_metadata::OustersMet;
use super::output::say_notice;
use super::sensor_args::{
    MetadataFile, SensorArgs, as_decoded, ensure_named, json_files, metadata_of, recorded_from,
    session_metadata,
};
use crate::live::receive::auxiliary_name;
use crate::recording::bags::{is_bag_at, is_bag_folder, metadata_in, names_in};
use crate::recording::packet_reader::{PacketReader, is_stream, keep_stream};
use crate::recording::{Manifest, SensorEntry, Session};
use crate::rig::Rig;

/// Packets looked at before decoding, where several sensors have to be separated by sender, or where an HDL-64E
/// has not sent its calibration yet.
const LEARN_PACKETS: usize = 20_000;

/// Packets within which every sensor of a recording has sent something.
const MEET_PACKETS: usize = 1000;

/// Refuses a folder that is no session.
pub(crate) fn ensure_recording(path: &Path) -> anyhow::Result<()> {
    ensure!(
        !path.is_dir() || Session::is_session(path) || is_bag_folder(path),
        "{}: a folder without {}; expected a capture file, or a session that `record` or the daemon wrote, or a bag or the \
         folder of one",
        path.display(),
        crate::recording::file::MANIFEST
    );
    Ok(())
}

/// The packets of a session: a file that lies in its folder.
pub(crate) fn packets_of(session: &Path) -> anyhow::Result<PathBuf> {
    let path = session.join(crate::recording::file::PACKETS);
    inside_of(session, &path).with_context(|| path.display().to_string())?;
    Ok(path)
}

/// Whether a path in a folder leads to a file there.
fn inside_of(folder: &Path, path: &Path) -> std::io::Result<()> {
    crate::base::files::open_inside(folder, path.strip_prefix(folder).unwrap_or(path)).map(drop)
}

/// Looks at packets before any is decoded: `look` learns from one and says whether nothing is left to learn; none at the
/// end of the packets.
pub(crate) fn look_first(mut look: impl FnMut() -> Option<bool>) {
    for looked_at in 1..=LEARN_PACKETS {
        match look() {
            Some(is_all) if !is_all || looked_at < MEET_PACKETS => {}
            _ => return,
        }
    }
}

/// Metadata files looked at when none was given.
const MAX_NEARBY_FILES: usize = 200;
const MOST_METADATA_BYTES: u64 = 1 << 20;

/// A capture with the metadata that belongs to it.
pub struct Recording {
    /// What messages call it.
    name: String,
    path: PathBuf,
    metadata: Vec<MetadataFile>,
    calibrations: Vec<GivenCalibration>,
    models: Vec<GivenModel>,
    /// The session that it is, and what that says of itself.
    session: Option<(PathBuf, Manifest)>,
    /// The bag that it is: how that calls its sensors, and where their packets seem to come from.
    bag: Option<BagAbout>,
    /// Its metadata are its own: those of a session, each of what came to its sensor's port, or of a bag.
    is_assigned_by_recording: bool,
    /// What of these cannot be read, and why.
    unreadable: Vec<String>,
    /// What can be read but once, where it is read more than once.
    _spooled: Option<NamedTempFile>,
    /// Opened already, for the first pass.
    opened: Mutex<Option<PacketReader>>,
    /// Whether a bar on the terminal shows how far reading is.
    shows_progress: bool,
    /// Whether it was reported which metadata were found.
    is_reported: AtomicBool,
}

/// What is known of a bag before it is read.
struct BagAbout {
    names: Vec<Named>,
    holds_clouds_only: bool,
}

impl Recording {
    /// Finds the packets (a session folder names them, and brings its metadata along) and reads the metadata.
    /// `-` is standard input.
    pub(crate) fn open(capture: &Path, sensors: &SensorArgs) -> anyhow::Result<Self> {
        Self::open_for(capture, sensors, false)
    }

    fn open_for(capture: &Path, sensors: &SensorArgs, is_read_again: bool) -> anyhow::Result<Self> {
        let mut paths = sensors.meta.clone();
        let mut path = capture.to_owned();
        ensure_recording(capture)?;
        let (mut session, mut is_assigned_by_recording, mut unreadable) = (None, false, Vec::new());
        if Session::is_session(capture) {
            let manifest = Manifest::read(capture)?;
            path = packets_of(capture)?;
            if paths.is_empty() {
                let mut files = session_metadata(capture)?;
                let named = manifest.sensors.iter().filter_map(|entry| entry.metadata.as_ref());
                let named: Vec<PathBuf> = named.map(|relative| capture.join(relative)).collect();
                files.extend(named.into_iter().filter(|file| !file.exists()));
                files.retain(|file| match inside_of(capture, file) {
                    Err(error) => {
                        unreadable.push(format!("{}: cannot be read: {error}", file.display()));
                        false
                    }
                    Ok(()) => true,
                });
                // units with packets that name no sensor were recorded from ports of their own
                let assigned = |path: PathBuf| AssignedFile {
                    source_filter: recorded_from(&manifest, capture, &path),
                    path,
                };
                paths = files.into_iter().map(assigned).collect();
                is_assigned_by_recording = true;
            }
            session = Some((capture.to_owned(), manifest));
        }
        let name = match path.as_os_str() == "-" {
            true => "standard input".into(),
            false => path.display().to_string(),
        };
        let mut spooled = if is_read_again { spool(&path)? } else { None };
        path = spooled.as_ref().map_or(path, |file| file.path().to_owned());
        let is_read_once = is_stream(&path);
        let opened = match session.is_none() && (is_read_once || is_bag_at(&path)) {
            true => Some(PacketReader::open(&path, &name)?),
            false => None,
        };
        if let Some(file) = opened.as_ref().and_then(PacketReader::take_spooled) {
            path = file.path().to_owned();
            spooled = Some(file);
        }
        // a session of which one file is damaged has others
        let mut tell = |error: anyhow::Error| {
            if !is_assigned_by_recording {
                return Err(error);
            }
            unreadable.push(format!("{error:#}"));
            Ok(())
        };
        let mut metadata = metadata_of(&paths, &mut tell)?;
        let mut bag = None;
        if let Some(packets) = opened.as_ref().and_then(PacketReader::bag) {
            is_assigned_by_recording = metadata.is_empty();
            let serials: Vec<_> = metadata.iter().map(|given| given.metadata.serial_number()).collect();
            let (own, cannot_be_read) = metadata_in(packets, &name, &serials);
            unreadable.extend(cannot_be_read);
            bag = Some(BagAbout {
                names: names_in(packets, &own),
                holds_clouds_only: packets.holds_clouds_only(),
            });
            metadata.extend(own.into_iter().map(|of| MetadataFile {
                source_filter: of.source_filter(),
                metadata: of.metadata,
                text: of.text,
                name: of.name,
            }));
        }
        let calibrations = sensors.calibrations()?;
        ensure_named(&calibrations, session.as_ref().map(|(_, manifest)| manifest), capture)?;
        Ok(Self {
            name,
            path,
            metadata,
            calibrations,
            models: sensors.model.clone(),
            session,
            bag,
            is_assigned_by_recording,
            unreadable,
            _spooled: spooled,
            opened: Mutex::new(opened),
            shows_progress: true,
            is_reported: AtomicBool::new(false),
        })
    }

    /// The same for who reads it more than once: standard input and pipes are copied to a temporary file.
    pub(crate) fn open_to_reread(capture: &Path, sensors: &SensorArgs) -> anyhow::Result<Self> {
        Self::open_for(capture, sensors, true)
    }

    /// The same, without a bar on the terminal.
    pub(crate) fn without_progress(mut self) -> Self {
        self.shows_progress = false;
        self
    }

    /// The session that is read, each of its files held against the manifest: reads all of them.
    pub(crate) fn checked_session(&self) -> Option<Session> {
        self.session.clone().map(|(dir, manifest)| Session::of(&dir, manifest))
    }

    /// The file that is read.
    pub(crate) fn name(&self) -> String {
        self.name.clone()
    }

    /// Where it is read from.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Whether it is a bag.
    pub(crate) fn is_bag(&self) -> bool {
        self.bag.is_some()
    }

    /// Whether it is a bag with clouds and no packets.
    pub(crate) fn holds_clouds_only(&self) -> bool {
        self.bag.as_ref().is_some_and(|bag| bag.holds_clouds_only)
    }

    /// The slot of a rig that a sensor of a bag sits in, where every sensor of the bag is called as one of the rig's.
    pub(crate) fn slot_of(&self, sensor: &sensors::router::Sensor, rig: &Rig) -> Option<usize> {
        let slot = |name: &str| {
            let last = name.rsplit('/').next();
            rig.sensors.iter().position(|mounted| mounted.name == name || Some(mounted.name.as_str()) == last)
        };
        let bag = self.bag.as_ref()?;
        bag.names
            .iter()
            .all(|named| slot(&named.name).is_some())
            .then(|| slot(sensor.name.as_ref()?))
            .flatten()
    }

    /// Whether this is the file that is read.
    pub(crate) fn is_read_from(&self, path: &Path) -> bool {
        crate::base::files::is_same(path, &self.path)
    }

    /// The session that the file belongs to, without what belongs to it.
    pub(crate) fn session_around(&self) -> Option<&Path> {
        let folder = self.path.parent().filter(|folder| Session::is_session(folder));
        let has_metadata = |folder: &&Path| session_metadata(folder).is_ok_and(|files| !files.is_empty());
        folder.filter(|_| self.metadata.is_empty()).filter(has_metadata)
    }

    /// Metadata files in the folder of the capture that describe one of these sensors, or that bear its name; with packets
    /// of one of these lengths, where any is known, and none of whom others are given. What says the same counts once.
    pub(crate) fn nearby_metadata(&self, serials: &[u64], packet_bytes: &[usize]) -> Vec<PathBuf> {
        let Some(stem) = self.path.file_stem().and_then(|stem| stem.to_str()) else { return Vec::new() };
        let folder = self.path.parent().filter(|folder| !folder.as_os_str().is_empty());
        let Ok(files) = json_files(folder.unwrap_or(Path::new("."))) else { return Vec::new() };
        let named = |path: &PathBuf| {
            let name = path.file_stem().and_then(|name| name.to_str()).unwrap_or_default();
            name.strip_prefix(stem).is_some_and(|rest| ["", "_0", ".0", "_1", ".1", ".2"].contains(&rest))
        };
        let is_given = |path: &Path| {
            self.metadata.iter().any(|given| crate::base::files::is_same(path, Path::new(&given.name)))
        };
        let of_given =
            |serial: u64| self.metadata.iter().any(|given| given.metadata.serial_number() == Some(serial));
        let mut known: Vec<Metadata> = Vec::new();
        let mut describes = |path: &PathBuf| {
            let small = std::fs::metadata(path).is_ok_and(|file| file.len() < MOST_METADATA_BYTES);
            let text =
                if small { crate::base::files::read_text(path).unwrap_or_default() } else { String::new() };
            // what does not read as metadata is not what is looked for
            let Ok(metadata) = Metadata::parse(&text, "") else { return false };
            let length = metadata.packet_format().packet_bytes();
            let is_wanted = match metadata.serial_number() {
                Some(serial) if serials.contains(&serial) => true,
                Some(serial) if of_given(serial) => false,
                _ => named(path),
            };
            let metadata = as_decoded(&metadata);
            if !is_wanted
                || is_given(path)
                || !(packet_bytes.is_empty() || packet_bytes.contains(&length))
                || known.contains(&metadata)
            {
                return false;
            }
            known.push(metadata);
            true
        };
        files.into_iter().take(MAX_NEARBY_FILES).filter(|path| describes(path)).collect()
    }

    /// Metadata that lie next to it and describe its sensors, where none were given.
    fn metadata_found(&self) -> Vec<MetadataFile> {
        let is_looked_for = self.metadata.is_empty() && self.session.is_none();
        if !is_looked_for || !(self.path.is_file() || self.bag.is_some()) {
            return Vec::new();
        }
        let Ok(mut reader) = PacketReader::open(&self.path, &self.name) else { return Vec::new() };
        let mut met = OustersMet::default();
        look_first(|| {
            met.add(&reader.next().ok()??);
            Some(true)
        });
        if met.is_empty() {
            return Vec::new();
        }
        let nearby = self.nearby_metadata(&met.serials, &met.lengths);
        let chosen =
            met.choose(nearby, &self.path).into_iter().map(|path| AssignedFile { source_filter: None, path });
        metadata_of(&chosen.collect::<Vec<_>>(), &mut |_| Ok(())).unwrap_or_default()
    }

    /// The metadata of one of its sensors, as they were read.
    pub(crate) fn metadata_text(&self, sensor: &sensors::router::Sensor) -> Option<&str> {
        let name = sensor.metadata_name.as_ref()?;
        self.metadata.iter().find(|given| given.name == *name).map(|given| given.text.as_str())
    }

    /// A router that knows the sensors of the metadata, and where they send from if that is needed.
    pub(crate) fn router(&self) -> anyhow::Result<Router> {
        let mut router = Router::new();
        router.set_names(self.names());
        for MetadataFile { metadata, name, source_filter, .. } in &self.metadata {
            router.add_ouster_from(metadata.clone(), name.clone(), *source_filter);
        }
        for MetadataFile { metadata, name, .. } in self.metadata_found() {
            if !self.is_reported.swap(true, Ordering::Relaxed) {
                say_notice(&format!("{name} lies next to the recording and is used; --meta names others"));
            }
            router.add_ouster(metadata, name);
        }
        for calibration in &self.calibrations {
            router.add_calibration(calibration.clone());
        }
        for model in &self.models {
            router.add_model(*model);
        }
        // a pipe can be read but once
        if self.path.is_file() || self.bag.is_some() {
            let mut reader = PacketReader::open(&self.path, &self.name)?;
            // damage is found again, and reported, when the packets are decoded
            look_first(|| Some(router.learn(&reader.next().ok()??)));
            router.end_learning();
        }
        Ok(router)
    }

    /// Refuses a calibration that does not fit the sensor that it was given for.
    pub(crate) fn ensure_calibrations_fit(router: &Router) -> anyhow::Result<()> {
        for sensor in router.sensors() {
            if let Some((name, error)) = sensor.calibration_error() {
                let source = sensor.source().map_or(String::new(), |source| format!(" from {source}"));
                bail!("{name}, given for the {}{source}: {error}", sensor.product());
            }
        }
        Ok(())
    }

    /// The same, and metadata assigned to a sender that sends nothing.
    pub(crate) fn ensure_given_fits(&self, router: &Router) -> anyhow::Result<()> {
        Self::ensure_calibrations_fit(router)?;
        for sensor in router.sensors() {
            let (Some(source_filter), Some(name)) = (sensor.source_filter(), &sensor.metadata_name) else {
                continue;
            };
            let (is_found, whence) = match source_filter {
                SourceFilter::Sender(address) => {
                    (sensor.stats().packets > 0, format!("comes from {address}"))
                }
                SourceFilter::Port(port) => (sensor.data_port().is_some(), format!("goes to port {port}")),
                SourceFilter::Stream(stream) => {
                    let (address, port) = (stream.ip(), stream.port());
                    (sensor.data_port().is_some(), format!("comes from {address} and goes to port {port}"))
                }
            };
            if let Some(reason) = sensor.one_of_several().filter(|_| !self.is_assigned_by_recording) {
                bail!("--meta {source_filter}={name}: {reason}");
            }
            ensure!(
                is_found || self.is_assigned_by_recording, // a session's sensor may have been silent
                "--meta {source_filter}={name}: no packet that fits it, and no other --meta as well, {whence}; `outrigger inspect` lists \
                 who sends what where"
            );
        }
        Ok(())
    }

    /// How a session calls its sensors.
    fn names(&self) -> Vec<Named> {
        let Some((dir, manifest)) = &self.session else {
            return self.bag.as_ref().map_or_else(Vec::new, |bag| bag.names.clone());
        };
        let entries = manifest.sensors.iter().filter(|entry| !manifest.is_auxiliary(entry));
        let port = |entry: &SensorEntry| entry.address.map(|address| address.port());
        let named = |entry: &SensorEntry| Named {
            name: entry.name.clone(),
            metadata: entry.metadata.as_ref().map(|relative| dir.join(relative).display().to_string()),
            source: entry.source,
            port: port(entry),
            auxiliary_port: manifest
                .sensors
                .iter()
                .find(|other| other.name == auxiliary_name(&entry.name))
                .and_then(port),
        };
        entries.map(named).collect()
    }
}

/// A temporary copy of what can be read only once; none for another file.
pub(crate) fn spool(path: &Path) -> anyhow::Result<Option<NamedTempFile>> {
    let name = if path.as_os_str() == "-" { "standard input".into() } else { path.display().to_string() };
    keep_stream(path).with_context(|| format!("{name} cannot be copied to a temporary file (TMPDIR)"))
}
