use std::path::Path;

use super::{CalibrationFile, MountFile, MountFileError, Rig, UnitError};

/// A mount file with the rig that it describes and the calibrations that it names.
#[derive(Debug)]
pub(crate) struct MountSlots {
    pub(crate) mount: MountFile,
    pub(crate) rig: Rig,
    pub(crate) calibrations: Vec<CalibrationFile>,
}

/// Why a mount file cannot be used.
#[derive(Debug, thiserror::Error)]
pub(crate) enum MountSlotsError {
    #[error(transparent)]
    File(#[from] MountFileError),
    #[error(transparent)]
    Unit(#[from] UnitError),
}

impl MountSlots {
    /// `axes` are the sensors that axis 0, 1, ... turn, where that is configured.
    pub(crate) fn read(path: &Path, axes: &[String]) -> Result<Self, MountSlotsError> {
        let mount = MountFile::read_by_axis(path, axes)?;
        Ok(Self { rig: mount.rig()?, calibrations: mount.calibration_files()?, mount })
    }
}
