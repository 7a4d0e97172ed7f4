//! Options about the sensors of a recording: metadata of Ousters, calibrations and models of Velodynes, source filters.

use std::path::Path;

use clap::builder::{OsStringValueParser, TypedValueParser};
use sensors::router::GivenModel;

use super::{Context, stage};
use crate::recording::Session;
use crate::recording::assigned_file::{AssignedFile, assigned_model};
use crate::recording::source::{RecordingSpec, SensorFiles, session_metadata};

/// Which sensors a recording is about: the options that `decode` and `inspect` share.
#[derive(clap::Args, Clone, Debug, Default)]
pub struct SensorArgs {
    /// Metadata of an Ouster sensor; once per sensor. Velodyne sensors need none. Where packets bear no serial number
    /// (LEGACY), several units of one model differ by their sender, 192.168.1.10=front.json, by the port of the lidar
    /// packets, :7502=front.json, or by both, 192.168.1.10:7502=front.json.
    #[arg(long = "meta", value_name = "[[ADDRESS][:PORT]=]META.json", value_parser = assigned_file())]
    pub meta: Vec<AssignedFile>,
    /// Calibration of a Velodyne (db.xml or YAML); with several, say for which: 192.168.1.201=left.xml, behind one address
    /// :2368=left.xml by the port of the data packets; in a session its name does, left=left.xml.
    #[arg(long, value_name = "[[ADDRESS][:PORT]=|NAME=]FILE", value_parser = assigned_file())]
    pub calibration: Vec<AssignedFile>,
    /// Product of a Velodyne with blank factory bytes in its packets: hdl-32e; with several, 192.168.1.201=hdl-32e
    /// or :2368=hdl-32e.
    #[arg(long, value_name = "[[ADDRESS][:PORT]=]MODEL", value_parser = assigned_model)]
    pub model: Vec<GivenModel>,
}

impl SensorArgs {
    /// What is opened.
    pub(crate) fn spec(&self, capture: &Path) -> RecordingSpec {
        let Self { meta, calibration, model } = self.clone();
        RecordingSpec {
            path: capture.to_owned(),
            sensors: SensorFiles { metadata: meta, calibrations: calibration, models: model },
            is_read_again: false,
            observer: stage::observer(),
        }
    }

    /// The same, without what the rig.toml says of metadata, where the capture is a session that has its own.
    pub(crate) fn of(&self, context: Context, capture: &Path) -> RecordingSpec {
        let mut spec = self.spec(capture);
        if !context.is_typed("meta") && session_metadata(capture).is_ok_and(|files| !files.is_empty()) {
            spec.sensors.metadata.clear();
        }
        spec
    }

    /// The same, with the metadata of the rig.toml's sensors, where nothing else names any and the capture is no session.
    pub(crate) fn or_of(&self, context: Context, capture: &Path) -> RecordingSpec {
        let mut spec = self.of(context, capture);
        let config = context.config;
        if spec.sensors.metadata.is_empty() && !Session::is_session(capture) {
            let named = config.into_iter().flat_map(|config| &config.sensors);
            let files = named.filter_map(|sensor| sensor.metadata.clone());
            spec.sensors.metadata.extend(files.map(|path| AssignedFile { source_filter: None, path }));
        }
        spec
    }
}

/// A file with or without its sensor.
fn assigned_file() -> impl TypedValueParser<Value = AssignedFile> {
    OsStringValueParser::new().try_map(AssignedFile::read)
}
