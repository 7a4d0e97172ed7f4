//! Opening a recording with the mounts of its sensors.

use std::cell::OnceCell;

use std::path::PathBuf;

use sensors::router::{AppliesTo, GivenCalibration, SourceFilter};

use super::axes::{Tilts, tilts};
use super::{AxisZeros, MountedRecording, Source, found_mount, host_clock};
use crate::recording::Session;
use crate::recording::bags::is_bag_at;
use crate::recording::packet_reader::PacketReader;
use crate::recording::source::{Recording, RecordingError, RecordingSpec, ensure_named, ensure_recording};
use crate::rig::{MountFile, Rig};

/// What is opened, and where its sensors sit.
#[derive(Clone, Debug, Default)]
pub(crate) struct MountedSpec {
    pub recording: RecordingSpec,
    /// A mount file; without one the recording's own mounts.
    pub mount: Option<PathBuf>,
    pub zeros: AxisZeros,
}

impl MountedRecording {
    /// Opens a session or, where metadata are given too, whatever the path names as a capture. The sensors sit as the mount
    /// file says, or as the recording does; a single sensor without a mount is level at the origin.
    pub(crate) fn open(spec: &MountedSpec) -> Result<Self, RecordingError> {
        if let Some(recording) = Self::open_if_mounted(spec)? {
            return Ok(recording);
        }
        let path = &spec.recording.path;
        let session = Session::is_session(path).then(|| Session::open(path)).transpose()?;
        let recording = Recording::open(&spec.recording.clone().reread())?;
        let mut notices = Vec::new();
        let mount = found_mount::of_only_sensor(&recording, session.as_ref(), &mut notices)?;
        Self::mounted(spec, mount, (session, Some(recording)), notices)
    }

    /// The same; none without mounts.
    pub(crate) fn open_if_mounted(spec: &MountedSpec) -> Result<Option<Self>, RecordingError> {
        let MountedSpec { recording, mount, zeros } = spec;
        let path = &recording.path;
        ensure_recording(path)?; // a name that was mistyped is no recording without a mount
        let session = Session::is_session(path).then(|| Session::open(path)).transpose()?;
        let mount = match mount {
            Some(file) => Some(MountFile::read(file)?),
            None => session.as_ref().map(Session::mount).transpose()?.flatten(),
        };
        let (mut in_bag, mut notices) = (None, Vec::new());
        if mount.is_none() && is_bag_at(path) {
            let recording = Recording::open(recording)?;
            in_bag = found_mount::of_bag(&recording, &mut notices)?;
        }
        let Some(mount) = mount.or(in_bag) else {
            // what is no recording at all does not lack a mount; a pipe could be read but once
            if path.is_file() || path.is_dir() {
                PacketReader::open(path, &path.display().to_string())?;
            }
            zeros.ensure_measured(&Rig { sensors: Vec::new() }, &[])?;
            return Ok(None);
        };
        Self::mounted(spec, mount, (session, None), notices).map(Some)
    }

    /// With this mount: the session, where that has its metadata itself, or what was opened as a capture.
    fn mounted(
        spec: &MountedSpec,
        mount: MountFile,
        (session, opened): (Option<Session>, Option<Recording>),
        mut notices: Vec<String>,
    ) -> Result<Self, RecordingError> {
        let RecordingSpec { path, sensors, observer, .. } = &spec.recording;
        let zeros = &spec.zeros;
        let rig = mount.rig()?;
        let source = match session {
            Some(mut session) if sensors.metadata.is_empty() => {
                if !sensors.models.is_empty() {
                    return Err(RecordingError::ModelOfSession { recording: path.display().to_string() });
                }
                notices.extend(host_clock::settle(&mut session, &rig, *observer)?);
                let calibrations = sensors.read_calibrations()?;
                ensure_meant(&calibrations, &session)?;
                let Tilts { histories: tilts, notices: not_homed } = tilts(&session, &rig, zeros)?;
                notices.extend(not_homed);
                zeros.ensure_measured(&rig, &tilts)?;
                Source::Session { session: Box::new(session), tilts, calibrations }
            }
            _ => {
                zeros.ensure_measured(&rig, &[])?;
                let opened = opened.map_or_else(|| Recording::open(&spec.recording.clone().reread()), Ok)?;
                Source::Capture(Box::new(opened))
            }
        };
        let (observer, zeros) = (*observer, zeros.clone());
        Ok(Self { source, observer, mount, rig, zeros, notices, span_ns: OnceCell::new() })
    }
}

/// A calibration that is meant for one sensor is meant for one of the session.
fn ensure_meant(calibrations: &[GivenCalibration], session: &Session) -> Result<(), RecordingError> {
    let entries = &session.manifest().sensors;
    ensure_named(calibrations, Some(session.manifest()), session.dir())?;
    for given in calibrations {
        let AppliesTo::From(SourceFilter::Sender(address)) = given.applies_to else { continue };
        if !entries.iter().any(|entry| entry.source == Some(address)) {
            let manifest = session.dir().join(crate::recording::file::MANIFEST).display().to_string();
            return Err(RecordingError::UnknownSender { address: address.to_string(), manifest });
        }
    }
    Ok(())
}
