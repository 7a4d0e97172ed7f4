//! Opening a recording: its packets, and the metadata that belong to it.

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::AtomicBool;

use super::metadata::{MetadataFile, metadata_of, recorded_from, session_metadata};
use super::{
    BagAbout, Recording, RecordingError, SensorFiles, ensure_named, ensure_recording, inside_of, name_of,
    packets_of, spool,
};
use crate::base::errors::with_causes;
use crate::recording::assigned_file::AssignedFile;
use crate::recording::bags::{BagPackets, is_bag_at, metadata_in, names_in};
use crate::recording::observer::Observer;
use crate::recording::packet_reader::{PacketReader, is_stream};
use crate::recording::{Manifest, Session};

/// What is opened, and what is given for its sensors.
#[derive(Clone, Debug, Default)]
pub(crate) struct RecordingSpec {
    /// `-` is standard input.
    pub path: PathBuf,
    pub sensors: SensorFiles,
    /// It is read more than once: standard input and pipes are copied to a temporary file.
    pub is_read_again: bool,
    pub observer: Observer,
}

impl RecordingSpec {
    /// The same of what is read more than once.
    pub(crate) fn reread(self) -> Self {
        Self { is_read_again: true, ..self }
    }

    /// The same without progress on the screen.
    pub(crate) fn without_progress(mut self) -> Self {
        self.observer.reading = Observer::default().reading;
        self
    }
}

impl Recording {
    /// Finds the packets (a session folder names them, and brings its metadata along) and reads the metadata.
    pub(crate) fn open(spec: &RecordingSpec) -> Result<Self, RecordingError> {
        let RecordingSpec { path: capture, sensors, .. } = spec;
        let mut paths = sensors.metadata.clone();
        let mut path = capture.clone();
        ensure_recording(capture)?;
        let (mut session, mut is_assigned_by_recording, mut unreadable) = (None, false, Vec::new());
        if Session::is_session(capture) {
            let manifest = Manifest::read(capture)?;
            path = packets_of(capture)?;
            if paths.is_empty() {
                paths = own_metadata(capture, &manifest, &mut unreadable)?;
                is_assigned_by_recording = true;
            }
            session = Some((capture.to_owned(), manifest));
        }
        let name = name_of(&path);
        let mut spooled = if spec.is_read_again { spool(&path)? } else { None };
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
        let mut tell = |error: RecordingError| {
            if !is_assigned_by_recording {
                return Err(error);
            }
            unreadable.push(with_causes(&error));
            Ok(())
        };
        let mut metadata = metadata_of(&paths, &mut tell)?;
        let mut bag = None;
        if let Some(packets) = opened.as_ref().and_then(PacketReader::bag) {
            is_assigned_by_recording = metadata.is_empty();
            bag = Some(BagAbout::read(packets, &name, &mut metadata, &mut unreadable));
        }
        let calibrations = sensors.read_calibrations()?;
        ensure_named(&calibrations, session.as_ref().map(|(_, manifest)| manifest), capture)?;
        Ok(Self {
            name,
            path,
            metadata,
            calibrations,
            models: sensors.models.clone(),
            session,
            bag,
            is_assigned_by_recording,
            unreadable,
            _spooled: spooled,
            opened: Mutex::new(opened),
            observer: spec.observer,
            is_reported: AtomicBool::new(false),
        })
    }
}

/// The metadata files of a session, each with the port that its sensor was recorded from.
fn own_metadata(
    session: &Path,
    manifest: &Manifest,
    unreadable: &mut Vec<String>,
) -> Result<Vec<AssignedFile>, RecordingError> {
    let mut files = session_metadata(session)?;
    let named = manifest.sensors.iter().filter_map(|entry| entry.metadata.as_ref());
    let named: Vec<PathBuf> = named.map(|relative| session.join(relative)).collect();
    files.extend(named.into_iter().filter(|file| !file.exists()));
    files.retain(|file| match inside_of(session, file) {
        Err(error) => {
            unreadable.push(format!("{}: cannot be read: {error}", file.display()));
            false
        }
        Ok(()) => true,
    });
    // units with packets that do not name them were recorded from ports of their own
    let assigned =
        |path: PathBuf| AssignedFile { source_filter: recorded_from(manifest, session, &path), path };
    Ok(files.into_iter().map(assigned).collect())
}

impl BagAbout {
    /// Reads its metadata, too, but for those of units that are known already.
    fn read(
        packets: &BagPackets,
        name: &str,
        metadata: &mut Vec<MetadataFile>,
        unreadable: &mut Vec<String>,
    ) -> Self {
        let serials: Vec<_> = metadata.iter().map(|given| given.metadata.serial_number()).collect();
        let (own, cannot_be_read) = metadata_in(packets, name, &serials);
        unreadable.extend(cannot_be_read);
        let names = names_in(packets, &own);
        metadata.extend(own.into_iter().map(|of| MetadataFile {
            source_filter: of.source_filter(),
            metadata: of.metadata,
            text: of.text,
            name: of.name,
        }));
        Self { names, holds_clouds_only: packets.holds_clouds_only() }
    }
}
