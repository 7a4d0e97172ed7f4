//! Anything recorded, opened as one thing: a capture, a bag or a session, with the metadata that belong to it; passes over its
//! packets.

mod error;
mod files;
mod found_metadata;
mod metadata;
mod nearby;
mod open;
mod pass;
mod router;
mod sensor_files;

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::AtomicBool;

use sensors::router::{GivenCalibration, GivenModel, Named};
use tempfile::NamedTempFile;

pub(crate) use error::RecordingError;
use files::inside_of;
pub(crate) use files::{ensure_recording, look_first, name_of, packets_of, spool};
use metadata::MetadataFile;
pub(crate) use metadata::session_metadata;
pub(crate) use open::RecordingSpec;
pub(crate) use pass::{Ending, capture_losses};
pub(crate) use sensor_files::{SensorFiles, ensure_named};

use crate::recording::observer::Observer;
use crate::recording::packet_reader::PacketReader;
use crate::recording::{Manifest, Session};
use crate::rig::Rig;

/// A recording with the metadata that belong to it.
pub(crate) struct Recording {
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
    pub(super) observer: Observer,
    /// Whether it was reported which metadata were found.
    is_reported: AtomicBool,
}

/// What is known of a bag before it is read.
struct BagAbout {
    names: Vec<Named>,
    holds_clouds_only: bool,
}

impl Recording {
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

    /// The metadata of one of its sensors, as they were read.
    pub(crate) fn metadata_text(&self, sensor: &sensors::router::Sensor) -> Option<&str> {
        let name = sensor.metadata_name.as_ref()?;
        self.metadata.iter().find(|given| given.name == *name).map(|given| given.text.as_str())
    }
}
