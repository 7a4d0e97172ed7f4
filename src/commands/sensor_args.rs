//! Options about the sensors of a recording: metadata of Ousters, calibrations and models of Velodynes, source filters.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail, ensure};
use sensors::ouster::Metadata;
use sensors::router::{AppliesTo, GivenCalibration, GivenModel, SourceFilter};
use sensors::velodyne::Calibration;

use super::Context;
use super::assigned_file::{AssignedFile, assigned_model};
use crate::recording::{Manifest, SensorEntry, Session};

/// Metadata of an Ouster.
pub struct MetadataFile {
    pub metadata: Metadata,
    /// The same as it was read.
    pub text: String,
    /// What messages call them.
    pub name: String,
    /// Which unit's they are, where somebody says.
    pub source_filter: Option<SourceFilter>,
}

/// Which sensors a recording is about: the options that `decode` and `inspect` share.
#[derive(clap::Args, Clone, Debug, Default)]
pub struct SensorArgs {
    /// Metadata of an Ouster sensor; once per sensor. Velodyne sensors need none. Where packets bear no serial number
    /// (LEGACY), several units of one model differ by their sender, 192.168.1.10=front.json, by the port of the lidar
    /// packets, :7502=front.json, or by both, 192.168.1.10:7502=front.json.
    #[arg(long = "meta", value_name = "[[ADDRESS][:PORT]=]META.json", value_parser = AssignedFile::parser())]
    pub meta: Vec<AssignedFile>,
    /// Calibration of a Velodyne (db.xml or YAML); with several, say for which: 192.168.1.201=left.xml, behind one address
    /// :2368=left.xml by the port of the data packets; in a session its name does, left=left.xml.
    #[arg(long, value_name = "[[ADDRESS][:PORT]=|NAME=]FILE", value_parser = AssignedFile::parser())]
    pub calibration: Vec<AssignedFile>,
    /// Product of a Velodyne with blank factory bytes in its packets: hdl-32e; with several, 192.168.1.201=hdl-32e
    /// or :2368=hdl-32e.
    #[arg(long, value_name = "[[ADDRESS][:PORT]=]MODEL", value_parser = assigned_model)]
    pub model: Vec<GivenModel>,
}

impl SensorArgs {
    /// Without what the rig.toml says of metadata, where the capture is a session that has its own.
    pub(crate) fn of(&self, context: Context, capture: &Path) -> Self {
        let mut sensors = self.clone();
        if !context.is_typed("meta") && session_metadata(capture).is_ok_and(|files| !files.is_empty()) {
            sensors.meta.clear();
        }
        sensors
    }

    /// The same, with the metadata of the rig.toml's sensors, where nothing else names any and the capture is no session.
    pub(crate) fn or_of(&self, context: Context, capture: &Path) -> Self {
        let mut sensors = self.of(context, capture);
        let config = context.config;
        if sensors.meta.is_empty() && !Session::is_session(capture) {
            let named = config.into_iter().flat_map(|config| &config.sensors);
            let files = named.filter_map(|sensor| sensor.metadata.clone());
            sensors.meta.extend(files.map(|path| AssignedFile { source_filter: None, path }));
        }
        sensors
    }

    /// The calibrations, read.
    pub(crate) fn calibrations(&self) -> anyhow::Result<Vec<GivenCalibration>> {
        self.calibration.iter().map(calibration).collect()
    }
}

/// The port that the sensor of a metadata file of a session was recorded from.
pub(crate) fn recorded_from(manifest: &Manifest, dir: &Path, file: &Path) -> Option<SourceFilter> {
    let is_of =
        |entry: &&SensorEntry| entry.metadata.as_ref().is_some_and(|relative| dir.join(relative) == file);
    let mut entries = manifest.sensors.iter().filter(|entry| !manifest.is_auxiliary(entry)).filter(is_of);
    match (entries.next(), entries.next()) {
        (Some(entry), None) => entry.address.map(|address| SourceFilter::Port(address.port())),
        _ => None,
    }
}

/// The metadata in some files; what describes a unit as another file does counts once. What cannot be read is reported.
pub(crate) fn metadata_of(
    files: &[AssignedFile],
    tell: &mut dyn FnMut(anyhow::Error) -> anyhow::Result<()>,
) -> anyhow::Result<Vec<MetadataFile>> {
    let mut known: Vec<MetadataFile> = Vec::with_capacity(files.len());
    for AssignedFile { source_filter, path } in files {
        let name = path.display().to_string();
        let text = crate::base::files::read_text(path).with_context(|| format!("{name}: cannot be read"));
        let (text, metadata) = match text.and_then(|text| Ok((Metadata::parse(&text, &name)?, text))) {
            Ok((metadata, text)) => (text, metadata),
            Err(error) => {
                tell(error)?;
                continue;
            }
        };
        let same_unit = |other: &&MetadataFile| {
            let serial = metadata.serial_number();
            let is_one = serial.is_some_and(|serial| other.metadata.serial_number() == Some(serial));
            is_one
                && other.source_filter == *source_filter
                && other.metadata.packet_format() == metadata.packet_format()
        };
        match known.iter().find(same_unit) {
            Some(other) if as_decoded(&other.metadata) == as_decoded(&metadata) => {}
            Some(other) => bail!(
                "{} and {name}: both of sensor {}, with packets of the same format, and they differ: give the one of the \
                 time of the recording",
                other.name,
                metadata.serial
            ),
            None => known.push(MetadataFile { metadata, text, name, source_filter: *source_filter }),
        }
    }
    Ok(known)
}

/// What decoding takes from metadata: not when it was switched on, what it runs and where it sends.
pub(crate) fn as_decoded(metadata: &Metadata) -> Metadata {
    let firmware = String::new();
    let (lidar_port, imu_port, zone_port, destination) = (None, None, None, None);
    Metadata { init_id: 0, firmware, lidar_port, imu_port, zone_port, destination, ..metadata.clone() }
}

fn calibration(file: &AssignedFile) -> anyhow::Result<GivenCalibration> {
    let (applies_to, path) = match (file.source_filter, file.of_name()) {
        (Some(source_filter), _) => (AppliesTo::From(source_filter), file.path.clone()),
        (None, Some((name, path))) => (AppliesTo::Named(name), path),
        (None, None) => (AppliesTo::Everyone, file.path.clone()),
    };
    let name = path.display().to_string();
    let bytes = crate::base::files::read(&path).with_context(|| name.clone())?;
    let calibration = Calibration::from_bytes(&bytes).with_context(|| name.clone())?;
    Ok(GivenCalibration { applies_to, name, calibration })
}

/// Refuses a calibration for a name that no sensor of a recording has; captures know no names.
pub(crate) fn ensure_named(
    calibrations: &[GivenCalibration],
    session: Option<&Manifest>,
    recording: &Path,
) -> anyhow::Result<()> {
    for given in calibrations {
        let AppliesTo::Named(name) = &given.applies_to else { continue };
        let (recording, file) = (recording.display(), &given.name);
        let Some(manifest) = session else {
            refuse!(
                "--calibration {name}={file}: {recording} is no session, so its sensors have no names: say ADDRESS={file}, or \
                 :PORT={file} with the port of its data packets"
            );
        };
        let names = manifest.sensors.iter().filter(|entry| !manifest.is_auxiliary(entry));
        let names: Vec<&str> = names.map(|entry| entry.name.as_str()).collect();
        ensure!(
            names.contains(&name.as_str()),
            "--calibration {name}={file}: no sensor of {recording} is called {name}; there are {}",
            names.join(", ")
        );
    }
    Ok(())
}

/// The metadata files of a session; none of what is no session.
pub(crate) fn session_metadata(session: &Path) -> anyhow::Result<Vec<PathBuf>> {
    json_files(&session.join(crate::recording::file::METADATA))
}

pub(crate) fn json_files(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
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
