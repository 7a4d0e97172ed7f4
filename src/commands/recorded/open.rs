//! Opening a recording with the mounts of its sensors.

use std::cell::OnceCell;

use anyhow::{Context as _, bail, ensure};
use sensors::router::{AppliesTo, GivenCalibration, SourceFilter};

use super::axes::{Tilts, tilts};
use super::{Recorded, RecordedArgs, Source, host_clock};
use crate::commands::Context;
use crate::commands::recording::{Recording, ensure_recording};
use crate::commands::registered::found_mount;
use crate::commands::sensor_args::{SensorArgs, ensure_named};
use crate::recording::Session;
use crate::recording::bags::is_bag_at;
use crate::recording::packet_reader::PacketReader;
use crate::rig::{MountFile, Rig};

impl Recorded {
    /// Opens a session or, where metadata are given too, whatever the path names as a capture. The sensors sit as `--mount`
    /// says, or as the recording does; a single sensor without a mount is level at the origin.
    pub(crate) fn open(args: &RecordedArgs, context: Context) -> anyhow::Result<Self> {
        if let Some(recorded) = Self::open_if_mounted(args, context)? {
            return Ok(recorded);
        }
        let (path, sensors) = (&args.recording, &args.sensors.of(context, &args.recording));
        let session = Session::is_session(path).then(|| Session::open(path)).transpose()?;
        let recording = Recording::open_to_reread(path, sensors)?;
        let mut notices = Vec::new();
        match found_mount::of_only_sensor(&recording, session.as_ref(), &mut notices)? {
            Some(mount) => Self::mounted(args, sensors, mount, (session, Some(recording)), notices),
            None => {
                bail!("{}: give --mount: the recording does not say where its sensors sit", path.display())
            }
        }
    }

    /// The same; none without mounts.
    pub(crate) fn open_if_mounted(args: &RecordedArgs, context: Context) -> anyhow::Result<Option<Self>> {
        let RecordedArgs { recording: path, sensors, mount, zeros } = args;
        let sensors = &sensors.of(context, path);
        // a name that was mistyped is no recording without a mount
        if path.as_os_str() != "-" {
            std::fs::metadata(path).with_context(|| path.display().to_string())?;
            ensure_recording(path)?;
        }
        let session = Session::is_session(path).then(|| Session::open(path)).transpose()?;
        let mount = match mount {
            Some(file) => Some(MountFile::read(file)?),
            None => session.as_ref().map(Session::mount).transpose()?.flatten(),
        };
        let (mut in_bag, mut notices) = (None, Vec::new());
        if mount.is_none() && is_bag_at(path) {
            let recording = Recording::open(path, sensors)?;
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
        Self::mounted(args, sensors, mount, (session, None), notices).map(Some)
    }

    /// With this mount: the session, where that has its metadata itself, or what was opened as a capture.
    fn mounted(
        args: &RecordedArgs,
        sensors: &SensorArgs,
        mount: MountFile,
        (session, opened): (Option<Session>, Option<Recording>),
        mut notices: Vec<String>,
    ) -> anyhow::Result<Self> {
        let RecordedArgs { recording: path, zeros, .. } = args;
        let rig = mount.rig()?;
        let source = match session {
            Some(mut session) if sensors.meta.is_empty() => {
                ensure!(
                    sensors.model.is_empty(),
                    "--model: {} is a session, which names the models of its sensors; give --model to a capture",
                    path.display()
                );
                notices.extend(host_clock::settle(&mut session, &rig)?);
                let calibrations = sensors.calibrations()?;
                ensure_meant(&calibrations, &session)?;
                let Tilts { histories: tilts, notices: not_homed } = tilts(&session, &rig, zeros)?;
                notices.extend(not_homed);
                zeros.ensure_measured(&rig, &tilts)?;
                Source::Session { session: Box::new(session), tilts, calibrations }
            }
            _ => {
                zeros.ensure_measured(&rig, &[])?;
                let opened = opened.map_or_else(|| Recording::open_to_reread(path, sensors), Ok)?;
                Source::Capture(Box::new(opened))
            }
        };
        let zeros = zeros.clone();
        Ok(Self { source, mount, rig, zeros, notices, span_ns: OnceCell::new() })
    }
}

/// A calibration that is meant for one sensor is meant for one of the session.
fn ensure_meant(calibrations: &[GivenCalibration], session: &Session) -> anyhow::Result<()> {
    let entries = &session.manifest().sensors;
    ensure_named(calibrations, Some(session.manifest()), session.dir())?;
    for given in calibrations {
        let AppliesTo::From(SourceFilter::Sender(address)) = given.applies_to else { continue };
        ensure!(
            entries.iter().any(|entry| entry.source == Some(address)),
            "--calibration {address}=...: {} names no sensor that sends from there; name the file under `calibrations` \
             in the mount file, or without an address where one holds for every Velodyne",
            session.dir().join(crate::recording::file::MANIFEST).display()
        );
    }
    Ok(())
}
