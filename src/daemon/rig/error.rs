//! Why the rig refused an order.

use firmware_protocol::AckCode;

use crate::drive::RigError;

/// Why a command was not carried out.
#[derive(Debug, thiserror::Error)]
pub enum RigCommandError {
    /// The configuration names none.
    #[error("no rig is configured: give [rig] a port in rig.toml")]
    NoRig,
    /// It does not answer.
    #[error("the rig is not connected: {0}")]
    NotConnected(String),
    /// Something else is in progress.
    #[error("the rig is busy with `{0}`: wait for its end, or hold")]
    Busy(&'static str),
    /// Motion was not allowed.
    #[error("this moves the rig: arm it first")]
    NotArmed,
    /// No mount is configured.
    #[error("no mount is configured: give [daemon] or [predict] a mount in rig.toml")]
    NoMount,
    /// A fault is latched.
    #[error("{0}: take its cause away, clear the faults, then arm the rig again")]
    Latched(RigError),
    /// The rig refused or failed.
    #[error(transparent)]
    Rig(RigError),
}

impl From<RigError> for RigCommandError {
    fn from(error: RigError) -> Self {
        match error {
            RigError::Fault { .. } | RigError::Refused { code: AckCode::Fault, .. } => Self::Latched(error),
            error => Self::Rig(error),
        }
    }
}
