//! What is given for the sensors of a recording: metadata of Ousters, calibrations and models of Velodynes.

use std::path::Path;

use sensors::router::{AppliesTo, GivenCalibration, GivenModel};
use sensors::velodyne::Calibration;

use super::RecordingError;
use crate::recording::Manifest;
use crate::recording::assigned_file::AssignedFile;

/// Files and models of sensors.
#[derive(Clone, Debug, Default)]
pub(crate) struct SensorFiles {
    pub metadata: Vec<AssignedFile>,
    pub calibrations: Vec<AssignedFile>,
    pub models: Vec<GivenModel>,
}

impl SensorFiles {
    /// The calibrations, read.
    pub(crate) fn read_calibrations(&self) -> Result<Vec<GivenCalibration>, RecordingError> {
        self.calibrations.iter().map(calibration).collect()
    }
}

fn calibration(file: &AssignedFile) -> Result<GivenCalibration, RecordingError> {
    let (applies_to, path) = match (file.source_filter, file.of_name()) {
        (Some(source_filter), _) => (AppliesTo::From(source_filter), file.path.clone()),
        (None, Some((name, path))) => (AppliesTo::Named(name), path),
        (None, None) => (AppliesTo::Everyone, file.path.clone()),
    };
    let name = path.display().to_string();
    let bytes = crate::base::files::read(&path)
        .map_err(|source| RecordingError::File { name: name.clone(), source })?;
    let calibration = Calibration::from_bytes(&bytes)
        .map_err(|source| RecordingError::Calibration { name: name.clone(), source })?;
    Ok(GivenCalibration { applies_to, name, calibration })
}

/// Refuses a calibration for a name that no sensor of a recording has; captures know no names.
pub(crate) fn ensure_named(
    calibrations: &[GivenCalibration],
    session: Option<&Manifest>,
    recording: &Path,
) -> Result<(), RecordingError> {
    for given in calibrations {
        let AppliesTo::Named(name) = &given.applies_to else { continue };
        let (name, file, recording) = (name.clone(), given.name.clone(), recording.display().to_string());
        let Some(manifest) = session else {
            return Err(RecordingError::NamesWithoutSession { name, file, recording });
        };
        let names = manifest.sensors.iter().filter(|entry| !manifest.is_auxiliary(entry));
        let names: Vec<&str> = names.map(|entry| entry.name.as_str()).collect();
        if !names.contains(&name.as_str()) {
            return Err(RecordingError::UnknownName { name, file, recording, known: names.join(", ") });
        }
    }
    Ok(())
}
