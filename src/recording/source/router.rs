//! From a recording to a router that knows its sensors.

use std::sync::atomic::Ordering;

use sensors::router::{Named, Router, SourceFilter};

use super::{MetadataFile, Recording, RecordingError, look_first};
use crate::live::receive::auxiliary_name;
use crate::recording::SensorEntry;
use crate::recording::packet_reader::PacketReader;

impl Recording {
    /// A router that knows the sensors of the metadata, and where they send from if that is needed.
    pub(crate) fn router(&self) -> Result<Router, RecordingError> {
        let mut router = Router::new();
        router.set_names(self.names());
        for MetadataFile { metadata, name, source_filter, .. } in &self.metadata {
            router.add_ouster_from(metadata.clone(), name.clone(), *source_filter);
        }
        for MetadataFile { metadata, name, .. } in self.metadata_found() {
            if !self.is_reported.swap(true, Ordering::Relaxed) {
                let notice = format!("{name} lies next to the recording and is used; --meta names others");
                (self.observer.notice)(&notice);
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
    pub(crate) fn ensure_calibrations_fit(router: &Router) -> Result<(), RecordingError> {
        for sensor in router.sensors() {
            if let Some((name, error)) = sensor.calibration_error() {
                let source = sensor.source().map_or(String::new(), |source| format!(" from {source}"));
                let sensor = format!("the {}{source}", sensor.product());
                let (name, error) = (name.to_owned(), error.to_string());
                return Err(RecordingError::CalibrationDoesNotFit { name, sensor, error });
            }
        }
        Ok(())
    }

    /// The same, and metadata assigned to a sender that sends nothing.
    pub(crate) fn ensure_given_fits(&self, router: &Router) -> Result<(), RecordingError> {
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
            if self.is_assigned_by_recording {
                continue; // a session's sensor may have been silent
            }
            let (source_filter, name) = (source_filter.to_string(), name.clone());
            if let Some(reason) = sensor.one_of_several() {
                let reason = reason.to_string();
                return Err(RecordingError::MetadataOfSeveral { source_filter, name, reason });
            }
            if !is_found {
                return Err(RecordingError::MetadataWithoutPackets { source_filter, name, whence });
            }
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
